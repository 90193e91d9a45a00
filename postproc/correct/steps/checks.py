"""The checks of a correction: each refuses or notes what is impossible or implausible, and changes nothing."""

from __future__ import annotations

import datetime

from postproc.compensation.left_outside import LeftOutside
from postproc.control.state import ControlState
from postproc.correct.feed_moves import FeedNotes
from postproc.correct.job import Job
from postproc.correct.mark import refuse_marked
from postproc.correct.plausibility import CorrectionLimit, Plausibility
from postproc.correct.steps.correction import CorrectedPart, Models
from postproc.correct.travel import note_outside, refuse_outside
from postproc.evaluation.evaluation import Evaluated
from postproc.motion.motions import Motions
from postproc.text.notes import Notes


class Checks:
    """The checks of one program, part after part."""

    def __init__(self, job: Job, models: Models, state: ControlState, notes: Notes) -> None:
        self._job, self._model, self._state, self._notes = job, models.evaluated, state, notes
        self._plausibility = Plausibility(job.accepted)
        self._feed_notes = FeedNotes(notes)
        self._limit = CorrectionLimit(
            job.machine, models.evaluated, job.conditions, job.max_correction_um, turns=models.orientation
        )

    @property
    def accepted(self) -> dict[str, str]:
        """Implausible conditions that were met and are accepted, as of `Plausibility`."""
        return self._plausibility.met

    def calibration(self) -> None:
        """Check the age and the temperatures of the calibration; UserError if they are not accepted."""
        if self._model.effects:
            self._plausibility.check_calibration(
                self._job.model, self._job.conditions, datetime.datetime.now(datetime.UTC)
            )

    def programmed(self, motions: Motions) -> None:
        """Check the moves of a part as programmed; Refusal for the travel, and for a program that is corrected."""
        self._feed_notes.take(motions)
        if self._job.travel_check:
            refuse_outside(motions, motions.machine_target, "as programmed", self._state)
        if self._model.effects:
            refuse_marked(motions.blocks.read_singly, self._job.dialect, self._notes, force=self._job.force)

    def corrected(self, part: CorrectedPart) -> float:
        """Check a corrected part; Refusal for a correction that is too large, and for the travel.

        Returns the largest correction, um, that is not refused.
        """
        motions, corrected = part.motions, part.correction.corrected
        limit = self._limit.check(motions, part.correction.nominal, corrected)
        if self._job.travel_check:
            refuse_outside(motions, corrected, "after correction", self._state)
        else:
            note_outside(motions, corrected, self._notes)
        return limit

    def whole(self, evaluated: Evaluated, outside: LeftOutside) -> None:
        """Check the evaluation of all moves; UserError for conditions that are not accepted.

        outside: moves that stay as programmed.
        """
        if evaluated.worse:
            self._plausibility.meet("worse", evaluated.worse)
        if not outside.leaves:
            self._plausibility.check_outside(evaluated.outside)
        if not self._job.model.demonstration:  # its uncertainty does not belong to a real machine
            self._plausibility.check_significance(evaluated.errors.significance)
