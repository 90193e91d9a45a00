"""Siemens programs that call one another, in one file or in several: the calls, and where each program ends."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from postproc.control.codes import PROGRAM_ENDS
from postproc.siemens.codes import BY_PATH, CALLS, END_OF_SUBPROGRAM, REFUSED_NAMES
from postproc.siemens.reading.declarations import Pass, Receive
from postproc.siemens.reading.statements import program_name
from postproc.siemens.variables import EMPTY, NAME, label
from postproc.siemens.words import is_known
from postproc.text.block import Block, Word
from postproc.text.expressions import Constant, Expression, NotKnown, Operation, Variable
from postproc.text.statements import Call, Code, EndModal, Modal, Return

_HOME = re.compile(r"[ \t]*;\$PATH=[ \t]*(\S+)", re.IGNORECASE)


_WORKPIECE = re.compile(r"(?:_N_)?(\w+?)[._]WPD", re.IGNORECASE)


def names(file: str) -> list[str]:
    """The names by which the program in a file is called: %L100 for `L100.SPF` and for `_N_L100_SPF`."""
    stem, point, _ = file.upper().rpartition(".")
    match = NAME.fullmatch(stem or file.upper())
    return [f"%{match[1]}"] if match and (point or file.upper().startswith("_N_")) else []


def link(blocks: Sequence[Block], in_folders: Callable[[], set[str]], called: bool, folder: Path | None) -> list[Block]:
    """The blocks with statements for the calls of programs, and for the ends of all but a main program.

    in_folders: the names of programs in files of their own; called: another program has called this file; folder: that
    of the file.
    """
    here = {program_name(block) for block in blocks if block.kind == "header"} - {""}
    home = next((match[1].upper() for block in blocks if (match := _HOME.match(block.text))), _home_of(folder))
    programs = here | {name.removeprefix("%") for name in in_folders()} - REFUSED_NAMES.keys()
    first = next((i for i, block in enumerate(blocks) if block.kind == "header" and block.code), len(blocks))
    first = 0 if called else first
    linked = [_with_call(block, here, programs, home) for block in blocks]
    if any(block.code and any(isinstance(step, Modal) for step in block.code.after) for block in linked):
        linked = [_with_end_of_modal_call(block) for block in linked]
    return linked[:first] + [_with_return(block) for block in linked[first:]]


def _home_of(folder: Path | None) -> str:
    """The folder on the control of the programs of a workpiece, PART.WPD; empty for another folder."""
    match = _WORKPIECE.fullmatch(folder.resolve().name) if folder is not None else None
    return f"/_N_WKS_DIR/_N_{match[1].upper()}_WPD" if match else ""


def saves_modes(block: Block) -> bool:
    """True for PROC with SAVE."""
    return block.code is not None and any(isinstance(step, Receive) and step.saves for step in block.code.before)


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


def _with_call(block: Block, here: set[str], programs: set[str], home: str) -> Block:
    """The block with its call.

    here: the programs of the file, which may have names of the language; home: its folder on the control.
    """
    called = [
        (word, name)
        for word in block.words
        if (name := _called(block, word, home)) in here
        or _calls(word)
        or (name in programs and not is_known(word.address, word))
    ]
    if not called:
        return block
    word, name = called[0]
    modal = any(other.address == "MCALL" for other in block.words)
    others = [other for other in block.words if other.address not in ("N", "P", "MCALL") and other is not word]
    if others or block.skippable or (block.code is not None and block.code.turns):
        raise block.refuse(
            f"the call of {name or word.address} must be alone in its block: write the other words in a block before it"
        )
    passes = next((other for other in block.words if other.address == "P"), None)
    if modal and passes is not None:
        raise block.refuse("MCALL with P is not followed: write P into the subprogram")
    given = [argument for argument in enumerate(_given(word), start=1) if argument[1] != EMPTY]
    program = f"%{name}" if name else Operation("called program", (*(word.arguments or ())[:1], Constant(home)))
    call = Call(program, tuple(given), _times(passes))
    numbers = tuple(other for other in block.words if other.address == "N")
    before = block.code.before if block.code is not None else ()
    references = tuple((i, argument) for i, argument in given if isinstance(argument, Variable))
    if references and not modal:
        before = (*before, Pass(references))
    step = Modal(call, ("MCALL", "MCALL", "its name"), single=True) if modal else call
    return block._replace(words=numbers, kind="words" if numbers else "control", code=Code(before, (step,)))


def _with_end_of_modal_call(block: Block) -> Block:
    """The block with a statement for MCALL alone, in a program with modal calls of its own."""
    if not any(word.address == "MCALL" for word in block.words) or len(block.words) > 2:
        return block
    code = block.code or Code()
    return block._replace(code=code._replace(after=(*code.after, EndModal())))


def _times(passes: Word | None) -> Expression | None:
    if passes is None:
        return None
    return passes.formula.expression if passes.formula is not None else Constant(passes.value or 0.0)


def _calls(word: Word) -> bool:
    """True for a word that calls a program, whatever its name is."""
    return (word.address in CALLS and bool(word.arguments)) or (word.address == "L" and word.value is not None)


def _called(block: Block, word: Word, home: str) -> str:
    """The name of a program that a word may call; empty for one that the program calculates."""
    if word.address in CALLS:
        given = word.arguments[0] if word.arguments else Constant("")
        with suppress(NotKnown):  # the call refuses it when it runs
            return label(given.value, home).removeprefix("%") if isinstance(given, Constant) else ""
        return ""
    if word.address == "L" and word.value is not None:
        return "".join(block.text[word.at : word.end].split()).upper()
    return word.address if word.start == word.end else ""


def _given(word: Word) -> tuple[Expression, ...]:
    """The arguments of a call; EXTCALL has the name of the program in its parentheses, PCALL before them."""
    given = word.arguments or ()
    return given if word.address not in CALLS else given[1:] if word.address == BY_PATH else ()
