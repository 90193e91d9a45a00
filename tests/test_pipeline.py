"""The main job as a whole: random and real programs, in chunks of any size, judged by what comes out."""

import dataclasses
import re

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.corrected_rows import MARK, exact_rows, kept_before_turning, without_mark
from support.programs import (
    WHOLE,
    RandomProgram,
    correct,
    load,
    model_of,
    random_model,
    random_setup,
    read,
    shifted,
    source_of,
)
from support.real_programs import ACCEPTED, FEW, LINES_OF_REAL_PROGRAMS, first_lines, machine_for, real_programs, run
from support.tiers import drawn, quick

from kinematics.basis import Polynomial
from kinematics.effects import Backlash, ErrorMotion
from kinematics.user_error import UserError
from postproc.compensation.correction import pose_errors
from postproc.control.setup import make_setup
from postproc.control.state import ControlState
from postproc.control.without_effect import unused_set_up
from postproc.control_data.tool_tables import ToolTable
from postproc.correct.mark import mark_in
from postproc.evaluation.evaluation import STRAIGHT_SHARE, Evaluation
from postproc.text.source import ENCODING, chunks
from postproc.verification.verify import verify

ROUNDING_UM = 0.1
"""Three axes off by half of 0.0001 mm each: 0.087."""
MACHINES = ("gantry", "bzt_pfu", "dmu50", "head_table")
seeds = st.integers(0, 2**32 - 1)
LINEAR_WORDS = re.compile(r"[XYZIJKR][ \t]*[+-]?[ \t]*(\d+\.?\d*|\.\d+)[ \t]*", re.I)


def others(line):
    """What must not change: everything but linear words and blanks; comments to the letter."""
    comment = re.search(r"\(.*\)|;.*", line)
    code = line if comment is None else line.replace(comment[0], "@")
    return re.sub(r"[ \t]", "", LINEAR_WORDS.sub("", code)), comment and comment[0]


@pytest.mark.parametrize("name", MACHINES)
@drawn(few=2, many=25, seed=seeds, tcp=st.booleans(), blocks=st.integers(3, 60))
def test_random_programs(name, seed, tcp, blocks):
    machine = load(name)
    tcp &= name in ("dmu50", "head_table")
    text = RandomProgram(machine, seed, tcp=tcp).text(blocks)
    setup, model = random_setup(machine), random_model(machine, seed)
    options = {"travel_check": not tcp, "max_correction_um": 1e4, **WHOLE}
    # the machine without errors: byte for byte
    assert correct(text, machine, **setup, **options).text == text
    # every end where it should be, by what the corrected text says
    output, report = correct(text, machine, model, **setup, **options)
    corrected = without_mark(output)
    nominal, commanded = read(text, machine, **setup), read(corrected, machine, **setup)
    verdict = verify(nominal, commanded, model)
    assert verdict.moves == report.moves == len(nominal)
    kept = kept_before_turning(nominal, commanded)
    assert not kept.any() or any("feed move of rotary axes only worse" in note for note in report.notes)
    rows = exact_rows(nominal) & ~kept
    q, target = commanded.machine_target[rows], nominal.machine_target[rows]
    assert pose_errors(machine, model, q, target, nominal.tool[rows]).point_um.max(initial=0.0) < ROUNDING_UM
    assert (commanded.target[:, machine.rotary] == nominal.target[:, machine.rotary]).all()
    # nothing else is touched
    before, after = (re.split(r"(?<=\n)", part) for part in (text, corrected))
    assert len(before) == len(after)
    assert [others(line) for line in before] == [others(line) for line in after]
    # what the report says is what verification finds
    assert report.after.largest == pytest.approx(verdict.after.largest, abs=2e-3)
    assert report.before.largest == pytest.approx(verdict.before.largest, abs=1e-6)
    assert report.blocks == len([line for line in before if line])
    # once more is refused, unless it is wanted
    with pytest.raises(UserError, match="already corrected by ncomp"):
        correct(output, machine, model, **setup, **options)
    again = correct(output, machine, model, **setup, **{**options, "travel_check": False}, force=True)
    assert again.text.count("(NCOMP ") == 2
    assert any(note.startswith("already corrected") for note in again.report.notes)


