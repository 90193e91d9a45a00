"""Canned cycles: every hole is moved to where the machine with errors drills it right; depths too."""

import numpy as np
import pytest
from clients.rs274 import Move
from hypothesis import strategies as st
from support.programs import WHOLE, correct, load, model_of, random_model, read, read_lines, shifted
from support.tiers import drawn, quick

from kinematics.effects import Backlash
from kinematics.error_model.model import ErrorModel
from kinematics.user_error import UserError
from postproc.compensation.correction import pose_errors
from postproc.motion.moves import Kind
from postproc.verification.verify import verify

HEAD = "G21 G90 G54 G17 G98\nG0 X0. Y0. Z100.\n"
TAIL = "G80\nG0 X1. Y1.\nM2\n"
PROGRAMS = {
    "modal": "G81 X10. Y5. Z-20. R2. F100\nX20.\nY10.\nX30. Y40.\n",
    "depths": "G82 X10. Y5. Z-20. R2. P1. F100\nX20. Z-30.\nY10.\nZ-10. R5.\n",
    "levels": "G99 G83 X10. Y5. Z-20. R2. Q5. F100\nX20.\nG98 Y10.\nX30.\nG99 X5.\n",
    "one after the other": "G81 X10. Y5. Z-20. R2. F100\nX20.\nG85 X30. Z-25. R3.\nX40.\n",
    "increments": "G91 G81 X10. Y5. Z-20. R-90. F100\nX10.\nX10. Y-3.\nG80 G90 X0.\n".replace("G80 G90 X0.", "G80\nG90 G1 X0. Y0. F100"),
    "peck": "G73 X10. Y5. Z-20. R2. Q4. F100\nX20. Q3.\n",
    "boring": "M3 S100\nG86 X10. Y5. Z-20. R2. P1. F100\nX20.\nG89 X20. Y20. Z-20. R2. P1.\n",
    "inches": "G20\nG81 X1. Y.5 Z-.5 R.1 F10\nX2.\n",
    "formulas": "#1=10 #2=-20\nG81 X#1 Y5. Z[#2-1] R2. F100\nX[#1+10]\n",
    "L": "G81 X10. Y5. Z-20. R2. L3 F100\nX20. L2\n",
    "another plane": "G18\nG0 Y90.\nG81 X10. Z5. Y-20. R2. F100\nX20.\nG98 Z7. Y-4. R1.\n",
    "the third plane": "G19\nG0 X90.\nG83 Z10. Y5. X-20. R2. Q5. F100\nY20.\n",
    "a loop": "#1=0\no1 while [#1 lt 3]\nG81 X[#1*10] Y5. Z-20. R2. F100\n#1=[#1+1]\no1 endwhile\n",
    "between moves": "G1 Z50. F100\nG81 X10. Y5. Z-20. R2. F100\nG0 X20.\nZ60.\nG81 Z-5. R1. F100\nX30.\n",
}  # fmt: skip


def holes(motions):
    return np.flatnonzero(motions.kind == Kind.CYCLE)


def bottoms(moves: list[Move], lines: list[int], rows: np.ndarray, axis: int = 2) -> list[tuple[float, ...]]:
    """Lowest places of LinuxCNC's moves in the blocks that drill along an axis, in order."""
    wanted = {lines[row] for row in rows}
    found: list[tuple[float, ...]] = []
    last = None
    for move in moves:
        if move.line not in wanted:
            last = None
            continue
        place = move.machine[:3]
        hole = (move.line, [place[i] for i in range(3) if i != axis])
        if hole != last:
            found.append(place)
            last = hole
        elif place[axis] < found[-1][axis]:
            found[-1] = place
    return [place for place in found if place[axis] < 40.0]


