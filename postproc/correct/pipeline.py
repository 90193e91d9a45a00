"""Correction of an NC program, chunk by chunk.

    lines -> blocks -> Motions -> Correction -> edits -> lines

Modal state, the position on the control and the statistics carry over from chunk to chunk; memory does not grow with
the program.
"""

from __future__ import annotations

import datetime
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, BinaryIO

import msgspec
import numpy as np
from msgspec.structs import asdict, replace

from kinematics.error_model.beyond_range import beyond_range
from kinematics.error_model.classes import ORIENTATION, select
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine, NDArrayBool
from kinematics.running.memory import keep_freed_memory
from kinematics.user_error import UserError
from postproc.compensation.conditions import Conditions
from postproc.compensation.correction import COLD, Correction, correct
from postproc.compensation.predicted_error import in_a_program, model_notes
from postproc.compensation.used_datums import UsedDatums
from postproc.control.setup import Setup
from postproc.correct.backlash import BacklashTakeUps
from postproc.correct.mark import MarkedOutput, mark_index, mark_line, mark_of, refuse_marked
from postproc.correct.plausibility import REASONS, CorrectionLimit, Plausibility
from postproc.correct.result import CorrectionResult
from postproc.correct.rotary_moves import uncorrected_before_rotary_moves
from postproc.correct.splitting import Splitter
from postproc.correct.travel import note_outside, refuse_outside
from postproc.dialects import Dialect
from postproc.evaluation.evaluation import ROTARY_ONLY, ErrorsBefore, Evaluated, Evaluation, WrittenMoves
from postproc.evaluation.predicted_errors import Statistic
from postproc.evaluation.trace import Trace
from postproc.execution import Part, StoredProgram, StreamedProgram, Turns, joined_before_rotary_moves, turns
from postproc.iso.lines import refuse_lengthened
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind, Known
from postproc.text.block import Block, Refusal
from postproc.text.line_numbers import ranges, shortened
from postproc.text.notes import Notes
from postproc.text.source import ENCODING, Source
from postproc.write.block_numbers import BlockNumbers
from postproc.write.helices import FlatArcs
from postproc.write.plain_texts import PlainText, unchanged
from postproc.write.writer import Writer, Written

if TYPE_CHECKING:
    from postproc.evaluation.evaluation_process import EvaluationProcess

LARGE = 1 << 22
"""Size of a program, bytes, from which a second process is worth its start."""
SPOOLED = 1 << 24
"""Bytes of a corrected program that are kept in memory until its mark is known."""