@pytest.mark.parametrize("name", ["gantry", pytest.param("dmu50", marks=pytest.mark.statistical)])
@drawn(few=1, many=8, seed=seeds)
def test_chunks_of_any_size_give_the_same_bytes(name, seed):
    machine = load(name)
    text = RandomProgram(machine, seed).text(25)
    setup, model = random_setup(machine), random_model(machine, seed)
    whole = correct(text, machine, model, **setup)
    for size in (1, 3, 7):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("postproc.execution.CHUNK_BLOCKS", size)
            part = correct(text, machine, model, **setup)
        assert part.text == whole.text
        assert part.report.notes == whole.report.notes
        for statistic in ("before", "after", "between_ends"):
            one, other = getattr(part.report, statistic), getattr(whole.report, statistic)
            assert (one.count, one.largest) == (other.count, pytest.approx(other.largest))


@drawn(few=8, many=25, seed=seeds, um=st.tuples(*[st.integers(-1000, 1000).map(lambda n: n / 10)] * 3))
def test_a_constant_shift_moves_everything_by_just_that(seed, um):
    """End points and arc centres of a gantry that is off by the same everywhere."""
    machine = load("gantry")
    text = RandomProgram(machine, seed).text(30)
    setup = random_setup(machine)
    model = shifted(machine, **dict(zip("XYZ", um, strict=True)))
    nominal = read(text, machine, **setup)
    commanded = read(correct(text, machine, model, **setup).text, machine, **setup)
    rows = nominal.evaluated
    moved = (commanded.target - nominal.target)[rows]
    assert moved == pytest.approx(np.tile(np.array(um) * -1e-3, (rows.sum(), 1)), abs=0.5e-4 + 1e-9)
    for row, arc in nominal.arcs.items():
        if nominal.evaluated_paths[row]:
            other = commanded.arcs[row]
            for i, axis in enumerate(arc.plane[:2]):
                tolerance = 2e-4 if not arc.form.startswith("radius") else 0.1
                assert other.centre[i] - arc.centre[i] == pytest.approx(um[axis] * -1e-3, abs=tolerance)


def another(machine, seed):
    """The machine as it stands on the shop floor: other home positions, offsets and tools than ncomp was told."""
    rng = np.random.default_rng(seed)
    homes = [axis.home + float(rng.uniform(-300, 300)) * (not axis.rotary) for axis in machine.axes]
    axes = tuple(dataclasses.replace(axis, home=home) for axis, home in zip(machine.axes, homes, strict=True))
    places = rng.uniform(-500, 500, (4, 3)).round(3).tolist()
    offsets = [
        f"{name}={x},{y},{z}" for name, (x, y, z) in zip(("G54", "G55", "G54.1P3", "G59.3"), places, strict=True)
    ]
    tools = [f"T{number}={length:.3f}" for number, length in enumerate(rng.uniform(0, 300, 3), start=1)]
    return dataclasses.replace(machine, axes=axes), {"offsets": offsets, "tools": tools}


@pytest.mark.statistical
@pytest.mark.parametrize("name", MACHINES)
@settings(max_examples=25)
@given(seed=seeds, tcp=st.booleans(), told=st.booleans())
def test_no_move_goes_elsewhere_whatever_the_offsets_really_are(name, seed, tcp, told):
    """The corrected program, on a machine set up in another way than ncomp was told, stays beside the original."""
    machine = load(name)
    tcp &= name in ("dmu50", "head_table")
    text = RandomProgram(machine, seed, tcp=tcp).text(50)
    setup = random_setup(machine) if told else {}
    corrected = without_mark(
        correct(
            text, machine, random_model(machine, seed), travel_check=False, max_correction_um=1e4, **WHOLE, **setup
        ).text
    )
    real, real_setup = another(machine, seed)
    before, after = (read(each, real, **real_setup).machine_target for each in (text, corrected))
    assert np.abs(after - before)[:, machine.translators].max() < 1.0
    assert (after[:, machine.rotary] == before[:, machine.rotary]).all()


