"""Corrects the moves of a program, part after part: Motions -> CorrectedPart."""

from __future__ import annotations

from collections.abc import Mapping, Set
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from kinematics.error_model.classes import ORIENTATION, select
from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array
from postproc.compensation.correction import Correction, correct
from postproc.compensation.left_outside import LeftOutside
from postproc.compensation.predicted_error import in_a_program
from postproc.correct.flat_arcs import held_across_arcs
from postproc.correct.job import Job
from postproc.correct.rotary.feed import RotaryFeeds
from postproc.correct.rotary.moves import uncorrected_before_rotary_moves
from postproc.correct.splitting import Splitter
from postproc.correct.steps.splines import check_splines
from postproc.evaluation.evaluation import ErrorsBefore, WrittenMoves
from postproc.execution import Part
from postproc.motion.motions import Motions
from postproc.motion.reversals import axes_with_backlash
from postproc.text.notes import Notes
from postproc.write.editors import Written

if TYPE_CHECKING:
    from postproc.correct.backlash.take_ups import BacklashTakeUps


class Models(NamedTuple):
    """The parts of a calibration that a correction uses."""

    evaluated: ErrorModel
    """Effects that act in a program: the errors are predicted by them."""
    corrected: ErrorModel
    """Effects of the corrected classes."""
    orientation: bool
    """True if the orientation of the tool is corrected as well, by all evaluated effects."""

    @classmethod
    def of(cls, job: Job) -> Models:
        """Those of a job."""
        evaluated = job.model.part(in_a_program)
        corrected = evaluated if job.classes is None else select(evaluated, job.classes)
        return cls(evaluated, corrected, job.classes is not None and ORIENTATION in job.classes)

    @property
    def pair(self) -> tuple[ErrorModel, ErrorModel | None]:
        """Models of the tool point and, if it is corrected, of the orientation."""
        return self.corrected, self.evaluated if self.orientation else None


class CorrectedPart(NamedTuple):
    """The corrected moves of a part of the program."""

    motions: Motions
    """Moves with the segments and the blocks that are added."""
    correction: Correction
    """The correction that is written."""
    wanted: Correction
    """The correction before arcs are held in their planes."""
    bounds: Array
    """Upper bounds `(blocks,)`, mm, of the second difference of the error along the moves of each block.

    Infinite where not all errors are corrected.
    """
    unsplit: Mapping[int, str]
    """Reason why a move beyond the tolerance is not split, by block."""
    suspect: Set[int]
    """Blocks whose moves may exceed their limits."""
    split: int
    """Number of moves of the program that are split so far."""
    before: ErrorsBefore | None
    """Errors in the input at the ends of the moves, if the correction has found them."""

    def as_written(self, written: Written) -> WrittenMoves:
        """The moves as programmed and as written."""
        motions = self.motions
        return WrittenMoves(
            motions,
            written.moves(motions),
            motions.line,
            self.bounds[motions.block],
            self.unsplit,
            self.suspect,
            self.before,
        )


class PartCorrection:
    """Corrects the parts of one program, in their order."""

    def __init__(self, job: Job, models: Models, notes: Notes) -> None:
        machine, conditions, tolerance_um = job.machine, job.conditions, job.tolerance_um
        self._job, self._models, self._notes = job, models, notes
        self.outside = LeftOutside(models.corrected, conditions, leaves=job.leave_outside)
        """Moves that stay as programmed."""
        self._rotary_feeds = RotaryFeeds(machine, job.rotary_feed, job.dialect, notes)
        self._splitter = Splitter(machine, models.pair, conditions, tolerance_um, "worse" in job.accepted)
        self._take_ups = _take_ups(job, models, notes)

    def corrected(self, part: Part) -> CorrectedPart:
        """The moves of a part, corrected; Refusal for a move that cannot be corrected."""
        splitter = self._splitter
        motions = self._rotary_feeds.prepare(part.motions, repeated=part.indices is not None)
        outside = self.outside.blocks(motions)
        check_splines(motions, self._models.pair, self._job.conditions, self._job.tolerance_um, outside)
        motions = splitter.prepare(motions, part.varied, outside)
        approach = None
        if self._take_ups is not None:
            motions, approach = self._take_ups.prepare(motions)
        wanted = self._correction(motions, approach, outside)
        correction = held_across_arcs(motions, wanted) if self._job.dialect.flat_arcs else wanted
        whole = self._models.corrected is self._models.evaluated
        known = wanted.before if whole and approach is None else None
        before = None if known is None else ErrorsBefore.of(known)
        bounds = splitter.bounds if whole else np.full_like(splitter.bounds, np.inf)
        return CorrectedPart(
            motions, correction, wanted, bounds, splitter.unsplit, splitter.suspect, splitter.moves, before
        )

    def _correction(self, motions: Motions, approach: Array | None, outside: np.ndarray) -> Correction:
        """The correction of moves; `approach` `(n, axes)`: sides of the play; `outside`: blocks that stay."""
        models, conditions = self._models, self._job.conditions
        found = correct(motions, *models.pair, conditions, approach)
        found = uncorrected_before_rotary_moves(motions, found, models.evaluated, conditions, approach, self._notes)
        return self.outside.uncorrected(motions, found, outside)


def _take_ups(job: Job, models: Models, notes: Notes) -> BacklashTakeUps | None:
    """What takes up the backlash of the axes; None if no error depends on a direction."""
    if not axes_with_backlash(models.corrected, job.machine):
        return None
    from postproc.correct.backlash.take_ups import BacklashTakeUps

    return BacklashTakeUps(job.machine, models.pair, job.conditions, job.tolerance_um, notes)
