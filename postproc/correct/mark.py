"""Mark of a corrected program: it prevents a second correction and identifies the set-up of the correction."""

from __future__ import annotations

import hashlib
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path, PurePath
from typing import IO, NamedTuple

from kinematics.error_model.model import ErrorModel
from kinematics.files import fingerprint
from kinematics.machine import Machine
from kinematics.user_error import UserError
from kinematics.version import VERSION
from postproc.control.state import ControlState
from postproc.dialects import Dialect
from postproc.text.block import Block
from postproc.text.notes import Notes
from postproc.text.source import ENCODING, HEAD_SIZE, Source, open_source

_MARK = re.compile(
    r"NCOMP (?P<version>\d\S*) MACHINE (?P<machine>\S+) CALIBRATION (?P<calibration>[0-9A-F]+)"
    r"(?: PROGRAM (?P<program>[0-9A-F]+))?(?: SETUP (?P<setup>[0-9A-F]+))?(?: DATUM (?P<datum>[0-9A-F]+))?"
    r"(?: TEXT (?P<text>[0-9A-F]+))?"
)
_PLAIN = re.compile(r"[^A-Z0-9_.-]")
NAME_LENGTH = 20
"""Largest number of characters of the machine name in a mark, which must fit on the lines of old controls."""
FINGERPRINT_DIGITS = 8
"""Number of hexadecimal digits in the fingerprints of set-up, datum and text."""
FINGERPRINT_DECIMALS = 6
"""Decimals of mm and degrees in the text of a fingerprint."""
MARK_COPIED_BYTES = 1 << 20
"""Bytes of a program that are copied together."""
CONVERTED = {"to-axes": " TCP TO-AXES", "to-tcp": " TCP TO-TCP", "": ""}
"""The end of the mark of a converted program, by `--tcp`."""
PARTS = ("calibration", "set-up", "datum")
"""Parts of a mark, by the names of `ncomp verify --accept`."""


class Mark(NamedTuple):
    """Fingerprints of the correction of a program, upper case; None if the mark does not contain one."""

    calibration: str
    setup: str | None = None
    """Fingerprint of the geometry of the machine and of the work offsets and tools that the program uses."""
    datum: str | None = None
    """Fingerprint of the datum entries of these work offsets."""

    def differs(self, here: Mark) -> dict[str, tuple[str, str]]:
        """Known differences, by the names PARTS: the fingerprint in this mark, and the one here."""
        pairs = zip(PARTS, self, here, strict=True)
        return {name: (own, other) for name, own, other in pairs if own and other and own != other}


def mark_of(model: ErrorModel, state: ControlState) -> Mark:
    """The mark for a calibration and the set-up that a program has used in its run."""
    return Mark(model.id.upper(), _short(_setup_lines(state)), _short(_datum_lines(state)))


def mark_line(
    dialect: Dialect,
    machine: Machine,
    mark: Mark,
    source: Source,
    accepted: Iterable[str] = (),
    called: str = "",
    *,
    text_hash: str,
) -> str:
    """Comment line for a corrected program; upper case and plain characters, so that the oldest control reads it.

    called: the end of the mark of a called program, or of a converted one; text_hash: fingerprint of the corrected
    text without this line.
    """
    name = _PLAIN.sub("_", machine.name.upper())[:NAME_LENGTH]
    text = f"NCOMP {VERSION} MACHINE {name} CALIBRATION {mark.calibration} PROGRAM {source.hash.upper()}"
    text += "".join(f" {word} {value}" for word, value in (("SETUP", mark.setup), ("DATUM", mark.datum)) if value)
    text += f" TEXT {text_hash}"
    names = ",".join(sorted(accepted)).upper()
    text += (f" ACCEPTED {names}" if names else "") + called
    return dialect.comment.format(text) + source.line_end


def called_by(caller: str | PurePath) -> str:
    """The end of the mark of a called program, with the name of the file of the main program."""
    return f" CALLED BY {_PLAIN.sub('_', PurePath(caller).name.upper())}"


UNCHANGED = " CALLED"
"""The end of the mark of a called program without a correction, which is alike for all main programs."""