@pytest.mark.statistical
@pytest.mark.parametrize("name", MACHINES)
@settings(max_examples=150)
@given(seed=seeds, tcp=st.booleans())
@example(seed=198025, tcp=True)  # an arc before a feed move of rotary axes alone
@example(seed=1384413, tcp=False)  # an arc like it, with its start shifted by 4 % of its radius
@example(seed=2051571744, tcp=True)  # an arc like it, of a radius smaller than its correction
def test_many_random_programs(name, seed, tcp):
    test_random_programs.holds(name, seed, tcp, 80)
    test_no_move_goes_elsewhere_whatever_the_offsets_really_are.hypothesis.inner_test(name, seed, tcp, False)


# ---- real programs


REASONS = {
    "BOTTLE.NC": ":12: .*the arc is no circle: .*With an absolute centre it is a circle",
    "CONTOUR_ABS.NC": ":15: .*the arc is no circle: .*With an absolute centre it is a circle",
    "TEST2.NC": ":12: .*the arc is no circle: .*With an absolute centre it is a circle",
    "G81_G91.NC": ":11: .*a canned cycle with increments needs G98",
    "TEST_G91.NC": ":30: .*an increment of Z needs a known start",
    "TEST_TURN.NC": ":9: .*the arc starts at a position that the program has not given",
    "box_centroid.nc": ":105: .*M99 outside of a subprogram repeats the program",
    "box_fanuc.nc": ":3: .*is not understood",
}


@LINES_OF_REAL_PROGRAMS
def test_real_programs(nc_data, lines, tmp_path):
    read_names, accepted = set(), ACCEPTED if lines is None else FEW
    for path in first_lines(real_programs(nc_data), lines, tmp_path):
        machine = machine_for(path)
        if path.name in REASONS:
            with pytest.raises(UserError, match=REASONS[path.name]):
                run(path, machine, model_of(machine))
            continue
        if path.name in ACCEPTED - accepted:
            continue
        read_names.add(path.name)
        data, report = run(path, machine, model_of(machine))
        assert data == path.read_bytes()
        model = random_model(machine, 11)
        corrected, report = run(path, machine, model, **WHOLE)
        text = without_mark(corrected.decode(ENCODING))
        nominal, commanded = read(data.decode(ENCODING), machine), read(text, machine)
        rows = exact_rows(nominal)
        q, target = commanded.machine_target[rows], nominal.machine_target[rows]
        assert pose_errors(machine, model, q, target, nominal.tool[rows]).point_um.max() < ROUNDING_UM
        assert verify(nominal, commanded, model).moves == report.moves
        before, after = (re.split(r"(?<=\n)", part) for part in (data.decode(ENCODING), text))
        assert [others(line) for line in before] == [others(line) for line in after]
    assert read_names == accepted


# ---- files of every kind

FORMS = {
    "line feeds": "%\nO1\nG0 X1.5 Y1.5 Z1.5\nM30\n%\n",
    "carriage returns and line feeds": "%\r\nO1\r\nG0 X1.5 Y1.5 Z1.5\r\n",
    "carriage returns": "%\rO1\rG0 X1.5 Y1.5 Z1.5\rM30\r",
    "two carriage returns": "G0 X1.5 Y1.5 Z1.5\r\r\nM30\r\r\n",
    "mixed": "%\r\nO1\nG0 X1.5 Y1.5 Z1.5\r\nM30\n",
    "no end of line at the end": "G0 X1.5 Y1.5 Z1.5\nX2.5",
    "one block without end": "G0 X1.5 Y1.5 Z1.5",
    "byte order mark": "\xef\xbb\xbf%\nG0 X1.5 Y1.5 Z1.5\n",
    "nul leader and trailer": "\0\0\0\0%\nG0 X1.5 Y1.5 Z1.5\n%\0\0\0",
    "empty lines": "\n\n  \n\t\nG0 X1.5 Y1.5 Z1.5\n\n\n",
    "latin-1 and utf-8 comments": "(Vorfr\xe4sen \xc3\xa4)\nG0 X1.5 Y1.5 Z1.5 ; \xb5m\n",
    "trailing blanks": "G0 X1.5 Y1.5 Z1.5 \t \nM30  \n",
    "comments only": "(a)\n; b\n\n",
    "a head only": "%\nO1",
}


