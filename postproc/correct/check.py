"""Check of a program without correcting it: lines of corrected, unchanged and refused blocks.

The check of a program without jumps continues after a refusal.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from kinematics.machine import Machine
from kinematics.user_error import UserError
from postproc.control.block_skip import decide
from postproc.control.interpreter import Interpreter
from postproc.control.setup import Setup
from postproc.control.without_effect import Unused, unused_set_up
from postproc.correct.feed_moves import FeedNotes
from postproc.correct.travel import note_outside, refusals_outside
from postproc.dialects import Dialect
from postproc.execution import StreamedProgram, Turns, turns
from postproc.motion.motions import Motions
from postproc.motion.moves import Kind
from postproc.program_set import ProgramSet
from postproc.text.block import Block, Refusal
from postproc.text.block_values import straight
from postproc.text.flow import Flow
from postproc.text.line_numbers import place, ranges, shown
from postproc.text.notes import Notes
from postproc.text.source import CHUNK_BLOCKS, Source, chunks
from rendering.report import Report, Section, Table, shortened
from rendering.shown import Shown

LISTED_BLOCKS = 50
"""Most refused blocks in the report."""
MEANINGS = {
    "corrected": "the coordinates of these lines get a correction",
    "not complete": "moves before the program has given every axis or a tool; their start is assumed, they stay",
    "machine": "moves in machine coordinates (G53, G28); they stay",
    "repeated": "lines that run more than once",
    "not run": "lines that jumps skip, or that follow the end of the program",
}
"""Kinds of lines, each with its meaning, for the page."""
UNKNOWN = "the travel is not checked before the work offset and the tool length are given"


@dataclass(repr=False)
class Findings(Shown):
    """Findings of a check; lists of line numbers contain a line as often as it runs."""

    dialect: str
    """Dialect of the program."""
    evidence: str = ""
    """The reason for this dialect; empty if the user has chosen it."""
    blocks: int = 0
    """Number of blocks."""
    corrected: list[int] = field(default_factory=list)
    """Lines of moves whose end is corrected."""
    not_programmed: list[int] = field(default_factory=list)
    """Lines of moves at whose end the program has not yet given all linear axes in its frame."""
    machine: list[int] = field(default_factory=list)
    """Lines of moves to machine coordinates, which are not changed."""
    not_run: list[int] = field(default_factory=list)
    """Lines of blocks that jumps skip, or that follow the end of the program."""
    refused: list[tuple[int, str, str]] = field(default_factory=list)
    """Line, text and reason; later refusals may be consequences of the first."""
    notes: list[str] = field(default_factory=list)
    """Notes for the user."""
    assumed: list[str] = field(default_factory=list)
    """Work offsets and tools that the machine file assumes."""
    assumption: str = ""
    """`assumed` as a sentence; empty for none."""
    unused: list[Unused] = field(default_factory=list)
    """Parts of the set-up that were given and not used; empty for a program that is refused."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        return f"{self.dialect}, {self.blocks} blocks, {len(self.corrected)} corrected, {len(self.refused)} refused"

    @property
    def repeated(self) -> list[int]:
        """Lines of moves that run more than once."""
        runs = Counter(self.corrected + self.not_programmed + self.machine)
        return sorted(line for line, times in runs.items() if times > 1)

    def json(self) -> dict[str, Any]:
        """The machine-readable form."""
        return {
            "dialect": self.dialect,
            "dialect_evidence": self.evidence,
            "blocks": self.blocks,
            "moves": len(self.corrected) + len(self.not_programmed) + len(self.machine),
            "corrected_lines": ranges(self.corrected),
            "unsaid_lines": ranges(self.not_programmed),
            "machine_coordinate_lines": ranges(self.machine),
            "repeated_lines": ranges(self.repeated),
            "not_run_lines": ranges(self.not_run),
            "refused": [{**_place(line), "text": text, "reason": reason} for line, text, reason in self.refused],
            "assumed": self.assumed,
            "notes": self.notes,
        }

    def report(self, name: str) -> Report:
        """The findings for people; `name`: of the program."""
        moves = len(self.corrected) + len(self.not_programmed) + len(self.machine)
        rows = [("program", f"{name}  ({self.dialect}, {self.blocks} blocks, {moves} moves)")]
        kinds = {
            "corrected": self.corrected,
            "not complete": self.not_programmed,
            "machine": self.machine,
            "repeated": self.repeated,
            "not run": self.not_run,
        }
        found = {kind: lines for kind, lines in kinds.items() if lines}
        for kind, lines in found.items():
            rows.append((kind, f"{len(lines)}: line{'s' if len(set(lines)) > 1 else ''} {ranges(lines)}"))
        rows += [("note", note) for note in (*self.notes, self.evidence if self.refused else "") if note]
        same = dict[str, list[tuple[int, str]]]()
        for line, text, reason in sorted(self.refused, key=lambda refused: refused[0]):
            same.setdefault(reason, []).append((line, text))
        refused = [
            f"line {shown(line)}: {text!r}: {reason}{_also([line for line, _ in others])}"
            for reason, ((line, text), *others) in same.items()
        ]
        rows += [
            ("refused", text) for text in shortened(refused, LISTED_BLOCKS, "refused blocks, all in the file of --json")
        ]
        number = len(self.refused)
        verdict = f"Refused: {number} block{'s' if number > 1 else ''}." if number else "Accepted."
        verdict = f"{name}: {verdict}"
        verdict += " The later ones may follow from the first." if number > 1 else ""
        verdict = f"{self.assumption}\n{verdict}" if self.assumption else verdict
        text = "\n".join(f"{kind.capitalize()}: {MEANINGS[kind]}." for kind in found)
        return Report(f"Check of {name}", "", [Section("Findings", text, Table(("", ""), rows))], verdict)

    def take(self, motions: Motions) -> None:
        """Add the lines of the moves of a chunk, each to the list of its treatment."""
        rows = np.flatnonzero(motions.kind != Kind.PRESET)
        block, machine = motions.block[rows], motions.kind[rows] == Kind.MACHINE
        # a second row of the same block is the end of a cycle
        first = ~(machine & np.append(False, block[1:] == block[:-1])[: len(rows)])
        corrected, lines = motions.evaluated[rows] & ~machine, motions.line[rows]
        self.machine += lines[first & machine].tolist()
        self.corrected += lines[first & corrected].tolist()
        self.not_programmed += lines[first & ~machine & ~corrected].tolist()

    def take_travel(self, refusals: Iterable[Refusal]) -> None:
        """Note moves outside the travel: each line once for each axis, however often it runs."""
        known = {(line, reason.split()[0]) for line, _, reason in self.refused}
        for refusal in refusals:
            axis_line = refusal.line, refusal.reason.split()[0]
            if axis_line not in known:
                known.add(axis_line)
                self.refuse(refusal)

    def refuse(self, refusal: Refusal) -> None:
        """Note a refusal."""
        self.refused.append((refusal.line, refusal.text, refusal.reason))


