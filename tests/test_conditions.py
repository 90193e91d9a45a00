"""Time and temperatures of a run: from options, from a log, and what is said when they lack."""

import io
import json

import numpy as np
import pytest
from support.effect_examples import EXAMPLES
from support.programs import load, model_of, source_of

from kinematics.effects import (
    Backlash,
    DriftWithSensor,
    FollowingError,
    GrowthWithSensor,
    GrowthWithTime,
    LocationError,
    Settling,
    StationShift,
    ThermalDrift,
    WorkpieceDrift,
)
from kinematics.user_error import UserError
from postproc.compensation.conditions import Conditions, make_conditions
from postproc.compensation.predicted_error import in_a_program, model_notes
from postproc.control.setup import make_setup
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.text.source import ENCODING

GANTRY = load("gantry")
HEAD = "G21 G90\nG0 X1000.0 Y500.0 Z100.0\n"


def corrected(model, conditions, text=HEAD):
    out = io.BytesIO()
    job = Job(
        source_of(text),
        find_dialect("iso", "", ""),
        GANTRY,
        model,
        make_setup(GANTRY, zero=True),
        conditions=conditions,
    )
    report = Pipeline(job).run(out, lambda _: None)
    return out.getvalue().decode(ENCODING).splitlines()[-1], report


@pytest.fixture
def log(tmp_path):
    def write(text, name="log.csv"):
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return write


def test_values_from_options():
    """Spindle +10 K at -6 um/K: the tool 60 um too low. X growth 12 um/m/K, +2.5 K at 1000 mm: 30 um too far."""
    drift = DriftWithSensor(component="Z", sensor="spindle", coefficient=-6.0)
    growth = GrowthWithSensor(axis="X", sensor="bed", coefficient=12.0)
    hours = ThermalDrift(component="Y", rate=10.0)
    conditions = make_conditions(["spindle=30", "bed=22.5"], 7200.0)
    line, report = corrected(model_of(GANTRY, drift, growth, hours), conditions)
    assert line == "G0 X999.9700 Y499.9800 Z100.0600"
    assert report.before.largest == pytest.approx(np.hypot(np.hypot(60, 30), 20), abs=1e-2)
    assert report.after.largest < 0.1
    assert report.json()["conditions"] == {
        "elapsed_s": 7200.0, "temperatures_degC": {"spindle": 30.0, "bed": 22.5}, "log": None,
    }  # fmt: skip
    assert conditions.text() == "7200 s after time zero, spindle 30 degC, bed 22.5 degC, held over the program"


def test_a_shift_of_the_part_turns_with_its_table():
    """The tool is 60 um too far along X of the part: at C = 90 deg that is -Y of the machine."""
    out, machine = io.BytesIO(), load("trunnion_ac")
    model = model_of(machine, WorkpieceDrift(component="X", rate=60.0))
    source = source_of("G21 G90\nG0 X30.0 Y20.0 Z100.0 A0.0 C0.0\nG0 X30.0 Y20.0 Z100.0 A0.0 C90.0\n")
    dialect, setup = find_dialect("iso", "", ""), make_setup(machine, zero=True)
    job = Job(source, dialect, machine, model, setup, conditions=Conditions(3600.0))
    report = Pipeline(job).run(out, lambda _: None)
    first, second = out.getvalue().decode(ENCODING).splitlines()[-2:]
    assert first.startswith("G0 X29.9400 Y20.0")
    assert second.startswith("G0 X30.0 Y20.0600")
    assert report.before.largest == pytest.approx(60.0, abs=0.1)
    assert report.after.largest < 0.1


def test_a_lag_runs_over_the_log(log):
    """A jump of 10 K, and then one time constant: 1 - 1/e of it has come."""
    path = log("time_s,temp_spindle,note\n0,20,cold\n100,20,\n100,30,switched on\n1000,30,\n")
    lagging = DriftWithSensor(component="Z", sensor="spindle", coefficient=-6.0, lag_s=900.0)
    line, report = corrected(model_of(GANTRY, lagging), make_conditions(log=path))
    assert line == f"G0 X1000.0 Y500.0 Z{100 + 0.06 * (1 - np.exp(-1)):.4f}"
    assert not [note for note in report.notes if "steady state" in note]
    # the last row is now, and options overrule it
    line, _ = corrected(model_of(GANTRY, lagging), make_conditions(["spindle=30"], 5000.0, path))
    assert line == f"G0 X1000.0 Y500.0 Z{100 + 0.06 * (1 - np.exp(-1)):.4f}"
    fast = DriftWithSensor(component="Z", sensor="spindle", coefficient=-6.0)
    line, _ = corrected(model_of(GANTRY, fast), make_conditions(["spindle=25"], None, path))
    assert line == "G0 X1000.0 Y500.0 Z100.0300"


