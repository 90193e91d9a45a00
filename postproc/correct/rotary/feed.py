"""Feed moves of rotary axes alone under G94: which are corrected, and how their F keeps the programmed time.

F of such a block is an angular speed, deg/min. With words for X Y Z beside the rotary ones, LinuxCNC and Siemens take F
as the speed of X Y Z alone, FANUC as that of all axes together. G93 gives the time of the block on every control.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from kinematics.machine import Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.correct.obstacles import Asked, Change, reasons
from postproc.correct.rotary.feed_in_force import FEED_IS_KNOWN, Feed, FeedsInForce
from postproc.dialects import Dialect
from postproc.evaluation.evaluation import ROTARY_ONLY
from postproc.motion.motions import Motions
from postproc.motion.moves import Paced
from postproc.text.notes import Notes

FAMILY = (
    "--rotary-feed scaled: controls differ in the meaning of F for linear and rotary axes in one block: write family = "
    '"linuxcnc" or "fanuc" under [control] of the machine file, or choose --rotary-feed inverse-time'
)


class RotaryFeeds:
    """Finds the feed moves of rotary axes alone that are corrected, chunk after chunk."""

    def __init__(self, machine: Machine, how: str, dialect: Dialect, notes: Notes) -> None:
        """`how`: as `Control.rotary_feed`; UserError for `scaled` on an unknown control."""
        self._machine, self._how, self._dialect, self._notes = machine, how, dialect.name, notes
        if how == "scaled" and dialect.name == "iso" and machine.control.family not in FEED_IS_KNOWN:
            raise UserError(FAMILY)
        self._feed = Feed()

    def prepare(self, motions: Motions, *, repeated: bool) -> Motions:
        """The moves of a chunk, with those that are corrected in `paced`; `repeated`: blocks may run several times."""
        if self._how == "leave":
            return motions
        feeds = FeedsInForce(motions.blocks, self._feed)
        klartext = self._dialect == "heidenhain"
        asked = Asked(motions, feeds=feeds, paced_form=self._form, klartext=klartext, repeated=repeated)
        rows, paced = np.flatnonzero(motions.rotary_only).tolist(), {}
        for row, reason in zip(rows, reasons(Change.PACE, asked, rows), strict=True):
            feed = feeds[int(motions.block[row])]
            if reason:
                text = f"a feed move of rotary axes only is left without a correction, because {reason}"
                self._notes.add(text, int(motions.line[row]))
                continue
            angle = float(np.linalg.norm((motions.target - motions.start)[row, self._machine.rotary]))
            assert feed.value is not None
            mode = "G93" if self._form == "inverse-time" else ""
            paced[row] = Paced(angle / feed.value, feed.value, self._form, mode)
        self._feed = feeds[-1] if feeds else self._feed
        return replace(motions, paced=paced) if paced else motions

    @property
    def _form(self) -> str:
        if self._how == "inverse-time":
            return self._how
        return "combined" if self._dialect == "iso" and self._machine.control.family == "fanuc" else "linear"


def note_rotary_only(motions: Motions, wanted: Array, ends: Array, tolerance_um: float, notes: Notes) -> None:
    """Note the feed moves of rotary axes only with a residual error that the next move corrects.

    wanted, ends `(n, axes)`: corrected and written ends, mm and degrees.
    """
    rows = np.flatnonzero(motions.rotary_only)
    behind = np.abs(ends[rows] - wanted[rows])[:, motions.machine.translators]
    for row in rows[behind.max(axis=1, initial=0.0) * 1e3 > tolerance_um].tolist():
        notes.add(ROTARY_ONLY, int(motions.line[row]))
