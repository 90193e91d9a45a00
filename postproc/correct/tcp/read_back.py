"""The converted program, read again: the control must go where the conversion has written."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import BinaryIO

import msgspec
import numpy as np

from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.control.setup import Setup
from postproc.correct.job import Job
from postproc.evaluation.evaluation import WrittenMoves
from postproc.execution import execution
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind
from postproc.text.notes import Notes
from postproc.text.source import ENCODING, HEAD_SIZE, Source

ANYWHERE_UM = 1e12
"""More than any coordinate: a conversion gives positions numbers of its own."""
SAME_READ_BACK = 1e-6
"""Largest difference of equal positions, mm and rad."""


def of_other_kind(setup: Setup, *, tcp_at_start: bool) -> Setup:
    """The set-up of a machine whose control positions the tool point from the start, or does not."""
    machine = setup.machine
    if machine.control.tcp_at_start == tcp_at_start:
        return setup
    control = dataclasses.replace(machine.control, tcp_at_start=tcp_at_start)
    return msgspec.structs.replace(setup, machine=dataclasses.replace(machine, control=control))


def setups_of(setup: Setup, conversions: Sequence[str]) -> tuple[Setup, Setup]:
    """The set-ups with which the control reads an original and the result of these conversions."""
    if not conversions:
        return setup, setup
    plain = of_other_kind(setup, tcp_at_start=False)
    return setup if conversions[0] == "to-axes" else plain, setup if conversions[-1] == "to-tcp" else plain


def setup_of_output(job: Job) -> Setup:
    """The set-up with which the control reads the corrected program."""
    return setups_of(job.setup, [job.tcp] if job.tcp else [])[1]


def setup_of_input(job: Job) -> Setup:
    """The set-up with which the control reads the original."""
    setup = setups_of(job.setup, [job.tcp] if job.tcp else [])[0]
    limit_um = ANYWHERE_UM if job.tcp else job.max_correction_um
    return setup if limit_um is None else msgspec.structs.replace(setup, correction_um=limit_um)


class ReadBack:
    """Keeps the written positions of a conversion, and compares those of the text with them."""

    def __init__(self, job: Job) -> None:
        self._job = job
        self._written: list[Array] = []

    def add(self, moves: WrittenMoves) -> None:
        """Keep the positions of the next written moves."""
        self._written.append(_positions(moves.motions, moves.written))

    def check(self, text: bytes, out: BinaryIO) -> None:
        """Write the text; UserError if a control would move otherwise by it than it is meant."""
        job = self._job
        name, head = f"{job.source.name} (converted)", text[:HEAD_SIZE].decode(ENCODING)
        source: Source = msgspec.structs.replace(job.source, name=name, head=head, data=text, origin=job.source.hash)
        interpreter = job.dialect.interpreter(setup_of_output(job).machine, setup_of_output(job), Notes())
        wanted = np.concatenate(self._written) if self._written else np.zeros((0, len(job.machine.axes)))
        done = 0
        for part in execution(source, job.dialect, interpreter).parts():
            motions = part.motions
            found = _positions(motions, motions.machine_target)
            meant = wanted[done : done + len(found)]
            done += len(found)
            apart = np.abs(found[: len(meant)] - meant).max(axis=1, initial=0.0)
            wrong = np.flatnonzero(apart > SAME_READ_BACK)
            if len(wrong) or len(meant) < len(found):
                row = int(wrong[0]) if len(wrong) else len(meant)
                line = int(motions.line[np.flatnonzero(motions.kind != Kind.PRESET)[row]])
                raise self._differs(line, f" by {apart[row]:.6f} mm or rad" if len(wrong) else "")
        if done != len(wanted):
            raise self._differs(0, "")
        out.write(text)

    def _differs(self, line: int, apart: str) -> UserError:
        where = f" in its line {line}" if line else ""
        return UserError(
            f"{self._job.source.name}: the converted program would not move as it is meant{where}{apart}: no output. "
            "Program all axes and the tool length (G43 H, D) before the first move under TCP"
        )


def _positions(motions: Motions, q: Array) -> Array:
    """Positions of the moves with words in the text."""
    return np.asarray(q[(motions.kind != Kind.PRESET) & (motions.kind != Kind.TAKE_UP)])