@pytest.mark.parametrize("name", FORMS)
def test_every_form_of_a_file_is_kept(name):
    text, machine = FORMS[name], load("gantry")
    assert correct(text, machine).text == text
    output = correct(text, machine, shifted(machine, X=-10.0)).text
    if "G0" in text:
        output = without_mark(output)
    assert output == text.replace("X1.5", "X1.5100").replace("X2.5", "X2.5100")


@pytest.mark.parametrize("size", [1, 2, 100])
@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("%\nO1 (A)\nG0 X1 Y1\n", 2),
        ("(A)\n%\nO1\n(B)\n\nG21\nG0 X1\n", 5),
        ("G0 X1\n", 0),
        ("( A )\r\nG0 X1\r\n", 1),
    ],
)
def test_place_of_the_mark(monkeypatch, text, place, size):
    monkeypatch.setattr("postproc.execution.CHUNK_BLOCKS", size)
    machine = load("gantry")
    output = correct(text, machine, shifted(machine, X=-10.0)).text
    lines = re.split(r"(?<=\n)", output)
    assert MARK.fullmatch(lines[place])
    assert ("\r\n" in lines[place]) == ("\r\n" in text)
    assert mark_in(lines[place]) is not None
    assert [i for i, line in enumerate(lines) if mark_in(line)] == [place]


def test_the_mark_names_program_machine_and_calibration():
    machine = load("dmu50")
    model = shifted(machine, X=1.0)
    text = "G0 X1 Y1 Z1\n"
    mark = correct(text, machine, model).text.splitlines()[0]
    named = f"CALIBRATION {model.id.upper()} PROGRAM {source_of(text).hash.upper()}"
    assert mark.startswith(f"(NCOMP 0.1.0 MACHINE DMU50 {named} SETUP ")


def test_a_mark_far_down_is_found(monkeypatch):
    monkeypatch.setattr("postproc.execution.CHUNK_BLOCKS", 10)
    machine = load("gantry")
    marked = correct("G0 X1\n", machine, shifted(machine, X=1.0)).text
    with pytest.raises(UserError, match=r":101: .*already corrected by ncomp \(calibration [0-9A-F]+\); --force"):
        correct("G0 X1\n" * 100 + marked, machine, shifted(machine, X=1.0))


# ---- travel

AT_THE_END = "G0 X5000 Y100 Z100\n"


def test_outside_travel_as_programmed():
    machine = load("gantry")
    for model in (model_of(machine), shifted(machine, X=10.0)):
        with pytest.raises(UserError, match=r"test.nc:2: .*X would go to 5000.5000 mm as programmed .*0..5000"):
            correct("G0 X1\nX5000.5\n", machine, model)
    noted = correct("G0 X1\nX5000.5\nX5001\n", machine, shifted(machine, X=10.0), travel_check=False).report.notes
    assert "X outside its travel 0..5000 mm (line 2, 2 times)" in noted


def test_outside_travel_after_correction():
    machine = load("gantry")
    assert correct(AT_THE_END, machine).text == AT_THE_END
    assert "X4999.9900" in correct(AT_THE_END, machine, shifted(machine, X=10.0)).text
    with pytest.raises(UserError, match=r"test.nc:1: .*X would go to 5000.0100 mm after correction"):
        correct(AT_THE_END, machine, shifted(machine, X=-10.0))


