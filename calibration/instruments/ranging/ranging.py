"""Ranging: distances alone, from stations with unknown positions to targets on the tool (sequential multilateration).

A range is the distance from a station to a target plus a dead length: the distance at which the counter of the
instrument was zero. It is new in each run, because a break of the beam begins one, and for each target. The frame of a
station has the directions of its base, and its origin in the station, so that only its shift is unknown.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from calibration.instruments.base import INDEPENDENT
from calibration.instruments.exact_numbers import joined
from calibration.instruments.of_points import OfDistances, centred_pose
from calibration.instruments.ranging.air import HELIUM_NEON_NM, refractive_index
from calibration.instruments.ranging.multilateration import Located, located
from calibration.registration.derived import derived
from calibration.registration.registration import SHIFTS, Registration
from kinematics.machine import Machine, Vector
from kinematics.state import REFERENCE_DEGC
from kinematics.transforms import Array
from kinematics.user_error import UserError

if TYPE_CHECKING:
    from calibration.instruments.targets import Distance
    from calibration.measurement.measurement import Measurement
    from calibration.measurement.states import MeasurementStates
    from calibration.measurement.text_table import Table
    from kinematics.effects import Effect
    from kinematics.transforms import Pose

RANGE = "range_mm"
"""Column of the readings."""
STATION, DEAD, DEAD_U = "station", "dead_mm", "dead_u_um"
"""First parts of header keys of stations and of their dead lengths; header key of the uncertainty of dead lengths."""
INDEX, WAVELENGTH = "assumed_index", "wavelength_nm"
"""Header keys of the refractive index to which the ranges refer, and of the wavelength in vacuum."""
AIR = ("temp_air", "pressure_hPa", "humidity_percent")
"""Columns of the air in the beam."""
AIR_LIMITS = {AIR[0]: (-40.0, 100.0), AIR[1]: (600.0, 1200.0), AIR[2]: (0.0, 100.0)}
"""Air for which the equation of the refractive index holds: degC, hPa, percent."""
UNNAMED = "1"
"""Name of the station without a column."""
VIRTUAL_DEAD_LENGTH_MM = 1000.0
"""Half-width of the dead lengths of a virtual instrument, mm: its counter is zeroed anywhere near the machine."""


class Ranging(OfDistances, frozen=True, tag="ranging"):
    """An interferometer that follows a target (LaserTRACER), or an absolute distance meter: ranges without angles."""

    PARTS = ("range",)
    OBSERVED = (RANGE,)
    OPTIONAL = AIR[1:]
    HEADER_KEYS = ("stands_on", DEAD_U, INDEX, WAVELENGTH)
    NEEDED = (("u_range_um", "u_range_um_per_m"),)
    STATIONED = True
    STATIONS = 4
    READS_RANGES = True
    ZERO_BY_BEAM = True
    CHECKS = ("places of stations", "points", "stated stations")
    MAY_BE_KNOCKED = True
    FOLLOWED_UP = True

    u_range_um: float = 0.0
    """Standard uncertainty of a range, um."""
    u_range_um_per_m: float = 0.0
    """Length-dependent part of it, um per m of distance."""
    dead_mm: tuple[tuple[str, float], ...] = ()
    """Stated dead lengths by station, mm."""
    dead_u_um: float | None = None
    """Standard uncertainty of stated dead lengths, of others from 0, um; None where the fit determines them alone."""
    components: Literal[1] = 1
    """Number of observed values in a row."""

    @classmethod
    def typical(cls) -> Ranging:
        """A LaserTRACER by its data sheet: U (k = 2) 0.2 um + 0.3 um/m, taken as k = 1 for the air and the target."""
        return cls(u_range_um=0.2, u_range_um_per_m=0.3)

    @classmethod
    def is_header_key(cls, key: str) -> bool:
        """Also the keys of stations and of their dead lengths."""
        return key.partition(".")[0] in (STATION, DEAD) or super().is_header_key(key)

    @classmethod
    def read_own(cls, table: Table) -> dict[str, Any]:
        """The dead lengths, and their uncertainty."""
        dead = {name: table.header_numbers(key, 1)[0] for key, name in _named(table, DEAD).items()}
        if DEAD_U not in table.entries:
            return {DEAD: tuple(dead.items())}
        (u,) = table.header_numbers(DEAD_U, 1)
        if u <= 0.0:
            table.header_fault(DEAD_U, f"{u:g} is not above 0; without this line the fit determines the dead lengths")
        return {DEAD: tuple(dead.items()), DEAD_U: u}

    @classmethod
    def read_set_ups(cls, table: Table) -> tuple[dict[str, Vector], tuple[Distance, ...]]:
        """About where the stations are."""
        stations: dict[str, Vector] = {}
        for key, name in _named(table, STATION).items():
            x, y, z = table.header_numbers(key, 3)
            stations[name] = (x, y, z)
        return stations, ()

    @classmethod
    def read_observed(cls, table: Table, machine: Machine, states: MeasurementStates) -> Array:
        """Ranges `(n, 1)`, mm."""
        table.need_columns(cls.OBSERVED, cls.kind())
        return table.numbers([RANGE])[RANGE][:, None]

    def placed(self, measurement: Measurement, table: Table) -> Measurement:
        """The measurement with the beams from its stations, and with ranges in the air of their rows."""
        registration = measurement.instrument.first_registration(measurement, np.ones(len(measurement), bool))
        beams = registration.apply(measurement, measurement.nominal_points)
        index = _index_shares(table, measurement)
        observed = measurement.observed
        if index is not None:  # with its dead path, the whole distance is in this air
            observed = observed + (np.linalg.norm(beams, axis=1) * (1.0 / index - 1.0))[:, None]
        return replace(measurement, observed=observed, state=replace(measurement.state, observed=beams))

    def zero_names(self, measurement: Measurement) -> np.ndarray:
        """The dead length of each row."""
        return dead_lengths(measurement)

    def first_registration(self, measurement: Measurement, trusted: np.ndarray) -> Registration:
        """Stations by multilateration of the trusted rows; dead lengths with their medians."""
        points, names = measurement.nominal_points, dead_lengths(measurement)
        poses, zeros = {}, dict.fromkeys(np.unique(names).tolist(), 0.0)
        for station in np.unique(measurement.groups).tolist():
            poses[station] = centred_pose(stations_of(measurement, station, trusted)[0].position)
            mine = np.flatnonzero(measurement.groups == station)
            off = measurement.observed[mine, 0] - np.linalg.norm(poses[station].apply(points[mine]), axis=1)
            for name in np.unique(names[mine]).tolist():
                own = names[mine] == name
                good = own & trusted[mine]
                zeros[name] = float(np.median(off[good if good.any() else own]))
        return Registration(poses, dict.fromkeys(poses, np.zeros(3)), SHIFTS, zeros)

    def stated_residuals(self, measurement: Measurement, registration: Registration) -> Array:
        """Stated minus present dead lengths `(k,)`, in standard uncertainties; empty where they are unknown."""
        if self.dead_u_um is None:
            return np.zeros(0)
        stated = self.stated_dead(measurement)
        off = [stated.get(name, 0.0) - zero for name, zero in registration.zeros.items()]
        return np.array(off) / (self.dead_u_um * 1e-3)

    def stated_design(self, measurement: Measurement, registration: Registration) -> Array:
        """See `InstrumentBase.stated_design`."""
        known = 0 if self.dead_u_um is None else len(registration.zeros)
        moves = len(registration.names) - len(registration.zeros)
        own = np.eye(len(registration.zeros))[:known] * (1.0 if self.dead_u_um is None else 1e3 / self.dead_u_um)
        return np.concatenate([np.zeros((known, moves)), own], axis=1)

    def stated_dead(self, measurement: Measurement) -> dict[str, float]:
        """Stated dead lengths, mm, by the names of dead lengths."""
        by_station, names = dict(self.dead_mm), dead_lengths(measurement)
        _, first = np.unique(names, return_index=True)
        stations = {str(names[row]): str(measurement.groups[row]).rpartition(":")[2] for row in first.tolist()}
        return {name: by_station[station] for name, station in stations.items() if station in by_station}

    def drawn_registration(
        self, blank: Measurement, poses: Mapping[str, Pose] | None, rng: np.random.Generator
    ) -> Registration:
        """The stations at the origins of the stated poses, with random dead lengths unless their size is stated."""
        if poses is None:
            raise UserError("the positions of the stations are missing: state --tracker x,y,z for each of them")
        placed = super().drawn_registration(blank, poses, rng)
        stations = {name: centred_pose(pose.inverse().translation[0]) for name, pose in placed.poses.items()}
        names = np.unique(dead_lengths(blank)).tolist()
        dead = rng.uniform(-VIRTUAL_DEAD_LENGTH_MM, VIRTUAL_DEAD_LENGTH_MM, len(names))
        if self.dead_u_um is not None:
            dead = rng.normal(0.0, self.dead_u_um * 1e-3, len(names))
        zeros = dict(zip(names, dead.tolist(), strict=True))
        return Registration(stations, dict.fromkeys(stations, np.zeros(3)), SHIFTS, zeros)

    def row_covariances(self, measurement: Measurement) -> Array:
        """Those of the distances, which are the ranges without their dead lengths."""
        beams = measurement.state.observed
        far = np.abs(measurement.observed[:, 0]) if beams is None else np.linalg.norm(beams, axis=1)
        return np.asarray((self.u_range_um * 1e-3 + self.u_range_um_per_m * 1e-6 * far) ** 2)[:, None, None]

    def would_show(self, measurement: Measurement, effects: Sequence[Effect]) -> str:
        """The stations or targets that would determine the effects for ranges."""
        missing = 3 - len(np.unique(measurement.groups))
        if missing > 0:
            stations = "one more station" if missing == 1 else f"{missing} more stations"
            return (
                f"ranges from {stations} in other directions would show it: a station sees errors along its beams only"
            )
        if any(effect.angular for effect in effects):
            return "three targets on the tool, not in one line, would show it"
        return INDEPENDENT

    def header_lines(self, measurement: Measurement) -> Iterator[str]:
        """The base on which the stations stand, about where they are, and their dead lengths."""
        yield f"stands_on: {measurement.stands_on}"
        yield from (f"{STATION}.{name}: {joined(position)}" for name, position in measurement.spheres.items())
        yield from (f"{DEAD}.{name}: {length!r}" for name, length in self.dead_mm)
        if self.dead_u_um is not None:
            yield f"{DEAD_U}: {self.dead_u_um!r}"

    def observed_columns(self, measurement: Measurement) -> dict[str, np.ndarray]:
        """The ranges."""
        return {RANGE: measurement.observed[:, 0]}


@derived
def dead_lengths(measurement: Measurement) -> np.ndarray:
    """Name `(n,)` of the dead length of each row: station, target, and run where there are runs."""
    target = np.array(list(measurement.targets))[measurement.target_number]
    names = np.char.add(np.char.add(measurement.groups.astype(str), " "), target.astype(str))
    return names if measurement.run is None else np.char.add(np.char.add(names, " "), measurement.run.astype(str))


def stations_of(measurement: Measurement, station: str, trusted: np.ndarray) -> list[Located]:
    """The positions of a station that its ranges allow, by the nominal machine; mostly one.

    The stated position, or the centre of the points, where there are too few ranges.
    """
    mine = measurement.groups == station
    rows = np.flatnonzero(mine & trusted if (mine & trusted).any() else mine)
    points, stated = measurement.nominal_points[rows], measurement.spheres.get(station)
    guess = None if stated is None else np.array(stated)
    _, number = np.unique(dead_lengths(measurement)[rows], return_inverse=True)
    if len(rows) < least_rows(int(number.max()) + 1):
        dead = np.zeros(int(number.max()) + 1)
        return [Located(points.mean(axis=0) + 1.0 if guess is None else guess, dead, np.inf)]
    return located(points, measurement.observed[rows, 0], number, guess)


def least_rows(dead: int) -> int:
    """Least number of ranges that determine a station with so many dead lengths, and one that checks them."""
    return 3 + dead + 1


def _named(table: Table, kind: str) -> dict[str, str]:
    """Names of stations by the header keys `station.s1` or `dead_mm.s1`; UserError for a station without rows."""
    keys = {key: key.partition(".")[2] for key in table.entries if key.partition(".")[0] == kind}
    if STATION not in table.names:
        if len(keys) > 1:
            raise UserError(f"{table.head}: the header has several stations, but the column {STATION} is missing")
        return dict.fromkeys(keys, UNNAMED)
    known = np.unique(table.texts([STATION])[STATION]).tolist()
    for key, name in keys.items():
        if name not in known:
            table.header_fault(key, f"no row has the station {name!r}; the column {STATION} has {', '.join(known)}")
    return keys


def _index_shares(table: Table, measurement: Measurement) -> Array | None:
    """Refractive index of each row by that to which its range refers `(n,)`; None where the instrument corrects it.

    UserError without all columns of the air, and for air that is none.
    """
    if INDEX not in table.entries:
        return None
    (assumed,) = table.header_numbers(INDEX, 1)
    if not 1.0 <= assumed < 1.001:
        table.header_fault(INDEX, f"{assumed:g} is no refractive index of air: expected about 1.00027, or 1 for vacuum")
    wavelength = table.header_numbers(WAVELENGTH, 1)[0] if WAVELENGTH in table.entries else HELIUM_NEON_NM
    table.need_columns(AIR, f"the header line '# {INDEX}: ...'")
    columns = table.numbers(AIR[1:]) | {AIR[0]: measurement.state.temperatures["air"] + REFERENCE_DEGC}
    for name, (low, high) in AIR_LIMITS.items():
        outside = (columns[name] < low) | (columns[name] > high)
        if outside.any():
            row = int(np.argmax(outside))
            table.fault(row, name, f"{columns[name][row]:g} is not within {low:g} to {high:g}")
    temperature, pressure, humidity = (columns[name] for name in AIR)
    return refractive_index(temperature, pressure, humidity, wavelength) / assumed
