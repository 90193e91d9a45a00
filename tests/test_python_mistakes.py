"""Mistakes of users who call `ncomp` from Python: each is a UserError in the words of Python."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.machine_texts import machine_text

import ncomp

ROOT = Path(__file__).parents[1]
PROGRAM = "G21 G90 G54\nT1 M6\nG0 X10 Y0 Z0\nG1 X60 F500\nM30\n"
MILL = machine_text("w X Y b Z t", travel=(0, 600))
GANTRY = ncomp.load_machine("gantry")


def plan():
    return ncomp.plan(GANTRY, "random", 40)


def measured():
    return ncomp.simulate(plan(), ncomp.virtual_machine(GANTRY)).measurement


def zero():
    return ncomp.set_up(GANTRY, zero=True)


def of_laser(temperature):
    return ncomp.simulate_continuous(GANTRY, "none", "X", 0, 100, temperature=temperature)


MISTAKES = {
    "no machine": (lambda: ncomp.load_machine(None), "machine=None: expected a text or a path or a Machine"),
    "unknown machine": (lambda: ncomp.load_machine("gantri"), "did you mean 'gantry'"),
    "calibration of another machine": (
        lambda: ncomp.predict(np.zeros((1, 5)), "dmu50", ncomp.virtual_machine(GANTRY)),
        "is of machine gantry",
    ),
    "no calibration": (
        lambda: ncomp.correct(PROGRAM, GANTRY, setup=zero()),
        'calibration="CAL.json" (\'ncomp fit\' makes one from measurements), or calibration="none"',
    ),
    "bytes": (lambda: ncomp.correct(b"G21\n", GANTRY, "none"), "expected a text or a path or a Source"),
    "no file": (lambda: ncomp.correct("nofile.nc", GANTRY, "none"), "program nofile.nc: No such file"),
    "set-up missing": (
        lambda: ncomp.correct(PROGRAM, "mill.toml", "none"),
        'give it by work_offset="G54=x,y,z", by tool_table=, in the job file or in the machine file, or take zero on '
        "purpose by zero=True",
    ),
    "text as a number": (
        lambda: ncomp.correct(PROGRAM, GANTRY, "none", setup=zero(), tolerance_um="1"),
        "tolerance_um='1': expected a finite number, 0 or above",
    ),
    "negative tolerance": (
        lambda: ncomp.correct(PROGRAM, GANTRY, "none", setup=zero(), tolerance_um=-1),
        "tolerance_um=-1: expected a finite number, 0 or above",
    ),
    "misspelt argument": (
        lambda: ncomp.correct(PROGRAM, GANTRY, "none", tolerance=1),
        "unexpected keyword argument 'tolerance' (did you mean 'tolerance_um'?)",
    ),
    "unknown class": (
        lambda: ncomp.correct(PROGRAM, GANTRY, "none", setup=zero(), classes="A-VOL"),
        "classes=\"A-VOL\": 'A-VOL' is none of",
    ),
    "unknown condition": (
        lambda: ncomp.correct(PROGRAM, GANTRY, "none", setup=zero(), accept="stael"),
        "accept=\"stael\": 'stael' is unknown (did you mean 'stale'?)",
    ),
    "unknown dialect": (lambda: ncomp.check(PROGRAM, GANTRY, dialect="fanuk"), "dialect="),
    "no set-up": (
        lambda: ncomp.correct(PROGRAM, GANTRY, "none", setup="G54=0,0,0"),
        "expected a Setup (of ncomp.set_up)",
    ),
    "work offset": (lambda: ncomp.set_up(GANTRY, work_offset="G54"), 'work_offset="G54": expected G54=x,y,z'),
    "work offset by name": (
        lambda: ncomp.set_up(GANTRY, work_offset={"G54": (0, float("nan"), 0)}),
        "work_offset=\"G54=0,nan,0\": 'nan' is no number",
    ),
    "work offset as a number": (lambda: ncomp.set_up(GANTRY, work_offset=5), "work_offset=5: expected NAME=VALUE"),
    "datum": (lambda: ncomp.set_up(GANTRY, datum={"G54": "guessed"}), 'datum="G54=guessed": '),
    "table unit": (lambda: ncomp.set_up(GANTRY, table_unit="cm"), "table_unit='cm': expected 'mm' or 'inch' or None"),
    "temperature": (lambda: ncomp.conditions(temperature="spindle"), 'temperature="spindle": expected SENSOR=degC'),
    "elapsed": (lambda: ncomp.conditions(elapsed=-1), "elapsed=-1: expected a finite number, 0 or above"),
    "plan of a text": (lambda: ncomp.plan(GANTRY, "rnadom", 20), "did you mean 'random'"),
    "no points": (lambda: ncomp.plan(GANTRY, "random", 0), "points=0: expected a whole number, 1 or above"),
    "points as a fraction": (lambda: ncomp.plan(GANTRY, "random", 2.5), "points=2.5: expected a whole number"),
    "choices as a dict": (lambda: ncomp.plan(GANTRY, "random", 20, choices={"runs": 2}), "expected a Choices"),
    "no plan": (lambda: ncomp.simulate("plan.csv", "none"), "plan='plan.csv': expected a Plan (of ncomp.plan)"),
    "negative seed": (lambda: ncomp.simulate(plan(), "none", seed=-1), "seed=-1: expected a whole number, 0 or above"),
    "points of no strategy": (lambda: ncomp.plan(GANTRY, "grid", []), "points: the list is empty"),
    "no measurement": (lambda: ncomp.fit("data.csv"), "expected a Measurement (of ncomp.read_measurement)"),
    "list for a measurement": (lambda: ncomp.fit([1.0, 2.0]), "expected a Measurement (of ncomp.read_measurement)"),
    "unknown basis": (lambda: ncomp.fit(measured(), basis="foo"), "basis 'foo' is none of"),
    "unknown noise": (lambda: ncomp.fit(measured(), noise="guess"), "noise='guess': expected 'sheet' or 'estimate'"),
    "effect of no axis": (
        lambda: ncomp.fit(measured(), effects="backlash:axis=Q,width=0"),
        'effects="backlash:axis=Q,width=0": machine gantry',
    ),
    "too little": (lambda: ncomp.fit(measured(), valid_days=0), "valid_days=0: expected a finite number, 1 to 36500"),
    "none together": (lambda: ncomp.fit_together([]), "0 measurements: a common fit needs two or more"),
    "one together": (
        lambda: ncomp.fit_together([measured()]),
        "1 measurement: a common fit needs two or more; 'ncomp fit' takes one",
    ),
    "circles of a tracker": (
        lambda: ncomp.ballbar(measured()),
        "measurement: circles need the measurement of a ballbar",
    ),
    "laser of a tracker": (lambda: ncomp.iso230(measured()), "measurement: "),
    "diagnosis of a path": (lambda: ncomp.diagnose("data.csv"), "expected a Measurement"),
    "format": (lambda: ncomp.export(GANTRY, "siemens", "none"), "format="),
    "format of parameters": (lambda: ncomp.export_parameters("dmu50", "siemens"), "format"),
    "sign": (lambda: ncomp.export(GANTRY, "linuxcnc", "none", sign="plus"), "sign='plus': expected 'error' or"),
    "setting": (
        lambda: ncomp.export(GANTRY, "linuxcnc", "none", settings={"pointz": 3}),
        'settings="pointz=3": expected NAME=VALUE',
    ),
    "tables of no file": (lambda: ncomp.import_tables("no", GANTRY, "linuxcnc"), "tables no: No such file"),
    "reference": (
        lambda: ncomp.compare(ncomp.virtual_machine(GANTRY), ncomp.virtual_machine(GANTRY), reference={"Q": 1}),
        'reference="Q=1": gantry',
    ),
    "header": (lambda: ncomp.read_measurement("x.csv", GANTRY, header=["u_um"]), 'header="u_um": expected KEY=VALUE'),
    "no data": (lambda: ncomp.read_measurement("nothing.csv", GANTRY), "nothing.csv: No such file"),
    "axis": (lambda: ncomp.simulate_continuous("dmu50", "none", "C", 0, 100), 'axis="C": a laser follows linear axes'),
    "run": (
        lambda: ncomp.simulate_continuous(GANTRY, "none", "X", 0, 1e5),
        "end_mm=100000: outside the travel of X",
    ),
    "one temperature": (lambda: of_laser({"spindle": 25.0}), "temperature['spindle']: expected two numbers"),
    "temperature as a text": (lambda: of_laser({"spindle": ("cold", 25)}), "temperature['spindle']: expected two"),
    "unknown temperature": (lambda: of_laser({"spindle": (20, float("nan"))}), "temperature['spindle']: expected two"),
    "sensor by number": (lambda: of_laser({1: (20, 25)}), "temperature[1]: expected a name of a sensor"),
    "no laser run": (lambda: ncomp.continuous([]), "data: no file is given"),
    "folder": (lambda: ncomp.batch("nowhere", "out", GANTRY, "none"), "folder nowhere: No such file"),
    "argument of all programs": (
        lambda: ncomp.batch(ROOT / "examples", "out", GANTRY, "none", tolerance=1),
        "unexpected keyword argument 'tolerance'",
    ),
    "argument of one program": (
        lambda: ncomp.batch(ROOT / "examples", "out", GANTRY, "none", one_of_several=False),
        "batch(): one_of_several is an argument for one program alone",
    ),
    "moves of each program": (
        lambda: ncomp.batch(ROOT / "examples", "out", GANTRY, "none", traced=True),
        "batch(): traced is an argument for one program alone",
    ),
    "job file": (lambda: ncomp.job("no.toml"), "job file no.toml: No such file"),
    "machine in place of a job file": (lambda: ncomp.job("mill.toml"), "machine file (machine=)"),
    "watched folder": (lambda: ncomp.watch("nowhere", "out", "gantry", "none"), "folder nowhere: No such file"),
    "watched without output": (lambda: ncomp.watch("in", machine="gantry"), "watch(): output is missing"),
    "watched without machine": (lambda: ncomp.watch("in", "out"), "watch(): machine is missing"),
    "watched by an object": (lambda: ncomp.watch("in", "out", GANTRY), "expected a text or a path or None"),
    "watched with the set-up of one program": (
        lambda: ncomp.watch("in", "out", "gantry", "none", setup=zero()),
        "watch(): setup is an argument for one program alone: give its values as set_up={...}",
    ),
    "misspelt in the set-up": (
        lambda: ncomp.watch("in", "out", "gantry", "none", set_up={"zeros": True}),
        "unexpected keyword argument 'zeros' (did you mean 'zero'?)",
    ),
    "a number in the set-up": (
        lambda: ncomp.watch("in", "out", "gantry", "none", set_up={1: 2}),
        "set_up(): 1 is no name of an argument",
    ),
    "empty pattern": (lambda: ncomp.batch(ROOT / "examples", "out", GANTRY, "none", glob=""), 'glob="": expected a'),
    "entry of a job file": (
        lambda: ncomp.watch("in", "out", "gantry", job="job.toml"),
        "watch(): machine is an entry of the job file job.toml",
    ),
    "job file with an output": (lambda: ncomp.watch("job.toml", "out"), "give no output, job, glob or drift"),
    "time of rest": (lambda: ncomp.watch("in", "out", "gantry", settle=0), "0.1 to 600"),
    "study": (lambda: ncomp.study("no.toml"), "no.toml: No such file"),
    "page": (lambda: ncomp.report(ROOT / "README.md"), "expected a page written by"),
    "model to save": (lambda: ncomp.save("cal.json", "cal.json"), "expected an ErrorModel"),
    "one row": (lambda: ncomp.predict(np.zeros(3), GANTRY, "none"), "points: expected an array (n, 3) of X, Y, Z"),
    "columns": (lambda: ncomp.predict(np.zeros((4, 5)), GANTRY, "none"), "not one of shape (4, 5)"),
    "not finite": (lambda: ncomp.predict(np.full((2, 3), np.nan), GANTRY, "none"), "points: row 0 has a number that"),
    "texts": (lambda: ncomp.predict([["a", "b", "c"]], GANTRY, "none"), "expected a text or a path"),
    "direction": (
        lambda: ncomp.predict(np.zeros((2, 3)), GANTRY, "none", approach=[2, 0, 0]),
        "approach: expected -1, 0 or 1",
    ),
    "length of a column": (
        lambda: ncomp.predict(np.zeros((2, 3)), GANTRY, "none", time=[1, 2, 3]),
        "time: expected an array of shape (2,), or () for all rows, not (3,)",
    ),
    "temperature of a text": (
        lambda: ncomp.predict(np.zeros((2, 3)), GANTRY, "none", temperatures={"air": "warm"}),
        "temperatures['air']: expected numbers",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_a_user_error_in_the_words_of_python(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mill.toml").write_text(MILL)
    mistake, expected = MISTAKES[name]
    with pytest.raises(ncomp.UserError) as refused:
        mistake()
    message = str(refused.value)
    assert expected in message
    assert "--" not in message


def test_the_same_mistake_on_the_command_line_is_in_its_own_words(command, tmp_path):
    (tmp_path / "in.nc").write_text(PROGRAM)
    done = command("in.nc", "-m", "gantry", "-c", "none", "--work-offset", "G54")
    assert "--work-offset G54: expected G54=x,y,z" in done.err
    (tmp_path / "mill.toml").write_text(MILL)
    (tmp_path / "posted").mkdir()
    for name in ("a.nc", "b.nc"):
        (tmp_path / "posted" / name).write_text(PROGRAM)
    for jobs in ("1", "2"):
        done = command("batch", "posted", "out", "-m", "mill.toml", "-c", "none", "--jobs", jobs)
        assert done.err.count("--work-offset G54=x,y,z") + done.out.count(b"--work-offset G54=x,y,z") == 2
    result = ncomp.batch("posted", "out", "mill.toml", "none", jobs=2)
    assert all('work_offset="G54=x,y,z"' in end.reason for end in result.outcomes.values())


def test_values_by_name_are_those_of_texts():
    by_text = ncomp.set_up("dmu50", work_offset=["G54=-30,-20.5,150"], tool_length="T1=80", datum="G54=true")
    by_name = ncomp.set_up(
        "dmu50", work_offset={"G54": np.array([-30, -20.5, 150])}, tool_length={"T1": 80}, datum={"G54": "true"}
    )
    assert by_name == by_text
    turned = ncomp.set_up("dmu50", work_offset={"G54": {"X": 1, "C": 90}})
    assert turned == ncomp.set_up("dmu50", work_offset="G54=X=1,C=90")
    warm = ncomp.conditions(temperature={"spindle": 31.5}, elapsed=np.float64(60))
    assert warm == ncomp.conditions(temperature="spindle=31.5", elapsed=60)


def test_numbers_of_numpy_and_whole_numbers_are_numbers():
    assert ncomp.plan(GANTRY, "random", np.int64(20)).positions.shape == (20, 3)
    assert ncomp.plan(GANTRY, "random+grid", (np.int32(5), 8)).positions.shape[0] > 5
