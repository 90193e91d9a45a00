"""LinuxCNC's interpreter reads what ncomp reads, and what ncomp writes."""

import math
import re
from typing import NamedTuple

import numpy as np
import pytest
from clients.rs274 import Move
from support.corrected_rows import exact_rows, without_mark
from support.linuxcnc_programs import TOOLS, wrapped
from support.programs import (
    LINUXCNC_OFFSETS,
    WHOLE,
    RandomProgram,
    correct,
    load,
    model_of,
    random_model,
    random_setup,
    read_lines,
    source_of,
)
from support.real_data import FREECAD
from support.real_programs import LINES_OF_REAL_PROGRAMS, SHORT, first_lines, real_programs
from support.tiers import quick

from kinematics.effects import Backlash
from kinematics.machine import Machine
from kinematics.user_error import UserError
from postproc.compensation.correction import correct as correction_of
from postproc.motion.circles import sweep
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind, Known
from postproc.text.number_style import decimals_for
from postproc.text.source import ENCODING

pytestmark = pytest.mark.usefixtures("linuxcnc")

KINDS = {Kind.RAPID: "rapid", Kind.LINE: "line", Kind.ARC: "arc"}
PLANES = {"XYZ": "xy", "ZXY": "xz", "YZX": "yz"}
COLUMNS = "XYZABC"
SAME = 1e-9
LAST_DECIMAL = 1e-4


class Seen(NamedTuple):
    """A program as LinuxCNC sees it: its moves by line of the source.

    Without those to reference points, and without those of no length that it makes of a G0 or G1 that stands alone.
    """

    moves: dict[int, Move]
    lines: list[int]


def see(rs274, text, *, tools=None, work_offsets=None):
    """LinuxCNC's moves; fails when it refuses the program."""
    result = rs274.run(text, tools=tools, work_offsets=work_offsets)
    assert result.exit_status == 0, f"line {result.line}: {result.message}"
    lines = text.splitlines()
    code = [re.sub(r"\(.*?\)|;.*", "", line).upper() for line in lines]
    moving = [re.search(r"[XYZABCIJKR]", line) and not re.search(r"G28|G30", line) for line in code]
    moves = [move for move in result.moves if moving[move.line - 1]]
    assert len({move.line for move in moves}) == len(moves)
    return Seen({move.line: move for move in moves}, [move.line for move in moves])


def largest_difference(motions: Motions, lines: list[int], seen: Seen) -> float:
    """Check that the moves are the same; largest difference of positions that the program has said, mm or degrees."""
    machine = motions.machine
    assert seen.lines == lines
    q = motions.machine_target / machine.scale
    largest = 0.0
    for row, line in enumerate(lines):
        move, kind = seen.moves[line], Kind(motions.kind[row])
        assert kind is Kind.MACHINE or KINDS[kind] == move.kind
        known = [i for i in range(len(machine.axes)) if motions.known[row, i] != Known.ASSUMED]
        ends = [move.machine[COLUMNS.index(machine.names[i])] for i in known]
        largest = max(largest, float(np.abs(q[row, known] - ends).max()))
        if kind is Kind.ARC:
            arc = motions.arcs[row]
            assert move.plane == PLANES["".join(machine.names[i] for i in arc.plane)]
            assert np.sign(move.turns) == arc.sense
            centre = [move.centre["XYZ".index(machine.names[i])] for i in arc.plane[:2]]
            # LinuxCNC moves a centre that is not quite as far from both ends; and by R, both work it out
            assert math.dist(centre, arc.centre) < 3 * fault_of(motions, row) + (1e-6 if arc.form == "radius" else 1e-8)
            assert arc_angle(motions, row) > 1e-9
    return largest


def plane_ends(motions, row):
    i, j, _ = motions.arcs[row].plane
    return [(float(at[row, i]), float(at[row, j])) for at in (motions.start, motions.target)]


def arc_angle(motions, row):
    arc = motions.arcs[row]
    return abs(sweep(*plane_ends(motions, row), arc.centre, arc.sense, arc.full))


def fault_of(motions, row):
    first, last = (math.dist(end, motions.arcs[row].centre) for end in plane_ends(motions, row))
    return abs(first - last)


