"""The joint estimate of an axis as a calibration: its positioning error as a table, its reversal, their covariance.

The error motion is the mean of both directions if both are known. Its nodes are the fewest rows of the estimate from
which linear interpolation reproduces it, and a pair on both sides of each jump. Its mean is zero, as after every fit
(`calibration.fit.datum`), because a laser's zero is not a property of the axis. The reversal is a backlash, with an
additional table of differences if the reversal changes along the axis.

A laser measures along one line. Joined to a calibration of the same machine, the error motion is the reading minus the
contribution of the other effects of that calibration on that line: angular errors by their arm, and squareness.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import msgspec
import numpy as np

from calibration.continuous.estimate import Estimate, TableRows, estimate
from calibration.continuous.reading import Data
from calibration.continuous.records import QuasiStatic
from calibration.instruments import Interferometer
from calibration.measurement.measurement import Measurement, Target
from calibration.observation.mean_lines import mean_line
from calibration.registration.registration import Registration
from kinematics.basis import BSpline
from kinematics.effects import Backlash, Effect, ErrorMotion, Reversal
from kinematics.effects.base import own_component, own_motion
from kinematics.error_model.covariance import propagated
from kinematics.error_model.model import ErrorModel
from kinematics.error_model.provenance import SIMULATED, Provenance, reference
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError
from kinematics.version import VERSION

NODE_UM, NODE_U = 0.05, 0.5
"""Largest deviation of the linear interpolation from the estimate: um, and as a share of its median uncertainty."""
MOST_CURVE_NODES = 600
"""Largest number of nodes of a table, because the file contains their covariance."""
CHANGES = 3.0
"""Least difference of the reversal at a position from its mean that counts as a change, in standard uncertainties."""
JUMP_MM = 0.05
"""Least distance of the nodes beside a jump from it, mm."""
SAME_TARGET = 1e-6
"""Difference, mm or degrees, up to which two positions or targets are the same."""


@dataclass(frozen=True)
class Line:
    """The measured line: the positions of the other axes at standstill, and the target on the tool."""

    positions: Array
    """Axis positions `(axes,)`, mm and rad; that of the measured axis is ignored."""
    target: Array
    """Position of the target `(3,)`, mm, from the tool reference point."""

    def text(self, machine: Machine, axis: str) -> str:
        """Description for reports."""
        stood = zip(machine.axes, self.positions / machine.scale, strict=True)
        others = " ".join(f"{each.name} {position:g}" for each, position in stood if each.name != axis)
        return f"{others}, target {' '.join(f'{value:g}' for value in self.target)} mm from the tool reference point"


def line_of(measurements: Sequence[Measurement], axis: str) -> Line:
    """The line of all quasi-static readings of the axis; UserError for more than one line."""
    stood, targets = [], []
    for measurement in measurements:
        rows = measurement.axis_rows[axis]
        positions = measurement.state.positions[rows].copy()
        positions[:, measurement.machine.index(axis)] = 0.0
        stood.append(positions)
        targets.append(measurement.tool[rows])
    line = Line(np.concatenate(stood)[0], np.concatenate(targets)[0])
    if (
        np.abs(np.concatenate(stood) - line.positions).max() > SAME_TARGET
        or np.ptp(np.concatenate(targets), axis=0).any()
    ):
        names = ", ".join(measurement.source for measurement in measurements)
        raise UserError(
            f"{names}: the readings of {axis} lie on more than one line (other axes or target differ): give "
            "the readings of one line"
        )
    return line


@dataclass(frozen=True)
class AxisModel:
    """The calibration of one axis, with its notes."""

    model: ErrorModel
    effects: tuple[str, ...]
    """Names of the effects from the estimate."""
    nodes: int
    """Number of nodes of its table."""
    notes: tuple[str, ...]


def axis_model(
    found: Estimate, data: Data, quasi: QuasiStatic, machine: Machine, line: Line, base: ErrorModel | None = None
) -> AxisModel:
    """The estimate as a calibration; with `base`, that calibration with its errors along this axis replaced.

    `quasi`: the quasi-static readings of the estimate.
    """
    both = found.both
    curves = _curves(_with_jumps(found, data, quasi))
    curves, within = _thinned(curves.scaled(own_motion(machine, data.axis)[2]))
    effects, matrix = _effects(machine, data.axis, curves, both)
    covariance = propagated(matrix, curves.covariance)
    own = _with_values(machine, effects, matrix @ curves.values, covariance, _provenance(data, base))
    names, nodes = tuple(effect.name for effect in effects), len(curves.positions)
    notes = [] if within <= NODE_UM else [f"the calibration follows the table within {within:.2g} um"]
    if not both:
        notes.append(f"{found.direction} only: the reversal of {data.axis} is not known, and is not in the calibration")
    where = line.text(machine, data.axis)
    if base is None:
        angles = ", ".join(f"E_{letter}{data.axis}" for letter in "ABC")
        notes.append(f"{names[0]} is that of the line {where}: {angles} are not known and count as zero")
        return AxisModel(own, names, nodes, tuple(notes))
    replaced, model = _joined(own, base, machine, data.axis, line, both)
    notes.append(f"{', '.join(replaced) or 'nothing'} of {base.id} replaced, on the line {where}")
    return AxisModel(model, names, nodes, tuple(notes))


@dataclass(frozen=True)
class _Curves:
    """Error, and reversal if both directions are known, at positions `(n,)`, mm; positive along a positive command."""

    positions: Array
    values: Array
    """`(n,)` or `(2 n,)`: error, then reversal (forward minus backward), um."""
    covariance: Array

    def scaled(self, factor: float) -> _Curves:
        """All values times a factor."""
        return _Curves(self.positions, factor * self.values, factor**2 * self.covariance)

    def at(self, rows: np.ndarray) -> _Curves:
        """Some of the positions."""
        n = len(self.positions)
        both = np.concatenate([rows + k for k in range(0, len(self.values), n)])
        return _Curves(self.positions[rows], self.values[both], self.covariance[np.ix_(both, both)])


def _with_jumps(found: Estimate, data: Data, quasi: QuasiStatic) -> Estimate:
    """The estimate with additional rows close to both sides of each jump."""
    low, high = found.segment
    jump_positions = [
        jump + side * max(each.shape.grain, JUMP_MM)
        for each in found.by_direction.values()
        for jump in each.jumps.positions_mm
        for side in (-1.0, 1.0)
    ]
    inside = [position for position in jump_positions if low < position < high]
    if not inside:
        return found
    grid = found.fused.positions
    near = np.abs(grid[:, None] - inside).min(axis=1) < JUMP_MM
    return estimate(data.records, quasi, positions=np.unique(np.concatenate([grid[~near], inside])))


def _curves(found: Estimate) -> _Curves:
    """Error motion and reversal at the rows of the table, with their joint covariance."""
    fused, count = found.fused, len(found.fused.signs)
    shares = [[0.5, 0.5], [float(fused.signs[0]), float(fused.signs[1])]] if count == 2 else [[1.0]]
    only = next(iter(found.by_direction.values()))
    near_jumps = [found.by_direction.get(sign, only).shape.u_near_jumps(fused.positions) for sign in fused.signs]
    spread = replace(fused, covariance=fused.covariance + np.diag(np.concatenate(near_jumps) ** 2))
    direction = "mean" if count == 2 else found.direction
    error, reversal = found.table(direction), found.table("reversal") if count == 2 else None
    rows = np.flatnonzero(error.continuous)
    total = len(error.position)
    where = np.concatenate([rows + k * total for k in range(count)])
    covariance = np.diag(np.square(np.concatenate([error.u, reversal.u] if reversal is not None else [error.u])))
    scale = np.zeros(count * total)
    scale[:total] = found.quasi.u_per_m * 1e-3 * (error.position - found.quasi.target[0])
    covariance -= np.diag(np.tile(scale[:total] ** 2, count))
    covariance[np.ix_(where, where)] = spread.mixed(shares)[1]
    alone = np.flatnonzero(~error.continuous)
    covariance[alone, alone] += [_unseen(error, row) ** 2 for row in alone.tolist()]
    values = np.concatenate([error.error, reversal.error]) if reversal is not None else error.error
    return _Curves(error.position, values, covariance + np.outer(scale, scale))


def _unseen(table: TableRows, row: int) -> float:
    """Standard uncertainty, um, of a target outside the segment for the unknown error between it and its neighbours.

    No run shows the error there. The value is twice the RMS deviation of the curve inside the segment from the middles
    of straight lines as long as the gap, because in the middle of the gap half of the value remains.
    """
    x, error = table.position[table.continuous], table.error[table.continuous]
    around = table.position[max(row - 1, 0) : row + 2]
    half = min(float(np.diff(around).max()), float(np.ptp(x))) / 2.0
    middles = x[(x - half >= x[0]) & (x + half <= x[-1])]
    if not len(middles):
        middles = np.array([(x[0] + x[-1]) / 2.0])
    ends = (np.interp(middles - half, x, error) + np.interp(middles + half, x, error)) / 2.0
    return 2.0 * float(np.sqrt(np.mean((np.interp(middles, x, error) - ends) ** 2)))


def _thinned(curves: _Curves) -> tuple[_Curves, float]:
    """The curves at the fewest positions that represent them, and the tolerance between these, um."""
    n = len(curves.positions)
    u = np.sqrt(np.maximum(np.diag(curves.covariance), 0.0))
    tolerance = min(NODE_UM, NODE_U * float(np.median(u)))
    columns = curves.values.reshape(-1, n).T
    rows = _nodes(curves.positions, columns, tolerance)
    while len(rows) > MOST_CURVE_NODES:
        tolerance *= 1.5
        rows = _nodes(curves.positions, columns, tolerance)
    thin = curves.at(rows)
    # between nodes the deviation is uniformly distributed within the tolerance
    interpolation = np.where(np.arange(len(thin.values)) < len(rows), tolerance**2 / 3.0, 0.0)
    return _Curves(thin.positions, thin.values, thin.covariance + np.diag(interpolation)), tolerance


def _nodes(x: Array, columns: Array, tolerance: float) -> np.ndarray:
    """Rows from which linear interpolation gives columns `(n, k)` within a tolerance (Douglas and Peucker 1973)."""
    kept, open_ = {0, len(x) - 1}, [(0, len(x) - 1)]
    while open_:
        first, last = open_.pop()
        if last - first < 2:
            continue
        share = ((x[first : last + 1] - x[first]) / (x[last] - x[first]))[:, None]
        straight = columns[first] + share * (columns[last] - columns[first])
        away = np.abs(columns[first : last + 1] - straight).max(axis=1)
        middle = first + int(np.argmax(away))
        if away.max() > tolerance:
            kept.add(middle)
            open_ += [(first, middle), (middle, last)]
    return np.array(sorted(kept))


def _effects(machine: Machine, axis: str, curves: _Curves, both: bool) -> tuple[list[Effect], Array]:
    """The effects without values, and the matrix that gives their parameters from the values of the curves."""
    n, component = len(curves.positions), own_component(axis)
    basis = BSpline(tuple(curves.positions.tolist()), 1)
    mean = mean_line(basis).mean
    centred = np.eye(n) - mean
    zero = (0.0,) * n
    note = "ncomp continuous"
    motion = ErrorMotion(component=component, axis=axis, basis=basis, parameters=zero, u=zero, note=note)
    if not both:
        return [motion], centred
    width = -own_motion(machine, axis)[2] * mean
    effects: list[Effect] = [motion, Backlash(axis=axis, width=0.0, note="ncomp continuous, minus mean reversal")]
    rows = [np.concatenate([centred, np.zeros((n, n))], axis=1), np.concatenate([np.zeros(n), width])[None]]
    changing = np.concatenate([np.zeros((n, n)), centred], axis=1)
    u = np.sqrt(np.maximum(np.diag(changing @ curves.covariance @ changing.T), 0.0))
    if np.any(np.abs(changing @ curves.values) > CHANGES * u):
        rows.append(changing)
        effects.append(Reversal(component=component, axis=axis, basis=basis, differences=zero, note=note))
    return effects, np.concatenate(rows)


def _provenance(data: Data, base: ErrorModel | None) -> Provenance:
    inputs, source = dict(data.fingerprints), f"continuous runs and targets of {data.axis}"
    if base is not None:
        inputs, source = base.provenance.inputs | inputs, f"{base.provenance.source}; {source}".removeprefix("; ")
    if data.simulated or (base is not None and base.invented):  # announced on every use
        source += f", {SIMULATED}"
    now = datetime.datetime.now(datetime.UTC).replace(microsecond=0)
    return Provenance(f"ncomp {VERSION}", now, source, inputs)


def _with_values(
    machine: Machine, effects: Sequence[Effect], values: Array, covariance: Array, made: Provenance
) -> ErrorModel:
    model = ErrorModel(machine=reference(machine), provenance=made, effects=tuple(effects))
    return model.with_parameters(values, covariance)


def _joined(
    own: ErrorModel, base: ErrorModel, machine: Machine, axis: str, line: Line, both: bool
) -> tuple[list[str], ErrorModel]:
    """Names of the replaced effects of `base`, and `base` with the effects of the axis in their stead."""
    is_replaced = _replaced_by(axis, both)
    unchanged = base.part(lambda effect: not is_replaced(effect))
    motion = own.error_motions[0][0]
    nodes = np.array(motion.basis.nodes) if isinstance(motion.basis, BSpline) else np.zeros(0)
    line_readings = _along(machine, axis, nodes, line)
    registration = Registration(zeros={str(line_readings.groups[0]): 0.0})
    forward = own_motion(machine, axis)[2]
    effects, instrument = unchanged.observation(machine, line_readings.state), line_readings.instrument
    shown = forward * 1e3 * instrument.expected(line_readings, registration, effects)[:, 0]
    transform = instrument.transform(line_readings, registration)
    design = unchanged.observation_design(machine, line_readings.state, transform)[:, 0] * (forward * 1e3)
    centred = np.eye(len(nodes)) - mean_line(motion.basis).mean
    n, old = len(own.parameters), len(unchanged.parameters)
    sensitivity = np.zeros((n, old))
    sensitivity[: len(nodes)] = -centred @ design
    values = own.parameters.copy()
    values[: len(nodes)] -= centred @ shown
    kept = np.array(unchanged.covariance) if unchanged.covariance is not None else np.diag(_variances(unchanged))
    whole = np.zeros((old + n, old + n))
    whole[:old, :old], whole[old:, old:] = kept.reshape(old, old), own.covariance
    covariance = propagated(np.block([[np.eye(old), np.zeros((old, n))], [sensitivity, np.eye(n)]]), whole)
    model = msgspec.structs.replace(base, effects=(*unchanged.effects, *own.effects), provenance=own.provenance)
    replaced = [effect.name for effect in base.effects if is_replaced(effect)]
    return replaced, model.with_parameters(np.concatenate([unchanged.parameters, values]), covariance)


def _variances(model: ErrorModel) -> Array:
    return np.square([u for effect in model.effects for u in effect.uncertainties])


def _replaced_by(axis: str, both: bool) -> Callable[[Effect], bool]:
    """Condition for the effects to replace: the positioning error of the axis, and its reversal if that is known."""

    def is_replaced(effect: Effect) -> bool:
        """True for an effect of the present model in whose place the measured errors of the axis come."""
        if not effect.IN_POSITIONING or effect.axes != (axis,) or effect.part != "own":
            return False
        return both or effect.IN_POSITIONING == "mean"

    return is_replaced


def _along(machine: Machine, axis: str, nodes: Array, line: Line) -> Measurement:
    """A laser measurement at the nodes, without a direction of approach."""
    n, i = len(nodes), machine.index(axis)
    positions = np.tile(line.positions, (n, 1))
    positions[:, i] = nodes
    state = State(positions, approach=np.zeros(positions.shape), target=np.full(n, "1"))
    targets: Mapping[str, Target] = {"1": Target(tuple(line.target.tolist()))}
    names, run = np.full(n, axis), np.full(n, "1")
    return Measurement(machine, Interferometer(u_um=1.0), state, np.zeros((n, 1)), targets, axis=names, run=run)
