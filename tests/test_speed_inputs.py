"""The programs of benchmarks/speed.py: one path in all its forms, which ncomp accepts."""

import sys
from pathlib import Path

import numpy as np
import pytest

import ncomp

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from speed_inputs import CLOTHINGS, FIVE_AXES, IN_SUBPROGRAM

MOVES = 60


def moves(name: str, folder: Path) -> np.ndarray:
    """The ends `(n, 5)` of the moves of a program, mm and degrees."""
    clothing = CLOTHINGS[name]
    path = folder / f"in{clothing.suffix}"
    clothing.write(path, MOVES)
    machine = ncomp.load_machine("dmu50")
    found = ncomp.correct(path, machine, "none", setup=ncomp.set_up(machine, zero=True)).moves
    columns = [machine.names.index(axis) for axis in "XYZBC"]
    return found.target[-MOVES:, columns]


@pytest.mark.parametrize("name", CLOTHINGS)
def test_the_path_is_the_same_in_each_form(name, tmp_path):
    found, expected = moves(name, tmp_path), moves(FIVE_AXES, tmp_path)
    if "called again" in name:
        expected = expected[(np.arange(2 * IN_SUBPROGRAM) % IN_SUBPROGRAM)[-MOVES:]]
    if name.startswith("five"):
        assert found == pytest.approx(expected, abs=1e-9)
    else:
        arcs = np.arange(1, MOVES + 1) % 10 == 0
        named = np.ones((MOVES, 3), bool) if "inch" not in name else np.abs(found[:, :3] - expected[:, :3]) < 0.002
        assert named[::50].all()
        assert named[~arcs, :2].mean() > 0.4
        linear = 2 if "holes" in name else 3
        assert np.abs(found[:, :linear] - expected[:, :linear]).max() < 1.0
