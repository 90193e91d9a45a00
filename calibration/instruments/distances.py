"""Calibrated distances between spheres as observations of the registration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calibration.instruments.targets import Distance
from calibration.registration.registration import SHIFTS, Registration
from kinematics.transforms import Array


def distance_residuals(distances: Sequence[Distance], registration: Registration) -> Array:
    """Calibrated minus present distances between spheres `(k,)`, in standard uncertainties; exact."""
    if not distances:
        return np.zeros(0)
    centres = registration.sphere_centres
    return np.array(
        [
            (each.length - float(np.linalg.norm(centres[each.one] - centres[each.other]))) / each.u
            for each in known_distances(distances, registration)
        ]
    )


def distance_design(distances: Sequence[Distance], registration: Registration) -> Array:
    """Derivatives `(k, registration)` of the distances by the registration, in standard uncertainties."""
    centres, columns = registration.sphere_centres, {name: i for i, name in enumerate(registration.names)}
    known = known_distances(distances, registration)
    design = np.zeros((len(known), len(columns)))
    for row, each in zip(design, known, strict=True):
        apart = centres[each.one] - centres[each.other]
        along = apart / np.linalg.norm(apart) / each.u
        for sphere, sign in ((each.one, -1.0), (each.other, 1.0)):  # the registration shifts by minus the centre
            row[[columns[f"pose {sphere} {move}"] for move in SHIFTS]] = sign * along
    return design


def known_distances(distances: Sequence[Distance], registration: Registration) -> list[Distance]:
    """The calibrated distances between spheres that are in the registration."""
    return [each for each in distances if {each.one, each.other} <= registration.poses.keys()]
