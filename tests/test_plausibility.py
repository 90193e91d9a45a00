"""An implausible correction ends with one message and no file; accepted by name, it is named in every output."""

import datetime
import json
import re
from pathlib import Path

import msgspec
import pytest
from support.programs import load, model_of
from support.tiers import quick

from kinematics.basis import Fourier, Legendre
from kinematics.effects import Backlash, DriftWithSensor, ErrorMotion, LocationError
from kinematics.error_model.model import ErrorModel, decode_model, write_model
from postproc.write.writer import Writer

NOW = datetime.datetime.now(datetime.UTC)
PROGRAM = "G21 G17 G90\nG0 X100.0 Y100.0 Z100.0\nG1 X200.0 F500\nY300.0\nM30\n"
GANTRY = ("--machine", "gantry", "--calibration", "cal.json", "--datum", "G54=true", "--set-up-zero", "-o", "out.nc")


def of_x(um: float = 10.0, u: float = 0.1) -> ErrorModel:
    return model_of(load("gantry"), LocationError("X", "X", um, u=(u,)))


def made(model: ErrorModel, days_ago: float, **fields: object) -> ErrorModel:
    provenance = msgspec.structs.replace(model.provenance, made_at=NOW - datetime.timedelta(days=days_ago), **fields)
    return msgspec.structs.replace(model, provenance=provenance)


@pytest.fixture
def ncomp(command):
    """Corrects PROGRAM, or another, with a calibration; nothing but inputs is left behind a refusal."""

    def run(model: ErrorModel, *options: object, program: str = PROGRAM):
        Path("in.nc").write_text(program)
        write_model(model, Path("cal.json"))
        Path("out.nc").unlink(missing_ok=True)
        done = command("in.nc", *GANTRY, *options)
        if done.status:
            assert done.status == 2, done.err
            assert sorted(path.name for path in Path().iterdir()) == ["cal.json", "in.nc"]
            assert "Traceback" not in done.err
            piped = command("in.nc", *GANTRY[:-2], *options)
            assert (piped.status, piped.out) == (2, b"")
        return done

    return run


OUTSIDE = model_of(load("gantry"), ErrorMotion("X", "X", Legendre((0.0, 150.0), 1), (10.0, 2.0), u=(0.1, 0.1)))
WARM = model_of(load("gantry"), DriftWithSensor(component="X", sensor="spindle", coefficient=2.0, u=(0.01,)))
RANGE = {"temperatures_degC": {"spindle": (18.0, 28.0)}}
IMPLAUSIBLE = {
    "stale": (made(of_x(), 400.0), (), ("13 months old (400 days)", "valid for 365 days")),
    "stale by its own": (made(of_x(), 40.0, valid_days=30.0), (), ("6 weeks old (40 days)", "valid for 30 days")),
    "future": (made(of_x(), -2.0), (), ("days ahead", "clock")),
    "temperature": (
        made(WARM, 1.0, **RANGE),
        ("--temperature", "spindle=31.5"),
        ("temperature spindle is 31.5 degC", "from 18 to 28 degC"),
    ),
    "outside": (OUTSIDE, (), ("2 of 3 evaluated moves (66.7%)", "lines 3-4")),
    "insignificant": (of_x(10.0, 6.0), (), ("3 of 3 moves", "2 times its standard uncertainty")),
}


@pytest.mark.parametrize("case", quick(IMPLAUSIBLE, ["stale", "temperature", "outside"]))
def test_refused_with_the_figure_unless_accepted(ncomp, case):
    model, options, words = IMPLAUSIBLE[case]
    name = case.split()[0]
    refused = ncomp(model, *options)
    assert refused.status == 2
    for word in (*words, f"--accept {name}"):
        assert word in refused.err
    others = ",".join(sorted({"stale", "future", "temperature", "outside", "insignificant", "worse"} - {name}))
    assert ncomp(model, *options, "--accept", others).status == 2
    accepted = ncomp(model, *options, "--accept", f"worse, {name}", "--json", "-")
    assert accepted.status == 0, accepted.err
    assert list(json.loads(accepted.out)["accepted"]) == [name]
    for text in (accepted.err, json.loads(accepted.out)["accepted"][name]):
        assert words[0] in text


