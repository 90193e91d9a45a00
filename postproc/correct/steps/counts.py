"""Counts the results of a correction for its report, part after part."""

from __future__ import annotations

import datetime

import numpy as np
from msgspec.structs import asdict, replace

from kinematics.error_model.beyond_range import beyond_range
from postproc.compensation.left_outside import LeftOutside
from postproc.compensation.predicted_error import model_notes
from postproc.compensation.used_datums import UsedDatums
from postproc.control.state import ControlState
from postproc.control.without_effect import unused_set_up
from postproc.correct.job import Job
from postproc.correct.result import CorrectionResult
from postproc.correct.rotary.feed import note_rotary_only
from postproc.correct.steps.correction import CorrectedPart, Models
from postproc.correct.travel import note_assumed
from postproc.evaluation.evaluation import Evaluated, WrittenMoves
from postproc.evaluation.predicted_errors import Statistic
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind
from postproc.text.line_numbers import ranges, shortened
from postproc.text.notes import Notes
from postproc.write.helices import FlatArcs


class Counts:
    """The results of one program so far."""

    def __init__(self, job: Job, models: Models, notes: Notes) -> None:
        """UserError if the model needs a condition of the run that is missing."""
        self._job, self._models, self._notes = job, models, notes
        self._result = _new_result(job)
        self._model_notes = model_notes(job.model, job.conditions)
        self._flat_arcs = FlatArcs()

    def read(self, name: str, sha256: str) -> None:
        """Take name and fingerprint of the program."""
        self._result.program |= {"name": name, "sha256": sha256}

    def programmed(self, motions: Motions) -> None:
        """Add the moves of a part as programmed."""
        self._result.moves += int((motions.kind != Kind.PRESET).sum())
        self._result.datums.add(motions)

    def corrected(self, part: CorrectedPart, moves: WrittenMoves, added: int, limit_um: float) -> None:
        """Add a corrected part and its written moves; `added`: number of blocks; limit_um: largest correction."""
        result, motions, ends = self._result, part.motions, moves.commanded.target
        result.split_moves = part.split
        result.max_correction_um = max(limit_um, result.max_correction_um or 0.0)
        result.added_blocks += added
        self._add_corrections(moves)
        note_assumed(motions, moves.correctable, self._notes)
        self._add_left(motions)
        if motions.evaluated.any():
            note_rotary_only(motions, part.correction.target, ends, self._job.tolerance_um, self._notes)
            self._flat_arcs.take(motions, part.wanted, ends)

    def written(self, blocks: int, changed: int) -> None:
        """Add blocks that are written, and the number of those that are changed."""
        self._result.blocks += blocks
        self._result.changed_blocks += changed

    def finish(
        self, evaluated: Evaluated, outside: LeftOutside, accepted: dict[str, str], state: ControlState
    ) -> CorrectionResult:
        """The results of the whole program.

        outside: moves that stay as programmed; accepted: implausible conditions that were met; `state` of the control
        at the end.
        """
        job, result = self._job, replace(self._result, **asdict(evaluated.errors))
        result.left_outside, result.accepted = outside.lines, accepted
        result.work_offsets, result.tools = state.used_offsets, state.used_tools
        result.assumed, result.assumption = list(state.assumed), state.assumption()
        result.unused = unused_set_up(state)
        result.datums.predict(job.machine, self._models.evaluated, job.conditions)
        result.notes = [
            *self._model_notes,
            *result.datums.notes(),
            *self._notes.texts(),
            *self._summary(result, evaluated, outside, state),
        ]
        return result

    def _add_corrections(self, moves: WrittenMoves) -> None:
        machine, result, motions = self._job.machine, self._result, moves.motions
        moved, corrected = moves.moved, moves.corrected
        result.corrected += int(((moved != 0.0) & corrected).any(axis=1).sum())
        result.not_evaluated += int((~motions.evaluated & ~motions.intermediate).sum())
        for i in machine.translators:
            result.correction.setdefault(machine.names[i], Statistic()).add(moved[corrected[:, i], i] * 1e3)
        for i in np.flatnonzero(machine.rotary).tolist() if self._models.orientation else ():
            rotated = np.deg2rad(moved[corrected[:, i], i]) * 1e6
            result.rotary_correction.setdefault(machine.names[i], Statistic()).add(rotated)

    def _add_left(self, motions: Motions) -> None:
        """Add the lines of moves that are not corrected in all axes."""
        left = motions.uncorrected
        if not left.any():
            return
        for row in np.flatnonzero(left.any(axis=1)).tolist():
            names = " ".join(self._job.machine.names[i] for i in np.flatnonzero(left[row]))
            self._result.left.setdefault(names, []).append(int(motions.line[row]))

    def _summary(
        self, result: CorrectionResult, evaluated: Evaluated, outside: LeftOutside, state: ControlState
    ) -> list[str]:
        """Notes on the whole program."""
        held = {} if outside.leaves else evaluated.outside.largest
        left = [
            f"{axes} not corrected: the program has not named the axis since a new frame, the end of radius "
            f"compensation, a move in machine coordinates or an unknown M function (lines {shortened(ranges(lines))})"
            for axes, lines in result.left.items()
        ]
        return [
            *state.left_out(),
            *state.short_tools(),
            *(each.note for each in result.unused),
            *outside.notes(),
            *beyond_range(dict(sorted(held.items()))),
            *left,
            *self._flat_arcs.notes(),
            *evaluated.notes,
            *(not_split.text(reason) for reason, not_split in result.not_split.items()),
        ]


def _new_result(job: Job) -> CorrectionResult:
    model, machine = job.model, job.machine
    age = model.age_days(datetime.datetime.now(datetime.UTC))
    calibration = {
        "id": model.id if model.effects else "none",
        "made_at": model.provenance.made_at.isoformat(),
        "age_days": round(age, 2) if model.effects else None,
        "made_by": model.provenance.made_by,
        "demonstration": model.demonstration,
    }
    return CorrectionResult(
        program={"name": job.source.name, "sha256": "", "dialect": job.dialect.name},
        machine={"name": machine.name, "chain": machine.chain},
        calibration=calibration,
        datums=UsedDatums(job.setup),
        conditions=job.conditions,
    )
