"""The datum: conventions, not priors, fix directions that no measurement shows; and the location errors in it.

A rigid motion of the whole workpiece frame, and constants that can belong to either of two axes, have no effect on a
workpiece (once it is clamped and probed). Such directions of the parameters, the gauge, follow from the normal
equations of an ideal measurement: random positions, four tool vectors, one unknown pose. Along them the parameters are
moved (S-transformation of geodesy) until

- the mean of every error motion of the linear axes is zero, and so is the slope of E_YX, E_ZX and E_ZY: X is x, and Y
  lies in the x y plane; only the mean rotations of the linear axis nearest to the tool stay: they are the orientation
  of the tool;
- a rotary axis has no mean shift along, and no mean rotation about, its own line, and no first harmonic that rotates
  with the part it carries: such a harmonic is a shift, or a tilt, of that part

as nearly as the gauge allows. The translations of a linear axis are taken at the centre of the measured points, so that
the datum does not depend on the origin of the frame. The uncertainties are then relative to this datum.

Location errors are the mean lines of the axes, by ISO 230-1: the mean of the error motions of a rotary axis across its
line is the location error of its axis average line, the slope of a straightness at the centre of the measured points
the orientation of a linear axis. Both become separate effects, with their covariance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import get_args

import msgspec
import numpy as np

from calibration.fit.linear import pseudo_inverse, singular_values
from calibration.fit.problem import Problem, Solved
from calibration.instruments import LaserTracker
from calibration.measurement.measurement import Measurement, Target
from calibration.observation.mean_lines import Line, mean_line
from calibration.registration.registration import Registration
from kinematics.basis import Basis
from kinematics.effects import COMPONENTS, CentredMotion, Component, Effect, ErrorMotion, LocationError
from kinematics.effects.base import UM, URAD, own_component
from kinematics.error_model.covariance import propagated
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Axis, Machine
from kinematics.state import State
from kinematics.transforms import IDENTITY, Array, rotation_about
from kinematics.turn import columns_of

DATUM_SLOPES = ("E_YX", "E_ZX", "E_ZY")
"""Straightness slopes that are zero by convention: X is x, Y lies in the x y plane."""
RULED = 2e-3
"""Share of the largest singular value below which the rules leave a direction of the gauge open.

