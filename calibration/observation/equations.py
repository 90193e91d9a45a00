"""The observation equations: expected observations and their derivatives, for each kind of instrument.

observed = registration(points of the machine with errors) + shift by the instrument's own effects + noise. Values are
exact; derivatives are those at nominal positions, first order in the errors.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.measurement.instruments import Ballbar, Interferometer, Part, TouchProbe
from calibration.measurement.measurement import Distance, Measurement
from calibration.measurement.observed_points import carried, derivatives_by_errors, target_points
from calibration.measurement.registration import PLANAR, RIGID, SHIFTS, Registration, rigid
from kinematics.deviation import exact_deviation
from kinematics.effects import COMPONENTS
from kinematics.error_model.model import Observation
from kinematics.error_transform import error_transform_with_tool, pose_slopes
from kinematics.forward import axis_frames
from kinematics.transforms import Array, Pose, by_turn, turn

LENGTH = "length"
"""Name of the error of a ballbar's length among the zeros of a registration."""
CENTRE_U, LENGTH_ABOUT = 10.0, 1.0
"""Standard uncertainties of the stated position of a table ball, and of a length that is not calibrated, mm."""
NEAR_MM, CLOSE_MM, ROUNDS = 0.01, 1e-6, 10
"""Weight of the readings in a first registration of a ballbar as an uncertainty, and its last step, mm; most steps."""
IN_LINE = 1.0
"""RMS distance of points from a line, mm, below which they do not determine the instrument's rotation about it."""


def start(measurement: Measurement, trusted: np.ndarray) -> Registration:
    """A first registration, from the nominal machine and the rows in the mask `trusted` `(n,)`.

    Poses of the instrument come from targets on the tool where these suffice: positions of other targets are guesses.
    """
    names, groups = np.unique(measurement.groups).tolist(), measurement.groups
    if isinstance(measurement.instrument, Interferometer):
        across = dict.fromkeys(np.unique(groups[measurement.straightness]).tolist(), 0.0)
        zeros = {name: _mean_zero(measurement, (groups == name), trusted) for name in names}
        return Registration(zeros=zeros, slopes=across)
    if isinstance(measurement.instrument, TouchProbe):
        return _first_centres(measurement, trusted)
    if isinstance(measurement.instrument, Ballbar):
        return _first_table_balls(measurement, trusted)
    planar = measurement.instrument.components == 2
    points = target_points(measurement, None, measurement.tool)
    observed = _in_space(measurement, points)
    known = np.array([target.known for target in measurement.targets.values()])[measurement.target_number]
    poses, centres = {}, {}
    for name in names:
        mine = groups == name
        # with too few trusted rows, all rows of the station count
        choices = [rows for rows in (mine & trusted & known, mine & trusted) if rows.sum() >= (2 if planar else 3)]
        rows = next((rows for rows in choices if planar or width(points[rows]) > IN_LINE), [*choices, mine][0])
        poses[name] = rigid(points[rows], observed[rows], planar=planar)
        centres[name] = observed[rows].mean(axis=0)
    registration = Registration(poses, centres, PLANAR if planar else RIGID)
    return replace(registration, targets=_first_targets(measurement, registration))


def width(points: Array) -> float:
    """RMS distance, mm, of points `(n, 3)` from the line that fits them best."""
    return float(np.linalg.norm(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1:]) / len(points) ** 0.5)


def expected(measurement: Measurement, registration: Registration, effects: Observation) -> Array:
    """Expected observations `(n, d)`, mm and rad, in the components that count, with these effects.

    NaN for runs of an interferometer whose zero is missing in the registration.
    """
    if isinstance(measurement.instrument, Interferometer):
        machine, q = measurement.machine, measurement.state.positions
        position, turned = exact_deviation(machine, q, effects.errors, measurement.tool)
        along = np.concatenate([position, turned], axis=1)
        zeros = np.array([registration.zeros.get(group, np.nan) for group in measurement.groups.tolist()])
        slopes = np.array([registration.slopes.get(group, 0.0) for group in measurement.groups.tolist()])
        return np.asarray((np.sum(_lines(measurement) * along, axis=1) + zeros + slopes * _own(measurement))[:, None])
    errors = effects.errors if effects.errors.any() else None
    points = target_points(measurement, errors, registration.tool(measurement))
    seen = registration.apply(measurement, points) + effects.shift
    if isinstance(measurement.instrument, Ballbar):
        return np.asarray(np.linalg.norm(seen, axis=1, keepdims=True) + registration.zeros[LENGTH])
    return _counted(measurement, seen)


