"""Three-point identification: the error motions of each axis from three points P, Q, K on the component that it moves.

Ellingsdalen (NTNU 2021) 3.1-3.3: three reflectors are on the spindle for the linear axes and on the table for the
rotary axes; the tracker is on the bed; one axis moves at a time. Here, from the bed outward:

    readings -> points in one frame (stations) -> six error motions at each position (rigid_motions)
             -> curves and location errors (error_curves) -> error model

The motion of the axes between the bed and an axis is removed with their errors, which are identified before, at the
positions where they are held. Angular errors of X therefore do not appear as squareness of Y. The uncertainties of all
parameters follow from the points through the same equations, with all covariances.
"""

from __future__ import annotations

import datetime
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from calibration.fit.acceptance import significant_share
from calibration.fit.prediction import relative_deviations
from calibration.measurement.measurement import Measurement
from calibration.plausibility.checks import usable
from calibration.single_axis import stations
from calibration.single_axis.error_curves import (
    Curves,
    Misfit,
    arc_of,
    axis_model,
    constants_design,
    fitted,
    misfits,
    polynomials,
    tables,
    widening,
)
from calibration.single_axis.rigid_motions import UNITS, RigidMotions, error_design, outward, solve
from calibration.single_axis.series import Series, all_series, physical_points
from kinematics.basis import Interval
from kinematics.effects import COMPONENTS, Effect
from kinematics.error_model.covariance import propagated
from kinematics.error_model.model import ErrorModel
from kinematics.error_model.provenance import SIMULATED, Provenance, reference
from kinematics.machine import Axis, Machine
from kinematics.transforms import IDENTITY, Array, Pose
from kinematics.user_error import UserError

FLAT_TRIANGLE_SHARE = 0.02
"""Flatness of the points' triangle, as a share of its length, below which they count as one line."""

Kind = Literal["polynomial", "table"]


@dataclass(frozen=True)
class Choice:
    """Representation of the error motions."""

    kind: Kind = "polynomial"
    """Polynomials, or tables interpolated between the measured positions."""
    degrees: Mapping[str, int] = field(default_factory=dict)
    """Degrees of polynomials, by name: {"XX": 4}; of the others the data decide."""
    arcs: Mapping[str, Interval] = field(default_factory=dict)
    """Measured ranges by axis, mm or degrees; default: between the end positions, or a turn without its widest gap."""


@dataclass(frozen=True)
class AxisResult:
    """Result for one axis; error motions in um and urad, tool relative to workpiece, in its error frame."""

    axis: Axis
    positions: Array
    """Positions `(n,)`, mm or degrees, ascending."""
    targets: tuple[str, ...]
    standing: Mapping[str, float]
    """Positions at which the other axes on the same side were held, mm or degrees."""
    errors: Array
    """Error motions `(n, 6)` at each position: of mean zero for a linear axis, about the axis average line for a rotary
    one."""
    covariance: Array
    """Covariance of the error motions `(6n, 6n)`."""
    covariance_a: Array
    """Part of the covariance from the machine's repeatability (Type A)."""
    location: Array
    """Location errors `(6,)` of a rotary axis; zero for a linear axis."""
    curves: Curves
    misfits: tuple[Misfit, ...]
    """Deviations of the six curves from the points."""

    @property
    def arc(self) -> Interval:
        """The measured range, mm or degrees."""
        return self.curves.shape.bases[0].interval

    @property
    def u(self) -> Array:
        """Standard uncertainties of the error motions `(n, 6)`."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0)).reshape(-1, 6)

    @property
    def u_a(self) -> Array:
        """Part of the standard uncertainties `(n, 6)` from repeatability."""
        return np.sqrt(np.maximum(np.diag(self.covariance_a), 0.0)).reshape(-1, 6)

    def block(self, component: int) -> Array:
        """Covariance `(n, n)` of one error motion."""
        return self.covariance[component::6, component::6]


@dataclass(frozen=True)
class ThreePoints:
    """All measured axes, and their error model."""

    axes: Mapping[str, AxisResult]
    """Result of each axis by name, from the bed outward, axes of the tool side first."""
    model: ErrorModel
    points: stations.Points
    notes: tuple[str, ...]
    significant_share: float
    """Share of the measured states at which the correction exceeds twice its standard uncertainty."""
    datums: Mapping[str, Array]
    """Positions of the targets on the bed `(3,)`, mm, machine frame, by name: frame of a later measurement."""


@dataclass(frozen=True)
class _Found:
    """One axis, and its dependence on all points."""

    series: Series
    motions: RigidMotions
    curves: Curves
    by_points: Array
    """Derivatives `(3kn, 3 points)` of the axis' points, in the frame at its foot, with respect to all points."""

    @property
    def parameters_by_points(self) -> Array:
        """Derivatives `(p, 3 points)` of the curves' parameters with respect to all points."""
        return np.asarray(self.curves.estimator @ self.motions.estimator @ self.by_points)


