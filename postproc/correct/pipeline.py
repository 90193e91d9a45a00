"""Correction of an NC program, chunk by chunk.

    lines -> blocks -> Motions -> Correction -> edits -> lines

Modal state, the position on the control and the statistics carry over from chunk to chunk; memory does not grow with
the program.
"""

from __future__ import annotations

import datetime
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np

from kinematics.error_model.classes import ORIENTATION, select
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine, NDArrayBool
from kinematics.transforms import Array
from postproc.compensation.conditions import Conditions
from postproc.compensation.correction import COLD, Correction, correct, pose_errors
from postproc.compensation.datum import datum_prediction
from postproc.compensation.predicted_error import MachineStates, in_a_program, model_notes
from postproc.compensation.significance import Significance, uncertainties_um
from postproc.compensation.used_datums import UsedDatums
from postproc.control.setup import Setup
from postproc.correct.backlash import BacklashTakeUps
from postproc.correct.mark import MarkedOutput, mark_in, mark_index, mark_line, mark_of
from postproc.correct.plausibility import REASONS, CorrectionLimit, Guard, Outside, Plausibility
from postproc.correct.result import CorrectionResult, Statistic, UnsplitMoves
from postproc.correct.rotary_moves import uncorrected_before_rotary_moves
from postproc.correct.splitting import Splitter
from postproc.correct.trace import Trace
from postproc.correct.travel import note_outside, refuse_outside
from postproc.dialects import Dialect
from postproc.execution import Part, StoredProgram, StreamedProgram, execution, joined_before_rotary_moves, turns
from postproc.iso.lines import refuse_lengthened
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind, Known
from postproc.text.block import Block, Refusal
from postproc.text.blocks import Blocks
from postproc.text.line_numbers import ranges, shortened
from postproc.text.notes import Notes
from postproc.text.source import ENCODING, Source
from postproc.write.block_numbers import BlockNumbers
from postproc.write.helices import FlatArcs
from postproc.write.plain_rows import PlainText, unchanged
from postproc.write.writer import Writer, Written

UNCERTAINTY_STEPS = ((0, 1), (500, 8), (1 << 12, 128), (1 << 16, 1024))
"""Uncertainties of predictions are computed for every move at first, and from further numbers of moves on for every
eighth, 128th and 1024th: more would cost more than the correction."""
SPOOLED = 1 << 24
"""Bytes of a corrected program that are kept in memory until its mark is known."""
BETWEEN = (0.25, 0.5, 0.75)
"""Shares of the path of a written block at which the error between its ends is predicted."""
STRAIGHT = 0.02
"""Share of the tolerance by which the error between the ends of a move may deviate from that at its ends, if it is not
evaluated there."""
CLOSELY = tuple(i / 32 for i in range(1, 33))
"""Shares for moves that may be worse than in the input."""
ERROR_JUMPS = "its error jumps, or an axis with backlash reverses within it"
ROTARY_ONLY = "a feed move of rotary axes only keeps its linear axes, because F would mean another speed with them"


@dataclass(frozen=True)
class Job:
    """One program to be corrected for one machine."""

    source: Source
    dialect: Dialect
    machine: Machine
    model: ErrorModel
    setup: Setup
    travel_check: bool = True
    force: bool = False
    classes: frozenset[str] | None = None
    """Elementary compensation classes, and FOR, that are corrected; None for all but FOR."""
    tolerance_um: float = 1.0
    """Largest deviation of a feed move between its ends, um, without splitting; half of it is no reversal."""
    conditions: Conditions = COLD
    """Conditions during the run of the program."""
    max_correction_um: float | None = None
    """Largest correction of a linear axis, um; None for the default of `CorrectionLimit`."""
    accepted: frozenset[str] = frozenset(REASONS)
    """Names of implausible conditions that are accepted; the command line accepts none by default."""
    unroll: bool = False
    """True if loops and calls are written out."""


