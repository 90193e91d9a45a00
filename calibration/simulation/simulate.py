"""Virtual measurements: the observations by an instrument of a machine with known errors.

The motion of the machine comes from the exact matrix product alone; the linear equations of fits are not used. Noise is
drawn from the full covariance of the instrument. The same generator gives the same measurement.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calibration.instruments import Instrument
from calibration.measurement.measurement import SPINDLE_NOSE, Measurement, Target, with_moves
from calibration.measurement.plan import Plan
from calibration.registration.registration import Registration
from kinematics.error_model.model import ErrorModel, Observation
from kinematics.machine import Machine, Vector
from kinematics.state import State
from kinematics.transforms import Array, Pose, rotation_vector_matrix, turn
from kinematics.user_error import UserError

ROWS_AT_A_TIME = 32_768
"""Number of rows evaluated together, which limits the memory."""


@dataclass(frozen=True)
class Faults:
    """Faults of a measurement, as shares of the observations."""

    outliers: float = 0.0
    outlier_mm: tuple[float, float] = (0.05, 0.5)
    """Smallest and largest outlier, mm; log-uniform between them."""
    duplicates: float = 0.0
    missing: float = 0.0


def observe(
    machine: Machine,
    model: ErrorModel,
    state: State,
    instrument: Instrument,
    rng: np.random.Generator,
    poses: Mapping[str, Pose] | None = None,
    targets: Mapping[str, Target] | None = None,
    *,
    stands_on: Literal["workpiece", "bed"] = "workpiece",
    axis: np.ndarray | None = None,
    run: np.ndarray | None = None,
    component: np.ndarray | None = None,
    noise_scale: float = 1.0,
    progress: Callable[[int], None] = lambda _: None,
) -> Measurement:
    """The observations by the instrument of a machine with the errors of `model`, in the given states, with noise.

    `poses`: for a tracker, by station, from the frame to which it is fixed to its own (see `tracker_pose`); for a part,
    its alignment, which is random without `poses`. `axis`, `run` and `component` `(n,)`: for an interferometer. Each
    run reads zero at its start, and a run of a straightness also has a slope. For missing entries of the state,
    approach and last moves follow from the order of its rows; target and station are the first ones, and velocity and
    acceleration are zero. `noise_scale`: the instrument's noise as a multiple of its specification; 0 for none.
    `progress` is called with the numbers of rows done.
    """
    blank = replace(_blank(machine, instrument, state, poses, targets, stands_on, axis, run), component=component)
    registration = instrument.drawn_registration(blank, poses, rng)
    aimed = [instrument.aimed_at(part, registration) for part in _parts(blank, ROWS_AT_A_TIME)]
    points = [part for part in aimed if part is not None]
    if points:
        blank = replace(blank, state=replace(blank.state, observed=np.concatenate(points)))
    exact = instrument.zeroed(blank, _without_noise(blank, model, registration, progress))
    observed = exact + noise_scale * _noise(replace(blank, observed=exact), rng)
    return replace(blank, observed=observed)


def _without_noise(
    blank: Measurement, model: ErrorModel, registration: Registration, progress: Callable[[int], None]
) -> Array:
    """Exact observations `(n, components)`; some rows at a time, where the errors do not depend on earlier ones."""
    together = len(blank) if any(effect.HAS_MEMORY for effect in model.effects) else ROWS_AT_A_TIME
    parts = [np.empty((0, blank.instrument.components))]
    for part in _parts(blank, together):
        effects = model.observation(blank.machine, part.state)
        for rows in _slices(len(part), ROWS_AT_A_TIME):
            errors = Observation(effects.errors[rows], effects.shift[rows])
            parts.append(blank.instrument.expected(part.rows(rows), registration, errors))
            progress(len(parts[-1]))
    return np.concatenate(parts)


def tracker_pose(position: Vector | Array, rng: np.random.Generator) -> Pose:
    """Pose of a levelled tracker at a position, mm, with a random angle about z: from its base frame to its own."""
    rotation = rotation_vector_matrix([[0.0, 0.0, rng.uniform(-np.pi, np.pi)]])
    return Pose(rotation, -turn(rotation, position))


def at_stations(state: State, stations: Sequence[str], pause_s: float = 0.0) -> State:
    """The states repeated for each station of the instrument in turn, with a pause, s, to move it."""
    if state.last_move is None:
        state = with_moves(state, state.approach)
    n = len(state)
    every = state.rows(np.tile(np.arange(n), len(stations)))
    time = state.time
    if time is not None:
        later = np.arange(len(stations)) * (time[-1] + pause_s)
        time = np.tile(time, len(stations)) + np.repeat(later, n)
    return replace(every, station=np.repeat(list(stations), n), time=time)


def stationed(plan: Plan, places: Sequence[Vector]) -> tuple[State, dict[str, Vector]]:
    """The states of a plan at its stations, and the positions of these by name, mm.

    A plan without stations is repeated at each of the places; for a plan with stations they are the positions of these,
    in their order. UserError for another number of them.
    """
    if not plan.stations:
        named = {f"s{k}": place for k, place in enumerate(places, start=1)}
        return (at_stations(plan.state, list(named)) if named else plan.state), named
    if places and len(places) != len(plan.stations):
        raise UserError(
            f"the plan has the stations {', '.join(plan.stations)}, but {len(places)} positions of the instrument "
            "(tracker) are given: give one for each of them, in this order, or none"
        )
    return plan.state, dict(zip(plan.stations, places or plan.stations.values(), strict=True))


def with_temperatures(state: State, courses: Mapping[str, tuple[float, float]]) -> State:
    """The state with temperatures, K from 20 degC, linear from start to end over time (without time, over the rows)."""
    n = len(state)
    share = np.linspace(0.0, 1.0, n) if state.time is None else state.time / max(state.time.max(), 1e-9)
    columns = {name: np.round(start + share * (end - start), 3) for name, (start, end) in courses.items()}
    return replace(state, temperatures=columns)


def read_out(measurement: Measurement) -> Measurement:
    """The measurement rounded to the digits of its instrument, far below its noise."""
    return replace(measurement, observed=measurement.instrument.read_out(measurement))


def spoil(measurement: Measurement, faults: Faults, rng: np.random.Generator) -> tuple[Measurement, tuple[str, ...]]:
    """The measurement with outliers, doubled and missing rows, and notes on these; last moves do not change."""
    if faults == Faults():
        return measurement, ()
    n, components = measurement.observed.shape
    bad = rng.permutation(n)[: round(faults.outliers * n)]
    direction = rng.standard_normal((len(bad), components))
    smallest, largest = np.log(faults.outlier_mm).tolist()
    size = np.exp(rng.uniform(smallest, largest, len(bad)))
    observed = measurement.observed.copy()
    observed[bad] += direction / np.linalg.norm(direction, axis=1, keepdims=True) * size[:, None]
    doubled = rng.permutation(n)[: round(faults.duplicates * n)]
    lost = rng.permutation(n)[: round(faults.missing * n)]
    kept = np.setdiff1d(np.arange(n), lost)
    rows = np.sort(np.concatenate([kept, np.intersect1d(doubled, kept)]))
    notes = []
    for kind, index in (("outliers", bad), ("doubled rows", doubled), ("missing rows", lost)):
        if len(index):
            notes.append(f"{len(index)} {kind}")
    return replace(measurement, observed=observed).rows(rows), tuple(notes)


def _blank(
    machine: Machine,
    instrument: Instrument,
    state: State,
    poses: Mapping[str, Pose] | None,
    targets: Mapping[str, Target] | None,
    stands_on: Literal["workpiece", "bed"],
    axis: np.ndarray | None,
    run: np.ndarray | None,
) -> Measurement:
    """The measurement without observations."""
    targets, n = targets or {"1": SPINDLE_NOSE}, len(state)
    instrument.check_plan(axis, run)
    if state.last_move is None:
        state = with_moves(state, state.approach)
    if state.target is None:
        state = replace(state, target=np.full(n, next(iter(targets))))
    if state.station is None and instrument.STATIONED:
        state = replace(state, station=np.full(n, next(iter(poses)) if poses else "1"))
    at_rest = np.broadcast_to(0.0, state.positions.shape)
    state = replace(
        state,
        velocity=at_rest if state.velocity is None else state.velocity,
        acceleration=at_rest if state.acceleration is None else state.acceleration,
    )
    nothing = np.zeros((n, instrument.components))
    return Measurement(machine, instrument, state, nothing, targets, stands_on, axis, run)


def _noise(measurement: Measurement, rng: np.random.Generator) -> Array:
    """Noise `(n, components)`, mm and rad, with the covariance of the instrument for these observations."""
    normal = rng.standard_normal(measurement.observed.shape)
    together = len(measurement) if measurement.instrument.GROWS_ALONG_RUN else ROWS_AT_A_TIME
    parts = zip(_parts(measurement, together), _slices(len(measurement), together), strict=True)
    return np.concatenate([np.einsum("nij,nj->ni", _root(part.covariances), normal[rows]) for part, rows in parts])


def _root(matrices: Array) -> Array:
    """Symmetric square roots `(n, d, d)`, also of singular matrices: an instrument may have no noise in a direction."""
    values, vectors = np.linalg.eigh(matrices)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]) @ np.swapaxes(vectors, 1, 2))


def _parts(measurement: Measurement, size: int) -> Iterator[Measurement]:
    return (measurement.rows(rows) for rows in _slices(len(measurement), size))


def _slices(n: int, size: int) -> Iterator[slice]:
    return (slice(start, start + size) for start in range(0, n, size))