def transform(measurement: Measurement, registration: Registration) -> Array:
    """Derivatives `(n, d, (axes + 1) * 6 + 3)`: by the error motions, and by the shift of the observed point.

    This is the transform that `ErrorModel.observation_design` expects.
    """
    n = len(measurement)
    if isinstance(measurement.instrument, Interferometer):
        six = error_transform_with_tool(measurement.machine, measurement.state.positions, measurement.tool)
        own = np.einsum("nk,nkp->np", _lines(measurement), six)[:, None]
        return np.concatenate([own, np.zeros((n, 1, 3))], axis=2)
    seen = derivatives_by_errors(measurement, registration.tool(measurement))
    own = registration.rotations(measurement) @ seen
    shift = np.broadcast_to(np.eye(3), (n, 3, 3))
    derivatives = np.concatenate([own, shift], axis=2)
    if isinstance(measurement.instrument, Ballbar):
        return np.asarray(along_bar(measurement, registration)[:, None] @ derivatives)
    return _counted(measurement, derivatives)


def registration_design(measurement: Measurement, registration: Registration) -> Array:
    """Derivatives `(n, d, parameters)` by the registration, at the machine's nominal points."""
    n, groups = len(measurement), measurement.groups
    if isinstance(measurement.instrument, Interferometer):
        zeros = [np.equal(groups, group).astype(float)[:, None] for group in registration.zeros]
        position = _own(measurement)
        slopes = [np.where(groups == group, position, 0.0)[:, None] for group in registration.slopes]
        return np.stack([*zeros, *slopes], axis=2)
    points = registration.apply(measurement, target_points(measurement, None, registration.tool(measurement)))
    columns = []
    for group, centre in registration.centres.items():
        own = np.zeros((n, 3, 6))
        rows = groups == group
        own[rows, :, :3] = np.eye(3)
        own[rows, :, 3:] = by_turn(points[rows] - centre)
        columns.append(own[:, :, registration.move_numbers])
    if isinstance(measurement.instrument, Ballbar):
        length = np.ones((n, 1, len(registration.zeros)))
        moves = along_bar(measurement, registration)[:, None] @ np.concatenate(columns, axis=2)
        return np.concatenate([moves, length], axis=2)
    turns = registration.rotations(measurement) @ carried(measurement) if registration.targets else None
    numbers = {name: i for i, name in enumerate(measurement.targets)}
    for name in registration.targets:
        assert turns is not None
        columns.append(np.where(np.equal(measurement.target_number, numbers[name])[:, None, None], turns, 0.0))
    return _counted(measurement, np.concatenate(columns, axis=2))


def along_bar(measurement: Measurement, registration: Registration) -> Array:
    """Unit vectors `(n, 3)` from a ballbar's table ball to its tool ball, of the nominal machine."""
    points = registration.apply(measurement, target_points(measurement, None, measurement.tool))
    return np.asarray(points / np.linalg.norm(points, axis=1, keepdims=True))


def stated_residuals(measurement: Measurement, registration: Registration) -> Array:
    """Stated minus present values `(k,)` of the registration, in standard uncertainties; exact.

    Of a touch probe the calibrated distances of its spheres; of a ballbar its length and where its table ball is.
    """
    if isinstance(measurement.instrument, Ballbar):
        centres = [np.subtract(measurement.spheres[name], own) for name, own in registration.sphere_centres.items()]
        length = -registration.zeros[LENGTH] / length_u(measurement.instrument)
        return np.append(np.concatenate(centres) / CENTRE_U, length)
    return distance_residuals(measurement, registration)


def stated_design(measurement: Measurement, registration: Registration) -> Array:
    """Derivatives `(k, registration)` of the stated values by the registration, in standard uncertainties."""
    if isinstance(measurement.instrument, Ballbar):
        moves = len(registration.names) - 1
        return np.diag(np.append(np.full(moves, -1.0 / CENTRE_U), 1.0 / length_u(measurement.instrument)))
    return distance_design(measurement, registration)


def length_u(bar: Ballbar) -> float:
    """Standard uncertainty of a bar's length, mm; a length that is not calibrated is only about right."""
    return LENGTH_ABOUT if bar.length_u_um is None else bar.length_u_um * 1e-3


def distance_residuals(measurement: Measurement, registration: Registration) -> Array:
    """Calibrated minus present distances between spheres `(k,)`, in standard uncertainties; exact."""
    if not measurement.distances:
        return np.zeros(0)
    centres = registration.sphere_centres
    return np.array(
        [
            (each.length - float(np.linalg.norm(centres[each.one] - centres[each.other]))) / each.u
            for each in known_distances(measurement, registration)
        ]
    )


