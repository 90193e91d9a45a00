"""An optimised measurement: from requirements to a plan and a tracker position.

The plan has the least mean variance of the aligned volumetric error for a number of points or of minutes. Its positions
and targets come from an exchange (`calibration.optimal.exchange`), the tracker position from a comparison of smaller
plans. The fitted model is not known yet: the error motions are assumed to be smooth (Legendre polynomials, the higher
the smaller).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from calibration.design.basis_draws import with_besides
from calibration.design.equations import Columns
from calibration.design.layout import laid_out
from calibration.design.volume import Volume
from calibration.measurement.instruments import Instrument, LaserTracker
from calibration.measurement.plan import Choices, Plan
from calibration.observation.full_model import moving_axes, parse_basis
from calibration.observation.reach import Reach
from calibration.optimal.candidates import Obstacle, places_around, positions, seen, with_targets
from calibration.optimal.exchange import Selection, exchanged, filled
from calibration.optimal.measuring_order import plan_of
from calibration.simulation.simulate import tracker_pose
from kinematics.basis import Legendre
from kinematics.effects import Effect, ErrorMotion
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine, Vector
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
class Wish:
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
    besides: Mapping[str, int]
    """Columns of the amplitudes of effects, by name."""

    def selection(self, weight: float = 0.0) -> Selection:
        """An empty selection, with a weight on the variance of the required effects."""
        weights = np.zeros(len(self.prior))
        weights[list(self.besides.values())] = weight
        return Selection(self.rows, self.prior, self.evaluated + np.diag(weights), np.zeros(len(self.rows), bool))


def optimised(
    machine: Machine, instrument: Instrument, wish: Wish, progress: Callable[[str], None] = lambda _: None
) -> Optimised:
    """The best plan that is found; UserError where no target is visible, or where no plan shows a required effect."""
    if not isinstance(instrument, LaserTracker):
        raise UserError("an optimised plan is for a laser tracker")
    if (wish.points is None) == (wish.minutes is None):
        raise UserError("an optimised plan takes a number of points or of minutes, one of the two")
    places = positions(machine, wish.choices, wish.candidates)
    tracker = _tracker(machine, instrument, wish, places, progress)
    progress("positions")
    found = _seen_from(machine, instrument, wish, places, tracker)
    number = _number(machine, wish, found)
    _refuse_hidden(found)
    chosen = _chosen(found, number, wish)
    plan, visible = _planned(machine, instrument, wish, found, chosen, tracker)
    evaluated = found.evaluated
    spread = np.linalg.inv(found.prior + _information(found.rows[chosen]))
    return Optimised(plan, tracker, float(np.sqrt(np.sum(evaluated * spread))), visible)


def _tracker(
    machine: Machine, instrument: LaserTracker, wish: Wish, places: Array, progress: Callable[[str], None]
) -> Vector:
    """The tracker position from which a smaller plan of the same kind is best."""
    first = next(iter(wish.choices.targets.values()))
    trackers = list(wish.trackers) or places_around(machine, wish.choices, first)
    if len(trackers) == 1:
        return trackers[0]
    timing = wish.choices.timing
    number = wish.points or int((wish.minutes or 0.0) * 60.0 / (timing.dwell_s or timing.point_s))
    some, values = places[::IN_LITTLE], []
    for k, tracker in enumerate(trackers, start=1):
        progress(f"place {k} of {len(trackers)} of the tracker")
        try:
            found = _seen_from(machine, instrument, wish, some, tracker)
        except UserError:
            values.append(np.inf)
            continue
        selection = found.selection()
        filled(selection, number // IN_LITTLE, found.allowed)
        values.append(selection.variance)
    if not np.isfinite(min(values)):
        raise UserError("the tracker sees nothing from any of the places it may stand at")
    return trackers[int(np.argmin(values))]


def _seen_from(machine: Machine, instrument: LaserTracker, wish: Wish, places: Array, tracker: Vector) -> _Field:
    """The candidates and their equations, for one tracker position."""
    targets = wish.choices.targets
    state = with_targets(places, targets)
    pose = tracker_pose(tracker, np.random.default_rng(0))
    visible = np.flatnonzero(seen(machine, state, targets, tracker, pose, wish.reach, wish.obstacles))
    if not len(visible):
        raise UserError("the tracker sees none of the positions from where it stands")
    state = state.rows(visible)
    columns = _columns(machine, instrument, wish, _plan_at(machine, state, wish), tracker)
    rows, prior, evaluated, besides = _equations(columns, len(state))
    return _Field(state, rows, prior, evaluated, np.ones(len(state), bool), besides)


def _plan_at(machine: Machine, state: State, wish: Wish) -> Plan:
    """The states as a plan."""
    names = np.full(len(state), "1")
    return Plan(machine, "optimised", state, names, names, wish.choices.targets, places=len(state))


def _columns(machine: Machine, instrument: LaserTracker, wish: Wish, plan: Plan, tracker: Vector) -> Columns:
    setup = laid_out(plan, instrument, [tracker])
    low, high = (ends(plan.positions / machine.scale, axis=0) for ends in (np.min, np.max))
    turned = {
        axis.name: (float(low[i]), float(high[i]))
        for i, axis in enumerate(machine.axes)
        if axis.rotary and high[i] > low[i]
    }
    volumes = [Volume.of(machine, target.position, turned) for target in wish.choices.targets.values()]
    return Columns(setup, volumes, wish.visible)


def _equations(columns: Columns, n: int) -> tuple[Array, Array, Array, dict[str, int]]:
    """F, P and B of `Selection`, and the columns of the amplitudes of effects besides the error motions."""
    bases = {
        axis: parse_basis(ROTARY_BASIS if axis[0] in "ABC" else BASIS) for axis in moving_axes(columns.measurement)
    }
    model = columns.model(with_besides(columns, bases))
    table = [(effect.name, quantity) for effect in model.effects for quantity in effect.parameter_table]
    scale = np.array([quantity.typical if quantity.linear else 0.0 for _, quantity in table]) * _smooth(model)
    own = columns.registration
    rows = np.concatenate([own, columns.observed(model) * scale], axis=1)
    prior = np.diag(np.append(np.full(own.shape[1], FREE), np.ones(len(scale))))
    seen_in = columns.evaluated(model) * scale
    evaluated = np.zeros_like(prior)
    evaluated[own.shape[1] :, own.shape[1] :] = seen_in.T @ seen_in / (len(seen_in) / 3)
    first = sum(len(effect.parameters) for effect in model.effects[: len(model.effects) - len(columns.besides)])
    besides = {
        f"{name} {quantity.name}": own.shape[1] + k
        for k, (name, quantity) in enumerate(table)
        if k >= first and quantity.linear
    }
    return rows.reshape(n, -1, rows.shape[1]), prior, evaluated, besides


def _smooth(model: ErrorModel) -> Array:
    """Sizes `(p,)` of the parameters, as shares of the typical one."""
    return np.concatenate(
        [
            1.0 / np.arange(1, len(effect.parameters) + 1)
            if isinstance(effect, ErrorMotion) and isinstance(effect.basis, Legendre)
            else np.ones(len(effect.parameters))
            for effect in model.effects
        ]
    )


def _number(machine: Machine, wish: Wish, found: _Field) -> int:
    """Number of points; for a number of minutes, from the duration of plans through that many candidates."""
    if wish.points is not None:
        number = wish.points
    else:
        assert wish.minutes is not None
        low, high = 0, len(found.state) + 1
        while high - low > 1:
            middle = (low + high) // 2
            spread = np.linspace(0, len(found.state) - 1, middle).astype(int)
            low, high = (middle, high) if _minutes(machine, wish, found, spread) <= wish.minutes else (low, middle)
        number = low
    if not 10 <= number <= len(found.state):
        raise UserError(
            f"{number} points: an optimised plan has at least 10, and at most the {len(found.state)} it sees"
        )
    return number


def _minutes(machine: Machine, wish: Wish, found: _Field, rows: np.ndarray) -> float:
    return _as_plan(machine, wish, found, rows).minutes if len(rows) else 0.0


def _as_plan(
    machine: Machine, wish: Wish, found: _Field, rows: np.ndarray, shuffled: np.random.Generator | None = None
) -> Plan:
    assert found.state.target is not None
    return plan_of(
        machine, found.state.positions[rows], found.state.target[rows], wish.choices.targets, wish.choices.timing,
        wish.change_min, shuffled=shuffled,
    )  # fmt: skip


def _refuse_hidden(found: _Field) -> None:
    """UserError for a required effect that all candidates together do not show."""
    if found.besides:
        spread = np.linalg.inv(found.prior + _information(found.rows))
        for name, k in found.besides.items():
            if spread[k, k] > VISIBLE**2:
                raise UserError(
                    f"{name} can't be told from the error motions and the tracker's place: measured at all of "
                    f"{len(found.rows)} positions it would be known to {np.sqrt(spread[k, k]):.0%} of its typical size"
                )


def _chosen(found: _Field, number: int, wish: Wish) -> np.ndarray:
    """Numbers of the best candidates; the weight of required effects grows until the candidates show them."""
    weight = WEIGHT
    for _ in range(TIMES):
        selection = found.selection(weight if wish.visible else 0.0)
        filled(selection, number, found.allowed)
        exchanged(selection, found.allowed, EXCHANGES)
        if all(selection.spread[k, k] <= VISIBLE**2 for k in found.besides.values()):
            break
        weight *= HEAVIER
    return np.flatnonzero(selection.chosen)


def _planned(
    machine: Machine, instrument: LaserTracker, wish: Wish, found: _Field, chosen: np.ndarray, tracker: Vector
) -> tuple[Plan, dict[str, float]]:
    """The plan of these candidates in an order that shows the required effects; UserError when none does."""
    told: dict[str, float] = {}
    for shuffled in (None, np.random.default_rng(wish.choices.seed)):
        plan = _as_plan(machine, wish, found, chosen, shuffled)
        if not wish.visible:
            return plan, {}
        columns = _columns(machine, instrument, wish, plan, tracker)
        rows, prior, _, besides = _equations(columns, len(plan))
        spread = np.linalg.inv(prior + _information(rows))
        told = {name: float(np.sqrt(spread[k, k])) for name, k in besides.items()}
        if max(told.values()) <= VISIBLE:
            return plan, told
    worst = max(told, key=lambda name: told[name])
    raise UserError(
        f"{len(chosen)} points from {', '.join(f'{v:g}' for v in tracker)} would show {worst} to {told[worst]:.0%} of "
        f"its typical size only, {VISIBLE:.0%} are wanted: more points, more targets, or another instrument"
    )


def _information(rows: Array) -> Array:
    flat = rows.reshape(-1, rows.shape[2])
    return np.asarray(flat.T @ flat)
