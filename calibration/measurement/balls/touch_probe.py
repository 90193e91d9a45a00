"""Touch probe and spheres in a measurement file: the probe's tip, the spheres, calibrated distances, and readings.

The tip is the one target on the tool. Each sphere is a set-up with an unknown centre, in the workpiece frame at zero
pose of the machine: the column `sphere` gives the station of a row. An observation is the vector from the centre to
the tip at the recorded positions: zero where the tip was found in the centre, minus the reading of an R-test otherwise.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

import numpy as np

from calibration.measurement.instruments import SQUARENESS_URAD
from calibration.measurement.measurement import Distance, Target
from calibration.measurement.text_table import Table
from kinematics.forward import forward
from kinematics.machine import Machine, Vector
from kinematics.transforms import Array, turn
from kinematics.user_error import UserError

TOUCH_PROBE = "touch-probe"
"""Kind of the instrument in a header."""
TIP, SPHERE, DISTANCE = "probe", "sphere", "distance"
"""Header keys: of the tip, and the first parts of those of spheres and of distances. The tip is the target `probe`."""
SPINDLE = "spindle_deg"
"""Header key of the angle by which the spindle was turned: another file, with the tip on the other side."""
SQUARENESS = "squareness_urad"
"""Header key of the expected size of squareness errors."""
LARGEST_SQUARENESS = 1e4
"""Largest accepted value of it, urad."""
PLAN_ID = "plan_id"
"""Header key of a plan of spheres, whose positions are not measured."""
READINGS = ("dx", "dy", "dz")
"""Position of the sphere's centre from the tip, mm, in the directions of the tool."""
NAME = re.compile(r'[^\s,:".]+')
"""Name of a sphere: without dots, which separate the two spheres of a distance."""


def is_touch_probe(table: Table) -> bool:
    """True for a table of a touch probe; also for points without an instrument whose header gives a probe's tip."""
    return table.entries["instrument"].value == TOUCH_PROBE if "instrument" in table.entries else TIP in table.entries


def refuse_plan(table: Table) -> None:
    """UserError for a plan of spheres, whose positions are not measured."""
    if PLAN_ID in table.entries:
        table.header_fault(
            PLAN_ID,
            "this file is a plan, its positions are not measured: ncomp touches LOG --plan PLAN.csv makes the data",
        )


def is_sphere_key(key: str) -> bool:
    """True for header keys of spheres and of distances between them."""
    return key.partition(".")[0] in (SPHERE, DISTANCE)


def read_tip(table: Table) -> tuple[dict[str, Target], np.ndarray]:
    """The tip as the one target, and the name of the target of each row `(n,)`; UserError without it."""
    if TIP not in table.entries:
        raise UserError(
            f"{table.source}: header line '# {TIP}: x y z' is missing: the tip of the probe from the spindle nose, mm"
        )
    for name, column in (("target", "one target, its tip"), ("station", "its spheres as set-ups: name them in sphere")):
        if name in table.names:
            raise UserError(f"{table.head} column {name}: a touch probe has {column}; remove this column")
    for key in table.entries:
        if key.partition(".")[0] in ("target", "table", "bed"):
            table.header_fault(key, f"a touch probe has one target, its tip (# {TIP}: x y z); remove this line")
    x, y, z = table.header_numbers(TIP, 3)
    turned = table.header_numbers(SPINDLE, 1)[0] if SPINDLE in table.entries else 0.0
    return {TIP: Target(_turned((x, y, z), turned), spindle_deg=turned)}, np.full(len(table), TIP)


def read_spheres(table: Table) -> dict[str, Vector]:
    """Approximate centres of the spheres, mm, by name; UserError for a sphere of a row that is not in the header."""
    spheres: dict[str, Vector] = {}
    for key in table.entries:
        first, dot, name = key.partition(".")
        if first == SPHERE:
            if not dot or not NAME.fullmatch(name):
                table.header_fault(key, f"expected {SPHERE}.NAME, the name without blanks and dots")
            x, y, z = table.header_numbers(key, 3)
            spheres[name] = x, y, z
    table.need_columns([SPHERE], "a touch probe")
    column = table.texts([SPHERE])[SPHERE]
    unknown = np.flatnonzero(~np.isin(column, list(spheres)))
    if len(unknown):
        row = int(unknown[0])
        known = f"has {', '.join(spheres)}" if spheres else "has no spheres"
        table.fault(
            row,
            SPHERE,
            f"{str(column[row])!r} is not in the header, which {known}: state about where its centre is, mm, in the "
            f"workpiece frame with all axes at 0 (# {SPHERE}.{column[row]}: x y z)",
        )
    return spheres


