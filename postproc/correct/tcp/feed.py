"""Feeds of a converted program: each feed move takes the time that it took in the original.

Under TCP, F is the speed of the tool point along its path on the workpiece; where the point stands still, degrees per
minute of the rotary axes. Without TCP, F is the speed of X Y Z on LinuxCNC and Siemens controls, and that of all axes
together on FANUC; G93 gives the time of the block on every control.
"""

from __future__ import annotations

import math

import numpy as np

from kinematics.machine import NDArrayBool
from kinematics.user_error import UserError
from postproc.correct.job import Job
from postproc.correct.rotary.feed_in_force import PER_MINUTE, Feed
from postproc.correct.tcp.path import turns
from postproc.motion.circles import SAME
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind, Paced
from postproc.siemens.codes import FEED_MODES
from postproc.text.block import Block, Edit, Word
from postproc.text.number_style import decimals_holding
from postproc.write.added_blocks import SINGLE_FEEDS, feed_index
from postproc.write.editors import Rewrite
from postproc.write.rotary_feed import RESTORED

ENDS = frozenset((2.0, 6.0, 17.0, 30.0, 99.0))
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
        if self._how == "scaled" and self._family in ("any", "grbl") and not to_tcp:
            raise UserError(FAMILY.format(cure=", or choose --tcp-feed inverse-time"))

        self._comment = job.dialect.comment
        self._changed = False
        """G93 is in force by the conversion, or F is that of a scaled move."""

    @property
    def timed(self) -> bool:
        """True for inverse time (G93)."""
        return self._how == "inverse-time"

    def of_part(self, nominal: Motions, moved: NDArrayBool, feeds: list[Feed], rewrite: Rewrite) -> dict[int, Paced]:
        """The times of the converted feed moves of a chunk, by row; lines that restore F behind them are added.

        nominal: the moves before the conversion; moved `(n,)`: those that are converted.
        """
        if not (self._changed or moved.any()):
            return {}
        cuts = np.isin(nominal.kind, (Kind.LINE, Kind.ARC)).tolist()
        turned: NDArrayBool = np.asarray((turns(nominal) > 0.0).any(axis=1))
        paced: dict[int, Paced] = {}
        rows: dict[int, list[int]] = {}
        for row, index in enumerate(nominal.block.tolist()):
            rows.setdefault(index, []).append(row)
        for index, block in enumerate(nominal.blocks):
            own, feed = rows.get(index, []), feeds[index]
            inside = [row for row in own if moved[row] and cuts[row]]
            modes = [word for word in block.words if word.address == "G" and word.value in FEED_MODES]
            for row in inside:
                found = self._paced(nominal, row, feed, turns=bool(turned[row]))
                if found is not None:
                    paced[row] = self._in_mode(found, index, modes, rewrite) if self.timed else found
                    self._changed = found.form != "programmed"
                elif _feed_word(block) or modes:
                    self._changed = False
            if not any(moved[row] for row in own) and self._relies(block, modes, moves=any(cuts[row] for row in own)):
                self._restore(index, block, feed, modes, rewrite)
        return paced

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
            return moves or bool(modes)
        silent = all(word.address in SILENT for word in block.words) and block.kind in ("words", "blank")
        return not silent or any(word.address == "M" and word.value in ENDS for word in block.words)

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
        minutes = max(self._minutes(nominal, row, feed.value, block), LEAST_MINUTES)
        form = "inverse-time" if self.timed else "all-axes" if self._all_axes else "linear"
        return Paced(minutes, feed.value, form, restored=False)

    @property
    def _all_axes(self) -> bool:
        return not self._to_tcp and self._family == "fanuc"

    def _minutes(self, nominal: Motions, row: int, feed: float, block: Block) -> float:
        """The time of a move in the original, min."""
        way, unit = (nominal.target - nominal.start)[row], float(nominal.unit[row])
        angle = float(np.linalg.norm(way[self._machine.rotary]))
        straight = float(np.linalg.norm(way[list(self._machine.translators)]))
        path = (float(nominal.path_lengths[row]) if nominal.kind[row] == Kind.ARC else straight) / unit
        if self._to_tcp and angle > SAME and path > SAME:
            if self._family in ("any", "grbl"):
                raise block.refuse(FAMILY.format(cure=""))
            path = math.hypot(path, angle) if self._family == "fanuc" else path
        return (path if path > SAME else angle) / feed


def _feed_word(block: Block) -> bool:
    return feed_index(block) is not None
