"""The drift of a machine at a time, and the calibration that corrects it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import msgspec

from calibration.following.followed import Estimate, Followed
from kinematics.error_model.model import ErrorModel
from kinematics.user_error import UserError
from rendering.shown import Shown


@dataclass(frozen=True, repr=False)
class Drift(Shown):
    """The drift of a machine at a time, and the calibration that corrects it."""

    followed: Followed
    """Sensors, walk and implausible readings."""
    estimate: Estimate
    """The drift with its uncertainty."""
    calibration: ErrorModel
    """The calibration that was given."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        return f"{self.followed.measurement.machine.name}, {self.estimate.headline}"

    @cached_property
    def model(self) -> ErrorModel:
        """The calibration with the drift, or without it where it is not larger than its uncertainty."""
        if not self.estimate.significant:
            return self.calibration
        provenance = self.followed.provenance(self.calibration)
        return msgspec.structs.replace(self.estimate.on(self.calibration), provenance=provenance)


def drift_at(
    followed: Followed,
    calibration: ErrorModel,
    at: str | None = None,
    since: str | None = None,
    temperatures: Mapping[str, float] | None = None,
    tolerance_um: float | None = None,
) -> Drift:
    """The drift from one time stamp of the log to another; UserError where its uncertainty exceeds a tolerance."""
    times = {"time": followed.seconds(at, "--at"), "since": followed.seconds(since, "--since")}
    estimate = followed.at(**times, temperatures=temperatures)
    if tolerance_um is not None and tolerance_um < estimate.U:
        raise UserError(
            f"{followed.measurement.source}: the drift is known to {estimate.U:.1f} um (U, k=2), "
            f"{estimate.age_s / 3600.0:.1f} h after the last plausible reading, and it has to be known to "
            f"{tolerance_um:g} um: touch the sphere again. Nothing is corrected"
        )
    return Drift(followed, estimate, calibration)
