"""The dialects ncomp reads, and how a program's dialect is found."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import Protocol

from kinematics.machine import Machine
from kinematics.user_error import UserError
from postproc.control.setup import Setup
from postproc.control.state import ControlState
from postproc.motion.motions import Motions
from postproc.motion.recorder import Recorder
from postproc.text.block import Block, Refusal
from postproc.text.dialect_evidence import evidence
from postproc.text.flow import Variables, never
from postproc.text.notes import Notes


class Interpreter(Protocol):
    """Meaning of a dialect: blocks in, moves out, modal state kept from chunk to chunk."""

    @property
    def control_state(self) -> ControlState:
        """Offsets and tools as the program has left them, and which it used."""

    @property
    def ended(self) -> bool:
        """The program has come to its end."""

    @property
    def moved(self) -> bool:
        """The last block moved the tool; Refusal where whether a modal call follows it depends on the control."""

    @property
    def recorder(self) -> Recorder:
        """Where the axes are."""

    @property
    def scope(self) -> Variables:
        """The variables of the program."""

    def read(self, blocks: Iterable[Block]) -> Motions:
        """The moves of a chunk of blocks. Refusal at the first block that isn't fully understood.

        Each is read before the next is asked for: what comes next may depend on where the tool stands.
        """


@dataclass(frozen=True)
class Dialect:
    """Grammar and meaning of one kind of NC code."""

    name: str
    join_lines: Callable[[Iterable[tuple[int, str]]], Iterator[tuple[int, str]]]
    """Numbered lines of a file into numbered texts of blocks."""
    read_block: Callable[[int, str], Block]
    flow: re.Pattern[str]
    """What stands in every block after which not always the next one runs, and perhaps in others."""
    labels: Callable[[Block], Iterable[str]]
    """The names under which jumps and calls find a block."""
    interpreter: Callable[[Machine, Setup, Notes], Interpreter]
    comment: str
    """A comment, as a format with one place for its text."""
    is_head: Callable[[Block], bool]
    """True for blocks that must stay in front of everything else."""
    own: re.Pattern[str] | None = None
    """Variables that corrections are put into: a program that has them already can't be corrected."""
    link: Callable[[Sequence[Block]], list[Block]] = list
    """The blocks of a program that is held as a whole, with what only the whole tells of them."""
    leads: Callable[[Block], bool] = never
    """True for a block that is written together with the one behind it."""
    begins: Callable[[Block], bool] = never
    """True for the first block of a program that jumps and labels of another don't reach."""
    evidence: str = ""
    """The reason for the dialect of a program, for messages; empty if the user has chosen it."""


def _bounded(read_block: Callable[[int, str], Block]) -> Callable[[int, str], Block]:
    """The reader of a block, which refuses formulas that are nested more deeply than Python follows."""

    def read(line: int, text: str) -> Block:
        try:
            return read_block(line, text)
        except RecursionError:
            raise Refusal(line, text, "the formula is too long or nested too deeply: divide it") from None

    return read


def _iso() -> Dialect:
    from postproc.iso import interpreter as iso
    from postproc.iso import lines as iso_lines
    from postproc.iso import statements as iso_statements

    return Dialect(
        "iso",
        iso_lines.join_lines,
        _bounded(iso_lines.read_line),
        iso_statements.FLOW,
        iso_statements.labels,
        iso.IsoInterpreter,
        "({})",
        lambda block: block.kind == "tape_mark" or (bool(block.words) and block.words[0].address == "O"),
        begins=lambda block: any(word.address == "O" for word in block.words),
    )


def _heidenhain() -> Dialect:
    from postproc.heidenhain import blocks as heidenhain_blocks
    from postproc.heidenhain import interpreter as heidenhain
    from postproc.heidenhain import statements as heidenhain_statements

    return Dialect(
        "heidenhain",
        heidenhain_blocks.join_lines,
        _bounded(heidenhain_blocks.read_block),
        heidenhain_statements.FLOW,
        heidenhain_statements.labels,
        heidenhain.HeidenhainInterpreter,
        "; {}",
        lambda block: block.kind == "begin_pgm",
        heidenhain_statements.OWN,
        leads=lambda block: block.kind == "centre",
    )


def _siemens() -> Dialect:
    from postproc.siemens import blocks as siemens_blocks
    from postproc.siemens import calls as siemens_calls
    from postproc.siemens import interpreter as siemens
    from postproc.siemens import statements as siemens_statements

    return Dialect(
        "siemens",
        iter,
        _bounded(siemens_blocks.read_block),
        siemens_statements.FLOW,
        siemens_statements.labels,
        siemens.SiemensInterpreter,
        "; {}",
        lambda block: block.kind == "header" or "$PATH" in block.text,
        link=siemens_calls.link,
        begins=lambda block: block.kind == "header",
    )


DIALECTS = {"iso": _iso, "siemens": _siemens, "heidenhain": _heidenhain}
"""A run loads the one it needs."""
NAMES = ("auto", "iso", "siemens", "heidenhain")


def find_dialect(name: str, file: str, head: str) -> Dialect:
    """The dialect by its name, or for `auto` by what the program says and, failing that, by the file's name.

    `head` is the beginning of the program. UserError for one that ncomp does not read.
    """
    if name not in NAMES:
        raise UserError(f"--dialect {name}: expected one of {', '.join(NAMES)}")
    if name != "auto":
        return DIALECTS[name]()
    found = evidence(PurePath(file).suffix.lower(), head)
    return replace(DIALECTS[found.dialect](), evidence=found.text)