@pytest.mark.parametrize("case", quick(IMPLAUSIBLE, ["stale"]))
def test_the_page_gives_the_figure_that_is_accepted(ncomp, case):
    model, options, words = IMPLAUSIBLE[case]
    accepted = ncomp(model, *options, "--accept", f"worse, {case.split()[0]}", "--report", "page.html")
    assert accepted.status == 0, accepted.err
    assert words[0].replace("degC", "°C").replace("%", "\u00a0%") in Path("page.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("model", "options"),
    [
        (made(of_x(), 364.0), ()),
        (made(of_x(), 400.0, valid_days=500.0), ()),
        (made(of_x(), -0.003), ()),
        (made(WARM, 1.0, **RANGE), ("--temperature", "spindle=28")),
        (made(WARM, 1.0), ("--temperature", "spindle=60")),
        (msgspec.structs.replace(made(of_x(10.0, 6.0), 4000.0), demonstration=True), ()),
        (msgspec.structs.replace(made(of_x(), -4000.0), demonstration=True), ()),
        (of_x(0.9, 6.0), ()),
        (of_x(10.0, 0.0), ()),
        (of_x(0.0, 6.0), ()),
    ],
    ids=[
        "nearly stale", "valid longer", "clocks differ", "at the end of the range", "no range stated",
        "old demonstration", "future demonstration", "nothing above the tolerance", "no uncertainty", "no error",
    ],
)  # fmt: skip
def test_plausible(ncomp, model, options):
    done = ncomp(model, *options)
    assert done.status == 0, done.err
    assert "accepted" not in done.err


def test_one_per_cent_of_the_moves_may_end_outside(ncomp):
    inside = "".join(f"X{100 + i % 7}.0\n" for i in range(198))
    program = f"G21 G17 G90\nG0 X100.0 Y100.0 Z100.0\nG1 F500 X101.0\n{inside}{{}}M30\n"
    assert ncomp(OUTSIDE, program=program.format("X151.0\nX150.0\nX151.0\n")).status == 0
    refused = ncomp(OUTSIDE, program=program.format("X151.0\nX150.0\nX151.0\nX152.0\n"))
    assert refused.status == 2
    assert "3 of 204 evaluated moves (1.5%)" in refused.err


def test_an_unknown_name_is_refused_with_the_list(command):
    Path("in.nc").write_text(PROGRAM)
    done = command("in.nc", "-m", "dmu50", "--accept", "stale,everything", "-o", "out.nc")
    assert done.status == 2
    assert "'everything' is unknown" in done.err
    assert "stale, future, temperature, outside, insignificant, worse" in done.err
    assert not Path("out.nc").exists()


# ---- the size of a correction


def test_the_user_limits_corrections(ncomp):
    refused = ncomp(of_x(10.0), "--max-correction-um", 5)
    assert refused.status == 2
    assert (
        "in.nc:2: 'G0 X100.0 Y100.0 Z100.0': X would be corrected by 10 um, more than 5 um (--max-correction-um)"
        in (refused.err)
    )
    assert ncomp(of_x(10.0), "--max-correction-um", 10).status == 0


def test_no_calibration_allows_more_than_500_um_by_itself(ncomp):
    refused = ncomp(of_x(600.0))
    assert refused.status == 2
    assert "600 um, more than 500 um" in refused.err
    assert ncomp(of_x(600.0), "--max-correction-um", 600).status == 0
    assert ncomp(of_x(600.0), "--max-correction-um", 6000).status == 2
    assert ncomp(of_x(600.0), "--max-correction-um", "nan").status == 2


def test_by_default_twice_the_largest_error_over_the_travel(ncomp):
    """Beyond the travel a squareness error grows on."""
    model = model_of(load("gantry"), LocationError("C", "Y", 10.0, u=(0.01,)))
    far = "G21 G17 G90\nG0 X100.0 Y{}.0 Z100.0\nM30\n"
    done = ncomp(model, "--no-travel-check", "--json", "-", program=far.format(5900))
    assert done.status == 0, done.err
    assert json.loads(done.out)["max_correction_um"] == pytest.approx(2 * 30.0, rel=0.01)
    refused = ncomp(model, "--no-travel-check", program=far.format(6100))
    assert refused.status == 2
    assert "X would be corrected by 61 um, more than 60 um (twice the largest error" in refused.err


