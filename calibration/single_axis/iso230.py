"""ISO 230-2:2014: positioning of one axis at a time, from repeated runs to target positions in both directions.

Values at each target i, from n runs in a direction: the mean deviation x_i, the estimator s_i of the standard
uncertainty (with n - 1), the reversal value B_i = x_i forward - x_i backward, the repeatability R_i = 4 s_i, and that
of both directions, max(2 s_i forward + 2 s_i backward + |B_i|, R_i forward, R_i backward). Values of the axis:

| | |
|---|---|
| B, mean B | largest size of the B_i; their mean, signed |
| E forward, backward, both | range of the mean deviations (systematic deviation) |
| M | range of the means of both directions |
| R forward, backward, both | largest R_i |
| A forward, backward, both | largest x_i + 2 s_i minus smallest x_i - 2 s_i (coverage factor 2) |

The uncertainty of these values from the instrument, U with k = 2, follows ISO/TR 230-9. It is propagated to first order
(GUM) from the instrument specification: u in um of each reading, independent, and u_m in um per m, one scale for the
whole test (wavelength, alignment, thermal expansion). Each value is a sum of a_c x_c + b_c s_c over the cells c that
form the extremes (a target in a direction, with n_c readings, at p_c in m). Therefore

    U = 2 sqrt(u^2 sum(a_c^2 / n_c + b_c^2 / (n_c - 1)) + (u_m sum(a_c p_c))^2)

because a reading changes s by (x - mean) / ((n - 1) s) of its own change. The scale cancels in B and R. Drift between
runs is contained in the s_i and not in U; the specification does not give it, and a drift test is needed for it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from calibration.instruments import Interferometer
from calibration.measurement.measurement import Measurement
from calibration.single_axis.cells import BACKWARD, DIRECTIONS, FORWARD, cells_of
from calibration.single_axis.disagreeing_readings import Astray, disagreeing, from_the_others, named
from calibration.single_axis.missing_readings import one_way_remarks, remarks
from kinematics.basis import BSpline
from kinematics.effects import Backlash, ErrorMotion, unit_of
from kinematics.effects.base import own_component, own_motion
from kinematics.machine import Machine, NDArrayBool
from kinematics.transforms import Array
from kinematics.user_error import UserError
from rendering.shown import Shown

ORDER = ("B", "mean", "E", "M", "R", "A")
"""Order of the values, by the first word of their symbols."""
TARGET_DECIMALS = 6
"""Decimals, mm or degrees, to which target positions are rounded; equal ones are one target."""


class Value(NamedTuple):
    """A value of the axis with its expanded uncertainty from the instrument."""

    symbol: str
    title: str
    value: float
    U: float
    """Expanded uncertainty, k = 2."""


class TableRow(NamedTuple):
    """One row of an error table."""

    position: float
    """Target position, mm or degrees."""
    error: float
    """Mean deviation, um or urad."""
    u: float
    """Standard uncertainty of the error (k = 1): sqrt((s^2 + u^2) / n + (u_m p)^2), s pooled over the axis, p from its
    first target."""
    n: int


class Readings(NamedTuple):
    """Readings `(n,)` in the order of acquisition."""

    target: Array
    """Target positions, mm or degrees."""
    direction: np.ndarray
    """FORWARD or BACKWARD."""
    deviation: Array
    """Measured minus target, um or urad."""


@dataclass(frozen=True, repr=False)
class AxisTest(Shown):
    """The readings of one axis in cells `(2, m)` of direction and target, forward first; um, urad for a rotary axis."""

    axis: str
    """Name of the axis, or of a diagonal: `X+Y-Z`."""
    rotary: bool
    """True for a rotary axis, with degrees and urad instead of mm and um."""
    positions: Array
    """Target positions `(m,)`, mm or degrees, ascending."""
    count: np.ndarray
    """Number of readings by direction and position."""
    mean: Array
    """Mean deviation `(2, m)`; NaN without a reading."""
    spread: Array
    """Estimator s `(2, m)`; NaN for fewer than two readings."""
    first: float
    """First measured target, mm or degrees."""
    u: float
    """Standard uncertainty of a reading (k = 1)."""
    u_per_m: float
    """Standard uncertainty of the scale, um per m (k = 1); 0 for a rotary axis."""
    notes: tuple[str, ...]
    """Notes for the user."""
    astray: tuple[Astray, ...] = ()
    """Readings that disagree with the others of their target and direction; they count in every value."""
    without: tuple[Value, ...] = ()
    """The values of the axis without them; empty where there are none."""
    others: Mapping[str, tuple[Value, ...]] = field(default_factory=dict)
    """The values by older standards."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        values = ", ".join(f"{each.symbol} {each.value:.3g}" for each in self.values[:4])
        return f"{self.axis}: {values} {self.unit}"

    @property
    def diagonal(self) -> bool:
        """True for a diagonal, `X+Y-Z`, in place of an axis."""
        return not self.axis.isalnum()

    @property
    def unit(self) -> str:
        """Unit of deviations."""
        return unit_of(self.axis)[0]

    @property
    def position_unit(self) -> str:
        """Unit of targets."""
        return "deg" if self.rotary else "mm"

    @property
    def both(self) -> NDArrayBool:
        """Mask `(m,)` of the targets with readings in both directions."""
        return np.asarray((self.count > 0).all(axis=0))

    @property
    def reversal(self) -> Array:
        """Reversal values B_i `(m,)`, forward minus backward; NaN without readings in both directions."""
        return np.asarray(self.mean[FORWARD] - self.mean[BACKWARD])

    @property
    def one_way_notes(self) -> tuple[str, ...]:
        """Notes where E or A of both directions leaves out targets that make it larger; empty otherwise."""
        values = {each.symbol: each.value for each in self.values}
        return tuple(one_way_remarks(self.axis, self.unit, values))

    @property
    def values(self) -> tuple[Value, ...]:
        """The values of the axis that the readings allow."""
        return self.values_with(2.0)

    def values_with(self, k: float) -> tuple[Value, ...]:
        """The values with k estimators s to each side of a mean in A, and 2 k in R."""
        found = []
        for direction, name in enumerate(DIRECTIONS):
            cells = np.zeros((2, len(self.positions)), bool)
            cells[direction] = True
            found += self._ranges(cells, name, f" {name}", k)
        if self.both.any():
            found += self._reversals()
            cells = np.broadcast_to(self.both, (2, len(self.positions)))
            found += self._ranges(cells, "", ", both directions", k)
        return tuple(sorted(found, key=lambda value: ORDER.index(value.symbol.split()[0])))

    def table(self, direction: int) -> tuple[TableRow, ...]:
        """The error table of one direction, FORWARD or BACKWARD."""
        u = np.hypot(self._random()[direction], self._scale())
        return tuple(
            TableRow(
                float(self.positions[i]), float(self.mean[direction, i]), float(u[i]), int(self.count[direction, i])
            )
            for i in np.flatnonzero(self.count[direction]).tolist()
        )

    def effects(self, machine: Machine) -> tuple[ErrorMotion | Backlash, ...]:
        """Effects of the machine: a table of the mean of both directions, and the backlash between them.

        For one direction only: its table. Standard uncertainties as in the tables, k = 1.
        """
        if self.diagonal:
            raise UserError(f"{self.axis}: a diagonal moves several axes, and has no error motion of its own")
        directions = [direction for direction in (FORWARD, BACKWARD) if self.count[direction].any()]
        used = (self.count[directions] > 0).all(axis=0)
        if used.sum() < 2:
            raise UserError(f"axis {self.axis}: an error table needs at least two targets")
        _, _, sign = own_motion(machine, self.axis)
        random = self._random()[directions][:, used]
        u = np.hypot(np.sqrt((random**2).sum(axis=0)) / len(directions), self._scale()[used])
        motion = ErrorMotion(
            component=own_component(self.axis),
            axis=self.axis,
            basis=BSpline(tuple(self.positions[used].tolist()), 1),
            parameters=tuple((sign * self.mean[directions][:, used].mean(axis=0)).tolist()),
            u=tuple(u.tolist()),
            note=f"ISO 230-2, {' and '.join(DIRECTIONS[direction] for direction in directions)}",
        )
        if len(directions) == 1:
            return (motion,)
        width, u_width = -float(self.reversal[used].mean()), float(np.sqrt((random**2).sum())) / int(used.sum())
        return motion, Backlash(axis=self.axis, width=width, u=(u_width,), note="ISO 230-2, minus mean B")

    def json(self) -> dict[str, Any]:
        """The test as JSON; keys contain the units."""
        p, e = self.position_unit, self.unit
        return {
            "axis": self.axis,
            "values": self.listed(self.values),
            "targets": [
                {
                    f"position_{p}": float(self.positions[i]),
                    **{
                        name: {
                            f"mean_{e}": _number(self.mean[direction, i]),
                            f"s_{e}": _number(self.spread[direction, i]),
                            "runs": int(self.count[direction, i]),
                        }
                        for direction, name in enumerate(DIRECTIONS)
                    },
                    f"B_{e}": _number(self.reversal[i]),
                }
                for i in range(len(self.positions))
            ],
            "notes": list(self.notes),
            "astray": [
                {"where": each.where, "run": each.run, f"deviation_{e}": each.deviation} for each in self.astray
            ],
            "values_without_astray": {value.symbol: value.value for value in self.without},
            "other_standards": {standard: self.listed(values) for standard, values in self.others.items()},
        }

    def listed(self, values: Iterable[Value]) -> dict[str, dict[str, float]]:
        """Values by their symbols, as JSON."""
        return {each.symbol: {f"value_{self.unit}": each.value, f"U_{self.unit}": each.U} for each in values}

    def _reversals(self) -> list[Value]:
        where = np.flatnonzero(self.both)
        largest = where[np.argmax(np.abs(self.reversal[where]))]
        one, every = np.zeros((2, 2, len(self.positions)))
        one[:, largest] = signed_size(self.reversal[largest])
        every[:, where] = np.array([[1.0], [-1.0]]) / len(where)
        middle = np.zeros((2, len(self.positions)))
        centres = self.mean[:, where].mean(axis=0)
        middle[:, where[np.argmax(centres)]] += 0.5
        middle[:, where[last_least(centres)]] -= 0.5
        none = np.zeros_like(one)
        return [
            self.combined("B", "reversal value", one, none),
            self.combined("mean B", "mean reversal value (forward minus backward)", every, none),
            self.combined("M", "mean bidirectional positioning deviation, range", middle, none),
        ]

    def _ranges(self, cells: np.ndarray, name: str, title: str, k: float) -> list[Value]:
        """E, R and A over the cells of a mask `(2, m)`."""
        found = []
        measured = cells & (self.count > 0)
        if measured.any():
            mean, none = self._span(measured, self.mean, self.mean), np.zeros(cells.shape)
            found.append(self.combined(f"E {name}".strip(), f"systematic deviation{title}", mean, none))
        repeated = cells & (self.count > 1)
        if name == "":
            repeated &= repeated.all(axis=0)
        if repeated.any():
            high, low = self.mean + k * self.spread, self.mean - k * self.spread
            mean, spread = self._span(repeated, high, low), np.zeros(cells.shape)
            spread[_highest(repeated, high)] += k
            spread[_highest(repeated, -low, last=True)] += k
            found += [
                self._repeatability(repeated, name, title, k),
                self.combined(f"A {name}".strip(), f"accuracy{title}", mean, spread),
            ]
        return found

    def _span(self, cells: np.ndarray, high: Array, low: Array) -> Array:
        """Factors `(2, m)` of the means in the difference of the highest and the lowest."""
        mean = np.zeros(cells.shape)
        mean[_highest(cells, high)] += 1.0
        mean[_highest(cells, -low, last=True)] -= 1.0
        return mean

    def _repeatability(self, cells: np.ndarray, name: str, title: str, k: float) -> Value:
        mean, spread = np.zeros((2, *cells.shape))
        where = _highest(cells, self.spread)
        spread[where] = 2.0 * k
        if name == "":
            across = np.where(cells.all(axis=0), k * self.spread.sum(axis=0) + np.abs(self.reversal), -np.inf)
            widest = int(np.argmax(across))
            if across[widest] >= 2.0 * k * self.spread[where]:
                spread[:] = 0.0
                spread[:, widest] = k
                mean[:, widest] = signed_size(self.reversal[widest])
        return self.combined(f"R {name}".strip(), f"repeatability{title}", mean, spread)

    def combined(self, symbol: str, title: str, mean: Array, spread: Array) -> Value:
        """The value with these factors `(2, m)` of the means and of the s_i, and its U."""
        used_means, used_spreads = mean != 0, spread != 0
        value = np.sum(mean[used_means] * self.mean[used_means]) + np.sum(
            spread[used_spreads] * self.spread[used_spreads]
        )
        by_reading = np.sum(mean[used_means] ** 2 / self.count[used_means])
        by_reading += np.sum(spread[used_spreads] ** 2 / (self.count[used_spreads] - 1))
        by_scale = self.u_per_m * 1e-3 * float(np.sum(mean * self.positions))
        U = 2.0 * float(np.hypot(self.u * np.sqrt(by_reading), by_scale))
        return Value(symbol, title, float(value) + 0.0, U)

    def _pooled(self) -> float:
        """Pooled s of all cells; 0 without repeated readings."""
        degrees_of_freedom = np.maximum(self.count - 1, 0)
        squares = np.where(degrees_of_freedom > 0, np.nan_to_num(self.spread) ** 2 * degrees_of_freedom, 0.0).sum()
        return float(np.sqrt(squares / max(degrees_of_freedom.sum(), 1)))

    def _random(self) -> Array:
        """Standard uncertainties of the means `(2, m)` from the independent errors of readings."""
        return np.asarray(np.sqrt((self._pooled() ** 2 + self.u**2) / np.maximum(self.count, 1)))

    def _scale(self) -> Array:
        """Standard uncertainties `(m,)` from the scale, relative to the first target."""
        return np.asarray(self.u_per_m * 1e-3 * np.abs(self.positions - self.first))