class Pipeline:
    """Correction of one program, with the state between its chunks; use it once, by `run`."""

    def __init__(self, job: Job, *, traced: bool = False) -> None:
        self.job = job
        self.notes = Notes()
        self.interpreter = job.dialect.interpreter(job.machine, job.setup, self.notes)
        self.orientation = job.classes is not None and ORIENTATION in job.classes
        self.model = job.model.part(in_a_program)
        """Evaluated part of the model; `corrected_part` is the corrected part of it."""
        self.corrected_part = self.model if job.classes is None else select(self.model, job.classes)
        models = (self.corrected_part, self.model if self.orientation else None)
        worse = "worse" in job.accepted
        self.splitter = Splitter(job.machine, models, job.conditions, job.tolerance_um, worse)
        self.take_ups = BacklashTakeUps(job.machine, models, job.conditions, job.tolerance_um, self.notes)
        self.before = MachineStates(self.model, job.machine, job.conditions, job.tolerance_um)
        self.after = MachineStates(self.model, job.machine, job.conditions, job.tolerance_um, written=True)
        self._numbers = BlockNumbers(klartext=job.dialect.name == "heidenhain")
        self.writer = Writer(
            job.machine,
            orientation=self.orientation,
            comment=job.dialect.comment,
            tolerance_um=job.tolerance_um,
        )
        self.report = _new_report(job)
        self.trace = Trace(job.machine, self.model) if traced else None
        """Record for figures; None if not requested."""
        self.report.notes = model_notes(job.model, job.conditions)
        self.plausibility = Plausibility(job.accepted)
        self.limit = CorrectionLimit(
            job.machine, self.model, job.conditions, job.max_correction_um, turns=self.orientation
        )
        self.guard = Guard(job.machine, self.plausibility, turns=self.orientation)
        self._outside = Outside()
        self._flat_arcs = FlatArcs()

    def run(self, out: BinaryIO, progress: Callable[[int], None]) -> CorrectionResult:
        """Write the corrected program to `out`; `progress` gets the number of bytes read since its last call.

        UserError, located in the program, for a block that cannot be corrected; discard `out` then.
        """
        job, report = self.job, self.report
        if self.model.effects:
            self.plausibility.check_calibration(job.model, job.conditions, datetime.datetime.now(datetime.UTC))
        with tempfile.SpooledTemporaryFile(SPOOLED) as rest:
            marked = MarkedOutput(out, rest)
            self._run(marked, progress)
            accepted = self.plausibility.met
            mark = mark_of(job.model, self.interpreter.control_state)
            marked.finish(mark_line(job.dialect, job.machine, mark, job.source, accepted))
        state = self.interpreter.control_state
        report.work_offsets, report.tools = state.used_offsets, state.used_tools
        report.assumed, report.assumption = list(state.assumed), state.assumption()
        report.datums.predict(job.machine, self.model, job.conditions)
        report.notes += report.datums.notes()
        report.notes = [*report.notes, *self.notes.texts(), *self._summary()]
        return report

    def _run(self, out: MarkedOutput, progress: Callable[[int], None]) -> None:
        """Write the corrected program with room for its mark."""
        job = self.job
        out.write(job.source.mark.encode(ENCODING))
        program = self._program()
        self.report.program["name"] = program.source.name
        try:
            for part in joined_before_rotary_moves(program.in_context()):
                self._put(out, *program.finished(part, self._correct(part)))
                progress(part.size)
            self._put(out, *program.rest())
        except Refusal as refusal:
            raise refusal.located(program.source.name, job.dialect.evidence) from None
        self._check_whole()

    def _program(self) -> StreamedProgram:
        """The program, or on request its text without loops and calls."""
        job = self.job
        if job.unroll and turns(job.source, job.dialect):
            from postproc.correct.unroll import unrolled

            interpreter = job.dialect.interpreter(job.machine, job.setup, Notes())
            return unrolled(StoredProgram(job.source, job.dialect, interpreter), self.interpreter)
        return execution(job.source, job.dialect, self.interpreter)

    def _check_whole(self) -> None:
        """Plausibility checks that need all moves; UserError for conditions that are not accepted."""
        self.plausibility.check_outside(self._outside)
        if not self.job.model.demonstration:  # its uncertainty does not belong to a real machine
            self.plausibility.check_significance(self.report.significance)
        self.report.accepted = self.plausibility.met

    def _summary(self) -> list[str]:
        """Notes on the whole program."""
        unused = self.interpreter.control_state.unused()
        beyond = [
            f"{name} is used up to {excess:.4g} {unit} beyond its calibrated range; its end value is held there"
            for (name, unit), excess in sorted(self._outside.largest.items())
        ]
        left = [
            f"{axes} not corrected: the program has not named the axis since a new frame, a move in machine "
            f"coordinates or an unknown M function (lines {shortened(ranges(lines))})"
            for axes, lines in self.report.left.items()
        ]
        left += self._flat_arcs.notes() + self.guard.notes()
        return unused + beyond + left + [not_split.text(reason) for reason, not_split in self.report.not_split.items()]

    def _put(self, out: MarkedOutput, blocks: Sequence[Block], texts: Sequence[str | PlainText]) -> None:
        """Write corrected blocks of the program, with room for the mark."""
        job, report = self.job, self.report
        report.blocks += len(blocks)
        index = mark_index(job.dialect, blocks) if self.model.effects and not out.has_room else None
        first = 0
        for text in texts:
            if first == index:
                out.leave_room(self._numbers.next_number())
            if isinstance(text, PlainText):
                first += text.lines
                report.changed_blocks += text.changed
                out.write(self._numbers.renumbered_lines(text.data))
                continue
            block = blocks[first]
            first += 1
            report.changed_blocks += text != block.text
            if job.dialect.name == "iso":
                refuse_lengthened(job.machine.control, block, text)
            out.write(self._numbers.renumbered(block, text).encode(ENCODING))

    def _correct(self, part: Part) -> list[str | PlainText]:
        """Texts of a chunk of blocks, corrected."""
        motions = part.motions
        job, report, blocks = self.job, self.report, motions.blocks
        report.moves += int((motions.kind != Kind.PRESET).sum())
        report.datums.add(motions)
        if job.travel_check:
            refuse_outside(motions, motions.machine_target, "as programmed", self.interpreter.control_state)
        if not self.model.effects:
            return list(unchanged(blocks))
        self._refuse_marked(blocks)
        motions = self.splitter.prepare(motions, part.varied)
        report.split_moves = self.splitter.moves
        motions, approach = self.take_ups.prepare(motions)
        orientation = self.model if self.orientation else None
        correction = correct(motions, self.corrected_part, orientation, job.conditions, approach)
        correction = uncorrected_before_rotary_moves(
            motions, correction, self.model, job.conditions, approach, self.notes
        )
        limit = self.limit.check(motions, correction.nominal, correction.corrected)
        report.max_correction_um = max(limit, report.max_correction_um or 0.0)
        if job.travel_check:
            refuse_outside(motions, correction.corrected, "after correction", self.interpreter.control_state)
        else:
            note_outside(motions, correction.corrected, self.notes)
        written = self.writer.write(motions, correction, part.indices)
        self._evaluate(motions, correction, written)
        report.added_blocks += written.added
        return written.texts

    def _refuse_marked(self, blocks: Blocks) -> None:
        own = self.job.dialect.own
        for block in blocks.read_singly:
            used = own.search(block.text) if own is not None and not self.job.force else None
            if used is not None:
                raise block.refuse(f"{used[0].upper()} is a variable for the corrections of ncomp: use another one")
            mark = mark_in(block.text)
            if mark is None:
                continue
            calibration = mark.calibration
            if not self.job.force:
                raise block.refuse(
                    f"the program is already corrected by ncomp (calibration {calibration}); --force corrects it again"
                )
            self.notes.add(f"already corrected (calibration {calibration}) and corrected again", block.line)

    def _evaluate(self, motions: Motions, correction: Correction, written: Written) -> None:
        """Add the corrections, and the errors that the exact model predicts before and after them, to the report."""
        job, report, own = self.job, self.report, ~motions.intermediate
        machine, evaluated, correctable = job.machine, motions.evaluated, motions.programmed & own
        moved, programmed = written.ends - motions.target, motions.correctable & correctable[:, None]
        report.corrected += int(((moved != 0.0) & programmed).any(axis=1).sum())
        report.not_evaluated += int((~evaluated & own).sum())
        for i in machine.translators:
            report.correction.setdefault(machine.names[i], Statistic()).add(moved[programmed[:, i], i] * 1e3)
        for i in np.flatnonzero(machine.rotary).tolist() if self.orientation else ():
            rotated = np.deg2rad(moved[programmed[:, i], i]) * 1e6
            report.rotary_correction.setdefault(machine.names[i], Statistic()).add(rotated)
        self._note_assumed(motions, correctable)
        self._note_left(motions)
        commanded = written.moves(motions)
        errors, left = np.full((len(motions), 2), np.nan), np.full((len(motions), 3), np.nan)
        errors[evaluated], left[evaluated] = self._evaluate_ends(motions, commanded, correction.nominal, evaluated)
        self.guard.check_ends(motions, np.flatnonzero(evaluated), errors[evaluated])
        self._evaluate_between(motions, commanded, errors[:, 0], left)
        if evaluated.any():
            self._note_rotary_only(motions, correction, written)
            self._flat_arcs.take(motions, correction, written.ends)
        if self.trace is not None:
            self.trace.add(motions, correctable, np.where(programmed, moved, np.nan), errors)
            self.trace.add_paths(motions, self.before)

    def _evaluate_ends(
        self, motions: Motions, commanded: Motions, nominal: Array, evaluated: NDArrayBool
    ) -> tuple[Array, Array]:
        """Errors `(k, 2)`, um, before and after at the ends of the evaluated rows, and those after as vectors `(k, 3)`.

        nominal `(n, axes)`, mm and rad. Vectors in mm, workpiece frame, relative to the datum.
        """
        job, report, tool = self.job, self.report, motions.tool[evaluated]
        machine = job.machine
        states_before = self.before.states(motions, evaluated)
        states_after = self.after.states(commanded, evaluated)
        if not evaluated.any():
            return np.empty((0, 2)), np.empty((0, 3))
        nominal, ends = nominal[evaluated], motions.in_machine(commanded.target)[evaluated]
        shift = self.before.datum_shifts(motions)[evaluated]
        before = pose_errors(machine, self.model, nominal, nominal, tool, states_before, shift)
        after = pose_errors(machine, self.model, ends, nominal, tool, states_after, shift)
        numbers = report.before.count + np.arange(len(nominal))
        some, stands_for = _sampled(numbers)
        report.before.add(before.point_um)
        report.after.add(after.point_um)
        report.absolute_before.add(before.absolute_um)
        report.absolute_after.add(after.absolute_um)
        report.tilt_before.add(before.axis_urad)
        report.tilt_after.add(after.axis_urad)
        looked_at = motions.bare.take(np.flatnonzero(evaluated)[some])
        datum = datum_prediction(looked_at, self.model, job.conditions)
        whole, along = uncertainties_um(machine, self.model, states_before(nominal).rows(some), tool[some], datum)
        report.uncertainty.add(whole)
        report.significance.add(before.point_um[some], after.point_um[some], along, stands_for)
        self._outside.add(self.model.excesses(machine, states_before(nominal)), motions.line[evaluated])
        return np.stack([before.point_um, after.point_um], axis=1), after.apart - shift

    def _note_assumed(self, motions: Motions, correctable: NDArrayBool) -> None:
        """Note the moves that were corrected with an assumed position of an axis."""
        for i, axis in enumerate(self.job.machine.axes):
            rows = np.flatnonzero(correctable & (motions.known[:, i] == Known.ASSUMED))
            if rows.size:
                line = int(motions.line[rows[0]])
                text = f"the program has not given {axis.name} yet: its home {axis.home:g} is assumed"
                self.notes.add(text, line, rows.size)

    def _note_left(self, motions: Motions) -> None:
        """Collect the lines of moves that are not corrected in all axes."""
        left = motions.uncorrected
        for row in np.flatnonzero(left.any(axis=1)).tolist():
            names = " ".join(self.job.machine.names[i] for i in np.flatnonzero(left[row]))
            self.report.left.setdefault(names, []).append(int(motions.line[row]))

    def _note_rotary_only(self, motions: Motions, correction: Correction, written: Written) -> None:
        """Note the feed moves of rotary axes only with a residual error that the next move corrects."""
        behind = np.abs(written.ends - correction.target)[:, self.job.machine.translators].max(axis=1, initial=0.0)
        for row in np.flatnonzero(motions.rotary_only & (behind * 1e3 > self.job.tolerance_um)):
            self.notes.add(ROTARY_ONLY, int(motions.line[row]))

    def _evaluate_between(self, motions: Motions, commanded: Motions, before: Array, left: Array) -> None:
        """Evaluate feed moves between their ends; before `(n,)`: errors in the input at the ends of all rows, um.

        left `(n, 3)`: errors after the correction at these ends, mm.
        """
        rows = motions.known_paths
        if not rows.any():
            return
        evaluated = motions.evaluated_paths[rows]
        if self.trace is not None:
            self.trace.between_before.add(self._errors_between(motions, motions, self.before, rows)[evaluated])
        errors_between = self._between_by_ends(motions, commanded, before, left)[rows]
        exact = np.isnan(errors_between)
        if exact.any():
            some = np.flatnonzero(rows)[exact]
            errors_between[exact] = self._errors_between(motions, commanded, self.after, some)
        self.report.between_ends.add(errors_between[evaluated])
        self._guard_between(motions, commanded, before, np.flatnonzero(rows)[evaluated], errors_between[evaluated])
        beyond, rotary_only = errors_between > self.job.tolerance_um, motions.rotary_only
        for row, size in zip(np.flatnonzero(rows)[beyond].tolist(), errors_between[beyond].tolist(), strict=True):
            block = int(motions.block[row])
            reason = ROTARY_ONLY if rotary_only[row] else self.splitter.unsplit.get(block, ERROR_JUMPS)
            self.report.not_split.setdefault(reason, UnsplitMoves()).add(int(motions.line[row]), size)

    def _between_by_ends(self, motions: Motions, commanded: Motions, before: Array, left: Array) -> Array:
        """Largest errors `(n,)`, um, between the ends of straight moves, from the errors at both ends; nan if unknown.

        The error deviates from the straight line between those of the ends by no more than a bound of its second
        difference; it is unknown where this is more than a share STRAIGHT of the tolerance, or could make the move
        worse than the tolerance or the input.
        """
        found = np.full(len(motions), np.nan)
        if len(motions) < 2 or self.after.axes:
            return found
        first, last = left[:-1], left[1:]
        joined = (commanded.start[1:] == commanded.target[:-1]).all(axis=1) & (motions.frame[1:] == motions.frame[:-1])
        joined &= (motions.start[1:] == motions.target[:-1]).all(axis=1) & (motions.kind[1:] == Kind.LINE)
        shifts = (commanded.target - motions.target)[:, motions.machine.translators]
        sizes = np.linalg.norm(shifts, axis=1)
        rotary = motions.machine.rotary
        turned = np.deg2rad(np.abs((motions.target - motions.start)[1:, rotary]).sum(axis=1))
        turned[motions.tcp[1:]] = 0.0
        bound = self.splitter.bounds[motions.block[1:]] + turned**2 / 4.0 * np.maximum(sizes[1:], sizes[:-1])
        bound = (bound + turned / 2.0 * np.linalg.norm(np.diff(shifts, axis=0), axis=1)) * 1e3
        between = [np.linalg.norm((1.0 - share) * first + share * last, axis=1) for share in BETWEEN]
        largest = np.max(between, axis=0) * 1e3
        tolerance = self.job.tolerance_um
        straight = joined & (bound <= STRAIGHT * tolerance) & (largest + bound <= np.minimum(tolerance, before[1:]))
        found[1:][straight] = largest[straight]
        return found

    def _guard_between(
        self, motions: Motions, commanded: Motions, before: Array, rows: np.ndarray, errors_between: Array
    ) -> None:
        """Compare programmed moves between their ends with the input; errors_between `(rows,)`: of their segments, um.

        In the input the largest error of a path is at least that of its end: moves within that error need no further
        evaluation.
        """
        ends = np.flatnonzero(~motions.intermediate)
        move = np.searchsorted(ends, rows)
        doubtful = np.zeros(len(ends), bool)
        doubtful[move[~(errors_between <= before[ends[move]])]] = True
        suspect = np.isin(motions.block[ends], list(self.splitter.suspect))
        chosen = (doubtful | suspect)[move]
        if not chosen.any():
            return
        rows, move = rows[chosen], move[chosen]
        errors = np.zeros((len(ends), 2))
        for column, (moves, machine_states) in enumerate(((motions, self.before), (commanded, self.after))):
            np.maximum.at(errors[:, column], move, self._errors_between(motions, moves, machine_states, rows, CLOSELY))
        found = np.unique(move)
        self.guard.check_paths(motions, ends[found], errors[found], self.splitter.unsplit, ERROR_JUMPS)

    def _errors_between(
        self,
        motions: Motions,
        commanded: Motions,
        machine_states: MachineStates,
        rows: np.ndarray,
        shares: Iterable[float] = BETWEEN,
    ) -> Array:
        """Largest errors `(rows,)`, um, of commanded moves between their ends; rows as a mask or by their numbers."""
        tool, shift = motions.tool[rows], machine_states.datum_shifts(motions)[rows]
        errors_between = np.zeros(len(tool))
        for share in shares:
            states = machine_states.last_states(rows, share)
            nominal = motions.in_machine(motions.along(share))[rows]
            actual = motions.in_machine(commanded.along(share))[rows]
            here = pose_errors(self.job.machine, self.model, actual, nominal, tool, states, shift).point_um
            errors_between = np.maximum(errors_between, here)
        return errors_between


def _sampled(numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the moves, by their numbers `(n,)`, whose uncertainty is computed, and how many each stands for."""
    first, steps = np.array(UNCERTAINTY_STEPS).T
    step = steps[np.searchsorted(first, numbers, side="right") - 1]
    some = np.flatnonzero(numbers % step == 0)
    return some, step[some]


def _new_report(job: Job) -> CorrectionResult:
    model, machine = job.model, job.machine
    age = model.age_days(datetime.datetime.now(datetime.UTC))
    calibration = {
        "id": model.id if model.effects else "none",
        "made_at": model.provenance.made_at.isoformat(),
        "age_days": round(age, 2) if model.effects else None,
        "made_by": model.provenance.made_by,
        "demonstration": model.demonstration,
    }
    program = {"name": job.source.name, "sha256": job.source.hash, "dialect": job.dialect.name}
    named = {"name": machine.name, "chain": machine.chain}
    significance = Significance(job.tolerance_um)
    datums = UsedDatums(job.setup)
    return CorrectionResult(program, named, calibration, datums, conditions=job.conditions, significance=significance)
