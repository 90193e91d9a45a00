"""Virtual measurements: the observations by an instrument of a machine with known errors.

The motion of the machine comes from the exact matrix product alone; the linear equations of fits are not used. Noise is
drawn from the full covariance of the instrument. The same generator gives the same measurement.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calibration.measurement.instruments import Instrument, Interferometer, LaserTracker, TouchProbe
from calibration.measurement.measurement import SPINDLE_NOSE, Measurement, Target, with_moves
from calibration.measurement.observed_points import target_points
from calibration.measurement.registration import PLANAR, RIGID, Registration
from calibration.observation.equations import covariance, expected
from kinematics.effects.base import UM, URAD
from kinematics.error_model.model import ErrorModel, Observation
from kinematics.machine import Machine, Vector
from kinematics.state import State
from kinematics.transforms import Array, Pose, rotation_vector_matrix, turn
from kinematics.user_error import UserError

AT_A_TIME = 32_768
"""Number of rows evaluated together, which limits the memory."""
ALIGNMENT_MM, ALIGNMENT_RAD = 0.1, 5e-4
"""Half-widths of the shift and the rotation of a part against its nominal frame on the measuring machine."""


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
    registration = _registration(blank, poses, rng)
    if not isinstance(instrument, Interferometer):
        # instrument effects use the beam to the nominal point: the influence of machine errors on it is negligible
        points = [registration.apply(part, target_points(part, None, part.tool)) for part in _parts(blank, AT_A_TIME)]
        blank = replace(blank, state=replace(blank.state, observed=np.concatenate(points)))
    together = len(blank) if any(effect.HAS_MEMORY for effect in model.effects) else AT_A_TIME
    exact = np.empty((len(blank), instrument.components))
    done = 0
    for part in _parts(blank, together):
        effects = model.observation(machine, part.state)
        for rows in _slices(len(part), AT_A_TIME):
            count = len(part.state.positions[rows])
            errors = Observation(effects.errors[rows], effects.shift[rows])
            exact[done : done + count] = expected(part.rows(rows), registration, errors)
            done += count
            progress(count)
    if isinstance(instrument, Interferometer):
        _, first, which = np.unique(blank.groups, return_index=True, return_inverse=True)
        exact -= exact[first[which]]
    observed = exact + noise_scale * _noise(replace(blank, observed=exact), rng)
    return replace(blank, observed=observed)


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


def with_temperatures(state: State, courses: Mapping[str, tuple[float, float]]) -> State:
    """The state with temperatures, K from 20 degC, linear from start to end over time (without time, over the rows)."""
    n = len(state)
    share = np.linspace(0.0, 1.0, n) if state.time is None else state.time / max(state.time.max(), 1e-9)
    columns = {name: np.round(start + share * (end - start), 3) for name, (start, end) in courses.items()}
    return replace(state, temperatures=columns)


def read_out(measurement: Measurement) -> Measurement:
    """The measurement rounded to the digits of an instrument, far below its noise: 10 nm; interferometers nm, nrad."""
    if not isinstance(measurement.instrument, Interferometer):
        return replace(measurement, observed=np.round(measurement.observed, 5))
    size = np.where(measurement.angular, URAD, UM)[:, None]
    return replace(measurement, observed=np.round(measurement.observed / size, 3) * size)


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
    if isinstance(instrument, Interferometer) and (axis is None or run is None):
        raise UserError("an interferometer measures one axis at a time, in runs: it needs strategy axes")
    if state.last_move is None:
        state = with_moves(state, state.approach)
    if state.target is None:
        state = replace(state, target=np.full(n, next(iter(targets))))
    if state.station is None and isinstance(instrument, LaserTracker):
        state = replace(state, station=np.full(n, next(iter(poses)) if poses else "1"))
    at_rest = np.broadcast_to(0.0, state.positions.shape)
    state = replace(
        state,
        velocity=at_rest if state.velocity is None else state.velocity,
        acceleration=at_rest if state.acceleration is None else state.acceleration,
    )
    nothing = np.zeros((n, instrument.components))
    return Measurement(machine, instrument, state, nothing, targets, stands_on, axis, run)


def _registration(blank: Measurement, poses: Mapping[str, Pose] | None, rng: np.random.Generator) -> Registration:
    """Registration of the instrument; UserError if a pose is missing."""
    groups = np.unique(blank.groups).tolist()
    if isinstance(blank.instrument, Interferometer):
        across = np.unique(blank.groups[blank.straightness]).tolist()
        slopes = dict(zip(across, rng.uniform(-ALIGNMENT_RAD, ALIGNMENT_RAD, len(across)).tolist(), strict=True))
        return Registration(zeros=dict.fromkeys(groups, 0.0), slopes=slopes)
    if poses is None:
        if isinstance(blank.instrument, TouchProbe):
            raise UserError("the spheres of the touch probe are missing: state --sphere NAME=x,y,z")
        if isinstance(blank.instrument, LaserTracker):
            raise UserError("the position of the laser tracker is missing: state --tracker x,y,z")
        poses = {group: _alignment(blank.instrument.components == 2, rng) for group in groups}
    missing = [group for group in groups if group not in poses]
    if missing:
        raise UserError(f"no pose of the instrument for {', '.join(missing)}")
    return Registration(poses, moves=PLANAR if blank.instrument.components == 2 else RIGID)


def _alignment(planar: bool, rng: np.random.Generator) -> Pose:
    """Random pose of a part on a measuring machine, near the nominal one."""
    free = np.array([1.0, 1.0, 0.0] if planar else [1.0, 1.0, 1.0])
    turns = rng.uniform(-ALIGNMENT_RAD, ALIGNMENT_RAD, 3) * (free if not planar else [0.0, 0.0, 1.0])
    return Pose(rotation_vector_matrix(turns), (rng.uniform(-ALIGNMENT_MM, ALIGNMENT_MM, 3) * free)[None])


def _noise(measurement: Measurement, rng: np.random.Generator) -> Array:
    """Noise `(n, components)`, mm and rad, with the covariance of the instrument for these observations."""
    normal = rng.standard_normal(measurement.observed.shape)
    # the uncertainty of an interferometer grows from the first position of its run, so its rows stay together
    together = len(measurement) if isinstance(measurement.instrument, Interferometer) else AT_A_TIME
    parts = zip(_parts(measurement, together), _slices(len(measurement), together), strict=True)
    return np.concatenate([np.einsum("nij,nj->ni", _root(covariance(part)), normal[rows]) for part, rows in parts])


def _root(matrices: Array) -> Array:
    """Symmetric square roots `(n, d, d)`, also of singular matrices: an instrument may have no noise in a direction."""
    values, vectors = np.linalg.eigh(matrices)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]) @ np.swapaxes(vectors, 1, 2))


def _parts(measurement: Measurement, size: int) -> Iterator[Measurement]:
    return (measurement.rows(rows) for rows in _slices(len(measurement), size))


def _slices(n: int, size: int) -> Iterator[slice]:
    return (slice(start, start + size) for start in range(0, n, size))
