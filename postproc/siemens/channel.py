"""The channel of a Siemens 840D control: what its words do to modes and axes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import ClassVar

from postproc.control import channel
from postproc.control.channel import AxisWords
from postproc.control.codes import HARMLESS_M, MOTION, PLANES, PROBE_BESIDE
from postproc.siemens.codes import END_OF_SUBPROGRAM, FEED_TYPES, MEASURING, UNITS
from postproc.siemens.modal_state import ModalState
from postproc.siemens.polar import Polar
from postproc.siemens.variables import SiemensVariables
from postproc.siemens.words import OF_CONTROL
from postproc.text.block import Block


@dataclass
class Channel(channel.Channel):
    """The operations that the parts of the dialect share."""

    modal: ModalState
    scope: SiemensVariables

    harmless_m: ClassVar[frozenset[float]] = HARMLESS_M | {END_OF_SUBPROGRAM, *map(float, range(40, 46))}
    units: ClassVar[Mapping[float, float]] = UNITS
    feed_modes: ClassVar[frozenset[float]] = FEED_TYPES
    with_own_variables = OF_CONTROL

    def accept(self, block: Block, name: str, reason: str, *, moves: bool = False) -> None:
        """Pass a name that is not known: a measuring cycle by --probing, others by --pass-through."""
        if MEASURING.fullmatch(name) is not None:
            if self.setup.probing and not moves and not block.skippable:
                self.probe(block, name)
                return
            reason = f"{name} is not known to ncomp, and the end of a probing cycle is not known: {PROBE_BESIDE}"
        super().accept(block, name, reason, moves=moves)

    def take_mode(self, block: Block, code: float) -> bool:
        """Take over a modal G code; another plane has no polar coordinates yet, a motion ends a spline."""
        if code in MOTION:
            self.modal.spline = ""
        if code in PLANES:
            self.modal.polar = Polar()
        return super().take_mode(block, code)

    def axis_words(self, block: Block, indices: Iterable[int]) -> AxisWords:
        """The axis words of a block with their values; Refusal for a mode that the axis does not have."""
        words = super().axis_words(block, indices)
        for axis, i, _ in (word for word, _ in words):
            mode, rotary = block.words[i].mode, self.rotary[axis]
            if mode in ("DC", "ACP", "ACN") and not rotary:
                raise block.refuse(f"{mode} needs a rotary axis: write AC or IC")
            if rotary and self.modal.tilted and not self.modal.tcp:
                raise block.refuse(
                    "a rotary axis moves in a tilted plane of CYCLE800: end the plane by CYCLE800() before it"
                )
        return words
