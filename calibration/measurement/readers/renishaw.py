"""Renishaw `.rtl`: runs of a laser interferometer to targets of one axis, exported by Laser10 and CARTO.

The manufacturer publishes no description. Five independent public readers and writers agree on this:

    TARGET DATA::  Target-count: n  |  Targets :  n numbers, over several lines, up to  Flags: ...
    USER-TEXT::    Machine:, Serial No:, Date:, By:, Axis:, Location:, TITLE:
    RUNS::         Run-count: m
    DEVIATIONS::   Run Target Data:  then a line of run, target (from 1), deviation for each reading
    EOF::

Sections may be missing or in another order; the text may be in any old encoding. Three of the five agree that
targets are mm and deviations um, measured minus target, in a linear measurement. For angular and straightness
measurements no two agree on the unit, so these are refused. The direction of a run follows from the order of its
targets: usually odd runs are forward and even ones backward. One writer fills the return runs of a test in one
direction (second number of `Flags:` 1) with zeros: a run of zeros alone is left out, with a note.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from calibration.measurement.readers.text import axis_named, given_entries
from calibration.measurement.text_table import Table, table_of
from kinematics.files import fingerprint
from kinematics.files.text_cells import number_at, numbered_lines
from kinematics.machine import Machine
from kinematics.user_error import UserError

_SECTION = re.compile(r"\s*([A-Z][A-Z -]*)::\s*")
_NOT_LINEAR = re.compile(r"ang|pitch|yaw|roll|straight|square|flat|rotary", re.I)
_ANOTHER_KIND = "is read only of linear measurements, whose unit (um) is known; convert it to the measurement file"


@dataclass
class _Content:
    targets: list[float] = field(default_factory=list)
    readings: list[tuple[int, int, float, int]] = field(default_factory=list)
    """Run, target, deviation, line."""
    texts: dict[str, str] = field(default_factory=dict)
    """`key: value` lines of all sections, keys in lower case."""


def recognises(head: str) -> bool:
    """True for the beginning of such a file."""
    return "TARGET DATA::" in head or ("HEADER::" in head and "RUNS::" in head)


def to_table(data: bytes, source: str, machine: Machine, header: Mapping[str, str]) -> tuple[Table, list[str]]:
    """The file as a table of the contract's columns, and notes. `header` may contain the axis and uncertainties."""
    content = _content(data, source)
    header = dict(header)
    axis = axis_named(header.pop("axis", content.texts.get("axis", "")).strip(), machine)
    if axis not in machine.names:
        raise UserError(
            f"{source}: Axis: {axis!r} is no axis of machine {machine.name} ({machine.chain}); state axis, one of these"
        )
    kinds = " ".join(content.texts.get(key, "") for key in ("filetype", "file type", "title"))
    if machine.axes[machine.index(axis)].rotary or _NOT_LINEAR.search(kinds):
        raise UserError(f"{source}: axis {axis}, {kinds.strip()!r}: .rtl {_ANOTHER_KIND}")
    notes = [f"read as a linear measurement of {axis}: targets in mm, deviations in um, measured minus target"]
    directions, names = _runs(content, source, notes)
    rows = [row for row in content.readings if row[0] in names]
    columns = {
        "axis": [axis] * len(rows),
        "run": [names[run] for run, *_ in rows],
        "direction": [directions[run] for run, *_ in rows],
        "target_mm": [repr(content.targets[target - 1]) for _, target, *_ in rows],
        "deviation_um": [repr(deviation) for _, _, deviation, _ in rows],
    }
    entries = given_entries(header, {"instrument": "interferometer"})
    return table_of(source, fingerprint(data), entries, columns, [line for *_, line in rows]), notes


def _content(data: bytes, source: str) -> _Content:
    content, section, listing = _Content(), "", ""
    for number, line in numbered_lines(data):
        head = _SECTION.fullmatch(line)
        if head:
            section, listing = head[1], ""
            continue
        key, colon, value = line.partition(":")
        if colon:
            listing = key.strip().lower()
            content.texts[listing] = value.strip()
        elif not line.strip():
            continue
        where = f"{source}:{number}"
        if section == "TARGET DATA" and listing == "targets":
            content.targets += [number_at(cell, where) for cell in (value if colon else line).split()]
        elif section == "DEVIATIONS" and listing == "run target data" and not colon:
            content.readings.append(_reading(line.split(), where, number, len(content.targets)))
    count = content.texts.get("target-count", "")
    if not content.targets or count != str(len(content.targets)):
        raise UserError(f"{source}: Target-count: {count or 'missing'}, but {len(content.targets)} targets are listed")
    if not content.readings:
        raise UserError(f"{source}: no readings below 'Run Target Data:' in DEVIATIONS::")
    return content


def _reading(cells: list[str], where: str, line: int, targets: int) -> tuple[int, int, float, int]:
    if len(cells) != 3 or not (cells[0].isdecimal() and cells[1].isdecimal()):
        raise UserError(f"{where}: {' '.join(cells)!r} is not 'run target deviation'")
    if not 1 <= int(cells[1]) <= targets:
        raise UserError(f"{where}: target {cells[1]} is none of {targets}")
    return int(cells[0]), int(cells[1]), number_at(cells[2], where), line


def _runs(content: _Content, source: str, notes: list[str]) -> tuple[dict[int, str], dict[int, str]]:
    """Direction, + or -, and name of each run, by its number; a forward run and its return share a name."""
    numbers = list(dict.fromkeys(run for run, *_ in content.readings))
    stated = content.texts.get("run-count", "")
    if stated and stated != str(len(numbers)):
        notes.append(f"Run-count: {stated}, but {len(numbers)} runs have readings")
    directions: dict[int, str] = {}
    names: dict[int, str] = {}
    for run in numbers:
        readings = [
            (content.targets[target - 1], deviation) for r, target, deviation, _ in content.readings if r == run
        ]
        steps = np.diff([position for position, _ in readings])
        if not any(deviation for _, deviation in readings):
            notes.append(f"run {run} is left out: all its deviations are 0, as of a run that was not measured")
            continue
        if len(steps) == 0 or not (np.all(steps > 0) or np.all(steps < 0)):
            raise UserError(f"{source}: run {run} passes its targets neither forward nor backward")
        directions[run] = "+" if steps[0] > 0 else "-"
        names[run] = str(list(directions.values()).count(directions[run]))
    flags = content.texts.get("flags", "").split()
    if len(flags) > 1 and flags[1] == "0" and len(set(directions.values())) == 1 and len(directions) > 1:
        raise UserError(
            f"{source}: Flags: {' '.join(flags)} means both directions, but all runs list their targets in the same "
            "order: the backward runs are unknown"
        )
    return directions, names
