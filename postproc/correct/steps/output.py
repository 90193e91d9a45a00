"""The corrected program on its way into a file: numbered blocks, with room for the mark that is known at the end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import IO, BinaryIO

from postproc.control.state import ControlState
from postproc.correct.job import Job
from postproc.correct.mark import CONVERTED, UNCHANGED, Mark, MarkedOutput, called_by, mark_index, mark_line, mark_of
from postproc.iso.reading.lines import refuse_lengthened
from postproc.text.block import Block
from postproc.text.source import ENCODING, Source
from postproc.write.block_numbers import BlockNumbers
from postproc.write.plain_texts import PlainText


class Output:
    """Takes the blocks of a corrected program in the order of the text."""

    def __init__(self, job: Job, lines: IO[bytes], *, marked: bool) -> None:
        """`lines`: an empty file; `marked`: the program gets a mark."""
        self._job, self._marked = job, marked
        self._lines = MarkedOutput(lines)
        self._numbers = BlockNumbers(klartext=job.dialect.name == "heidenhain")
        self._lines.write(job.source.mark.encode(ENCODING))

    def put(self, blocks: Sequence[Block], texts: Sequence[str | PlainText]) -> int:
        """Write corrected blocks; returns the number of changed ones. Refusal for a line that becomes too long."""
        job, out, numbers = self._job, self._lines, self._numbers
        index = mark_index(job.dialect, blocks) if self._marked and not out.has_room else None
        first = changed = 0
        for text in texts:
            if first == index:
                out.leave_room(numbers.next_number())
            if isinstance(text, PlainText):
                first += text.lines
                changed += text.changed
                out.write(numbers.renumbered_lines(text.data))
                continue
            block = blocks[first]
            first += 1
            changed += text != block.text
            if job.dialect.name == "iso":
                refuse_lengthened(job.machine.control, block, text)
            out.write(numbers.renumbered(block, text).encode(ENCODING))
        return changed

    def finish(self, state: ControlState, accepted: dict[str, str], out: BinaryIO) -> str:
        """Write the program to `out`, with its mark; returns the line of the mark, empty without one.

        state: of the control at the end; accepted: implausible conditions that were met.
        """
        job = self._job
        mark = mark_of(job.model, state)
        end, text_hash = CONVERTED[job.tcp], self._lines.text_hash
        line = mark_line(job.dialect, job.machine, mark, job.source, accepted, end, text_hash=text_hash)
        self._lines.finish(line, out)
        return line.strip() if self._lines.has_room else ""

    def finish_called(
        self, state: ControlState, accepted: dict[str, str], out: BinaryIO, caller: Source, *, changed: bool
    ) -> None:
        """As `finish`, for a file that a program calls; one without a change has the same mark for all callers."""
        job = self._job
        mark = mark_of(job.model, state) if changed else Mark(job.model.id.upper())
        names, end = (accepted, called_by(caller.name)) if changed else ((), UNCHANGED)
        text_hash = self._lines.text_hash
        self._lines.finish(mark_line(job.dialect, job.machine, mark, job.source, names, end, text_hash=text_hash), out)
