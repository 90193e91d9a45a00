"""Klartext programs that call one another: CALL PGM, SEL PGM, cycle 12, and the beginning and end of a called one."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from postproc.heidenhain.codes import CALL_M, DATA_CYCLES, FRAME_CYCLES, PROGRAM_CALL_CYCLE, PROGRAM_END_M
from postproc.heidenhain.variables import QParameters
from postproc.text.block import Block
from postproc.text.expressions import Constant, NotKnown, Scope, Variable
from postproc.text.statements import Assign, Call, Code, Jump, Return, Step, Taken, When

_CALL = re.compile(r"CALL PGM (.+)", re.IGNORECASE)
_CALL_SELECTED = re.compile(r"CALL SELECTED(?: PGM)?", re.IGNORECASE)
_SELECT = re.compile(r"SEL PGM (.+)", re.IGNORECASE)
_CYCLE = re.compile(r"CYCL DEF (\d+)(?:\.(\d+))?(?: PGM (.+))?", re.IGNORECASE)
_ABSOLUTE = re.compile(r"[\\/]|\w+:")
_FIRST = Constant(0.0)
SELECTED = Variable("SEL PGM", (_FIRST,))
"""The program of CALL SELECTED PGM."""
OF_CYCLE = Variable("CYCL DEF 12.1 PGM", (_FIRST,))
"""The program of cycle 12."""
IN_CYCLE = Variable("CYCL DEF 12", (_FIRST,))
"""1 while cycle 12 is the one that a call runs, otherwise 0."""
NO_JUMP = Jump("", "", optional=True)
"""Does nothing, and makes the program one that is stored."""


class Begin(NamedTuple):
    """BEGIN PGM of a called program."""

    unit: str

    def run(self, scope: Scope) -> None:
        """NotKnown for another unit than that of the main program."""
        assert isinstance(scope, QParameters)
        if scope.unit != self.unit:
            raise NotKnown(f"the called program is in {self.unit} and the main program in {scope.unit}: write one unit")


class Refused(NamedTuple):
    """A block that a called program must not run."""

    reason: str

    def run(self, _: Scope) -> None:
        """NotKnown, always."""
        raise NotKnown(self.reason)


END_IN_CALLED = Refused("M2 or M30 in a called program ends the main program too: jump to the end of the program")


def names(file: str) -> list[str]:
    """The name by which the program in a file is called: PGM POCKET.H for `pocket.h`."""
    return [f"PGM {file.upper()}"] if "." in file else []


def program(text: str) -> str:
    """The label of a program by its path: SUB/PGM POCKET.H for `sub\\pocket`; empty for one outside of the folder."""
    path = text.strip().strip('"').strip()
    *folders, name = re.split(r"[\\/]+", path.upper())
    if _ABSOLUTE.match(path) or ".." in folders or not name:
        return ""
    return "/".join((*(each for each in folders if each != "."), f"PGM {name if '.' in name else f'{name}.H'}"))


def link(blocks: Sequence[Block], in_folders: Callable[[], set[str]], called: bool, _: Path | None) -> list[Block]:
    """The blocks with statements for the calls of programs in other files, and for both ends of a called program."""
    linked = list(_with_cycles([_with_call(block, in_folders) for block in blocks]))
    return [_in_called(block) for block in linked] if called else linked


def _with_call(block: Block, in_folders: Callable[[], set[str]]) -> Block:
    if block.kind == "program_call":
        if _CALL_SELECTED.fullmatch(block.detail):
            return _control(block, Call(SELECTED, ()))
        match = _CALL.fullmatch(block.detail)
        label = program(match[1]) if match else ""
        return _control(block, Call(label, ())) if label and ("/" in label or label in in_folders()) else block
    match = _SELECT.fullmatch(block.detail) if block.kind == "selection" else None
    if match and (label := program(match[1])):
        return _control(block, Assign(SELECTED, Constant(label)))
    return block


def _control(block: Block, step: Step) -> Block:
    return block._replace(kind="control", words=(), code=Code((step,)))


def _cycle(block: Block) -> int:
    """The number of the cycle that a block defines; -1 for none."""
    match = _CYCLE.match(block.detail) if block.kind == "cycle_def" else None
    return int(match[1]) if match else -1


def _with_cycles(blocks: Sequence[Block]) -> Iterator[Block]:
    """The blocks with statements that select cycle 12, or another one, and that call its program."""
    number = -1
    for block in blocks:
        defined = _cycle(block)
        if defined >= 0 and defined not in DATA_CYCLES and defined not in FRAME_CYCLES:
            number = defined
            yield _with_definition(block, number)
        elif number == PROGRAM_CALL_CYCLE:
            yield _with_call_of_cycle(block)
        else:
            yield block


def _with_definition(block: Block, number: int) -> Block:
    code = block.code or Code()
    steps: tuple[Step, ...] = (Assign(IN_CYCLE, Constant(float(number == PROGRAM_CALL_CYCLE))),)
    if number == PROGRAM_CALL_CYCLE:
        match = _CYCLE.fullmatch(block.detail)
        label = program(match[3] or "") if match else ""
        if match and match[2] == "1" and not label:
            raise block.refuse("the program that cycle 12 calls is not followed: write its name alone")
        steps = (Taken(0, len(block.text)), *steps, *((Assign(OF_CYCLE, Constant(label)),) if label else ()))
        return block._replace(code=Code((NO_JUMP,), steps))
    return block._replace(code=code._replace(after=(*code.after, *steps)))


def _with_call_of_cycle(block: Block) -> Block:
    """A block behind a definition of cycle 12: M99 and CYCL CALL call its program."""
    call = When(IN_CYCLE, Call(OF_CYCLE, ()), Refused("another cycle is active here: write cycle 12 before the call"))
    if block.kind == "cycle_call" and block.detail.upper() == "CYCL CALL":
        return _control(block, call)
    if block.kind == "cycle_position":
        raise block.refuse("CYCL CALL POS of a program is not followed: write the position and M99")
    word = next((word for word in block.words if word.address == "M" and word.value == CALL_M), None)
    if word is None:
        return block
    words, code = tuple(other for other in block.words if other is not word), block.code or Code()
    return block._replace(words=words, code=code._replace(after=(*code.after, Taken(word.at, word.end), call)))


def _in_called(block: Block) -> Block:
    """A block of a called program."""
    if block.kind == "begin_pgm":
        return _control(block, Begin(unit_of(block)))
    if block.kind == "end_pgm":
        return _control(block, Return())
    if any(word.address == "M" and word.value in PROGRAM_END_M for word in block.words):
        code = block.code or Code()
        return block._replace(code=code._replace(before=(*code.before, END_IN_CALLED)))
    return block


def unit_of(block: Block) -> str:
    """The unit of a program, by its BEGIN PGM."""
    return "INCH" if block.detail.split()[-1].upper() == "INCH" else "MM"
