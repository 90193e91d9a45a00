"""An optimised measurement: from requirements to a plan with its stations, targets and positions.

The plan has the least mean variance of the aligned volumetric error for a number of points or of minutes. Its positions
come from an exchange (`calibration.optimal.exchange`), the stations and targets from a comparison of possible ones
(`calibration.optimal.set_ups`). The fitted model is not known yet: the error motions are assumed to be smooth (Legendre
polynomials, the higher the smaller).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from calibration.design.basis_draws import with_other_effects
from calibration.design.equations import Columns
from calibration.design.layout import laid_out
from calibration.design.volume import Volume
from calibration.fit.identifiability import Unidentifiable
from calibration.instruments import Instrument
from calibration.measurement.measurement import Target
from calibration.measurement.plan import Choices, Plan
from calibration.observation.full_model import parse_basis
from calibration.observation.reach import Reach
from calibration.optimal.candidates import Obstacle, places_around, positions, refuse_inside, visible, with_set_ups
from calibration.optimal.exchange import Selection, exchanged, filled
from calibration.optimal.hidden import hidden_from
from calibration.optimal.measuring_order import plan_of
from calibration.optimal.set_ups import SetUps, best_set_ups
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
PRIOR_REGISTRATION_INFORMATION = 1e-9
"""Prior information on the registration."""
EXCHANGES = 40
NAMING_ROWS = 1000
"""Number of rows of the fit that names what the stations and targets do not show."""
CANDIDATE_ROWS, FEWEST_CANDIDATES = 20_000, 100
"""Rows in which possible stations and targets are compared, and the least number of positions of each there."""
LEAST_POINTS_OF_STATION = 10
"""Least number of points of a station: its registration, and some that check it."""
VISIBLE = 0.3
"""Largest standard uncertainty of a required effect, as a share of its typical size."""
WEIGHT, HEAVIER, TIMES = 1.0, 4.0, 7
"""Weight of the variance of required effects, its growth factor, and the largest number of attempts."""

Stations = Mapping[str, Vector]


@dataclass(frozen=True)
class Request:
    """Requirements of the measurement, and obstacles."""

    choices: Choices
    """Targets to choose from, ranges, timing; rotary axes."""
    points: int | None = None
    minutes: float | None = None
    trackers: Sequence[Vector] = ()
    """Places to choose the stations from, mm; empty for places around the volume."""
    reach: Reach | None = None
    obstacles: Sequence[Obstacle] = ()
    visible: Sequence[Effect] = ()
    candidates: int = 2000
    stations: int | None = None
    """Number of stations; None for that of the instrument."""
    targets: int | None = None
    """Number of targets; None for all."""
    change_min: float = 5.0
    """Time to change the target, min."""


@dataclass(frozen=True)
class Optimised:
    """The plan, with its stations, and its predicted uncertainty."""

    plan: Plan
    expected_um: float
    """RMS volumetric error, um, from noise and from undetermined parameters, for errors of typical size."""
    visible: Mapping[str, float]
    """Standard uncertainties of the required effects, as shares of their typical sizes."""
    hidden: tuple[Unidentifiable, ...]
    """Errors that these stations and targets cannot show, by any positions, with reason and remedy."""


@dataclass(frozen=True)
class _Field:
    """Candidates and their equations for some stations and targets."""

    stations: Stations
    targets: Mapping[str, Target]
    state: State
    rows: Array
    """F of `Selection`."""
    prior: Array
    evaluated: Array
    registration: int
    """Number of columns of the registration, the first ones."""
    other_effects: Mapping[str, int] = field(default_factory=dict)
    """Columns of the amplitudes of effects, by name."""

    @property
    def least(self) -> int:
        """Least number of points of a station: more than it has unknowns of its own."""
        return max(LEAST_POINTS_OF_STATION, self.registration // len(self.stations) + 1)

    def selection(self, weight: float = 0.0) -> Selection:
        """An empty selection, with a weight on the variance of the required effects."""
        weights = np.zeros(len(self.prior))
        weights[list(self.other_effects.values())] = weight
        return Selection(self.rows, self.prior, self.evaluated + np.diag(weights), np.zeros(len(self.rows), bool))

    def evenly(self, number: int) -> Array:
        """Information of so many points of each station, spread evenly over its candidates."""
        assert self.state.station is not None
        shares = {name: number / np.count_nonzero(self.state.station == name) for name in self.stations}
        weights = np.sqrt([shares[name] for name in self.state.station.tolist()])
        return _information(self.rows * weights[:, None, None])


def optimised(machine: Machine, instrument: Instrument, request: Request, progress: Progress = silent) -> Optimised:
    """The best plan that is found; UserError where no target is visible, or where no plan shows a required effect."""
    if not instrument.STATIONED:
        raise UserError("an optimised plan needs a laser tracker or ranges (--instrument ranging)")
    if (request.points is None) == (request.minutes is None):
        raise UserError("an optimised plan needs either a number of points or a number of minutes")
    candidates = positions(machine, request.choices, request.candidates)
    stations, targets = _set_ups(machine, instrument, request, candidates, numbered(progress, 1, 2))
    choosing = numbered(progress, 2, 2)
    choosing("equations of all positions")
    found = _field_of(machine, instrument, request, candidates[:: len(stations)], stations, targets)
    number = _number(machine, instrument, request, found)
    _refuse_hidden(found)
    chosen = _chosen(found, number, request, choosing)
    plan, shown = _plan_and_visible(machine, instrument, request, found, chosen)
    spread = np.linalg.inv(found.prior + _information(found.rows[chosen]))
    expected = float(np.sqrt(np.sum(found.evaluated * spread)))
    return Optimised(plan, expected, shown, hidden_from(_all_of_set_ups(machine, found, chosen), instrument))


def _all_of_set_ups(machine: Machine, found: _Field, chosen: np.ndarray) -> Plan:
    """Candidates, as a plan, of the stations and targets of the chosen ones: more of them would not show more."""
    assert found.state.station is not None
    assert found.state.target is not None
    pairs = np.char.add(np.char.add(found.state.station, " "), found.state.target)
    rows = np.flatnonzero(np.isin(pairs, pairs[chosen]))
    return _unordered(machine, found.state.rows(rows[:: 1 + len(rows) // NAMING_ROWS]), found.stations, found.targets)


def _unordered(machine: Machine, state: State, stations: Stations, targets: Mapping[str, Target]) -> Plan:
    """The states as a plan."""
    names = np.full(len(state), "1")
    return Plan(machine, "optimised", state, names, names, targets, position_count=len(state), stations=stations)


def _set_ups(
    machine: Machine, instrument: Instrument, request: Request, candidates: Array, progress: Progress
) -> tuple[Stations, Mapping[str, Target]]:
    """The stations and targets that leave the least variance, of all possible ones."""
    targets, count = request.choices.targets, request.stations or instrument.STATIONS
    wanted = request.targets or len(targets)
    if wanted > len(targets):
        raise UserError(f"{wanted} targets are wanted, but only {len(targets)} are given to choose from (--target)")
    refuse_inside(machine, request.choices, request.trackers)
    places = list(dict.fromkeys(request.trackers)) or places_around(machine, request.choices)
    if len(places) < count:
        raise UserError(
            f"{count} stations are wanted, but only {len(places)} places are given: give more places (--tracker), "
            f"or ask for fewer stations (--stations {len(places)})"
        )
    stations = {f"s{k}": place for k, place in enumerate(places, start=1)}
    if len(places) == count and wanted == len(targets):
        return stations, targets
    progress(f"{count} of {len(places)} places of the instrument")
    step = max(
        1,
        len(candidates)
        * len(places)
        * len(targets)
        // max(CANDIDATE_ROWS, FEWEST_CANDIDATES * len(places) * len(targets)),
    )
    found = _field_of(machine, instrument, request, candidates[::step], stations, targets)
    number = request.points or int((request.minutes or 0.0) * 60.0 / _point_s(request))
    own = slice(found.registration, None)
    compared = SetUps(found.state, found.rows, own, found.prior, found.evaluated)
    chosen, used = best_set_ups(compared, tuple(found.stations), tuple(targets), (count, wanted), number)
    named = {f"s{k}": stations[name] for k, name in enumerate(chosen, start=1)}
    return named, {name: targets[name] for name in used}


def _point_s(request: Request) -> float:
    return request.choices.timing.dwell_s or request.choices.timing.point_s


def _field_of(
    machine: Machine,
    instrument: Instrument,
    request: Request,
    candidates: Array,
    stations: Stations,
    targets: Mapping[str, Target],
) -> _Field:
    """The candidates that the instrument sees, and their equations; stations that see too few are left out.

    UserError where fewer stations than wanted are left.
    """
    state = with_set_ups(candidates, list(targets), list(stations))
    seen = visible(machine, instrument, state, targets, stations, request.reach, request.obstacles)
    assert state.station is not None
    counts = {name: int(np.count_nonzero(seen[state.station == name])) for name in stations}
    used = {name: place for name, place in stations.items() if counts[name] >= LEAST_POINTS_OF_STATION}
    _refuse_too_few(instrument, stations, used, request.stations or instrument.STATIONS)
    state = state.rows(np.flatnonzero(seen & np.isin(state.station, list(used))))
    columns = _columns(machine, instrument, request, _unordered(machine, state, used, targets))
    rows, prior, evaluated, other_effects = equations_of(columns, len(state))
    return _Field(used, targets, state, rows, prior, evaluated, columns.registration.shape[1], other_effects)


def _refuse_too_few(instrument: Instrument, stations: Stations, used: Stations, wanted: int) -> None:
    """UserError where fewer of the stations than wanted see the targets."""
    if len(used) >= wanted:
        return
    blind = [f"{x:g},{y:g},{z:g}" for name, (x, y, z) in stations.items() if name not in used]
    several = f" and {len(blind) - 3} more" if len(blind) > 3 else ""
    raise UserError(
        f"the {instrument.kind()} observes none of the positions, or fewer than {LEAST_POINTS_OF_STATION}, from "
        f"{'; '.join(blind[:3])}{several}: obstacles and the limits of the beam (--elevation, --incidence, --beam-mm) "
        f"leave {len(used)} of {len(stations)} places with a line of sight, and {wanted} are needed: give other places "
        "(--tracker)"
    )


def _columns(machine: Machine, instrument: Instrument, request: Request, plan: Plan) -> Columns:
    setup = laid_out(plan, instrument)
    low, high = (ends(plan.positions / machine.scale, axis=0) for ends in (np.min, np.max))
    turned = {
        axis.name: (float(low[i]), float(high[i]))
        for i, axis in enumerate(machine.axes)
        if axis.rotary and high[i] > low[i]
    }
    volumes = [Volume.of(machine, target.position, turned) for target in request.choices.targets.values()]
    return Columns(setup, volumes, request.visible)


def equations_of(
    columns: Columns,
    n: int,
    basis: str = BASIS,
    rotary_basis: str = ROTARY_BASIS,
    free: float = PRIOR_REGISTRATION_INFORMATION,
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


def _number(machine: Machine, instrument: Instrument, request: Request, found: _Field) -> int:
    """Number of points; for a number of minutes, from the duration of plans through that many candidates."""
    if request.points is not None:
        number = request.points
    else:
        assert request.minutes is not None
        low, high = 1, len(found.state) + 1
        while high - low > 1:
            middle = (low + high) // 2
            spread = np.linspace(0, len(found.state) - 1, middle).astype(int)
            fits = _as_plan(machine, instrument, request, found, spread).minutes <= request.minutes
            low, high = (middle, high) if fits else (low, middle)
        number = low
    least = found.least * len(found.stations)
    if not least <= number <= len(found.state):
        each = f", {found.least} for each station" if len(found.stations) > 1 else ""
        raise UserError(
            f"{number} points: an optimised plan needs at least {least}{each}, and at most the {len(found.state)} that "
            f"the {instrument.kind()} observes"
        )
    return number


def _as_plan(
    machine: Machine,
    instrument: Instrument,
    request: Request,
    found: _Field,
    rows: np.ndarray,
    shuffled: np.random.Generator | None = None,
) -> Plan:
    return plan_of(
        machine, instrument, found.state.rows(rows), (found.stations, found.targets), request.choices.timing,
        request.change_min, shuffled=shuffled,
    )  # fmt: skip


def _refuse_hidden(found: _Field) -> None:
    """UserError for a required effect that all candidates together do not show."""
    if found.other_effects:
        spread = np.linalg.inv(found.prior + _information(found.rows))
        for name, k in found.other_effects.items():
            if spread[k, k] > VISIBLE**2:
                known = f"{np.sqrt(spread[k, k]):.0%} of its typical size"
                raise UserError(
                    f"{name} cannot be separated from the error motions and the instrument's position: measured at all "
                    f"of {len(found.rows)} positions it would be known to {known}"
                )


def _chosen(found: _Field, number: int, request: Request, progress: Progress) -> np.ndarray:
    """Numbers of the best candidates; the weight of required effects grows until the candidates show them."""
    weight, stations = WEIGHT, found.state.station
    assert stations is not None

    def done(chosen: int) -> None:
        progress("choosing positions", chosen / number)

    for _ in range(TIMES):
        selection = found.selection(weight if request.visible else 0.0)
        allowed = np.ones(len(found.state), bool)
        # the first points of a station tell nothing: choose as if some had been measured there
        first = replace(selection, prior=selection.prior + found.evenly(LEAST_POINTS_OF_STATION))
        for k, name in enumerate(found.stations, start=1):
            filled(first, k * found.least, np.equal(stations, name), done)
        filled(first, number, allowed, done)
        selection = replace(selection, chosen=first.chosen)
        progress("exchanging positions")
        exchanged(selection, allowed, EXCHANGES, stations, found.least)
        if all(selection.spread[k, k] <= VISIBLE**2 for k in found.other_effects.values()):
            break
        weight *= HEAVIER
    return np.flatnonzero(selection.chosen)


def _plan_and_visible(
    machine: Machine, instrument: Instrument, request: Request, found: _Field, chosen: np.ndarray
) -> tuple[Plan, dict[str, float]]:
    """The plan of these candidates in an order that shows the required effects; UserError when none does."""
    u: dict[str, float] = {}
    for shuffled in (None, np.random.default_rng(request.choices.seed)):
        plan = _as_plan(machine, instrument, request, found, chosen, shuffled)
        if not request.visible:
            return plan, {}
        columns = _columns(machine, instrument, request, plan)
        rows, prior, _, other_effects = equations_of(columns, len(plan))
        spread = np.linalg.inv(prior + _information(rows))
        u = {name: float(np.sqrt(spread[k, k])) for name, k in other_effects.items()}
        if max(u.values()) <= VISIBLE:
            return plan, u
    worst = max(u, key=lambda name: u[name])
    raise UserError(
        f"{len(chosen)} points from {'; '.join(f'{x:g},{y:g},{z:g}' for x, y, z in found.stations.values())} determine "
        f"{worst} to {u[worst]:.0%} of its typical size only, {VISIBLE:.0%} are required: take more points, more "
        "targets, or another instrument"
    )


def _information(rows: Array) -> Array:
    flat = rows.reshape(-1, rows.shape[2])
    return np.asarray(flat.T @ flat)
