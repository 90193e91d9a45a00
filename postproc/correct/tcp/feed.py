"""Feeds of a converted program: each feed move takes the time that it took in the original.

Under TCP, F is the speed of the tool point along its path on the workpiece; where the point stands still, degrees per
minute of the rotary axes. Without TCP, F is the speed of X Y Z on LinuxCNC and Siemens controls, and that of all axes
together on FANUC; G93 gives the time of the block on every control.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kinematics.machine import NDArrayBool
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.correct.job import Job
from postproc.correct.rotary.feed_in_force import FEED_IS_KNOWN, PER_MINUTE, Feed, FeedsInForce
from postproc.correct.tcp.path import turns
from postproc.motion.circles import SAME_POINT_MM
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind, Paced
from postproc.siemens.codes import CYCLES, FEED_TYPES
from postproc.text.block import Block, Edit, Word
from postproc.text.blocks import PlainRun
from postproc.text.number_style import decimals_holding
from postproc.write.added_blocks import SINGLE_FEEDS, feed_index
from postproc.write.editors import Rewrite
from postproc.write.rotary_feed import RESTORED

ENDING_M_FUNCTIONS = frozenset((2.0, 6.0, 17.0, 30.0, 99.0))
"""M functions of the end of a program and of a tool change."""
SILENT = frozenset("NSM")
"""Addresses of words to which the feed mode does not matter."""
LEAST_MINUTES = 1e-5
"""Time of a block that moves nothing, under G93."""
FAMILY = (
    "--tcp-feed scaled: controls differ in the meaning of F for linear and rotary axes in one block: write family = "
    '"linuxcnc" or "fanuc" under [control] of the machine file{cure}'
)
KLARTEXT = "--tcp-feed inverse-time: Klartext has no G93: choose --tcp-feed scaled"


class Feeds:
    """Finds the F of converted moves, chunk after chunk."""

    def __init__(self, job: Job) -> None:
        """UserError for feeds that the control does not have."""
        klartext, to_tcp = job.dialect.name == "heidenhain", job.tcp == "to-tcp"
        self._how = job.tcp_feed or ("scaled" if klartext or to_tcp else "inverse-time")
        self._family = job.machine.control.family if job.dialect.name == "iso" else "linuxcnc"
        self._to_tcp, self._machine = to_tcp, job.machine
        if klartext and self._how == "inverse-time":
            raise UserError(KLARTEXT)
        if self._how == "scaled" and self._family not in FEED_IS_KNOWN and not to_tcp:
            raise UserError(FAMILY.format(cure=", or choose --tcp-feed inverse-time"))

        self._comment = job.dialect.comment
        self._changed = False
        """G93 is in force by the conversion, or F is that of a scaled move."""

    @property
    def timed(self) -> bool:
        """True for inverse time (G93)."""
        return self._how == "inverse-time"

    def of_part(self, nominal: Motions, moved: NDArrayBool, feeds: FeedsInForce, rewrite: Rewrite) -> dict[int, Paced]:
        """The times of the converted feed moves of a chunk, by row; lines that restore F behind them are added.

        nominal: the moves before the conversion; moved `(n,)`: those that are converted.
        """
        if not (self._changed or moved.any()):
            return {}
        cuts: NDArrayBool = np.isin(nominal.kind, (Kind.LINE, Kind.ARC))
        turned: NDArrayBool = np.asarray((turns(nominal) > 0.0).any(axis=1))
        part, blocks = _Part(nominal, moved, feeds, rewrite, cuts, turned), nominal.blocks
        paced: dict[int, Paced] = {}
        for items, first in zip(blocks.parts, blocks.firsts, strict=False):
            if isinstance(items, list):
                for index, block in enumerate(items, start=first):
                    self._of_block(part, index, block, paced)
            else:
                self._of_run(part, first, items, paced)
        return paced

    def _of_block(self, part: _Part, index: int, block: Block, paced: dict[int, Paced]) -> None:
        """Add the times of the moves of one block to `paced`."""
        nominal, rewrite, own = part.nominal, part.rewrite, part.rows(index)
        feed = part.feeds[index]
        modes = [word for word in block.words if word.address == "G" and word.value in FEED_TYPES]
        for row in (row for row in own if part.moved[row] and part.cuts[row]):
            found = self._paced(nominal, row, feed, turns=bool(part.turned[row]))
            if found is not None and (nominal.kind[own] == Kind.MACHINE).any():
                raise block.refuse(
                    "the cycle at the end of this move would run with another feed than the program's: write the "
                    "move in G0, or the cycle in a block of its own"
                )
            if found is not None:
                paced[row] = self._in_mode(found, index, modes, rewrite) if self.timed else found
                self._changed = found.form != "programmed"
            elif _feed_word(block) or modes:
                self._changed = False
        feeds_itself = bool((part.cuts | (nominal.kind == Kind.CYCLE))[own].any())
        if not part.moved[own].any() and self._relies(block, modes, moves=feeds_itself):
            self._restore(index, block, feed, modes, rewrite)

    def _of_run(self, part: _Part, first: int, run: PlainRun, paced: dict[int, Paced]) -> None:
        """Add the times of the moves of plain lines, each of which is one move, to `paced`; first: index of a block."""
        line = 0
        base = int(np.searchsorted(part.nominal.block, first))
        moved = part.moved[base : base + len(run)]
        while line < len(run):
            alike = moved[line:] == moved[line]
            behind = len(run) if alike.all() else line + int(alike.argmin())
            while line < behind and (self._changed if not moved[line] else self.timed and not self._changed):
                self._of_block(part, first + line, run.block(line), paced)
                line += 1
            if line < behind and moved[line]:
                self._of_lines(part, first + line, run.part(line, behind), paced)
            line = behind

    def _of_lines(self, part: _Part, first: int, run: PlainRun, paced: dict[int, Paced]) -> None:
        """The same for lines that are all converted; under G93, which is in force already."""
        base = int(np.searchsorted(part.nominal.block, first))
        lines = np.flatnonzero(part.cuts[base : base + len(run)])
        rows, nominal = base + lines, part.nominal
        if not len(rows):
            return
        if nominal.timed[rows[0]]:
            self._changed = self._changed and not np.isfinite(run.feeds[lines]).any()
            return
        turned, feeds = part.turned[rows], part.feeds.values[first + lines]
        minutes, wrong = self._times(nominal, rows, feeds)
        wrong |= ~(feeds > 0.0) | (part.feeds[first].mode != PER_MINUTE)
        if not self.timed:
            minutes = np.where(turned, minutes, 0.0)
        for row in rows[wrong].tolist():  # for the reason
            self._paced(nominal, row, part.feeds[int(nominal.block[row])], turns=bool(part.turned[row]))
        form = "inverse-time" if self.timed else "all-axes" if self._all_axes else "linear"
        changed = np.append(self._changed, turned[:-1])
        again = ~turned & changed & ~np.isfinite(run.feeds[lines])
        forms = np.where(turned | self.timed, form, np.where(again, "programmed", ""))
        for row, time, feed, how in zip(rows.tolist(), minutes.tolist(), feeds.tolist(), forms.tolist(), strict=True):
            if how:
                paced[row] = Paced(time, feed, how, restored=False)
        self._changed = self.timed or bool(turned[-1])

    def _in_mode(self, found: Paced, index: int, modes: list[Word], rewrite: Rewrite) -> Paced:
        """A time with the word for G93, where this is not in force yet."""
        if modes:
            rewrite.edits.setdefault(index, []).extend(Edit(word.start, word.end, "93") for word in modes)
        elif not self._changed:
            return found._replace(mode="G93")
        return found

    def _relies(self, block: Block, modes: list[Word], *, moves: bool) -> bool:
        """True for a block outside the converted moves to which F, or its mode, may matter."""
        if not self._changed:
            return False
        if not self.timed:
            return moves or bool(modes) or any(word.address in CYCLES for word in block.words)
        silent = all(word.address in SILENT for word in block.words) and block.kind in ("words", "blank")
        return not silent or any(word.address == "M" and word.value in ENDING_M_FUNCTIONS for word in block.words)

    def _restore(self, index: int, block: Block, feed: Feed, modes: list[Word], rewrite: Rewrite) -> None:
        """Restore the feed of the program before a block."""
        self._changed, own = False, _feed_word(block)
        if modes or (own and not self.timed):
            return
        number = "" if own or not feed.value else f"F{feed.value:.{decimals_holding(feed.value)}f}"
        words = " ".join(word for word in ("G94" if self.timed else "", number) if word)
        if words:
            rewrite.before.setdefault(index, []).append(f"{words} {self._comment.format(RESTORED)}")

    def _paced(self, nominal: Motions, row: int, feed: Feed, *, turns: bool) -> Paced | None:
        """The time of a feed move of the original; None for one that keeps its F.

        turns: rotary axes turn. Refusal for a move without a known feed.
        """
        block = nominal.blocks[int(nominal.block[row])]
        if nominal.timed[row]:
            return None
        if any(word.address in SINGLE_FEEDS for word in block.words):
            raise block.refuse("its feed is in force for one block only (FB, FT): write F")
        if feed.mode != PER_MINUTE or not feed.value:
            raise block.refuse("the feed of this move is not known as a speed per minute: write G94 and F before it")
        if not turns and not self.timed:
            again = self._changed and not _feed_word(block)
            return Paced(0.0, feed.value, "programmed", restored=False) if again else None
        minutes = self._minutes(nominal, row, feed.value, block)
        form = "inverse-time" if self.timed else "all-axes" if self._all_axes else "linear"
        return Paced(minutes, feed.value, form, restored=False)

    @property
    def _all_axes(self) -> bool:
        return not self._to_tcp and self._family == "fanuc"

    def _minutes(self, nominal: Motions, row: int, feed: float, block: Block) -> float:
        """The time of a move in the original, min."""
        minutes, unknown = self._times(nominal, np.array([row]), np.array([feed]))
        if unknown[0]:
            raise block.refuse(FAMILY.format(cure=""))
        return float(minutes[0])

    def _times(self, nominal: Motions, rows: np.ndarray, feeds: Array) -> tuple[Array, NDArrayBool]:
        """The times `(k,)`, min, of moves in the original, and where the meaning of F is not known."""
        way = (nominal.target - nominal.start)[rows]
        angle = np.linalg.norm(way[:, self._machine.rotary], axis=1)
        straight = np.linalg.norm(way[:, list(self._machine.translators)], axis=1)
        path = np.where(nominal.kind[rows] == Kind.ARC, nominal.path_lengths[rows], straight) / nominal.unit[rows]
        both = (angle > SAME_POINT_MM) & (path > SAME_POINT_MM) & self._to_tcp
        if self._family == "fanuc":
            path = np.where(both, np.hypot(path, angle), path)
        minutes = np.maximum(np.where(path > SAME_POINT_MM, path, angle) / feeds, LEAST_MINUTES)
        return minutes, both & (self._family not in FEED_IS_KNOWN)


class _Part(NamedTuple):
    """A chunk of moves before their conversion."""

    nominal: Motions
    moved: NDArrayBool
    """True `(n,)` for those that are converted."""
    feeds: FeedsInForce
    rewrite: Rewrite
    cuts: NDArrayBool
    """True `(n,)` for feed moves."""
    turned: NDArrayBool
    """True `(n,)` where rotary axes turn."""

    def rows(self, index: int) -> np.ndarray:
        """The rows of a block."""
        return np.arange(*np.searchsorted(self.nominal.block, [index, index + 1]))


def _feed_word(block: Block) -> bool:
    return feed_index(block) is not None
