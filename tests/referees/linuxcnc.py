"""Moves of a program by LinuxCNC's interpreter (2.9, `rs274` and the module `gcode`), with files that it calls."""

from __future__ import annotations

import math
from collections.abc import Mapping

from tests.fuzz.canon import MOVES, Call, ClientError, Environment, RefusedError, calls
from tests.referees.moves import PLANES, Move, Point, Unclear, arc_middle

NAMES = {"xy": "XY", "yz": "YZ", "xz": "ZX"}


def run(
    texts: Mapping[str, str], offsets: Mapping[str, Point], lengths: Mapping[int, float], rotary: str
) -> list[Move]:
    """All moves; the main program is the first text. Cycles come out as rapids and lines."""
    work = {name: [offset[axis] for axis in "XYZ"] for name, offset in offsets.items()}
    main, *others = texts.items()
    environment = Environment(work, {number: (length, 0.0) for number, length in lengths.items()}, dict(others))
    try:
        found = calls(main[1], environment)
    except (RefusedError, ClientError) as fault:
        raise Unclear(str(fault)) from None
    return _Reader("XYZ" + rotary).moves(found)


class _Reader:
    """What the calls set, and the moves between them."""

    def __init__(self, axes: str) -> None:
        self.axes = axes
        self.frame: dict[str, list[float]] = {name: [0.0] * 6 for name in ("g5x", "g92", "tool_length", "feed")}
        self.plane = "XY"
        self.at: Point = dict.fromkeys("XYZABC", 0.0)
        self.inverse = self.part = False

    def moves(self, found: list[Call]) -> list[Move]:
        """The moves; the comment of a block stands before its move."""
        moves = []
        for call in found:
            if call.name == "COMMENT":
                self._comment(call.text)
            elif call.name in MOVES.values():
                for name, value in call.before:
                    self._set(name, value)
                moves.append(self._move(call))
                self.part = False
        return moves

    def _comment(self, text: str) -> None:
        if "feed mode set to" in text:
            self.inverse = "inverse" in text
        self.part = self.part or "NCOMP FROM" in text or "NCOMP ARC" in text

    def _set(self, name: str, value: object) -> None:
        if name == "plane":
            self.plane = NAMES[str(value)]
        elif name == "rotation":
            if any(map(float, value)):  # type: ignore[call-overload]
                raise Unclear("a rotation")
        else:
            self.frame[name] = [float(each) for each in value]  # type: ignore[attr-defined]

    def _placed(self, values: list[float]) -> Point:
        """With the offsets added; the length of the tool is none of them."""
        shifts = zip(values, self.frame["g5x"], self.frame["g92"], strict=True)
        return dict(zip("XYZABC", map(sum, shifts), strict=True))

    def _move(self, call: Call) -> Move:
        start, middle, whole = self.at, dict[str, float](), False
        if call.name == "arc":
            first, second, normal = PLANES[self.plane]
            u, v, centre_u, centre_v, turns, w, *rotary = call.values
            self.at = self._placed(_in_order({first: u, second: v, normal: w}, rotary))
            centre = self._placed(_in_order({first: centre_u, second: centre_v, normal: w}, rotary))
            middle = arc_middle(start, self.at, centre, self.plane, turns > 0, int(abs(turns)) - 1)
            whole = math.dist(*([p[first], p[second]] for p in (start, self.at))) < 1e-7
        elif call.name in {"rapid", "line"}:
            self.at = self._placed(list(call.values[:6]))
        else:
            raise Unclear(call.name)
        end = {axis: self.at[axis] for axis in self.axes}
        feed = ("", 0.0) if call.name == "rapid" else self._feed(start)
        return Move(call.name, end, self.frame["tool_length"][2], feed=feed, middle=middle, continues=self.part,
                    whole_turn=whole)  # fmt: skip

    def _feed(self, start: Point) -> tuple[str, float]:
        """The word of the feed; under G93 LinuxCNC gives a speed, of the linear axes where they move."""
        speed = self.frame["feed"][0]
        if not self.inverse:
            return "minute", speed
        ways = (math.dist(*([p[axis] for axis in axes] for p in (start, self.at))) for axes in ("XYZ", "ABC"))
        return "inverse", speed / next((way for way in ways if way > 1e-9), 1.0)


def _in_order(lengths: Point, rotary: list[float]) -> list[float]:
    return [*(lengths[axis] for axis in "XYZ"), *rotary]
