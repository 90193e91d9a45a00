"""A calibration and the changes that were found in it, as one calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from calibration.fit.datum import AT_ORIGIN, about_own_points, split_locations, to_datum, transformed
from calibration.gaussian_terms.given.nested_bases import contained, embedding
from calibration.observation.full_model import priors
from kinematics.effects import UM, Effect, ErrorMotion, Scale
from kinematics.effects.base import own_component, own_motion
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine
from kinematics.transforms import Array


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
