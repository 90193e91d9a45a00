"""A part is touched off and cut on the virtual machine, from the text of its program, and measured from its datum.

Programs of the ISO kind: G0, G1, and G2 and G3 in XY with I and J; absolute, in mm, one work offset, one tool with its
length offset, no TCP. The control runs straight in axis positions and round the circles.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from virtual_machine.chain import Array, Chain, nominal_points, tool_points

Errors = Callable[[Chain, Array], Array]
"""Error motions `(n, axes, 6)`, mm and rad, at positions `(n, axes)`, mm and degrees."""
_WORD = re.compile(r"([A-Z])\s*([-+]?[\d.]+)")
_PIECE = re.compile(r"\(NCOMP FROM (\d+)/(\d+)\)")
SHARES = np.linspace(0.0, 1.0, 33)[1:]


@dataclass
class Move:
    """One move of the program, in pieces: shares at which they begin, and positions by share of each."""

    rapid: bool
    placed: bool
    """The program has named X, Y and Z since the last tool change."""
    begins: list[float]
    pieces: list[Callable[[float], dict[str, float]]]

    def at(self, share: float) -> dict[str, float]:
        """Programmed positions by axis."""
        k = max(i for i, begin in enumerate(self.begins) if begin < share or i == 0)
        end = self.begins[k + 1] if k + 1 < len(self.begins) else 1.0
        return self.pieces[k]((share - self.begins[k]) / (end - self.begins[k]))


def moves(text: str, axes: list[str]) -> list[Move]:
    """The moves of a program, from programmed zero; pieces belong to the move that they are part of."""
    found: list[Move] = []
    here, motion, named = dict.fromkeys(axes, 0.0), 0, set[str]()
    for line in text.splitlines():
        piece = _PIECE.search(line)
        words = _WORD.findall(re.sub(r"\(.*?\)", "", line))
        codes = [float(value) for letter, value in words if letter == "G"]
        motion = next((int(code) for code in codes if code in (0, 1, 2, 3)), motion)
        if ("M", "6") in words:
            named.clear()
        there = {letter: float(value) for letter, value in words if letter in here}
        if not there:
            continue
        centre = {letter: float(value) for letter, value in words if letter in "IJ"}
        way = _way(dict(here), {**here, **there}, motion, centre)
        if piece:
            found[-1].begins.append(int(piece[1]) / int(piece[2]))
            found[-1].pieces.append(way)
        else:
            named.update(there)
            found.append(Move(motion == 0, named >= set("XYZ"), [0.0], [way]))
        here.update(there)
    return found


def _way(
    start: dict[str, float], end: dict[str, float], motion: int, centre: dict[str, float]
) -> Callable[[float], dict[str, float]]:
    def straight(share: float) -> dict[str, float]:
        return {axis: start[axis] + share * (end[axis] - start[axis]) for axis in start}

    if motion < 2:
        return straight
    x, y = start["X"] + centre.get("I", 0.0), start["Y"] + centre.get("J", 0.0)
    first, last = (math.atan2(at["Y"] - y, at["X"] - x) for at in (start, end))
    near, far = (math.dist((at["X"], at["Y"]), (x, y)) for at in (start, end))
    sense = 1.0 if motion == 3 else -1.0
    turned = sense * (sense * (last - first) % (2 * math.pi) or 2 * math.pi)

    def round_the_circle(share: float) -> dict[str, float]:
        angle, radius = first + share * turned, near + share * (far - near)
        return straight(share) | {"X": x + radius * math.cos(angle), "Y": y + radius * math.sin(angle)}

    return round_the_circle


@dataclass(frozen=True)
class TouchedOff:
    """A datum that was touched off."""

    offset: dict[str, float]
    """X Y Z that the control has stored, mm."""
    datum: Array
    """True position `(3,)`, mm, workpiece frame."""
    believed: Array
    """Position `(3,)` at which a machine without errors would have found it, mm."""


@dataclass(frozen=True)
class Shop:
    """A machine with its errors and one tool."""

    chain: Chain
    errors: Errors
    length: float
    """Length of the tool, mm."""

    def actual(self, positions: Array, length: float) -> Array:
        """True positions of the tip of a tool `(n, 3)`, mm, workpiece frame; positions `(n, axes)`, mm and degrees."""
        q, tips = self.chain.to_radians(positions), _tips(len(positions), length)
        return tool_points(self.chain, q, self.errors(self.chain, positions), np.zeros((len(q), 6)), tips)

    def nominal(self, positions: Array, length: float) -> Array:
        """Nominal positions of the tip `(n, 3)`, mm."""
        return nominal_points(self.chain, self.chain.to_radians(positions), _tips(len(positions), length))

    def touched_off(self, place: dict[str, float], probe: float, **rotary: float) -> TouchedOff:
        """The probe's tip is driven until it is exactly at a datum, with the rotary axes at positions in degrees.

        The datum is the point of the workpiece where a machine without errors would find it by the work offset `place`.
        """
        names, linear = self.chain.names, [self.chain.index(axis) for axis in "XYZ"]
        ideal = np.array([[{**place, **rotary}.get(name, 0.0) for name in names]])
        ideal[0, linear[2]] += probe
        datum, found = self.nominal(ideal, probe), ideal.copy()
        directions = np.stack([(self.nominal(_step(ideal, i), probe) - datum)[0] for i in linear], axis=1)
        for _ in range(20):
            found[0, linear] -= np.linalg.solve(directions, (self.actual(found, probe) - datum)[0])
        read = found[0, linear] - [0.0, 0.0, probe]
        offset = {axis: round(value, 6) for axis, value in zip("XYZ", read.tolist(), strict=True)}
        return TouchedOff(offset, datum[0], self.nominal(found, probe)[0])

    def cut(
        self, program: str, nominal: str, touched: TouchedOff, wanted: dict[str, float] | None = None
    ) -> tuple[Array, Array]:
        """Errors of the part from its datum, um: at block ends `(n,)`, and along feed moves at SHARES `(m, 32)`.

        `program` is run with the work offset on this machine. The `nominal` program defines the nominal part: its
        points as seen from the datum that the control believes in, put to the datum that the probe has touched. `wanted` is
        the work offset of this belief, where another one has been entered since.
        """
        pairs = list(zip(moves(program, self.chain.names), moves(nominal, self.chain.names), strict=True))
        pairs = [(run, should) for run, should in pairs if should.placed]
        commanded, ideal = (
            self._axes([move.at(share) for move in text for share in SHARES], zero)
            for text, zero in zip(zip(*pairs, strict=True), (touched.offset, wanted or touched.offset), strict=True)
        )
        part = self.nominal(ideal, self.length) - touched.believed
        apart = self.actual(commanded, self.length) - touched.datum - part
        sizes = np.linalg.norm(apart, axis=1).reshape(-1, len(SHARES)) * 1e3
        return sizes[:, -1], sizes[[not should.rapid for _, should in pairs]]

    def _axes(self, programmed: list[dict[str, float]], offset: dict[str, float]) -> Array:
        """Axis positions `(n, axes)`, mm and degrees: programmed plus offset, plus the tool's length along Z."""
        added = {**offset, "Z": offset["Z"] + self.length}
        return np.array([[at[name] + added.get(name, 0.0) for name in self.chain.names] for at in programmed])


def _tips(count: int, length: float) -> Array:
    return np.tile([0.0, 0.0, -length], (count, 1))


def _step(positions: Array, axis: int) -> Array:
    moved = positions.copy()
    moved[0, axis] += 1.0
    return moved
