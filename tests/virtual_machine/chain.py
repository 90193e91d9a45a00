"""Machines as chains of exact homogeneous transforms, from their files.

From the workpiece to the tool every axis contributes one transform. Its six error motions are a rigid displacement
about its point - translation, then a finite rotation vector - that stands next to it: of a linear axis on the side of
the moving component, of a rotary axis on the side of the bed. Units: mm and rad.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
MACHINES = Path(__file__).parents[2] / "machines"
LETTERS = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}
TURNS_ABOUT = {"A": "X", "B": "Y", "C": "Z"}


@dataclass(frozen=True)
class Axis:
    """One axis; travel and home in mm or degrees."""

    name: str
    rotary: bool
    on_workpiece_side: bool
    direction: Array
    point: Array
    travel: tuple[float, float]
    home: float

    @property
    def turn(self) -> float:
        """Degrees after which everything repeats: 360 of a rotary axis that turns once round or on; 0 of others."""
        return 360.0 if self.rotary and self.travel[1] - self.travel[0] >= 360.0 else 0.0

    @property
    def per_file_unit(self) -> float:
        """rad per degree, or 1."""
        return float(np.pi / 180) if self.rotary else 1.0

    @property
    def own(self) -> int:
        """Which of the six error motions is its positioning error."""
        return "XYZABC".index(self.name[0])

    @property
    def frame(self) -> Array:
        """Rotation (3, 3) of the axes that its errors are counted in: the letter's direction laid on the line."""
        letter = np.array(LETTERS[TURNS_ABOUT.get(self.name[0], self.name[0])])
        line = self.direction if letter @ self.direction >= 0 else -self.direction
        halfway = np.array([1.0 + letter @ line, *np.cross(letter, line)])
        return np.asarray(from_quaternions((halfway / np.linalg.norm(halfway))[None])[0])


@dataclass(frozen=True)
class Chain:
    """A machine: its axes in order from the workpiece to the tool."""

    name: str
    axes: tuple[Axis, ...]

    @property
    def names(self) -> list[str]:
        """Names of the axes, in order."""
        return [axis.name for axis in self.axes]

    def index(self, name: str) -> int:
        """Place of an axis in the chain."""
        return self.names.index(name)

    def axis(self, name: str) -> Axis:
        """By its name."""
        return self.axes[self.index(name)]

    @property
    def linear(self) -> list[str]:
        """Names of the linear axes."""
        return [axis.name for axis in self.axes if not axis.rotary]

    def to_radians(self, positions: Array) -> Array:
        """Positions `(n, axes)` in mm and rad, of those in mm and degrees."""
        return np.asarray(positions * [axis.per_file_unit for axis in self.axes])


def load(name: str) -> Chain:
    """A machine of the folder machines/."""
    return read((MACHINES / f"{name}.toml").read_text(encoding="utf-8"))


def read(toml: str) -> Chain:
    """The machine that the text of a machine file describes."""
    text = tomllib.loads(toml)
    before, after = text["chain"].removeprefix("w").removesuffix("t").split("b")
    axes = []
    for letter in [*before.split(), *after.split()]:
        entry = text["axes"][letter]
        low, high = entry["travel"]
        along = np.array(entry.get("direction", LETTERS[TURNS_ABOUT.get(letter[0], letter[0])]), float)
        axes.append(
            Axis(
                letter,
                letter[0] in TURNS_ABOUT,
                letter in before.split(),
                along / np.linalg.norm(along),
                np.array(entry.get("point", (0.0, 0.0, 0.0)), float),
                (float(low), float(high)),
                float(entry.get("home", min(max(0.0, low), high))),
            )
        )
    return Chain(text["name"], tuple(axes))


def tool_poses(chain: Chain, q: Array, errors: Array, tool: Array) -> Array:
    """Homogeneous transforms `(n, 4, 4)` from the tool reference point to the workpiece.

    q `(n, axes)`, mm and rad. errors `(n, axes, 6)`, mm and rad: E_X E_Y E_Z E_A E_B E_C of each axis, tool relative to
    workpiece. tool `(n, 6)`: a displacement of the tool in its own directions.
    """
    pose = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for i, axis in enumerate(chain.axes):
        move = (
            _about(axis.point, _rotated(q[:, [i]] * axis.direction))
            if axis.rotary
            else _shifted(q[:, [i]] * axis.direction)
        )
        error = _about(axis.point, _rigid(errors[:, i, :3] @ axis.frame.T, errors[:, i, 3:] @ axis.frame.T))
        error_first = axis.on_workpiece_side != axis.rotary
        pose = pose @ error @ move if error_first else pose @ move @ error
    return pose @ _rigid(tool[:, :3], tool[:, 3:])


def tool_points(chain: Chain, q: Array, errors: Array, tool: Array, targets: Array) -> Array:
    """Points `(n, 3)`, mm, workpiece frame, of targets `(n, 3)` on the tool; the rest as in `tool_poses`."""
    return applied(tool_poses(chain, q, errors, tool), targets)


def bed_poses(chain: Chain, q: Array, errors: Array) -> Array:
    """Homogeneous transforms `(n, 4, 4)` from the bed to the workpiece; q and errors as in `tool_poses`."""
    sides = [i for i, axis in enumerate(chain.axes) if axis.on_workpiece_side]
    part = Chain(chain.name, tuple(chain.axes[i] for i in sides))
    return tool_poses(part, q[:, sides], errors[:, sides], np.zeros((len(q), 6)))


def nominal_points(chain: Chain, q: Array, targets: Array) -> Array:
    """The same of the machine without errors."""
    return tool_points(chain, q, np.zeros((*q.shape, 6)), np.zeros((len(q), 6)), targets)


def applied(poses: Array, points: Array) -> Array:
    """Points `(n, 3)` moved by homogeneous transforms `(n, 4, 4)`."""
    return np.asarray((poses @ np.concatenate([points, np.ones((len(points), 1))], axis=1)[:, :, None])[:, :3, 0])


def turned_about(point: Array, vectors: Array) -> Array:
    """Homogeneous transforms `(n, 4, 4)` of turns by rotation vectors `(n, 3)`, rad, about a point."""
    return _about(point, _rotated(vectors))


def rotations(vectors: Array) -> Array:
    """Rotation matrices `(n, 3, 3)` of rotation vectors `(n, 3)`, rad, by unit quaternions."""
    half = 0.5 * np.linalg.norm(vectors, axis=1, keepdims=True)
    return from_quaternions(np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * vectors], axis=1))


def from_quaternions(unit: Array) -> Array:
    """Rotation matrices `(n, 3, 3)` of unit quaternions `(n, 4)`, the real part first."""
    w, x, y, z = unit.T
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)


def _shifted(shift: Array) -> Array:
    return _rigid(shift, np.zeros_like(shift))


def _rotated(turn: Array) -> Array:
    return _rigid(np.zeros_like(turn), turn)


def _rigid(shift: Array, turn: Array) -> Array:
    """Homogeneous transforms `(n, 4, 4)`: a turn about the origin, then a shift."""
    result = np.zeros((len(shift), 4, 4))
    result[:, :3, :3], result[:, :3, 3], result[:, 3, 3] = rotations(turn), shift, 1.0
    return result


def _about(point: Array, motion: Array) -> Array:
    """The motion about a point instead of the origin."""
    there, back = _shifted(point[None]), _shifted(-point[None])
    return np.asarray(there @ motion @ back)