def check(source: Source, dialect: Dialect, machine: Machine, setup: Setup, *, travel_check: bool = True) -> Findings:
    """Check a program, and its travel, as its correction would read it.

    A program without jumps is read as for its correction, in bulk, up to the first refusal. Where there is one, it is
    read again block by block, so that the blocks behind it are checked too.
    """
    runs = turns(source, dialect, setup)
    with suppress(UserError, Turns):
        if not runs:
            return _checked(source, dialect, machine, setup, _in_bulk, travel_check=travel_check)
    return _checked(source, dialect, machine, setup, _run if runs else _singly, travel_check=travel_check)


Reader = Callable[[Source, Dialect, Interpreter, "Findings", Callable[[Motions], None]], None]
"""Reads a program. Findings and moves go to the last arguments."""


def _checked(
    source: Source, dialect: Dialect, machine: Machine, setup: Setup, read: Reader, *, travel_check: bool
) -> Findings:
    """The findings by one reader."""
    notes = Notes()
    interpreter, findings = dialect.interpreter(machine, setup, notes), Findings(dialect.name, dialect.evidence)
    state, feed_notes = interpreter.control_state, FeedNotes(notes)

    def take(motions: Motions) -> None:
        """Add moves, and those that leave the travel."""
        findings.take(motions)
        feed_notes.take(motions)
        if travel_check:
            given = np.array([state.is_given(frame) for frame in motions.frames], bool)[motions.frame]
            outside = refusals_outside(motions, motions.machine_target, "as programmed", state, only=given)
            findings.take_travel(outside)
            if not given.all():
                notes.add(UNKNOWN, int(motions.line[np.argmin(given)]), int((~given).sum()))
        else:
            note_outside(motions, motions.machine_target, notes)

    read(source, dialect, interpreter, findings, take)
    if not findings.refused:
        findings.unused = unused_set_up(state)
    findings.notes = notes.texts() + state.left_out() + state.short_tools()
    findings.assumed, findings.assumption = list(state.assumed), state.assumption()
    return findings


