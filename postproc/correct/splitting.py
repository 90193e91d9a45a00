"""Splits long moves into segments if the path between their corrected ends would exceed the tolerance."""

from __future__ import annotations

import math
from collections.abc import Hashable, Set
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from kinematics.error_model.model import ErrorModel
from kinematics.forward import tool_point
from kinematics.inverse import linear_positions
from kinematics.machine import TURN_DEG, Machine
from kinematics.transforms import Array
from postproc.compensation.conditions import Conditions
from postproc.correct.chord_error import CorrectedPaths, Limits, beyond_limits, find_cuts
from postproc.correct.obstacles import Asked, Change, reasons
from postproc.motion.frames import Frame
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind
from postproc.motion.rotary_words import Way
from postproc.motion.segments import arc_turned, split
from postproc.text.number_style import decimals_for

BOUND_SHARE_OF_TOLERANCE = 0.01
"""Share of the tolerance below which bounds of second differences are not distinguished."""
NOT_CORRECTED = "it begins or ends outside the range of the calibration, where moves stay as programmed"
"""Reason why a path deviates that is not corrected at both ends."""
QUARTER_TURN_RAD = math.pi / 2 + 1e-9
LARGEST_ARC_RAD = math.pi - 1e-6


@dataclass
class Splitter:
    """Splits moves, chunk after chunk."""

    machine: Machine
    models: tuple[ErrorModel, ErrorModel | None]
    """Models of the tool point and, if it is corrected, of the orientation."""
    conditions: Conditions
    tolerance_um: float
    worse: bool = False
    """True if moves may become worse than in the input, so that this is no reason to split them."""

    def __post_init__(self) -> None:
        self.unsplit: dict[int, str] = {}
        """Reason why a move beyond the tolerance is not split, by block of the last chunk."""
        self.suspect: Set[int] = set()
        """Blocks of the last chunk whose moves may exceed their limits."""
        self.moves = 0
        """Number of moves that were split."""
        self.bounds: Array = np.zeros(0)
        """Upper bounds of the second differences of the error along the moves of each block of the last chunk, mm."""

    @property
    def limits(self) -> Limits:
        """Limits of the path without the rounding of its ends; at least half of the requested tolerance."""
        rounding = self.machine.rounding_mm
        required = 1e-3 * self.tolerance_um
        return Limits(max(required - 1.1 * rounding, required / 2, rounding), math.inf if self.worse else rounding)

    def prepare(self, motions: Motions, varied: frozenset[int], left: np.ndarray) -> Motions:
        """The moves of a chunk, split where necessary; `varied`: blocks that run several times with different moves.

        left: blocks that stay as programmed, and whole.
        """
        self.unsplit, self.suspect, self.bounds = {}, set(), np.full(len(motions.blocks), np.inf)
        rows = np.flatnonzero(motions.known_paths & ~motions.rotary_only & ~np.isin(motions.block, left))
        if not rows.size or not self.models[0].effects:
            return motions
        paths = CorrectedPaths(motions, self.models, self.conditions)
        bounds = np.full(len(rows), np.inf)
        lines = np.flatnonzero(motions.kind[rows] == Kind.LINE)
        least = min(BOUND_SHARE_OF_TOLERANCE * 1e-3 * self.tolerance_um, float(self.limits.of(np.zeros(1))[0]) / 2.0)
        bounds[lines] = paths.second_difference_bounds(rows[lines], least)
        self.bounds = np.full(len(motions.blocks), -np.inf)
        np.maximum.at(self.bounds, motions.block[rows], bounds)
        self.bounds[np.isinf(self.bounds)] = np.inf
        suspect = beyond_limits(paths, rows, self.limits, bounds)
        possible = suspect.tolist()
        why = dict(zip(possible, reasons(Change.SPLIT, Asked(motions, varied), possible), strict=True))
        self.unsplit = {int(motions.block[row]): reason for row, reason in why.items() if reason}
        runs = _runs_by_move(motions, [row for row, reason in why.items() if not reason])
        found = find_cuts(paths, np.array(list(runs), int), self.limits)
        steep = [row for segment in found.steep for row in runs[segment.row]]
        self.unsplit |= dict.fromkeys(_at_left(motions, left), NOT_CORRECTED)
        self.suspect = self.unsplit.keys() | set(motions.block[steep].tolist())
        cuts = {row: _quarters(motions, row, shares) for first, shares in found.shares.items() for row in runs[first]}
        self.moves += len(cuts)
        return with_round_angles(split(motions, cuts)) if cuts else motions


