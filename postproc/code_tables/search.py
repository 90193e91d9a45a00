"""Codes by their name or by words of their meaning."""

from __future__ import annotations

import re

import msgspec
from msgspec.structs import replace

from kinematics.files.mistaken import none_of
from kinematics.machine import Machine
from kinematics.user_error import UserError
from postproc.code_tables.entries import ANY_OTHER, CONTROLS, ENTRIES, CodeEntry
from postproc.code_tables.trials import FAMILIES, families_of

_CODE = re.compile(r"([GM])\s*(\d+(?:\.\d+)?)", re.IGNORECASE)
_CYCLE = re.compile(r"(?:CYCL\s+DEF|CYCLE|CYCL)\s+(\d+)(?:\.\d+)?", re.IGNORECASE)
_FUNCTION = re.compile(r"FN\s*(\d+):?", re.IGNORECASE)


class FoundCode(msgspec.Struct, frozen=True):
    """A code that was found, with the families of ISO controls that accept it."""

    entry: CodeEntry
    families: tuple[str, ...]

    @property
    def only_with(self) -> str:
        """The families of which the code needs one; empty where it needs none."""
        return "" if self.families == FAMILIES else " or ".join(self.families)


class Codes(msgspec.Struct, frozen=True):
    """The codes of a search, by dialect."""

    text: str
    """What was searched for."""
    family: str | None
    """Family of ISO controls; None for none in particular."""
    found: dict[str, list[FoundCode]]
    """The codes of each dialect."""

    @property
    def unknown(self) -> bool:
        """True where the text names one code, and no table has it."""
        return _named_code(self.text) != "" and not any(self.found.values())

    def json(self) -> dict[str, object]:
        """The codes for programs."""
        rows = [
            {**msgspec.structs.asdict(each.entry), "families": list(each.families)}
            for codes in self.found.values()
            for each in codes
        ]
        return {
            "text": self.text,
            "family": self.family,
            "controls": {dialect: CONTROLS[dialect] for dialect in self.found},
            "codes": rows,
            "other_codes": {dialect: ANY_OTHER[dialect] for dialect in self.found},
        }


def codes(text: str, machine: Machine | None, family: str | None, dialect: str | None) -> Codes:
    """The codes of a name, or with words, as a family reads them, by default that of a machine.

    UserError for a family or a dialect that there is not.
    """
    if family is not None and family not in FAMILIES:
        raise UserError(f"--family {none_of(family, FAMILIES)}")
    if dialect is not None and dialect not in ENTRIES:
        raise UserError(f"--dialect {none_of(dialect, list(ENTRIES))}")
    if machine is not None and family is None:
        family = machine.control.family
    passing = [] if machine is None else [_named_code(each) or each.upper() for each in machine.control.pass_through]
    tables = {name: list(entries()) for name, entries in ENTRIES.items() if dialect in (None, name)}
    named = {name: [entry for entry in table if _is_named(entry, text)] for name, table in tables.items()}
    if not any(named.values()) and not _named_code(text):
        named = {name: [entry for entry in table if _has_words(entry, text)] for name, table in tables.items()}
    found = {name: [_judged(entry, family) for entry in table] for name, table in named.items()}
    if (code := _named_code(text)) in passing and not any(found.values()):
        meaning = "accepted by pass_through in the machine file"
        found = {name: [FoundCode(CodeEntry(name, code, "passes", meaning), FAMILIES)] for name in found}
    return Codes(text, family, found)


def _judged(entry: CodeEntry, family: str | None) -> FoundCode:
    """An entry as a family reads it; None is no family in particular."""
    families = families_of(entry)
    if family is None or family in families:
        return FoundCode(entry, families)
    reason = f"{entry.meaning}: followed with family = {' or '.join(families)} only"
    return FoundCode(replace(entry, verdict="refused", meaning=reason), families)


def _named_code(text: str) -> str:
    """The code that a text names, as the tables write it; empty for other texts."""
    text = text.strip()
    if (code := _CODE.fullmatch(text)) is not None:
        return f"{code[1].upper()}{float(code[2]):g}"
    if (cycle := _CYCLE.fullmatch(text)) is not None:
        return f"cycle {int(cycle[1])}"
    if (function := _FUNCTION.fullmatch(text)) is not None:
        return f"FN {int(function[1])}"
    return ""


def _is_named(entry: CodeEntry, text: str) -> bool:
    """True for the code of this name."""
    code = _named_code(text) or text.strip()
    return entry.code.rstrip("=").casefold() == code.rstrip("=").casefold()


def _has_words(entry: CodeEntry, text: str) -> bool:
    """True for a code with all these words in its name and meaning."""
    within = f"{entry.code} {entry.meaning}".casefold()
    return all(word in within for word in text.casefold().split())