Along such a direction the rules would give large parameters that only cancel one another.
"""
HARMONIC_RULE_WEIGHT = 1e-2
"""Weight of the rules for first harmonics, which only some bases represent exactly."""
SHORTEST_TURN_RAD = np.deg2rad(60.0)
"""Shortest range of a rotary axis, rad, over which a first harmonic differs from a constant."""
NULL_EIGENVALUE = 1e-9
"""Eigenvalues below this share of the largest count as zero."""
GAUGE = 1e-2
"""Largest information of the ideal measurement, to 1 um, on the gauge, with parameters in units of their priors."""
AT_ORIGIN: Mapping[str, Array] = {}
"""The arms of points at the origin of the frame, about which the error motions of every linear axis are written."""
ALIGNED = 1e-9
"""Largest deviation of a unit vector's component from 1 for an axis along a direction of the machine's frame."""
IN_SPAN = 1e-9
"""Largest relative misfit of a line that a basis represents."""


def model_in_datum(model: ErrorModel, measurement: Measurement, prior: Array) -> ErrorModel:
    """A model that was fitted to a measurement, in the datum, with its location errors.

    prior `(p,)`: prior sizes of its parameters, in their units.
    """
    machine, arms = measurement.machine, measurement.arms
    moved = transformed(model, model.effects, to_datum(machine, model, prior, arms))
    moved = transformed(moved, *about_own_points(moved))
    return transformed(moved, *split_locations(machine, moved, arms))


def null_space(information: Array) -> Array:
    """Orthonormal directions `(p, k)` on which an information matrix has no information."""
    return pseudo_inverse(information, NULL_EIGENVALUE, 1.0).null


def gauge(machine: Machine, model: ErrorModel, prior: Array) -> Array:
    """Directions `(p, k)` of the parameters, in prior units and orthonormal, that no measurement can show."""
    motions = model.error_motions
    columns = np.concatenate([np.arange(part.start, part.stop) for _, part in motions] or [np.zeros(0, int)])
    found = np.zeros((len(prior), 0))
    if len(columns):
        alone = msgspec.structs.replace(model, effects=tuple(effect for effect, _ in motions), covariance=None)
        values, vectors = np.linalg.eigh(_ideal(machine, alone, prior[columns]).information)
        inner = vectors[:, values < GAUGE]
        found = np.zeros((len(prior), inner.shape[1]))
        found[columns] = inner
    return _with_constants(found, motions, prior)


def _with_constants(found: Array, motions: Sequence[tuple[ErrorMotion, slice]], prior: Array) -> Array:
    """The directions, and the constants of axes with a positioning error alone, which is relative to their own zero."""
    axes = [effect.axis for effect, _ in motions]
    constants = np.zeros((len(prior), 0))
    for effect, part in motions:
        if axes.count(effect.axis) == 1 and effect.component == own_component(effect.axis):
            x = np.linspace(*effect.basis.interval, 801)
            column = np.zeros((len(prior), 1))
            column[part, 0] = np.linalg.lstsq(effect.basis.columns(x), np.ones_like(x), rcond=None)[0]
            column[part, 0] /= np.where(np.isfinite(prior[part]), prior[part], 1.0)
            constants = np.concatenate([constants, column / np.linalg.norm(column)], axis=1)
    if not constants.shape[1]:
        return found
    u, values, _ = singular_values(np.concatenate([found, constants], axis=1))
    return np.asarray(u[:, values > NULL_EIGENVALUE])


def to_datum(machine: Machine, model: ErrorModel, prior: Array, arms: Mapping[str, Array] = AT_ORIGIN) -> Array:
    """The matrix `(p, p)` that moves parameters, in their units, along the gauge into the datum.

    arms: those of the measured points, as `arms_of`.
    """
    free = gauge(machine, model, prior)
    if not free.shape[1]:
        return np.eye(len(prior))
    scale = np.where(np.isfinite(prior), prior, 1.0)
    rules = _rules(machine, model, arms) * scale
    u, values, directions = np.linalg.svd(rules @ free)
    ruled = int(np.sum(values > RULED * values.max(initial=0.0)))
    by_rules = (u[:, :ruled] / values[:ruled]).T @ rules
    least = directions[ruled:] @ free.T  # components that the rules do not determine are removed
    along = directions.T @ np.concatenate([by_rules, least])
    return np.asarray((np.eye(len(prior)) - free @ along) * scale[:, None] / scale)


def _rules(machine: Machine, model: ErrorModel, arms: Mapping[str, Array]) -> Array:
    """Linear functions `(rules, p)` of the parameters, um and urad, that are zero in the datum."""
    rows, axes = [], _by_name(machine)
    known = {effect.axis for effect, _ in model.error_motions}
    last = [axis.name for axis in machine.axes if not axis.rotary and axis.name in known][-1:]
    for effect, _ in model.error_motions:
        line = line_at_centre(model, effect, arms)
        axis = axes[effect.axis]
        if (
            effect.component in along_own_line(effect.axis)
            if axis.rotary
            else not (effect.axis in last and effect.angular)
        ):
            rows.append(line.mean)
        if effect.name in DATUM_SLOPES:
            rows.append(line.slope * (effect.basis.interval[1] - effect.basis.interval[0]))
    return np.array([*rows, *_carried_harmonics(machine, model)]).reshape(-1, len(model.parameters))


def _carried_harmonics(machine: Machine, model: ErrorModel) -> Iterator[Array]:
    """First harmonics of rotary axes that rotate with the carried part, as functions `(p,)` of the parameters."""
    by_name = {effect.name: (effect, part) for effect, part in model.error_motions}
    for axis in machine.axes:
        for letters in ("XYZ", "ABC"):
            found = [by_name.get(f"E_{letter}{axis.name}") for letter in letters]
            motions = [motion for motion in found if motion is not None]
            if not axis.rotary or len(motions) < 3:
                continue
            low, high = np.deg2rad(motions[0][0].basis.interval)
            if high - low < SHORTEST_TURN_RAD:
                continue
            q = np.linspace(low, high, 201)
            line = axis.error_frame.T @ axis.unit_direction
            across = np.linalg.svd(line[None])[2][1:]
            after_turn = rotation_about(line, q if axis.side == "tool" else -q) @ across.T
            at_zero = np.broadcast_to(across.T, after_turn.shape)
            # rotating component of a curve that is the sum of a constant and a rotating vector
            columns = np.concatenate([at_zero, after_turn], axis=2).swapaxes(0, 1).reshape(-1, 4)
            parts = np.linalg.pinv(columns)[2:].reshape(2, 3, len(q))
            for turned in parts:
                row = np.zeros(len(model.parameters))
                for (effect, part), weights in zip(motions, turned, strict=True):
                    row[part] = HARMONIC_RULE_WEIGHT * weights @ columns_of(axis, effect.basis, np.rad2deg(q))
                yield row


def _by_name(machine: Machine) -> dict[str, Axis]:
    return {axis.name: axis for axis in machine.axes}


def along_own_line(axis: str) -> str:
    """Letters of the components along the line of a rotary axis: the rotation about it, then the shift."""
    own = own_component(axis)
    return own + "XYZ"["ABC".index(own)]


def _ideal(machine: Machine, model: ErrorModel, prior: Array) -> Solved:
    """The solution of the normal equations of the ideal measurement."""
    rng = np.random.default_rng(0)
    ends = _ends(machine, model.effects)
    n = 4 * len(prior) + 200
    positions = rng.uniform(ends[0], ends[1], (n, len(machine.axes)))
    size = 0.3 * max(_reach(machine, ends), 100.0)
    targets = {"o": (0.0, 0.0, 0.0), "x": (size, 0.0, 0.0), "y": (0.0, size, 0.0), "z": (0.0, 0.0, size)}
    if not any(effect.angular for effect, _ in model.error_motions):  # the model has no rotation of the tool
        targets = {"o": targets["o"]}
    state = State(positions, target=rng.choice(list(targets), n))
    seen = np.zeros((n, 3))
    ideal = Measurement(
        machine,
        LaserTracker(u_range_um=1.0, u_angle_um=1.0),
        state,
        seen,
        {name: Target(vector) for name, vector in targets.items()},
    )
    registration = Registration({"1": IDENTITY}, {"1": np.zeros(3)})
    problem = Problem(ideal, model, np.broadcast_to(1e3 * np.eye(3), (n, 3, 3)), ideal.stops, prior)
    return problem.solve(problem.point(np.array(model.parameters), registration), np.ones(n), 1.0)


def _reach(machine: Machine, ends: Array) -> float:
    """Longest travel of a linear axis, mm; without linear axes the longest distance of an axis line's point."""
    if machine.rotary.all():
        return max(float(np.linalg.norm(axis.point)) for axis in machine.axes)
    return float(np.ptp(ends[:, ~machine.rotary], axis=0).max())