def test_uncertainty_counts_the_lag(log):
    path = log("time_s,temp_spindle\n0,20\n0,30\n900,30\n")
    lagging = DriftWithSensor(component="Z", sensor="spindle", coefficient=-6.0, lag_s=900.0, u=(0.0, 90.0))
    _, report = corrected(model_of(GANTRY, lagging), make_conditions(log=path))
    assert report.uncertainty.largest == pytest.approx(60 * np.exp(-1) * 0.1, rel=1e-6)  # d/dlag of 1 - exp(-t/lag)


def test_many_chunks_see_the_same_past(log, monkeypatch):
    path = log("time_s,temp_spindle\n0,20\n0,30\n900,30\n")
    model = model_of(GANTRY, DriftWithSensor(component="Z", sensor="spindle", coefficient=-6.0, lag_s=900.0))
    text = HEAD + "X5.0\nZ50.0\n" * 20
    whole = corrected(model, make_conditions(log=path), text)
    monkeypatch.setattr("postproc.execution.CHUNK_BLOCKS", 3)
    part = corrected(model, make_conditions(log=path), text)
    assert whole[0] == part[0] == f"Z{50 + 0.06 * (1 - np.exp(-1)):.4f}"


def test_elapsed_of_the_log_is_its_last_row(log):
    path = log("# logged by hand\ntime_s,temp_bed\n0,20\n\n3600,21\n")
    model = model_of(GANTRY, ThermalDrift(component="Y", rate=10.0))
    assert corrected(model, make_conditions(log=path))[0] == "G0 X1000.0 Y499.9900 Z100.0"
    assert corrected(model, make_conditions((), 7200.0, path))[0] == "G0 X1000.0 Y499.9800 Z100.0"


NEEDS = [
    (DriftWithSensor(component="Z", sensor="spindle", coefficient=-6.0), {},
     "thermal-drift-sensor Z spindle needs the temperature 'spindle': give --temperature spindle=degC or --log"),
    (GrowthWithSensor(axis="X", sensor="bed", coefficient=12.0, lag_s=10.0), {"temperatures": {"spindle": 20.0}},
     "thermal-scale-sensor X bed needs the temperature 'bed': give --temperature bed=degC or --log"),
    (GrowthWithTime(axis="X", rate=12.0), {"temperatures": {"bed": 20.0}},
     "thermal-scale X needs the time since its zero: give --elapsed s or --log"),
]  # fmt: skip


@pytest.mark.parametrize(("effect", "given", "message"), NEEDS)
def test_what_is_needed_and_not_given(effect, given, message):
    with pytest.raises(UserError) as caught:
        corrected(model_of(GANTRY, effect), Conditions(**given))
    assert str(caught.value) == message


def test_notes():
    settled = DriftWithSensor(component="Z", sensor="spindle", coefficient=-6.0, lag_s=900.0)
    notes = model_notes(
        model_of(GANTRY, settled, Settling("X", 20.0), FollowingError("Y", 1.0)),
        make_conditions(["spindle=25", "bed=22"]),
    )
    assert notes == [
        "settling X, following-error Y: no program can correct this, and predicted errors do not contain it",
        "temperature bed was given and no effect uses it",
        "thermal-drift-sensor Z spindle: a steady state at the given temperature is assumed; --log gives its history",
    ]


def test_effects_without_remedy_are_left_out():
    shift = LocationError("X", "X", -10.0)
    left_out = (Settling("X", 1e5), FollowingError("Y", 100.0), StationShift("s", (1.0,) * 3, (1.0,) * 3))
    line, report = corrected(model_of(GANTRY, shift, *left_out), Conditions())
    assert line == "G0 X1000.0100 Y500.0 Z100.0"
    assert report.after.largest < 0.1
    assert report.before.largest == pytest.approx(10.0)