def evaluate(measurement: Measurement) -> tuple[AxisTest, ...]:
    """The tests of all axes in interferometer data, in the order of the machine's axes; UserError for other data."""
    if not measurement.axis_rows:
        raise UserError(f"{measurement.source}: ISO 230-2 needs data of an interferometer (axis by axis)")
    measurement = measurement.rows(np.flatnonzero(measurement.positioning))
    if not len(measurement):
        raise UserError(f"{measurement.source}: ISO 230-2 needs positioning deviations, and the data contain none")
    return tuple(_axis_test(measurement, name) for name in measurement.machine.names if name in measurement.axis_rows)


def _axis_test(measurement: Measurement, name: str) -> AxisTest:
    machine, instrument = measurement.machine, Interferometer.expect(measurement.instrument)
    rows = measurement.axis_rows[name]
    column = machine.index(name)
    axis = machine.axes[column]
    approach = measurement.state.need("approach", f"ISO 230-2 of {name}")[rows, column]
    if not np.all(approach):
        unknown = int(rows[np.argmin(np.abs(approach))])
        raise UserError(f"{measurement.where(unknown)}: the direction of approach of {name} to its target is unknown")
    target = np.round(measurement.state.position(machine, name)[rows], TARGET_DECIMALS) + 0.0
    direction = (approach < 0).astype(int)
    readings = measurement.observed[rows, 0] / unit_of(name)[1]
    u = instrument.u_um, 0.0 if axis.rotary else instrument.u_um_per_m
    return tested(measurement, name, rows, Readings(target, direction, readings), u, rotary=axis.rotary)


