"""NC files as numbered lines of text that give the same bytes when written back."""

from __future__ import annotations

import hashlib
import io
import itertools
import os
import re
import sys
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path

import msgspec

from kinematics.files import reason_of
from kinematics.files.inputs import note_input
from kinematics.files.mistaken import PROGRAM, kind_of_file, missing
from kinematics.user_error import UserError

ENCODING = "latin-1"
"""Gives every byte a character and back, for every real encoding of the file: only comments hold more than ASCII."""

BYTE_ORDER_MARK = "\xef\xbb\xbf"
HEAD_SIZE = 20_000
LONGEST_LINE = 1_000_000
"""Characters; a control takes some hundred, a line of a Klartext cycle's text a few thousand."""
CHUNK_BLOCKS = 16384
"""Blocks that are worked on together: enough for NumPy, few enough for the processor's cache."""
PIECE = 1 << 20
"""Bytes that are read together."""
_CONTROLS = frozenset(range(32)) - frozenset(b"\t\n\r\x00\x0c\x1a")

_ODD = re.compile(f"[{re.escape(''.join(map(chr, sorted({0, *_CONTROLS}))))}]")


class Source(msgspec.Struct, frozen=True, dict=True):
    """A program to be read, more than once if necessary; a file is never in memory as a whole."""

    name: str
    head: str
    """Its beginning."""
    data: bytes | None = None
    """The text from standard input or another pipe."""
    origin: str = ""
    """Fingerprint of the program that this one was made from."""
    before: int = 0
    """Number that is added to the numbers of its lines: of a text that ncomp makes, as of `line_numbers`."""
    state: tuple[int, int, int] | None = None
    """State of the file when it was opened first: it is read more than once and must not change."""

    def open(self) -> io.BufferedReader | io.BytesIO:
        """The bytes from the start; UserError where the file has changed since it was opened first."""
        if self.data is not None:
            return io.BytesIO(self.data)
        try:
            stream = Path(self.name).open("rb")  # noqa: SIM115
        except OSError as fault:
            raise UserError(f"program {self.name}: {fault.strerror or fault}{missing(self.name)}") from None
        self.check_unchanged(stream)
        return stream

    def check_unchanged(self, stream: io.BufferedReader | io.BytesIO) -> None:
        """UserError where the file has changed since it was opened first."""
        if self.state is not None and isinstance(stream, io.BufferedReader) and _state(stream) != self.state:
            raise UserError(f"program {self.name} was changed while it was read; run ncomp again when it is complete")

    @cached_property
    def hash(self) -> str:
        """Fingerprint of the bytes, as `kinematics.files.fingerprint`."""
        if self.origin:
            return self.origin
        with self.open() as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()[:12]

    @property
    def size(self) -> int:
        """Number of bytes; UserError where the file has vanished."""
        if self.data is not None:
            return len(self.data)
        try:
            return Path(self.name).stat().st_size
        except OSError as fault:
            raise UserError(f"program {self.name}: {fault.strerror or fault}") from None

    @property
    def folder(self) -> Path | None:
        """The folder of the file; None for a text, and for a program from a pipe."""
        return Path(self.name).parent if self.data is None else None

    @property
    def mark(self) -> str:
        """The byte order mark before the first line, if any."""
        return BYTE_ORDER_MARK if self.head.startswith(BYTE_ORDER_MARK) else ""

    @property
    def text_head(self) -> str:
        """The beginning behind a byte order mark, for finding the dialect."""
        return self.head.removeprefix(BYTE_ORDER_MARK)

    @property
    def line_end(self) -> str:
        """How its first line ends, a line feed when nothing shows it."""
        match = re.search(r"\r*\n|\r", self.head)
        return match[0] if match else "\n"

    def lines(self) -> Iterator[tuple[int, str]]:
        """Lines with their ends, numbered from 1, behind a byte order mark."""
        with self.open() as stream:
            stream.seek(len(self.mark))
            newline = "\n" if self.has_line_feeds else "\r"
            text = io.TextIOWrapper(stream, encoding=ENCODING, newline=newline)
            for number, line in enumerate(iter(lambda: text.readline(LONGEST_LINE), ""), start=self.before + 1):
                self.check_line(number, line)
                yield number, line
            self.check_unchanged(stream)

    def check_line(self, number: int, line: str) -> None:
        """UserError for a line, by its number in the file, that is no line of an NC program."""
        if len(line) >= LONGEST_LINE:
            raise UserError(
                f"{self.name}:{number}: a line of more than {LONGEST_LINE} characters: this is no NC program"
            )
        odd = _ODD.search(line)
        if odd and not _is_tape_end(line, number - self.before):
            raise UserError(f"{self.name}:{number}: {odd[0]!r} is no character of an NC program")

    @property
    def has_line_feeds(self) -> bool:
        """True if its lines end with line feeds, not with carriage returns alone."""
        return "\n" in self.head or "\r" not in self.head

    def pieces(self) -> Iterator[bytes]:
        """The bytes behind a byte order mark, in pieces of about PIECE bytes that end with a line feed.

        The last piece may end without one; a line that is much too long is cut.
        """
        with self.open() as stream:
            stream.seek(len(self.mark))
            rest = b""
            while read := stream.read(PIECE):
                rest += read
                end = rest.rfind(b"\n") + 1
                if end or len(rest) > LONGEST_LINE:
                    yield rest[: end or None]
                    rest = rest[end:] if end else b""
            if rest:
                yield rest
            self.check_unchanged(stream)