@pytest.mark.parametrize("name", quick(PROGRAMS, [*PROGRAMS][::2]))
def test_linuxcnc_drills_the_same_holes(linuxcnc, name):
    machine, text = load("gantry"), HEAD + PROGRAMS[name] + TAIL
    model = shifted(machine, X=3.0, Y=-4.2, Z=5.5) if name == "a loop" else random_model(machine, 5)
    written = correct(text, machine, model, travel_check=False).text
    for program in (text, written):
        seen = linuxcnc.run(program)
        assert seen.exit_status == 0, seen
        motions, lines = read_lines(program, machine)
        rows = holes(motions)
        assert len(rows) > 1
        axis = motions.cycles[rows[0]].axis
        np.testing.assert_allclose(bottoms(seen.moves, lines, rows, axis), motions.machine_target[rows], atol=1e-6)
        after = [move for move in seen.moves if move.line == lines[rows[-1]]][-1]
        assert after.machine[axis] == pytest.approx(motions.in_machine(motions.start)[rows[-1] + 1, axis], abs=1e-6)


@pytest.mark.parametrize("name", PROGRAMS)
def test_holes_are_put_right(name):
    machine, text = load("gantry"), HEAD + PROGRAMS[name] + TAIL
    assert correct(text, machine, travel_check=False).text == text
    if name == "a loop":
        with pytest.raises(UserError, match="needs a different correction each time"):
            correct(text, machine, random_model(machine, 5), travel_check=False)
        return
    model = random_model(machine, 5)
    nominal, commanded = (
        read(text, machine),
        read(correct(text, machine, model, travel_check=False, **WHOLE).text, machine),
    )
    rows = holes(nominal)
    left = error(machine, model, nominal, commanded, rows)
    assert error(machine, model, nominal, nominal, rows).max() > 20.0
    assert left.max() < 0.1
    assert verify(nominal, commanded, model).after.largest < 0.1


def error(machine, model: ErrorModel, nominal, commanded, rows):
    return pose_errors(
        machine, model, commanded.machine_target[rows], nominal.machine_target[rows], nominal.tool[rows]
    ).point_um


def test_what_is_written():
    machine = load("gantry")
    text = HEAD + "G81X10.Y5.Z-20.R2.F100\nX20.\nG99X30.\nG80\nG0 X1. Y1.\n"
    written = correct(text, machine, shifted(machine, X=3.0, Z=5.5), travel_check=False).text
    assert written.splitlines()[3:] == [
        "G81X9.9970Y5.Z-20.0055R1.9945F100", "X19.9970", "G99X29.9970", "G80", "G0 X0.9970 Y1.",
    ]  # fmt: skip


def test_play_is_taken_up_on_the_way_to_a_hole():
    machine, text = load("gantry"), HEAD + "G81 X10. Y5. Z-20. R2. F100\nX20.\nX15.\n" + TAIL
    model = model_of(machine, Backlash("X", 20.0), Backlash("Z", 10.0))
    result = correct(text, machine, model, travel_check=False)
    assert result.report.added_blocks == 0
    assert result.text.splitlines()[3:6] == ["G81 X10.0100 Y5. Z-20.0050 R1.9950 F100", "X20.0100", "X14.9900"]


def test_repeats_by_increments(linuxcnc):
    """One block drills several holes; each is put right as long as they want the same words."""
    machine = load("gantry")
    text = HEAD + "G91 G81 X10. Y-3. Z-20. R-90. L4 F100\nX5. L2\n" + TAIL.replace("G80", "G80\nG90")
    motions, lines = read_lines(text, machine)
    rows = holes(motions)
    assert motions.machine_target[rows, 0].tolist() == [10, 20, 30, 40, 45, 50]
    model = shifted(machine, X=3.0, Y=-4.2, Z=5.5)
    written = correct(text, machine, model, travel_check=False).text
    for program in (text, written):
        seen = linuxcnc.run(program)
        motions, lines = read_lines(program, machine)
        np.testing.assert_allclose(bottoms(seen.moves, lines, rows), motions.machine_target[rows], atol=1e-6)
    with pytest.raises(UserError, match="the block drills several holes that need different corrections"):
        correct(text, machine, random_model(machine, 5), travel_check=False)


