"""The shares of the causes of the deviations of circles: a linear model of the table's effects, selected by the data.

The deviations along the bar are linear in the sizes of the causes. Centre and length are always in the model. The
cause with the largest gain by BIC is added until none is significant, then those that others have made superfluous are
dropped. A cause is tied with another one that explains the data nearly as well in its place.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from calibration.circles.candidates import (
    OTHER,
    Group,
    candidates,
    cyclic,
    feeds_of,
    other_motions,
    spike,
    timed_spike,
    way_in,
)
from calibration.circles.circles import Circle
from calibration.circles.result import Limit, Share, Shares
from calibration.circles.spikes import SpikeAtFeed, spikes_by_feed
from calibration.fit.linear import singular_values
from calibration.measurement.measurement import Measurement
from calibration.observation import equations
from calibration.observation.normal_equations import residuals
from calibration.plausibility.misfit import misfit
from calibration.registration.registration import Registration
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
OUTLYING = 6.0
"""Deviation of a row in robust standard deviations from which it is left out."""
MOST = 20
"""Largest number of causes."""


def shares(measurement: Measurement, circles: Sequence[Circle]) -> Shares:
    """The shares of the causes in the deviations of the circles."""
    rows = np.sort(np.concatenate([each.rows for each in circles]))
    found = _Selection.of(measurement, rows, circles).selected()
    off = found.left
    usual = 1.4826 * float(np.median(np.abs(off - np.median(off))))
    good = np.abs(off) <= OUTLYING * max(usual, found.u_um)
    if not good.all():
        found = _Selection.of(measurement, rows[good], circles).selected()
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
    gains: dict[tuple[tuple[Group, ...], Group, float], float] = field(default_factory=dict)
    """Gains that have been worked out, by the causes in the model, the cause and the share of independent rows."""

    @classmethod
    def of(cls, measurement: Measurement, rows: np.ndarray, circles: Sequence[Circle]) -> _Selection:
        """The selection before its first step."""
        _, registration = misfit(measurement)
        residual = residuals(measurement, no_errors(measurement.machine), registration)[rows, 0] * 1e3
        base = measurement.instrument.registration_design(measurement, registration)[rows, 0] * 1e3
        transform = measurement.instrument.transform(measurement, registration)[:, 0] * 1e3
        u = float(np.sqrt(equations.covariance(measurement)[0, 0, 0])) * 1e3
        groups = (*candidates(measurement, transform, rows), *other_motions(measurement, rows, circles))
        return cls(measurement, rows, residual, registration, base, transform, u, groups)

    def selected(self) -> _Selection:
        """The better one of two selections by BIC: from nothing, and from all other error motions on.

        Circles in one direction show sums of steps at the reversals that look like smooth error motions.
        """
        smooth = self
        for plane in dict.fromkeys(group.where for group in self.candidates if group.kind == OTHER):
            waves = [group for group in self.candidates if group.kind == OTHER and group.where == plane]
            best = max(waves, key=smooth.gain)
            if smooth.gain(best) >= SIGNIFICANT:
                smooth = replace(smooth, chosen=(*smooth.chosen, best))
        starts = (self, smooth) if smooth.chosen else (self,)
        return min((start._grown() for start in starts), key=lambda selection: selection.score)

    @property
    def score(self) -> float:
        """BIC of the selection; residuals below the specified noise do not count."""
        n, left = len(self.rows), self.left
        cost = sum(group.columns.shape[1] * np.log(n) + 2.0 * np.log(group.trials) for group in self.chosen)
        return float(n * np.log(max(float(left @ left), n * self.u_um**2)) + cost)

    def _grown(self) -> _Selection:
        """The selection with all significant causes and no superfluous ones."""
        now = self
        for _ in range(MOST):
            gains = [*((now.gain(group), now, group) for group in now._open()), *now._exchanges()]
            best = max((gain for gain, *_ in gains), default=0.0)
            if best < SIGNIFICANT:
                break
            before, group = next((before, group) for gain, before, group in gains if gain > best - SAME)
            now = replace(before, chosen=(*before.chosen, now._refined(group))).without_superfluous()
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

        share_of_rows: number of independent rows as a share of all. Minus infinity of a cause that is hidden.
        """
        key = self.chosen, group, share_of_rows
        if key not in self.gains:
            self.gains[key] = self._gain(group, share_of_rows)
        return self.gains[key]

    def _gain(self, group: Group, share_of_rows: float) -> float:
        left, own = self.left, self._visible(group)
        if not own.shape[1]:
            return -np.inf
        n, variance = len(left) * share_of_rows, self.u_um**2
        smallest = 1e-6 * len(left) * variance
        before, removed = float(left @ left), float(((own.T @ left) ** 2).sum())
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
        u, values, v = singular_values(design / scale)
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
            named = group.names or ()
            parameters = dict(zip(named, solution[own].tolist(), strict=bool(named)))
            U = dict(zip(named, (2.0 * sizes[own]).tolist(), strict=bool(named)))
            known = {**parameters, **group.shape}
            mean_square, gain = float(signal @ signal) / total, self.without(group).gain(group)
            width = float(np.ptp(signal))
            share = Share(group.kind, group.where, known, U, width, mean_square, -gain, self._ties(group))
            causes.append(replace(share, by_feed=self._by_feed(group, noise)))
        offset, offset_u = self._offset(solution, sizes)
        fitted = np.sum(signals, axis=0) if signals else np.zeros(len(left))
        return Shares(
            tuple(sorted(causes, key=lambda cause: -cause.share)), offset, offset_u, _rms(before), _rms(left),
            self.u_um, left_out, self._hidden(), self._limits(noise), fitted, self.rows,
        )  # fmt: skip

    def _by_feed(self, group: Group, noise_um: float) -> tuple[SpikeAtFeed, ...]:
        """The decay of a reversal spike at each feed."""
        if group.kind != "reversal-spike":
            return ()
        feeds, others = feeds_of(self.measurement, self.rows), self.without(group)
        time = group.shape.get("time_ms")
        ways = [group.shape["length_mm"] if time is None else way_in(self.measurement, feed, time) for feed in feeds]
        return spikes_by_feed(
            self.measurement, self.transform, self.rows, group.where, np.array(ways), others._basis, self.deviation,
            noise_um,
        )  # fmt: skip

    def _open(self) -> Iterator[Group]:
        """Candidates that are not in the model."""
        chosen = {group.name for group in self.chosen}
        for group in self.candidates:
            if group.name not in chosen:
                yield group

    def _exchanges(self) -> Iterator[tuple[float, _Selection, Group]]:
        """Gain in BIC by another number of waves of the other error motions, with the selection without them."""
        for group in self.chosen:
            if group.kind == OTHER:
                before = self.without(group)
                present = before.gain(group)
                for other in self.candidates:
                    if other.name == group.name and other is not group:
                        yield before.gain(other) - present, before, other

    def _refined(self, group: Group) -> Group:
        """The cause with its shape refined where the gain is largest."""
        if not group.shape or group.kind == OTHER:
            return group
        (start,) = group.shape.values()
        from scipy.optimize import minimize_scalar

        width = 0.4 if group.kind == "reversal-spike" else 0.5 * start / self._span(group.where)

        def loss(share: float) -> float:
            return -self.gain(self._reshaped(group, start * float(np.exp(share))))

        best = minimize_scalar(loss, bounds=(-width, width), method="bounded", options={"xatol": 1e-3 * width})
        return self._reshaped(group, start * float(np.exp(best.x)))

    def _reshaped(self, group: Group, value: float) -> Group:
        build = cyclic if group.kind == "cyclic" else timed_spike if "time_ms" in group.shape else spike
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
        bare = replace(self, chosen=())
        return tuple(dict.fromkeys(group.name for group in self.candidates if bare.gain(group) == -np.inf))

    def _limits(self, noise_um: float) -> tuple[Limit, ...]:
        """Detection limits of the causes that are not in the model, of both ends alike, beside those that are."""
        found: dict[str, list[float]] = {}
        units, n = {}, len(self.rows)
        for group in self._open():
            if group.kind == OTHER:
                continue
            signal = group.columns[:, 0] if group.kind == "cyclic" else group.columns.sum(axis=1)
            rest = signal - self._basis @ (self._basis.T @ signal)
            if np.linalg.norm(rest) < HIDDEN * np.linalg.norm(signal):
                continue
            needed = SIGNIFICANT + group.columns.shape[1] * np.log(n) + 2.0 * np.log(group.trials)
            found.setdefault(group.name, []).append(float(np.sqrt(needed) * noise_um / np.linalg.norm(rest)))
            units[group.name] = group.unit
        return tuple(Limit(name, min(sizes), max(sizes), units[name]) for name, sizes in found.items())

    def _offset(self, solution: Array, sizes: Array) -> tuple[dict[str, float], dict[str, float]]:
        """Shift of the first table ball from its stated centre, um, and its standard uncertainty."""
        name, centre = next(iter(self.registration.sphere_centres.items()))
        shift = 1e3 * (centre - np.array(self.measurement.spheres[name]))
        seen = [k for k in range(3) if np.linalg.norm(self.base[:, k]) > 0.1 * np.linalg.norm(self.base[:, -1])]
        offset = {"xyz"[k]: float(shift[k] - 1e3 * solution[k]) for k in seen}
        return offset, {"xyz"[k]: float(1e3 * sizes[k]) for k in seen}

    def _visible(self, group: Group) -> Array:
        """Orthonormal directions `(n, k)` of the part of a cause that the model does not imitate."""
        rest = group.columns - self._basis @ (self._basis.T @ group.columns)
        u, values, _ = singular_values(rest / group.norms)
        return np.asarray(u[:, values > HIDDEN])

    @cached_property
    def _basis(self) -> Array:
        """Orthonormal columns of centre, length and the causes in the model."""
        return self._orthonormal(np.column_stack([self.base, *(group.columns for group in self.chosen)]))

    @staticmethod
    def _orthonormal(columns: Array) -> Array:
        """Orthonormal columns with the same span."""
        norms = np.linalg.norm(columns, axis=0)
        u, values, _ = singular_values(columns / np.where(norms > 0.0, norms, 1.0))
        return np.asarray(u[:, values > 1e-7 * max(values[0], 1e-300)])


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