def test_travel_is_checked_in_machine_axes():
    machine = load("gantry")
    with pytest.raises(UserError, match=r"X would go to 5000.5000 mm as programmed"):
        correct("G54 G0 X0.5\n", machine, offsets=["G54=X=5000"])
    with pytest.raises(UserError, match=r"Z would go to 1600.0000 mm as programmed"):
        correct("G43 H1 G0 Z1500\n", machine, tools=["T1=100"])
    with pytest.raises(UserError, match=r"X would go to -1.0000 mm as programmed"):
        correct("G0 G53 X-1\n", machine)
    tilting = load("dmu50")
    with pytest.raises(UserError, match=r"C would go to 370.0000 deg as programmed"):
        correct("G0 X0 C370\n", tilting)


# ---- what is reported


def test_report():
    machine = load("gantry")
    model = model_of(machine, ErrorMotion("X", "X", Polynomial((0.0, 5000.0), 1), (10.0, 50.0), u=(1.0, 2.0)))
    text = "G21 G90 G0 X1000.0 Y10.0 Z10.0\nG53 Z0\nG1 X2000.0 F500\nZ10.0\nX3000.0\nM30\n"
    report = correct(text, machine, model).report
    data = report.json()
    assert data["blocks"] == {"read": 6, "changed": 3, "added": 0}
    assert data["moves"] == {"read": 5, "corrected": 4, "split": 0, "not_judged": 2}
    assert data["correction_um"]["X"]["max"] == pytest.approx(40.0, abs=0.1)
    assert data["correction_um"]["Y"] == {"max": 0.0, "rms": 0.0, "count": 4}
    error = data["predicted_error_um"]
    assert error["before"]["max"] == pytest.approx(40.0, abs=1e-3)
    assert error["before"]["count"] == error["after"]["count"] == 3
    assert error["after"]["max"] < 0.05
    assert error["between_block_ends_after"] == {"max": pytest.approx(0.0, abs=0.06), "rms": pytest.approx(0.0, abs=0.06), "count": 1}  # fmt: skip
    assert error["standard_uncertainty_of_prediction"]["max"] == pytest.approx(np.hypot(1.0, 2.0 * 0.6), abs=1e-3)
    assert data["work_offsets"] == {"G54": "0 (--set-up-zero)"}
    assert data["tools"] == {}
    assert data["calibration"]["id"] == model.id


def test_between_the_ends_of_a_move_after_a_reference_point():
    """The way to Z5 begins somewhere else than where the program was before G28: nothing is said about its middle."""
    machine = load("gantry")
    text = "G21 G90 G0 X10.0 Y10.0 Z5.0\nG91 G28 Z0.0\nG90 G1 Z5.0 F100\nX20.0\n"
    report = correct(text, machine, random_model(machine, 1)).report
    assert report.between_ends.count == 1
    assert report.between_ends.largest < 1.0


def test_notes():
    machine = load("dmu50")
    model = model_of(machine, ErrorMotion("X", "X", Polynomial((-100.0, 100.0), 2), (0.0, 0.0, 80.0), u=(1.0,) * 3))
    text = "G21 G90 G0 X-200.0 Y0.0\nG1 Z10.0 F100\nX0.0\nC10.0\n"
    notes = correct(text, machine, model, offsets=["G55=1,2,3"]).report.notes
    assert notes == [
        "the program has not given B yet: its home 0 is assumed (line 1, 4 times)",
        "the program has not given C yet: its home 0 is assumed (line 1, 3 times)",
        "the program has not given Z yet: its home 400 is assumed (line 1)",
        "work offset G55 was given and is not used",
        "E_XX is used up to 100 mm beyond its calibrated range; its end value is held there",
    ]


# ---- offsets, lengths, sources