def test_the_limit_knows_play_and_tools():
    from postproc.compensation.correction import COLD
    from postproc.correct.plausibility import largest_error_um

    gantry = load("gantry")
    play = model_of(gantry, Backlash(axis="X", width=15.0), Backlash(axis="Y", width=20.0))
    assert largest_error_um(gantry, play, COLD, (0.0, 0.0, 0.0)) == pytest.approx(12.5)
    tilted = model_of(load("dmu50"), ErrorMotion("A", "Z", Legendre((0.0, 400.0), 0), (100.0,)))
    short, long = (largest_error_um(load("dmu50"), tilted, COLD, (0.0, 0.0, -tip)) for tip in (0.0, 200.0))
    assert long - short == pytest.approx(20.0, rel=0.2)


# ---- never worse than in the input

TABLE = ErrorMotion("Y", "C", Fourier((0.0, 360.0), (2.0,)), (0.0, 0.0, 20.0, 0.0), u=(0.1,) * 4)
TURNED = "G21 G17 G90\nG0 X10.0 Y10.0 Z200.0 B0 C90\n{}\nG1 {} F500\nG1 X20.0\nM30\n"


@pytest.fixture
def turned(command):
    """Corrects a program with C on a DMU 50 whose table moves with twice the angle of C."""

    def run(before: str, block: str, *options: object):
        Path("in.nc").write_text(TURNED.format(before, block))
        write_model(model_of(load("dmu50"), TABLE), Path("cal.json"))
        return command(
            "in.nc", "-m", "dmu50", "-c", "cal.json", "-o", "out.nc", "--no-travel-check", "--set-up-zero", *options
        )

    return run


def test_a_position_is_left_where_turning_from_it_would_be_worse(turned):
    done = turned("G1 X12.0 F500", "C270", "--json", "-")
    assert done.status == 0, done.err
    result = json.loads(done.out)
    assert "accepted" not in done.err
    assert any(
        note.startswith("not corrected: its correction would make") and "(line 3)" in note for note in result["notes"]
    )
    lines = Path("out.nc").read_text().splitlines()
    assert lines[-5:-2] == ["G0 X10.0 Y9.9800 Z200.0 B0 C90", "G1 X12.0 Y10.0000 F500", "G1 C270 F500"]
    assert lines[-2] == "G1 X20.0 Y10.0200"
    assert result["predicted_error_um"]["after"]["max"] <= result["predicted_error_um"]["before"]["max"]


def test_a_small_turn_keeps_its_correction(turned):
    done = turned("G1 X12.0 F500", "C100")
    assert done.status == 0, done.err
    assert "its correction would make" not in done.err


PLAY = model_of(load("gantry"), Backlash(axis="X", width=15.0, u=(0.1,)))
WORSE = "predicted to be worse than in the input"


def test_a_move_that_would_be_worse_than_in_the_input_is_refused(ncomp, monkeypatch):
    """A writer that goes astray by 40 um in one block."""
    write = Writer.write

    def astray(self, *chunk):
        written = write(self, *chunk)
        written.ends[-1, 0] += 0.04
        return written

    monkeypatch.setattr(Writer, "write", astray)
    refused = ncomp(of_x(10.0))
    assert refused.status == 2
    assert f"in.nc:4: 'Y300.0': {WORSE} at its end: 40 um instead of 10 um" in refused.err
    accepted = ncomp(of_x(10.0), "--accept", "worse", "--json", "-")
    assert accepted.status == 0, accepted.err
    assert "at most 40 um instead of 10 um (lines 4)" in json.loads(accepted.out)["accepted"]["worse"]


def test_an_arc_of_two_turns_is_not_worse_than_in_the_input(ncomp):
    """Its circle has to close: with backlash a correction of its end alone made its radius wrong by 0.16 mm."""
    arc = "G21 G17 G90\nG0 X100.0 Y100.0 Z20.0\nG1 X140.0 Y135.0 F500\nG3 X140.0 Y135.0 Z5.0 I-20.0 J0 P2\nM30\n"
    done = ncomp(PLAY, "--json", "-", program=arc)
    assert WORSE in done.err if done.status else json.loads(done.out)["accepted"] == {}


# ---- calibrations that are none


def _in_provenance(key: str, value: str):
    return lambda text: text.replace('"source":', f'"{key}": {value}, "source":', 1)


def _made_at(value: str):
    return lambda text: re.sub(r'"made_at": "[^"]*"', f'"made_at": {value}', text)


