"""Instruments that observe points: those of the machine, from the pose of a station, a part, a sphere or a table ball.

observed = registration(points of the machine with errors) + shift by the instrument's own effects + noise. Values are
exact; derivatives are those at nominal positions, first order in the errors.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from calibration.instruments.base import InstrumentBase
from calibration.registration.observed_points import (
    carried,
    derivatives_by_errors,
    derivatives_by_positions,
    target_points,
)
from calibration.registration.registration import PLANAR, RIGID, SHIFTS, Registration, rigid
from kinematics.transforms import Array, Pose, by_turn, turn
from kinematics.user_error import UserError

if TYPE_CHECKING:
    from calibration.measurement.measurement import Measurement
    from kinematics.error_model.model import Observation
    from kinematics.machine import Vector

LINE_RMS_MM = 1.0
"""RMS distance of points from a line, mm, below which they do not determine the instrument's rotation about it."""


class OfPoints(InstrumentBase, frozen=True):
    """Base of the instruments that observe points in a frame of their own."""

    CHECKS: ClassVar[tuple[str, ...]] = ("points",)

    @property
    def moves(self) -> tuple[str, ...]:
        """All moves of a rigid body; those in the plane where only x and y are observed."""
        return PLANAR if self.planar else RIGID

    def first_registration(self, measurement: Measurement, trusted: np.ndarray) -> Registration:
        """See `InstrumentBase.first_registration`.

        Poses come from targets on the tool where these suffice: positions of other targets are guesses.
        """
        names, groups = np.unique(measurement.groups).tolist(), measurement.groups
        planar = self.planar
        points = measurement.nominal_points
        # z of a part that is measured in x and y is nominal
        observed = np.concatenate([measurement.observed, points[:, measurement.instrument.components :]], axis=1)
        known = np.array([target.known for target in measurement.targets.values()])[measurement.target_number]
        poses, centres = {}, {}
        for name in names:
            mine = groups == name
            # with too few trusted rows, all rows of the station count
            choices = [rows for rows in (mine & trusted & known, mine & trusted) if rows.sum() >= (2 if planar else 3)]
            rows = next((rows for rows in choices if planar or width(points[rows]) > LINE_RMS_MM), [*choices, mine][0])
            poses[name] = rigid(points[rows], observed[rows], planar=planar)
            centres[name] = observed[rows].mean(axis=0)
        registration = Registration(poses, centres, self.moves)
        return replace(registration, targets=_first_targets(measurement, registration))

    def nominally_observed(
        self, measurement: Measurement, registration: Registration
    ) -> tuple[Measurement, Registration]:
        """See `InstrumentBase.nominally_observed`."""
        seen = registration.apply(measurement, registration.points(measurement))
        return replace(measurement, observed=seen, state=replace(measurement.state, observed=seen)), registration

    def expected(self, measurement: Measurement, registration: Registration, effects: Observation) -> Array:
        """See `InstrumentBase.expected`."""
        return measurement.components_of(self.seen(measurement, registration, effects))

    def seen(self, measurement: Measurement, registration: Registration, effects: Observation) -> Array:
        """Points `(n, 3)`, mm, of the machine with these effects, in the instrument's frame."""
        errors = effects.errors if effects.errors.any() else None
        points = target_points(measurement, errors, registration.tool(measurement))
        return registration.apply(measurement, points) + effects.shift

    def transform(self, measurement: Measurement, registration: Registration) -> Array:
        """See `InstrumentBase.transform`."""
        return measurement.components_of(self.moves_by_errors(measurement, registration))

    def moves_by_errors(self, measurement: Measurement, registration: Registration) -> Array:
        """Derivatives `(n, 3, (axes + 1) * 6 + 3)` of the points by the error motions, and by their shift."""
        seen = derivatives_by_errors(measurement, registration.tool(measurement))
        own = registration.rotations(measurement) @ seen
        shift = np.broadcast_to(np.eye(3), (len(measurement), 3, 3))
        return np.concatenate([own, shift], axis=2)

    def registration_design(self, measurement: Measurement, registration: Registration) -> Array:
        """See `InstrumentBase.registration_design`."""
        columns = self.moves_by_poses(measurement, registration), self.moves_by_targets(measurement, registration)
        return measurement.components_of(np.concatenate(columns, axis=2))

    def moves_by_targets(self, measurement: Measurement, registration: Registration) -> Array:
        """Derivatives `(n, 3, 3 targets)` of the points by the positions of targets that the registration has."""
        columns = [np.zeros((len(measurement), 3, 0))]
        turns = registration.rotations(measurement) @ carried(measurement) if registration.targets else None
        numbers = {name: i for i, name in enumerate(measurement.targets)}
        for name in registration.targets:
            assert turns is not None
            columns.append(np.where(np.equal(measurement.target_number, numbers[name])[:, None, None], turns, 0.0))
        return np.concatenate(columns, axis=2)

    def moves_by_poses(self, measurement: Measurement, registration: Registration) -> Array:
        """Derivatives `(n, 3, poses)` of the points by the poses of the groups."""
        n, groups = len(measurement), measurement.groups
        points = registration.apply(measurement, registration.points(measurement))
        columns = []
        for group, centre in registration.centres.items():
            own = np.zeros((n, 3, 6))
            rows = groups == group
            own[rows, :, :3] = np.eye(3)
            own[rows, :, 3:] = by_turn(points[rows] - centre)
            columns.append(own[:, :, registration.move_numbers])
        return np.concatenate(columns, axis=2)

    def drawn_registration(
        self, blank: Measurement, poses: Mapping[str, Pose] | None, rng: np.random.Generator
    ) -> Registration:
        """The stated poses; UserError where one is missing."""
        groups = np.unique(blank.groups).tolist()
        missing = [group for group in groups if group not in (poses or {})]
        if poses is None or missing:
            raise UserError(f"no pose of the instrument for {', '.join(missing)}")
        return Registration(poses, moves=self.moves)

    def aimed_at(self, blank: Measurement, registration: Registration) -> Array | None:
        """Nominal points: the influence of machine errors on the beam to them is negligible."""
        return registration.apply(blank, blank.nominal_points)

    def by_axes(self, measurement: Measurement, registration: Registration) -> Array:
        """See `InstrumentBase.by_axes`."""
        return np.asarray(self.moves_by_axes(measurement, registration)[:, : measurement.instrument.components])

    def moves_by_axes(self, measurement: Measurement, registration: Registration) -> Array:
        """Derivatives `(n, 3, axes)` of the points by the positions of the axes, per mm and rad."""
        moves = derivatives_by_positions(measurement, registration.tool(measurement))
        return np.asarray(registration.rotations(measurement) @ moves)


