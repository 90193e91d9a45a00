"""Verification: the tool path of a program before and after correction, by the exact model.

Works from the two texts alone, so it judges what was written and not what was meant. Block ends, and points along
straight and circular feed moves, as the control interpolates them in programmed coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from kinematics.error_transform import place_names, place_transform
from kinematics.errors import UserError
from kinematics.machine import Machine
from kinematics.model import ErrorModel
from kinematics.state import State
from kinematics.transforms import Array
from postproc.compensate import missed
from postproc.dialects import Dialect
from postproc.motions import Kind, Motions
from postproc.notes import Notes
from postproc.program import Refusal
from postproc.report import Statistic
from postproc.setup import Setup
from postproc.source import CHUNK, Source, chunks

PATH_POINTS = (0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875)
"""Where a feed move is looked at between its ends."""


@dataclass(frozen=True)
class Verdict:
    """Errors of the tool point, um, before and after; and what each error motion contributes before."""

    moves: int
    before: Statistic
    after: Statistic
    path_before: Statistic
    path_after: Statistic
    contributions: dict[str, Statistic]

    def json(self) -> dict[str, Any]:
        """The machine-readable form; every length in um."""
        return {
            "moves": self.moves,
            "block_ends_um": {"before": self.before.json(), "after": self.after.json()},
            "along_feed_moves_um": {"before": self.path_before.json(), "after": self.path_after.json()},
            "contributions_before_um": {name: statistic.json() for name, statistic in self.contributions.items()},
        }


def read_motions(source: Source, dialect: Dialect, machine: Machine, setup: Setup) -> list[Motions]:
    """All moves of a program, chunk by chunk; UserError, located, at the first block that isn't understood."""
    interpreter = dialect.interpreter(machine, setup, Notes())
    motions = []
    try:
        for lines in chunks(dialect.join_lines(source.lines()), CHUNK):
            chunk = interpreter.read([dialect.read_block(line, text) for line, text in lines])
            motions.append(replace(chunk, blocks=[], words=[]))  # the columns are all that is looked at
    except Refusal as refusal:
        raise refusal.located(source.name) from None
    return motions


def verify(nominal: Motions, commanded: Motions, model: ErrorModel) -> Verdict:
    """Judge the moves of a corrected program against those of its original, which they must match one to one."""
    if len(nominal) != len(commanded) or not np.array_equal(nominal.kind, commanded.kind):
        raise UserError("the two programs do not make the same moves: is the second one a correction of the first?")
    machine, tool = nominal.machine, nominal.tool
    judged = nominal.judged
    q, q_commanded = nominal.machine_target[judged], commanded.machine_target[judged]
    verdict = Verdict(len(nominal), Statistic(), Statistic(), Statistic(), Statistic(), {})
    verdict.before.add(missed(machine, model, q, q, tool[judged]).point_um)
    verdict.after.add(missed(machine, model, q_commanded, q, tool[judged]).point_um)
    feed = nominal.judged_start & (nominal.kind != Kind.RAPID)
    for share in PATH_POINTS:
        path, path_commanded = (m.in_machine(m.along(share))[feed] for m in (nominal, commanded))
        verdict.path_before.add(missed(machine, model, path, path, tool[feed]).point_um)
        verdict.path_after.add(missed(machine, model, path_commanded, path, tool[feed]).point_um)
    _contributions(machine, model, q, tool[judged], verdict.contributions)
    return verdict


def merged(parts: list[Motions]) -> Motions:
    """The chunks of a program as one table, without its blocks."""
    first = parts[0]
    frames = [frame for part in parts for frame in part.frames]
    starts = np.cumsum([0, *(len(part) for part in parts)])
    frame_starts = np.cumsum([0, *(len(part.frames) for part in parts)])
    stacked = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("block", "kind", "unit", "incremental", "timed", "start", "target", "known_start", "known")
    }
    frame = np.concatenate([part.frame + offset for part, offset in zip(parts, frame_starts, strict=False)])
    arcs = {
        row + int(offset): arc for part, offset in zip(parts, starts, strict=False) for row, arc in part.arcs.items()
    }
    words = [word for part in parts for word in part.words]
    return Motions(first.machine, [], frames, frame=frame, words=words, arcs=arcs, **stacked)


def _contributions(machine: Machine, model: ErrorModel, q: Array, tool: Array, into: dict[str, Statistic]) -> None:
    """What each error motion does to the tool point, first order; location errors count with their error motions."""
    step = max(1, len(q) // 2000)
    q, tool = q[::step], tool[::step]
    if not len(q):
        return
    errors = model.errors(machine, State(q)).reshape(len(q), -1)
    transform = place_transform(machine, q, tool)[:, :3]
    for i, name in enumerate(place_names(machine)):
        if errors[:, i].any():
            into.setdefault(name, Statistic()).add(np.linalg.norm(transform[:, :, i] * errors[:, [i]], axis=1) * 1e3)