def mark_in(text: str) -> Mark | None:
    """The mark in the text of a block; None if there is none."""
    match = _MARK.search(text) if "NCOMP" in text else None
    return Mark(match["calibration"], match["setup"], match["datum"]) if match else None


def mark_in_program(source: Source) -> Mark | None:
    """The mark of a corrected program, of its last correction; None if there is none."""
    found = None
    for _, text in _lines_with_name(source):
        found = mark_in(text) or found
    return found


def _lines_with_name(source: Source) -> Iterator[tuple[int, str]]:
    """Numbered lines of a program with the name of ncomp: marks, and tags of added blocks."""
    if not source.has_line_feeds:
        yield from ((number, text) for number, text in source.lines() if "NCOMP" in text)
        return
    before = source.before + 1
    for piece in source.pieces():
        counted, at = 0, piece.find(b"NCOMP")
        while at >= 0:
            start, end = piece.rfind(b"\n", 0, at) + 1, piece.find(b"\n", at) + 1 or len(piece)
            before += piece.count(b"\n", counted, start)
            yield before, piece[start:end].decode(ENCODING)
            counted, at = start, piece.find(b"NCOMP", end)
        before += piece.count(b"\n", counted)


class Statement(NamedTuple):
    """What the mark of a program says, and whether the text is still the one of the correction."""

    version: str
    """Version of ncomp."""
    machine: str
    calibration: str
    program: str | None
    """Fingerprint of the original program."""
    setup: str | None
    datum: str | None
    text: str | None
    """Fingerprint of the corrected text."""
    found: str
    """Fingerprint of the text now."""
    line: int
    """Line of the mark."""
    words: str
    """The mark."""

    @property
    def edited(self) -> bool | None:
        """Whether the text was changed after the correction; None for a mark that does not say it."""
        return None if self.text is None else self.text != self.found


def statement_in(source: Source) -> Statement | None:
    """What the mark of a program's last correction says; None for a program without one."""
    marks = [(number, match) for number, text in _lines_with_name(source) if (match := _MARK.search(text)) is not None]
    if not marks:
        return None
    line, match = marks[-1]
    of_text = TextHash()
    of_text.add(source.mark.encode(ENCODING))
    for number, text in source.lines():
        if number != line:
            of_text.add(text.encode(ENCODING))
    return Statement(**match.groupdict(), found=str(of_text), line=line, words=match.string.strip())


def called_by_program(path: Path) -> Iterator[tuple[Path, Statement]]:
    """The corrected files in the folder of a program whose marks name it as their caller, with what the marks say."""
    words = called_by(path).strip()
    for other in sorted(each for each in path.parent.rglob("*") if each.is_file() and each != path):
        with other.open("rb") as file:
            head = file.read(HEAD_SIZE).decode(ENCODING)
        if words not in head:
            continue
        statement = statement_in(open_source(str(other)))
        if statement is not None and re.search(rf"{re.escape(words)}(?![\w.-])", statement.words):
            yield other, statement


def conversions_in_program(source: Source) -> list[str]:
    """`to-axes` or `to-tcp` for each conversion of a program by ncomp, in their order."""
    marks = (text for _, text in _lines_with_name(source) if mark_in(text) is not None)
    return [name for text in marks for name, words in CONVERTED.items() if words and words in text]


def refuse_marked(blocks: Iterable[Block], dialect: Dialect, notes: Notes, *, force: bool) -> None:
    """Refusal for a block of a corrected program, and for a variable that corrections use; `force`: a note instead."""
    for block in blocks:
        used = dialect.own.search(block.text) if dialect.own is not None and not force else None
        if used is not None:
            raise block.refuse(f"{used[0].upper()} is a variable for the corrections of ncomp: use another one")
        mark = mark_in(block.text)
        if mark is None:
            continue
        if not force:
            raise block.refuse(
                f"the program is already corrected by ncomp (calibration {mark.calibration}); --force corrects it again"
            )
        notes.add(f"already corrected (calibration {mark.calibration}) and corrected again", block.line)


