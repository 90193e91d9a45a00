"""A small control of its own: where the programs of `verified` and their corrections put the axes.

It shares no code with ncomp: words by regular expressions, variables and loops line by line, frames and tilted planes as
3 x 3 matrices, and linear axes from the tool point by `tests/virtual_machine`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np

Array = Any
VALUE = {
    "iso": re.compile(r"(?<![A-Z#])([XYZABC])\s*(\[[^\]]*\]|[-+]?(?:#\d+|[\d.]+))"),
    "siemens": re.compile(r"(?<![A-Z])([XYZABC])(?:=(?:AC\()?)?([-+]?(?:R\d|[\d.])[^\s)]*)"),
    "heidenhain": re.compile(r"(?<![A-Z])([XYZABC])([-+]?(?:QL?\d+|[\d.,]+))"),
}
"""A coordinate and its formula."""
ASSIGNMENT = {
    "iso": re.compile(r"(#\d+)=(.*)"),
    "siemens": re.compile(r"(R\d+)=(.*)"),
    "heidenhain": re.compile(r"(?:FN \d+: )?(QL?\d+) *= *(.*)"),
}
MOVES = re.compile(r"(?:G[01]|L) |(?:[XYZABC])[-+=\[#\d.Q]")
COMMENT = {"iso": r"\(.*", "siemens": r";.*", "heidenhain": r";.*"}
STANDS = re.compile(r"STANDS ((?:[ABC]\S+ ?)+)")
"""Comment of a program behind which the control has turned the rotary axes: CYCLE800 chooses their positions."""


def about(axis: str, degrees: float) -> Array:
    """Right-handed rotation (3, 3) about x, y or z."""
    c, s, i = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees)), "XYZ".index(axis)
    turned = np.eye(3)
    j, k = (i + 1) % 3, (i + 2) % 3
    turned[np.ix_([j, k], [j, k])] = [[c, -s], [s, c]]
    return turned


class Reckoner:
    """Runs one text; `axes_of` makes axis positions of rotary positions, degrees, a point, mm, and whether it is the tip."""

    def __init__(self, dialect: str, axes_of: Callable[[dict[str, float], Array, bool], list[float]]) -> None:
        self.dialect, self.axes_of = dialect, axes_of
        self.values: dict[str, float] = {}
        self.held: dict[str, float] = {}
        self.turn, self.shift = np.eye(3), np.zeros(3)
        self.plane = self.tcp = False
        self.poses: list[list[float]] = []
        self.passes: dict[int, int] = {}
        """Iterations of loops that run, by their line."""

    def run(self, text: str) -> list[list[float]]:
        """Axis positions, mm and rad, behind each move from the first on that knows X, Y and Z.

        nan behind a move of rotary axes alone: X, Y and Z may be those of another frame.
        """
        lines = text.split("\n")
        spoken = [re.sub(COMMENT[self.dialect], "", line).strip() for line in lines]
        at = 0
        while at < len(lines):
            stands = STANDS.search(lines[at])
            if stands is not None:
                self.held |= {word[0]: float(word[1:]) for word in stands[1].split()}
            at = self._flow(spoken, at) if self._flows(spoken[at]) else at + 1 + self._run_line(lines[at], spoken[at])
        return self.poses

    # ---- loops

    def _flows(self, line: str) -> bool:
        return line.startswith(("WHILE", "END1", "FOR ", "ENDFOR", "CALL LBL", "M30"))

    def _flow(self, lines: list[str], at: int) -> int:
        """Number of the line that runs next."""
        line = lines[at]
        if line == "M30":
            return len(lines)
        if line.startswith("WHILE"):
            condition = line[5 : line.rindex("DO1")]
            return at + 1 if self.value(condition) else lines.index("END1", at) + 1
        if line == "END1":
            return max(i for i in range(at) if lines[i].startswith("WHILE"))
        if line.startswith("FOR "):
            name, first, last = re.fullmatch(r"FOR (R\d+)=(.*) TO (.*)", line).groups()  # type: ignore[union-attr]
            self.values[name] = self.values[name] + 1 if at in self.passes else self.value(first)
            self.passes[at] = 1
            if self.values[name] <= self.value(last):
                return at + 1
            del self.passes[at]
            return lines.index("ENDFOR", at) + 1
        if line == "ENDFOR":
            return max(i for i in range(at) if lines[i].startswith("FOR "))
        label, repeats = re.fullmatch(r"CALL LBL (\d+) REP *(\d+)", line).groups()  # type: ignore[union-attr]
        left = self.passes.pop(at, int(repeats))
        if not left:
            return at + 1
        self.passes[at] = left - 1
        return lines.index(f"LBL {label}") + 1

    # ---- lines

    def _run_line(self, whole: str, line: str) -> int:
        """Run a line that is followed by the next one; 0."""
        assignment = ASSIGNMENT[self.dialect].fullmatch(line)
        if assignment is not None:
            self.values[assignment[1]] = self.value(assignment[2])
        elif line.startswith(("G43.4", "TRAORI", "M128")):
            self.tcp = True
            self._move(whole, line)
        elif not self._frame(line) and MOVES.match(line):
            self._move(whole, line)
        return 0

    def _move(self, whole: str, line: str) -> None:
        words = {axis: self.value(formula) for axis, formula in VALUE[self.dialect].findall(line)}
        if not words or "TAKE-UP" in whole:
            return
        self.held |= words
        if not set("XYZ") <= self.held.keys():
            return
        place = self.turn @ [self.held[axis] for axis in "XYZ"] + self.shift
        pose = self.axes_of(self.held, place, self.plane or self.tcp)
        pose = pose if words.keys() & set("XYZ") else [np.nan] * len(pose)
        if "NCOMP FROM" in whole:
            self.poses[-1] = pose
        else:
            self.poses.append(pose)

    def _frame(self, line: str) -> bool:
        """Take over the frame of a line, if it has one."""
        said = {axis: self.value(formula) for axis, formula in VALUE[self.dialect].findall(line)}
        numbers = dict(re.findall(r"(?<![A-Z])([IJKR]|SP[ABC])([-+]?[\d.]+)", line))
        values = {name: float(value) for name, value in numbers.items()}
        by = np.array([said.get(axis, 0.0) for axis in "XYZ"])
        if line.startswith("G68.2"):
            turn = about("Z", values["I"]) @ about("X", values["J"]) @ about("Z", values["K"])
            self._place(turn, by, plane=True)
        elif line.startswith("G68 "):
            turn = about("Z", values["R"])
            self._place(turn, by - turn @ by)
        elif line.startswith(("G52", "TRANS")):
            self._place(np.eye(3), by)
        elif line in {"G69", "CYCLE800()"}:
            self._place(np.eye(3), np.zeros(3))
        elif line.startswith("AROT Z"):
            self.turn = self.turn @ about("Z", float(line[6:]))
        elif line.startswith("CYCLE800("):
            _, _, _, _, x, y, z, a, b, c, *_ = line[9:].split(",")
            turn = about("X", float(a)) @ about("Y", float(b)) @ about("Z", float(c))
            self._place(turn, np.array([x, y, z], float), plane=True)
        elif line.startswith("CYCL DEF 7."):
            for axis, value in said.items():
                self.shift["XYZ".index(axis)] = value
        elif line.startswith("CYCL DEF 10.1"):
            self.turn = about("Z", float(line.partition("ROT")[2]))
        elif line.startswith("PLANE SPATIAL"):
            turn = about("Z", values["SPC"]) @ about("Y", values["SPB"]) @ about("X", values["SPA"])
            self._place(turn, self.shift, plane=True)
        elif line.startswith("PLANE RESET"):
            self._place(np.eye(3), self.shift)
        else:
            return line.startswith("CYCL DEF")
        return True

    def _place(self, turn: Array, shift: Array, *, plane: bool = False) -> None:
        self.turn, self.shift, self.plane = turn, np.array(shift, float), plane

    def value(self, formula: str) -> float:
        """Value of a formula with variables, brackets and comparisons of one of the three dialects."""
        known = re.sub(r"#\d+|QL?\d+|R\d+", lambda name: f"({self.values[name[0]]!r})", formula.replace(",", "."))
        python = known.replace("[", "(").replace("]", ")").replace(" LT ", "<")
        return float(eval(re.sub(r"(?<![\d.])0+(?=\d)", "", python), {"__builtins__": {}}))
