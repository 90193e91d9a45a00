"""A program with the files that it calls: their blocks one behind the other, each file read at its first call."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from msgspec.structs import replace

from postproc.control.block_skip import decide
from postproc.control.codes import PROBE_BESIDE
from postproc.control.interpreter import Interpreter
from postproc.control.setup import Setup
from postproc.dialects import Dialect
from postproc.program_lines import read_blocks
from postproc.text.block import Block, Refusal
from postproc.text.blocks import PlainRun
from postproc.text.calls.called_files import CalledFiles, Found, posted_suffix, shown_name
from postproc.text.calls.listing import Passed
from postproc.text.dialect_evidence import TITLES, definite, evidence
from postproc.text.expressions import NotKnown, Scope, evaluate
from postproc.text.line_numbers import first_line
from postproc.text.source import CHUNK_BLOCKS, ENCODING, Source, open_source
from postproc.text.statements import Assign, Call, Code, Modal, When

PROBING_MACRO = re.compile(r"O9[78]\d\d")
"""Names of the macros for probes of a machine (Renishaw, Blum)."""


HEAD_LINES = 10
"""Lines in which the head of a program is looked for."""
SET_UP = ".toml"
"""Suffix behind the name of a program, of the file with its set-up."""


class CalledFile(NamedTuple):
    """The file of a called program, with its place among the blocks of the set."""

    source: Source
    name: str
    """Path of its correction, from the folder of the output."""
    first: int
    last: int
    """Its blocks are those from `first` to before `last`."""


class ProgramSet:
    """The blocks of a program, and of the files that it has called so far."""

    def __init__(
        self,
        source: Source,
        dialect: Dialect,
        interpreter: Interpreter,
        blocks: Iterable[Block] | None = None,
        *,
        axes: str = "",
    ) -> None:
        """`blocks`: those of the main program, if they are read. Refusal for a block that is not understood.

        axes: letters of the axes, for the runs of plain lines; empty for none.
        """
        self._axes = axes
        self.runs: dict[int, PlainRun] = {}
        """Runs of plain lines by the index of their first block."""
        self.source, self.dialect, self._interpreter = source, dialect, interpreter
        self.found = called_files(source, dialect, interpreter.control_state.setup)
        self.end = dialect.end
        self.blocks: list[Block] = []
        self.called: list[CalledFile] = []
        """The files that have been called, in the order of their first calls."""
        self.main = self._link(self._read(source, 0) if blocks is None else blocks, None)
        """Number of blocks of the main program."""

    def first_block(self, name: str, at: int) -> int:
        """Index of the first block of the file of a program, as of `Files` in `postproc/text/calls/listing.py`."""
        calling = self._file(at)
        folder = calling.source.folder if calling else None
        found = self.found.find(name, folder)
        if found is None and PROBING_MACRO.fullmatch(name):
            state = self._interpreter.control_state
            if not state.setup.probing:
                raise NotKnown(
                    f"the file has no subprogram {shown_name(name)}; if it is a macro that probes: {PROBE_BESIDE}"
                )
            self._interpreter.channel.probe(self.blocks[at], f"the macro {name}")
            raise Passed
        if found is None:
            raise NotKnown(f"the file has no subprogram {shown_name(name)}{self.found.missing(folder)}")
        known = next((each for each in self.called if each.source.name == str(found.path)), None)
        return known.first if known else self._add(found)

    def refuse_beside(self, name: str, inside: int) -> None:
        """NotKnown if a program has a file of its own, and a beginning at the block `inside` of another file.

        LinuxCNC 2.9 reads the file unless it has run over the other beginning before, FANUC has both in its memory.
        """
        if self.dialect.name != "iso" or self._interpreter.machine.control.family == "fanuc":
            return
        found = self.found.find(name, Path(self.name(inside)).parent if self.source.folder else None)
        if found is not None and found.path.resolve() != Path(self.name(inside)).resolve():
            raise NotKnown(
                f"{found.path} is a file of {shown_name(name)} too, and the order of the blocks decides which one "
                'LinuxCNC runs: rename one of them, or write family = "fanuc" in the machine file'
            )

    def name(self, at: int) -> str:
        """The name of the file of a block."""
        file = self._file(at)
        return file.source.name if file else self.source.name

    def _file(self, at: int) -> CalledFile | None:
        """The called file of a block; None for the main program."""
        return next((each for each in self.called if each.first <= at < each.last), None)

    def _add(self, found: Found) -> int:
        """Read a file behind the others; returns its first block."""
        if self.source.data is None and found.path.resolve() == Path(self.source.name).resolve():
            raise NotKnown(f"the program calls itself: {found.path} is the main program; end the recursion")
        if (own := found.path.with_name(found.path.name + SET_UP)).is_file():
            raise NotKnown(
                f"{own} is the set-up of {found.path.name} alone, and a called program runs in that of its main "
                "program: write its entries there, and delete it or rename it"
            )
        source = open_source(str(found.path))
        self._check_dialect(source, found.path)
        self._refuse_same_output(found)
        first = len(self.blocks) + 1
        self.blocks.append(Block(0, "", "blank"))
        try:
            last = first + self._link(self._read(source, first_line(source.name)), source.folder)
        except BaseException:
            del self.blocks[first - 1 :]
            self.runs = {index: run for index, run in self.runs.items() if index < first}
            raise
        self.called.append(CalledFile(source, found.name, first, last))
        return first

    def _read(self, source: Source, before: int) -> Iterator[Block]:
        """The blocks of a file, whose lines are counted from a number on."""
        state, index = self._interpreter.control_state, len(self.blocks)
        for item in read_blocks(replace(source, before=source.before + before), self.dialect, self._axes):
            if isinstance(item, PlainRun):
                for line in range(0, len(item), CHUNK_BLOCKS):
                    self.runs[index + line] = item.part(line, min(line + CHUNK_BLOCKS, len(item)))
                yield from map(item.block, range(len(item)))
                index += len(item)
            else:
                yield decide(item, state.setup.block_skip, self._interpreter.notes)
                index += 1

    def _link(self, blocks: Iterable[Block], folder: Path | None) -> int:
        """Add the blocks of a file, which is called if it has a folder; returns how many they are."""
        own = self.source.folder if folder is None else folder
        linked = self.dialect.link(list(blocks), lambda: self._names(folder), folder is not None, own)
        self.blocks += linked
        return len(linked)

    def _names(self, folder: Path | None) -> set[str]:
        """Names by which a program of a folder may call others, but those that pass unchanged by the user's choice."""
        return self.found.names(folder) - {f"%{name}" for name in self._interpreter.control_state.setup.pass_through}

    def _check_dialect(self, source: Source, path: Path) -> None:
        """NotKnown for a file that is clearly of another dialect."""
        own = evidence(path.suffix.lower(), source.text_head)
        if own.dialect != self.dialect.name and definite(own):
            raise NotKnown(
                f"{path} is {TITLES[own.dialect]} because {own.reason}, and the program that calls it is "
                f"{TITLES[self.dialect.name]}: call a program of one dialect"
            )

    def _refuse_same_output(self, found: Found) -> None:
        main = Path(self.source.name).name if self.source.data is None else ""
        for each in self.called:
            if each.name.upper() == found.name.upper():
                raise NotKnown(
                    f"{found.path} and {each.source.name} are both called, and their corrections would have one name, "
                    f"{found.name}: rename one of them"
                )
        if found.name.upper() == main.upper():
            raise NotKnown(f"{found.path} has the name of the main program: rename it")


