"""Writes out a program with jumps, loops and calls: its blocks in order of execution, with numbers for formulas.

The written text is a program of its own. It is interpreted once, during its correction, and must make the same moves.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import PurePath

import msgspec
import numpy as np

from kinematics.user_error import UserError
from postproc.control.codes import AXES, PROGRAM_ENDS
from postproc.control.interpreter import Interpreter
from postproc.execution import Part, StoredProgram, StreamedProgram, turns
from postproc.motion.axis_words import AxisWords
from postproc.motion.motions import Motions, merged
from postproc.siemens.reading.calls import saves_modes
from postproc.siemens.variables import EMPTY
from postproc.text.block import Block, Edit, Refusal, Word, edited
from postproc.text.blocks import Blocks
from postproc.text.expressions import Constant
from postproc.text.line_numbers import first_line_of_text, place
from postproc.text.source import ENCODING, HEAD_SIZE
from postproc.text.statements import Return, Taken

SAME_UNROLLED = 1e-6
"""Largest difference of equal positions, mm and rad: written numbers have nine decimals."""
UNROLLED_DECIMALS = 9
COORDINATES = frozenset(AXES + "IJKRF")
UNSIGNED = frozenset("FST")
"""Klartext words without a sign."""
SUBPROGRAM_END = 17.0
ENDS = frozenset((*PROGRAM_ENDS, SUBPROGRAM_END))
_PLAIN = re.compile(r"[^A-Z0-9_.-]")
"""Characters of the name of a file that not all controls read in a comment."""
CLOSING = frozenset(("tape_mark", "end_pgm"))
"""Kinds of blocks after the end of the program that close the file."""


def unrolled(program: StoredProgram, interpreter: Interpreter) -> UnrolledProgram:
    """The program without jumps, loops and calls, for a new `interpreter`.

    The program runs once. UserError, located in it, for a block that cannot be written out.
    """
    moves: list[Motions] = []
    source, end = program.source, program.source.line_end
    lines, origins = list[str](), list[int]()
    for line, origin in _lines(program, moves):
        lines.append(line if line.endswith(end) else line + end)
        origins += [origin] * lines[-1].count(end)
    data = (source.mark + "".join(lines)).encode(ENCODING)
    head, before = data[:HEAD_SIZE].decode(ENCODING), first_line_of_text(origins or [1])
    text = msgspec.structs.replace(source, head=head, data=data, origin=source.hash, before=before)
    if turns(text, program.dialect, program.interpreter.control_state.setup):
        raise UserError(f"{text.name}: a jump, a loop or a call could not be written out")
    return UnrolledProgram(text, program.dialect, interpreter, merged(moves))


@dataclass
class UnrolledProgram(StreamedProgram):
    """The written text of a program; its moves must be those of the program."""

    moves: Motions
    """Moves of the program."""

    def parts(self) -> Iterator[Part]:
        """The chunks of the text; UserError for moves that differ from those of the program."""
        done = 0
        for part in super().parts():
            first, done = done, done + len(part.motions)
            if done > len(self.moves) or not _same(part.motions, self.moves.take(np.arange(first, done))):
                break
            yield part
        else:
            if done == len(self.moves):
                return
        raise UserError(f"{self.source.name}: the written text does not make the same moves as the program")


def _lines(program: StoredProgram, moves: list[Motions]) -> Iterator[tuple[str, int]]:
    """The lines, each with the line that it is from, and a comment after a jump: its line, and number of its iteration.

    `moves` takes the moves of the program.
    """
    iterations: Counter[int] = Counter()
    before, comment = -1, ""
    for index, block, last in _runs(program, moves):
        iterations[index] += 1
        try:
            line = _straight(block, program.blocks[index], last=last)
        except Refusal as refusal:
            raise refusal.located(program.source.name, program.dialect.evidence) from None
        if index != before + 1:
            file, number = place(block.line)
            named = f"{_PLAIN.sub('_', PurePath(file).name.upper())} " if file else ""
            comment = program.dialect.comment.format(f"{named}LINE {number}, PASS {iterations[index]}")
        before = index
        if line is not None:
            yield from ((text, block.line) for text in ((comment, line) if comment else (line,)))
            comment = ""
    main = program.program_set.main
    for index in range(max((i for i in iterations if i < main), default=-1) + 1, main):
        if program.blocks[index].kind in CLOSING:
            yield program.blocks[index].text, program.blocks[index].line


def _runs(program: StoredProgram, moves: list[Motions]) -> Iterator[tuple[int, Block, bool]]:
    """Index in the program and block of every run, and true for the last run."""
    held: tuple[int, Block] | None = None
    for part in program.parts():
        moves.append(replace(part.motions, blocks=Blocks(()), words=AxisWords()))
        for run in zip(part.indices or (), part.motions.blocks, strict=True):
            if held is not None:
                yield *held, False
            held = run
    if held is not None:
        yield *held, True


def _straight(block: Block, written: Block, *, last: bool) -> str | None:
    """The text of a block in its run, without jumps, loops and calls; None if the text is empty then.

    `written`: the block with the arguments of its calls as in the program.
    """
    calls = [edit for pair in zip(block.words, written.words, strict=False) for edit in _call(block, *pair)]
    if block.code is None:
        return edited(block.text, calls)
    if saves_modes(block):
        raise block.refuse(
            "a subprogram with SAVE cannot be written out, because the control restores modes behind it: write them at "
            "its end, and no SAVE"
        )
    if block.kind in ("control", "blank"):
        return None
    taken = [step for step in block.code.after if isinstance(step, Taken)]
    if any((step.at, step.end) == (0, len(block.text)) for step in taken):
        return None
    calls += [Edit(step.at, step.end, "") for step in taken]
    steps = [step for step in block.code.before + block.code.after if not isinstance(step, Return)]
    returns = any(isinstance(step, Return) for step in block.code.after) and not last
    if block.kind != "words" or not (steps or returns):
        return edited(block.text, [*calls, *(edit for word in block.words for edit in _literal(block, word))])
    kept = [word for word in block.words if not (returns and _ends(word))]
    if all(word.address == "N" for word in kept):
        return None
    texts = []
    for word in kept:
        at, stop = word.at, word.end + word.tail
        edits = [*_literal(block, word), *(edit for edit in calls if edit.start == at)]
        moved = [Edit(e.start - at, e.end - at, e.text) for e in edits]
        texts.append(edited(block.text[at:stop], moved))
    return " ".join(texts)


def _call(block: Block, word: Word, written: Word) -> list[Edit]:
    """Edits that put values for the variables in the arguments of a call."""
    given = word.arguments or ()
    if given == (written.arguments or ()):
        return []
    texts = []
    for argument in given:
        if argument == EMPTY:
            texts.append("")
        elif isinstance(argument, Constant):
            texts.append(f'"{argument.value}"' if isinstance(argument.value, str) else f"{argument.value:.10g}")
        else:
            raise block.refuse(f"an argument of {word.address} is unknown: the call cannot be unrolled")
    return [Edit(word.at, word.end, f"{block.text[word.at : word.end].partition('(')[0]}({','.join(texts)})")]


def _ends(word: Word) -> bool:
    return (word.address == "M" and word.value in ENDS) or word.address == "RET"


def _literal(block: Block, word: Word) -> list[Edit]:
    """Edit that puts a number for a formula."""
    if word.formula is None or word.formula.instead:
        return []
    if word.value is None:
        raise block.refuse(f"{block.text[word.at : word.end]}: the value is unknown, and the block cannot be unrolled")
    text = f"{round(word.value, UNROLLED_DECIMALS) + 0.0:.{UNROLLED_DECIMALS}f}".rstrip("0")
    if text.endswith(".") and word.address.removeprefix("I") not in COORDINATES:
        text = text[:-1]
    elif text.endswith("."):
        text += "0"
    signed = block.kind != "words" and word.address not in UNSIGNED
    plus = "+" if signed and not text.startswith("-") else ""
    return [Edit(word.start, word.end, plus + text)]


def _same(found: Motions, expected: Motions) -> bool:
    """True if the moves are equal, except for the rounding of the written numbers."""
    if not np.array_equal(found.kind, expected.kind) or found.arcs.keys() != expected.arcs.keys():
        return False
    same = bool(np.abs(found.machine_target - expected.machine_target).max(initial=0.0) < SAME_UNROLLED)
    same &= bool((found.known == expected.known).all())
    for row, arc in expected.arcs.items():
        other = found.arcs[row]
        same &= (arc.plane, arc.sense, arc.full, arc.turns) == (other.plane, other.sense, other.full, other.turns)
        same &= bool(np.allclose(arc.centre, other.centre, rtol=0.0, atol=1e-4))
    return same
