"""ncomp's own reading of a program, against the moves that LinuxCNC makes of it."""

from __future__ import annotations

import re
from itertools import pairwise

import numpy as np

import machines
from postproc.control.setup import make_setup
from postproc.dialects import find_dialect
from postproc.execution import execution
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind, Known
from postproc.text.notes import Notes
from postproc.text.source import HEAD_SIZE, Source
from tests.fuzz.case import Case
from tests.fuzz.groups import UNCORRECTED, code_of, split_lines
from tests.fuzz.path import Array, Move

MOVING = frozenset((Kind.RAPID, Kind.LINE, Kind.ARC))
KINDS = {"rapid": Kind.RAPID, "line": Kind.LINE, "arc": Kind.ARC}
SAME = 1e-6
"""Largest difference of two readers, mm."""
Row = tuple[int, Kind, Array]
"""Line, kind, and end in machine coordinates; nan for an axis that nobody has placed."""


def fault(case: Case, moves: list[Move]) -> str:
    """The first move that ncomp reads differently from LinuxCNC, empty for none; contours are left out."""
    codes = [code_of(line) for line in split_lines(case.program)]
    if any(re.search(r"G4[12](?!\d)", code) for code in codes):
        return ""
    parts = _read(case)
    drilled = {motions.blocks[motions.block[row]].line for motions in parts for row in _rows(motions, Kind.CYCLE)}
    silent = {
        i for i, code in enumerate(codes, 1) if UNCORRECTED.search(code) or not re.search(r"[XYZIJKR@^]", code)
    } | drilled
    ours = [row for motions in parts for row in _ends(motions) if row[0] not in silent]
    theirs = [(move.line, KINDS[move.kind], move.end) for move in moves if move.line not in silent]
    for (line, kind, end), (their_line, their_kind, their_end) in zip(ours, theirs, strict=False):
        if (line, kind) != (their_line, their_kind):
            return f"order of moves: ncomp reads line {line} ({kind!r}), LinuxCNC line {their_line} ({their_kind!r})"
        if (np.abs(end - their_end) > SAME).any():
            return f"position: line {line} ends at {np.round(end, 6)}, LinuxCNC: {np.round(their_end, 6)}"
    return "" if len(ours) == len(theirs) else f"number of moves: ncomp reads {len(ours)}, LinuxCNC {len(theirs)}"


def _read(case: Case) -> list[Motions]:
    machine = machines.parse(case.machine, "fuzz.toml")
    options = list(pairwise(case.options))
    offsets = [value for option, value in options if option == "--work-offset"]
    tools = [value for option, value in options if option == "--tool-length"]
    data = case.program.encode("latin-1")
    dialect = find_dialect("iso", case.name, "")
    interpreter = dialect.interpreter(machine, make_setup(machine, offsets, tools), Notes())
    source = Source(case.name, data[:HEAD_SIZE].decode("latin-1"), data)
    return [part.motions for part in execution(source, dialect, interpreter).parts()]


def _rows(motions: Motions, *kinds: Kind) -> list[int]:
    rows: list[int] = np.flatnonzero(np.isin(motions.kind, kinds)).tolist()
    return rows


def _ends(motions: Motions) -> list[Row]:
    return [
        (motions.blocks[motions.block[i]].line, Kind(motions.kind[i]), _end(motions, i))
        for i in _rows(motions, *MOVING)
    ]


def _end(motions: Motions, row: int) -> Array:
    """In rotated coordinates an axis gets its position from every coordinate that moves it."""
    shares = motions.frames[motions.frame[row]].shares
    assumed = (shares & (motions.known[row] == Known.ASSUMED)).any(axis=1)
    return np.where(assumed, np.nan, motions.machine_target[row])
