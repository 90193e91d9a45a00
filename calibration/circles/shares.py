"""The shares of the causes of the deviations of circles: a linear model of the table's effects, selected by the data.

The deviations along the bar are linear in the sizes of the causes. Centre and length are always in the model. The
cause with the largest gain by BIC is added until none is significant, then those that others have made superfluous are
dropped. A cause is tied with another one that explains the data nearly as well in its place.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, permutations
from typing import Any, cast

import numpy as np

from calibration.circles.circles import Circle
from calibration.measurement.measurement import Measurement
from calibration.measurement.registration import Registration
from calibration.observation import equations
from calibration.observation.normal_equations import residuals
from calibration.plausibility.recording_mistakes import misfit
from kinematics.basis import Legendre
from kinematics.effects import (
    Backlash,
    Component,
    Cyclic,
    EffectBase,
    ErrorMotion,
    LateralPlay,
    LocationError,
    ReversalSpike,
    Scale,
    ServoMismatch,
)
from kinematics.effects.base import own_component
from kinematics.error_model.model import no_errors
from kinematics.transforms import Array

SIGNIFICANT = 12.0
"""Gain in BIC from which a cause is in the model, after the costs of its tries: odds of 400 to 1."""
TIED = 6.0
"""Difference in BIC up to which another cause in its place is tied: odds of 20 to 1."""
SAME = 1e-3
"""Difference in BIC below which the first of the candidates is taken: signals are the same."""
HIDDEN = 0.05
"""Share of the signal of a cause that centre, length and causes before it cannot imitate: below it, it is hidden."""
LENGTHS_MM = (0.03, 0.06, 0.12, 0.25, 0.5, 1.0, 2.0)
"""Ways over which a reversal spike decays that are tried, mm; refined."""
WAVES = 3.0
"""Rows in the shortest period of a cyclic error."""
LARGEST_PERIOD = 0.1
"""Longest period of a cyclic error, as a share of the range of its axis."""
OUTLYING = 6.0
"""Deviation of a row in robust standard deviations from which it is left out."""
MOST = 20
"""Largest number of causes."""


@dataclass(frozen=True)
class Group:
    """A cause with the columns of its signal."""

    kind: str
    where: str
    names: tuple[str, ...]
    """Names of its parameters with their units."""
    columns: Array
    """Signal along the bar `(n, k)`, um for each unit of the parameters."""
    shape: Mapping[str, float]
    """Values of the parameters that shape the columns, with units."""
    trials: float = 1.0
    """Number of independent shapes that were tried."""

    @property
    def name(self) -> str:
        """Name in reports: `backlash X`."""
        return f"{self.kind} {self.where}"


@dataclass(frozen=True)
class Share:
    """One cause in the result."""

    kind: str
    where: str
    parameters: Mapping[str, float]
    U: Mapping[str, float]
    """Expanded uncertainties, k = 2."""
    range_um: float
    """Range of its signal on the circles, without the part that looks like a shift or another radius."""
    share: float
    """Mean square of its signal as a share of that of all causes and of the unexplained residual."""
    delta_bic: float
    tied_with: tuple[str, ...]
    """Other causes that explain the data nearly as well in its place."""

    @property
    def name(self) -> str:
        """Name in reports: `backlash X`."""
        return f"{self.kind} {self.where}"

    def json(self) -> dict[str, Any]:
        """The share for programs."""
        return {
            "kind": self.kind, "where": self.where, "parameters": dict(self.parameters), "U": dict(self.U),
            "range_um": self.range_um, "share": self.share, "delta_bic": self.delta_bic,
            "verdict": "tied" if self.tied_with else "clear", "tied_with": list(self.tied_with),
        }  # fmt: skip


@dataclass(frozen=True)
class Shares:
    """The causes of the deviations, the largest share first, and the residuals with them."""

    causes: tuple[Share, ...]
    offset_um: Mapping[str, float]
    """Shift of the table ball from the stated centre in each direction that the circles show, um."""
    offset_u: Mapping[str, float]
    """Standard uncertainties of the shift, um."""
    before_um: float
    """RMS of the deviations from centre and radius, um."""
    unexplained_um: float
    """RMS of the residuals with the causes, um."""
    noise_um: float
    """Noise by the instrument's specification, um."""
    left_out: int
    """Number of rows that disagree with all others."""
    hidden: tuple[str, ...]
    """Causes whose signal centre and length imitate."""
    fitted: Array
    """Signal of all causes `(n,)` at the rows used, um."""
    rows: np.ndarray
    """Numbers of the rows used."""