REFUSED = {
    "G81 X5. Y5. Z-5. F100": "the canned cycle needs Z and R",
    "G81 X5. Y5. R2. F100": "the canned cycle needs Z and R",
    "G81 X5. Y5. Z-5. R200. F100": "R is above the level before the cycle",
    "G81 X5. Y5. Z-5. R2. K0": "the effect of K0 or L0 in this canned cycle",
    "G81 X5. Y5. Z-5. R2. K2 L2": "a canned cycle takes one of K and L",
    "G81 X5. Y5. Z-5. R2. I3.": "I in a canned cycle",
    "G81 X5. Y5. Z-5. R2.\nG18 X7.": "a change of the plane within a canned cycle",
    "G81 X5. Y5. Z-5. R2.\nG19 G83 X7. Q1.": "a change of the plane within a canned cycle",
    "G41 D1 X5.\nG81 X5. Y5. Z-5. R2.": "a canned cycle under radius compensation",
    "G51 X0. Y0. Z0. P2.\nG81 X5. Y5. Z-5. R2.": "controls differ in canned cycles with a scaled or mirrored depth",
    "G91 G81 X5. Y5. Z-5. R-2.\nG90 X5.": "G90 or G91 within a canned cycle",
    "G81 G80 X5.": "G80 and G81 in one block",
    "G98 G99": "G98 and G99 in one block",
    "G87 X5. Y5. Z-5. R2.": "G87 is a boring cycle that shifts the tool",
    "G76 X5. Y5. Z-5. R2. Q1.": "G76 is threading on LinuxCNC and fine boring on FANUC",
}


@pytest.mark.parametrize("block", REFUSED)
def test_refused(block):
    with pytest.raises(UserError) as caught:
        read(HEAD + block + "\n", load("gantry"))
    assert REFUSED[block] in str(caught.value)


def test_where_a_cycle_ends_unless_the_program_says_so():
    """At the level before it on Fanuc, at R on LinuxCNC: Z is not known until it is said again."""
    text = HEAD.replace(" G98", "") + "G81 X10. Y5. Z-20. R2. F100\nG80\nG0 X5.\nZ5.\n"
    machine = load("gantry")
    assert read(text, machine).evaluated.tolist() == [True, True, False, True]
    assert correct(text, machine, shifted(machine, Z=5.0), travel_check=False).text.splitlines()[-2:] == [
        "G0 X5.",
        "Z4.9950",
    ]


places = st.integers(0, 400).map(lambda tenths: f"{tenths / 10:.1f}")
hole = st.tuples(
    st.sampled_from(["", "", "", "G98 ", "G99 "]),
    st.lists(st.sampled_from("XYZR"), unique=True, min_size=1, max_size=4).filter(lambda names: names != ["R"]),
    places, places, st.integers(1, 300), st.integers(0, 40),
)  # fmt: skip


@drawn(
    few=4,
    many=25,
    code=st.sampled_from(["G81", "G82 P1.", "G83 Q7.", "G85"]),
    found=st.lists(hole, min_size=1, max_size=6),
)
def test_generated_cycles_against_linuxcnc(linuxcnc, code, found):
    lines = [f"{code} X5. Y5. Z-1. R50. F100"]
    for level, names, x, y, depth, retract in found:
        values = {"X": x, "Y": y, "Z": f"-{depth / 10}", "R": f"{retract}."}
        lines.append(level + " ".join(name + values[name] for name in sorted(names)))
    machine, text = load("gantry"), HEAD + "\n".join(lines) + "\n" + TAIL
    written = correct(text, machine, random_model(machine, 6), travel_check=False).text
    for program in (text, written):
        seen = linuxcnc.run(program)
        assert seen.exit_status == 0, seen
        motions, places_ = read_lines(program, machine)
        rows = holes(motions)
        np.testing.assert_allclose(bottoms(seen.moves, places_, rows), motions.machine_target[rows], atol=1e-6)
