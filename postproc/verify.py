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
from postproc.added_blocks import Tag, begin_of, tag_of
from postproc.compensate import COLD, missed
from postproc.conditions import Conditions
from postproc.dialects import Dialect
from postproc.execution import execution
from postproc.judge import Judge, in_a_program, where
from postproc.motions import BY_ROW, COLUMNS, Motions
from postproc.moves import Kind
from postproc.notes import Notes
from postproc.pieces import like
from postproc.report import Statistic
from postproc.reversals import INNER
from postproc.setup import Setup
from postproc.source import CHUNK, Source


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
    for part in execution(source, dialect, interpreter).parts():
        chunk = _with_tags(part.motions)
        motions.append(replace(chunk, blocks=[], words=[]))  # the columns are all that is looked at
    return motions


def _with_tags(motions: Motions) -> Motions:
    """The moves of a corrected program, with those of ncomp's own known as such."""
    tags = [tag_of(block.text) for block in motions.blocks]
    if not any(tags):
        return motions
    own = np.array([tag is not None for tag in tags])[motions.block]
    takes_up = np.array([tag is Tag.TAKE_UP for tag in tags])[motions.block] & (motions.kind == Kind.LINE)
    begin = np.array([begin_of(block.text) if tag else 0.0 for block, tag in zip(motions.blocks, tags, strict=True)])
    kind = np.where(takes_up, Kind.TAKE_UP, motions.kind)
    return replace(motions, kind=kind, added=own, begin=begin[motions.block])


def verify(
    nominal: Motions, commanded: Motions, model: ErrorModel, conditions: Conditions = COLD, tolerance_um: float = 1.0
) -> Verdict:
    """Judge the moves of a corrected program against those of its original, which they must match one to one.

    Take-ups and pieces of arcs belong to the moves of the original; directions are those of each text's own moves,
    in which half of the tolerance is no reversal.
    """
    moves, model = len(nominal), model.part(in_a_program)
    matched = like(nominal, commanded)
    if matched is None:
        raise UserError("the two programs do not make the same moves: is the second one a correction of the first?")
    machine = nominal.machine
    before = Judge(model, machine, conditions, tolerance_um)
    after = Judge(model, machine, conditions, tolerance_um, written=True)
    verdict = Verdict(moves, Statistic(), Statistic(), Statistic(), Statistic(), {})
    ends: list[Array] = [np.empty((0, len(machine.axes)))]
    starts = np.flatnonzero(~matched.added)[::CHUNK]  # no move is torn apart
    for rows in np.split(np.arange(len(matched)), starts[1:]):
        _judge((matched.take(rows), commanded.take(rows)), (before, after), model, conditions, verdict)
        if before.approach is not None:
            ends.append(before.approach)
    judged = matched.judged
    approach = np.concatenate(ends)[judged] if before.axes else None
    state = conditions.state(matched.machine_target[judged], approach)
    _contributions(machine, model, state, matched.tool[judged], verdict.contributions)
    return verdict


def _judge(
    texts: tuple[Motions, Motions],
    judges: tuple[Judge, Judge],
    model: ErrorModel,
    conditions: Conditions,
    verdict: Verdict,
) -> None:
    """Some rows of both texts, at their ends and along feed moves."""
    nominal, _ = texts
    machine, tool = nominal.machine, nominal.tool
    directions = [judge.along(motions) for judge, motions in zip(judges, texts, strict=True)]
    feed = nominal.judged_ways
    places = [(share, i, feed, (verdict.path_before, verdict.path_after)) for i, share in enumerate(INNER)]
    places.append((1.0, -1, nominal.judged, (verdict.before, verdict.after)))
    for share, i, rows, statistics in places:
        wanted = nominal.in_machine(nominal.along(share))[rows]
        for motions, approach, statistic in zip(texts, directions, statistics, strict=True):
            q = motions.in_machine(motions.along(share))[rows]
            states = conditions.states(where(approach, i, rows))
            statistic.add(missed(machine, model, q, wanted, tool[rows], states).point_um)


def merged(parts: list[Motions]) -> Motions:
    """The chunks of a program as one table, without its blocks."""
    first = parts[0]
    frames = [frame for part in parts for frame in part.frames]
    starts = np.cumsum([0, *(len(part) for part in parts)])
    frame_starts = np.cumsum([0, *(len(part.frames) for part in parts)])
    stacked: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in COLUMNS if name != "frame"
    }
    frame = np.concatenate([part.frame + offset for part, offset in zip(parts, frame_starts, strict=False)])
    by_row: dict[str, Any] = {name: {} for name in BY_ROW}
    for part, start in zip(parts, starts.tolist(), strict=False):
        for name, rows in by_row.items():
            rows.update({start + row: value for row, value in getattr(part, name).items()})
    words = [word for part in parts for word in part.words]
    return Motions(first.machine, [], frames, frame=frame, words=words, **by_row, **stacked)


def _contributions(machine: Machine, model: ErrorModel, state: State, tool: Array, into: dict[str, Statistic]) -> None:
    """What each error motion does to the tool point, first order; location errors count with their error motions."""
    step = max(1, len(state) // 2000)
    state, tool = state.rows(slice(None, None, step)), tool[::step]
    if not len(state):
        return
    errors = model.errors(machine, state).reshape(len(state), -1)
    transform = place_transform(machine, state.positions, tool)[:, :3]
    for i, name in enumerate(place_names(machine)):
        if errors[:, i].any():
            into.setdefault(name, Statistic()).add(np.linalg.norm(transform[:, :, i] * errors[:, [i]], axis=1) * 1e3)
