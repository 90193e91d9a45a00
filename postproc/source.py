"""NC files as numbered lines of text that give the same bytes when written back."""

from __future__ import annotations

import hashlib
import io
import itertools
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from kinematics.errors import UserError

ENCODING = "latin-1"
"""Gives every byte a character and back, whatever the file's real encoding: only comments hold more than ASCII."""

BYTE_ORDER_MARK = "\xef\xbb\xbf"
HEAD_SIZE = 20_000
CHUNK = 4096
"""Blocks that are worked on together: enough for NumPy, few enough for the processor's cache."""
_CONTROLS = frozenset(range(32)) - frozenset(b"\t\n\r\x00\x0c\x1a")


@dataclass(frozen=True)
class Source:
    """A program to be read, more than once if need be; a file is never held in memory as a whole."""

    name: str
    head: str
    """Its beginning."""
    data: bytes | None = None
    """What came from standard input or another pipe."""
    origin: str = ""
    """Fingerprint of the program that this one was made from."""

    def open(self) -> io.BufferedReader | io.BytesIO:
        """The bytes from the start."""
        return Path(self.name).open("rb") if self.data is None else io.BytesIO(self.data)

    @cached_property
    def hash(self) -> str:
        """Fingerprint of the bytes, as `kinematics.files.fingerprint`."""
        if self.origin:
            return self.origin
        with self.open() as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()[:12]

    @property
    def size(self) -> int:
        """Number of bytes."""
        return Path(self.name).stat().st_size if self.data is None else len(self.data)

    @property
    def mark(self) -> str:
        """A byte order mark that stands in front of the first line, or nothing."""
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
            newline = "\n" if "\n" in self.head or "\r" not in self.head else "\r"
            with io.TextIOWrapper(stream, encoding=ENCODING, newline=newline) as text:
                yield from enumerate(text, start=1)


def open_source(path: str) -> Source:
    """The program in a file, `-` for standard input; UserError when it can't be read or is no NC text."""
    if path == "-":
        data = sys.stdin.buffer.read()
        source = Source("<stdin>", data[:HEAD_SIZE].decode(ENCODING), data)
    else:
        try:
            with Path(path).open("rb") as stream:
                head = stream.read(HEAD_SIZE)
                # a pipe can be read but once
                data = None if stream.seekable() else head + stream.read()
                source = Source(path, head.decode(ENCODING), data)
        except OSError as fault:
            raise UserError(f"program {path}: {fault.strerror or fault}") from None
    _check(source)
    return source


def chunks(items: Iterator[tuple[int, str]], size: int) -> Iterator[list[tuple[int, str]]]:
    """The items in lists of `size`."""
    while chunk := list(itertools.islice(items, size)):
        yield chunk


def _check(source: Source) -> None:
    head = source.head.encode(ENCODING)
    if not head.strip(b"\0 \t\r\n") and len(head) < HEAD_SIZE:
        raise UserError(f"program {source.name} is empty")
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise UserError(f"program {source.name} is UTF-16 text; save it as plain text (ASCII or UTF-8)")
    body = head.strip(b"\0")
    if b"\0" in body or not _CONTROLS.isdisjoint(body):
        raise UserError(f"program {source.name} is a binary file, no NC text")