def _in_bulk(
    source: Source, dialect: Dialect, interpreter: Interpreter, findings: Findings, take: Callable[[Motions], None]
) -> None:
    """Read a program without jumps; UserError if a block is refused."""
    for part in StreamedProgram(source, dialect, interpreter).parts():
        findings.blocks += len(part.motions.blocks)
        take(part.motions)


def _singly(
    source: Source, dialect: Dialect, interpreter: Interpreter, findings: Findings, take: Callable[[Motions], None]
) -> None:
    """Read a program without jumps, block by block."""
    for lines in chunks(dialect.join_lines(source.lines()), CHUNK_BLOCKS):
        findings.blocks += len(lines)
        _read(_blocks(lines, dialect, interpreter, findings), interpreter, findings, take)


def _place(line: int) -> dict[str, Any]:
    """The line of a refusal, with the called file that it is in."""
    file, number = place(line)
    return {"line": number, "file": file} if file else {"line": number}


def _also(lines: list[int]) -> str:
    """The other lines with the reason of the first one."""
    return f" (the same in line{'s' if len(set(lines)) > 1 else ''} {ranges(lines)})" if lines else ""


def _blocks(
    lines: Iterable[tuple[int, str]], dialect: Dialect, interpreter: Interpreter, findings: Findings
) -> Iterator[Block]:
    skip = interpreter.control_state.setup.block_skip
    for line, text in lines:
        try:
            yield decide(dialect.read_block(line, text), skip, interpreter.notes)
        except Refusal as refusal:
            if not interpreter.ended:
                findings.refuse(refusal)


def _read(
    blocks: Iterator[Block], interpreter: Interpreter, findings: Findings, take: Callable[[Motions], None]
) -> None:
    """Read a chunk, block by block; after a refused block the positions of all axes are unknown."""
    while True:
        done: list[Block] = []
        try:
            take(interpreter.read(straight(_noted(blocks, done), interpreter.scope)))
        except Refusal as refusal:
            findings.refuse(refusal)
            take(interpreter.recorder.finish(done))
            interpreter.recorder.mark_unknown(list(range(len(interpreter.recorder.machine.axes))))
        else:
            return


def _noted(blocks: Iterable[Block], done: list[Block]) -> Iterator[Block]:
    for block in blocks:
        done.append(block)
        yield block


def _run(
    source: Source,
    dialect: Dialect,
    interpreter: Interpreter,
    findings: Findings,
    take: Callable[[Motions], None],
) -> None:
    """Run a program with jumps up to the first refusal."""
    lines = list(dialect.join_lines(source.lines()))
    findings.blocks = len(lines)
    blocks = list(_blocks(lines, dialect, interpreter, findings))
    if findings.refused:
        return
    done: list[Block] = []
    try:
        files = ProgramSet(source, dialect, interpreter, blocks)
        blocks = files.blocks
        flow = Flow(blocks, interpreter.scope, dialect.labels, dialect.begins, files)
        running = (block for _, block in flow.run(interpreter) if isinstance(block, Block))
        take(interpreter.read(_noted(running, done)))
    except Refusal as refusal:
        findings.refuse(refusal)
        take(interpreter.recorder.finish(done))
        return
    findings.not_run = [
        block.line for i, block in enumerate(blocks) if i not in flow.ran and block.kind not in ("blank", "header")
    ]