@pytest.mark.parametrize(
    ("option", "name", "values"),
    [
        ("G54=10,20,-5", "G54", {"X": 10, "Y": 20, "Z": -5}),
        ("g55 = 1, 2,3", "G55", {"X": 1, "Y": 2, "Z": 3}),
        ("G54.1 P3=1,,3".replace(",,", ",0,"), "G54.1P3", {"X": 1, "Y": 0, "Z": 3}),
        ("1=X=5,C=-30", "1", {"X": 5, "C": -30}),
        ("G54=1,2,3,C=30", "G54", {"X": 1, "Y": 2, "Z": 3, "C": 30}),
    ],
)
def test_work_offset_option(option, name, values):
    assert make_setup(load("dmu50"), [option]).work_offsets == {name: values}


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ("G54", "expected G54=x,y,z"),
        ("foo", "expected G54=x,y,z"),
        ("", "expected G54=x,y,z"),
        ("G54=", "expected G54=x,y,z"),
        ("=1,2,3", "expected G54=x,y,z"),
        ("G54=1", "expected G54=x,y,z, got 1 of 3 values"),
        ("G54=-30,-20", "expected G54=x,y,z, got 2 of 3 values"),
        ("G54=1,C=5", "got 1 of 3 values"),
        ("G54=1,2,3,X=5", "X is given twice"),
        ("G54=a", "'a' is no number"),
        ("G54=1,2,3,4", "no axis"),
        ("G54=1,U=4", "no axis U"),
        ("G54=nan", "is no number"),
        ("G54=1,inf", "is no number"),
        ("G54=1,,3", "is no number"),
    ],
)
def test_bad_work_offset_option(option, words):
    with pytest.raises(UserError, match=rf"^--work-offset {re.escape(option)}: .*{words}"):
        make_setup(load("dmu50"), [option])


@pytest.mark.parametrize(
    ("offsets", "lengths", "words"),
    [
        (["G54=1,2,3", "g54 = 4,5,6"], [], "--work-offset G54 is given twice"),
        ([], ["T1=80", "t01=90"], "--tool-length T1 is given twice"),
    ],
)
def test_the_same_given_twice(offsets, lengths, words):
    with pytest.raises(UserError, match=words):
        make_setup(load("dmu50"), offsets, lengths)


@pytest.mark.parametrize("option", ["T1", "T1=", "80", "=5", "T1=a", "TX=a", "T1=nan", "T1=-inf", ""])
def test_bad_tool_length_option(option):
    with pytest.raises(UserError, match=r"^--tool-length"):
        make_setup(load("dmu50"), [], [option])


def test_options_overrule_the_tool_table():
    table = ToolTable({"1": 100.0, "3": 7.0}, {"G54": {"X": 1.0}, "G55": {"X": 2.0}})
    setup = make_setup(load("dmu50"), ["G54=X=9"], ["T1=5", "t02=6.5"], table)
    assert setup.work_offsets == {"G54": {"X": 9.0}, "G55": {"X": 2.0}}
    state = ControlState(setup)
    assert [state.tool_length(n) for n in (1, 2, 3, 4)] == [5, 6.5, 7, 100]
    assert [each.note for each in unused_set_up(state) if "work offset" in each.name] == [
        "work offset G54 was given and is not used", "work offset G55 was given and is not used"
    ]  # fmt: skip
    state = ControlState(make_setup(load("dmu50"), [], ["T10=5", "T9=6"]))
    assert [each.note for each in unused_set_up(state)] == [
        "tool length T9 was given and is not used",
        "tool length T10 was given and is not used",
    ]


CONTROLS = bytes({*range(32)} - {*b"\t\n\r\f\x1a"})


@settings(max_examples=30)
@given(st.binary(min_size=1, max_size=200).map(lambda data: data.translate(None, CONTROLS)), st.integers(1, 4))
def test_lines_and_chunks_lose_no_byte(data, size):
    source = source_of(data.decode(ENCODING))
    parts = list(chunks(source.lines(), size))
    numbered = [line for part in parts for line in part]
    assert (source.mark + "".join(text for _, text in numbered)).encode(ENCODING) == data
    assert [number for number, _ in numbered] == list(range(1, len(numbered) + 1))