def distance_design(measurement: Measurement, registration: Registration) -> Array:
    """Derivatives `(k, registration)` of the distances by the registration, in standard uncertainties."""
    centres, columns = registration.sphere_centres, {name: i for i, name in enumerate(registration.names)}
    known = known_distances(measurement, registration)
    design = np.zeros((len(known), len(columns)))
    for row, each in zip(design, known, strict=True):
        apart = centres[each.one] - centres[each.other]
        along = apart / np.linalg.norm(apart) / each.u
        for sphere, sign in ((each.one, -1.0), (each.other, 1.0)):  # the registration shifts by minus the centre
            row[[columns[f"pose {sphere} {move}"] for move in SHIFTS]] = sign * along
    return design


def known_distances(measurement: Measurement, registration: Registration) -> list[Distance]:
    """The calibrated distances between spheres that are in the registration."""
    return [each for each in measurement.distances if {each.one, each.other} <= registration.poses.keys()]


def covariance(measurement: Measurement) -> Array:
    """Covariances `(n, d, d)`, mm2 or rad2, of the components that count, each row by itself.

    By the estimated noise of the measurement, else by the specification.
    """
    specified = specified_covariance(measurement)
    return specified if measurement.noise is None else measurement.noise.covariance(specified)


def specified_covariance(measurement: Measurement) -> Array:
    """Covariances `(n, d, d)`, mm2 or rad2, by the instrument's specification; rows in motion are means.

    Specification and scatter describe the same readings (GUM 4.3.10): scatter counts as far as it exceeds the
    specification of the instrument.
    """
    instrument = measurement.instrument
    if isinstance(instrument, Interferometer):
        return _along_axes(measurement, instrument)
    if isinstance(instrument, Part):
        u = (instrument.u_um + instrument.u_um_per_m * 1e-3 * np.linalg.norm(measurement.observed, axis=1)) * 1e-3
        return np.asarray(u[:, None, None] ** 2 * np.eye(instrument.components))
    if isinstance(instrument, Ballbar):
        return np.full((len(measurement), 1, 1), (instrument.u_um * 1e-3) ** 2)
    if isinstance(instrument, TouchProbe):
        return np.tile((instrument.u_um * 1e-3) ** 2 * np.eye(3), (len(measurement), 1, 1))
    whole, across = instrument.covariance(measurement.observed), measurement.across
    if across is None:
        return whole if measurement.scatter is None else _widened(whole, measurement.scatter)
    return np.asarray(across.of(whole) @ np.swapaxes(across.directions, 1, 2) / across.readings[:, None, None])


def _widened(covariances: Array, scatter: Array) -> Array:
    """Covariances `(n, 3, 3)` whose mean variance is at least that of the scatter `(n,)`."""
    surplus = scatter**2 - np.trace(covariances, axis1=1, axis2=2) / 3.0
    return np.asarray(covariances + np.maximum(surplus, 0.0)[:, None, None] * np.eye(3))


def _counted(measurement: Measurement, vectors: Array) -> Array:
    """The components that count, `(n, d, ...)`, of vectors `(n, 3, ...)` in the instrument's frame."""
    if measurement.across is None:
        return vectors[:, : measurement.components]
    return measurement.across.of(vectors)


def _lines(measurement: Measurement) -> Array:
    """Directions `(n, 6)`, of displacement or rotation, in which an interferometer measures, workpiece frame.

    The direction is that of the axis' motion, or of the error frame for a named error motion.
    """
    machine = measurement.machine
    assert measurement.axis is not None
    slopes = pose_slopes(machine, measurement.state.positions)
    lines = np.zeros((len(measurement), 6))
    for name in np.unique(measurement.axis).tolist():
        i, rows = machine.index(name), measurement.axis == name
        part = slice(3, 6) if machine.axes[i].rotary else slice(0, 3)
        lines[rows, part] = slopes[rows, part, i]
    return lines if measurement.component is None else _named_lines(measurement, lines, measurement.component)