def called_files(source: Source, dialect: Dialect, setup: Setup, main: Path | None = None) -> CalledFiles:
    """The files that a program may call: of its folder, and of those of the set-up.

    main: folder of the main program, if this is another one.
    """
    own = [folder for folder in (source.folder, main) if folder is not None]
    folders = list(dict.fromkeys((*own, *map(Path, setup.subprograms))))
    return CalledFiles(folders, dialect.names, posted_suffix(source.name) if dialect.name == "iso" else "")


def names_in_text(dialect: Dialect, files: CalledFiles) -> re.Pattern[str] | None:
    """Pattern of the names of programs that a block may call by their name alone; None if there is none."""
    return _words(map(shown_name, files.names())) if dialect.calls_by_name else None


def _words(names: Iterable[str]) -> re.Pattern[str] | None:
    words = sorted(names)
    return re.compile(rf"(?<!\w)(?:{'|'.join(map(re.escape, words))})(?!\w)", re.IGNORECASE) if words else None


def calls_in(source: Source, dialect: Dialect, setup: Setup, scope: Scope) -> Iterator[str]:
    """The names of programs that a program calls, whether or not the call runs; without those that it calculates."""
    files = called_files(source, dialect, setup)
    names = {shown_name(name) for name in files.names()} if dialect.calls_by_name else set()
    head = _head(source, dialect)
    for piece in source.pieces():
        data = piece.upper()
        patterns = (dialect.calls, _words(name for name in names if name.encode(ENCODING) in data))
        text = piece.decode(ENCODING)
        lines = {_line(text, match.start()) for pattern in patterns if pattern for match in pattern.finditer(text)}
        for line in lines:
            try:
                blocks = dialect.link([*head, dialect.read_block(1, line)], files.names, False, source.folder)
            except Refusal:
                continue
            yield from _called(blocks, scope)


def _head(source: Source, dialect: Dialect) -> list[Block]:
    """The blocks that must stay before all others, which may give the folder of the program on the control."""
    found = []
    for line in source.text_head.splitlines(keepends=True)[:HEAD_LINES]:
        with suppress(Refusal):
            found.append(dialect.read_block(1, line))
    return [block for block in found if dialect.is_head(block)]


def _line(text: str, at: int) -> str:
    """The line of a text at a place."""
    end = text.find("\n", at)
    return text[text.rfind("\n", 0, at) + 1 : len(text) if end < 0 else end + 1]


def _called(blocks: Iterable[Block], scope: Scope) -> Iterator[str]:
    """The names of programs in the statements of blocks."""
    for block in blocks:
        code = block.code or Code()
        for step in (*code.before, *code.after):
            inner = step.call if isinstance(step, Modal) else step.then if isinstance(step, When) else step
            name = inner.name if isinstance(inner, Call) else inner.value if isinstance(inner, Assign) else ""
            with suppress(NotKnown):
                value = name if isinstance(name, str) else evaluate(name, scope)
                if isinstance(value, str) and value:
                    yield value
