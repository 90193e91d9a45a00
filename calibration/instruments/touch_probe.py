"""The touch probe: its tip, the spheres, calibrated distances, and readings in a measurement file.

The tip is the one target on the tool. Each sphere is a set-up with an unknown centre, in the workpiece frame at zero
pose of the machine: the column `sphere` gives the station of a row. An observation is the vector from the centre to
the tip at the recorded positions: zero where the tip was found in the centre, minus the reading of an R-test otherwise.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import permutations
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from calibration.instruments.base import LeastErrors, along_itself
from calibration.instruments.distances import distance_design, distance_residuals
from calibration.instruments.of_points import OfPoints
from calibration.instruments.targets import Distance, Target
from calibration.registration.registration import SHIFTS, Registration
from kinematics.forward import forward
from kinematics.machine import Machine, Vector
from kinematics.transforms import Array, Pose, turn
from kinematics.user_error import UserError

if TYPE_CHECKING:
    from calibration.measurement.measurement import Measurement
    from calibration.measurement.states import MeasurementStates
    from calibration.measurement.text_table import Table
    from kinematics.effects import Effect

SQUARENESS_URAD = 30.0
"""Squareness of linear axes of a machine in good order (k = 1), urad, the same as of its rotary axes.

Tolerances of acceptance are of this order: 0.02 mm over 500 mm, 40 urad. ISO 10791-1 and -2 are quoted with this
figure; their text was not at hand.
"""
TIP, SPHERE, DISTANCE, SHOWS = "probe", "sphere", "distance", "shows"
"""Header keys: of the tip, and the first parts of those of spheres, of distances, and of the directions that a ring or
a surface shows. The tip is the target `probe`."""
UNSEEN_COORDINATE_UM = 1e6
"""Standard uncertainty, um, of a coordinate that a feature does not show: a metre."""
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
MEANING = "they are the position of the sphere's centre from the tip, in the directions of the tool"
"""What the readings are, for messages."""
NAME = re.compile(r'[^\s,:".]+')
"""Name of a sphere: without dots, which separate the two spheres of a distance."""


class TouchProbe(OfPoints, frozen=True, tag="touch-probe"):
    """A touch probe in the spindle that finds the centres of spheres on the table, or an R-test that reads them."""

    PARTS = ("x", "y", "z")
    OBSERVED = (SPHERE, *READINGS)
    HEADER_KEYS = (TIP, SPINDLE, SQUARENESS)
    RECOGNISED_BY = TIP
    SET_UP = SPHERE
    MAY_BE_KNOCKED = True
    OWN_TIP = True
    FINDS_CENTRES = True
    DOUBTS = ("spheres", "tip")

    u_um: float = 0.0
    """Standard uncertainty of each coordinate of a sphere's centre, um."""
    squareness_urad: float = SQUARENESS_URAD
    """Expected size of the machine's squareness errors before the measurement (k = 1), urad."""
    shows: Mapping[str, str] = {}
    """Directions of the workpiece frame, `XY`, that a feature which is no sphere shows, by its name."""
    components: Literal[3] = 3
    """Number of observed values in a row."""

    @property
    def moves(self) -> tuple[str, ...]:
        """Those of a sphere: its orientation has no effect."""
        return SHIFTS

    @property
    def least_errors(self) -> LeastErrors:
        """Location errors: they come from assembly, not from the shapes of error motions.

        Spheres leave combinations of them to the prior.
        """
        return LeastErrors(typical_lines=True, squareness_urad=self.squareness_urad)

    @classmethod
    def is_header_key(cls, key: str) -> bool:
        """Also the keys of spheres and of distances between them."""
        return key.partition(".")[0] in (SPHERE, DISTANCE, SHOWS) or super().is_header_key(key)

    @classmethod
    def refuse_other_files(cls, table: Table) -> None:
        """UserError for a plan of spheres, whose positions are not measured."""
        refuse_plan(table)

    @classmethod
    def read_own(cls, table: Table) -> dict[str, Any]:
        """The expected size of squareness errors, and the directions of features that are no spheres."""
        return {**read_squareness(table), **read_shown(table)}

    @classmethod
    def read_targets(cls, table: Table) -> tuple[dict[str, Target], np.ndarray]:
        """The tip as the one target."""
        return read_tip(table)

    @classmethod
    def read_set_ups(cls, table: Table) -> tuple[dict[str, Vector], tuple[Distance, ...]]:
        """The centres of the spheres, and the calibrated distances between them."""
        spheres = read_spheres(table)
        return spheres, read_distances(table, spheres)

    @classmethod
    def read_observed(cls, table: Table, machine: Machine, states: MeasurementStates) -> Array:
        """Vectors `(n, 3)`, mm, from the centre to the tip."""
        return read_observed(table, machine, states.state.positions)

    def first_registration(self, measurement: Measurement, trusted: np.ndarray) -> Registration:
        """First centres of the spheres: medians over the trusted rows, where a sphere has any; UserError for others."""
        for name, shown in self.shows.items():
            raise UserError(
                f"{measurement.source} {SHOWS}.{name}: {' '.join(shown)}: a feature that is no sphere shows a drift "
                "(ncomp drift), and no errors of a machine: leave its rows out"
            )
        shifts, groups = measurement.observed - measurement.nominal_points, measurement.groups
        poses, centres = {}, {}
        for name in np.unique(groups).tolist():
            mine = groups == name
            rows = mine & trusted if (mine & trusted).any() else mine
            poses[name] = Pose(np.eye(3)[None], np.median(shifts[rows], axis=0)[None])
            centres[name] = np.zeros(3)
        return Registration(poses, centres, SHIFTS)

    def stated_residuals(self, measurement: Measurement, registration: Registration) -> Array:
        """Calibrated minus present distances between spheres `(k,)`, in standard uncertainties; exact."""
        return distance_residuals(measurement.distances, registration)

    def stated_design(self, measurement: Measurement, registration: Registration) -> Array:
        """Derivatives `(k, registration)` of the distances."""
        return distance_design(measurement.distances, registration)

    @classmethod
    def typical(cls) -> TouchProbe:
        """See `InstrumentBase.typical`."""
        return cls(u_um=1.0)

    def drawn_registration(
        self, blank: Measurement, poses: Mapping[str, Pose] | None, rng: np.random.Generator
    ) -> Registration:
        """See `InstrumentBase.drawn_registration`."""
        if poses is None:
            raise UserError("the spheres of the touch probe are missing: state --sphere NAME=x,y,z")
        return super().drawn_registration(blank, poses, rng)

    def row_covariances(self, measurement: Measurement) -> Array:
        """The same in each coordinate that the feature shows."""
        shown = [[axis in self.shows.get(name, "XYZ") for axis in "XYZ"] for name in measurement.groups.tolist()]
        return np.asarray(np.where(shown, self.u_um, UNSEEN_COORDINATE_UM)[:, :, None] ** 2 * 1e-6 * np.eye(3))

    def would_show(self, measurement: Measurement, effects: Sequence[Effect]) -> str:
        """The spheres, distances or tips that would determine the effects for a touch probe."""
        spheres = len(np.unique(measurement.groups))
        if all(along_itself(effect) for effect in effects):
            second = "a second sphere, and " if spheres == 1 else ""
            return (
                f"spheres have no scale: {second}the calibrated distance of two spheres (# distance.A.B: mm u) would "
                "show it, or an interferometer"
            )
        if spheres == 1:
            where = "at another height and farther from the lines of the rotary axes"
            return f"a second sphere, {where}, would show some of it"
        if any(effect.angular for effect in effects):
            return "a second tip would show some of it: a probe of another length, or a stylus to the side"
        return "more spheres, or rotary positions farther from each other, would show it"

    def header_lines(self, measurement: Measurement) -> Iterator[str]:
        """The tip, the spheres, and the distances."""
        placed = measurement.targets[TIP], measurement.spheres, measurement.distances
        yield from header_lines(*placed, self.squareness_urad)
        yield from (f"{SHOWS}.{name}: {' '.join(shown)}" for name, shown in self.shows.items())

    def observed_columns(self, measurement: Measurement) -> dict[str, np.ndarray]:
        """The readings of an R-test."""
        return {**readings(measurement.machine, measurement.state.positions, measurement.observed)}

    def other_readings(self, measurement: Measurement) -> Iterator[tuple[str, Measurement]]:
        """The measurement with each mistake in the readings of an R-test reversed in turn, and words for it.

        The readings of a machine under tool centre point are its errors alone: where their signs or frame are wrong,
        another machine is as plausible. Where the commanded positions lie beside the spheres, the readings have to
        bring the tip there.
        """
        machine, q = measurement.machine, measurement.state.positions
        of_head = np.array([axis.side == "tool" for axis in machine.axes]) & machine.rotary
        tool, bed = (forward(machine, positions).rotation for positions in (q, np.where(of_head, 0.0, q)))
        readings = -turn(tool.swapaxes(1, 2), measurement.observed)

        def read(by: str, frame: Array, own: Array) -> tuple[str, Measurement]:
            return f"{by} ({MEANING})", replace(measurement, observed=-turn(frame, own))

        yield read("with the signs of dx, dy and dz reversed", tool, -readings)
        for k, letter in enumerate(READINGS):
            yield read(f"with the sign of {letter} reversed", tool, readings * np.where(np.arange(3) == k, -1.0, 1.0))
        for order in list(permutations(range(3)))[1:]:
            columns = ", ".join(READINGS[k] for k in order)
            yield read(f"with the columns dx, dy, dz in the order {columns}", tool, readings[:, order])
        same = np.broadcast_to(np.eye(3), tool.shape)
        frames = {"the workpiece": same} if not of_head.any() else {"the workpiece": same, "the machine": bed}
        for name, frame in frames.items():
            for words, sign in (("", 1.0), (" and of the opposite sign", -1.0)):
                yield read(f"with dx, dy and dz in the directions of {name}{words}", frame, sign * readings)


def refuse_plan(table: Table) -> None:
    """UserError for a plan of spheres, whose positions are not measured."""
    if PLAN_ID in table.entries:
        table.header_fault(
            PLAN_ID,
            "this file is a plan, its positions are not measured: ncomp touches LOG --plan PLAN.csv makes the data",
        )


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


def read_shown(table: Table) -> dict[str, dict[str, str]]:
    """Directions that a ring or a surface shows, by its name; UserError for other directions. Empty without any."""
    found = {}
    for key, entry in table.entries.items():
        first, _, name = key.partition(".")
        if first == SHOWS:
            shown = "".join(entry.value.replace(",", " ").split()).upper()
            if not shown or len(set(shown)) != len(shown) or set(shown) - set("XYZ"):
                table.header_fault(
                    key, f"expected directions of the workpiece frame, X Y for a ring, got {entry.value!r}"
                )
            if f"{SPHERE}.{name}" not in table.entries:
                table.header_fault(key, f"feature {name!r} is not in the header (# {SPHERE}.{name}: x y z)")
            found[name] = shown
    return {SHOWS: found} if found else {}


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
