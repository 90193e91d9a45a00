"""Virtual touch probe: the axis positions at which a machine with known errors finds the centres of spheres."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from calibration.instruments import TouchProbe
from calibration.instruments.touch_probe import TIP
from calibration.measurement.measurement import Distance, Measurement, with_moves
from calibration.measurement.plan import Plan
from calibration.registration.registration import SHIFTS, Registration
from kinematics.error_model.model import ErrorModel
from kinematics.forward import tool_point
from kinematics.inverse import linear_positions
from kinematics.machine import TRAVEL_ROUNDING, Machine, Vector
from kinematics.state import State
from kinematics.transforms import Array, Pose
from kinematics.user_error import UserError

PLACED_MM = 1.0
"""Half-width of the difference between a sphere's centre and its stated position, in each coordinate, mm."""
FOUND_MM = 1e-9
"""Distance of the tip from the centre, mm, at which the search for the axis positions ends."""
CONTACT_STEPS = 20
CONTACT_DECIMALS = 5
"""Decimals of the recorded positions, mm: 10 nm, far below the noise."""
TIME_OF_CENTRE_S = 15.0
"""Time for one centre, s, where the plan has no times."""


@dataclass(frozen=True)
class Spheres:
    """Spheres on the table."""

    centres: Mapping[str, Vector]
    """Stated centres by name, mm, in the workpiece frame at zero pose of the machine."""
    distances: Mapping[tuple[str, str], float]
    """Standard uncertainties, mm, of calibrated distances between two spheres."""


def probed(
    plan: Plan,
    model: ErrorModel,
    instrument: TouchProbe,
    spheres: Spheres,
    draws: tuple[np.random.Generator, np.random.Generator],
    noise_scale: float = 1.0,
) -> tuple[Measurement, tuple[str, ...]]:
    """The measurement of a plan, and notes on rows that are left out.

    A plan of spheres has the sphere of each row; of any other plan all spheres are measured at each rotary position.

    The positions of the linear axes follow from the spheres: they are those at which the actual tip is in the actual
    centre, with noise. draws: random numbers of the centres and of the noise. UserError for a plan with several targets
    or without a reachable sphere.
    """
    machine = plan.machine
    if len(plan.targets) > 1 or any(not target.known for target in plan.targets.values()):
        raise UserError("--target: a touch probe has one target, its tip from the spindle nose")
    (tip,) = plan.targets.values()
    nominal = _nominal(plan, tip.position, spheres)
    beyond = np.maximum(machine.travel[0] - nominal.positions, nominal.positions - machine.travel[1])
    reached = np.flatnonzero(beyond.max(axis=1) <= TRAVEL_ROUNDING)
    notes: tuple[str, ...] = ()
    if len(reached) < len(nominal):
        notes = (f"{len(nominal) - len(reached)} of {len(nominal)} centres are beyond the travel of an axis, left out",)
    if not len(reached):
        raise UserError("--sphere: no sphere is within the travel of the linear axes at the rotary positions")
    state = with_moves(nominal.rows(reached))
    run = np.repeat(plan.run, len(nominal) // len(plan))[reached]
    blank = Measurement(machine, instrument, state, np.zeros((len(state), 3)), {TIP: tip}, run=run)
    actual = {
        name: np.array(stated) + draws[0].uniform(-PLACED_MM, PLACED_MM, 3) for name, stated in spheres.centres.items()
    }
    noise = noise_scale * instrument.u_um * 1e-3 * draws[1].standard_normal((len(state), 3))
    distances = tuple(_distance(names, u, actual, draws[1], noise_scale) for names, u in spheres.distances.items())
    blank = replace(blank, spheres=dict(spheres.centres), distances=distances)
    return _found(machine, model, blank, actual, noise), notes


def into_positions(measurement: Measurement) -> Measurement:
    """The measurement with its observed vectors in the positions of the linear axes instead."""
    machine, state = measurement.machine, measurement.state
    tip = tool_point(machine, state.positions, measurement.tool) - measurement.observed
    moved = np.round(linear_positions(machine, state.positions, tip, measurement.tool), CONTACT_DECIMALS)
    off = np.linalg.norm(measurement.observed, axis=1) > 0.0
    positions = np.where(off[:, None] & ~machine.rotary, moved, state.positions)
    return replace(
        measurement,
        state=with_moves(replace(state, positions=positions), state.approach),
        observed=np.zeros_like(measurement.observed),
    )


def _nominal(plan: Plan, tip: Vector, spheres: Spheres) -> State:
    """The states of the nominal machine with its tip in each sphere's centre, all spheres at each rotary position."""
    n = len(plan)
    if plan.spheres:
        assert plan.state.station is not None
        rows, station = np.arange(n), plan.state.station
    else:
        rows, station = np.repeat(np.arange(n), len(spheres.centres)), np.tile(list(spheres.centres), n)
    state = plan.state.rows(rows)
    centres = np.array([spheres.centres[name] for name in station.tolist()])
    positions = linear_positions(plan.machine, state.positions, centres, tip)
    time = plan.state.time
    step = TIME_OF_CENTRE_S if time is None or n < 2 else float(time[-1] - time[0]) / (n - 1)
    return State(
        positions,
        velocity=np.zeros_like(positions),
        acceleration=np.zeros_like(positions),
        time=state.time if plan.spheres and time is not None else step * np.arange(len(rows), dtype=float),
        temperatures=state.temperatures,
        cycle=state.cycle,
        station=station,
        target=np.full(len(rows), TIP),
        observed=np.zeros((len(rows), 3)),
    )


def _found(
    machine: Machine, model: ErrorModel, blank: Measurement, centres: Mapping[str, Array], noise: Array
) -> Measurement:
    """The measurement with the positions of the linear axes at which the tip is in the centre, but for the noise."""
    poses = {name: Pose(np.eye(3)[None], -centre[None]) for name, centre in centres.items()}
    registration = Registration(poses, dict.fromkeys(poses, np.zeros(3)), SHIFTS)
    state, instrument = blank.state, blank.instrument
    for step in range(CONTACT_STEPS):
        here = replace(blank, state=state)
        off = instrument.expected(here, registration, model.observation(machine, state)) + noise
        if np.abs(off).max() < FOUND_MM:
            break
        tip = tool_point(machine, state.positions, blank.tool) - off
        moved = replace(state, positions=linear_positions(machine, state.positions, tip, blank.tool))
        # a move of um from row to row may change its sign with each step
        state = with_moves(moved, state.approach if step else None)
    positions = np.where(machine.rotary, state.positions, np.round(state.positions, CONTACT_DECIMALS))
    return replace(blank, state=with_moves(replace(state, positions=positions), state.approach))


def _distance(
    names: tuple[str, str], u: float, actual: Mapping[str, Array], rng: np.random.Generator, noise_scale: float
) -> Distance:
    """The calibrated distance of two spheres, with an error of its uncertainty u, mm."""
    for name in names:
        if name not in actual:
            raise UserError(f"--distance: there is no sphere {name!r}; known are {', '.join(actual)}")
    one, other = names
    length = float(np.linalg.norm(actual[one] - actual[other])) + noise_scale * u * float(rng.standard_normal())
    return Distance(one, other, round(length, CONTACT_DECIMALS), u)
