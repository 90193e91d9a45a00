"""A program with jumps, loops and calls written out: the blocks as they run, with numbers in the place of formulas.

What is written is a program of its own, which is read again and has to make the very same moves.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from kinematics.user_error import UserError
from postproc.control.codes import AXES, PROGRAM_ENDS
from postproc.dialects import Dialect, Interpreter
from postproc.execution import Walk, turns
from postproc.motion.motions import Motions, merged
from postproc.siemens.variables import EMPTY
from postproc.text.block import Block, Edit, Word, edited
from postproc.text.expressions import Constant
from postproc.text.source import ENCODING, HEAD_SIZE, Source
from postproc.text.statements import Return

SAME = 1e-6
"""mm and rad: literals have nine decimals."""
DECIMALS = 9
COORDINATES = frozenset(AXES + "IJKRF")
UNSIGNED = frozenset("FST")
"""Klartext words that take no sign."""
SUBPROGRAM_END = 17.0
ENDS = frozenset((*PROGRAM_ENDS, SUBPROGRAM_END))
CLOSING = frozenset(("tape_mark", "end_pgm"))
"""Blocks that stand behind the end of the program and close the file."""


def unrolled(source: Source, dialect: Dialect, interpreter: Callable[[], Interpreter]) -> Source:
    """The program without jumps, loops and calls, the source itself where it has none.

    `interpreter` gives a fresh one. UserError, located in the program, for what can't be written out.
    """
    if not turns(source, dialect):
        return source
    walk = Walk(source, dialect, interpreter())
    ran: list[tuple[int, Block]] = []
    moves = []
    for part in walk.parts():
        ran += zip(part.places, part.motions.blocks, strict=True)
        moves.append(_bare(part.motions))
    end = source.line_end
    text = source.mark + "".join(line if line.endswith(end) else line + end for line in _lines(walk, ran))
    data = text.encode(ENCODING)
    result = replace(
        source, name=f"{source.name} (unrolled)", head=data[:HEAD_SIZE].decode(ENCODING), data=data, origin=source.hash
    )
    _check(result, dialect, interpreter(), merged(moves))
    return result


def _lines(walk: Walk, ran: list[tuple[int, Block]]) -> Iterator[str]:
    """With a comment where something else runs than the next block of the program: its line, and how often it ran."""
    passes: Counter[int] = Counter()
    before, comment = -1, ""
    for i, (place, block) in enumerate(ran):
        passes[place] += 1
        try:
            line = _straight(block, walk.blocks[place], last=i == len(ran) - 1)
        except UserError as refusal:
            located = getattr(refusal, "located", None)
            raise located(walk.source.name, walk.dialect.evidence) if located else refusal from None
        if place != before + 1:
            comment = walk.dialect.comment.format(f"LINE {block.line}, PASS {passes[place]}")
        before = place
        if line is not None:
            yield from (comment, line) if comment else (line,)
            comment = ""
    for place in range(max((place for place, _ in ran), default=-1) + 1, len(walk.blocks)):
        if walk.blocks[place].kind in CLOSING and not passes[place]:
            yield walk.blocks[place].text


def _straight(block: Block, written: Block, *, last: bool) -> str | None:
    """The text of a block as it runs, without jumps, loops and calls; None if nothing is left of it.

    `written`: the block with the arguments of its calls as in the program.
    """
    calls = [edit for pair in zip(block.words, written.words, strict=False) for edit in _call(block, *pair)]
    if block.code is None:
        return edited(block.text, calls)
    if block.kind in ("control", "blank"):
        return None
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
    """The values instead of variables in the arguments of a call."""
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
            raise block.refuse(f"an argument of {word.address} is not known, and it can't be unrolled")
    return [Edit(word.at, word.end, f"{block.text[word.at : word.end].partition('(')[0]}({','.join(texts)})")]


def _ends(word: Word) -> bool:
    return (word.address == "M" and word.value in ENDS) or word.address == "RET"


def _literal(block: Block, word: Word) -> list[Edit]:
    """The number in the place of a formula."""
    if word.formula is None or word.formula.instead:
        return []
    if word.value is None:
        raise block.refuse(f"{block.text[word.at : word.end]}: its value is not known, and it can't be unrolled")
    text = f"{round(word.value, DECIMALS) + 0.0:.{DECIMALS}f}".rstrip("0")
    if text.endswith(".") and word.address.removeprefix("I") not in COORDINATES:
        text = text[:-1]
    elif text.endswith("."):
        text += "0"
    signed = block.kind != "words" and word.address not in UNSIGNED
    plus = "+" if signed and not text.startswith("-") else ""
    return [Edit(word.start, word.end, plus + text)]


def _bare(motions: Motions) -> Motions:
    return replace(motions, blocks=[], words=[])


def _check(source: Source, dialect: Dialect, interpreter: Interpreter, wanted: Motions) -> None:
    """Refuse a text that does not make the moves that it was made from, or that still turns."""
    if turns(source, dialect):
        raise UserError(f"{source.name}: what turns the run of the program could not be taken out of it")
    walk = Walk(source, dialect, interpreter)
    found = merged([_bare(part.motions) for part in walk.parts()])
    same = len(found) == len(wanted) and np.array_equal(found.kind, wanted.kind)
    if same and len(found):
        same = bool(np.abs(found.machine_target - wanted.machine_target).max() < SAME)
        same &= bool((found.known == wanted.known).all()) and found.arcs.keys() == wanted.arcs.keys()
        for row, arc in wanted.arcs.items() if same else ():
            other = found.arcs[row]
            same &= (arc.plane, arc.sense, arc.full, arc.turns) == (other.plane, other.sense, other.full, other.turns)
            same &= bool(np.allclose(arc.centre, other.centre, rtol=0.0, atol=1e-4))
    if not same:
        raise UserError(f"{source.name}: what is written out does not make the same moves as the program")