def _ends(machine: Machine, effects: tuple[Effect, ...]) -> Array:
    """Ends `(2, axes)`, mm and rad, of the intervals of the effects; zero for axes without effects."""
    ends = np.zeros((2, len(machine.axes)))
    for effect in effects:
        for axis, interval in effect.intervals.items():
            i = machine.index(axis)
            ends[:, i] = np.array(interval) * machine.scale[i]
    return ends


def split_locations(
    machine: Machine, model: ErrorModel, arms: Mapping[str, Array] = AT_ORIGIN
) -> tuple[tuple[Effect, ...], Array]:
    """Effects with the location errors, still zero, in front; and the matrix `(q, p)` from old to new parameters.

    Linear axes that do not lie along x, y or z keep their slopes. arms: those of the measured points, as `arms_of`.
    """
    matrix = np.eye(len(model.parameters))
    found: list[LocationError] = []
    rows: list[Array] = []
    for effect, part in model.error_motions:
        located = None if effect.name in DATUM_SLOPES else _location(machine, model, effect, arms)
        if located is None:
            continue
        location, row, function = located
        matrix[part] -= np.outer(function, row)
        found.append(location)
        rows.append(row)
    return (*found, *model.effects), np.concatenate([np.array(rows).reshape(-1, matrix.shape[1]), matrix])


def transformed(model: ErrorModel, effects: tuple[Effect, ...], matrix: Array) -> ErrorModel:
    """The model with these effects, whose parameters are `matrix` times the old ones, and their covariance."""
    moved = msgspec.structs.replace(model, effects=effects)
    return moved.with_parameters(matrix @ model.parameters, propagated(matrix, np.array(model.covariance)))


