"""Layout of one case: nominal positions, targets and stations; weights and noise of its observations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from calibration.instruments import Instrument
from calibration.instruments.of_points import centred_pose
from calibration.measurement.measurement import Distance, Measurement
from calibration.measurement.plan import Plan
from calibration.observation.reach import Reach, in_reach
from calibration.registration.registration import Registration
from calibration.simulation.simulate import observe, stationed, tracker_pose, with_temperatures
from kinematics.error_model.model import no_errors
from kinematics.machine import Vector
from kinematics.state import State
from kinematics.transforms import Array, Pose
from kinematics.user_error import UserError

Weighting = Literal["full", "cartesian-diagonal"]
"""Weights by the full covariance of each observation, or by the variances of x, y and z alone (the paper, (8))."""
NEAREST_TARGET_MM = 1.0
"""Smallest distance, mm, between tracker and target: a closer target has no direction."""


@dataclass(frozen=True)
class Setup:
    """A measurement of a machine without errors by an instrument without noise, with weights and noise."""

    measurement: Measurement
    registration: Registration
    poses: Mapping[str, Pose] | None
    white: Array
    """Weights `(n, d, d)` of the observations."""
    noise: Array
    """Factors `(n, d, d)` from noise of unit variance to the weighted noise of the instrument."""
    minutes: float
    """Duration of the measurement, min."""
    notes: tuple[str, ...] = ()

    @property
    def stated(self) -> Array:
        """Derivatives `(k, registration)` of stated values, such as calibrated distances, in standard uncertainties."""
        return self.measurement.instrument.stated_design(self.measurement, self.registration)


def laid_out(
    plan: Plan,
    instrument: Instrument,
    trackers: Sequence[Vector] = (),
    reach: Reach | None = None,
    weighting: Weighting = "full",
    temperatures: Mapping[str, tuple[float, float]] | None = None,
    distances: Sequence[Distance] = (),
) -> Setup:
    """The set-up of a plan, measured once from each tracker position; points out of reach are left out, with a note.

    A plan with stations of its own is measured once (see `stationed`). distances: calibrated distances of the spheres
    of a touch probe. UserError for an instrument that observes nothing, or that is at a target.
    """
    state, stations = stationed(plan, trackers)
    poses = _poses(plan, instrument, stations)
    if temperatures:
        state = with_temperatures(state, temperatures)
    repeat = len(state) // len(plan)
    run, rows, notes = np.tile(plan.run, repeat), np.arange(len(state)), plan.notes
    if stations and poses is not None and reach is not None:
        rows, out_of_reach = _in_reach(plan, instrument, state, poses, reach)
        notes = (*notes, *out_of_reach)
    # rows out of reach cost no time
    minutes = plan.minutes * repeat * (len(rows) / len(state))
    readings = instrument.readings_in(plan.machine, plan.axis, rows % len(plan))
    rows = rows[readings.rows]
    nominal = observe(
        plan.machine, no_errors(plan.machine), state.rows(rows), instrument, np.random.default_rng(0), poses,
        plan.targets, axis=readings.axis, run=run[rows], component=readings.component, noise_scale=0.0,
    )  # fmt: skip
    stated = plan.spheres or (stations if plan.stations else {})
    nominal = replace(nominal, source=plan.strategy, spheres=stated, distances=tuple(distances))
    if (
        instrument.STATIONED
        and np.linalg.norm(nominal.state.need("observed", "a tracker"), axis=1).min() < NEAREST_TARGET_MM
    ):
        raise UserError(f"a target comes closer than {NEAREST_TARGET_MM:g} mm to the tracker: move the tracker")
    registration = nominal.instrument.first_registration(nominal, np.ones(len(nominal), bool))
    return Setup(nominal, registration, poses, *_weights(nominal, weighting), minutes, tuple(notes))


def _poses(plan: Plan, instrument: Instrument, stations: Mapping[str, Vector]) -> Mapping[str, Pose] | None:
    """Poses of the trackers by station, or of the spheres by name; None for other instruments.

    UserError for a tracker without a position, and for a position of another instrument.
    """
    if instrument.STATIONED:
        if not stations:
            raise UserError(
                f"the position of the {instrument.kind().replace('-', ' ')} is missing: state tracker = [x, y, z]"
            )
        # the rotation of a levelled tracker about its vertical has no effect: it need not be drawn
        return {name: tracker_pose(position, np.random.default_rng(0)) for name, position in stations.items()}
    if stations:
        raise UserError(
            f"a position of a tracker is not allowed in a measurement by {type(instrument).__name__.lower()}"
        )
    return {name: centred_pose(centre) for name, centre in plan.spheres.items()} or None


def _in_reach(
    plan: Plan, instrument: Instrument, state: State, poses: Mapping[str, Pose], reach: Reach
) -> tuple[np.ndarray, Sequence[str]]:
    """The rows that the trackers observe, and notes on the others; UserError if they observe none."""
    measurement = Measurement(plan.machine, instrument, state, np.zeros((len(state), 3)), plan.targets)
    visible = in_reach(measurement, poses, reach)
    rows = np.flatnonzero(visible.rows)
    if not len(rows):
        raise UserError("the tracker observes none of the points from its position")
    return rows, visible.notes


def _weights(measurement: Measurement, weighting: Weighting) -> tuple[Array, Array]:
    """Weights and weighted noise `(n, d, d)`."""
    full = measurement.whiteners
    if weighting == "full":
        return full, np.broadcast_to(np.eye(full.shape[1]), full.shape)
    covariance = measurement.covariances
    white = np.eye(full.shape[1]) / np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))[:, :, None]
    return white, white @ np.linalg.inv(full)