@pytest.mark.parametrize("name", quick(["BOTTLE.NC", "CONTOUR_ABS.NC", "TEST2.NC"], ["CONTOUR_ABS.NC", "TEST2.NC"]))
def test_real_programs_with_absolute_centres(nc_data, name):
    """As the refusal of these says: with the machine file set, they are read, and stay circles."""
    (path,) = (nc_data / "iso").rglob(name)
    machine = load("dmu50")
    machine = dataclasses.replace(machine, control=dataclasses.replace(machine.control, arc_centres="absolute"))
    model = random_model(machine, 2)
    data, report = run(path, machine, model, **WHOLE)
    nominal = read(path.read_bytes().decode(ENCODING), machine)
    commanded = read(without_mark(data.decode(ENCODING)), machine)
    rows = exact_rows(nominal)
    q, target = commanded.machine_target[rows], nominal.machine_target[rows]
    assert pose_errors(machine, model, q, target, nominal.tool[rows]).point_um.max() < ROUNDING_UM
    assert report.moves == len(nominal) > 15


BENT = "".join(
    f"G1 X{60 * np.cos(t):.4f} Y{60 * np.sin(1.1 * t):.4f} Z{200 + 20 * np.sin(t):.4f} B{10 * np.sin(t):.4f} C{c:.4f}\n"
    for t, c in ((i * step, 40.0 * i * step) for step in (0.0001, 0.0025, 0.05, 0.6) for i in range(60))
)
TURNS = "G1 C90. F500\nC180.\nX5. C200.\nG0 X30. Y30.\nG1 X31. B20.\n"


@pytest.mark.parametrize(
    ("begin", "radius", "note"),
    [("X9.", "R3.", "not corrected"), ("X12.631 Y-28.547", "R0.031", "its correction makes")],
)
def test_an_arc_before_a_turn_ends_without_its_correction_if_it_can(begin, radius, note):
    """An arc as small as its correction would be another one, or none, between a corrected start and such an end."""
    machine = load("dmu50")
    text = f"G21 G17 G90 G54\nG0 X9. Y-30. Z17.\n{begin}\nG3 X12.658 Y-28.559 {radius} F500\nG1 C23.47 B18.466\n"
    corrected, report = correct(text, machine, random_model(machine, 2051571744), travel_check=False, **WHOLE)
    assert any(each.startswith(note) and "line 4" in each for each in report.notes)
    nominal, commanded = (read(each, machine).target[2] for each in (text, without_mark(corrected)))
    moved = np.abs(commanded - nominal).max() > 1e-3
    assert moved == (note != "not corrected")


@pytest.mark.parametrize("play_um", [0.0, 6.0])
@pytest.mark.parametrize("head", ["", "G43.4 H1\n"], ids=["axes", "tcp"])
def test_errors_between_ends_follow_from_those_at_the_ends(head, play_um):
    """Where the bound of the second difference is small, and no axis crosses its play; to within that, and with the
    same text."""
    text = f"G21 G90 G17 G54 G94\nT1 M6\nG0 X60 Y0 Z200 B0 C0\n{head}{BENT}{TURNS}"
    dmu50 = load("dmu50")
    play = [Backlash(axis, play_um) for axis in "XYZBC"] if play_um else []
    model, evaluate = model_of(dmu50, *random_model(dmu50, 4).effects, *play), Evaluation._errors_between
    found, counts = [], []

    def counted(evaluation, motions, commanded, states, rows, *shares):
        counts[-1] += len(rows)
        return evaluate(evaluation, motions, commanded, states, rows, *shares)

    for share in (STRAIGHT_SHARE, -1.0):
        counts.append(0)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("postproc.evaluation.evaluation.STRAIGHT_SHARE", share)
            patch.setattr(Evaluation, "_errors_between", counted)
            found.append(correct(text, dmu50, model, tools=["T1=80"], travel_check=False))
    by_ends, exact = found
    assert by_ends.text == exact.text
    assert counts[0] < counts[1] - 40
    ours, theirs = by_ends.report.between_ends, exact.report.between_ends
    assert (ours.largest, ours.rms) == pytest.approx((theirs.largest, theirs.rms), abs=STRAIGHT_SHARE)
    assert ours.count == theirs.count