def identify(
    measurement: Measurement, choice: Choice | None = None, datums: Mapping[str, Array] | None = None
) -> ThreePoints:
    """Identify every axis that moves alone through three or more positions with three targets on it.

    In the resulting frame, the targets on the tool lie nearest to their positions on the machine without errors; with
    `datums` of an earlier measurement, the targets on the bed lie nearest to these. UserError for unsuitable data.
    """
    _check(measurement)
    odd = [finding.message for finding in usable(measurement)]
    return identified(measurement, choice or Choice(), datums, odd)


def identified(
    measurement: Measurement, choice: Choice, datums: Mapping[str, Array] | None = None, odd: Sequence[str] = ()
) -> ThreePoints:
    """As `identify`, for data already checked; `odd`: notes on their anomalies."""
    point_numbers, number = physical_points(measurement)
    series = all_series(measurement, point_numbers, number)
    on_bed = {name: number for (name, _), number in point_numbers.items() if measurement.targets[name].carrier == "bed"}
    if datums is None:
        anchors = _on_tool(measurement, number)
    else:
        anchors = {number: datums[name] for name, number in on_bed.items() if name in datums}
    points = stations.locate(measurement, number, anchors)
    found: dict[str, _Found] = {}
    for one in series:
        _refuse_line(measurement, one, points)
        found[measurement.machine.axes[one.column].name] = _identify(measurement.machine, one, points, found, choice)
    _refuse_unknown(choice, found)
    notes = list(odd) + (
        []
        if points.degrees_of_freedom
        else ["every point was measured once: no repeatability, u by the specification alone"]
    )
    results = {name: _result(measurement.machine, one, points) for name, one in found.items()}
    notes += [*_misfit_notes(results), *_unresolved(results)]
    model = _model(measurement, found, results, points)
    return ThreePoints(
        results,
        model,
        points,
        tuple(notes),
        significant_share(relative_deviations(model, measurement)),
        {name: points.positions[number] for name, number in on_bed.items()},
    )


def _check(measurement: Measurement) -> None:
    if not measurement.instrument.BY_BEAM:
        raise UserError(f"{measurement.source}: three-point identification needs the points of a laser tracker")
    if measurement.stands_on != "bed":
        raise UserError(
            f"{measurement.source}: three-point identification needs the tracker on the bed (stands_on: bed), "
            "where it observes one axis at a time: write # stands_on: bed into the header if it stood there; ncomp fit "
            "takes all other measurements"
        )
    for name, target in measurement.targets.items():
        if target.free:
            raise UserError(
                f"{measurement.source}: the header does not give the position of target {name} "
                f"(# target.{name}: x y z), which a three-point identification needs"
            )


def _refuse_line(measurement: Measurement, series: Series, points: stations.Points) -> None:
    observed = points.positions[series.numbers[0]]
    spread = np.linalg.svd(observed - observed.mean(axis=0), compute_uv=False)
    if spread[1] < FLAT_TRIANGLE_SHARE * spread[0]:
        raise UserError(
            f"{measurement.source}: the targets {', '.join(series.targets)} on "
            f"{measurement.machine.axes[series.column].name} lie in one line, and a rotation about it is unidentifiable"
        )