class OfDistances(OfPoints, frozen=True):
    """Base of the instruments that observe the distance of a target from a centre of theirs, with an unknown zero.

    The centre is the origin of the instrument's frame, whose orientation has no effect.
    """

    @property
    def moves(self) -> tuple[str, ...]:
        """Those of the centre."""
        return SHIFTS

    def nominally_observed(
        self, measurement: Measurement, registration: Registration
    ) -> tuple[Measurement, Registration]:
        """See `InstrumentBase.nominally_observed`."""
        done, registration = super().nominally_observed(measurement, registration)
        zeros = dict.fromkeys(np.unique(self.zero_names(done)).tolist(), 0.0) | dict(registration.zeros)
        far = np.linalg.norm(done.observed, axis=1, keepdims=True)
        return replace(done, observed=far), replace(registration, zeros=zeros)

    def expected(self, measurement: Measurement, registration: Registration, effects: Observation) -> Array:
        """Distances `(n, 1)`, mm, with the zeros of their rows; 0 where the registration lacks one."""
        seen = self.seen(measurement, registration, effects)
        zeros = [registration.zeros.get(name, 0.0) for name in self.zero_names(measurement).tolist()]
        return np.asarray(np.linalg.norm(seen, axis=1) + zeros)[:, None]

    def transform(self, measurement: Measurement, registration: Registration) -> Array:
        """See `InstrumentBase.transform`."""
        along = directions(measurement, registration)[:, None]
        return np.asarray(along @ self.moves_by_errors(measurement, registration))

    def registration_design(self, measurement: Measurement, registration: Registration) -> Array:
        """Derivatives `(n, 1, parameters)` by the centres, the zeros and the targets."""
        names, along = self.zero_names(measurement), directions(measurement, registration)[:, None]
        zeros = np.stack([names == name for name in registration.zeros], axis=1)[:, None].astype(float)
        centres = along @ self.moves_by_poses(measurement, registration)
        return np.concatenate([centres, zeros, along @ self.moves_by_targets(measurement, registration)], axis=2)

    def by_axes(self, measurement: Measurement, registration: Registration) -> Array:
        """See `InstrumentBase.by_axes`."""
        return directions(measurement, registration)[:, None] @ self.moves_by_axes(measurement, registration)


def directions(measurement: Measurement, registration: Registration) -> Array:
    """Unit vectors `(n, 3)` from the centres to the targets of the nominal machine."""
    points = registration.apply(measurement, measurement.nominal_points)
    return np.asarray(points / np.linalg.norm(points, axis=1, keepdims=True))


def centred_pose(centre: Array | Vector) -> Pose:
    """Pose of an instrument with a centre `(3,)`, mm, and without an orientation of its own."""
    return Pose(np.eye(3)[None], -np.asarray(centre, float)[None])


def width(points: Array) -> float:
    """RMS distance, mm, of points `(n, 3)` from the line that fits them best."""
    return float(np.linalg.norm(np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1:]) / len(points) ** 0.5)


def _first_targets(measurement: Measurement, registration: Registration) -> dict[str, Array]:
    """Positions `(3,)`, mm, of free targets and targets on table and bed: medians over their rows, with first poses."""
    unknown = [name for name, target in measurement.targets.items() if not target.known]
    found = {name: np.array(measurement.targets[name].position) for name in unknown}
    if not found:
        return found
    at_zero = registration.apply(measurement, target_points(measurement, None, np.zeros((len(measurement), 3))))
    there = registration.rotations(measurement) @ carried(measurement)
    positions = turn(np.swapaxes(there, 1, 2), measurement.observed - at_zero)
    for number, name in enumerate(measurement.targets):
        rows = measurement.target_number == number
        if name in found and rows.any():
            found[name] = np.median(positions[rows], axis=0)
    return found