def compare(rs274, text, machine: Machine, setup, wrap=lambda text: text, **environment):
    """The program and its correction, read by both; the largest differences between the two readers.

    The ends that LinuxCNC finds in the two texts differ by the predicted correction, to half the last decimal.
    """
    model = random_model(machine, 4)
    nominal, lines = read_lines(text, machine, **setup)
    before = see(rs274, wrap(text), **environment)
    corrected = without_mark(correct(text, machine, model, travel_check=False, **WHOLE, **setup).text)
    commanded, new_lines = read_lines(corrected, machine, **setup)
    after = see(rs274, wrap(corrected), **environment)
    assert new_lines == lines
    differences = (largest_difference(nominal, lines, before), largest_difference(commanded, lines, after))
    correction = correction_of(nominal, model)
    q = correction.corrected - correction.nominal
    exact = exact_rows(nominal)
    worst = 0.0
    for row, line in enumerate(lines):
        for i in machine.translators:
            if exact[row]:
                column = COLUMNS.index(machine.names[i])
                moved = after.moves[line].machine[column] - before.moves[line].machine[column]
                worst = max(worst, abs(moved - q[row, i]))
        for i in np.flatnonzero(machine.rotary):
            column = COLUMNS.index(machine.names[i])
            assert after.moves[line].end[column] == before.moves[line].end[column]
    return len(lines), *differences, worst


# ---- real programs


REAL = [
    "CONTOUR.NC", "CONTOUR_R.NC", "CONTOUR_R1.NC", "G17_18_19.NC", "G17_18_19_G91.NC", "PARALLEL.NC", "PROGRAM.NC",
    "PROGRAM2.NC", "TEST.NC", "TEST3.NC", "TEST4.NC", "TEST_G90.NC", "VINT_360arc-1.NC", "VINT_360arc.NC",
    "VINT_REV_360arc.NC", "impeller-7bl-xyzac.ngc", "box_grbl.nc", "box_linuxcnc.nc", "box_mach3_mach4.nc",
]  # fmt: skip


@pytest.mark.parametrize("name", quick(REAL, sorted(SHORT)))
def test_real_programs(linuxcnc, nc_data, name):
    (path,) = [*(nc_data / "iso").rglob(name), *FREECAD.glob(name)]
    machine = load("trunnion_ac" if "xyzac" in name else "dmu50")
    text = path.read_bytes().decode(ENCODING)
    moves, before, after, worst = compare(linuxcnc, text, machine, {}, wrapped)
    print(f"{name}: {moves} moves, {before:.1e} before, {after:.1e} after, correction within {worst:.2e}")
    assert moves > 9
    assert before < SAME
    assert after < SAME
    assert worst <= 0.5 * LAST_DECIMAL + SAME


@LINES_OF_REAL_PROGRAMS
def test_every_real_program_that_both_take_is_compared(linuxcnc, nc_data, lines, tmp_path):
    taken = set()
    for path in first_lines(real_programs(nc_data), lines, tmp_path):
        text = path.read_bytes().decode(ENCODING)
        try:
            read_lines(text, load("trunnion_ac" if "xyzac" in path.name else "dmu50"))
        except UserError:
            continue
        cut_tape = len(re.findall(r"(?m)^%", text)) == 1
        assert linuxcnc.run(wrapped(text + "\n%\n" * cut_tape)).exit_status == 0
        taken.add(path.name)
    assert taken == {*REAL, "G81.NC", "G82.NC", "G83.NC"}  # of cycles LinuxCNC shows every stroke: test_cycles.py


# ---- programs by hand and at random


def environment_of(setup):
    offsets = [option.partition("=") for option in setup["offsets"]]
    places = {name: [float(value) for value in values.split(",")] for name, _, values in offsets}
    return {"tools": TOOLS, "work_offsets": {name: places[name] for name in LINUXCNC_OFFSETS}}


HEAD = "G21 G90 G17 F600\nG54 G0 X10 Y5 Z20\n"
BY_HAND = {
    "planes": "G17 G2 X20 Y5 I5 J0\nG18 G3 Z30 X20 K5 I0\nG19 G2 Y15 Z30 J5 K0 X25\n",
    "radius": "G2 X14 Y9 R5\nG3 X20 Y5 R-6\nG18 G2 X21 Z21 R1\nG19 G3 Y6 Z22 R1\n",
    "full circles": "G2 I5\nG3 X10 Y5 J-4\nG18 G2 K3\nG19 G3 J1 K1\nG17 G2 X10 Y5 Z10 I2 J2\n",
    "absolute centres": "G90.1 G2 X20 Y5 I15 J5\nG3 I25 J5\nG18 G2 X20 Z30 I20 K25\nG91.1 G17 G2 X10 I-5\n",
    "increments": "G91\nX1\nG1 Y-.5\nG2 X4 Y4 I4\nG3 X0 Y0 J2\nG1 X.1\nX.1\nX.1\nG90 X0\n",
    "inches": "G20\nG1 X1 Y-.5\nG2 X1.5 Y0 I.5\nG91 G3 X.1 Y.1 R.1\nG90 G21 X5 R40\n".replace("X5 R40", "X40 Y5 R40"),
    "work offsets": "G55\nG1 X5\nG59.3 X1 Y1 Z1\nG2 X3 I1\nG54 G1 X0 Y0 Z0\nG91 X1\nG55 X1\n",
    "machine coordinates": "G53 G0 Z300\nX12\nG53 G1 X20 Y30\nG1 X5\nG91 Y5\nG90 Z5\n",
    "tool lengths": "T1 M6\nG43 H1 Z5\nG1 Z4\nG43 H2\nG1 X5\nZ6\nG49\nX6\nZ7\nT2 M6\nG43 Z8\n",
    "modal": "G1\nX1\nY2\nG0\nX3\nG2 X5 R1\nX3 R1\nG4 P.1\nF50\nG1 X2\n",
    "reference point": "G91 G28 Z0\nG90 G1 X5\nZ5\nG28 X0 Y0\nX1 Y1\nX2\n",
    "feed modes": "G93 G1 X1 F10\nX2 F5\nG94 X3 F100\n",
    "styles": "g1x+1.y-.5\n X 2  Y - 1.25 \nn7 x.0(y5)z-.0;z9 etc\n",
}