class Job(msgspec.Struct, frozen=True):
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

    def __init__(self, job: Job, *, traced: bool = False, processes: int = 1, stored: bool = False) -> None:
        """`traced`: record the moves for figures; `processes`: number of processes that may be used.

        `stored`: the program has a jump, a loop or a call.
        """
        self.job, self._traced, self._processes, self._stored = job, traced, processes, stored
        self.notes = Notes()
        self.interpreter = job.dialect.interpreter(job.machine, job.setup, self.notes)
        self.orientation = job.classes is not None and ORIENTATION in job.classes
        self.model = job.model.part(in_a_program)
        """Evaluated part of the model; `corrected_part` is the corrected part of it."""
        self.corrected_part = self.model if job.classes is None else select(self.model, job.classes)
        models = (self.corrected_part, self.model if self.orientation else None)
        self.splitter = Splitter(job.machine, models, job.conditions, job.tolerance_um, "worse" in job.accepted)
        self.take_ups = BacklashTakeUps(job.machine, models, job.conditions, job.tolerance_um, self.notes)
        self.evaluation: Evaluation | EvaluationProcess
        """Evaluation of the written moves during a run."""
        self._numbers = BlockNumbers(klartext=job.dialect.name == "heidenhain")
        self.writer = Writer(
            job.machine,
            orientation=self.orientation,
            comment=job.dialect.comment,
            tolerance_um=job.tolerance_um,
        )
        self.report = _new_report(job)
        self.trace: Trace | None = None
        """Record for figures, once the program has run; None if not requested."""
        self.report.notes = model_notes(job.model, job.conditions)
        self.plausibility = Plausibility(job.accepted)
        self.limit = CorrectionLimit(
            job.machine, self.model, job.conditions, job.max_correction_um, turns=self.orientation
        )
        self._flat_arcs = FlatArcs()

    def run(self, out: BinaryIO, progress: Callable[[int], None]) -> CorrectionResult:
        """Write the corrected program to `out`; `progress` gets the number of bytes read since its last call.

        A program without jumps, loops and calls is read only once: where one is found on the way, the program begins
        again as a stored one. UserError, located in the program, for a block that cannot be corrected; discard `out`
        then.
        """
        if self._stored:
            return self._run(out, progress)
        seen = _Seen(progress)
        try:
            return self._run(out, seen)
        except Turns:
            pass
        except UserError:
            if not turns(self.job.source, self.job.dialect):
                raise
        stored = Pipeline(self.job, traced=self._traced, processes=self._processes, stored=True)
        self.report = stored.run(out, seen.again())
        self.trace = stored.trace
        return self.report

    def _run(self, out: BinaryIO, progress: Callable[[int], None]) -> CorrectionResult:
        """As `run`; Turns for a jump, a loop or a call in a program that is not stored."""
        job = self.job
        if job.source.size >= LARGE:
            keep_freed_memory()
        if self.model.effects:
            self.plausibility.check_calibration(job.model, job.conditions, datetime.datetime.now(datetime.UTC))
        with self._evaluation() as self.evaluation, tempfile.SpooledTemporaryFile(SPOOLED) as rest:
            marked = MarkedOutput(rest)
            self._correct_all(marked, progress)
            evaluated = self.evaluation.finish()
            self.report, self.trace = replace(self.report, **asdict(evaluated.errors)), evaluated.trace
            self._check_whole(evaluated)
            accepted = self.plausibility.met
            mark = mark_of(job.model, self.interpreter.control_state)
            marked.finish(mark_line(job.dialect, job.machine, mark, job.source, accepted), out)
        report, state = self.report, self.interpreter.control_state
        report.work_offsets, report.tools = state.used_offsets, state.used_tools
        report.assumed, report.assumption = list(state.assumed), state.assumption()
        report.datums.predict(job.machine, self.model, job.conditions)
        report.notes += report.datums.notes()
        report.notes = [*report.notes, *self.notes.texts(), *self._summary(evaluated)]
        return report

    @contextmanager
    def _evaluation(self) -> Iterator[Evaluation | EvaluationProcess]:
        """The evaluation, in a second process if the program is long enough and several may be used."""
        job = self.job
        evaluation = Evaluation(
            job.machine,
            self.model,
            job.conditions,
            job.tolerance_um,
            worse="worse" in job.accepted,
            turns=self.orientation,
            traced=self._traced,
        )
        if not self._several or not self.model.effects:
            yield evaluation
            return
        from postproc.evaluation.evaluation_process import evaluated_elsewhere

        with evaluated_elsewhere(evaluation) as process:
            yield process

    @property
    def _several(self) -> bool:
        """True if the program is long enough for several processes, and these may be used."""
        return self._processes > 1 and self.job.source.size >= LARGE

    def _correct_all(self, out: MarkedOutput, progress: Callable[[int], None]) -> None:
        """Write the corrected program with room for its mark."""
        job = self.job
        out.write(job.source.mark.encode(ENCODING))
        program = self._program()
        self.report.program["name"] = program.source.name
        try:
            try:
                for part in joined_before_rotary_moves(program.in_context()):
                    self._put(out, *program.finished(part, self._correct(part)))
                    progress(part.size)
                self._put(out, *program.rest())
                self.report.program["sha256"] = job.source.hash  # while the evaluation takes its last moves
            except UserError:
                self.evaluation.settle()  # a refusal of an earlier move comes first
                raise
            self.evaluation.settle()
        except Refusal as refusal:
            raise refusal.located(program.source.name, job.dialect.evidence) from None

    def _program(self) -> StreamedProgram:
        """The program, or on request its text without loops and calls."""
        job = self.job
        if not self._stored:
            return StreamedProgram(job.source, job.dialect, self.interpreter, ahead=self._several)
        if job.unroll:
            from postproc.correct.unroll import unrolled

            interpreter = job.dialect.interpreter(job.machine, job.setup, Notes())
            return unrolled(StoredProgram(job.source, job.dialect, interpreter), self.interpreter)
        return StoredProgram(job.source, job.dialect, self.interpreter)

    def _check_whole(self, evaluated: Evaluated) -> None:
        """Plausibility checks that need all moves; UserError for conditions that are not accepted."""
        if evaluated.worse:
            self.plausibility.meet("worse", evaluated.worse)
        self.plausibility.check_outside(evaluated.outside)
        if not self.job.model.demonstration:  # its uncertainty does not belong to a real machine
            self.plausibility.check_significance(self.report.significance)
        self.report.accepted = self.plausibility.met

    def _summary(self, evaluated: Evaluated) -> list[str]:
        """Notes on the whole program."""
        state = self.interpreter.control_state
        beyond = beyond_range(dict(sorted(evaluated.outside.largest.items())))
        left = [
            f"{axes} not corrected: the program has not named the axis since a new frame, a move in machine "
            f"coordinates or an unknown M function (lines {shortened(ranges(lines))})"
            for axes, lines in self.report.left.items()
        ]
        left += self._flat_arcs.notes() + evaluated.notes
        return (
            state.left_out()
            + state.unused()
            + beyond
            + left
            + [not_split.text(reason) for reason, not_split in self.report.not_split.items()]
        )

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
        refuse_marked(blocks.read_singly, job.dialect, self.notes, force=job.force)
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
        splitter, before = self.splitter, None
        if correction.before is not None and self.corrected_part is self.model and approach is None:
            before = ErrorsBefore.of(correction.before)
        moves = WrittenMoves(
            motions,
            written.moves(motions),
            motions.line,
            splitter.bounds[motions.block],
            splitter.unsplit,
            splitter.suspect,
            before,
        )
        self._count(moves)
        self.evaluation.add(moves)
        if motions.evaluated.any():
            self._note_rotary_only(motions, correction, written)
            self._flat_arcs.take(motions, correction, written.ends)
        report.added_blocks += written.added
        return written.texts

    def _count(self, moves: WrittenMoves) -> None:
        """Add the corrections of a chunk to the report."""
        machine, report, motions = self.job.machine, self.report, moves.motions
        moved, corrected = moves.moved, moves.corrected
        report.corrected += int(((moved != 0.0) & corrected).any(axis=1).sum())
        report.not_evaluated += int((~motions.evaluated & ~motions.intermediate).sum())
        for i in machine.translators:
            report.correction.setdefault(machine.names[i], Statistic()).add(moved[corrected[:, i], i] * 1e3)
        for i in np.flatnonzero(machine.rotary).tolist() if self.orientation else ():
            rotated = np.deg2rad(moved[corrected[:, i], i]) * 1e6
            report.rotary_correction.setdefault(machine.names[i], Statistic()).add(rotated)
        self._note_assumed(motions, moves.correctable)
        self._note_left(motions)

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
        if not left.any():
            return
        for row in np.flatnonzero(left.any(axis=1)).tolist():
            names = " ".join(self.job.machine.names[i] for i in np.flatnonzero(left[row]))
            self.report.left.setdefault(names, []).append(int(motions.line[row]))

    def _note_rotary_only(self, motions: Motions, correction: Correction, written: Written) -> None:
        """Note the feed moves of rotary axes only with a residual error that the next move corrects."""
        rows = np.flatnonzero(motions.rotary_only)
        behind = np.abs(written.ends[rows] - correction.target[rows])[:, self.job.machine.translators]
        for row in rows[behind.max(axis=1, initial=0.0) * 1e3 > self.job.tolerance_um].tolist():
            self.notes.add(ROTARY_ONLY, int(motions.line[row]))


class _Seen:
    """Passes numbers of bytes on, without those that were seen before."""

    def __init__(self, progress: Callable[[int], None], before: int = 0) -> None:
        self._progress, self._before, self._seen = progress, before, 0

    def __call__(self, size: int) -> None:
        new = max(self._seen + size - max(self._seen, self._before), 0)
        self._seen += size
        self._progress(new)

    def again(self) -> _Seen:
        """For the same bytes once more."""
        return _Seen(self._progress, self._seen)


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
    program = {"name": job.source.name, "sha256": "", "dialect": job.dialect.name}
    return CorrectionResult(
        program=program,
        machine={"name": machine.name, "chain": machine.chain},
        calibration=calibration,
        datums=UsedDatums(job.setup),
        conditions=job.conditions,
    )
