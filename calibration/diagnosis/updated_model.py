"""The new calibration: the machine's effects with the causes found, in the datum, without the instrument's."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from typing import Any

import msgspec
import numpy as np

from calibration.diagnosis.search.present.nested_bases import contained, embedding
from calibration.diagnosis.search.start_model import Base
from calibration.fit.calibrate import in_datum
from calibration.fit.datum import to_datum
from calibration.fit.fit import Fit
from calibration.fit.location_errors import split_locations, transformed
from calibration.observation.full_model import priors
from kinematics.effects import UM, Effect, ErrorMotion, LocationJump, Scale
from kinematics.effects.base import own_component, own_motion
from kinematics.error_model.model import SIMULATED, ErrorModel, Provenance
from kinematics.machine import Machine
from kinematics.transforms import Array
from kinematics.version import VERSION


def new_calibration(
    base: Base, fit: Fit, causes: Sequence[str], present: ErrorModel | None, beside: str = ""
) -> ErrorModel:
    """The new calibration from a fit; its provenance lists `causes` and the inputs of the calibration `present`.

    beside: variables of a function beside which the model was fitted, as a list in words; empty without one.
    """
    calibrated = base.present
    if calibrated is None:
        model = in_datum(fit)
    else:
        model = merged(fit.measurement.machine, fit.model, len(calibrated.model.effects))
    found = f"; added: {', '.join(causes)}" if causes else ""
    found += f"; beside a function of {beside}" if beside else ""
    before = {} if present is None else {**present.provenance.inputs, "present calibration": present.id}
    simulated = fit.measurement.simulated or (present is not None and present.invented)
    provenance = Provenance(
        made_by=f"ncomp {VERSION}",
        made_at=datetime.datetime.now(datetime.UTC).replace(microsecond=0),
        source=f"diagnosis of {fit.observations} observations, chi2/dof {fit.chi2_reduced:.3g}{found}"
        f"{f', {SIMULATED}' if simulated else ''}",
        inputs={**before, fit.measurement.source: fit.measurement.fingerprint},
        valid_days=msgspec.UNSET if present is None else present.provenance.valid_days,
        temperatures_degC=_temperatures(fit, present) or msgspec.UNSET,
    )
    own = model.part(lambda effect: effect.ACTS_ON != "instrument")
    effects = tuple(map(lasting, own.effects))
    return msgspec.structs.replace(own, effects=effects, provenance=provenance, demonstration=False)


def lasting(effect: Effect) -> Effect:
    """The effect as a calibration has it: after its moment a jump is permanent, whenever later data begin."""
    return msgspec.structs.replace(effect, since_s=None) if isinstance(effect, LocationJump) else effect


def _temperatures(fit: Fit, present: ErrorModel | None) -> dict[str, tuple[float, float]]:
    """Temperature ranges, degC, by sensor: of the measurement and of the present calibration together."""
    ranges = dict(fit.measurement.temperatures)
    stated = msgspec.UNSET if present is None else present.provenance.temperatures_degC
    for sensor, (low, high) in {} if stated is msgspec.UNSET else stated.items():
        least, most = ranges.get(sensor, (low, high))
        ranges[sensor] = min(least, low), max(most, high)
    return ranges


def merged(machine: Machine, model: ErrorModel, calibrated: int) -> ErrorModel:
    """The model with one error motion for each axis and component, in the finest of its nested bases.

    A scale becomes part of the positioning error. Effects that differ only in linear parameters are one, with the sum
    of their parameters. calibrated: number of effects of the present calibration, which come first and keep their
    datum. The additional errors are moved into the datum, and its mean lines become location errors.
    """
    kept, into = _joined(machine, model.effects)
    whole = msgspec.structs.replace(model, effects=kept, covariance=None)
    located, split = split_locations(machine, whole)
    matrix = np.eye(len(split), len(into), len(into) - len(split)) @ into
    end = sum(len(effect.parameters) for effect in model.effects[:calibrated])
    if any(isinstance(effect, (ErrorMotion, Scale)) for effect in model.effects[calibrated:]):
        matrix[:, end:] = split @ to_datum(machine, whole, priors(whole)) @ into[:, end:]
    final, together = _joined(machine, located)
    return transformed(model, final, together @ matrix)


def _joined(machine: Machine, effects: Sequence[Effect]) -> tuple[tuple[Effect, ...], Array]:
    """Effects that contain all others, in their order, and the matrix `(q, p)` from the parameters of all to theirs."""
    containing: dict[int, tuple[int, Array]] = {}
    roots: list[int] = []
    for i in sorted(range(len(effects)), key=lambda i: -len(effects[i].parameters)):
        found = ((root, _within(machine, effects[i], effects[root])) for root in roots)
        root, matrix = next(((root, matrix) for root, matrix in found if matrix is not None), (i, None))
        if matrix is None:
            roots.append(i)
        containing[i] = root, np.eye(len(effects[i].parameters)) if matrix is None else matrix
    order = sorted(roots)
    starts = np.cumsum([0, *(len(effects[root].parameters) for root in order)])
    whole = np.zeros((int(starts[-1]), sum(len(effect.parameters) for effect in effects)))
    end = 0
    for i in range(len(effects)):
        root, matrix = containing[i]
        start = int(starts[order.index(root)])
        whole[start : start + matrix.shape[0], end : end + matrix.shape[1]] += matrix
        end += matrix.shape[1]
    return tuple(effects[root] for root in order), whole


def _within(machine: Machine, effect: Effect, other: Effect) -> Array | None:
    """The matrix `(q, p)` from the parameters of an effect to those of another that contains it; else None."""
    if isinstance(other, ErrorMotion):
        if isinstance(effect, ErrorMotion) and effect.name == other.name:
            return embedding(effect.basis, other.basis)
        if isinstance(effect, Scale) and (effect.axis, own_component(effect.axis)) == (other.axis, other.component):
            size = own_motion(machine, effect.axis)[2] * UM
            return contained(lambda x: size * x[:, None], other.basis, other.basis)
        return None
    if type(effect) is type(other) and _identity(effect) == _identity(other):
        return np.eye(len(effect.parameters))
    return None


def _identity(effect: Effect) -> str:
    """JSON of an effect without its linear parameters, uncertainties and note."""
    fields: dict[str, Any] = msgspec.to_builtins(effect)
    changing = {quantity.name for quantity in effect.quantities() if quantity.linear}
    fixed = {name: value for name, value in fields.items() if name not in changing and name not in ("u", "note")}
    return msgspec.json.encode(fixed, order="sorted").decode()