def _at_left(motions: Motions, left: np.ndarray) -> list[int]:
    """Blocks that stay as programmed, and those that begin where such a block ends."""
    rows = np.flatnonzero(np.isin(motions.block, left))
    return motions.block[np.union1d(rows, np.minimum(rows + 1, len(motions) - 1))].tolist() if len(rows) else []


def _runs_by_move(motions: Motions, rows: list[int]) -> dict[int, list[int]]:
    """The rows with the same move, by the first of them: the iterations of a loop are split alike."""
    frames: dict[Frame, int] = {}
    number = [frames.setdefault(frame, i) for i, frame in enumerate(motions.frames)]
    groups: dict[Hashable, list[int]] = {}
    columns = (motions.start, motions.target, motions.known_start, motions.known)
    for row in rows:
        arc = motions.arcs.get(row)
        circle = arc and arc._replace(words=(None, None), pole_block=-1)
        move = number[motions.frame[row]], circle, *(column[row].tobytes() for column in columns)
        groups.setdefault(move, []).append(row)
    return {rows[0]: rows for rows in groups.values()}


def _quarters(motions: Motions, row: int, shares: list[float]) -> list[float]:
    """The cuts of a move, with additional ones for arcs by their radius and for arcs of several turns.

    Near half a circle a radius hardly determines the centre. Segments of an arc have no number of turns.
    """
    arc = motions.arcs.get(row)
    if arc is None or not (arc.turns or arc.form.startswith("radius")):
        return shares
    turned, found = abs(arc_turned(motions, row)), [0.0, *shares, 1.0]
    longest = QUARTER_TURN_RAD if arc.form.startswith("radius") else LARGEST_ARC_RAD + 2e-6
    while True:
        middles = [(a + b) / 2 for a, b in pairwise(found) if (b - a) * turned > longest]
        if not middles:
            return found[1:-1]
        found = sorted(found + middles)


def with_round_angles(motions: Motions) -> Motions:
    """The segments with rotary positions rounded to the resolution, and with unchanged tool points.

    Otherwise the rounding of an angle would move the tool point by the angle times its distance from the axis.
    """
    machine = motions.machine
    inner = np.flatnonzero(motions.added)  # each begins at the end of the row before
    columns = np.flatnonzero(machine.rotary)
    if not columns.size or not (motions.target != motions.start)[inner][:, columns].any():
        return motions
    part = motions.bare.take(inner)
    unrounded = motions.start[inner]
    rounded = unrounded.copy()
    for i in columns.tolist():
        rounded[:, i] = np.round(unrounded[:, i], decimals_for(machine.axes[i].resolution))
        if machine.axes[i].rollover == Way.SIGNED.value:  # 0 with a minus would be the word of a whole turn backwards
            back = (motions.target < motions.start)[inner, i] & (rounded[:, i] % TURN_DEG == 0.0)
            rounded[back, i] -= machine.axes[i].resolution
    q, turned = part.in_machine(unrounded), part.in_machine(rounded)
    turned = linear_positions(machine, turned, tool_point(machine, q, part.tool), part.tool)
    result = part.in_program(turned)
    result[:, columns] = rounded[:, columns]
    start, target = motions.copies("start", "target")
    start[inner] = target[inner - 1] = result
    return replace(motions, start=start, target=target)
