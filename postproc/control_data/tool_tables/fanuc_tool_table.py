"""FANUC's offsets: the control's output as a program of G10, or a plain list of lengths.

    G10 L10 P1 R120.5       length of H1            G10 L2 P1 X10. Y20. Z-300.      G54 (P2: G55 ... P6: G59)
    G10 L11 P1 R-0.02       its wear                G10 L20 P1 X5. Y6. Z7.          G54.1 P1
    G10 L12 P1 R5.          radius of D1            G10 L13 P1 R0.01                its wear

    H1 120.5                length of H1            H1 120.5 -0.02                  with its wear
    D1 5.0                  radius of D1

mm after G21, inches after G20, the unit of the control without either. Comments in parentheses or after a semicolon;
`%`, `O1234`, G90, G21 and M30 are ignored.
"""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

from kinematics.user_error import UserError
from postproc.control.tool_table import ToolTable
from postproc.control_data.tool_tables.form import Form

_UNITS = {"G20": 25.4, "G21": 1.0}
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)"
_WORDS = re.compile(rf"(?:[A-Z]\s*{_NUMBER}\s*)+", re.I)
_WORD = re.compile(rf"([A-Z])\s*({_NUMBER})", re.I)
_ENTRY = re.compile(rf"([HD])(\d+)\s+({_NUMBER})(?:\s+({_NUMBER}))?", re.I)
_BEGINS = re.compile(r"\s*(?:%|O\d+\s*$|(?:G(?:2[01]|90)\s*)+$|(?:N\d+\s*)?(?:G\d+\s*)*G10\b|[HD]\d+\s+[+-.\d])", re.I)
_UNIT = re.compile(r"G2[01](?!\d)", re.I)
_SILENT = frozenset(("G90", "G21", "G20", "G11", "M30", "M2", "M99"))
_OFFSETS = {n: f"G{53 + n}" for n in range(1, 7)}
_ROTARY = "ABC"
_LISTS = {10: "lengths", 11: "lengths", 12: "radii", 13: "radii"}


def _is_it(_: Path, text: str) -> bool:
    """True where the first line with content is one of these."""
    lines = (_plain(line) for line in text.splitlines())
    return _BEGINS.match(next((line for line in lines if line), "")) is not None


def _plain(line: str) -> str:
    return re.sub(r"\([^()]*\)|;.*", "", line).strip("\0 \t")


@dataclass
class _Lists:
    """The values that have been read."""

    unit: float | None = None
    """mm; None until G20 or G21."""
    values: dict[str, dict[str, float]] = field(default_factory=lambda: defaultdict(lambda: defaultdict(float)))
    """Lengths and radii by number, mm: geometry and wear, added."""
    given: set[tuple[int, str]] = field(default_factory=set)
    work_offsets: dict[str, dict[str, float]] = field(default_factory=dict)

    def add(self, kind: int, number: str, value: float) -> None:
        if (kind, number) in self.given:
            raise ValueError(f"{number} is given twice")
        self.given.add((kind, number))
        self.values[_LISTS[kind]][number] += value * (self.unit or 1.0)


def read(path: Path, text: str) -> ToolTable:
    """Lengths, radii and work offsets; UserError with the line that is not understood."""
    lists = _Lists()
    for i, line in enumerate(text.splitlines(), start=1):
        content = _plain(line)
        if not content or content.startswith("%"):
            continue
        try:
            _read_line(lists, content)
        except ValueError as fault:
            raise UserError(f"tool table {path}:{i}: {line.strip()!r}: {fault}") from None
    return ToolTable(dict(lists.values["lengths"]), lists.work_offsets, dict(lists.values["radii"]))


def _read_line(lists: _Lists, content: str) -> None:
    entry = _ENTRY.fullmatch(content)
    if entry is not None:
        kind = 10 if entry[1].upper() == "H" else 12
        lists.add(kind, entry[2], float(entry[3]))
        if entry[4] is not None:
            lists.add(kind + 1, entry[2], float(entry[4]))
        return
    if not _WORDS.fullmatch(content):
        raise ValueError("expected FANUC's offsets: G10 L10 P1 R120.5, or H1 120.5")
    words = [(address.upper(), value) for address, value in _WORD.findall(content) if address.upper() != "N"]
    codes = {f"{address}{float(value):g}" for address, value in words if address in "GM"}
    for unit in codes & _UNITS.keys():
        if lists.unit is None and (lists.values or lists.work_offsets):
            raise ValueError(f"{unit} follows lengths without a unit: write it before the first line of data")
        lists.unit = _UNITS[unit]
    others = {address: value for address, value in words if address not in "GM"}
    if len(others) + sum(address in "GM" for address, _ in words) < len(words):
        raise ValueError("an address is given twice")
    if codes - _SILENT - {"G10"}:
        raise ValueError(f"{', '.join(sorted(codes - _SILENT - {'G10'}))} may not be in a list of offsets")
    if "G10" in codes:
        _read_data(lists, others)
    elif others.keys() - {"O"}:
        raise ValueError("expected G10")


def _read_data(lists: _Lists, words: dict[str, str]) -> None:
    if not {"L", "P"} <= words.keys():
        raise ValueError("G10 needs L and P")
    kind, number = _count(words.pop("L")), _count(words.pop("P"))
    if kind in _LISTS and words.keys() == {"R"}:
        lists.add(kind, str(number), float(words["R"]))
        return
    name = f"G54.1P{number}" if kind == 20 else _OFFSETS.get(number) if kind == 2 else None
    if name is None or not words.keys() <= set("XYZABCUVW"):
        raise ValueError("this kind of data is unknown: expected L2, L20 with axes, or L10 to L13 with R")
    positions = {axis: float(value) * (1.0 if axis in _ROTARY else lists.unit or 1.0) for axis, value in words.items()}
    lists.work_offsets.setdefault(name, {}).update(positions)


def _count(text: str) -> int:
    number = float(text)
    if number != int(number):
        raise ValueError(f"{text} is not a whole number")
    return int(number)


FORM = Form(_is_it, read, has_unit=lambda text: any(_UNIT.search(_plain(line)) for line in text.splitlines()))
