"""Rotary words: the position and the direction that the control takes from them, in all dialects."""

import re
import subprocess

import numpy as np
import pytest
from support.command import refusal, succeed
from support.plain_programs import outcome
from support.programs import model_of

import ncomp
from kinematics.effects import Cyclic
from kinematics.error_model.model import write_model
from postproc.control.interpreter import Interpreter
from postproc.motion.moves import Kind

MACHINE = """name = "mill"
chain = "w C b X Y Z B t"
[axes.C]
point = [0, 0, 0]
travel = {travel}
{rollover}
[axes.X]
travel = [-500, 500]
[axes.Y]
travel = [-400, 400]
[axes.Z]
travel = [0, 700]
home = 700
[axes.B]
point = [0, 0, 150]
travel = [-110, 110]
[control]
{control}
[tools]
1 = 80
[work_offsets]
G54 = {{ X = 0, Y = 0, Z = 200 }}
G500 = {{ X = 0, Y = 0, Z = 200 }}
1 = {{ X = 0, Y = 0, Z = 200 }}
[datum]
default = "true"
"""
ENDLESS = "[-inf, inf]"
TOLERANCE_UM = 0.5


@pytest.fixture
def mill(tmp_path):
    """Writes the machine file; returns its path."""

    def written(rollover="", travel=ENDLESS, control=""):
        entry = f'rollover = "{rollover}"' if rollover else ""
        (tmp_path / "mill.toml").write_text(MACHINE.format(rollover=entry, travel=travel, control=control))
        return str(tmp_path / "mill.toml")

    return written


def erring(machine):
    """A model whose errors repeat with every turn of C: tens of um."""
    sizes = {"X": 22.0, "Y": 30.0, "Z": 19.0, "B": 80.0}
    return model_of(ncomp.load_machine(machine), *(Cyclic(c, "C", 360.0, (v,), (-v / 2,)) for c, v in sizes.items()))


def corrected(text, machine, dialect, **options):
    return ncomp.correct(text, machine, erring(machine), dialect=dialect, tolerance_um=TOLERANCE_UM, **options)


def angles(done, axis="C"):
    """Positions of an axis at the ends of the moves of a corrected program, degrees."""
    machine = done.job.machine
    return np.degrees(done.moves.machine_target[:, machine.index(axis)])


SIEMENS = (
    "G71 G90 G17\nT1 D1 M6\nG54\nG0 B0 C0\nTRAORI\nG0 X40 Y5 Z30 B0 C{}\nG1 X42 C{} F500\nX43 C={}\nTRAFOOF\nM30\n"
)
ISO = "G21 G90 G17 G94\nT1 M6\nG54\nG43.4 H1\nG0 X40. Y5. Z30. B0. C{}\nG1 X42. C{} F500\nX43. C{}\nM30\n"
KLARTEXT = (
    "BEGIN PGM A MM\nCYCL DEF 247 DATUM Q339=+1\nTOOL CALL 1 Z S1\nL B+0 C+0 FMAX\n{}M128\nL X+40 Y+5 Z+30 C{} R0 FMAX\n"
    "L X+42 C{} F500\nL X+43 C{}\nM129\nM30\nEND PGM A MM\n"
)
SHORTEST = {
    "DC": ("siemens", SIEMENS.format("=DC(355)", "=DC(5)", "DC(15)"), "", "DC"),
    "ACP": ("siemens", SIEMENS.format("=DC(355)", "=ACP(5)", "ACP(15)"), "", "ACP"),
    "DC, then the number alone": ("siemens", SIEMENS.format("=DC(355)", "=DC(5)", "15"), "", "DC"),
    "M126": ("heidenhain", KLARTEXT.format("M126\n", "+355", "+5", "+15"), "", ""),
    "rollover in ISO": ("iso", ISO.format("355.", "5.", "15."), "shortest", ""),
    "rollover in Siemens": ("siemens", SIEMENS.format("355", "5", "15"), "shortest", ""),
    "rollover in Klartext": ("heidenhain", KLARTEXT.format("", "+355", "+5", "+15"), "shortest", ""),
}


@pytest.mark.parametrize("case", SHORTEST)
def test_the_shortest_way_is_corrected_like_its_positions(case, mill):
    dialect, text, rollover, mode = SHORTEST[case]
    done = corrected(text, mill(rollover), dialect)
    plain = corrected(ISO.format("-5.", "5.", "15."), mill(), "iso")
    assert not done.report.not_split
    assert done.report.split_moves == plain.report.split_moves > 0
    assert done.report.between_ends.largest < 1.2 * TOLERANCE_UM
    way = angles(done)[-len(angles(plain)) :]
    assert way - way[0] == pytest.approx(angles(plain) - angles(plain)[0], abs=1e-6)
    assert way[-1] - way[0] == pytest.approx(20.0)
    added = [line for line in done.text.splitlines() if "NCOMP FROM" in line]
    assert added
    assert all(0.0 <= float(re.search(r"C(?:=\w+\(|\+)?(\d+\.?\d*)", line)[1]) < 360.0 for line in added)
    assert f"C={mode}(" in added[0] if mode else "C=" not in "".join(added)


