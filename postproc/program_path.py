"""Path of a program in axis positions: the commanded path of the machine while an instrument records."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from kinematics.machine import Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.control.setup import Setup
from postproc.control.without_effect import refuse_without_effect, unused_set_up
from postproc.dialects import Dialect
from postproc.execution import execution
from postproc.motion.circles import sweep
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind, Known
from postproc.text.block import Refusal
from postproc.text.notes import Notes
from postproc.text.source import Source

TCP_SEGMENT_DEG = 0.1
"""Largest angle, degrees, of a segment of a circle or of a move with TCP: straight within 0.2 um at 500 mm."""
RAPID = re.compile(r"G0*0(?![0-9.])|G28|G30|FMAX", re.IGNORECASE)
FEED = re.compile(r"G0*1(?![0-9.])", re.IGNORECASE)


class ProgramPath(NamedTuple):
    """Path of `m` vertices, straight in axis positions between them."""

    positions: Array
    """Axis positions `(m, axes)`, mm and rad."""
    length: Array
    """Programmed path length `(m,)` from 0, as the feed counts it: mm; degrees if rotary axes move alone."""
    counts: np.ndarray
    """True `(m,)` where the move to the vertex is a feed move."""
    notes: tuple[str, ...]


def program_path(source: Source, dialect: Dialect, machine: Machine, setup: Setup) -> ProgramPath:
    """The path from the first position with all linear axes programmed to the last position.

    Rotary axes that the program never names are assumed at home, with a note. UserError, located, for canned cycles
    and for unknown positions of linear axes, as at a tool change.
    """
    interpreter = dialect.interpreter(machine, setup, Notes())
    positions: list[Array] = []
    lengths: list[Array] = []
    counts: list[np.ndarray] = []
    assumed = np.ones(len(machine.axes), bool)
    rapid = False
    for part in execution(source, dialect, interpreter).parts():
        motions = part.motions
        try:
            rows = _path_rows(motions, begun=bool(positions))
        except Refusal as refusal:
            raise refusal.located(source.name, dialect.evidence) from None
        if not len(rows):
            continue
        motions = motions.take(rows)
        assumed &= (motions.known == Known.ASSUMED).all(axis=0)
        feeds, rapid = _feeds(motions, rapid)
        if not positions:
            positions.append(motions.machine_target[:1])
            lengths.append(np.zeros(1))
            counts.append(np.ones(1, bool))
            motions, feeds = motions.take(np.arange(1, len(motions))), feeds[1:]
        for positions_here, lengths_here, row in _in_segments(motions):
            positions.append(positions_here)
            lengths.append(lengths_here)
            counts.append(feeds[row])
    if not positions or len(np.concatenate(lengths)) < 2:
        raise UserError(f"{source.name}: the program has no path: expected at least two positions of all linear axes")
    names = [axis.name for axis, not_programmed in zip(machine.axes, assumed, strict=True) if not_programmed]
    home = f"{source.name} gives no position of {', '.join(names)}: home is assumed" if names else ""
    refuse_without_effect(unused_set_up(interpreter.control_state))
    notes = tuple(note for note in (interpreter.control_state.assumption(), home) if note)
    return ProgramPath(np.concatenate(positions), np.cumsum(np.concatenate(lengths)), np.concatenate(counts), notes)


def _path_rows(motions: Motions, *, begun: bool) -> np.ndarray:
    """Rows of a chunk that are part of the path; Refusal for a canned cycle or an unknown linear position."""
    linear = [i for i, axis in enumerate(motions.machine.axes) if not axis.rotary]
    programmed = (motions.known[:, linear] != Known.ASSUMED).all(axis=1)
    for row in np.flatnonzero(motions.kind == Kind.CYCLE):
        raise motions.blocks[motions.block[row]].refuse(
            "a canned cycle cannot be part of a measured path: write its moves out"
        )
    first = 0 if begun else int(np.argmax(programmed)) if programmed.any() else len(programmed)
    for row in np.flatnonzero(~programmed[first:]):
        raise motions.blocks[motions.block[first + row]].refuse(
            "the position of a linear axis is unknown here: a measured path must give all linear axes throughout"
        )
    return np.arange(first, len(motions))


def _feeds(motions: Motions, rapid: bool) -> tuple[np.ndarray, bool]:
    """True `(n,)` for feed moves, and whether the last move was rapid; in machine coordinates by words of the block."""
    found = motions.kind != Kind.RAPID
    for row, (index, kind) in enumerate(zip(motions.block.tolist(), motions.kind.tolist(), strict=True)):
        if kind == Kind.MACHINE:
            text = motions.blocks[index].text
            rapid = bool(RAPID.search(text)) or (rapid and not FEED.search(text))
            found[row] = not rapid
        else:
            rapid = kind == Kind.RAPID
    return found, rapid


def _in_segments(motions: Motions) -> Iterator[tuple[Array, Array, np.ndarray]]:
    """Axis positions at the ends of all segments, their lengths as the feed counts them, and their rows, in order.

    Axis positions are straight along a segment. Consecutive moves that need no cut are returned together.
    """
    number = _segment_counts(motions)
    rows = np.arange(len(motions))
    cuts = np.flatnonzero(np.append(True, (number[1:] > 1) | (number[:-1] > 1))) if len(rows) else rows
    for group in np.split(rows, cuts[1:]):
        if not len(group):
            continue
        some, count = motions.take(group), int(number[group[0]])
        before, positions_here, lengths = some.start, [], []
        for k in range(1, count + 1):
            along = some.along(k / count)
            positions_here.append(some.in_machine(along))
            lengths.append(_length(motions, along - before))
            before = along
        yield np.concatenate(positions_here), np.concatenate(lengths), np.repeat(group, count) if count > 1 else group


def _segment_counts(motions: Motions) -> np.ndarray:
    """Number of segments `(n,)` of each move."""
    turned = np.zeros(len(motions))
    rotary = motions.machine.rotary
    turned[motions.tcp] = np.abs(motions.target - motions.start)[motions.tcp][:, rotary].max(axis=1, initial=0.0)
    for row, arc in motions.arcs.items():
        i, j, _ = arc.plane
        start, end = motions.start[row].tolist(), motions.target[row].tolist()
        angle = sweep((start[i], start[j]), (end[i], end[j]), arc.centre, arc.sense, arc.full)
        turned[row] = max(turned[row], abs(np.degrees(angle)))
    return np.maximum(np.ceil(turned / TCP_SEGMENT_DEG - 1e-9), 1).astype(int)


def _length(motions: Motions, moves: Array) -> Array:
    """Lengths `(n,)` of programmed moves `(n, axes)`, mm and degrees, as the feed counts them."""
    rotary = motions.machine.rotary
    linear, turned = (np.linalg.norm(moves[:, mask], axis=1) for mask in (~rotary, rotary))
    return np.asarray(np.where(linear > 1e-9, linear, turned))
