"""Canonical calls as moves of the axes: their ends, their paths, and the other calls between them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from tests.fuzz.canon import MM_PER_INCH, MOVES, Call

Array = NDArray[np.float64]
ORDER = {"xy": (0, 1, 2), "yz": (1, 2, 0), "xz": (2, 0, 1)}
TRIM = 1.5
"""Length of a rapid, mm, that a correction may bring into a cycle or take out of it."""
FULL = 1e-6
"""Radians below which an arc is a full circle."""
PLACES = ("SET_G5X_OFFSET", "SET_G92_OFFSET", "SET_XY_ROTATION", "USE_TOOL_LENGTH_OFFSET", "SET_FEED_RATE", "COMMENT")
"""Calls that are judged by where the moves go, or by their feed; comments hold the tags of ncomp."""


@dataclass
class Frame:
    """Program coordinates to machine coordinates: p -> R (p + g92) + g5x + tool."""

    g5x: Array = field(default_factory=lambda: np.zeros(3))
    g92: Array = field(default_factory=lambda: np.zeros(3))
    tool: Array = field(default_factory=lambda: np.zeros(3))
    degrees: float = 0.0
    plane: str = "xy"

    def set(self, name: str, values: list[float]) -> None:
        """Apply the values that a call sets."""
        if name == "plane":
            self.plane = str(values)
        elif name == "rotation":
            self.degrees = values[0]
        elif name in {"g5x", "g92", "tool_length"}:
            setattr(self, name.removesuffix("_length"), np.array(values[:3]))

    @property
    def turn(self) -> Array:
        """Rotation (3, 3)."""
        cos, sin = math.cos(math.radians(self.degrees)), math.sin(math.radians(self.degrees))
        return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])

    def machine(self, points: Array) -> Array:
        """Axis positions (n, 3) of program points (n, 3)."""
        return (points + self.g92) @ self.turn.T + self.g5x + self.tool

    def program(self, q: Array) -> Array:
        """Program points of axis positions."""
        return (q - self.g5x - self.tool) @ self.turn - self.g92


@dataclass
class Move:
    """One move: axis positions along it, the length of the tool, and the other calls since the move before."""

    kind: str
    line: int
    points: Array
    """(n, 3), evenly in its length (arcs: in their angle), first and last included."""
    tool: float
    feed: float
    since: tuple[str, ...]
    number: int = 0
    """Number of the active frame: a new one after every call that sets the coordinates."""
    takes_up: bool = False
    """A block of ncomp's own that takes up backlash."""
    degrees: float = 0.0
    """Rotation of the frame, degrees."""
    at: Callable[[Array], Array] = field(default=lambda share: share, repr=False)
    """Axis positions (n, 3) at shares (n,) of the path."""

    @property
    def end(self) -> Array:
        """Axis positions at its end."""
        return self.points[-1]

    @property
    def length(self) -> float:
        """Length of its path, mm."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum())


SAMPLES = 17


def moves(
    calls: Iterable[Call], tools: Mapping[int, tuple[float, float]], samples: int = SAMPLES
) -> tuple[list[Move], tuple[str, ...]]:
    """All moves, and the calls after the last of them."""
    frame, at, found = Frame(), np.zeros(3), []
    since: list[str] = []
    feed, unit, number, spindle = 0.0, 1.0, 0, 0.0
    for call in calls:
        if call.name == "USE_LENGTH_UNITS":
            unit = MM_PER_INCH if "INCHES" in call.text else 1.0
        if call.name == "SET_FEED_RATE":
            feed = unit * float(call.text)
        if call.name == "CHANGE_TOOL":
            spindle = tools.get(int(call.text), (0.0, 0.0))[0]
        if call.name not in MOVES.values():
            if call.name not in PLACES:
                since.append(f"{call.name}({call.text})")
            continue
        for name, values in call.before:
            frame.set(name, values)
            number += name not in {"plane", "feed"}
        way = partial(_points, call, replace(frame), frame.program(at))
        points = way(np.linspace(0.0, 1.0, samples))
        at = points[-1] if call.name != "tap" else at
        found.append(
            Move(
                call.name,
                call.line,
                points,
                float(frame.tool[2]) or spindle,
                feed,
                tuple(since),
                number,
                degrees=frame.degrees,
                at=way,
            )
        )
        since = []
    return found, tuple(since)


def without_trims(moves: list[Move]) -> list[Move]:
    """Moves without the rapids of micrometres by which a cycle goes from its last R to the next."""
    kept: list[Move] = []
    since: tuple[str, ...] = ()
    for run in (list(moves) for _, moves in groupby(moves, lambda move: move.line)):
        cycle = {move.kind for move in run} > {"rapid"}
        for move in run:
            if not (cycle and move.kind == "rapid" and move.length < TRIM):
                kept.append(replace(move, since=since + move.since))
                since = ()
                continue
            since += move.since
    return kept


def _points(call: Call, frame: Frame, start: Array, shares: Array) -> Array:
    """Axis positions at shares of the path from a program point."""
    return frame.machine(_program_points(call, frame, start, shares[:, None]))


def _program_points(call: Call, frame: Frame, start: Array, share: Array) -> Array:
    if call.name != "arc":
        end = np.array(call.values[:3])
        return np.asarray(start + share * (end - start))
    i, j, k = ORDER[frame.plane]
    end_i, end_j, centre_i, centre_j, turns, end_k, *_ = call.values
    first = np.array([start[i] - centre_i, start[j] - centre_j])
    last = np.array([end_i - centre_i, end_j - centre_j])
    angle = math.atan2(last[1], last[0]) - math.atan2(first[1], first[0])
    sense = 1 if turns > 0 else -1
    angle = sense * angle % (2 * math.pi)
    angle = angle + 2 * math.pi if angle < FULL else angle
    angle += 2 * math.pi * (abs(turns) - 1)
    radius = np.hypot(*first) + share[:, 0] * (np.hypot(*last) - np.hypot(*first))
    phase = math.atan2(first[1], first[0]) + sense * angle * share[:, 0]
    points = np.empty((len(share), 3))
    points[:, i] = centre_i + radius * np.cos(phase)
    points[:, j] = centre_j + radius * np.sin(phase)
    points[:, k] = start[k] + share[:, 0] * (end_k - start[k])
    return points
