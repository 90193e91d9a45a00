"""Circles of a ballbar by angle and deviation, as ballbar software shows and exports them.

    # u_um: 0.3
    # length_mm: 150
    # centre: 300 225 150
    # target.t1: 0 0 -120
    # plane: XY
    angle_deg,deviation_um,run,feed
    0.0,-1.2,ccw 1000,1000

Angles count from the first axis of the plane to the second (XY, YZ, ZX), of the tool ball about the table ball. The
deviation is that of the distance of the balls from the length of the bar; `radius_mm`, the distance, replaces it. The
circle has the length of the bar as its radius. Plane and feed are columns, or header lines for all rows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NoReturn

import numpy as np

from calibration.instruments.ballbar import CENTRE, LENGTH, RADIUS, Ballbar
from calibration.measurement.logged import is_clock, with_seconds
from calibration.measurement.readers import delimited
from calibration.measurement.text_table import Entry, Table, table_of
from kinematics.inverse import linear_positions
from kinematics.machine import Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError

ANGLE, DEVIATION, PLANE, FEED, DIRECTION, RUN = "angle_deg", "deviation_um", "plane", "feed", "direction", "run"
PLANES = {"XY": (0, 1), "YZ": (1, 2), "ZX": (2, 0)}
KNOWN = (ANGLE, DEVIATION, RADIUS, RUN, FEED, PLANE, DIRECTION, "time_s")
LARGEST_BALLBAR_UM = 2000.0
"""Deviation from which a row is no deviation in um."""
LARGEST_ANGLE_STEP_DEG = 30.0
"""Angle between rows of a run, degrees, from which the order of rows does not show the direction."""


def recognises(head: str) -> bool:
    """True for names of columns with an angle and a deviation or a radius."""
    return in_columns(delimited.names_in(head))


def in_columns(names: Sequence[str]) -> bool:
    """True for names of columns with an angle, and a deviation or a radius."""
    return ANGLE in names and (DEVIATION in names or RADIUS in names)


def to_table(data: bytes, source: str, machine: Machine, header: Mapping[str, str]) -> tuple[Table, list[str]]:
    """The file as a table of the contract's columns, and notes."""
    table, notes = delimited.plain_table(data, source, machine, header)
    found, more = of_angles(with_seconds(table), machine)
    return found, [*notes, *more]


def of_angles(table: Table, machine: Machine) -> tuple[Table, list[str]]:
    """The table with positions of the axes in place of angles, and notes; without a column run all is one run."""
    table.allow_columns(lambda name: name in KNOWN or is_clock(name), KNOWN)
    table.need_columns([ANGLE], "circles of a ballbar by angle")
    stated = table.entries.get("instrument", Entry(Ballbar.kind())).value
    if stated != Ballbar.kind():
        raise UserError(f"{table.head}: column {ANGLE}: angles are those of a ballbar, and the instrument is {stated}")
    radius = _readings(table)
    angles = table.numbers([ANGLE])[ANGLE]
    runs = table.texts([RUN])[RUN] if RUN in table.names else np.full(len(table), "1")
    _check_order(table, angles, runs)
    feeds = table.numbers([FEED])[FEED] if FEED in table.names else np.full(len(table), _entry(table, FEED, "1000"))
    positions = _positions(table, machine, angles)
    columns = {name: _texts(positions[:, i] / machine.scale[i]) for i, name in enumerate(machine.names)}
    columns |= {"run": runs.tolist(), "feed": _texts(feeds), RADIUS: _texts(radius)}
    columns |= {name: cells.tolist() for name, cells in table.texts([n for n in table.names if is_clock(n)]).items()}
    entries = {key: entry for key, entry in table.entries.items() if key not in (PLANE, FEED)}
    entries["instrument"] = Entry(Ballbar.kind())
    read = table_of(table.source, table.fingerprint, entries, columns, table.lines.tolist())
    notes = ["circles by angle: axis positions are those of the nominal circle about the stated centre"]
    return read, notes


def _texts(values: Array) -> list[str]:
    return [repr(round(float(value), 9)) for value in values]