def test_every_effect_of_a_machine_serves_in_a_program():
    """With its temperatures and time given, each one is corrected, or left out by its remedy; none is refused."""
    conditions = make_conditions(["spindle=25", "column=22"], 1000.0)
    text = "G21 G90\nG0 X10.0 Y10.0 Z10.0\nG1 X20.0 Y30.0 Z40.0 F100\nX10.0\n"
    for example in EXAMPLES:
        machine, out = example.machine, io.BytesIO()
        model = model_of(machine, example.effect)
        job = Job(
            source_of(text),
            find_dialect("iso", "", ""),
            machine,
            model,
            make_setup(machine, zero=True),
            False,
            conditions=conditions,
        )
        report = Pipeline(job).run(out, lambda _: None)
        assert report.after.largest < 0.2
        if not in_a_program(example.effect):
            assert out.getvalue().decode() == text


BAD_LOGS = [
    ("", "expected one column time_s, found none"),
    (
        "time,temp_a\n0,20\n",
        ":2, column time: '0' is no date with a time of day: write it as 2026-11-30 09:12:05",
    ),
    (
        "Zeit,temp_a\n0,20\n",
        ":1: expected one column time_s, found none; the columns of a log are time_s or time, and temp_NAME, and Zeit is "
        "neither; or give a column map (--log-columns MAP.toml)",
    ),
    ("time_s,temp_a\n0,-300\n", ":2, column temp_a: -300 degC is below absolute zero"),
    ("time_s,temp_a,temp_a\n0,20,20\n", ":1: expected one column temp_a, found 2"),
    ("time_s,temp_a\n", "has no rows of values"),
    ("time_s,temp_a\n0,20\n1\n", ":3: the row has 1 values, and the header 2 columns"),
    ("time_s,temp_a\n0,warm\n", ":2, column temp_a: 'warm' is no number"),
    ("time_s,temp_a\n0,nan\n", ":2, column temp_a: 'nan' is no number"),
    ("# a\ntime_s,temp_a\n5,20\n4,20\n", ":4, column time_s: the time is before that of the last row"),
    ('time_s,temp_a\n0,"20\n', ":2: "),
]


@pytest.mark.parametrize(("text", "message"), BAD_LOGS)
def test_bad_logs(log, text, message):
    path = log(text)
    with pytest.raises(UserError) as caught:
        make_conditions(log=path)
    assert str(path) in str(caught.value)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("temperatures", "elapsed", "message"),
    [
        (["spindle"], None, "--temperature spindle: expected SENSOR=degC, for example spindle=31.5"),
        (["=5"], None, "--temperature =5: expected"),
        (["spindle=warm"], None, "--temperature spindle=warm: 'warm' is no number"),
        (["spindle=-300"], None, "--temperature spindle=-300: -300 degC is below absolute zero"),
        (["a=20", "a=21"], None, "--temperature a is given twice"),
        ((), float("nan"), "--elapsed nan: expected a time"),
        ((), -5.0, "--elapsed -5: expected a time"),
    ],
)
def test_bad_options(temperatures, elapsed, message):
    with pytest.raises(UserError, match=message):
        make_conditions(temperatures, elapsed)


def test_a_log_that_is_not_there(tmp_path):
    with pytest.raises(UserError, match=r"log .*no\.csv: No such file"):
        make_conditions(log=tmp_path / "no.csv")


def test_a_log_that_lacks_a_column_says_what_it_has(log):
    conditions = make_conditions(log=log("time_s,temp_bed,scale\n0,20,21\n"))
    with pytest.raises(UserError, match=r"needs the temperature 'scale'.*has time_s, temp_bed; the columns of a log are time_s or time, and temp_NAME, and scale is neither"):  # fmt: skip
        corrected(model_of(GANTRY, DriftWithSensor(component="Z", sensor="scale", coefficient=-6.0)), conditions)


def test_json_of_conditions_is_json():
    assert json.loads(json.dumps(Conditions().json())) == {"elapsed_s": None, "temperatures_degC": {}, "log": None}


def test_backlash_alone_needs_no_conditions():
    assert model_notes(model_of(GANTRY, Backlash("X", 5.0)), Conditions()) == []