@pytest.mark.parametrize(
    ("machine", "name"),
    quick(
        [(machine, name) for machine in ("gantry", "dmu50") for name in BY_HAND],
        [*(("gantry", name) for name in BY_HAND), ("dmu50", "planes"), ("dmu50", "tool lengths")],
    ),
)
def test_programs_by_hand(linuxcnc, name, machine):
    machine = load(machine)
    setup = random_setup(machine)
    text = HEAD + BY_HAND[name] + "M2\n"
    moves, before, after, worst = compare(linuxcnc, text, machine, setup, **environment_of(setup))
    assert moves > 3
    assert before < SAME
    assert after < SAME
    assert worst <= 0.5 * LAST_DECIMAL + SAME


@pytest.mark.parametrize("name", BY_HAND)
def test_programs_with_take_ups(linuxcnc, name):
    """Blocks of ncomp's own too: LinuxCNC ends every move where ncomp says it has sent it."""
    machine = load("gantry")
    setup = random_setup(machine)
    head = HEAD.replace("X10 Y5 Z20", "X9 Y4 Z19\nG0 X10 Y5 Z20")
    text = head + BY_HAND[name] + "G90 G94 G1 X30 Y30 Z30 F100\nX29 Y29 Z29\nM2\n"
    model = model_of(machine, *(Backlash(axis, width) for axis, width in {"X": 20.0, "Y": 40.0, "Z": 12.0}.items()))
    result = correct(text, machine, model, travel_check=False, **setup)
    assert result.report.added_blocks > 0
    commanded, lines = read_lines(result.text, machine, **setup)
    seen = see(linuxcnc, result.text, **environment_of(setup))
    assert largest_difference(commanded, lines, seen) < SAME


@pytest.mark.parametrize("machine", ["gantry", "head_table"])
@pytest.mark.parametrize("seed", quick(range(120), range(2), range(2, 24)))
def test_random_programs(linuxcnc, machine, seed):
    machine = load(machine)
    setup = random_setup(machine)
    text = RandomProgram(machine, seed, for_linuxcnc=True).text(40)
    moves, before, after, worst = compare(linuxcnc, text, machine, setup, **environment_of(setup))
    assert moves > 10
    assert before < SAME
    assert after < SAME
    assert worst <= 0.5 * LAST_DECIMAL + SAME


def test_decimals_that_linuxcnc_prints_are_those_of_the_machines():
    assert {decimals_for(axis.resolution) for axis in load("gantry").axes} == {4}
    assert source_of("G0 X1").line_end == "\n"


@pytest.mark.parametrize("machine", quick(["gantry", "dmu50"], ["dmu50"]))
def test_split_moves(linuxcnc, machine):
    """Long lines, with rotary axes too, and arcs in three planes, in pieces: LinuxCNC goes where ncomp says."""
    machine = load(machine)
    rotary = " B20. C50." if machine.rotary.any() else ""
    text = "G21 G90 G54 F600\nG0 X0. Y0. Z0.\n" + (f"G0{rotary}\n" if rotary else "")
    text += f"G1 X150. Y-100. Z40.{rotary.replace('50', '-30')}\nG91 X-100.\nG20 X1. Z-.5\nG21 G90\n"
    text += "G0 X80. Y0. Z0.\nG17 G2 I-80.\nG3 X0. Y80. Z30. I-80. J0.\nG18 G2 X50. Z-20. R60.\nG19 G3 Y-80. J-80.\n"
    text += "G93 G1 X0. Y0. F2.\nG17 G2 X-100. R50. F3.\nG1 X100. F2. M30\n"
    setup = {"offsets": random_setup(machine)["offsets"]}
    result = correct(text, machine, random_model(machine, 1), travel_check=False, **setup)
    assert result.report.split_moves >= 6
    assert sum("NCOMP FROM" in line for line in result.text.splitlines()) == result.report.added_blocks
    commanded, lines = read_lines(result.text, machine, **setup)
    seen = see(linuxcnc, result.text, **environment_of({**random_setup(machine), **setup}))
    assert largest_difference(commanded, lines, seen) < SAME
