"""Several Siemens programs in one file: which calls of one run another, and where each ends."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from postproc.control.codes import PROGRAM_ENDS
from postproc.siemens.codes import END_OF_SUBPROGRAM
from postproc.siemens.reading.statements import program_name
from postproc.siemens.variables import EMPTY
from postproc.text.block import Block, Word
from postproc.text.expressions import Constant, Expression
from postproc.text.statements import Call, Code, Return


def link(blocks: Sequence[Block], _: Callable[[], set[str]], __: bool) -> list[Block]:
    """The blocks with statements for the calls of programs of the same file, and for the ends of all but the first."""
    programs = {program_name(block) for block in blocks if block.kind == "header"} - {""}
    first = next((i for i, block in enumerate(blocks) if block.kind == "header" and block.code), len(blocks))
    linked = [_with_call(block, programs) for block in blocks]
    return linked[:first] + [_with_return(block) for block in linked[first:]]


def ends(block: Block) -> bool:
    """True for the last block of a program or a subprogram."""
    return any(
        (word.address == "M" and word.value in PROGRAM_ENDS | {END_OF_SUBPROGRAM})
        or (word.address == "RET" and word.arguments is None)
        for word in block.words
    )


def _with_return(block: Block) -> Block:
    if not ends(block):
        return block
    code = block.code or Code()
    return block._replace(code=code._replace(after=(*code.after, Return())))


def _with_call(block: Block, programs: set[str]) -> Block:
    called = [(word, name) for word in block.words if (name := _called(block, word)) in programs]
    if not called or any(word.address == "MCALL" for word in block.words):
        return block
    word, name = called[0]
    others = [other for other in block.words if other.address not in ("N", "P") and other is not word]
    if others or block.skippable or (block.code is not None and block.code.turns):
        raise block.refuse(f"the call of {name} must be alone in its block: write the other words in a block before it")
    passes = next((other for other in block.words if other.address == "P"), None)
    given = [argument for argument in enumerate(word.arguments or (), start=1) if argument[1] != EMPTY]
    call = Call(f"%{name}", tuple(given), _times(passes))
    numbers = tuple(other for other in block.words if other.address == "N")
    before = block.code.before if block.code is not None else ()
    return block._replace(words=numbers, kind="words" if numbers else "control", code=Code(before, (call,)))


def _times(passes: Word | None) -> Expression | None:
    if passes is None:
        return None
    return passes.formula.expression if passes.formula is not None else Constant(passes.value or 0.0)


def _called(block: Block, word: Word) -> str:
    """The name of a program that a word may call."""
    if word.address == "CALL":
        return word.mode.removeprefix("_N_").removesuffix("_SPF").removesuffix(".SPF")
    if word.address == "L" and word.value is not None:
        return "".join(block.text[word.at : word.end].split()).upper()
    return word.address if word.start == word.end else ""
