"""The new calibration: the machine's effects with the causes found, in the datum, without the instrument's."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

import msgspec
import numpy as np

from calibration.diagnosis.search.start_model import Base
from calibration.fit.calibrate import in_datum
from calibration.fit.fit import Fit
from calibration.fit.location_errors import transformed
from kinematics.effects import Effect, LocationJump
from kinematics.error_model.model import ErrorModel, Provenance


def new_calibration(base: Base, fit: Fit, causes: Sequence[str], present: ErrorModel | None) -> ErrorModel:
    """The new calibration from a fit; its provenance lists `causes` and the inputs of the calibration `present`."""
    model = merged(fit.model) if base.origin == "updated" else in_datum(fit)
    found = f"; added: {', '.join(causes)}" if causes else ""
    before = {} if present is None else {**present.provenance.inputs, "present calibration": present.id}
    provenance = Provenance(
        made_by=f"ncomp {version('ncomp')}",
        made_at=datetime.datetime.now(datetime.UTC).replace(microsecond=0),
        source=f"diagnosis of {fit.observations} observations, chi2/dof {fit.chi2_reduced:.3g}{found}",
        inputs={**before, fit.measurement.source: fit.measurement.fingerprint},
        valid_days=msgspec.UNSET if present is None else present.provenance.valid_days,
        temperatures_degC=_temperatures(fit, present) or msgspec.UNSET,
    )
    machine = model.part(lambda effect: effect.ACTS_ON != "instrument")
    # after its moment a jump is permanent, whenever the clock of later data begins
    jumped = (
        msgspec.structs.replace(effect, since_s=None) if isinstance(effect, LocationJump) else effect
        for effect in machine.effects
    )
    return msgspec.structs.replace(machine, effects=tuple(jumped), provenance=provenance, demonstration=False)


def _temperatures(fit: Fit, present: ErrorModel | None) -> dict[str, tuple[float, float]]:
    """Temperature ranges, degC, by sensor: of the measurement and of the present calibration together."""
    ranges = dict(fit.measurement.temperatures)
    stated = msgspec.UNSET if present is None else present.provenance.temperatures_degC
    for sensor, (low, high) in {} if stated is msgspec.UNSET else stated.items():
        least, most = ranges.get(sensor, (low, high))
        ranges[sensor] = min(least, low), max(most, high)
    return ranges


def merged(model: ErrorModel) -> ErrorModel:
    """The model in which effects that differ only in linear parameters are one, with the sum of their parameters."""
    numbers: dict[str, int] = {}
    effects: list[Effect] = []
    of: list[int] = []
    for effect in model.effects:
        key = _identity(effect)
        if key not in numbers:
            numbers[key] = len(effects)
            effects.append(effect)
        of.append(numbers[key])
    kept = msgspec.structs.replace(model, effects=tuple(effects), covariance=None).slices
    matrix = np.zeros((sum(part.stop - part.start for part in kept), len(model.parameters)))
    for number, part in zip(of, model.slices, strict=True):
        matrix[kept[number], part] += np.eye(part.stop - part.start)
    return transformed(model, tuple(effects), matrix)


def _identity(effect: Effect) -> str:
    """JSON of an effect without its linear parameters, uncertainties and note."""
    fields: dict[str, Any] = msgspec.to_builtins(effect)
    changing = {quantity.name for quantity in effect.quantities() if quantity.linear}
    fixed = {name: value for name, value in fields.items() if name not in changing and name not in ("u", "note")}
    return msgspec.json.encode(fixed, order="sorted").decode()
