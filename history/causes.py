"""The causes that diagnoses of a machine have found, and which of them has changed."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import date
from itertools import zip_longest
from typing import TYPE_CHECKING, Any, NamedTuple

from history.entries import FoundCause
from kinematics.files.number_text import odds_by_log, plus_minus
from rendering.report import Section, Table

if TYPE_CHECKING:
    from history.schema import CauseRow, Entry

HEAD = ("date", "entry", "since", "cause", "change, U (k=2)", "before", "odds", "verdict")
NAME = re.compile(r"(?P<name>.+?)(?:_(?P<unit>(?:um|urad|mm|mrad|deg)(?:_per_\w+)?))?(?P<number> \d+)?")
"""A parameter with its unit, and its number in a row: width_um, weights_um 3."""


def of_diagnosis(effects: Iterable[Mapping[str, Any]]) -> list[FoundCause]:
    """The causes of the machine, from the `effects` in the results of `ncomp diagnose` for programs."""
    own = (each for each in effects if each["where"] == "machine")
    return [
        FoundCause(
            " ".join(filter(None, (each["kind"], each["axis"]))), each["verdict"], each["log10_odds"],
            list(_sizes(each["parameters"], each["u"], each["present"] or {})),
        )
        for each in own
    ]  # fmt: skip


def _sizes(values: Mapping[str, Any], u: Mapping[str, Any], before: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """The parameters, one number after the other; what is not known is None."""
    for key, value in values.items():
        rows = zip_longest(*(_row(each.get(key)) for each in (values, u, before)))
        for number, (one, own_u, old) in enumerate(rows, 1):
            name = key if isinstance(value, float | int) else f"{key} {number}"
            known = own_u if own_u is not None and math.isfinite(own_u) else None
            yield {"name": name, "value": one, "u": known, "before": old}


def _row(given: float | Sequence[float] | None) -> Sequence[float]:
    """A number, or a row of numbers, as a row; empty where none is given."""
    return [] if given is None else [given] if isinstance(given, float | int) else given


def cause_json(cause: CauseRow) -> dict[str, Any]:
    """A cause for programs; u with k = 1."""
    return {"name": cause.name, "verdict": cause.verdict, "log10_odds": cause.log10_odds, "sizes": cause.sizes}


class Compared(NamedTuple):
    """A diagnosis, and the calibration with which it was compared."""

    diagnosis: Entry
    before: Entry | None
    """None where the diagnosis had no calibration, or one that the history does not have."""


def compared(entries: Sequence[Entry]) -> list[Compared]:
    """The diagnoses that have causes, or a calibration before them, by time."""
    found = []
    for entry in entries:
        if entry.kind == "diagnosis":
            files = {file.fingerprint for file in entry.files} - {entry.fingerprint}
            before = next((each for each in entries if each is not entry and each.fingerprint in files), None)
            if entry.causes or before is not None:
                found.append(Compared(entry, before))
    return found


def causes_section(entries: Sequence[Entry]) -> Iterator[Section]:
    """The causes of all diagnoses; no section without any."""
    rows = [row for each in compared(entries) for row in _rows(each)]
    text = (
        "Causes that diagnoses have found. With a date 'since': what has changed from the calibration of this date, "
        "and its value before. Without one: all causes, with their sizes."
    )
    if rows:
        yield Section("Causes", text, Table(HEAD, rows))


def _rows(found: Compared) -> Iterator[tuple[str, ...]]:
    entry, since = found.diagnosis, "" if found.before is None else str(_day(found.before))
    if not entry.causes:
        yield str(_day(entry)), str(entry.id), since, "no cause has changed", "", "", "", ""
    for cause in entry.causes:
        before = [f"{each['before']:.2f}" for each in cause.sizes if each["before"] is not None]
        yield (
            str(_day(entry)), str(entry.id), since, cause.name, "; ".join(map(_size, cause.sizes)), "; ".join(before),
            odds_by_log(cause.log10_odds * math.log(10.0)), cause.verdict,
        )  # fmt: skip


def cause_of_change(entries: Sequence[Entry], first: date, last: date) -> str:
    """What changed between two dates by the last diagnosis across them, in a sentence; empty without one."""
    across = [
        each
        for each in compared(entries)
        if each.before is not None and _day(each.before) <= first and last <= _day(each.diagnosis)
    ]
    if not across:
        return ""
    entry, before = across[-1]
    assert before is not None
    which = ", ".join(map(_named, entry.causes)) or "none that the data show"
    return f"Which cause changed from {_day(before)} to {_day(entry)}, by diagnosis {entry.id}: {which}."


def _named(cause: CauseRow) -> str:
    return f"{cause.name} ({'; '.join(map(_size, cause.sizes))}, odds {odds_by_log(cause.log10_odds * math.log(10.0))})"


def _size(size: Mapping[str, Any]) -> str:
    """`width 5.98 ± 0.28 um`, of the parameter width_um."""
    value = f"{size['value']:.2f}" if size["u"] is None else plus_minus(size["value"], 2.0 * size["u"], 2)
    match = NAME.fullmatch(size["name"])
    assert match is not None
    name, unit = match["name"] + (match["number"] or ""), (match["unit"] or "").replace("_per_", "/")
    return f"{name} {value} {unit}".strip()


def _day(entry: Entry) -> date:
    return date.fromisoformat(entry.at[:10])
