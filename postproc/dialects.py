"""Dialects of NC programs, and the choice of the dialect of a program."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path, PurePath

import msgspec
from msgspec.structs import replace

from kinematics.files.mistaken import none_of
from kinematics.machine import Machine
from kinematics.user_error import UserError
from postproc.control.interpreter import Interpreter
from postproc.control.setup import Setup
from postproc.text.block import Block, Refusal
from postproc.text.dialect_evidence import evidence
from postproc.text.flow import never
from postproc.text.notes import Notes
from postproc.text.plain_style import PlainStyle


def as_they_are(blocks: Sequence[Block], _: Callable[[], set[str]], __: bool, ___: Path | None) -> list[Block]:
    """The blocks of a dialect in which each block is complete by itself."""
    return list(blocks)


def without_names(_: str) -> tuple[str, ...]:
    """No name, for a dialect without calls of other files."""
    return ()


class Dialect(msgspec.Struct, frozen=True):
    """Grammar and meaning of one kind of NC code."""

    name: str
    join_lines: Callable[[Iterable[tuple[int, str]]], Iterator[tuple[int, str]]]
    """Joins the numbered lines of a file to numbered texts of blocks."""
    read_block: Callable[[int, str], Block]
    flow: re.Pattern[str]
    """Pattern that matches at least every block after which another than the next block may run."""
    labels: Callable[[Block], Iterable[str]]
    """Names of a block for jumps and calls."""
    interpreter: Callable[[Machine, Setup, Notes], Interpreter]
    comment: str
    """Format of a comment, for its text."""
    is_head: Callable[[Block], bool]
    """True for blocks that must stay before all others."""
    own: re.Pattern[str] | None = None
    """Variables for corrections; a program that already uses them cannot be corrected."""
    link: Callable[[Sequence[Block], Callable[[], set[str]], bool, Path | None], list[Block]] = as_they_are
    """Completes the blocks of a file of a stored program by the parts that depend on all of them, on the names of the
    programs in its folders, on whether it is called, and on its folder."""
    names: Callable[[str], Iterable[str]] = without_names
    """The names by which a program is called, by the name of its file."""
    end: str = ""
    """The cure for a called program without an end."""
    calls: re.Pattern[str] | None = None
    """Pattern that matches at least every call of a program in another file, but one by its name alone."""
    calls_by_name: bool = False
    """True if the name of a program alone calls it."""
    plain: PlainStyle | None = None
    """Words of plain lines, which are read together; None for a dialect whose lines are read one by one."""
    leads: Callable[[Block], bool] = never
    """True for a block that is written together with the next one."""
    flat_arcs: bool = False
    """True if blocks of arcs may be unable to name the axis across their plane."""
    begins: Callable[[Block], bool] = never
    """True for the first block of a program: jumps and labels of other programs do not reach it."""
    evidence: str = ""
    """The reason for the dialect of a program, for messages; empty if the user has chosen it."""


def _bounded(read_block: Callable[[int, str], Block]) -> Callable[[int, str], Block]:
    """A reader of blocks that refuses formulas nested too deeply for Python."""

    def read(line: int, text: str) -> Block:
        try:
            return read_block(line, text)
        except RecursionError:
            raise Refusal(
                line, text, "the formula is too long or nested too deeply: split it into several blocks"
            ) from None

    return read


def _iso() -> Dialect:
    from postproc.iso import interpreter as iso
    from postproc.iso.reading import blocks as iso_blocks
    from postproc.iso.reading import calls as iso_calls
    from postproc.iso.reading import lines as iso_lines

    return Dialect(
        "iso",
        iso_lines.join_lines,
        _bounded(iso_lines.read_line),
        iso_blocks.FLOW,
        iso_blocks.labels,
        iso.IsoInterpreter,
        "({})",
        lambda block: block.kind == "tape_mark" or (bool(block.words) and block.words[0].address == "O"),
        begins=lambda block: any(word.address == "O" for word in block.words),
        names=iso_calls.names,
        end="write M99 as its last block",
        calls=re.compile(r"M[ \t]*0*1?98|G[ \t]*0*6[56]|O[ \t]*(?:\d+|<[^<>]*>)[ \t]*C", re.IGNORECASE),
        plain=PlainStyle("FNS", motions="0123", arcs="IJKR"),
    )


def _heidenhain() -> Dialect:
    from postproc.heidenhain import blocks as heidenhain_blocks
    from postproc.heidenhain import calls as heidenhain_calls
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
        lambda block: block.kind == "begin_pgm" or block.detail[:9].upper() == "BEGIN PGM",
        heidenhain_statements.OWN,
        link=heidenhain_calls.link,
        names=heidenhain_calls.names,
        end="write END PGM as its last block",
        calls=re.compile(r"(?:CALL|SEL)[ \t]+PGM|DEF[ \t]+12", re.IGNORECASE),
        flat_arcs=True,
        leads=lambda block: block.kind == "centre",
        plain=PlainStyle(
            "FR",
            head="L",
            rapid="FMAX",
            unchanged="R",
            continued="~",
            marks=".,",
            tool=("TX", "TY", "TZ"),
            normal=("NX", "NY", "NZ"),
            vector_head="LN",
        ),
    )


def _siemens() -> Dialect:
    from postproc.siemens import interpreter as siemens
    from postproc.siemens.reading import blocks as siemens_blocks
    from postproc.siemens.reading import calls as siemens_calls
    from postproc.siemens.reading import statements as siemens_statements

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
        names=siemens_calls.names,
        end="write M17 or RET as its last block",
        calls=re.compile(r"(?<![A-Z_])L\s*\d|CALL", re.IGNORECASE),
        calls_by_name=True,
        begins=lambda block: block.kind == "header",
        plain=PlainStyle("FNS", motions="0123", arcs="IJK", tool=("A3=", "B3=", "C3=")),
    )


DIALECTS = {"iso": _iso, "siemens": _siemens, "heidenhain": _heidenhain}
"""Functions that make a dialect, by name; they import its modules only if it is used."""
NAMES = ("auto", "iso", "siemens", "heidenhain")


def find_dialect(name: str, file: str, head: str) -> Dialect:
    """The dialect by its name; for `auto` by the suffix of `file` and the beginning `head` of the program.

    UserError for a name that is not in NAMES.
    """
    if name not in NAMES:
        raise UserError(f"--dialect {none_of(name, NAMES)}")
    if name != "auto":
        return DIALECTS[name]()
    found = evidence(PurePath(file).suffix.lower(), head)
    return replace(DIALECTS[found.dialect](), evidence=found.text)
