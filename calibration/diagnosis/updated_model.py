"""The new calibration: the machine's effects with the causes found, in the datum, without the instrument's."""

from __future__ import annotations

import datetime
from collections.abc import Mapping, Sequence
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
from calibration.observation.mean_lines import AT_ORIGIN, about_own_points, arms_of
from kinematics.effects import UM, Effect, ErrorMotion, Scale
from kinematics.effects.base import own_component, own_motion
from kinematics.error_model.model import ErrorModel
from kinematics.error_model.provenance import SIMULATED, Provenance, plugin_inputs
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


def merged(machine: Machine, model: ErrorModel, calibrated: int, arms: Mapping[str, Array] = AT_ORIGIN) -> ErrorModel:
    """The model with one error motion for each axis and component, in the finest of its nested bases.

    A scale becomes part of the positioning error. Effects that differ only in linear parameters are one, with the sum
    of their parameters. calibrated: number of effects of the present calibration, which come first and keep their
    datum. The additional errors are moved into the datum, and its mean lines become location errors. arms: those of the
    measured points, as `arms_of`.
    """
    own_points, turned = about_own_points(model)
    kept, into = _joined(machine, own_points)
    whole = msgspec.structs.replace(model, effects=kept, covariance=None)
    located, split = split_locations(machine, whole, arms)
    matrix = np.eye(len(split), len(into), len(into) - len(split)) @ into
    end = sum(len(effect.parameters) for effect in model.effects[:calibrated])
    if any(isinstance(effect, (ErrorMotion, Scale)) for effect in model.effects[calibrated:]):
        matrix[:, end:] = split @ to_datum(machine, whole, priors(whole), arms) @ into[:, end:]
    final, together = _joined(machine, located)
    return transformed(model, final, together @ matrix @ turned)


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