def _readings(table: Table) -> Array:
    """Distances of the balls `(n,)`, mm."""
    if (DEVIATION in table.names) == (RADIUS in table.names):
        raise UserError(f"{table.head}: expected one of the columns {DEVIATION} and {RADIUS}")
    if RADIUS in table.names:
        return table.numbers([RADIUS])[RADIUS]
    deviation = table.numbers([DEVIATION])[DEVIATION]
    if np.any(np.abs(deviation) > LARGEST_BALLBAR_UM):
        row = int(np.argmax(np.abs(deviation) > LARGEST_BALLBAR_UM))
        table.fault(row, DEVIATION, f"{deviation[row]:g} um is no deviation of a circle; distances are {RADIUS}")
    return np.asarray(_entry(table, LENGTH, "150") + 1e-3 * deviation)


def _entry(table: Table, key: str, example: str) -> float:
    if key not in table.entries:
        _missing(table, key, example)
    (value,) = table.header_numbers(key, 1)
    return value


def _missing(table: Table, key: str, example: str) -> NoReturn:
    column = f" or a column {key}" if key in KNOWN else ""
    raise UserError(f"{table.source}: header line '# {key}: {example}'{column} is missing")


def _positions(table: Table, machine: Machine, angles: Array) -> Array:
    """Axis positions `(n, axes)`, mm and rad, that bring the tool ball to the angles on the nominal circle."""
    radius, targets = _entry(table, LENGTH, "150"), [key for key in table.entries if key.startswith("target.")]
    if len(targets) != 1:
        raise UserError(f"{table.source}: expected one header line '# target.NAME: x y z', found {len(targets)}")
    if CENTRE not in table.entries:
        _missing(table, CENTRE, "x y z")
    tool, centre = (np.array(table.header_numbers(key, 3)) for key in (targets[0], CENTRE))
    points = np.tile(centre, (len(table), 1))
    for row, name in enumerate(_planes(table)):
        if name not in PLANES:
            if PLANE in table.names:
                table.fault(row, PLANE, f"{name!r} is none of {', '.join(PLANES)}")
            table.header_fault(PLANE, f"{name!r} is none of {', '.join(PLANES)}")
        first, second = PLANES[name]
        angle = np.radians(angles[row])
        points[row, first] += radius * np.cos(angle)
        points[row, second] += radius * np.sin(angle)
    return linear_positions(machine, np.zeros((len(table), len(machine.axes))), points, tool)


def _planes(table: Table) -> list[str]:
    if PLANE in table.names:
        return [str(name) for name in table.texts([PLANE])[PLANE]]
    if PLANE not in table.entries:
        _missing(table, PLANE, "XY")
    return [table.entries[PLANE].value.strip()] * len(table)


def _check_order(table: Table, angles: Array, runs: np.ndarray) -> None:
    """UserError where the rows of a run are not in the order of its direction, which ncomp takes from them."""
    stated = table.texts([DIRECTION])[DIRECTION] if DIRECTION in table.names else None
    for run in dict.fromkeys(runs.tolist()):
        rows = np.flatnonzero(runs == run)
        if len(rows) < 2:
            continue
        steps = (np.diff(angles[rows]) + 180.0) % 360.0 - 180.0
        wide = np.flatnonzero(np.abs(steps) > LARGEST_ANGLE_STEP_DEG)
        turned = np.flatnonzero(np.sign(steps) != np.sign(np.median(steps)))
        for which, why in ((wide, f"a step of more than {LARGEST_ANGLE_STEP_DEG:g} degrees"), (turned, "a step back")):
            if len(which):
                row = int(rows[which[0] + 1])
                table.fault(row, ANGLE, f"{why} in run {run}: rows must be in the order of acquisition")
        way = "ccw" if np.median(steps) > 0.0 else "cw"
        wrong = rows[stated[rows] != way] if stated is not None else rows[:0]
        if stated is not None and len(wrong):
            row = int(wrong[0])
            given = str(stated[row])
            table.fault(row, DIRECTION, f"{given!r}, and the rows of run {run} go {way} (expected ccw or cw)")
