"""Virtual measurements for tests: exact kinematics, noise by the instrument specification, seeds fixed."""

import io
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np

import machines
from calibration.instruments import LaserTracker
from calibration.measurement.measurement import Measurement, Target, with_moves
from calibration.measurement.written_file import write_measurement
from calibration.registration.registration import Registration
from kinematics.basis import Fourier
from kinematics.effects import COMPONENTS, ErrorMotion
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Pose, rotation_vector_matrix

ONE = {"1": Target((0.0, 0.0, -120.0))}
COLLINEAR = {"1": Target((0.0, 0.0, -120.0)), "2": Target((0.0, 0.0, -180.0))}
THREE = {"1": Target((0.0, 0.0, -120.0)), "2": Target((90.0, 40.0, -180.0)), "3": Target((-60.0, 80.0, -100.0))}
TRACKER = LaserTracker(u_range_um_per_m=0.5, u_angle_um=3.0, u_angle_um_per_m=3.0)
EXACT = LaserTracker(u_range_um=0.01, u_angle_um=0.01)

MONTAVON = machines.parse(
    """
name = "montavon"
chain = "w b Y X Z t"
axes.X = { travel = [0, 2000] }
axes.Y = { travel = [0, 1500] }
axes.Z = { travel = [0, 400] }
""",
    "montavon",
)
"""Chain and volume of Montavon et al."""


def truth(machine: Machine, rng: np.random.Generator, size: float = 20.0) -> ErrorModel:
    """Random smooth error motions of all axes, um and urad."""
    effects = []
    for axis in machine.axes:
        travel = tuple(np.clip(axis.travel, -180, 180).tolist()) if axis.rotary else axis.travel
        for component in COMPONENTS:
            values = rng.uniform(-size, size, 6) * [0.5, 1, 1, 1, 0.3, 0.3]
            effects.append(
                ErrorMotion(component, axis.name, Fourier(travel, (0.5, 2.0)), tuple(values.tolist()), u=(0.0,) * 6)
            )
    return msgspec.structs.replace(no_errors(machine), effects=tuple(effects))


def positions(machine: Machine, n: int, rng: np.random.Generator, edges: int = 0) -> np.ndarray:
    """Random positions `(n, axes)`, mm and rad, the first of them on edges of the volume."""
    travel = np.where(machine.rotary, np.clip(machine.travel, -np.pi, np.pi), machine.travel)
    q = rng.uniform(*travel, (n, len(machine.axes)))
    corner = np.where(rng.integers(0, 2, (edges, q.shape[1])) == 1, travel[1], travel[0])
    free = rng.integers(0, q.shape[1], edges)
    corner[np.arange(edges), free] = q[np.arange(edges), free]
    q[:edges] = corner
    return q


def measured(
    machine, q, targets, model, rng, *, tracker=TRACKER, stations=1, noise=True, stands_on="workpiece", start_s=0.0,
    **columns,
):  # fmt: skip
    """What a tracker sees of the machine at `q` `(n, axes)`, targets and stations in random turn, every 15 s.

    columns: further columns of the state.
    """
    n = len(q)
    names = [f"s{i + 1}" for i in range(stations)]
    state = with_moves(
        State(
            q,
            target=rng.choice(list(targets), n),
            station=np.array(names)[np.arange(n) * stations // n],
            time=start_s + 15.0 * np.arange(n),
            **columns,
        )
    )
    empty = Measurement(machine, tracker, state, np.ones((n, 3)), targets, stands_on, source="virtual")
    registration = pose_of(names, {k: np.array(t.position) for k, t in targets.items() if not t.known})
    # instrument effects use the beam to the nominal point
    state = replace(
        state, observed=empty.instrument.expected(empty, registration, no_errors(machine).observation(machine, state))
    )
    observed = empty.instrument.expected(empty, registration, model.observation(machine, state))
    if noise:
        root = np.linalg.cholesky(tracker.covariance(observed))
        observed = observed + (root @ rng.normal(size=(n, 3, 1)))[:, :, 0]
    return replace(empty, observed=observed, state=replace(state, observed=observed))


def pose_of(stations, targets=None) -> Registration:
    """Poses of trackers about the machine."""
    poses, centres = {}, {}
    for i, name in enumerate(stations):
        turned = rotation_vector_matrix([[0.02, -0.03, 2.0 - i]])
        poses[name] = Pose(turned, np.array([[2500.0 - 900 * i, 800.0 + 300 * i, -300.0]]))
        centres[name] = np.zeros(3)
    return Registration(poses, centres, targets=targets or {})


def written(measurement: Measurement, path: Path) -> Path:
    """The file of a measurement."""
    file = io.BytesIO()
    write_measurement(measurement, file)
    path.write_bytes(file.getvalue())
    return path
