"""A measurement as linear observations about the nominal machine: residuals, and derivatives by every error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from calibration.measurement.measurement import Measurement
from calibration.observation.equations import specified_covariance
from calibration.observation.normal_equations import residuals
from calibration.observation.outliers import first_registration
from kinematics.effects import Effect
from kinematics.error_model.effect_sums import Design
from kinematics.error_model.model import no_errors
from kinematics.transforms import Array


@dataclass(frozen=True)
class Observations:
    """Linearised observations of n rows with d scalars each, mm and rad."""

    measurement: Measurement
    residual: Array
    """Observed minus nominal `(n, d)`."""
    transform: Array
    """Derivatives `(n, d, (axes + 1) * 6 + 3)` by the error motions, and by a shift of the observed point."""
    registration: Array
    """Derivatives `(n, d, r)` by the registration."""
    specified: Array
    """Covariances `(n, d, d)` by the specification of the instrument."""
    stated: Array
    """Derivatives `(k, r)` of stated values of the registration, in their standard uncertainties."""
    stated_residual: Array
    """Stated minus present values `(k,)`, in the same unit."""

    @classmethod
    def of(cls, measurement: Measurement) -> Observations:
        """The observations of a measurement about the nominal machine and a first registration."""
        registration, _ = first_registration(measurement)
        instrument, nominal = measurement.instrument, no_errors(measurement.machine)
        return cls(
            measurement,
            residuals(measurement, nominal, registration),
            instrument.transform(measurement, registration),
            instrument.registration_design(measurement, registration),
            specified_covariance(measurement),
            instrument.stated_design(measurement, registration),
            instrument.stated_residuals(measurement, registration),
        )

    def __len__(self) -> int:
        return len(self.residual)

    @property
    def components(self) -> int:
        """Number d of scalars in a row."""
        return int(self.residual.shape[1])

    def columns(self, effects: Sequence[Effect]) -> Array:
        """Derivatives `(n, d, k)` by the parameters of effects, one after the other."""
        measurement = self.measurement
        design = Design(effects, measurement.machine, measurement.state, with_instrument=True)
        return design.of(slice(None), self.transform)