READ = {
    "the long way as written": ("iso", ISO.format("355.", "5.", "15."), "as-written", [355, 5, 15]),
    "ACN": ("siemens", SIEMENS.format("=DC(355)", "=ACN(5)", "ACN(15)"), "", [-5, -355, -705]),
    "back to numbers": ("heidenhain", KLARTEXT.format("M126\n", "+355", "+5 M127", "+15"), "", [-5, -355, -345]),
    "increments": ("iso", ISO.format("355.", "5.", "0. G91"), "shortest", [-5, 5, 5]),
    "half a turn": ("iso", ISO.format("0.", "180.", "0."), "shortest", [0, 180, 360]),
    "half a turn by DC": ("siemens", SIEMENS.format("=DC(0)", "=DC(180)", "DC(0)"), "", [0, 180, 360]),
    "a turn back": ("iso", ISO.format("10.", "350.", "200."), "shortest", [10, -10, -160]),
    "signs": ("iso", ISO.format("90.", "-90.", "10."), "signed", [90, 90, 370]),
}


@pytest.mark.parametrize("case", READ)
def test_positions_that_words_lead_to(case, mill):
    dialect, text, rollover, expected = READ[case]
    done = ncomp.correct(text, mill(rollover), "none", dialect=dialect)
    assert angles(done)[-3:] == pytest.approx(expected, abs=1e-9)


def test_many_plain_lines_lead_the_shortest_way(mill):
    """Lines that are read as columns: 0, 350, 10, 200, 90, 350, ... turn by -10, 20, -170, -110, -100 degrees, ..."""
    lines = "".join(f"X{i}. C{number}.\n" for i, number in enumerate([350, 10, 200, 90] * 10))
    text = f"G21 G90 G17 G94\nT1 M6\nG54\nG0 X40. Y5. Z300. B0. C0.\nG1 F500\n{lines}M30\n"
    found = angles(ncomp.correct(text, mill("shortest"), "none", dialect="iso"))[-40:]
    assert found[:5].tolist() == pytest.approx([-10, 10, -160, -270, -370])
    assert np.diff(found) == pytest.approx(([20, -170, -110, -100] * 10)[:39])


LIMITED = "[0, 360]"


def test_an_axis_with_limits_never_leaves_its_travel(mill):
    text = SIEMENS.format("=DC(355)", "=DC(5)", "DC(15)")
    done = ncomp.correct(text, mill(travel=LIMITED), "none", dialect="siemens")
    assert angles(done)[-3:] == pytest.approx([355, 5, 15])


KNOWN = {
    "an increment": ("0.", "0.", "360. G91"),
    "one full turn": ("0.", "360.", "360."),
}


@pytest.mark.parametrize("case", KNOWN)
def test_whole_turns_are_split(case, mill):
    done = corrected(ISO.format(*KNOWN[case]), mill(), "iso")
    assert not done.report.not_split
    assert done.report.between_ends.largest < 1.2 * TOLERANCE_UM
    assert angles(done)[-1] == pytest.approx(360.0)
    assert np.diff(angles(done)).max() < 180.0


def test_a_jump_that_is_not_split_names_the_entry(mill, tmp_path):
    machine = mill()
    write_model(erring(machine), tmp_path / "cal.json")
    (tmp_path / "a.nc").write_text(ISO.format("355.", "5.", "15."))
    command = (tmp_path / "a.nc", "--machine", machine, "--calibration", tmp_path / "cal.json", "-o", tmp_path / "o.nc")
    entry = 'rollover = "as-written" or "shortest" under [axes.C]'
    assert entry in " ".join(refusal(*command).split())
    mill("shortest")
    assert entry not in succeed(*command).shown