def tested(
    measurement: Measurement,
    name: str,
    rows: np.ndarray,
    read: Readings,
    u: tuple[float, float],
    *,
    rotary: bool,
) -> AxisTest:
    """The test of an axis, or of a diagonal, from its rows; u: of a reading, um, and of the scale, um per m (k = 1)."""

    invented = (f"{name}: the data are simulated, and describe no real machine",) if measurement.simulated else ()

    def test(kept: NDArrayBool) -> AxisTest:
        cells = cells_of(read.target[kept], read.direction[kept], read.deviation[kept])
        notes = tuple(remarks(name, "deg" if rotary else "mm", cells.positions, cells.counts))
        found = AxisTest(name, rotary, *cells, float(read.target[0]), *u, (*notes, *invented))
        return replace(found, notes=(*notes, *found.one_way_notes, *invented))

    whole = test(np.ones(len(rows), bool))
    away = from_the_others(read.target, read.direction, read.deviation)
    kept = ~disagreeing(away, u[0], int(np.count_nonzero(whole.count)))
    astray = tuple(named(measurement, rows[~kept], away[~kept]))
    return replace(whole, astray=astray, without=test(kept).values) if astray else whole


def _highest(cells: np.ndarray, values: Array, last: bool = False) -> tuple[int, int]:
    """The cell with the highest value in a mask; the first, or the last, of equal ones."""
    chosen = np.where(cells, values, -np.inf).reshape(-1)
    number = len(chosen) - 1 - np.argmax(chosen[::-1]) if last else np.argmax(chosen)
    direction, target = np.unravel_index(number, cells.shape)
    return int(direction), int(target)


def last_least(values: Array) -> int:
    """Index of the smallest value; the last of equal ones, so that a range of zero also has two different readings."""
    return len(values) - 1 - int(np.argmin(values[::-1]))


def signed_size(reversal: float) -> Array:
    """Factors `(2,)` of the means in |B_i|; not zero for B_i = 0, because noise alone makes it differ from zero."""
    return np.array([1.0, -1.0]) * (-1.0 if reversal < 0 else 1.0)


def _number(value: float) -> float | None:
    return None if np.isnan(value) else float(value)
