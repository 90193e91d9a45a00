"""Correction of an NC program, part by part.

    lines -> blocks -> Motions -> CorrectedPart -> WrittenMoves -> edits -> lines

The steps are in `postproc/correct/steps`. Modal state, the position on the control and the results carry over from part
to part; memory does not grow with the program.
"""

from __future__ import annotations

import io
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

from msgspec.structs import replace

from kinematics.files.inputs import true_path
from kinematics.running.memory import keep_freed_memory
from kinematics.running.progress import Unseen
from kinematics.user_error import UserError
from postproc.correct.job import Job
from postproc.correct.mark import refuse_marked
from postproc.correct.result import CorrectionResult
from postproc.correct.steps.checks import Checks
from postproc.correct.steps.correction import Models, PartCorrection
from postproc.correct.steps.counts import Counts
from postproc.correct.steps.output import Output
from postproc.correct.tcp.conversion import conversion_of
from postproc.correct.tcp.read_back import ReadBack, setup_of_input
from postproc.evaluation.evaluation import Evaluated, Evaluation
from postproc.evaluation.trace import Trace
from postproc.execution import (
    Different,
    Part,
    StoredProgram,
    StreamedProgram,
    Turns,
    joined_before_rotary_moves,
    turns,
)
from postproc.program_set import CalledFile
from postproc.text.block import Block, Refusal
from postproc.text.line_numbers import shown
from postproc.text.notes import Notes
from postproc.text.source import Source
from postproc.write.plain_texts import PlainText, unchanged
from postproc.write.writer import Writer

if TYPE_CHECKING:
    from postproc.evaluation.evaluation_process import EvaluationProcess

SECOND_PROCESS_BYTES = 1 << 22
"""Size of a program, bytes, from which a second process is worth its start."""
SPOOLED = 1 << 24
"""Bytes of a corrected program that are kept in memory until its mark is known."""


class WritingOut(Exception):
    """The reason why the calls of other files are written out."""


class CorrectedFile(NamedTuple):
    """The file of a called program, corrected."""

    name: str
    """Its path from the folder of the output, with slashes."""
    source: Source
    data: bytes


