"""A bench of three linear axes that a tracker sees, and a measurement that follows another one on it."""

from dataclasses import fields, replace

import msgspec
import numpy as np

import machines
from calibration.follow_up.design import FollowUpDesign
from calibration.follow_up.designs import follow_up_designs
from calibration.instruments import Interferometer
from calibration.measurement.measurement import Measurement, Target
from calibration.simulation.simulate import observe, tracker_pose
from kinematics.effects import Effect
from kinematics.error_model.model import no_errors
from kinematics.state import State
from kinematics.transforms import Array
from support.virtual_measurements import THREE, TRACKER, measured, positions

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


def five_axes() -> Measurement:
    """Five axes without errors, from two stations, with a target on the table."""
    machine, rng = machines.load("dmu50"), np.random.default_rng(4)
    targets = THREE | {"nest": Target((100.0, 50.0, -20.0), "table")}
    q = positions(machine, 160, rng)
    return measured(machine, q, targets, no_errors(machine), rng, stations=2, stands_on="bed")


def in_motion() -> Measurement:
    """The bench without errors, recorded in motion, with the temperature of its spindle."""
    q, rng = shuffled(), np.random.default_rng(6)
    velocity = np.diff(q, axis=0, prepend=q[:1]) + 1.0
    state = State(
        q,
        time=0.1 * np.arange(len(q)),
        velocity=velocity,
        acceleration=0.0 * q,
        temperatures={"spindle": np.linspace(0.0, 3.0, len(q))},
    )
    return observe(BENCH, no_errors(BENCH), state, TRACKER, rng, {"1": POSE})


def by_interferometer() -> Measurement:
    """X of the bench without errors, to and fro in three runs."""
    x = np.tile(np.append(np.linspace(0, 600, 13), np.linspace(600, 0, 13)), 3)
    state = State(np.stack([0 * x + 300, x, 0 * x + 200], axis=1), time=10.0 * np.arange(len(x)))
    run, rng = np.repeat(["1", "2", "3"], 26), np.random.default_rng(8)
    instrument = Interferometer(u_um=0.5)
    return observe(BENCH, no_errors(BENCH), state, instrument, rng, axis=np.full(len(x), "X"), run=run)


def planned(data: Measurement, name: str) -> FollowUpDesign:
    """The design of a name that may follow a measurement."""
    registration, _ = data.first_registration
    return next(design for design in follow_up_designs(data, registration) if design.name == name)
