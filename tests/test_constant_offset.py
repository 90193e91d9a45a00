"""For an error that is the same everywhere, LinuxCNC's interpreter moves every end and centre by just that, and does
nothing else otherwise: on all real programs that it takes, and on generated ones."""

import numpy as np
import pytest
from clients.rs274 import Move, Tool
from support.linuxcnc_programs import TOOLS, wrapped
from support.programs import LINUXCNC_OFFSETS, RandomProgram, correct, load, random_setup, read_lines, shifted
from support.real_data import FREECAD
from support.tiers import quick

from kinematics.user_error import UserError
from postproc.motion.moves import Kind, Known
from postproc.text.source import ENCODING

UM = {"X": 3.0, "Y": -4.2, "Z": 7.3}
"""For some others, 5.5 among them, LinuxCNC's own sums make a peck of no length at the bottom of every hole."""
SHIFT = np.array([-0.003, 0.0042, -0.0073])
REFUSED = {
    # LinuxCNC: the centres of these are absolute
    "BOTTLE.NC", "CONTOUR_ABS.NC", "TEST2.NC",
    # ncomp: a lathe's diameters; increments behind a tool change; G90 within a cycle of increments
    "TEST_TURN.NC", "TEST_G91.NC", "G81_G91.NC",
}  # fmt: skip
"""Real programs that one of the two does not take."""


def shifts_of(machine, text, **setup) -> dict[int, np.ndarray]:
    """By line: how far X Y Z at the end of its moves have to go; nan for what the program has not said in its frame."""
    motions, lines = read_lines(text, machine, **setup)
    columns = [machine.index(axis) for axis in "XYZ"]
    said = (motions.known[:, columns] == Known.PROGRAM) & motions.programmed[:, None]
    moving = motions.kind != Kind.PRESET
    return {line: np.where(row, SHIFT, np.nan) for line, row, real in zip(lines, said, moving, strict=True) if real}


def compare(linuxcnc, text, machine, decimals=4, environment=None, **setup):
    """Check every move of a program against that of its correction; how many there are."""
    written = correct(text, machine, shifted(machine, **UM), travel_check=False, **setup).text
    before, after = (linuxcnc.run(program, **(environment or {})) for program in (text, written))
    assert (before.exit_status, after.exit_status) == (0, 0), (before.message, after.message)
    added = 1 if "NCOMP" in written else 0
    expected, unsaid = shifts_of(machine, text, **setup), np.full(3, np.nan)
    assert len(before.moves) == len(after.moves)
    for old, new in zip(before.moves, after.moves, strict=True):
        assert old.line is not None
        assert new.line == old.line + (added if new.line != old.line else 0)
        check_rest(old, new)
        check_ends(old, new, expected.get(old.line, unsaid), 10.0**-decimals)
    return len(before.moves)


def check_rest(old: Move, new: Move) -> None:
    same = ("kind", "plane", "turns", "number")
    assert [getattr(old, name) for name in same] == [getattr(new, name) for name in same]
    assert old.end[3:] == new.end[3:]
    assert new.feed == pytest.approx(old.feed, abs=1e-9)


def check_ends(old: Move, new: Move, expected: np.ndarray, resolution: float) -> None:
    tolerance = 0.51 * resolution
    moved = np.array(new.machine[:3]) - old.machine[:3]
    # it stands where it was put, or where the program has put it in another frame
    still = np.where(np.abs(moved) < tolerance, 0.0, SHIFT)
    np.testing.assert_allclose(moved, np.where(np.isnan(expected), still, expected), atol=tolerance)
    if old.centre is not None and new.centre is not None:
        # in its plane; LinuxCNC itself moves a centre that is not quite as far from both ends
        i, j = {"xy": (0, 1), "yz": (1, 2), "xz": (0, 2)}[old.plane]
        centre = np.array(new.centre) - old.centre
        np.testing.assert_allclose(centre[[i, j]], moved[[i, j]], atol=4 * tolerance)


