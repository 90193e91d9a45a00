"""The checks of a correction: each refuses or notes what is impossible or implausible, and changes nothing."""

from __future__ import annotations

import datetime

from kinematics.user_error import UserError
from postproc.compensation.left_outside import LeftOutside
from postproc.compensation.surface import beyond_surface, follows_surface, place_not_given
from postproc.control.state import ControlState
from postproc.correct.feed_moves import FeedNotes
from postproc.correct.job import Job
from postproc.correct.mark import refuse_marked
from postproc.correct.plausibility import CorrectionLimit, Plausibility
from postproc.correct.steps.correction import CorrectedPart, Models
from postproc.correct.travel import note_outside, refuse_outside
from postproc.evaluation.evaluation import Evaluated
from postproc.motion.motions import Motions
from postproc.text.line_numbers import shown
from postproc.text.notes import Notes


class Checks:
    """The checks of one program, part after part."""

    def __init__(self, job: Job, models: Models, state: ControlState, notes: Notes) -> None:
        self._job, self._model, self._state, self._notes = job, models.evaluated, state, notes
        self._plausibility = Plausibility(job.accepted)
        self._feed_notes = FeedNotes(notes)
        self._follows_map = False
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
            self._refuse_off_surface(motions)
            refuse_marked(motions.blocks.read_singly, self._job.dialect, self._notes, force=self._job.force)

    def _refuse_off_surface(self, motions: Motions) -> None:
        """Refusal for a feed move beyond a height map, unless that is accepted, or at a place that is not known."""
        self._follows_map |= bool(follows_surface(motions).any())
        unknown = place_not_given(motions, self._model)
        if unknown is not None:
            raise motions.blocks[unknown[0]].refuse(
                f"the program has not given {unknown[1]}, so that the place on the height map is not known: write a "
                "rapid move to it before this block, or state --start"
            )
        found = beyond_surface(motions, self._model)
        if found is None:
            return
        block, text = motions.blocks[found[0]], found[1]
        if "outside" not in self._plausibility.accepted:
            raise block.refuse(
                f"{text}: probe a larger area, or give the map of this work zero; --accept outside takes the height "
                "of the edge of the map there"
            )
        self._plausibility.meet("outside", f"line {shown(block.line)} is the first: {text}; the edge counts there")

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
        self._refuse_another_offset()
        if self._job.setup.surface is not None and not self._follows_map:
            raise UserError(
                "the program gives Z to no feed move, so that nothing follows the height map: write the height at its "
                "beginning, for instance G0 Z0, or correct it without --height-map"
            )
        if evaluated.worse:
            self._plausibility.meet("worse", evaluated.worse)
        if not outside.leaves:
            self._plausibility.check_outside(evaluated.outside)
        if not self._job.model.demonstration:  # its uncertainty does not belong to a real machine
            self._plausibility.check_significance(evaluated.errors.significance)

    def _refuse_another_offset(self) -> None:
        """UserError for a program that does not use the work offset of the height map."""
        setup, used = self._job.setup, self._state.used_offsets
        if setup.surface is not None and setup.surface_offset not in ("", *used):
            others = " and ".join(used) or "no work offset"
            raise UserError(
                f"the height map was probed at {setup.surface_offset}, and the program uses {others}: name the work "
                "offset of the map, --height-map FILE@G55"
            )