def _location(
    machine: Machine, model: ErrorModel, effect: ErrorMotion, arms: Mapping[str, Array]
) -> tuple[LocationError, Array, Array] | None:
    """Location error in an error motion, its value as a function `(p,)` of all parameters, and `(size,)` of one unit.

    None where there is none, or the basis cannot represent it.
    """
    axis, line = _by_name(machine)[effect.axis], line_at_centre(model, effect, arms)
    if axis.rotary:
        if effect.component in along_own_line(effect.axis):
            return None
        component, value, coefficients = effect.component, line.mean, _written(effect, np.ones_like)
    else:
        if effect.angular:
            return None
        # the line deviates from d by angle x d per mm, so that angle = d x slope; 1 um per mm is 1000 urad
        along = axis.error_frame.T @ axis.unit_direction
        turn = np.cross(along, np.eye(3)["XYZ".index(effect.component)])
        k = int(np.argmax(np.abs(turn)))
        if abs(abs(turn[k]) - 1.0) > ALIGNED:
            return None
        component, value = get_args(Component)[3 + k], turn[k] * line.slope * 1e3
        coefficients = _written(effect, lambda x: turn[k] * x * 1e-3)
    return None if coefficients is None else (LocationError(component, effect.axis, 0.0), value, coefficients)


def _written(effect: ErrorMotion, function: Callable[[Array], Array]) -> Array | None:
    """Parameters `(size,)` of a function of position; None when the basis cannot represent it."""
    x = np.linspace(*effect.basis.interval, 801)
    columns, values = effect.basis.columns(x), function(x)
    parameters, *_ = np.linalg.lstsq(columns, values, rcond=None)
    misfit = np.abs(columns @ parameters - values).max()
    return np.asarray(parameters) if misfit < IN_SPAN * np.abs(values).max() else None


def about_own_points(model: ErrorModel) -> tuple[tuple[Effect, ...], Array]:
    """The effects of a model with all angular error motions about the axes' own points, and the matrix `(p, p)`.

    It takes the parameters of the model to those of these effects.
    """
    matrix = np.eye(len(model.parameters))
    effects = list(model.effects)
    parts = list(zip(model.effects, model.slices, strict=True))
    motions = model.error_motions
    for i, (turn, rows) in enumerate(parts):
        if isinstance(turn, CentredMotion):
            effects[i] = turn.at_own_point()
            for letter, arm in zip(COMPONENTS[:3], turn.shift * URAD / UM, strict=True):
                own = [(each, part) for each, part in motions if each.name == f"E_{letter}{turn.axis}"]
                # a diagnosis may have refined one error motion of the axis
                shift, part = max(own, key=lambda one: (one[0].basis == turn.basis, one[0].basis.size))
                matrix[part, rows] += arm * _written_in(shift.basis, turn.basis)
    return tuple(effects), matrix


def _written_in(basis: Basis, other: Basis) -> Array:
    """Matrix `(q, p)` from the parameters of a function in another basis to those of the nearest one in a basis."""
    if basis == other:
        return np.eye(basis.size)
    x = np.linspace(*other.interval, 801)
    return np.asarray(np.linalg.lstsq(basis.columns(x), other.columns(x), rcond=None)[0])


def line_at_centre(model: ErrorModel, motion: ErrorMotion, arms: Mapping[str, Array]) -> Line:
    """Mean line of a translation of a linear axis at the centre of the measured points, by all parameters `(p,)`.

    Of any other error motion: its own mean line. arms: as `arms_of`.
    """
    found = Line(np.zeros(len(model.parameters)), np.zeros(len(model.parameters)))
    own = np.zeros((3, 3)) if motion.angular else arms.get(motion.axis, np.zeros((3, 3)))
    direction = COMPONENTS.index(motion.component) % 3
    for effect, part in model.error_motions:
        if effect.axis == motion.axis:
            weight = 1.0 if effect is motion else 0.0
            if effect.angular and not motion.angular:
                moved = own[direction, COMPONENTS.index(effect.component) % 3]
                moved += effect.shift[direction]
                weight = moved * URAD / UM
            mean, slope = mean_line(effect.basis)
            found.mean[part] += weight * mean
            found.slope[part] += weight * slope
    return found
