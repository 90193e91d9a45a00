"""The new calibration: the machine's effects with the causes found, in the datum, without the instrument's."""

from __future__ import annotations

import datetime
from collections.abc import Sequence

import msgspec

from calibration.diagnosis.search.start_model import Base
from calibration.fit.calibrate import in_datum
from calibration.fit.fit import Fit
from calibration.gaussian_terms.given.merged import merged
from calibration.observation.mean_lines import arms_of
from kinematics.error_model.model import ErrorModel
from kinematics.error_model.provenance import SIMULATED, Provenance, plugin_inputs
from kinematics.version import VERSION


def new_calibration(
    base: Base, fit: Fit, causes: Sequence[str], present: ErrorModel | None, beside: str = ""
) -> ErrorModel:
    """The new calibration from a fit; its provenance lists `causes` and the inputs of the calibration `present`.

    beside: variables of a function beside which the model was fitted, as a list in words; empty without one.
    """
    calibrated = base.present
    model = in_datum(fit) if calibrated is None else _merged(fit, len(calibrated.model.effects))
    found = f"; added: {', '.join(causes)}" if causes else ""
    found += f"; beside a function of {beside}" if beside else ""
    before = {} if present is None else {**present.provenance.inputs, "present calibration": present.id}
    simulated = fit.measurement.simulated or (present is not None and present.invented)
    own = model.part(lambda effect: effect.ACTS_ON != "instrument")
    provenance = Provenance(
        made_by=f"ncomp {VERSION}",
        made_at=datetime.datetime.now(datetime.UTC).replace(microsecond=0),
        source=f"diagnosis of {fit.observations} observations, chi2/dof {fit.chi2_reduced:.3g}{found}"
        f"{f', {SIMULATED}' if simulated else ''}",
        inputs={**before, fit.measurement.source: fit.measurement.fingerprint, **plugin_inputs(own.effects)},
        valid_days=msgspec.UNSET if present is None else present.provenance.valid_days,
        measured_on=msgspec.UNSET if fit.measurement.measured is None else fit.measurement.measured,
        temperatures_degC=_temperatures(fit, present) or msgspec.UNSET,
    )
    effects = tuple(effect.lasting() for effect in own.effects)
    return msgspec.structs.replace(own, effects=effects, provenance=provenance, demonstration=False)


def _temperatures(fit: Fit, present: ErrorModel | None) -> dict[str, tuple[float, float]]:
    """Temperature ranges, degC, by sensor: of the measurement and of the present calibration together."""
    ranges = dict(fit.measurement.temperatures)
    stated = msgspec.UNSET if present is None else present.provenance.temperatures_degC
    for sensor, (low, high) in {} if stated is msgspec.UNSET else stated.items():
        least, most = ranges.get(sensor, (low, high))
        ranges[sensor] = min(least, low), max(most, high)
    return ranges


def _merged(fit: Fit, calibrated: int) -> ErrorModel:
    """The fitted model as of `merged`."""
    return merged(fit.measurement.machine, fit.model, calibrated, arms_of(fit.measurement))