def _named_lines(measurement: Measurement, lines: Array, component: np.ndarray) -> Array:
    """The directions `(n, 6)`; those of named error motions are axes of the error frame."""
    machine = measurement.machine
    assert measurement.axis is not None
    frames = axis_frames(machine, measurement.state.positions)
    for name, letter in np.unique(np.stack([measurement.axis, component], axis=1).astype(str), axis=0).tolist():
        if not letter:
            continue
        i, k = machine.index(name), COMPONENTS.index(letter)
        rows = np.flatnonzero((measurement.axis == name) & (component == letter))
        along = turn(frames[i].rotation, machine.axes[i].error_frame[:, k % 3])
        lines[rows] = 0.0
        lines[rows[:, None], 3 * (k // 3) + np.arange(3)] = np.broadcast_to(along, (len(lines), 3))[rows]
    return lines


def _own(measurement: Measurement) -> Array:
    """Positions `(n,)` of the measured axis, mm or rad."""
    return np.asarray(measurement.state.positions[np.arange(len(measurement)), _own_column(measurement)])


def _own_column(measurement: Measurement) -> np.ndarray:
    """Column `(n,)` of the measured axis."""
    assert measurement.axis is not None
    names = measurement.axis.tolist()
    columns = {name: measurement.machine.index(name) for name in set(names)}
    return np.array([columns[name] for name in names], int)


def _along_axes(measurement: Measurement, instrument: Interferometer) -> Array:
    """Covariances `(n, 1, 1)` of an interferometer; mm2, of rotary axes rad2."""
    machine, column, position = measurement.machine, _own_column(measurement), _own(measurement)
    _, first, run = np.unique(measurement.groups, return_index=True, return_inverse=True)
    away = np.abs(position - position[first[run]])
    metres = np.where(machine.rotary[column], 0.0, away * 1e-3)
    u = np.where(
        measurement.straightness,
        instrument.u_straightness_um + instrument.u_straightness_um_per_m * metres,
        instrument.u_um + instrument.u_um_per_m * metres,
    )
    u = np.where(measurement.angular & ~machine.rotary[column], instrument.u_angle_urad, u)
    return np.asarray(((u * np.where(measurement.angular, 1e-6, 1e-3)) ** 2)[:, None, None])


def _first_centres(measurement: Measurement, trusted: np.ndarray) -> Registration:
    """First centres of the spheres of a touch probe: medians over the trusted rows, where a sphere has any."""
    shifts, groups = measurement.observed - target_points(measurement, None, measurement.tool), measurement.groups
    poses, centres = {}, {}
    for name in np.unique(groups).tolist():
        mine = groups == name
        rows = mine & trusted if (mine & trusted).any() else mine
        poses[name] = Pose(np.eye(3)[None], np.median(shifts[rows], axis=0)[None])
        centres[name] = np.zeros(3)
    return Registration(poses, centres, SHIFTS)


def _first_table_balls(measurement: Measurement, trusted: np.ndarray) -> Registration:
    """First centres of a ballbar's table balls and the error of its length, from the stated ones, by trusted rows."""
    n = len(measurement)
    nominal = Observation(np.zeros((n, len(measurement.machine.axes) + 1, 6)), np.zeros((n, 3)))
    names = np.unique(measurement.groups).tolist()
    poses = {name: Pose(np.eye(3)[None], -np.array([measurement.spheres[name]])) for name in names}
    found = Registration(poses, dict.fromkeys(names, np.zeros(3)), SHIFTS, {LENGTH: 0.0})
    for _ in range(ROUNDS):
        residual = (measurement.observed - expected(measurement, found, nominal))[trusted, 0]
        rows = registration_design(measurement, found)[trusted, 0] / NEAR_MM
        matrix = np.concatenate([rows, stated_design(measurement, found)])
        right = np.concatenate([residual / NEAR_MM, stated_residuals(measurement, found)])
        step = np.linalg.lstsq(matrix, right)[0]
        found = found.moved(step)
        if np.abs(step).max() < CLOSE_MM:
            break
    return found


def _mean_zero(measurement: Measurement, mine: np.ndarray, trusted: np.ndarray) -> float:
    """Mean reading of a run, mm or rad."""
    return float(measurement.observed[mine & trusted if (mine & trusted).any() else mine].mean())


def _first_targets(measurement: Measurement, registration: Registration) -> dict[str, Array]:
    """Positions `(3,)`, mm, of free targets and targets on table and bed: medians over their rows, with first poses."""
    unknown = [name for name, target in measurement.targets.items() if not target.known]
    found = {name: np.array(measurement.targets[name].position) for name in unknown}
    if not found:
        return found
    at_zero = registration.apply(measurement, target_points(measurement, None, np.zeros((len(measurement), 3))))
    there = registration.rotations(measurement) @ carried(measurement)
    positions = turn(np.swapaxes(there, 1, 2), measurement.observed - at_zero)
    for number, name in enumerate(measurement.targets):
        rows = measurement.target_number == number
        if name in found and rows.any():
            found[name] = np.median(positions[rows], axis=0)
    return found


def _in_space(measurement: Measurement, points: Array) -> Array:
    """Observed points `(n, 3)`; z of a part that is measured in x and y is nominal."""
    missing = points[:, measurement.instrument.components :]
    return np.concatenate([measurement.observed, missing], axis=1)