def shares(measurement: Measurement, circles: Sequence[Circle]) -> Shares:
    """The shares of the causes in the deviations of the circles."""
    rows = np.sort(np.concatenate([each.rows for each in circles]))
    found = _Selection.of(measurement, rows).selected()
    off = found.left
    usual = 1.4826 * float(np.median(np.abs(off - np.median(off))))
    good = np.abs(off) <= OUTLYING * max(usual, found.u_um)
    if not good.all():
        found = _Selection.of(measurement, rows[good]).selected()
    return found.result(int(np.count_nonzero(~good)))


@dataclass(frozen=True)
class _Selection:
    """The rows, the causes that are tried, and those in the model."""

    measurement: Measurement
    rows: np.ndarray
    deviation: Array
    """Readings less those of the nominal machine about the first centre `(n,)`, um."""
    registration: Registration
    """First centre and length."""
    base: Array
    """Columns of centre and length `(n, m)`, um per mm."""
    transform: Array
    """Derivatives of all readings by the error motions, um per mm and rad."""
    u_um: float
    candidates: tuple[Group, ...]
    chosen: tuple[Group, ...] = ()

    @classmethod
    def of(cls, measurement: Measurement, rows: np.ndarray) -> _Selection:
        """The selection before its first step."""
        _, registration = misfit(measurement)
        residual = residuals(measurement, no_errors(measurement.machine), registration)[rows, 0] * 1e3
        base = equations.registration_design(measurement, registration)[rows, 0] * 1e3
        transform = equations.transform(measurement, registration)[:, 0] * 1e3
        u = float(np.sqrt(equations.covariance(measurement)[0, 0, 0])) * 1e3
        groups = tuple(candidates(measurement, transform, rows))
        return cls(measurement, rows, residual, registration, base, transform, u, groups)

    def selected(self) -> _Selection:
        """The selection with all significant causes and no superfluous ones."""
        now = self
        for _ in range(MOST):
            gains = [(now.gain(group), group) for group in now._open()]
            best = max((gain for gain, _ in gains), default=0.0)
            if best < SIGNIFICANT:
                break
            group = next(group for gain, group in gains if gain > best - SAME)
            now = replace(now, chosen=(*now.chosen, now._refined(group))).without_superfluous()
        return now.without_superfluous(now.independent())

    def independent(self) -> float:
        """Number of independent rows as a share of all, by the correlation of successive residuals.

        Residuals that are smooth along the circle are those of shapes that no cause has: each of their waves would
        otherwise count as evidence as often as it has rows.
        """
        left = self.left
        correlation = float(left[1:] @ left[:-1]) / max(float(left @ left), 1e-300)
        return (1.0 - correlation) / (1.0 + correlation) if correlation > 0.0 else 1.0

    def without_superfluous(self, share_of_rows: float = 1.0) -> _Selection:
        """The selection without causes that the others make superfluous."""
        now = self
        while now.chosen:
            costs = [(now.without(group).gain(group, share_of_rows), group) for group in now.chosen]
            least, group = min(costs, key=lambda pair: pair[0])
            if least >= SIGNIFICANT:
                break
            now = now.without(group)
        return now

    def without(self, group: Group) -> _Selection:
        """The selection without one of its causes."""
        return replace(self, chosen=tuple(own for own in self.chosen if own is not group))

    @cached_property
    def left(self) -> Array:
        """Residuals `(n,)` with centre, length and causes fitted, um."""
        basis = self._basis
        return np.asarray(self.deviation - basis @ (basis.T @ self.deviation))

    def gain(self, group: Group, share_of_rows: float = 1.0) -> float:
        """Fall of BIC by a cause in addition; its noise is that of the residuals where these exceed the specified.

        share_of_rows: number of independent rows as a share of all.
        """
        basis, left = self._basis, self.left
        own = _visible(group.columns - basis @ (basis.T @ group.columns), group.columns)
        if not own.shape[1]:
            return -np.inf
        n, variance = len(left) * share_of_rows, self.u_um**2
        smallest = 1e-6 * len(left) * variance
        before, removed = float(left @ left), float(np.sum((own.T @ left) ** 2))
        specified = removed / variance
        relative = n * float(np.log(max(before, smallest) / max(before - removed, smallest)))
        cost = own.shape[1] * np.log(n) + 2.0 * np.log(group.trials)
        return float(min(specified, relative) - cost)

    def result(self, left_out: int) -> Shares:
        """The causes with their sizes, uncertainties, shares and ties."""
        registered = self._orthonormal(self.base)
        design = np.column_stack([self.base, *(group.columns for group in self.chosen)])
        scale = np.linalg.norm(design, axis=0)
        scale[scale == 0.0] = 1.0
        u, values, v = np.linalg.svd(design / scale, full_matrices=False)
        kept = values > 1e-7 * values[0]
        solution = (v[kept].T / values[kept]) @ (u[:, kept].T @ self.deviation) / scale
        left = self.left
        degrees = max(len(left) - int(kept.sum()), 1)
        noise = max(self.u_um, float(np.sqrt(left @ left / degrees))) / self.independent() ** 0.5
        sizes = noise * np.sqrt(np.sum((v[kept].T / values[kept]) ** 2, axis=1)) / scale
        signals, place, causes = [], self.base.shape[1], []
        for group in self.chosen:
            own = slice(place, place + group.columns.shape[1])
            signal = group.columns @ solution[own]
            signals.append(signal - registered @ (registered.T @ signal))
            place = own.stop
        before = self.deviation - registered @ (registered.T @ self.deviation)
        total = float(np.sum(np.square(signals)) + left @ left)
        place = self.base.shape[1]
        for group, signal in zip(self.chosen, signals, strict=True):
            own = slice(place, place + group.columns.shape[1])
            place = own.stop
            parameters = dict(zip(group.names, solution[own].tolist(), strict=True))
            U = dict(zip(group.names, (2.0 * sizes[own]).tolist(), strict=True))
            known = {**parameters, **group.shape}
            mean_square, gain = float(signal @ signal) / total, self.without(group).gain(group)
            width = float(np.ptp(signal))
            causes.append(Share(group.kind, group.where, known, U, width, mean_square, -gain, self._ties(group)))
        offset, offset_u = self._offset(solution, sizes)
        fitted = np.sum(signals, axis=0) if signals else np.zeros(len(left))
        return Shares(
            tuple(sorted(causes, key=lambda cause: -cause.share)), offset, offset_u, _rms(before), _rms(left),
            self.u_um, left_out, self._hidden(), fitted, self.rows,
        )  # fmt: skip

    def _open(self) -> Iterator[Group]:
        """Candidates that are not in the model."""
        chosen = {group.name for group in self.chosen}
        for group in self.candidates:
            if group.name not in chosen:
                yield group

    def _refined(self, group: Group) -> Group:
        """The cause with its shape refined where the gain is largest."""
        if not group.shape:
            return group
        (start,) = group.shape.values()
        from scipy.optimize import minimize_scalar

        width = 0.4 if group.kind == "reversal-spike" else 0.5 * start / self._span(group.where)

        def loss(share: float) -> float:
            return -self.gain(self._reshaped(group, start * float(np.exp(share))))

        best = minimize_scalar(loss, bounds=(-width, width), method="bounded", options={"xatol": 1e-3 * width})
        return self._reshaped(group, start * float(np.exp(best.x)))

    def _reshaped(self, group: Group, value: float) -> Group:
        build = spike if group.kind == "reversal-spike" else cyclic
        axis = group.where.removeprefix("E_")[-1]
        return replace(build(self.measurement, self.transform, self.rows, axis, value), trials=group.trials)

    def _span(self, where: str) -> float:
        i = self.measurement.machine.index(where.removeprefix("E_")[-1])
        return float(np.ptp(self.measurement.state.positions[self.rows, i]))

    def _ties(self, group: Group) -> tuple[str, ...]:
        """Causes that explain the data nearly as well in place of one."""
        others = self.without(group)
        own = others.gain(group)
        tied = [other.name for other in others._open() if other.name != group.name and others.gain(other) > own - TIED]
        return tuple(dict.fromkeys(tied))

    def _hidden(self) -> tuple[str, ...]:
        """Candidates whose signal centre and length imitate."""
        basis = self._orthonormal(self.base)
        hidden = []
        for group in self.candidates:
            if not _visible(group.columns - basis @ (basis.T @ group.columns), group.columns).shape[1]:
                hidden.append(group.name)
        return tuple(dict.fromkeys(hidden))

    def _offset(self, solution: Array, sizes: Array) -> tuple[dict[str, float], dict[str, float]]:
        """Shift of the first table ball from its stated centre, um, and its standard uncertainty."""
        name, centre = next(iter(self.registration.sphere_centres.items()))
        shift = 1e3 * (centre - np.array(self.measurement.spheres[name]))
        seen = [k for k in range(3) if np.linalg.norm(self.base[:, k]) > 0.1 * np.linalg.norm(self.base[:, -1])]
        offset = {"xyz"[k]: float(shift[k] - 1e3 * solution[k]) for k in seen}
        return offset, {"xyz"[k]: float(1e3 * sizes[k]) for k in seen}

    @cached_property
    def _basis(self) -> Array:
        """Orthonormal columns of centre, length and the causes in the model."""
        return self._orthonormal(np.column_stack([self.base, *(group.columns for group in self.chosen)]))

    @staticmethod
    def _orthonormal(columns: Array) -> Array:
        """Orthonormal columns with the same span."""
        norms = np.linalg.norm(columns, axis=0)
        u, values, _ = np.linalg.svd(columns / np.where(norms > 0.0, norms, 1.0), full_matrices=False)
        return np.asarray(u[:, values > 1e-7 * max(values[0], 1e-300)])