def real_programs(nc_data):
    return sorted([*(nc_data / "iso").rglob("*.*"), *FREECAD.glob("*.nc")])


@pytest.mark.statistical
def test_every_real_program_that_linuxcnc_takes(linuxcnc, nc_data):
    left, moves = set(), 0
    for path in real_programs(nc_data):
        machine = load("trunnion_ac" if "xyzac" in path.name else "dmu50")
        text = wrapped(path.read_bytes().decode(ENCODING))
        try:
            taken = linuxcnc.run(text).exit_status == 0
            read_lines(text, machine)
        except UserError:
            taken = False
        if not taken:
            left.add(path.name)
        elif path.stat().st_size < 100_000:
            moves += compare(linuxcnc, text, machine)
    assert left & {path.name for path in (nc_data / "iso").rglob("*.*")} == REFUSED
    assert moves > 5000


@pytest.mark.statistical
def test_the_impeller(linuxcnc, nc_data):
    (path,) = (nc_data / "iso").rglob("impeller*")
    assert compare(linuxcnc, path.read_bytes().decode(ENCODING), load("trunnion_ac")) == 4492


@pytest.mark.parametrize("machine", ["gantry", "head_table"])
@pytest.mark.parametrize("seed", quick(range(60), range(4), range(4, 16)))
def test_random_programs(linuxcnc, machine, seed):
    machine = load(machine)
    setup = random_setup(machine)
    text = RandomProgram(machine, seed, for_linuxcnc=True).text(40)
    offsets = dict(option.split("=") for option in setup["offsets"])
    places = {name: [float(value) for value in offsets[name].split(",")] for name in LINUXCNC_OFFSETS}
    environment = {"tools": TOOLS, "work_offsets": places}
    assert compare(linuxcnc, text, machine, environment=environment, **setup) > 10


CONTOURS = {
    "outside": "G41 D1 G1 X10. Y10.\nZ-5.\nY50.\nG2 X30. Y70. I20. J0.\nG1 X50.\nY10.\nX8.\nG40 G0 X0. Y0.\nZ20.\n",
    "inside": "G1 X30. Y30. Z-5.\nG42 D1 X40. Y30.\nY10.\nX10.\nY50.\nX40.\nY30.\nG40 X30. Y35.\nZ20.\n",
    "arcs": "G41.1 D8. G1 X10. Y10.\nG3 X30. Y30. I0. J20.\nX10. Y50. R20.\nG1 X-10.\nG40 G0 X-20.\n",
    "increments": "G91 G41 D1 G1 X10. Y10.\nY40.\nX40.\nG2 X10. Y-10. J-10.\nG1 Y-30.\nG90 G40 X0. Y-20.\n",
    "another plane": "G18 G42 D1 G1 X10. Z10.\nZ50.\nX40.\nY5.\nX60. Z60.\nG40 X80. Z80.\n",
}


@pytest.mark.parametrize("name", CONTOURS)
def test_paths_shifted_by_the_radius_of_the_tool(linuxcnc, name):
    """Also where LinuxCNC runs beside the contour: its own path moves by the offset, corners and all."""
    text = "G21 G90 G54 G17 G94 F500\nG0 X0. Y0. Z20.\n" + CONTOURS[name] + "M2\n"
    machine, environment = load("gantry"), {"tools": {1: Tool(0.0, 8.0)}}
    written = correct(text, machine, shifted(machine, **UM), travel_check=False).text
    before, after = (linuxcnc.run(program, **environment).moves for program in (text, written))
    assert len(before) == len(after) > 5
    moved = [np.array(new.machine[:3]) - old.machine[:3] for old, new in zip(before, after, strict=True)]
    np.testing.assert_allclose(moved, np.broadcast_to(SHIFT, (len(moved), 3)), atol=1e-4)
    for old, new in zip(before, after, strict=True):
        assert (old.kind, old.plane, old.turns) == (new.kind, new.plane, new.turns)