def read_distances(table: Table, spheres: dict[str, Vector]) -> tuple[Distance, ...]:
    """Calibrated distances between spheres; UserError for unknown spheres and for a length or u that is not above 0."""
    found: list[Distance] = []
    for key in table.entries:
        first, _, rest = key.partition(".")
        if first != DISTANCE:
            continue
        names = rest.split(".")
        if len(names) != 2 or names[0] == names[1]:
            table.header_fault(key, f"expected {DISTANCE}.A.B, the names of two spheres")
        for name in names:
            if name not in spheres:
                table.header_fault(key, f"sphere {name!r} is not in the header (# {SPHERE}.{name}: x y z)")
        if any({each.one, each.other} == set(names) for each in found):
            table.header_fault(key, "the distance of these spheres is given twice")
        length, u = table.header_numbers(key, 2)
        if length <= 0.0 or u <= 0.0:
            table.header_fault(key, "expected the distance and its standard uncertainty (k=1), mm, both above zero")
        found.append(Distance(names[0], names[1], length, u))
    return tuple(found)


def read_squareness(table: Table) -> dict[str, float]:
    """Expected size of squareness errors, urad, by header key; empty without it."""
    if SQUARENESS not in table.entries:
        return {}
    (size,) = table.header_numbers(SQUARENESS, 1)
    if not 0.0 <= size <= LARGEST_SQUARENESS:
        table.header_fault(SQUARENESS, f"{size:g} urad is no size of squareness errors (0 to {LARGEST_SQUARENESS:g})")
    return {SQUARENESS: size}


def read_observed(table: Table, machine: Machine, positions: Array) -> Array:
    """Vectors `(n, 3)`, mm, from the centre to the tip, in the workpiece frame; zeros without readings.

    The nominal rotation of the tool turns the readings of an R-test into the workpiece frame.
    """
    if not any(name in table.names for name in READINGS):
        return np.zeros((len(table), 3))
    table.need_columns(READINGS, "the readings of an R-test")
    readings = np.stack(list(table.numbers(READINGS).values()), axis=1)
    return -turn(forward(machine, positions).rotation, readings)


def readings(machine: Machine, positions: Array, observed: Array) -> dict[str, Array]:
    """Columns of the readings of an R-test; none where every row found the tip in the centre."""
    if not observed.any():
        return {}
    own = -turn(np.swapaxes(forward(machine, positions).rotation, 1, 2), observed)
    return {name: own[:, k] + 0.0 for k, name in enumerate(READINGS)}


def header_lines(
    tip: Target,
    spheres: Mapping[str, Vector],
    distances: tuple[Distance, ...],
    squareness_urad: float = SQUARENESS_URAD,
) -> Iterator[str]:
    """Header lines of the tip, the spheres, the distances and another squareness than the usual one, without `# `."""
    yield f"{TIP}: {_numbers(*_turned(tip.position, -tip.spindle_deg))}"
    if tip.spindle_deg:
        yield f"{SPINDLE}: {tip.spindle_deg!r}"
    for name, centre in spheres.items():
        if not NAME.fullmatch(name):
            raise UserError(f"sphere {name!r}: its name must not contain blanks, commas, colons or dots")
        yield f"{SPHERE}.{name}: {_numbers(*centre)}"
    for each in distances:
        yield f"{DISTANCE}.{each.one}.{each.other}: {_numbers(each.length, each.u)}"
    if squareness_urad != SQUARENESS_URAD:
        yield f"{SQUARENESS}: {squareness_urad!r}"


def _turned(tip: Vector, degrees: float) -> Vector:
    """The tip of a spindle that has turned about +z; digits beyond a picometre are rounding."""
    if not degrees:
        return tip
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    x, y = np.round([c * tip[0] - s * tip[1], s * tip[0] + c * tip[1]], 9).tolist()
    return x + 0.0, y + 0.0, tip[2]


def _numbers(*values: float) -> str:
    return " ".join(f"{value!r}" for value in values)