def _visible(rest: Array, columns: Array) -> Array:
    """Orthonormal directions `(n, k)` of the part of columns that others do not imitate."""
    norms = np.linalg.norm(columns, axis=0)
    u, values, _ = np.linalg.svd(rest / np.where(norms > 0.0, norms, 1.0), full_matrices=False)
    return np.asarray(u[:, values > HIDDEN])


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


# ---- the candidates


def candidates(measurement: Measurement, transform: Array, rows: np.ndarray) -> Iterator[Group]:
    """The causes that are tried: those of the table that a circle shows."""
    machine, q = measurement.machine, measurement.state.positions[rows]
    moving = [
        axis.name for axis, span in zip(machine.axes, np.ptp(q, axis=0).tolist(), strict=True)
        if not axis.rotary and span > 1.0
    ]  # fmt: skip

    def signal(effect: EffectBase) -> Array:
        return signal_of(measurement, transform, rows, effect)

    for axis in moving:
        backlash = signal(Backlash(axis, 1.0))
        i = machine.index(axis)
        side = (q[:, [i]] - q[:, i].mean()) / (0.5 * np.ptp(q[:, i]))
        yield Group("backlash", axis, ("width_plus_um", "width_minus_um"), _sides(backlash, side), {})
        for length in LENGTHS_MM:
            yield spike(measurement, transform, rows, axis, length)
        yield from _periods(measurement, transform, rows, axis)
    for axis, other in permutations(moving, 2):
        component = own_component(other)
        where = f"E_{component}{axis}"
        yield Group("lateral-play", where, ("play_um",), signal(LateralPlay(component, axis, 1.0)), {})
        low, high = q[:, machine.index(axis)].min(), q[:, machine.index(axis)].max()
        bow = signal(ErrorMotion(component, axis, Legendre((float(low), float(high)), 2), (0.0,) * 3))[:, 2:]
        yield Group("straightness", where, ("bow_um",), bow / 1.5, {})
    for axis in moving:
        low, high = q[:, machine.index(axis)].min(), q[:, machine.index(axis)].max()
        component, basis = own_component(axis), Legendre((float(low), float(high)), 2)
        curve = signal(ErrorMotion(component, axis, basis, (0.0,) * 3))[:, 2:]
        yield Group("positioning-curve", f"E_{component}{axis}", ("bow_um",), curve / 1.5, {})
    for one, other in combinations(moving, 2):
        pair = f"{one} {other}"
        apart = 0.5 * (signal(Scale(one, 1.0)) - signal(Scale(other, 1.0)))
        yield Group("scale-mismatch", pair, ("difference_um_per_m",), apart, {})
        normal = cast(Component, "ABC"[3 - sum("XYZ".index(own_component(axis)) for axis in (one, other))])
        first, second = sorted((one, other), key=own_component)
        angle = signal(LocationError(normal, second, 1.0))
        yield Group("squareness", f"{first} {second}", ("angle_urad",), angle, {})
        yield Group("servo-mismatch", pair, ("lag_ms",), signal(ServoMismatch(one, other, 1.0)), {})


