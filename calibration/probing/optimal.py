"""Rotary positions that leave the least uncertainty at all other ones: `calibration.optimal.exchange` over poses."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from calibration.design.equations import Columns
from calibration.design.layout import Setup
from calibration.design.volume import Volume, standing
from calibration.instruments import TouchProbe
from calibration.instruments.touch_probe import TIP
from calibration.measurement.measurement import Measurement, Target, with_moves
from calibration.optimal.exchange import Selection, exchanged, filled
from calibration.optimal.optimise import EXCHANGES, equations_of
from calibration.probing.bodies import Bodies
from calibration.probing.paths import Reached, centre_point
from kinematics.inverse import linear_positions
from kinematics.state import State
from kinematics.transforms import Array

AROUND_MM = 50.0
"""Distance beyond the spheres, mm, of the points at which the uncertainty is evaluated."""
EVALUATED = 300
"""Number of these points."""
BASIS, ROTARY_BASIS = "legendre:3", "fourier:2"
"""Assumed bases: spheres take the linear axes to few positions."""
CENTRE_INFORMATION = 1e-5
"""Prior information on the centres of the spheres, whose columns have unit length."""


def most_informative(
    bodies: Bodies, poses: Sequence[list[Reached]], number: int, u_um: float, done: Callable[[float], None]
) -> tuple[list[int], float]:
    """Numbers of the poses that show most, and the RMS error, um, that they leave for errors of typical size.

    A pose is measured as a whole, with all spheres that are within reach in it. done: called with the share of those
    chosen.
    """
    rows = [(k, reached) for k, own in enumerate(poses) for reached in own]
    columns = Columns(_set_up(bodies, [reached for _, reached in rows], u_um), [_volume(bodies, poses)], ())
    each, prior, evaluated, _ = equations_of(columns, len(rows), BASIS, ROTARY_BASIS, CENTRE_INFORMATION)
    size = each.shape[1]
    by_pose = np.zeros((len(poses), size * len(bodies.names), each.shape[2]))
    for (k, reached), equations in zip(rows, each, strict=True):
        first = reached.centre.sphere * size
        by_pose[k, first : first + size] = equations
    selection = Selection(by_pose, prior, evaluated, np.zeros(len(poses), bool))
    allowed = np.ones(len(poses), bool)
    filled(selection, min(number, len(poses)), allowed, done)
    if number < len(poses):
        exchanged(selection, allowed, EXCHANGES)
    some = by_pose[selection.chosen].reshape(-1, by_pose.shape[2])
    spread = np.linalg.inv(prior + some.T @ some)
    return np.flatnonzero(selection.chosen).tolist(), float(np.sqrt(np.sum(evaluated * spread)))


def _set_up(bodies: Bodies, rows: Sequence[Reached], u_um: float) -> Setup:
    """A measurement of these centres on the machine without errors."""
    machine, tip, n = bodies.machine, bodies.probe.tip, len(rows)
    centres = np.array([centre_point(bodies, row.centre) for row in rows])
    positions = linear_positions(machine, np.array([row.centre.raised for row in rows]), centres, tip)
    at_rest = np.zeros_like(positions)
    state = State(
        positions, velocity=at_rest, acceleration=at_rest, time=np.arange(n, dtype=float), cycle=np.zeros(n),
        station=np.array(bodies.names)[[row.centre.sphere for row in rows]], target=np.full(n, TIP),
        observed=np.zeros((n, 3)),
    )  # fmt: skip
    measured = Measurement(
        machine, TouchProbe(u_um=u_um), with_moves(state), np.zeros((n, 3)), {TIP: Target(tip)},
        spheres=dict(bodies.artefact.centres),
    )  # fmt: skip
    white = measured.whiteners
    noise = np.broadcast_to(np.eye(3), white.shape)
    return Setup(measured, measured.instrument.first_registration(measured, np.ones(n, bool)), None, white, noise, 0.0)


def _volume(bodies: Bodies, poses: Sequence[list[Reached]]) -> Volume:
    """Points about the spheres at rotary positions within reach, at which the tip's uncertainty counts."""
    machine, tip = bodies.machine, np.array(bodies.probe.tip)
    balls = np.array(list(bodies.artefact.centres.values()))
    rng = np.random.default_rng(0)
    low, high = balls.min(axis=0) - AROUND_MM, balls.max(axis=0) + AROUND_MM
    points = low + rng.uniform(size=(EVALUATED, 3)) * (high - low)
    turned: Array = np.array([own[0].centre.raised for own in poses])[rng.integers(0, len(poses), EVALUATED)]
    return Volume.at(machine, standing(linear_positions(machine, turned, points, tip)), tip)
