"""Virtual ballbar: circles of a machine with known errors about a table ball, read by a bar."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from calibration.instruments import Ballbar
from calibration.instruments.ballbar import LENGTH_ERROR, ONE_SET_UP, in_runs, run_starts, velocities_on_circles
from calibration.measurement.measurement import Measurement, Target
from calibration.registration.registration import SHIFTS, Registration
from kinematics.error_model.model import ErrorModel
from kinematics.inverse import linear_positions
from kinematics.machine import Machine, Vector
from kinematics.state import State
from kinematics.transforms import Array, Pose
from kinematics.user_error import UserError

OFF_CENTRE_MM = 0.03
"""Half-width of the difference between the table ball and the centre of the circles, in each coordinate, mm."""
UNCALIBRATED_LENGTH_MM = 0.02
"""Standard deviation of the length of a bar that is not calibrated, mm."""
OVERSHOOT_S = 20.0
"""Time between two circles, s."""
READING_DECIMALS = 5
"""Decimals of recorded positions and readings, mm: 10 nm."""
PLANES = {"XY": (0, 1), "YZ": (1, 2), "ZX": (2, 0)}
"""Coordinates of the workpiece frame of each plane; the angle counts from the first to the second."""


@dataclass(frozen=True)
class Circles:
    """Circles about a table ball: in each plane at each feed, counter-clockwise, then clockwise."""

    centre: Vector
    """Centre of the circles, workpiece frame, mm: where the table ball is, but for the set-up."""
    planes: Sequence[str] = ("XY",)
    feeds: Sequence[float] = (1000.0,)
    """Feeds, mm/min."""
    step_deg: float = 1.0
    arc_deg: tuple[float, float] = (0.0, 360.0)
    """First and last angle of each circle, from the first axis of its plane to the second."""


def swept(
    machine: Machine,
    model: ErrorModel,
    bar: Ballbar,
    circles: Circles,
    target: tuple[str, Target],
    draws: tuple[np.random.Generator, np.random.Generator],
    noise_scale: float = 1.0,
) -> Measurement:
    """The circles as the bar reads them; draws: random numbers of the set-up and of the noise.

    UserError for an unknown plane and for circles beyond the travel.
    """
    blank = _nominal(machine, bar, circles, target)
    centre = np.add(circles.centre, draws[0].uniform(-OFF_CENTRE_MM, OFF_CENTRE_MM, 3))
    longer = draws[0].standard_normal() * (
        UNCALIBRATED_LENGTH_MM if bar.length_u_um is None else bar.length_u_um * 1e-3
    )
    poses = {ONE_SET_UP: Pose(np.eye(3)[None], -centre[None])}
    registration = Registration(poses, {ONE_SET_UP: np.zeros(3)}, SHIFTS, {LENGTH_ERROR: float(longer)})
    exact = bar.expected(blank, registration, model.observation(machine, blank.state))
    noise = noise_scale * bar.u_um * 1e-3 * draws[1].standard_normal(exact.shape)
    return replace(blank, observed=np.round(exact + noise, READING_DECIMALS))


def _nominal(machine: Machine, bar: Ballbar, circles: Circles, target: tuple[str, Target]) -> Measurement:
    """The circles without readings."""
    name, tool = target
    low, high = circles.arc_deg
    angles = np.radians(np.linspace(low, high, round(abs(high - low) / circles.step_deg) + 1))
    points, runs, feeds = [], [], []
    for plane, each, direction in product(circles.planes, circles.feeds, ("ccw", "cw")):
        if plane not in PLANES:
            raise UserError(f"--plane {plane}: expected one of {', '.join(PLANES)}")
        on_circle = np.tile(np.array(circles.centre), (len(angles), 1))
        turned = angles if direction == "ccw" else angles[::-1]
        for k, part in zip(PLANES[plane], (np.cos(turned), np.sin(turned)), strict=True):
            on_circle[:, k] += bar.length_mm * part
        points.append(on_circle)
        runs += [f"{plane} F{each:g} {direction}"] * len(angles)
        feeds += [each] * len(angles)
    home = np.tile([axis.home for axis in machine.axes], (len(runs), 1)) * machine.scale
    positions = np.round(linear_positions(machine, home, np.concatenate(points), tool.position), READING_DECIMALS)
    _refuse_beyond(machine, positions)
    feed = np.array(feeds)
    cycle = np.repeat(np.arange(len(points)), len(angles)).astype(float)
    state = State(positions, cycle=cycle, target=np.full(len(runs), name))
    starts = run_starts(state)
    velocity = velocities_on_circles(machine, state, feed)
    lengths = np.linalg.norm(np.diff(positions, axis=0, prepend=positions[:1])[:, ~machine.rotary], axis=1)
    time = np.round(np.cumsum(np.where(starts, OVERSHOOT_S, lengths / feed * 60.0)) - OVERSHOOT_S, 4)
    state = in_runs(replace(state, velocity=velocity, acceleration=np.zeros_like(positions), time=time))
    return Measurement(
        machine,
        bar,
        state,
        np.zeros((len(runs), 1)),
        {name: tool},
        run=np.array(runs),
        feed=feed,
        spheres={ONE_SET_UP: circles.centre},
    )


def _refuse_beyond(machine: Machine, positions: Array) -> None:
    beyond = np.maximum(machine.travel[0] - positions, positions - machine.travel[1]).max(axis=0)
    for axis, far in zip(machine.axes, beyond.tolist(), strict=True):
        if far > 1e-6:
            raise UserError(f"--centre: the circles leave the travel of {axis.name} by {far:.4g} {axis.unit}")