def check_mark(name: str, mark: Mark, here: Mark, accepted: frozenset[str]) -> list[str]:
    """Notes on differences between the correction of program `name` and `here`; UserError if not accepted."""
    found = [
        f"{name} was corrected with another {part}: its mark has {own}, here it is {other}"
        for part, (own, other) in mark.differs(here).items()
    ]
    refused = [part for part in mark.differs(here) if part not in accepted]
    if refused:
        raise UserError(
            f"{'; '.join(found)}: give the calibration, machine, offsets, tool lengths and datums of the correction; "
            f"--accept {','.join(refused)} continues nevertheless"
        )
    return found


def mark_index(dialect: Dialect, blocks: Sequence[Block]) -> int | None:
    """Index of the block before which the mark is inserted: the first after the head; None if there is none yet.

    The head is tape mark, program number, BEGIN PGM and the comments around them.
    """
    return next((i for i, b in enumerate(blocks) if b.kind != "blank" and not dialect.is_head(b)), None)


class TextHash:
    """Fingerprint of a text without its carriage returns: a transfer to a control may change the ends of lines."""

    def __init__(self) -> None:
        self._found = hashlib.sha256()

    def add(self, text: bytes) -> None:
        """Take the next part."""
        self._found.update(text.translate(None, b"\r"))

    def __str__(self) -> str:
        """The fingerprint of all parts so far."""
        return self._found.hexdigest()[:FINGERPRINT_DIGITS].upper()


class MarkedOutput:
    """Collects a program with room for its mark, which is known only after the whole program has run."""

    def __init__(self, lines: IO[bytes]) -> None:
        """`lines`: an empty file for the lines of the program."""
        self._lines, self._room = lines, -1
        self._number, self._hash = "", TextHash()

    @property
    def text_hash(self) -> str:
        """Fingerprint of all lines so far."""
        return str(self._hash)

    @property
    def has_room(self) -> bool:
        """True if there is room for the mark."""
        return self._room >= 0

    def write(self, text: bytes) -> None:
        """Write lines."""
        self._lines.write(text)
        self._hash.add(text)

    def leave_room(self, number: str = "") -> None:
        """Leave room for the mark here, after the number of its block."""
        self._room, self._number = self._lines.tell(), number

    def finish(self, mark: str, out: IO[bytes]) -> None:
        """Write the program, with the mark if there is room for it."""
        self._lines.seek(0)
        if self.has_room:
            out.write(self._lines.read(self._room))
            out.write((self._number + mark).encode(ENCODING))
        shutil.copyfileobj(self._lines, out, MARK_COPIED_BYTES)


def _short(lines: Iterable[str]) -> str:
    return fingerprint("\n".join(lines).encode())[:FINGERPRINT_DIGITS].upper()


def _setup_lines(state: ControlState) -> Iterable[str]:
    """Set-up that a program has used, one entry per line, in a fixed order."""
    setup = state.setup
    yield setup.machine.chain_hash
    for name in sorted(state.used_offsets):
        yield f"{name} {_numbers(state.work_offset(name))} {_numbers(setup.turned.get(name, ()))}"
    for tool in sorted(state.used_tools):
        yield f"T{tool} {_numbers((state.tool_length(tool), state.tool_radius(tool) or 0.0))}"
    for line, values in sorted(setup.datums.items()):
        yield f"#{line} {_by_axis(values)}"
    if setup.start:
        yield f"start {_by_axis(setup.start)}"


def _by_axis(values: Mapping[str, float]) -> str:
    return " ".join(f"{axis}{_numbers((value,))}" for axis, value in sorted(values.items()))


def _datum_lines(state: ControlState) -> Iterable[str]:
    """Datum entries of the work offsets that a program has used, one per line."""
    for name in sorted(state.used_offsets):
        datum = state.setup.datum(name)
        at = " ".join(f"{axis}{_numbers((value,))}" for axis, value in sorted(datum.at.items()))
        probe = "" if datum.probe is None else _numbers((datum.probe,))
        yield f"{name} probed @ {at} probe {probe}" if datum.probed else f"{name} true"


def _numbers(values: Iterable[float]) -> str:
    return " ".join(f"{round(value, FINGERPRINT_DECIMALS) + 0.0:.{FINGERPRINT_DECIMALS}f}" for value in values)
