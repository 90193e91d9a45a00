"""Every code beside every word, under every modal motion: the moves of ncomp end where those of LinuxCNC end."""

import dataclasses
import itertools
import random

import pytest
from clients.rs274 import RefusedError
from support.programs import load, read

from kinematics.user_error import UserError

HEAD = "G21 G90 G17 G94 G54 G98 F500\nG0 X1 Y2 Z3\n"
TAIL = "\nG80 G90 G1 Y9.5\nM2\n"
MOTIONS = ("G0", "G1", "G2 X3 Y2 I1 J0", "G81 X2 Y2 Z1 R2.5", "(none)")
CODES = (
    "", "G4 P1", "G10 L2 P1", "G10 L2 P0", "G10 L20 P1", "G52", "G53", "G53 G0", "G92", "G92.1", "G92.2", "G43 H1",
    "G43.1", "G49", "G54", "G55", "G40", "G61", "G64", "G64 P0.1", "G80", "G80 G1", "G0 G80", "G90", "G91", "G90.1",
    "G91.1", "G93 F5", "G94", "G98", "G99", "G18", "G20", "G96 D100 S9", "G97 S9", "M3 S9", "M0", "M62 P1",
    "M66 P0 L0", "M61 Q1", "G0", "G1", "G3", "G81", "G82", "G83 Q1",
)  # fmt: skip
"""All moves that end at programmed positions: no reference point, no tool change."""
WORDS = (
    "X5", "Z1.5", "X5 Y6", "X5 R2.5", "R2.5", "I2", "I2 J0", "X5 I2", "P2", "X5 P2", "L2", "X5 L2", "Q2", "X5 Q2",
    "K2", "X5 K1", "X5 Y2 I2 J0 P2", "X5 Z1 R2.5", "X5 Z1 R2.5 L2", "X5 R2.5 P1", "X5 H1", "X5 D1", "X5 S100 T2",
)  # fmt: skip
COUNT = 1500


@pytest.mark.statistical
@pytest.mark.parametrize("family", ["any", "linuxcnc"])
def test_blocks_end_where_linuxcnc_ends(family, linuxcnc):
    """A random sample of them all; blocks that either refuses are no danger."""
    machine = load("gantry")
    machine = dataclasses.replace(machine, control=dataclasses.replace(machine.control, family=family))
    drawn = random.Random(7).sample(list(itertools.product(MOTIONS, CODES, WORDS)), COUNT)
    compared = 0
    for motion, code, words in drawn:
        text = f"{HEAD}{motion}\n{code} {words}{TAIL}"
        try:
            position = read(text, machine).machine_target[-1, [machine.index(axis) for axis in "XYZ"]]
            moves = linuxcnc.rs274_moves(text)
        except (UserError, RefusedError):
            continue
        compared += 1
        assert position == pytest.approx(moves[-1].machine[:3], abs=2e-3), text
    assert compared > 100