def open_source(path: str) -> Source:
    """The program in a file, `-` for standard input; UserError when it cannot be read or is no NC text."""
    if path == "-":
        if sys.stdin is None:
            raise UserError("program -: standard input is closed: name a file, or give the program by a pipe")
        data = sys.stdin.buffer.read()
        source = Source("<stdin>", data[:HEAD_SIZE].decode(ENCODING), data)
    else:
        note_input(path)
        try:
            with Path(path).open("rb") as stream:
                head = stream.read(HEAD_SIZE)
                # a pipe can be read but once
                data = None if stream.seekable() else head + stream.read()
                source = Source(path, head.decode(ENCODING), data, state=_state(stream))
        except OSError as fault:
            raise UserError(f"program {path}: {reason_of(fault)}{missing(path)}") from None
    _check(source)
    return source


def text_source(text: str, name: str = "<text>") -> Source:
    """The program in a text; UserError for a character beyond latin-1 and for a text that is no NC program."""
    try:
        data = text.encode(ENCODING)
    except UnicodeEncodeError as fault:
        raise UserError(f"program {name}: {text[fault.start]!r} is no character of an NC program") from None
    source = Source(name, text[:HEAD_SIZE], data)
    _check(source)
    return source


def chunks(items: Iterator[tuple[int, str]], size: int) -> Iterator[list[tuple[int, str]]]:
    """The items in lists of `size`."""
    while chunk := list(itertools.islice(items, size)):
        yield chunk


def _state(stream: io.BufferedReader) -> tuple[int, int, int]:
    """Identity of the file, its size, and the time of its last change."""
    found = os.fstat(stream.fileno())
    return found.st_ino, found.st_size, found.st_mtime_ns


def _is_tape_end(line: str, number: int) -> bool:
    """True for a line whose only control characters are the NULs that lead or trail a tape."""
    text = line.lstrip("\0") if number == 1 else line
    text = text if line.endswith(("\n", "\r")) else text.rstrip("\0")
    return not _ODD.search(text) or not text.strip("\0 \t\r\n")


def _check(source: Source) -> None:
    head = source.head.encode(ENCODING)
    if not head.removeprefix(BYTE_ORDER_MARK.encode(ENCODING)).strip(b"\0 \t\r\n"):
        if len(head) == HEAD_SIZE:
            raise UserError(
                f"program {source.name} begins with {HEAD_SIZE} blank or NUL characters: no NC text; give the file "
                "that the CAM has posted"
            )
        raise UserError(f"program {source.name} is empty: write it again from the CAM")
    kind = kind_of_file(head)
    if kind not in ("", PROGRAM):
        raise UserError(f"program {source.name}: this is {kind}, no NC program: give the file that the CAM has posted")
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise UserError(f"program {source.name} is UTF-16 text; save it as plain text (ASCII or UTF-8)")
    body = head.strip(b"\0")
    if b"\0" in body or not _CONTROLS.isdisjoint(body):
        raise UserError(f"program {source.name} is a binary file, no NC text: give the file that the CAM has posted")
