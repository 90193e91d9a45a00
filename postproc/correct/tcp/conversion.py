"""Conversion of a program: the tool point's coordinates (TCP) into positions of the axes, or the reverse.

    Part of the input -> Motions in the other coordinates, cut into segments, and a Rewrite of what else changes

From there on the moves are corrected, checked and written as those of any program.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import msgspec
import numpy as np

from kinematics.machine import TURN_DEG, NDArrayBool
from kinematics.user_error import UserError
from postproc.control.channel import LEANS
from postproc.control.tool_table import shown_tool
from postproc.correct.job import Job
from postproc.correct.obstacles import Asked, Change, reasons, turns_unknown
from postproc.correct.rotary.feed_in_force import Feed, FeedsInForce
from postproc.correct.splitting import with_round_angles
from postproc.correct.tcp.arcs import bends, bent_arcs, straightened, write_straight
from postproc.correct.tcp.feed import Feeds
from postproc.correct.tcp.known import known_in_other
from postproc.correct.tcp.path import cuts_within, turns, with_frames
from postproc.correct.tcp.singular import note_singular
from postproc.correct.tcp.switches import SwitchedOn, spell_vector, switch_off
from postproc.execution import Part
from postproc.motion.frames import drills_along
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind, Known, Paced
from postproc.motion.segments import split
from postproc.text.block import Block, Refusal
from postproc.text.notes import Notes
from postproc.text.number_style import decimals_for
from postproc.write.added_blocks import NO_INSERTION
from postproc.write.editors import Rewrite

LINEARISATION_SHARE = 0.5
"""Share of the tolerance for the linearisation; the rest is for the correction and for rounding."""
RAPID_MM = 0.1
"""Largest deviation of a rapid from its path under TCP."""
PATHS = (Kind.RAPID, Kind.LINE, Kind.ARC)
POSITIONED = (*PATHS, Kind.CYCLE)
"""Kinds of moves that get the other coordinates."""
ONE_WAY_TURN_DEG = TURN_DEG / 2.0 - 1e-3
"""Degrees: a rotary axis that turns by less has one way only."""
STANDS_MM = 1e-7
"""An axis that moves by less stands still."""
NOTHING = {
    "to-axes": "--tcp to-axes: the program switches no TCP on (G43.4, TRAORI, M128, FUNCTION TCPM): nothing to convert",
    "to-tcp": "--tcp to-tcp: no move of the program can be one of the tool point: nothing to convert",
}
REFUSED = {
    "polars": "polar coordinates under TCP are not converted: write X Y Z",
    "cutter_compensated": "radius compensation under TCP is not converted: let the CAM system compensate the radius",
    "splines": "a spline is not converted, because its curve would be another one: write G1",
}
"""Entries of Motions by row that no conversion has, with the reason."""


class Conversion:
    """Converts the parts of one program, in their order."""

    def __init__(self, job: Job, notes: Notes) -> None:
        """UserError for feeds or coordinates that the control does not have."""
        self._job, self._machine, self._notes = job, job.machine, notes
        self._to_axes = job.tcp == "to-axes"
        family = job.machine.control.family if job.dialect.name == "iso" else ""
        if not self._to_axes and family == "linuxcnc" and not job.machine.control.tcp_at_start:
            raise UserError(
                "--tcp to-tcp: LinuxCNC has no code for TCP, its kinematics position the tool point from the start: "
                "write tcp_at_start = true under [control] of the machine file"
            )
        if not self._to_axes and family in ("grbl", "mach3"):
            raise UserError(f"--tcp to-tcp: {family} has no code for TCP: write axis positions, --tcp to-axes")
        self._feeds, self._feed = Feeds(job), Feed()
        self._switched = SwitchedOn(job.dialect, job.machine.control.tcp_at_start)
        self._turned: dict[int, tuple[float, float]] = {}
        """Positions to which the last tool vector has turned the rotary axes, by column: exact, and as written."""
        self._singular = 0
        self.moves = 0
        """Number of converted moves."""

    def converted(self, part: Part) -> tuple[Part, Rewrite]:
        """The moves of a part in the other coordinates; Refusal for one that cannot be converted."""
        rewrite = Rewrite()
        motions = part.motions
        timed = motions.timed & (motions.kind != Kind.RAPID)  # a rapid has no F under G93
        motions = replace(motions, timed=timed)
        feeds = FeedsInForce(motions.blocks, self._feed)
        self._feed = feeds[-1] if feeds else self._feed
        rows = self._rows(motions, rewrite)
        motions = self._spelled(motions, rows, rewrite)
        self._refuse(motions, rows)
        moved = rows & np.isin(motions.kind, PATHS)
        self.moves += int((rows & np.isin(motions.kind, POSITIONED)).sum())
        self._singular = note_singular(motions, np.flatnonzero(moved), self._notes, self._singular)
        paced = self._feeds.of_part(motions, moved, feeds, rewrite)
        bent = np.isin(np.arange(len(motions)), bent_arcs(motions, rows))
        for row in np.flatnonzero(bent).tolist():
            index = int(motions.block[row])
            write_straight(index, motions.blocks[index], motions.arcs[row], rewrite)
        cut = split(motions, self._cuts(motions, moved, bent, part.varied, rewrite))
        origin = np.cumsum(~cut.added) - 1
        rows = rows[origin]
        cut = with_round_angles(straightened(cut, bent[origin]))
        pieces = _timed(cut, origin, paced | _programmed_times(motions, cut, feeds))
        known, known_start = known_in_other(cut, rows)
        converted = replace(with_frames(cut, rows), known=known, known_start=known_start, paced=pieces)
        self._refuse_unknown(converted, rows)
        return msgspec.structs.replace(part, motions=converted), rewrite

    def refuse_nothing(self) -> None:
        """UserError for a program of which no move was converted."""
        if not self.moves:
            raise UserError(f"{self._job.source.name}: {NOTHING[self._job.tcp]}")

    def notes(self, tools: dict[str, str]) -> list[str]:
        """Notes on what the program depends on; tools: the lengths that it uses."""
        leans = any(axis.rotary and axis.side == "tool" for axis in self._machine.axes)
        if not self._to_axes or not leans:
            return []
        lengths = ", ".join(f"{shown_tool(tool)} {length} mm" for tool, length in tools.items()) or "0"
        return [f"the positions of the axes hold for these tool lengths only: {lengths}"]

    def _rows(self, motions: Motions, rewrite: Rewrite) -> NDArrayBool:
        """The rows that get the other coordinates; the words that switch TCP are rewritten."""
        blocks = motions.blocks
        if self._to_axes:
            for index, block in blocks.numbered:
                switch_off(self._job.dialect, index, block, rewrite)
            return np.array(motions.tcp)
        kinds: dict[int, list[Kind]] = {}
        singly = blocks.in_lists[motions.block]
        for index, kind in zip(motions.block[singly].tolist(), motions.kind[singly].tolist(), strict=True):
            kinds.setdefault(index, []).append(Kind(kind))
        known = (motions.known_start == Known.PROGRAM).all(axis=1) & (motions.known == Known.PROGRAM).all(axis=1)
        feed = known & ((motions.kind == Kind.LINE) | (motions.kind == Kind.ARC))
        if motions.tcp.any():
            raise blocks[int(motions.block[motions.tcp.argmax()])].refuse(
                "TCP is on in this move already, and --tcp to-tcp converts positions of the axes: correct the program "
                "without --tcp, or take the part under TCP out of it"
            )
        inside = self._switched.follow(blocks, kinds, np.isin(np.arange(len(blocks)), motions.block[feed]), rewrite)
        return np.asarray(inside[motions.block])

    def _spelled(self, motions: Motions, rows: NDArrayBool, rewrite: Rewrite) -> Motions:
        """Tool vectors as positions of the rotary axes, rounded as they are written."""
        rotary, blocks = np.flatnonzero(self._machine.rotary).tolist(), motions.blocks
        some = [
            row
            for row in np.flatnonzero(rows & (blocks.in_lists | blocks.no_insertion)[motions.block]).tolist()
            if row not in motions.arcs
            and (
                (index := int(motions.block[row])) in rewrite.spelled
                or spell_vector(self._job.dialect, index, blocks[index], rewrite)
            )
        ]
        if not some and not self._turned:
            return motions
        start, target, known, known_start = motions.copies("start", "target", "known", "known_start")
        vectors = set(some)
        for row in range(len(motions)):
            for axis, (exact, rounded) in self._turned.items():
                if start[row, axis] == exact:
                    start[row, axis], known_start[row, axis] = rounded, Known.PROGRAM
            if row in vectors:
                self._turned = {
                    axis: (float(target[row, axis]), self._rounded(axis, target[row, axis])) for axis in rotary
                }
            for axis, (exact, rounded) in list(self._turned.items()):
                if target[row, axis] == exact:
                    target[row, axis], known[row, axis] = rounded, Known.PROGRAM
                else:
                    del self._turned[axis]
        return replace(motions, start=start, target=target, known=known, known_start=known_start)

    def _rounded(self, axis: int, degrees: float) -> float:
        """A position of a rotary axis as it is written."""
        return round(degrees, decimals_for(self._machine.axes[axis].resolution))

    def _refuse(self, motions: Motions, rows: NDArrayBool) -> None:
        """Refusal for a move that has no form in the other coordinates."""
        turned = np.array([frame.turn is not None for frame in motions.frames], bool)[motions.frame]
        suspect = (
            turned | ~np.isin(motions.kind, (*PATHS, Kind.MACHINE)) | (turns(motions) > ONE_WAY_TURN_DEG).any(axis=1)
        )
        suspect[[row for name in REFUSED for row in getattr(motions, name)]] = True
        for row in np.flatnonzero(rows & suspect).tolist():
            block = motions.blocks[int(motions.block[row])]
            for name, reason in REFUSED.items():
                if row in getattr(motions, name):
                    raise block.refuse(reason)
            frame = motions.frames[motions.frame[row]]
            if frame.turn is not None:
                raise block.refuse(
                    "rotated, mirrored or scaled coordinates, or a tilted plane, are not converted: end them before TCP"
                )
            if motions.kind[row] not in (*POSITIONED, Kind.MACHINE):
                raise block.refuse("this block under TCP is not converted: write its moves in X Y Z")
            if row in motions.cycles:
                self._check_cycle(motions, row, block)
            if (unknown := turns_unknown(motions, row)) and motions.kind[row] != Kind.MACHINE:
                raise _direction_open(block, motions, row, unknown[0])

    def _check_cycle(self, motions: Motions, row: int, block: Block) -> None:
        """Refusal for a canned cycle that is none in the other coordinates, or that controls do not have there."""
        axis, frame = motions.cycles[row].axis, motions.frames[motions.frame[row]]
        if not self._to_axes and not self._machine.control.tcp_at_start:
            raise block.refuse("controls differ in canned cycles under G43.4: write its moves, or G49 before it")
        if not drills_along(self._machine, frame, motions.target[row].tolist(), axis):
            raise block.refuse(f"a canned cycle {LEANS.format(axis=self._machine.names[axis])}")
        if motions.incremental[row] and np.count_nonzero(motions.block == motions.block[row]) > 1:
            raise block.refuse(
                "a canned cycle that is repeated by increments (K, L) is not converted, because its increments are "
                "others in the other coordinates: write each hole in a block of its own"
            )

    def _cuts(
        self, motions: Motions, moved: NDArrayBool, bent: NDArrayBool, varied: frozenset[int], rewrite: Rewrite
    ) -> dict[int, list[float]]:
        """Where the moves are cut; Refusal for a move that cannot be. bent `(n,)`: arcs that become straight lines."""
        limit = max(LINEARISATION_SHARE * 1e-3 * self._job.tolerance_um, self._machine.rounding_mm)
        rapid = motions.kind == Kind.RAPID
        turned = bends(motions, np.flatnonzero(bent).tolist())
        cuts = cuts_within(motions, np.flatnonzero(moved & ~rapid), turned, limit)
        cuts |= cuts_within(motions, np.flatnonzero(moved & rapid), turned, max(limit, RAPID_MM))
        assumed = (motions.known_start == Known.ASSUMED).any(axis=1)
        cuts = {row: shares for row, shares in cuts.items() if not (rapid[row] and assumed[row])}
        rows = sorted(cuts)
        # a start that follows from machine coordinates or from an earlier frame is known
        known_start = np.where(assumed[:, None], motions.known_start, motions.known)
        asked = Asked(replace(straightened(motions, bent), known_start=known_start), varied)
        for row, reason in zip(rows, reasons(Change.SPLIT, asked, rows), strict=True):
            index = int(motions.block[row])
            if reason and not (reason == NO_INSERTION and index in rewrite.spelled):
                raise motions.blocks[index].refuse(
                    f"the move must be written in {len(cuts[row]) + 1} segments to stay within the tolerance, and "
                    f"{reason}"
                )
        return cuts

    def _refuse_unknown(self, motions: Motions, rows: NDArrayBool) -> None:
        """Refusal for a move of axes whose coordinates in this frame the program has not given."""
        linear = list(self._machine.translators)
        positioned = rows & np.isin(motions.kind, POSITIONED)
        partly = positioned & (motions.known[:, linear] != Known.PROGRAM).any(axis=1)
        if not partly.any():
            return
        wanted = (np.abs(motions.target - motions.start) > STANDS_MM)[:, linear]
        for row in np.flatnonzero(partly).tolist():
            named = {word.axis for word in motions.words[row]}
            wanted[row] |= [axis in named for axis in linear]
        unknown = wanted & (motions.known[:, linear] != Known.PROGRAM) & partly[:, None]
        for row in np.flatnonzero(unknown.any(axis=1)).tolist():
            names = " ".join(self._machine.names[axis] for axis, each in zip(linear, unknown[row], strict=True) if each)
            block, every = motions.blocks[int(motions.block[row])], " ".join(self._machine.names)
            if (motions.known[row, linear][unknown[row]] == Known.ASSUMED).any():
                raise block.refuse(
                    f"the conversion moves {names} in this block, and the program has not yet given the positions of "
                    f"all axes: write {every} in it, or before it with the TCP and the work offset of this block"
                )
            raise block.refuse(
                f"the conversion moves {names} in this block, and the program has given their positions only before it "
                "switched TCP on or off, with another work offset, or in machine coordinates, where the same numbers "
                f"are another place: write {every} in it, or before it with the TCP and the work offset of this block"
            )


def conversion_of(job: Job, notes: Notes) -> Conversion | None:
    """The conversion that a job asks for; UserError for its feeds without it."""
    if job.tcp_feed and not job.tcp:
        raise UserError(f"--tcp-feed {job.tcp_feed}: it states the feeds of --tcp to-axes or to-tcp: give --tcp too")
    return Conversion(job, notes) if job.tcp else None


def _timed(cut: Motions, origin: np.ndarray, paced: dict[int, Paced]) -> dict[int, Paced]:
    """The times of the segments, by row: the tool point keeps its speed, or the axes theirs, from end to end.

    origin `(n,)`: row of each segment in the moves before they were cut; paced: their times, by that row.
    """
    ends = np.where(np.append(cut.added[1:], False), np.append(cut.start_fraction[1:], 0.0), 1.0)
    shares = (ends - cut.start_fraction).tolist()
    return {
        i: paced[row] if shares[i] == 1.0 else paced[row]._replace(minutes=paced[row].minutes * shares[i])
        for i, row in enumerate(origin.tolist())
        if row in paced
    }


def _programmed_times(motions: Motions, cut: Motions, feeds: Sequence[Feed]) -> dict[int, Paced]:
    """The times of moves under a G93 of the program that are cut, by row."""
    times: dict[int, Paced] = {}
    for row in np.unique((np.cumsum(~cut.added) - 1)[cut.added]).tolist():
        if motions.timed[row] and (number := feeds[int(motions.block[row])].value):
            times[row] = Paced(1.0 / number, number, "inverse-time", restored=False)
    return times


def _direction_open(block: Block, motions: Motions, row: int, axis: int) -> Refusal:
    """Why the direction of a turn is not known, and what states it."""
    machine, target = motions.machine, float(motions.target[row, axis])
    name, (low, high) = machine.names[axis], machine.axes[axis].travel
    back = target - math.copysign(TURN_DEG, target - motions.start[row, axis])
    at = back + motions.frames[motions.frame[row]].offset[axis]
    if not low <= at <= high:
        return block.refuse(
            f"{name} turns by half a turn or more, and the shorter way would leave its travel, {low:g} to {high:g} "
            f"degrees: write travel = [-inf, inf] under [axes.{name}] in the machine file if it turns without end, or "
            f'rollover = "as-written" if it turns the long way'
        )
    return block.refuse(
        f"{name} turns by half a turn or more, and its direction depends on the control: write rollover = "
        f'"as-written" or "shortest" under [axes.{name}] in the machine file'
    )