def spike(measurement: Measurement, transform: Array, rows: np.ndarray, axis: str, length: float) -> Group:
    """A reversal spike at both ends of an axis that decays over a length, mm."""
    own = signal_of(measurement, transform, rows, ReversalSpike(axis, 0.0, length))[:, :1]
    names = "height_plus_um", "height_minus_um"
    x = measurement.state.positions[rows, measurement.machine.index(axis)]
    plus = (x > 0.5 * (x.min() + x.max()))[:, None]
    columns = np.concatenate([np.where(plus, own, 0.0), np.where(plus, 0.0, own)], axis=1)
    return Group("reversal-spike", axis, names, columns, {"length_mm": length}, 3.0)


def cyclic(measurement: Measurement, transform: Array, rows: np.ndarray, axis: str, period: float) -> Group:
    """A cyclic error of an axis with one harmonic and this period, mm."""
    component = own_component(axis)
    columns = signal_of(measurement, transform, rows, Cyclic(component, axis, period, (0.0,), (0.0,)))[:, 1:]
    waves = _range(measurement, rows, axis) / period
    return Group("cyclic", axis, ("sine_um", "cosine_um"), columns, {"period_mm": period}, max(waves, 1.0) * 10.0)


def signal_of(measurement: Measurement, transform: Array, rows: np.ndarray, effect: EffectBase) -> Array:
    """Signal along the bar `(n, parameters)` of an effect, um for each unit of its parameters."""
    total: Array | None = None
    for column, component, values in effect.columns(measurement.machine, measurement.state):
        own = transform[rows, 6 * column + component][:, None] * values[rows]
        total = own if total is None else total + own
    assert total is not None
    return total


def _sides(width: Array, side: Array) -> Array:
    """Columns of the widths at the positive and at the negative end, for a width that is linear between."""
    return np.concatenate([width * 0.5 * (1.0 + side), width * 0.5 * (1.0 - side)], axis=1)


def _range(measurement: Measurement, rows: np.ndarray, axis: str) -> float:
    return float(np.ptp(measurement.state.positions[rows, measurement.machine.index(axis)]))


def _periods(measurement: Measurement, transform: Array, rows: np.ndarray, axis: str) -> Iterator[Group]:
    """Cyclic errors on a grid of periods, fine enough that the phase at the ends changes by less than an eighth."""
    steps = np.abs(np.diff(measurement.state.positions[rows, measurement.machine.index(axis)]))
    span, shortest = _range(measurement, rows, axis), WAVES * float(np.quantile(steps, 0.95))
    low, high = 1.0 / (LARGEST_PERIOD * span), 1.0 / max(shortest, 1e-3)
    for frequency in np.arange(low, high, 0.4 / span).tolist():
        yield cyclic(measurement, transform, rows, axis, 1.0 / frequency)