def _refuse_unknown(choice: Choice, found: Mapping[str, _Found]) -> None:
    names = {f"{component}{axis}" for axis in found for component in "XYZABC"}
    unknown = sorted(set(choice.degrees) - names)
    if unknown:
        raise UserError(f"degree of E_{unknown[0]}: no such error motion was measured ({', '.join(found)} were)")


def _on_tool(measurement: Measurement, number: np.ndarray) -> dict[int, Array]:
    """Nominal positions `(3,)` of the points on the tool, mm, by number."""
    nominal = measurement.nominal_points
    carrier = np.array([target.carrier for target in measurement.targets.values()])[measurement.target_number]
    return {int(number[row]): nominal[row] for row in np.flatnonzero(carrier == "tool")}


def _identify(
    machine: Machine, series: Series, points: stations.Points, before: Mapping[str, _Found], choice: Choice
) -> _Found:
    """Identification of one axis, given the axes between it and the bed."""
    axis = machine.axes[series.column]
    at_bed = points.positions[series.numbers.reshape(-1)]
    feet, foot = _feet(machine, series, before)
    back = foot.inverse()
    weights = back.rotation @ points.information[series.numbers.reshape(-1)] @ foot.rotation
    n, k = series.numbers.shape
    motions = solve(axis, series.positions, back.apply(at_bed).reshape(n, k, 3), weights.reshape(n, k, 3, 3))
    by_points = np.zeros((at_bed.size, points.positions.size))
    for i, number in enumerate(series.numbers.reshape(-1).tolist()):
        by_points[3 * i : 3 * i + 3, 3 * number : 3 * number + 3] = back.rotation[0]
    for name, pose in feet.items():
        by_points -= _by_foot(machine, before[name], series, pose, at_bed, back)
    positions = series.positions / machine.scale[series.column]
    arc = choice.arcs.get(axis.name) or arc_of(axis, positions)
    table = choice.kind == "table"
    shape = tables(axis, positions, arc) if table else polynomials(axis, positions, choice.degrees, arc)
    return _Found(series, motions, fitted(shape, positions, motions, machine.priors), by_points)


def _feet(machine: Machine, series: Series, before: Mapping[str, _Found]) -> tuple[dict[str, Pose], Pose]:
    """Poses from the bed to the feet of the identified axes in between, and to the foot of this axis."""
    tool_side = machine.axes[series.column].side == "tool"
    inward = range(series.column) if tool_side else range(len(machine.axes) - 1, series.column, -1)
    feet, pose = {}, IDENTITY
    for i in inward:
        axis = machine.axes[i]
        if (axis.side == "tool") == tool_side:
            errors = np.zeros((1, 6))
            if axis.name in before:
                feet[axis.name] = pose
                at = series.standing[[i]] / machine.scale[i]
                curves = before[axis.name].curves
                errors = (curves.design(at) @ curves.parameters)[None] * UNITS
            pose = pose @ outward(axis, series.standing[[i]], errors)
    return feet, pose


def _by_foot(machine: Machine, inward: _Found, series: Series, pose: Pose, at_bed: Array, back: Pose) -> Array:
    """Derivatives `(3kn, 3 points)` of the points at the foot of this axis through an axis nearer to the bed."""
    axis, i = machine.axes[inward.series.column], inward.series.column
    q = series.standing[[i]]
    moved = error_design(axis, q, pose.inverse().apply(at_bed)[None])[0] * UNITS
    errors = inward.curves.design(q / machine.scale[i]) @ inward.parameters_by_points
    return np.asarray((back.rotation @ pose.rotation @ moved).reshape(-1, 6) @ errors)


def _misfit_notes(results: Mapping[str, AxisResult]) -> list[str]:
    misfitting = [
        f"E_{component}{name} ({one.chi2 / one.degrees_of_freedom:.2g})"
        for name, result in results.items()
        for component, one in zip(COMPONENTS, result.misfits, strict=True)
        if one.significant
    ]
    if not misfitting:
        return []
    return [
        f"{', '.join(misfitting)}: the curve deviates from its points by more than their scatter (chi2/dof): u is "
        "increased by its square root; --basis table follows the points"
    ]


