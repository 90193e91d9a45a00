"""A virtual DMU 50 with three targets on the spindle and three on the table, measured axis by axis."""

from __future__ import annotations

import datetime
from collections.abc import Mapping, Sequence

import numpy as np

from calibration.instruments import LaserTracker
from calibration.measurement.measurement import Measurement, Target
from calibration.registration.registration import Registration
from kinematics.basis import Harmonics, Legendre
from kinematics.effects import Effect, ErrorMotion, LocationError
from kinematics.error_model.model import ErrorModel, Observation
from kinematics.error_model.provenance import Provenance, reference
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array, Pose, rotation_vector_matrix

SERIES = {
    "X": np.linspace(-250, 250, 11),
    "Y": np.linspace(-225, 225, 11),
    "Z": np.linspace(0, 400, 11),
    "C": np.arange(0.0, 360.0, 20.0),
    "B": np.arange(0.0, 181.0, 10.0),
}
STANDING = {"X": 10.0, "Y": -20.0, "Z": 100.0, "B": 30.0, "C": 0.0}
TARGETS = {
    "P": Target((80.0, 10.0, -50.0)),
    "Q": Target((-60.0, 60.0, -20.0)),
    "K": Target((-30.0, -75.0, -80.0)),
    "TP": Target((150.0, 20.0, 20.0), "table"),
    "TQ": Target((-80.0, 120.0, 60.0), "table"),
    "TK": Target((-60.0, -110.0, 110.0), "table"),
}
QUIET = LaserTracker(u_range_um=0.2, u_range_um_per_m=0.15, u_angle_um=7.5, u_angle_um_per_m=3.0)


def station(eye: Sequence[float], turn: float) -> Pose:
    """A tracker at `eye`, mm, in the machine's frame, turned about a slanting axis."""
    rotation = rotation_vector_matrix([[0.1 * turn, -0.2 * turn, turn]])
    return Pose(rotation, -(rotation @ np.array(eye))[..., :])


def model(machine: Machine, effects: Sequence[Effect]) -> ErrorModel:
    made = Provenance("tests", datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC))
    return ErrorModel(machine=reference(machine), provenance=made, effects=tuple(effects))


def random_effects(seed: int, degree: int = 3, axes: Sequence[str] = "XYZBC", size: float = 15.0) -> list[Effect]:
    """Error motions of all axes, polynomials, of C harmonics of the turn, um and urad."""
    rng = np.random.default_rng(seed)
    effects: list[Effect] = []
    for axis in axes:
        interval = (float(SERIES[axis].min()), float(SERIES[axis].max()))
        for component in ("X", "Y", "Z", "A", "B", "C"):
            basis = Harmonics((0.0, 360.0), degree) if axis == "C" else Legendre(interval, degree)
            values = rng.uniform(-size, size, basis.size)
            effects.append(ErrorMotion(component, axis, basis, tuple(values.tolist())))
    return effects


def locations(values: Mapping[str, float]) -> list[Effect]:
    """Location errors by name: {"C0Y": 12.0}."""
    return [LocationError(name[0], name[2:], value) for name, value in values.items()]  # type: ignore[arg-type]


def rows(
    machine: Machine, axes: Sequence[str], rounds: Sequence[str], fixed: Mapping[str, Target]
) -> tuple[Array, np.ndarray, np.ndarray]:
    """Positions `(n, axes)`, file units, targets and runs: one axis, round and target after the other."""
    positions, targets, runs = [], [], []
    for run in rounds:
        for name in [n for n, target in fixed.items() if target.carrier == "bed"]:
            positions.append([STANDING[each] for each in machine.names])
            targets.append(name)
            runs.append(run)
    for axis in axes:
        on_tool = machine.axes[machine.index(axis)].side == "tool"
        for run in rounds:
            for name in [n for n, t in fixed.items() if t.carrier == ("tool" if on_tool else "table")]:
                for value in SERIES[axis]:
                    positions.append([value if each == axis else STANDING[each] for each in machine.names])
                    targets.append(name)
                    runs.append(run)
    return np.array(positions, float), np.array(targets), np.array(runs)


def measured(
    machine: Machine,
    truth: ErrorModel,
    stations: Mapping[str, Pose],
    *,
    axes: Sequence[str] = "XYZBC",
    instrument: LaserTracker = QUIET,
    rng: np.random.Generator | None = None,
    stray: float = 0.0,
    targets: Mapping[str, Target] = TARGETS,
) -> Measurement:
    """One round from each station; `rng` adds the instrument's noise and positions that stray by `stray` mm."""
    positions, names, runs = rows(machine, axes, list(stations), targets)
    # stations at one place are one
    same = {name: next(k for k, pose in stations.items() if pose is own) for name, own in stations.items()}
    state = State(positions * machine.scale, station=np.array([same[run] for run in runs]), target=names)
    empty = np.zeros((len(runs), 3))
    blank = Measurement(machine, instrument, state, empty, targets, "bed", run=runs, source="virtual.csv")
    registration = Registration(dict(stations), {name: np.zeros(3) for name in stations})
    shift = np.zeros((len(runs), 3))
    seen = blank.instrument.expected(blank, registration, Observation(truth.errors(machine, state), shift))
    if rng is not None:
        root = np.linalg.cholesky(instrument.covariance(seen))
        seen = seen + (root @ rng.standard_normal((len(runs), 3, 1)))[:, :, 0]
        seen = seen + stray * rng.standard_normal((len(runs), 3))
    return Measurement(machine, instrument, state, seen, targets, "bed", run=runs, source="virtual.csv")
