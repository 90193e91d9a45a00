"""Assignment of the moves of a correction to the moves of the program; axes that the program has positioned so far."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from tests.fuzz.path import Array, Move, without_trims

PART = re.compile(r"NCOMP FROM (\d+)/(\d+)")
ABSOLUTE = {"90": True, "91": False}
CYCLES = dict.fromkeys(("73", "74", "76", *map(str, range(81, 90))), True) | dict.fromkeys(
    ("0", "1", "2", "3", "80"), False
)
KNOWN_M = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 19, 30, 48, 49}
UNCORRECTED = re.compile(r"G0*(28|30|53)(?![\d.])")
OUTPUTS = re.compile("AUX_OUTPUT|MOTION_OUTPUT")
"""Calls of M functions that ncomp does not know: they may move something."""

STILL = 1e-6
"""Length of a move, mm, below which it stands still."""

Moves = tuple[list[Move], tuple[str, ...]]
"""All moves, and the other calls behind the last one."""


@dataclass
class Group:
    """A move of the program and the moves that the correction makes of it."""

    programmed: Move
    written: list[Move]
    shares: list[float]
    """Shares of the programmed move at which the written ones begin; nan where they do not contain it."""
    taken: list[Move] = field(default_factory=list)
    """Moves before it that take up backlash; those within it are among the written ones."""


class DisorderError(Exception):
    """The moves of the correction are not those of the program."""


def split_lines(text: str) -> list[str]:
    """Lines as LinuxCNC counts them."""
    return re.split(r"\r\n|\r|\n", text)


def grouped(before: Moves, after: Moves, text: str) -> list[Group]:
    """Moves of the correction, whose text is given, under those of the program; DisorderError names a difference."""
    groups = list(_groups(without_trims(before[0]), without_trims(after[0]), split_lines(text)))
    for group in groups:
        programmed, written = group.programmed, group.written
        if {programmed.kind} != {move.kind for move in written if not move.takes_up}:
            raise DisorderError(f"kind of move: line {programmed.line} of the program")
        first = sum((move.since for move in (*group.taken, written[0])), ())
        if programmed.since != first or any(move.since for move in written[1:]):
            raise DisorderError(f"other calls: before line {programmed.line}: {programmed.since} {first}")
    if before[1] != after[1]:
        raise DisorderError(f"other calls at the end: {before[1]} {after[1]}")
    return groups


def _groups(before: list[Move], after: list[Move], lines: list[str]) -> Iterator[Group]:
    programmed = iter(before)
    group: Group | None = None
    taken: list[Move] = []
    for move in after:
        line = lines[move.line - 1]
        if "NCOMP TAKE-UP" in line:
            move.takes_up = True
            taken.append(move)
            continue
        own = PART.search(line)
        if group is not None and (own or "NCOMP ARC" in line):
            group.written += [*taken, move]
            group.shares += [float("nan")] * len(taken) + [int(own[1]) / int(own[2]) if own else float("nan")]
            taken = []
            continue
        if group is not None:
            yield group
        wanted = next(programmed, None)
        if wanted is None:
            raise DisorderError(f"extra move: line {move.line} of the correction")
        group, taken = Group(wanted, [move], [0.0], taken), []
    if group is not None:
        yield group
    left = next(programmed, None)
    if left is not None:
        raise DisorderError(f"missing move: line {left.line} of the program")


class Placed:
    """Axes with a known position, move after move, since the last change of the frame."""

    def __init__(self, text: str, groups: list[Group]) -> None:
        self.codes = [code_of(line) for line in split_lines(text)]
        self._absolute = _modal(self.codes, ABSOLUTE, True)
        self._cycles = _modal(self.codes, CYCLES, False)
        self.groups = groups
        self.said: set[str] = set()
        self.changed = False
        """The frame is new, or may be, since the move before."""

    def follow(self, i: int) -> set[str]:
        """Axes with a known position after move `i`, called in order; none after a move to machine coordinates."""
        move = self.groups[i].programmed
        code = self.codes[move.line - 1]
        self.changed = bool(
            (i and move.number != self.groups[i - 1].programmed.number)
            or any(float(number) not in KNOWN_M for number in re.findall(r"M([\d.]+)", code))
            or any(OUTPUTS.search(call) for call in move.since)
        )
        if self.changed or UNCORRECTED.search(code):
            self.said.clear()
        if UNCORRECTED.search(code):
            return set()
        if self._absolute[move.line - 1]:
            self.said |= set(re.findall("[XYZ]", code)) | (set("XY") if "@" in code or "^" in code else set())
        if move.degrees and not self.said >= set("XY"):
            return self.said - set("XY")
        return set(self.said)

    def code(self, i: int) -> str:
        """Words of the block of move `i`."""
        return self.codes[self.groups[i].programmed.line - 1]

    def in_cycle(self, i: int) -> bool:
        """True for one of several moves of a block that a cycle makes, and for one behind them that stands still.

        LinuxCNC calls the rapid of a G0 alone, which leaves the tool where the cycle has left it.
        """
        line = self.groups[i].programmed.line
        if i and self.groups[i].programmed.length < STILL and self.groups[i - 1].programmed.line != line:
            return self.in_cycle(i - 1)
        same = [g.programmed.kind for g in (*self._run(i, -1, line), *self._run(i, 1, line))]
        return self._cycles[line - 1] or (bool(same) and "rapid" in {*same, self.groups[i].programmed.kind})

    def _run(self, i: int, step: int, line: int) -> Iterator[Group]:
        i += step
        while 0 <= i < len(self.groups) and self.groups[i].programmed.line == line:
            yield self.groups[i]
            i += step


def _modal(codes: list[str], words: Mapping[str, bool], state: bool) -> list[bool]:
    """A state on each line: G words in the order of the text, which no branch of a program changes."""
    found = []
    for code in codes:
        for number in re.findall(r"G0*([\d.]+)", code):
            state = words.get(number, state)
        found.append(state)
    return found


def code_of(line: str) -> str:
    """Words of a line, without comments, names, formulas and functions."""
    text = re.sub(r"\([^)]*\)|;.*|<[^>]*>", "", line).upper()
    while re.search(r"\[[^\[\]]*\]", text):
        text = re.sub(r"[A-Z]{2,}\[[^\[\]]*\]|\[[^\[\]]*\]", "", text)
    return re.sub(r"#\s*[\d.]*\s*=[^A-Z#]*", "", re.sub(r"\s", "", text))


def tip(move: Move) -> Array:
    """Tool points (n, 3) along a move of a machine without errors."""
    return np.asarray(move.points - [0.0, 0.0, move.tool])