def _unresolved(results: Mapping[str, AxisResult]) -> Iterator[str]:
    """A note for each axis with error motions that its positions do not resolve."""
    for name, result in results.items():
        names = [f"E_{COMPONENTS[j]}{name}" for j in result.curves.unresolved]
        if names:
            yield (
                f"{', '.join(names)}: waves shorter than {len(result.positions)} positions resolve are probable, and "
                f"in u: measure {name} at {2 * len(result.positions) - 1} positions"
            )


def _result(machine: Machine, found: _Found, points: stations.Points) -> AxisResult:
    series, motions, by_points = found.series, found.motions, found.motions.estimator @ found.by_points
    axis, inward = machine.axes[series.column], [a.side == machine.axes[series.column].side for a in machine.axes]
    positions = series.positions / machine.scale[series.column]
    covariance = by_points @ points.covariance @ by_points.T
    return AxisResult(
        axis,
        positions,
        series.targets,
        {
            machine.names[i]: float(series.standing[i] / machine.scale[i])
            for i in np.flatnonzero(inward)
            if i != series.column
        },
        motions.errors,
        covariance,
        by_points @ points.repeatability_covariance @ by_points.T,
        motions.location @ motions.errors.reshape(-1),
        found.curves,
        misfits(found.curves, positions, motions, covariance),
    )


def _model(
    measurement: Measurement, found: Mapping[str, _Found], results: Mapping[str, AxisResult], points: stations.Points
) -> ErrorModel:
    """All effects with their covariance."""
    from scipy.linalg import block_diag

    machine = measurement.machine
    carrying = [name for name, one in found.items() if machine.axes[one.series.column].side == "tool"]
    effects: list[Effect] = []
    values: list[Array] = []
    by_points: list[Array] = []
    unseen: list[Array] = []
    for name, one in found.items():
        axis = machine.axes[one.series.column]
        split = axis_model(axis, one.series.positions / machine.scale[one.series.column], one.curves, one.motions)
        parameters = one.curves.parameters
        wider = widening(axis, split.effects, results[name].misfits)[:, None] * split.matrix
        own = one.parameters_by_points
        if carrying and name == carrying[-1] and not axis.rotary:
            shift, shift_by_body = _tool_shift(measurement, one)
            add = constants_design(one.curves)
            parameters = parameters + add @ shift
            own = own + add @ shift_by_body @ one.motions.body_estimator @ one.by_points
        effects += split.effects
        values.append(split.matrix @ parameters)
        by_points.append(wider @ own)
        unseen.append(wider @ one.curves.between)
    inputs = {measurement.source: measurement.fingerprint} if measurement.fingerprint else {}
    source = f"three-point identification{f', {SIMULATED}' if measurement.simulated else ''}"
    made = Provenance("ncomp three-points", datetime.datetime.now(datetime.UTC), source, inputs)
    model = ErrorModel(machine=reference(machine), provenance=made, effects=tuple(effects))
    every = np.concatenate(by_points)
    covariance = propagated(every, points.covariance) + block_diag(*(root @ root.T for root in unseen))
    return model.with_parameters(np.concatenate(values), covariance)


def _tool_shift(measurement: Measurement, found: _Found) -> tuple[Array, Array]:
    """Constants `(6,)`, um and urad, of the linear axis next to the tool, and derivatives `(6, 3k)` by its body points.

    With all error motions zero in the mean, the tool is at the position of its targets, which differs from that on the
    nominal machine. Relative to a rotary table this difference is not a shift of the zero point.
    """
    machine, series = measurement.machine, found.series
    pose = IDENTITY
    for i in range(series.column + 1, len(machine.axes)):
        pose = pose @ outward(machine.axes[i], series.standing[[i]], np.zeros((1, 6)))
    nominal = np.concatenate([pose.apply(measurement.targets[name].position) for name in series.targets])
    moved = error_design(machine.axes[series.column], np.zeros(1), nominal[None])[0] * UNITS
    by_body = np.linalg.pinv(moved.reshape(-1, 6))
    return by_body @ (found.motions.body - nominal).reshape(-1), by_body
