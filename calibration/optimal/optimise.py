"""An optimised measurement: from requirements to a plan and a tracker position.

The plan has the least mean variance of the aligned volumetric error for a number of points or of minutes. Its positions
and targets come from an exchange (`calibration.optimal.exchange`), the tracker position from a comparison of smaller
plans. The fitted model is not known yet: the error motions are assumed to be smooth (Legendre polynomials, the higher
the smaller).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from calibration.design.basis_draws import with_other_effects
from calibration.design.equations import Columns
from calibration.design.layout import laid_out
from calibration.design.volume import Volume
from calibration.instruments import Instrument, LaserTracker
from calibration.measurement.plan import Choices, Plan
from calibration.observation.full_model import parse_basis
from calibration.observation.reach import Reach
from calibration.optimal.candidates import Obstacle, positions, positions_around, visible_from, with_targets
from calibration.optimal.exchange import Selection, exchanged, filled
from calibration.optimal.measuring_order import plan_of
from calibration.simulation.simulate import tracker_pose
from kinematics.basis import Legendre
from kinematics.effects import Effect
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine, Vector
from kinematics.running.progress import Progress, numbered, silent
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError

BASIS = "legendre:12"
"""Basis of linear axes; its k-th parameter is expected to have the typical size over 1 + k: errors are smooth."""
ROTARY_BASIS = "fourier:3"
FREE = 1e-9
"""Prior information on the registration."""
EXCHANGES = 40
IN_LITTLE = 4
"""Factor by which candidates and points are reduced to compare tracker positions."""
VISIBLE = 0.3
"""Largest standard uncertainty of a required effect, as a share of its typical size."""
WEIGHT, HEAVIER, TIMES = 1.0, 4.0, 7
"""Weight of the variance of required effects, its growth factor, and the largest number of attempts."""


@dataclass(frozen=True)
class Request:
    """Requirements of the measurement, and obstacles."""

    choices: Choices
    """Targets, ranges, timing; rotary axes."""
    points: int | None = None
    minutes: float | None = None
    trackers: Sequence[Vector] = ()
    """Tracker positions to choose from, mm; empty for positions around the volume."""
    reach: Reach | None = None
    obstacles: Sequence[Obstacle] = ()
    visible: Sequence[Effect] = ()
    candidates: int = 2000
    change_min: float = 5.0
    """Time to change the target, min."""


@dataclass(frozen=True)
class Optimised:
    """The plan, and its predicted uncertainty."""

    plan: Plan
    tracker: Vector
    expected_um: float
    """RMS volumetric error, um, from noise and from undetermined parameters, for errors of typical size."""
    visible: Mapping[str, float] = field(default_factory=dict)
    """Standard uncertainties of the required effects, as shares of their typical sizes."""


@dataclass(frozen=True)
class _Field:
    """Candidates and their equations for one tracker position."""

    state: State
    rows: Array
    """F of `Selection`."""
    prior: Array
    evaluated: Array
    allowed: np.ndarray
    other_effects: Mapping[str, int]
    """Columns of the amplitudes of effects, by name."""

    def selection(self, weight: float = 0.0) -> Selection:
        """An empty selection, with a weight on the variance of the required effects."""
        weights = np.zeros(len(self.prior))
        weights[list(self.other_effects.values())] = weight
        return Selection(self.rows, self.prior, self.evaluated + np.diag(weights), np.zeros(len(self.rows), bool))


def optimised(machine: Machine, instrument: Instrument, request: Request, progress: Progress = silent) -> Optimised:
    """The best plan that is found; UserError where no target is visible, or where no plan shows a required effect."""
    if not isinstance(instrument, LaserTracker):
        raise UserError("an optimised plan needs a laser tracker")
    if (request.points is None) == (request.minutes is None):
        raise UserError("an optimised plan needs either a number of points or a number of minutes")
    candidates = positions(machine, request.choices, request.candidates)
    tracker = _tracker(machine, instrument, request, candidates, numbered(progress, 1, 2))
    choosing = numbered(progress, 2, 2)
    choosing("equations of all positions")
    found = _field_from(machine, instrument, request, candidates, tracker)
    number = _number(machine, request, found)
    _refuse_hidden(found)
    chosen = _chosen(found, number, request, choosing)
    plan, visible = _plan_and_visible(machine, instrument, request, found, chosen, tracker)
    evaluated = found.evaluated
    spread = np.linalg.inv(found.prior + _information(found.rows[chosen]))
    return Optimised(plan, tracker, float(np.sqrt(np.sum(evaluated * spread))), visible)


def _tracker(
    machine: Machine, instrument: LaserTracker, request: Request, candidates: Array, progress: Progress
) -> Vector:
    """The tracker position from which a smaller plan of the same kind is best."""
    first = next(iter(request.choices.targets.values()))
    trackers = list(request.trackers) or positions_around(machine, request.choices, first)
    if len(trackers) == 1:
        return trackers[0]
    timing = request.choices.timing
    number = request.points or int((request.minutes or 0.0) * 60.0 / (timing.dwell_s or timing.point_s))
    some, values = candidates[::IN_LITTLE], []
    for k, tracker in enumerate(trackers, start=1):
        progress(f"position {k} of {len(trackers)} of the tracker", (k - 1) / len(trackers))
        try:
            found = _field_from(machine, instrument, request, some, tracker)
        except UserError:
            values.append(np.inf)
            continue
        selection = found.selection()
        filled(selection, number // IN_LITTLE, found.allowed)
        values.append(selection.variance)
    if not np.isfinite(min(values)):
        raise UserError("the tracker observes no point from any of its possible positions")
    return trackers[int(np.argmin(values))]


def _field_from(
    machine: Machine, instrument: LaserTracker, request: Request, candidates: Array, tracker: Vector
) -> _Field:
    """The candidates and their equations, for one tracker position."""
    targets = request.choices.targets
    state = with_targets(candidates, targets)
    pose = tracker_pose(tracker, np.random.default_rng(0))
    visible = np.flatnonzero(visible_from(machine, state, targets, tracker, pose, request.reach, request.obstacles))
    if not len(visible):
        raise UserError("the tracker observes none of the positions from its own position")
    state = state.rows(visible)
    columns = _columns(machine, instrument, request, _plan_at(machine, state, request), tracker)
    rows, prior, evaluated, other_effects = equations_of(columns, len(state))
    return _Field(state, rows, prior, evaluated, np.ones(len(state), bool), other_effects)


def _plan_at(machine: Machine, state: State, request: Request) -> Plan:
    """The states as a plan."""
    names = np.full(len(state), "1")
    return Plan(machine, "optimised", state, names, names, request.choices.targets, position_count=len(state))


def _columns(machine: Machine, instrument: LaserTracker, request: Request, plan: Plan, tracker: Vector) -> Columns:
    setup = laid_out(plan, instrument, [tracker])
    low, high = (ends(plan.positions / machine.scale, axis=0) for ends in (np.min, np.max))
    turned = {
        axis.name: (float(low[i]), float(high[i]))
        for i, axis in enumerate(machine.axes)
        if axis.rotary and high[i] > low[i]
    }
    volumes = [Volume.of(machine, target.position, turned) for target in request.choices.targets.values()]
    return Columns(setup, volumes, request.visible)


def equations_of(
    columns: Columns, n: int, basis: str = BASIS, rotary_basis: str = ROTARY_BASIS, free: float = FREE
) -> tuple[Array, Array, Array, dict[str, int]]:
    """F, P and B of `Selection`, and the columns of the amplitudes of effects besides the error motions.

    free: prior information on the registration, whose columns have unit length.
    """
    bases = {axis: parse_basis(rotary_basis if axis[0] in "ABC" else basis) for axis in columns.measurement.moving}
    model = columns.model(with_other_effects(columns, bases))
    table = [(effect.name, quantity) for effect in model.effects for quantity in effect.parameter_table]
    scale = np.array([quantity.typical if quantity.linear else 0.0 for _, quantity in table]) * _smooth(model)
    own = columns.registration
    rows = np.concatenate([own, columns.observed(model) * scale], axis=1)
    prior = np.diag(np.append(np.full(own.shape[1], free), np.ones(len(scale))))
    evaluated_in = columns.evaluated(model) * scale
    evaluated = np.zeros_like(prior)
    evaluated[own.shape[1] :, own.shape[1] :] = evaluated_in.T @ evaluated_in / (len(evaluated_in) / 3)
    first = sum(len(effect.parameters) for effect in model.effects[: len(model.effects) - len(columns.other_effects)])
    other_effects = {
        f"{name} {quantity.name}": own.shape[1] + k
        for k, (name, quantity) in enumerate(table)
        if k >= first and quantity.linear
    }
    return rows.reshape(n, -1, rows.shape[1]), prior, evaluated, other_effects


def _smooth(model: ErrorModel) -> Array:
    """Sizes `(p,)` of the parameters, as shares of the typical one."""
    sizes = np.ones(len(model.parameters))
    for motion, part in model.error_motions:
        if isinstance(motion.basis, Legendre):
            sizes[part] = 1.0 / np.arange(1, len(motion.parameters) + 1)
    return sizes


def _number(machine: Machine, request: Request, found: _Field) -> int:
    """Number of points; for a number of minutes, from the duration of plans through that many candidates."""
    if request.points is not None:
        number = request.points
    else:
        assert request.minutes is not None
        low, high = 0, len(found.state) + 1
        while high - low > 1:
            middle = (low + high) // 2
            spread = np.linspace(0, len(found.state) - 1, middle).astype(int)
            low, high = (
                (middle, high) if _minutes(machine, request, found, spread) <= request.minutes else (low, middle)
            )
        number = low
    if not 10 <= number <= len(found.state):
        raise UserError(
            f"{number} points: an optimised plan needs at least 10, and at most the {len(found.state)} that the "
            "tracker observes"
        )
    return number


def _minutes(machine: Machine, request: Request, found: _Field, rows: np.ndarray) -> float:
    return _as_plan(machine, request, found, rows).minutes if len(rows) else 0.0


def _as_plan(
    machine: Machine, request: Request, found: _Field, rows: np.ndarray, shuffled: np.random.Generator | None = None
) -> Plan:
    assert found.state.target is not None
    return plan_of(
        machine, found.state.positions[rows], found.state.target[rows], request.choices.targets, request.choices.timing,
        request.change_min, shuffled=shuffled,
    )  # fmt: skip


def _refuse_hidden(found: _Field) -> None:
    """UserError for a required effect that all candidates together do not show."""
    if found.other_effects:
        spread = np.linalg.inv(found.prior + _information(found.rows))
        for name, k in found.other_effects.items():
            if spread[k, k] > VISIBLE**2:
                raise UserError(
                    f"{name} cannot be separated from the error motions and the tracker's position: measured at all of "
                    f"{len(found.rows)} positions it would be known to {np.sqrt(spread[k, k]):.0%} of its typical size"
                )


def _chosen(found: _Field, number: int, request: Request, progress: Progress) -> np.ndarray:
    """Numbers of the best candidates; the weight of required effects grows until the candidates show them."""
    weight = WEIGHT
    for _ in range(TIMES):
        selection = found.selection(weight if request.visible else 0.0)
        filled(selection, number, found.allowed, partial(progress, "choosing positions"))
        progress("exchanging positions")
        exchanged(selection, found.allowed, EXCHANGES)
        if all(selection.spread[k, k] <= VISIBLE**2 for k in found.other_effects.values()):
            break
        weight *= HEAVIER
    return np.flatnonzero(selection.chosen)


def _plan_and_visible(
    machine: Machine, instrument: LaserTracker, request: Request, found: _Field, chosen: np.ndarray, tracker: Vector
) -> tuple[Plan, dict[str, float]]:
    """The plan of these candidates in an order that shows the required effects; UserError when none does."""
    u: dict[str, float] = {}
    for shuffled in (None, np.random.default_rng(request.choices.seed)):
        plan = _as_plan(machine, request, found, chosen, shuffled)
        if not request.visible:
            return plan, {}
        columns = _columns(machine, instrument, request, plan, tracker)
        rows, prior, _, other_effects = equations_of(columns, len(plan))
        spread = np.linalg.inv(prior + _information(rows))
        u = {name: float(np.sqrt(spread[k, k])) for name, k in other_effects.items()}
        if max(u.values()) <= VISIBLE:
            return plan, u
    worst = max(u, key=lambda name: u[name])
    raise UserError(
        f"{len(chosen)} points from {', '.join(f'{v:g}' for v in tracker)} determine {worst} to "
        f"{u[worst]:.0%} of its typical size only, {VISIBLE:.0%} are required: take more points, more "
        "targets, or another instrument"
    )


def _information(rows: Array) -> Array:
    flat = rows.reshape(-1, rows.shape[2])
    return np.asarray(flat.T @ flat)
