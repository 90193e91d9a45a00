"""Registration: the unknown pose of the instrument, which every fit estimates together with the errors.

A tracker has one pose for each station, a part one alignment, an interferometer one zero for each run, a touch probe
one centre for each sphere, a ballbar one for its table ball and the error of its length; each target on the table or
the bed has an unknown position.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from calibration.registration.observed_points import target_points
from kinematics.transforms import Array, Pose, rotation_vector_matrix, turn

if TYPE_CHECKING:
    from calibration.measurement.measurement import Measurement

RIGID = ("x", "y", "z", "A", "B", "C")
"""Moves of a rigid body: three shifts, then three rotations."""
PLANAR = ("x", "y", "C")
"""Moves of a part that is measured in x and y only."""
SHIFTS = ("x", "y", "z")
"""Moves of a touch probe's sphere: its orientation has no effect."""


@dataclass(frozen=True)
class Registration:
    """Registration, mm and rad.

    Order of the parameters: poses (shift, then rotation about the centre of the observations), zeros, slopes, targets.
    """

    poses: Mapping[str, Pose] = field(default_factory=dict)
    """Pose of each group, from the frame to which the instrument is fixed to its own."""
    centres: Mapping[str, Array] = field(default_factory=dict)
    """Centre of rotation of each group `(3,)`, mm, in the instrument's frame."""
    moves: tuple[str, ...] = RIGID
    """Moves by which the pose of a group is unknown, some of RIGID in its order."""
    zeros: Mapping[str, float] = field(default_factory=dict)
    """Reading for an axis without error, by run of an interferometer; error of a ballbar's length."""
    slopes: Mapping[str, float] = field(default_factory=dict)
    """Slope of the line of each straightness run against the axis, rad; its zero is at position 0 of the axis."""
    targets: Mapping[str, Array] = field(default_factory=dict)
    """Position `(3,)`, mm, of each target on table or bed, by name."""

    @property
    def names(self) -> list[str]:
        """Names of the parameters."""
        return [
            *(f"pose {group} {move}" for group in self.poses for move in self.moves),
            *(f"zero {group}" for group in self.zeros),
            *(f"slope {group}" for group in self.slopes),
            *(f"target {name} {letter}" for name in self.targets for letter in "xyz"),
        ]

    @property
    def move_numbers(self) -> list[int]:
        """Numbers of the moves among those of a rigid body."""
        return [RIGID.index(move) for move in self.moves]

    @property
    def sphere_centres(self) -> dict[str, Array]:
        """Centres `(3,)`, mm, of a touch probe's spheres, in the workpiece frame at zero pose of the machine."""
        return {sphere: -pose.translation[0] for sphere, pose in self.poses.items()}

    def moved(self, step: Array) -> Registration:
        """The registration after a step `(parameters,)`."""
        size = len(self.moves)
        left = step[size * len(self.poses) :]
        poses = {}
        for (group, pose), own in zip(
            self.poses.items(), step.reshape(-1)[: size * len(self.poses)].reshape(-1, size), strict=True
        ):
            six = np.zeros(len(RIGID))
            six[self.move_numbers] = own
            turned, centre = rotation_vector_matrix(six[3:]), self.centres[group]
            shift = Pose(turned, centre - turn(turned, centre) + six[:3])
            poses[group] = shift @ pose
        zeros, left = _stepped(self.zeros, left)
        slopes, left = _stepped(self.slopes, left)
        shifts = left.reshape(-1, 3)
        targets = {name: own + shift for (name, own), shift in zip(self.targets.items(), shifts, strict=True)}
        return Registration(poses, self.centres, self.moves, zeros, slopes, targets)

    def tool(self, measurement: Measurement) -> Array:
        """Positions `(n, 3)`, mm, of the targets on their carriers, as estimated so far."""
        if not self.targets:
            return measurement.tool
        positions = np.array([self.targets.get(name, np.array(t.position)) for name, t in measurement.targets.items()])
        return np.asarray(positions[measurement.target_number])

    def points(self, measurement: Measurement) -> Array:
        """Targets `(n, 3)`, mm, of the nominal machine, as estimated so far, in the frame of `target_points`."""
        if not self.targets:
            return measurement.nominal_points
        return target_points(measurement, None, self.tool(measurement))

    def apply(self, measurement: Measurement, points: Array) -> Array:
        """Points `(n, 3)`, mm, of the frame to which the instrument is fixed, in the instrument's frame."""
        result = np.empty_like(points)
        groups = measurement.groups
        for group, pose in self.poses.items():
            rows = groups == group
            result[rows] = pose.apply(points[rows])
        return result

    def rotations(self, measurement: Measurement) -> Array:
        """Rotations `(n, 3, 3)` from the frame to which the instrument is fixed to its own."""
        result = np.empty((len(measurement), 3, 3))
        groups = measurement.groups
        for group, pose in self.poses.items():
            result[groups == group] = pose.rotation
        return result


def _stepped(values: Mapping[str, float], step: Array) -> tuple[dict[str, float], Array]:
    """Values after their part of a step, and the remaining part of the step."""
    moved = {
        name: value + own for (name, value), own in zip(values.items(), step[: len(values)].tolist(), strict=False)
    }
    return moved, step[len(values) :]


def rigid(points: Array, seen: Array, *, planar: bool = False) -> Pose:
    """The least-squares pose from `points` to `seen`, both `(n, 3)` (SVD; Montavon et al. (1)-(5)).

    Planar: rotation about z only.
    """
    centre, there = points.mean(axis=0), seen.mean(axis=0)
    product = (seen - there).T @ (points - centre)
    if planar:
        angle = np.arctan2(product[1, 0] - product[0, 1], product[0, 0] + product[1, 1])
        rotation = rotation_vector_matrix([[0.0, 0.0, angle]])[0]
    else:
        u, _, v = np.linalg.svd(product)
        rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
    return Pose(rotation[None], (there - rotation @ centre)[None])