class Pipeline:
    """Correction of one program, with the state between its parts; use it once, by `run`."""

    def __init__(self, job: Job, *, traced: bool = False, processes: int = 1, stored: bool = False) -> None:
        """`traced`: record the moves for figures; `processes`: number of processes that may be used.

        `stored`: the program has a jump, a loop or a call.
        """
        self._job, self._traced, self._processes, self._stored = job, traced, processes, stored
        notes = Notes()
        setup = setup_of_input(job)
        self._interpreter = job.dialect.interpreter(setup.machine, setup, notes)
        self._conversion = conversion_of(job, notes)
        self._read_back = ReadBack(job)
        self._state = self._interpreter.control_state
        self._models = models = Models.of(job)
        self._correction = PartCorrection(job, models, notes)
        self._checks = Checks(job, models, self._state, notes)
        self._counts = Counts(job, models, notes)
        self._writer = Writer(
            job.machine,
            orientation=models.orientation,
            comment=job.dialect.comment,
            tolerance_um=job.tolerance_um,
        )
        self.trace: Trace | None = None
        """Record for figures, once the program has run; None if not requested."""
        self.called: list[CorrectedFile] = []
        """The files of called programs, once the program has run."""
        self._called_files: list[tuple[CalledFile, Sequence[Block], list[str | PlainText]]] = []

    def run(self, out: BinaryIO, progress: Callable[[int], None]) -> CorrectionResult:
        """Write the corrected program to `out`; `progress` gets the number of bytes read since its last call.

        A program without jumps, loops and calls is read only once: where one is found on the way, the program begins
        again as a stored one. UserError, located in the program, for a block that cannot be corrected; discard `out`
        then.
        """
        seen = Unseen(progress)
        try:
            return self._run(out, seen)
        except Turns:
            pass
        except UserError:
            if not turns(self._job.source, self._job.dialect, self._job.setup):
                raise
        return self._again(self._job, out, seen)

    def _again(self, job: Job, out: BinaryIO, seen: Unseen) -> CorrectionResult:
        """Correct the program as a stored one."""
        stored = Pipeline(job, traced=self._traced, processes=self._processes, stored=True)
        try:
            result = stored._run(out, seen.again())
        except WritingOut as reason:
            result = self._again(replace(job, unroll=True), out, seen)
            result.notes.insert(0, str(reason))
        else:
            self.trace, self.called = stored.trace, stored.called
            result.add_called([file.name for file in self.called])
        return result

    def _run(self, out: BinaryIO, progress: Callable[[int], None]) -> CorrectionResult:
        """As `run`; Turns for a jump, a loop or a call in a program that is not stored."""
        job, checks, outside = self._job, self._checks, self._correction.outside
        if job.source.size >= SECOND_PROCESS_BYTES:
            keep_freed_memory()
        checks.calibration()
        with tempfile.SpooledTemporaryFile(SPOOLED) as lines:
            output = Output(job, lines, marked=bool(self._models.evaluated.effects) or self._conversion is not None)
            evaluated = self._correct_all(output, progress)
            checks.whole(evaluated, outside)
            self.called = [self._corrected_file(*each) for each in self._called_files]
            if self._conversion is None:
                mark = output.finish(self._state, checks.accepted, out)
            else:
                self._conversion.refuse_nothing()
                text = io.BytesIO()
                mark = output.finish(self._state, checks.accepted, text)
                self._read_back.check(text.getvalue(), out)
        self.trace = evaluated.trace
        result = self._counts.finish(evaluated, outside, checks.accepted, self._state)
        result.mark = mark
        if self._conversion is not None:
            result.converted_moves, result.conversion = self._conversion.moves, self._job.tcp
            result.notes += self._conversion.notes(self._state.used_tools)
        return result

    @contextmanager
    def _evaluation(self) -> Iterator[Evaluation | EvaluationProcess]:
        """The evaluation, in a second process if the program is long enough and several may be used."""
        job, models = self._job, self._models
        evaluation = Evaluation(
            job.machine,
            models.evaluated,
            job.conditions,
            job.tolerance_um,
            worse="worse" in job.accepted,
            turns=models.orientation,
            traced=self._traced,
        )
        if not self._several or not models.evaluated.effects:
            yield evaluation
            return
        from postproc.evaluation.evaluation_process import evaluated_elsewhere

        with evaluated_elsewhere(evaluation) as process:
            yield process

    @property
    def _several(self) -> bool:
        """True if the program is long enough for several processes, and these may be used."""
        return self._processes > 1 and self._job.source.size >= SECOND_PROCESS_BYTES

    def _correct_all(self, output: Output, progress: Callable[[int], None]) -> Evaluated:
        """Write the corrected program; returns the evaluation of its moves."""
        job = self._job
        with self._evaluation() as evaluation:
            program = self._program()
            try:
                try:
                    for part in joined_before_rotary_moves(program.in_context()):
                        self._refuse_called(program)
                        self._put(output, *program.finished(part, self._corrected(part, evaluation)))
                        progress(part.size)
                    self._put(output, *program.rest())
                    self._called_files = list(program.called())
                    # while the evaluation takes its last moves
                    self._counts.read(program.source.name, job.source.hash)
                except UserError:
                    evaluation.settle()  # a refusal of an earlier move comes first
                    raise
                evaluation.settle()
            except Refusal as refusal:
                if isinstance(refusal, Different) and program.called_files:
                    where = f"line {shown(refusal.line)} needs a different correction each time"
                    raise WritingOut(f"{_written_out(program.called_files)}, because {where}") from None
                raise refusal.located(program.source.name, job.dialect.evidence) from None
            return evaluation.finish()

    def _program(self) -> StreamedProgram:
        """The program, or on request its text without loops and calls."""
        job = self._job
        if not self._stored:
            return StreamedProgram(job.source, job.dialect, self._interpreter, ahead=self._several)
        if job.unroll or self._conversion is not None:
            from postproc.correct.unroll import unrolled

            setup = setup_of_input(job)
            interpreter = job.dialect.interpreter(setup.machine, setup, Notes())
            return unrolled(StoredProgram(job.source, job.dialect, interpreter), self._interpreter)
        return StoredProgram(job.source, job.dialect, self._interpreter, bulk=True)

    def _refuse_called(self, program: StreamedProgram) -> None:
        """WritingOut if the program has called other files, and these cannot be corrected as files."""
        if program.called_files and not self._job.beside:
            raise WritingOut(f"{_written_out(program.called_files)}: the output is one program")

    def _corrected_file(
        self, file: CalledFile, blocks: Sequence[Block], texts: Sequence[str | PlainText]
    ) -> CorrectedFile:
        """The file of a called program, corrected, with a mark."""
        job, marked = replace(self._job, source=file.source), bool(self._models.evaluated.effects)
        if marked:
            refuse_marked(blocks, job.dialect, Notes(), force=job.force)
        changed = any(text != block.text for text, block in zip(texts, blocks, strict=True))
        if changed and str(true_path(Path(file.source.name))) in job.shared:
            why = f"other programs call {file.name} too, with corrections that may differ"
            raise WritingOut(f"{_written_out([file])}, because {why}")
        with tempfile.SpooledTemporaryFile(SPOOLED) as lines:
            output, out = Output(job, lines, marked=marked), io.BytesIO()
            self._put(output, blocks, texts)
            output.finish_called(self._state, self._checks.accepted, out, self._job.source, changed=changed)
        return CorrectedFile(file.name, file.source, out.getvalue())

    def _put(self, output: Output, blocks: Sequence[Block], texts: Sequence[str | PlainText]) -> None:
        """Write corrected blocks, and count them."""
        self._counts.written(len(blocks), output.put(blocks, texts))

    def _corrected(self, part: Part, evaluation: Evaluation | EvaluationProcess) -> list[str | PlainText]:
        """Texts of a part, corrected; its written moves go to the evaluation."""
        self._counts.programmed(part.motions)
        self._checks.programmed(part.motions)
        rewrite = None
        if self._conversion is not None:
            part, rewrite = self._conversion.converted(part)
        elif not self._models.evaluated.effects:
            return list(unchanged(part.motions.blocks))
        corrected = self._correction.corrected(part)
        limit_um = self._checks.corrected(corrected)
        indices = part.indices if part.repeated else None
        written = self._writer.write(corrected.motions, corrected.correction, indices, rewrite)
        moves = corrected.as_written(written)
        if rewrite is not None:
            self._read_back.add(moves)
        if self._models.evaluated.effects:
            evaluation.add(moves)
        self._counts.corrected(corrected, moves, written.added, limit_um)
        return written.texts


def _written_out(files: Iterable[CalledFile]) -> str:
    return f"the calls of {', '.join(file.name for file in files)} are written out in the program"