@pytest.mark.parametrize("case", ["DC", "M126", "rollover in ISO"])
def test_a_corrected_orientation_keeps_the_way(case, mill):
    dialect, text, rollover, _ = SHORTEST[case]
    machine = ncomp.load_machine(mill(rollover))
    model = model_of(machine, Cyclic("C", "C", 360.0, (60.0,), (-80.0,)), Cyclic("B", "C", 360.0, (40.0,), (90.0,)))
    done = ncomp.correct(text, mill(rollover), model, dialect=dialect, classes="FOR,L-VOL,R-VOL")
    assert done.report.tilt_after.largest < 10.0
    first = np.flatnonzero(done.moves.kind == Kind.LINE)[0]
    assert angles(done)[-1] - angles(done)[first - 1] == pytest.approx(20.0, abs=0.05)
    verdict = ncomp.verify(text, done.text, mill(rollover), model, dialect=dialect).verdicts[""]
    assert verdict.after.largest < 1.0


@pytest.mark.parametrize("size", [-300.0, 300.0])
def test_a_correction_that_would_turn_once_round_is_refused(size, mill):
    """C=ACP(90.002) after a corrected position beyond it is nearly a full turn away."""
    model = model_of(ncomp.load_machine(mill()), Cyclic("A", "Y", 1000.0, (size,), (0.0,)))
    text = SIEMENS.format("=DC(90)", "=ACP(90.002)", "ACP(90.01)").replace("B0 C=", "B30 C=").replace("X42", "X142")
    with pytest.raises(ncomp.UserError, match="turn it once round"):
        ncomp.correct(text, mill(), model, dialect="siemens", classes="FOR,L-VOL,R-VOL")


def test_many_plain_lines_are_read_like_single_ones(mill):
    rng = np.random.default_rng(5)
    numbers = rng.uniform(0.0, 360.0, 400).round(3)
    lines = [f"L X{x:+.3f} C{c:+.3f}" for x, c in zip(rng.uniform(-50, 50, 400), numbers, strict=True)]
    head = "BEGIN PGM A MM\nCYCL DEF 247 DATUM Q339=+1\nTOOL CALL 1 Z S1\nM126\nL X+0 Y+0 Z+0 B+0 C+0 R0 F500\n"
    together = ncomp.correct(head + "\n".join(lines) + "\nEND PGM A MM\n", mill(), "none", dialect="heidenhain")
    single = ncomp.correct(
        head + "\n".join(f"{line} M126" for line in lines) + "\nEND PGM A MM\n", mill(), "none", dialect="heidenhain"
    )
    assert angles(together) == pytest.approx(angles(single), abs=1e-9)
    assert np.abs(np.diff(angles(together))).max() <= 180.0
    assert angles(together)[1:] % 360 == pytest.approx(numbers)


RULES = {
    "M126, an axis with ends": ("heidenhain", "M126", "", "[-200, 200]"),
    "signed": ("iso", "G90", "signed", None),
    "shortest, an axis with ends": ("iso", "G90", "shortest", "[-200, 200]"),
}
"""Dialect, a line of the program, rollover and travel: words of C are read one after the other."""


@pytest.mark.parametrize("case", RULES)
def test_only_lines_that_name_such_an_axis_are_read_one_by_one(case, mill):
    """They are the same together and alone, and those without a word of C are read together."""
    dialect, mode, rollover, travel = RULES[case]
    machine = ncomp.load_machine(mill(rollover, **({} if travel is None else {"travel": travel})))
    model = model_of(machine, Cyclic("A", "X", 30.0, (5.0,), (3.0,)))
    rng, klartext = np.random.default_rng(7), dialect == "heidenhain"
    lines = [f"{'L ' if klartext else ''}X{x:+.3f}" for x in rng.uniform(-50, 50, 120)]
    for k, number in zip(range(20, 110, 15), (355.0, 5.0, 170.0, 190.0, 350.0, 10.0), strict=True):
        lines[k] += f" C{number:+.1f}"
    head = ["BEGIN PGM A MM", mode, "L X+0 Y+0 Z+0 B+0 C+0 R0 F500"] if klartext else [mode, "G1 X0 Y0 Z0 B0 C0 F500"]
    text = "\n".join([*head, *lines, *(["END PGM A MM"] if klartext else ["M30"])]) + "\n"
    together = outcome(text, machine, model, dialect=dialect)
    assert together == outcome(text, machine, model, dialect=dialect, plain=False)
    assert len(together) == 2, together

    taken = []
    with pytest.MonkeyPatch.context() as patch:
        take = Interpreter._take_run
        patch.setattr(
            Interpreter, "_take_run", lambda own, at, run, *rest: taken.append(len(run)) or take(own, at, run, *rest)
        )
        outcome(text, machine, model, dialect=dialect)
    assert sum(taken) >= 110


# ---- signs that are directions, against LinuxCNC

WRAPPED = """[EMC]
VERSION = 1.1
[RS274NGC]
PARAMETER_FILE = w.var
[TRAJ]
COORDINATES = X Y Z B C
LINEAR_UNITS = mm
[AXIS_C]
WRAPPED_ROTARY = 1
[EMCIO]
TOOL_TABLE = w.tbl
"""


