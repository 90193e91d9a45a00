"""Reading of continuous runs and quasi-static data of one axis (contract 4.2)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import NamedTuple, cast

import numpy as np

from calibration.continuous.records import DIRECTION_NAMES, QuasiStatic, Record
from calibration.measurement.readers import iso230_table, renishaw
from calibration.measurement.readers.text import given_entries
from calibration.measurement.states import DIRECTIONS, MADE_BY, is_simulated
from calibration.measurement.text_table import Table, parse_table, refuse_empty
from kinematics.files import read_input
from kinematics.files.text_cells import old_text
from kinematics.machine import Machine, make_axis
from kinematics.transforms import Array
from kinematics.user_error import UserError

RUN_COLUMNS = ("time_s", "displacement_mm", "run", "direction")
RUN_KEYS = ("machine", "instrument", "axis", "start_mm", "end_mm", "feed_mm_min", MADE_BY)
SAME_UM = 1e-6
STATE_COLUMN = re.compile(r"[A-CU-Z]\d?|time_s|feed|target|point|station|(dir|actual)_\w+|temp_\S+")
"""Other columns of a measurement file, which a run of one axis does not need."""
RECORD_HEAD_BYTES = 20_000
RECORD_TARGET_DECIMALS = 6
"""Decimals, mm, to which targets are rounded."""


class Data(NamedTuple):
    """Data of all files together."""

    axis: str
    records: tuple[Record, ...]
    quasi: QuasiStatic
    fingerprints: Mapping[str, str]
    """Fingerprint of the content, by file."""
    notes: tuple[str, ...]
    standing: tuple[Path, ...] = ()
    """Files of quasi-static data."""
    machine: str = ""
    """Name of the machine, if a file gives it."""
    simulated: bool = False
    """True if a file is of a virtual machine."""


class _File(NamedTuple):
    path: Path
    data: bytes
    reader: ModuleType | None
    """Reader of a foreign format, with quasi-static data."""
    table: Table | None
    """Content of a file in a format of the contract."""

    @property
    def continuous(self) -> bool:
        """True for a file of continuous runs."""
        return self.table is not None and "displacement_mm" in self.table.names


def read_all(paths: Sequence[Path], header: Mapping[str, str]) -> Data:
    """Continuous runs and quasi-static data, distinguished by their columns; UserError for data that cannot be used.

    `header`: values of header keys that are missing in the files or replace those in the files.
    """
    if not paths:
        raise UserError("data: no file is given: name the continuous runs and the quasi-static data")
    files = [_read(path, header) for path in paths]
    runs = [file.table for file in files if file.table is not None and file.continuous]
    names = ", ".join(map(str, paths))
    if not runs:
        raise UserError(f"{names}: no continuous run (columns time_s, displacement_mm) among them")
    if len(runs) == len(files):
        raise UserError(
            f"{names}: no quasi-static data (columns axis, run, direction, target_mm, deviation_um) among them; a "
            "continuous run alone does not show the scale and the datum of an axis"
        )
    notes: list[str] = []
    axis = _axis(runs)
    quasi_static = [_quasi_static_table(file, axis, header, notes) for file in files if not file.continuous]
    _refuse_copies([*runs, *quasi_static])
    _refuse_same_names(runs)
    _refuse_same_names(quasi_static)
    _refuse_other_machines([*runs, *quasi_static])
    records = tuple(record for table in runs for record in _records(table, len(runs) > 1, notes))
    parts = [
        _quasi(table, axis, f"{Path(table.source).name}:" if len(quasi_static) > 1 else "", notes)
        for table in quasi_static
    ]
    prints = {table.source: table.fingerprint for table in (*runs, *quasi_static)}
    standing = tuple(file.path for file in files if not file.continuous)
    tables = [*runs, *quasi_static]
    simulated = any(is_simulated(table) for table in tables)
    return Data(axis, records, _together(parts), prints, tuple(notes), standing, _machine(tables), simulated)


def _read(path: Path, header: Mapping[str, str]) -> _File:
    """Content of a file; foreign formats stay unread until the axis is known."""
    data = read_input(path, "measurement")
    refuse_empty(data, str(path))
    head = old_text(data[:RECORD_HEAD_BYTES]).replace("\r\n", "\n")
    for reader in (renishaw, iso230_table):
        if reader.recognises(head):
            return _File(path, data, reader, None)
    table = parse_table(data, str(path))
    if "displacement_mm" in table.names and "deviation_um" in table.names:
        raise UserError(f"{table.head}: displacement_mm is of a continuous run, deviation_um of quasi-static data")
    if "displacement_mm" not in table.names and "deviation_um" not in table.names:
        raise UserError(
            f"{table.head}: neither a continuous run (time_s, displacement_mm) nor quasi-static data (axis, run, "
            f"direction, target_mm, deviation_um); found {', '.join(table.names)}"
        )
    return _File(path, data, None, replace(table, entries={**table.entries, **given_entries(header, {})}))


def _quasi_static_table(file: _File, axis: str, header: Mapping[str, str], notes: list[str]) -> Table:
    """The table of quasi-static data."""
    if file.table is not None:
        return file.table
    assert file.reader is not None
    single = Machine(f"axis {axis}", "", (make_axis(axis, "tool", (-np.inf, np.inf)),))
    table, more = file.reader.to_table(file.data, str(file.path), single, header)
    notes += more
    return cast(Table, table)


def _machine(tables: Sequence[Table]) -> str:
    return next((table.entries["machine"].value for table in tables if "machine" in table.entries), "")


def _refuse_other_machines(tables: Sequence[Table]) -> None:
    named = [table for table in tables if "machine" in table.entries]
    for table in named[1:]:
        first = named[0].entries["machine"].value
        if table.entries["machine"].value != first:
            table.header_fault("machine", f"{table.entries['machine'].value}, {named[0].source} is of {first}")


def _refuse_copies(tables: Sequence[Table]) -> None:
    earlier: dict[str, str] = {}
    for table in tables:
        if table.fingerprint in earlier:
            raise UserError(f"{table.source} contains the same data as {earlier[table.fingerprint]}")
        earlier[table.fingerprint] = table.source


def _refuse_same_names(tables: Sequence[Table]) -> None:
    """UserError for two files of one name, in two folders: the names of their runs begin with it."""
    earlier: dict[str, str] = {}
    for table in tables:
        name = Path(table.source).name
        if name in earlier:
            raise UserError(
                f"{table.source} has the file name of {earlier[name]}, so their runs have one name: rename it"
            )
        earlier[name] = table.source


def _axis(runs: Sequence[Table]) -> str:
    """The axis of all continuous runs."""
    axis = ""
    for table in runs:
        if "axis" not in table.entries:
            raise UserError(f"{table.source}: header line '# axis: X' is missing")
        own = table.entries["axis"].value
        if not re.fullmatch(r"[UVWXYZ]\d?", own):
            table.header_fault("axis", f"{own!r} is no linear axis (X Y Z U V W)")
        if axis and own != axis:
            table.header_fault("axis", f"{own}, the other continuous run is of {axis}")
        axis = own
    return axis


# ---- continuous runs


def _records(table: Table, several: bool, notes: list[str]) -> Iterator[Record]:
    """The traverses in a file, one per run and direction."""
    table.allow_columns(lambda name: name in RUN_COLUMNS, RUN_COLUMNS)
    table.need_columns(RUN_COLUMNS[:2], "a continuous run")
    for key in table.entries:
        if key not in RUN_KEYS and not key.startswith("u_"):
            notes.append(f"{table.source}: header key {key!r} is unknown, and ignored")
    start, end, feed = _programmed_run(table)
    columns = table.numbers(RUN_COLUMNS[:2])
    run = table.texts(["run"])["run"] if "run" in table.names else np.full(len(table), "1")
    own = 1 if end > start else -1
    direction = _directions(table) if "direction" in table.names else np.full(len(table), own)
    low, high = sorted((start, end))
    passes = [(name, sign) for name in dict.fromkeys(run.tolist()) for sign in (1, -1)]
    prefix = f"{Path(table.source).name}:" if several else ""
    for name, sign in passes:
        rows = np.flatnonzero((run == name) & (direction == sign))
        if not len(rows):
            continue
        time = columns["time_s"][rows]
        back = np.flatnonzero(np.diff(time) <= 0.0)
        if len(back):
            table.fault(
                int(rows[back[0] + 1]),
                "time_s",
                f"{time[back[0] + 1]:g} does not follow {time[back[0]]:g} (runs in one file need a column run)",
            )
        yield Record(
            f"{prefix}{name} {DIRECTION_NAMES[sign]}",
            sign,
            time - time[0],
            columns["displacement_mm"][rows],
            low if sign > 0 else high,
            high if sign > 0 else low,
            feed,
            f"{table.source}:{table.lines[rows[0]]}",
        )


def _programmed_run(table: Table) -> tuple[float, float, float]:
    """Start and end, mm, and feed, mm/min, from the header."""
    for key in ("start_mm", "end_mm", "feed_mm_min"):
        if key not in table.entries:
            raise UserError(f"{table.source}: header line '# {key}: ...' is missing")
    (start,), (end,), (feed,) = (table.header_numbers(key, 1) for key in ("start_mm", "end_mm", "feed_mm_min"))
    if start == end:
        table.header_fault("end_mm", f"{end:g} is also the start: the run has no length")
    if feed <= 0.0:
        table.header_fault("feed_mm_min", f"{feed:g} is not above zero")
    return start, end, feed


def _directions(table: Table) -> np.ndarray:
    """Direction `(n,)`, 1 or -1."""
    texts = table.texts(["direction"])["direction"]
    unknown = np.flatnonzero(~np.isin(texts, list(DIRECTIONS)))
    if len(unknown):
        row = int(unknown[0])
        table.fault(row, "direction", f"{str(texts[row])!r} is none of {', '.join(DIRECTIONS)}")
    names, which = np.unique(texts, return_inverse=True)
    return np.array([DIRECTIONS[str(name)] for name in names])[which]


# ---- quasi-static data


def _quasi(table: Table, axis: str, prefix: str, notes: list[str]) -> QuasiStatic:
    """The quasi-static readings of the axis in a file."""
    known = ("axis", "run", "direction", "target_mm", "target_deg", "deviation_um", "deviation_urad")
    table.allow_columns(lambda name: name in known or STATE_COLUMN.fullmatch(name) is not None, known)
    table.need_columns(["axis", "run", "direction", "target_mm", "deviation_um"], "quasi-static data")
    if "instrument" in table.entries and table.entries["instrument"].value != "interferometer":
        table.header_fault("instrument", f"{table.entries['instrument'].value!r} is no interferometer")
    own = table.texts(["axis"])["axis"] == axis
    if not own.any():
        there = ", ".join(dict.fromkeys(table.texts(["axis"])["axis"].tolist()))
        raise UserError(f"{table.source}: no reading of axis {axis}, the axis of the continuous run; found {there}")
    if not own.all():
        notes.append(f"{table.source}: {np.count_nonzero(~own)} readings of other axes than {axis} not used")
    rows = np.flatnonzero(own)
    part = replace(table, rows=[table.rows[row] for row in rows.tolist()], lines=table.lines[rows])
    columns = part.numbers(["target_mm", "deviation_um"])
    _refuse_motion(part)
    _refuse_positions(part, axis, columns["target_mm"])
    _refuse_dead(part, columns["deviation_um"])
    u, u_per_m = _specification(table, notes)
    return QuasiStatic(
        np.round(columns["target_mm"], RECORD_TARGET_DECIMALS),
        columns["deviation_um"],
        _directions(part),
        np.char.add(prefix, part.texts(["run"])["run"]),
        u,
        u_per_m,
        table.source,
    )


def _refuse_motion(table: Table) -> None:
    """UserError for a reading recorded in motion."""
    if "feed" in table.names:
        moving = np.flatnonzero(table.numbers(["feed"])["feed"] != 0.0)
        if len(moving):
            table.fault(int(moving[0]), "feed", "recorded in motion: not a quasi-static reading")


def _refuse_dead(table: Table, deviations: Array) -> None:
    """UserError if all of several readings are equal."""
    if len(deviations) > 2 and np.ptp(deviations) == 0.0:
        raise UserError(
            f"{table.source}: all {len(deviations)} readings deviate by {deviations[0]:g} um: the instrument did not "
            "measure, or the wrong column was read"
        )


def _refuse_positions(table: Table, axis: str, targets: Array) -> None:
    """UserError if the column of the axis and the target disagree."""
    if axis in table.names:
        off = np.flatnonzero(np.abs(table.numbers([axis])[axis] - targets) > SAME_UM)
        if len(off):
            table.fault(int(off[0]), axis, f"not the target, {targets[off[0]]:g}")


def _specification(table: Table, notes: list[str]) -> tuple[float | None, float]:
    """Standard uncertainties of the instrument: reading, um; scale, um per m."""
    values: dict[str, float] = {}
    for key in ("u_um", "u_um_per_m"):
        if key in table.entries:
            (values[key],) = table.header_numbers(key, 1)
            if values[key] < 0.0:
                table.header_fault(key, f"{values[key]:g} is negative")
    if "u_um" not in values:
        notes.append(
            f"{table.source}: the uncertainty of the instrument is missing (# u_um:, # u_um_per_m:): u_um contains the "
            "scatter of the readings, but not the instrument's scale"
        )
    return values.get("u_um"), values.get("u_um_per_m", 0.0)


def _together(parts: Sequence[QuasiStatic]) -> QuasiStatic:
    """Data of several files together: the largest uncertainty of their instruments holds for all."""
    specified = [part.u for part in parts if part.u is not None]
    return QuasiStatic(
        np.concatenate([part.target for part in parts]),
        np.concatenate([part.deviation for part in parts]),
        np.concatenate([part.direction for part in parts]),
        np.concatenate([part.run for part in parts]),
        max(specified) if len(specified) == len(parts) else None,
        max(part.u_per_m for part in parts),
        ", ".join(part.source for part in parts),
    )
