"""Error motions as smooth curves, and their uncertainty: between few measured positions, and among many.

With as many parameters as positions a basis follows every reading, so that its covariance holds the noise alone: the
errors between the positions may differ by much more. Among many positions a basis with few parameters leaves a misfit,
which its covariance does not contain. Here each error motion of an axis is a Gaussian process
(`smooth_process`). The values at the positions, or at equidistant ones among many, show its size, length and
smoothness by their evidence: values that jump from one position to the next belong to short waves, about which nothing
is known half-way between two positions. A Type B judgement (GUM) limits them where the positions are too few to show
them.

The curve and its covariance, given the data, are written as a cubic spline: with a node at each position and half-way
between few of them, with as few nodes as hold the process among many. Other effects are found again beside the curves,
which hold lines more easily than a basis does: what looks like a line of an axis may be a wave of a tracker's circle.
Their shapes, in which errors are not linear, stay, and so do other error motions.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import count

import msgspec
import numpy as np
from scipy import linalg

from calibration.fit.cross_validation import diagonals
from calibration.fit.curves.line_shares import line_shares
from calibration.fit.curves.smooth_process import TYPICAL_SIZE, Processes
from calibration.fit.curves.spline_of_process import cubic, following, root_of
from calibration.fit.fit import Fit
from calibration.fit.linear import pseudo_inverse
from calibration.fit.problem import UNSEEN_EIGENVALUE
from calibration.measurement.measurement import Measurement
from calibration.observation.full_model import ROTARY, least_priors
from calibration.observation.normal_equations import assemble, decorrelation_of, whitened
from kinematics.basis import Basis, BSpline
from kinematics.effects import Effect, ErrorMotion
from kinematics.effects.base import own_component
from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array

FEW_POSITIONS = 24
"""Most positions of an axis that count as few; among more, values at equidistant ones are found."""
FEWEST_EQUIDISTANT, MOST_EQUIDISTANT = 13, FEW_POSITIONS + 1
"""Numbers of equidistant positions, at least and at most."""
ONE_POSITION_SHARE = 1e-3
"""Distance, as a share of the measured range, up to which positions are one."""
CURVE_SHARE = 0.2
"""Size of a process that is expected for spheres, as a share of the prior of its error motion (Type B)."""
SWEEPS = 2
"""Most times that the processes of all axes are found, one after the other."""
NOTICED = 0.1
"""Least U, um or urad, that a report contains."""
UNLIMITED_SIZE = 1e4
"""Standard deviation of a parameter without a prior, in its units."""


@dataclass(frozen=True)
class BetweenPositions:
    """Uncertainty of the error motions of an axis between its measured positions, known exactly at these."""

    axis: str
    positions: int
    u_um: float | None
    """Largest standard uncertainty of its translational error motions, um; None without any."""
    u_urad: float | None
    """Largest standard uncertainty of its angular error motions, urad; None without any."""

    @property
    def noticed(self) -> bool:
        """True where the uncertainty is worth a sentence."""
        return 2.0 * max(self.u_um or 0.0, self.u_urad or 0.0) >= NOTICED

    def json(self) -> dict[str, float | int | None]:
        """For programs."""
        return {"positions": self.positions, "u_um": self.u_um, "u_urad": self.u_urad}

    def __str__(self) -> str:
        parts = ((self.u_um, "um"), (self.u_urad, "urad"))
        sizes = " and ".join(f"{2.0 * u:.2g} {unit}" for u, unit in parts if u is not None)
        return (
            f"between the {self.positions} measured positions of {self.axis} its errors may differ from the new "
            f"calibration by up to {sizes} (U, k=2): measure more positions to reduce this"
        )


def with_curves_between(found: Fit) -> tuple[Fit, tuple[BetweenPositions, ...]]:
    """The fit with its error motions as smooth curves, and the uncertainties of those between few positions.

    Of the result, only the model, with its covariance, and the priors belong to the new curves. Other error motions
    than splines stay, and those of an axis with finer ones than the curves could be. Also those of axes with many
    positions on a few diagonals: the held-out lines have decided on the sizes of the errors there, not the evidence.
    """
    splines = _splines(found)
    measured = {axis: _positions(found.measurement, axis, found.kept) for axis in splines}
    few = [axis for axis, x in measured.items() if 2 <= len(x) <= FEW_POSITIONS]
    axes = {axis: measured[axis] for axis in few}
    if diagonals(found.measurement) is None:
        axes |= {axis: _among_many(measured[axis], splines[axis]) for axis in splines if axis not in few}
    axes = {axis: x for axis, x in axes.items() if len(x)}
    if not axes:
        return found, ()
    values = _Values.of(found, axes)
    processes = values.processes()
    intervals = {axis: splines[axis][0].interval for axis in axes}
    bases = {
        axis: cubic(intervals[axis], 2 * len(own.positions) - 1) if axis in few else following(own, intervals[axis])
        for axis, own in processes.items()
    }
    return values.with_curves(processes, bases), tuple(_between(axis, processes[axis]) for axis in few)


def _motion_of(effect: Effect, axes: Container[str]) -> ErrorMotion | None:
    """An effect that is an error motion of one of these axes; None for others."""
    return effect if isinstance(effect, ErrorMotion) and effect.axis in axes else None


def _splines(found: Fit) -> dict[str, list[BSpline]]:
    """Bases of the error motions of each axis, where all are splines; none of axes that turn fully."""
    machine, bases = found.measurement.machine, dict[str, list[Basis]]()
    if found.measurement.across is not None:
        return {}
    for motion, _ in found.model.error_motions:
        if not machine.axes[machine.index(motion.axis)].turns_fully:
            bases.setdefault(motion.axis, []).append(motion.basis)
    splines = {axis: [basis for basis in own if isinstance(basis, BSpline)] for axis, own in bases.items()}
    return {axis: own for axis, own in splines.items() if len(own) == len(bases[axis])}


def _among_many(x: Array, splines: list[BSpline]) -> Array:
    """Equidistant positions among measured ones `(k,)`, twice as many as parameters; none where these are too many."""
    size = max(basis.size for basis in splines)
    if len(x) <= FEW_POSITIONS or size > FEW_POSITIONS:
        return x[:0]
    return np.linspace(x[0], x[-1], min(max(2 * size + 1, FEWEST_EQUIDISTANT), MOST_EQUIDISTANT))


def _positions(measurement: Measurement, axis: str, rows: np.ndarray) -> Array:
    """Different positions of an axis, mm or degrees, in those of the rows, a mask `(n,)`, that measure it."""
    if measurement.axis is not None:
        rows = rows & np.equal(measurement.axis, axis)
    x = np.unique(measurement.state.position(measurement.machine, axis)[rows])
    if len(x) < 2:
        return x
    group = np.concatenate([[0], np.cumsum(np.diff(x) > ONE_POSITION_SHARE * (x[-1] - x[0]))])
    return np.asarray(np.bincount(group, x) / np.bincount(group))


@dataclass(frozen=True)
class _Values:
    """Information of the data on the values of error motions at some positions, and on all other parameters."""

    found: Fit
    axes: Mapping[str, Array]
    """Positions `(k,)` of each axis, mm or degrees."""
    effects: tuple[Effect, ...]
    """The effects of the fit; error motions of these axes as tables of their values at the positions."""
    parts: tuple[slice, ...]
    """Parameters of each of these effects."""
    information: Array
    """`(q, q)`, registration eliminated."""
    slope: Array
    """Product `(q,)` of the derivatives with the residuals, registration eliminated."""
    prior: Array
    """Standard deviations `(q,)`; only those of the other parameters are used."""

    @classmethod
    def of(cls, found: Fit, axes: Mapping[str, Array]) -> _Values:
        """The information about the result of a fit."""
        effects: list[Effect] = []
        priors: list[Array] = []
        for effect, part in zip(found.model.effects, found.model.slices, strict=True):
            own = np.where(np.isfinite(found.prior[part]), found.prior[part], UNLIMITED_SIZE)
            if motion := _motion_of(effect, axes):
                x = axes[motion.axis]
                values = motion.basis.columns(x) @ np.array(motion.parameters)
                effects.append(_motion(motion, BSpline(tuple(x.tolist()), 1), values))
                priors.append(np.full(len(x), own.max()))
            else:
                effects.append(effect)
                priors.append(own)
        model = msgspec.structs.replace(found.model, effects=tuple(effects), covariance=None)
        information, slope = _information(found, model)
        prior = np.concatenate(priors)
        return cls(found, axes, model.effects, model.slices, information, slope, prior)

    def processes(self) -> dict[str, Processes]:
        """The possible processes of each axis."""
        lines = {axis: self._lines(axis) for axis in self.axes}
        found = self._swept(lines)
        if self._of_spheres:
            shares = self._line_shares(found)
            found = self._swept({axis: own * shares[axis] for axis, own in lines.items()})
        return found

    def _swept(self, lines: Mapping[str, Array]) -> dict[str, Processes]:
        """The possible processes of each axis; lines: size of the line of each error motion of an axis, um or urad."""
        found = {
            axis: Processes.about(x, lines[axis].tolist(), list(self._values(axis)), self._typical_size(axis))
            for axis, x in self.axes.items()
        }
        for _ in range(SWEEPS):
            before = dict(found)
            for axis, own in before.items():
                found[axis] = own.given(*self._without_others(axis, found))
            if all(found[axis].possible[0] == before[axis].possible[0] for axis in found):
                break
        return found

    def _lines(self, axis: str) -> Array:
        """Size of constant and slope of each error motion: at the ends both together have that of its prior."""
        return np.asarray(self.prior[self._rows(axis)][:: len(self.axes[axis])] / 2**0.5)

    @property
    def _of_spheres(self) -> bool:
        """True for spheres, which leave some lines of linear axes to their prior: these have the size of all lines."""
        return self.found.measurement.instrument.OBSERVES == "offset"

    def _typical_size(self, axis: str) -> float:
        """Size of the processes of an axis that is expected, um or urad."""
        smaller = self._of_spheres and axis[0] not in ROTARY
        return CURVE_SHARE * 2**0.5 * float(self._lines(axis).min()) if smaller else TYPICAL_SIZE

    def _line_shares(self, processes: Mapping[str, Processes]) -> dict[str, Array]:
        """Size of the line of each error motion, as a share of its prior; squareness and rotary axes keep theirs."""
        rows = np.concatenate([self._rows(axis) for axis in processes])
        model = msgspec.structs.replace(self.found.model, effects=self.effects)
        least = least_priors(self.found.measurement, model)
        free = {
            axis: (axis[0] not in ROTARY) & (least[self._rows(axis)][:: len(x)] == 0.0) for axis, x in self.axes.items()
        }
        return line_shares(processes, free, self.information[np.ix_(rows, rows)], self._right[rows])

    def with_curves(self, processes: Mapping[str, Processes], bases: Mapping[str, BSpline]) -> Fit:
        """The fit with the curves, given the data, in place of its error motions; bases: of the curves of each axis."""
        effects: list[Effect] = []
        reached: list[Array] = []
        roots: list[Array] = []
        numbers = {axis: count() for axis in self.axes}
        for effect, part in zip(self.found.model.effects, self.parts, strict=True):
            if motion := _motion_of(effect, self.axes):
                own, basis = processes[motion.axis], bases[motion.axis]
                roots.append(root_of(own, next(numbers[motion.axis]), basis))
                reached.append(basis.columns(own.positions) @ roots[-1])
                effects.append(_motion(motion, basis, np.zeros(basis.size)))
            else:
                effects.append(effect)
                roots.append(np.diag(self.prior[part]))
                reached.append(roots[-1])
        model = msgspec.structs.replace(self.found.model, effects=tuple(effects), covariance=None)
        root, through = linalg.block_diag(*roots), linalg.block_diag(*reached)
        within = through.T @ self.information @ through
        values, vectors = np.linalg.eigh((within + within.T) / 2.0)
        half = root @ (vectors / np.sqrt(1.0 + np.maximum(values, 0.0)))
        free = self._moving(model)
        inner = (np.eye(len(within)) + within)[np.ix_(free, free)]
        solved = np.linalg.solve(inner, (through.T @ self._right - self._pulled(model))[free])
        parameters = np.array(model.parameters) + root[:, free] @ solved
        prior = np.sqrt(np.sum(root**2, axis=1))
        return replace(self.found, model=model.with_parameters(parameters, half @ half.T), prior=prior)

    def _moving(self, model: ErrorModel) -> np.ndarray:
        """Numbers of the parameters that are found again; shapes, and error motions without curves, stay."""
        moving = np.concatenate([effect.linear for effect in model.effects])
        for motion, part in model.error_motions:
            if motion.axis not in self.axes:
                moving[part] = False
        return np.flatnonzero(moving)

    def _pulled(self, model: ErrorModel) -> Array:
        """Distances `(q,)` of the parameters of other effects from their priors, in units of these; 0 for curves."""
        pulled = np.zeros(len(model.parameters))
        for effect, own, part in zip(self.found.model.effects, self.found.model.slices, model.slices, strict=True):
            if not _motion_of(effect, self.axes):
                limited = np.isfinite(self.found.prior[own])
                pulled[part] = np.where(limited, self.found.away[own], 0.0)
        return pulled

    def _rows(self, axis: str) -> np.ndarray:
        """Numbers of the values of the error motions of an axis."""
        own = zip(self.effects, self.parts, strict=True)
        return np.concatenate([np.arange(p.start, p.stop) for effect, p in own if _motion_of(effect, (axis,))])

    def _values(self, axis: str) -> Iterator[tuple[str, Array]]:
        """Class of each error motion of an axis, and its values at the positions."""
        for effect in self.effects:
            if motion := _motion_of(effect, (axis,)):
                yield _class_of(motion), np.array(motion.parameters)

    @cached_property
    def _right(self) -> Array:
        """Product `(q,)` of the information with the values; parameters of other effects are held."""
        rows = np.concatenate([self._rows(axis) for axis in self.axes])
        values = np.zeros(len(self.slope))
        values[rows] = np.concatenate([np.array(effect.parameters) for effect in self.effects])[rows]
        return np.asarray(self.slope + self.information @ values)

    def _without_others(self, axis: str, processes: Mapping[str, Processes]) -> tuple[Array, Array]:
        """Information `(k, k)` on the values of one axis, and its product with them `(k,)`, other axes eliminated."""
        own = self._rows(axis)
        others = [name for name in processes if name != axis]
        information, right = self.information[np.ix_(own, own)], self._right[own]
        if not others:
            return information, right
        rows = np.concatenate([self._rows(name) for name in others])
        blocks = [
            np.asarray(np.linalg.cholesky(processes[name].covariance(self.axes[name], motion)))
            for name in others
            for motion in range(len(processes[name].classes))
        ]
        root = linalg.block_diag(*blocks)
        inner = np.eye(len(rows)) + root.T @ self.information[np.ix_(rows, rows)] @ root
        cross = root.T @ self.information[np.ix_(rows, own)]
        solved = np.linalg.solve(inner, np.column_stack([cross, root.T @ self._right[rows]]))
        return information - cross.T @ solved[:, :-1], right - cross.T @ solved[:, -1]


def _information(found: Fit, model: ErrorModel) -> tuple[Array, Array]:
    """Information on the parameters of a model `(q, q)` and slope `(q,)` at the residuals of a fit."""
    measurement, registration = found.measurement, found.registration
    white = measurement.whiteners
    weights = found.kept / (found.variance_factor * found.widening)
    decorrelation = decorrelation_of(measurement, weights)
    root = np.sqrt(weights)
    residual = decorrelation.apply(whitened(white, found.residual) * root[:, None])
    normal = assemble(measurement, model, registration, white * root[:, None, None], residual, decorrelation)
    normal.add_stated(measurement, registration)
    size = len(registration.names)
    own = normal.matrix[:size, :size]
    scale = 1.0 / np.sqrt(np.where(np.diag(own) > 0, np.diag(own), 1.0))
    half = scale[:, None] * pseudo_inverse(own * np.outer(scale, scale), UNSEEN_EIGENVALUE, 1.0).root
    eliminated = normal.matrix[size:, :size] @ half
    information = normal.matrix[size:, size:] - eliminated @ eliminated.T
    return (information + information.T) / 2.0, normal.right[size:] - eliminated @ (half.T @ normal.right[:size])


def _motion(effect: ErrorMotion, basis: BSpline, values: Array) -> ErrorMotion:
    return msgspec.structs.replace(effect, basis=basis, parameters=tuple(values.tolist()), u=(0.0,) * basis.size)


def _class_of(effect: ErrorMotion) -> str:
    if effect.component == own_component(effect.axis):
        return "positioning"
    return "angular" if effect.angular else "straightness"


def _between(axis: str, processes: Processes) -> BetweenPositions:
    """The uncertainty between the positions of an axis."""
    u = [(which, processes.between(motion)) for motion, which in enumerate(processes.classes)]
    shifts, turns = ([own for which, own in u if (which == "angular") == angular] for angular in (False, True))
    return BetweenPositions(axis, len(processes.positions), max(shifts, default=None), max(turns, default=None))
