"""Calibrated distances between spheres beside the data of a touch probe: do both agree?"""

from __future__ import annotations

from collections.abc import Iterator

from calibration.fit.fit import Fit
from calibration.instruments.distances import distance_residuals, known_distances
from calibration.plausibility.finding import Finding

DISAGREES = 4.0
"""Standard uncertainties from which a distance disagrees with the fit."""


def distance_findings(found: Fit) -> Iterator[Finding]:
    """A finding for each calibrated distance that the fit does not reproduce.

    A single distance determines the scale, and disagrees only where the priors of the axes oppose it.
    """
    distances = known_distances(found.measurement.distances, found.registration)
    off = distance_residuals(found.measurement.distances, found.registration).tolist()
    for each, in_u in zip(distances, off, strict=True):
        if abs(in_u) > DISAGREES:
            yield Finding(
                "distances",
                f"the calibrated distance of spheres {each.one} and {each.other} is {1e3 * each.u * in_u:+.3g} um from "
                f"that of the fit, {abs(in_u):.3g} times its standard uncertainty: the distance, its uncertainty or "
                "one of the spheres is wrong, or the bar was warm",
                False,
            )