ODD = {
    "no time zone": (_made_at('"2026-01-01T00:00:00"'), "expected e.g. 2026-01-31T12:00:00Z"),
    "no date": (_made_at('"yesterday"'), "expected e.g. 2026-01"),
    "a number": (_made_at("5"), "expected e.g. 2026-01"),
    "year 1": (_made_at('"0001-01-01T00:00:00+14:00"'), "valid for 365 days; --accept stale"),
    "year 9999": (_made_at('"9999-12-31T23:59:59-14:00"'), "days ahead of this computer's clock"),
    "valid for no time": (_in_provenance("valid_days", "0"), "provenance.valid_days: Expected float > 0.0"),
    "valid for ever": (_in_provenance("valid_days", "1e999"), "out of range"),
    "temperatures the wrong way": (
        _in_provenance("temperatures_degC", '{"spindle": [25.0, 20.0]}'),
        "temperatures_degC: spindle from 25 to 20 degC",
    ),
    "NaN": (lambda text: text.replace('"value": 10.0', '"value": NaN'), "NaN and Infinity are no numbers in JSON"),
    "infinite": (lambda text: text.replace('"value": 10.0', '"value": -Infinity'), "NaN and Infinity are no numbers"),
    "huge": (lambda text: text.replace('"value": 10.0', '"value": 1e9'), "1e+09 um, more than 500 um"),
}


@pytest.mark.parametrize("case", ODD)
def test_calibrations_that_are_none_are_refused(command, case):
    change, words = ODD[case]
    Path("in.nc").write_text(PROGRAM)
    write_model(of_x(), Path("cal.json"))
    whole = Path("cal.json").read_text()
    changed = change(whole)
    assert changed != whole
    Path("cal.json").write_text(changed)
    done = command("in.nc", *GANTRY)
    assert done.status == 2
    assert words in done.err
    assert not Path("out.nc").exists()


@pytest.mark.parametrize("effects", [(), (LocationError("X", "X", 0.0),)], ids=["no effects", "an effect of size zero"])
def test_a_calibration_of_nothing_changes_nothing(ncomp, effects):
    assert ncomp(model_of(load("gantry"), *effects), "--tolerance-um", 0).status == 0
    lines = Path("out.nc").read_text().splitlines()
    assert [line for line in lines if "NCOMP" not in line] == PROGRAM.splitlines()


OTHER_MACHINE = ("-m", "cframe", "-c", "cal.json")
COMMANDS = {
    "correct": ("in.nc", "-o", "out.nc"),
    "verify": ("verify", "in.nc", "in.nc"),
    "verify --old": ("verify", "in.nc", "in.nc", "-c", "none", "--old", "cal.json"),
    "verify --align": ("verify", "in.nc", "in.nc", "-c", "none", "--align", "cal.json"),
    "export": ("export", "--format", "linuxcnc", "-o", "out.nc"),
    "predict": ("predict", "in.nc", "-o", "out.nc"),
    "diagnose": ("diagnose", "in.nc", "-o", "out.nc"),
    "simulate": ("simulate", "--strategy", "grid", "-o", "out.nc"),
}


@pytest.mark.parametrize("name", COMMANDS)
def test_another_machines_calibration_is_refused_by_every_command(command, name):
    Path("in.nc").write_text(PROGRAM)
    write_model(of_x(), Path("cal.json"))
    arguments = COMMANDS[name]
    machine = OTHER_MACHINE[:2] if "-c" in arguments else OTHER_MACHINE
    done = command(*arguments, *machine)
    assert done.status == 2
    assert "is of machine gantry (w b X Y Z t), not of cframe" in done.err
    assert not Path("out.nc").exists()


def test_a_fit_states_its_validity_and_temperatures(command):
    simulated = ("simulate", "-m", "gantry", "--strategy", "grid", "--points", "60", "--temperature", "spindle=20:25")
    done = command(*simulated, "-o", "data.csv")
    assert done.status == 0, done.err
    for options, valid in (((), None), (("--valid-days", "90"), 90.0)):
        fit = ("fit", "data.csv", "-m", "gantry", "--basis", "legendre:1", "--no-hold-out", "--force", "-o", "cal.json")
        done = command(*fit, *options)
        assert done.status == 0, done.err
        provenance = json.loads(Path("cal.json").read_text())["provenance"]
        assert provenance.get("valid_days") == valid
        assert provenance["temperatures_degC"] == {"spindle": [20.0, 25.0]}
        assert decode_model(Path("cal.json").read_bytes(), "").temperatures == {"spindle": (20.0, 25.0)}