def linuxcnc_angles(text, folder):
    """Positions of C at the ends of the moves in LinuxCNC's interpreter with a wrapped axis."""
    (folder / "w.ini").write_text(WRAPPED)
    (folder / "w.tbl").write_text("")
    (folder / "w.ngc").write_text(text)
    done = subprocess.run(
        ["rs274", "-i", "w.ini", "-g", "w.ngc"], cwd=folder, capture_output=True, text=True, timeout=60, check=True
    )
    moves = re.findall(r"STRAIGHT_(?:TRAVERSE|FEED)\(([^)]*)\)", done.stdout)
    return [float(move.split(",")[5]) for move in moves]


def signed_words(seed):
    """A program of random words of a wrapped axis, absolute and by increments."""
    rng = np.random.default_rng(seed)
    lines = []
    for _ in range(60):
        number = float(rng.choice([round(rng.uniform(-359.9, 359.9), 2), rng.choice([0.0, -0.0, 90.0, -90.0, 180.0])]))
        text = f"{'-' if np.signbit(number) else ''}{abs(number):.2f}"
        lines.append(f"G91 C{text}\nG90" if rng.random() < 0.2 else f"G0 X{rng.uniform(-9, 9):.1f} C{text}")
    return "G21 G90 G54\nG0 X0. Y0. Z0. B0. C90.\nC-90.\nC10.\nC0.\n" + "\n".join(lines) + "\nM2\n"


@pytest.mark.usefixtures("linuxcnc")
@pytest.mark.parametrize("seed", range(4))
def test_signed_words_end_where_linuxcnc_ends(seed, mill, tmp_path):
    text = signed_words(seed)
    machine = mill("signed", control='family = "linuxcnc"')
    done = ncomp.correct(
        text, machine, "none", setup=ncomp.set_up(machine, work_offset=["G54=0,0,0"]), travel_check=False
    )
    assert angles(done) == pytest.approx(linuxcnc_angles(text, tmp_path), abs=1e-3)
    assert angles(done)[:4] == pytest.approx([90.0, 90.0, 370.0, 720.0])


@pytest.mark.usefixtures("linuxcnc")
@pytest.mark.parametrize(
    "words", [("90.", "60.", "50."), ("10.", "-350.", "-300."), ("20.", "-1.", "-0.5"), ("300.", "40.", "-20.")]
)
def test_segments_of_signed_words_lead_linuxcnc_along_the_way(words, mill, tmp_path):
    machine = mill("signed", control='family = "linuxcnc"\ntcp_at_start = true')
    text = ISO.format(*words).replace("G43.4 H1\n", "G43 H1\n")
    done = corrected(text, machine, "iso")
    assert done.report.split_moves
    assert not done.report.not_split
    assert done.report.between_ends.largest < 1.2 * TOLERANCE_UM
    before, after = (
        linuxcnc_angles(text.replace("T1 M6\n", ""), tmp_path),
        linuxcnc_angles(done.text.replace("T1 M6\n", ""), tmp_path),
    )
    assert after[-1] == pytest.approx(before[-1], abs=1e-3)
    assert angles(done) == pytest.approx(after[-len(angles(done)) :], abs=1e-3)
    assert np.abs(np.diff(after)).max() < 180.0


def test_a_signed_number_beyond_a_turn_is_refused(mill):
    with pytest.raises(ncomp.UserError, match="between -360 and 360"):
        ncomp.correct(ISO.format("0.", "400.", "0."), mill("signed"), "none", dialect="iso")


@pytest.mark.parametrize(("word", "shown"), [("-30.", True), ("400.", True), ("360.", False), ("30.", False)])
def test_words_outside_a_turn_are_an_assumption(word, shown, mill, tmp_path):
    (tmp_path / "a.nc").write_text(ISO.format("0.", word, "10.") + "")
    command = ("--machine", mill(), "--calibration", "none", "-o", tmp_path / "o.nc")
    said = " ".join(succeed(tmp_path / "a.nc", *command).shown.split())
    assert ("is taken as a position, and its sign not as a direction" in said) == shown
    command = ("--machine", mill("as-written"), "--calibration", "none", "-o", tmp_path / "o.nc")
    assert "is taken as a position" not in " ".join(succeed(tmp_path / "a.nc", *command).shown.split())


def test_rollover_needs_an_axis_that_turns_fully(mill):
    with pytest.raises(ncomp.UserError, match="rollover = 'shortest' needs a rotary axis"):
        ncomp.load_machine(mill("shortest", travel="[-90, 90]"))
