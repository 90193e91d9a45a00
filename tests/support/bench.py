"""A bench of three linear axes that a tracker sees, and a measurement that follows another one on it."""

from dataclasses import fields, replace

import msgspec
import numpy as np

import machines
from calibration.follow_up.design import FollowUpDesign
from calibration.measurement.measurement import Measurement
from calibration.simulation.simulate import observe, tracker_pose
from kinematics.effects import Effect
from kinematics.error_model.model import no_errors
from kinematics.state import State
from kinematics.transforms import Array
from support.virtual_measurements import THREE, TRACKER

BENCH_TOML = """
name = "bench"
chain = "w b Y X Z t"
axes.X = { travel = [0, 600] }
axes.Y = { travel = [0, 600] }
axes.Z = { travel = [0, 450] }
"""
BENCH = machines.parse(BENCH_TOML, "bench")
"""The volume of "Visibility under a tracker design"; the tracker stands 1.5 m from its middle."""
POSE = tracker_pose((-1200.0, 300.0, 300.0), np.random.default_rng(0))
GRID = [(0.0, 120.0, 240.0, 360.0, 480.0, 600.0)] * 2 + [(0.0, 112.5, 225.0, 337.5, 450.0)]


def swept() -> Array:
    """A grid, row by row."""
    return np.stack(np.meshgrid(*GRID, indexing="ij"), axis=-1).reshape(-1, 3)


def shuffled() -> Array:
    """The grid in shuffled order."""
    return np.random.default_rng(5).permutation(swept())


def to_and_fro() -> Array:
    """The grid line by line, every move along X and Z of the same length."""
    path = [[]]
    for ladder in (GRID[1], GRID[0], GRID[2]):
        path = [[*head, at] for i, head in enumerate(path) for at in (ladder if i % 2 == 0 else ladder[::-1])]
    return np.array(path)


def seen(q: Array, *effects: Effect, seed: int = 2, targets=THREE) -> Measurement:
    """The bench as a tracker sees it, a row every 15 s."""
    rng = np.random.default_rng(seed)
    state = State(q, time=15.0 * np.arange(len(q)), target=rng.choice(list(targets), len(q)))
    model = msgspec.structs.replace(no_errors(BENCH), effects=effects)
    return observe(BENCH, model, state, TRACKER, rng, {"1": POSE}, targets)


def together(measurement: Measurement, plan: FollowUpDesign, *effects: Effect, seed: int = 3) -> Measurement:
    """The data, and what the planned measurement shows of the bench with these effects."""
    more = plan.measurement
    rng = np.random.default_rng(seed)
    known = {name: replace(target, carrier=target.carrier) for name, target in more.targets.items()}
    model = msgspec.structs.replace(no_errors(BENCH), effects=effects)
    done = observe(BENCH, model, replace(more.state, past=None), TRACKER, rng, plan.registration.poses, known)
    columns = {}
    before = replace(measurement.state, station=measurement.groups)
    for field in fields(State):
        one, other = getattr(before, field.name, None), getattr(done.state, field.name, None)
        if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
            columns[field.name] = np.concatenate([one, other])
    observed = np.concatenate([measurement.observed, done.observed])
    return replace(measurement, state=State(**columns), observed=observed, targets=known)
