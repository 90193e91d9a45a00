"""Tables as an error model: the errors that they correct, and models joined with them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, cast

import msgspec
import numpy as np

from kinematics.effects import ControlTable, Effect
from kinematics.effects.base import unit_of
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine
from kinematics.transforms import Array
from postproc.control_data.tables.terms import Curve, Surface, Term


def effects_of(machine: Machine, terms: Iterable[Term]) -> list[Effect]:
    """The errors that tables correct, minus their corrections, in um and urad. A product of curves is a surface."""
    found: list[Effect] = []
    for term in terms:
        nodes, values = _table(term)
        axis = machine.index(term.output)
        um = -values.ravel() * machine.scale[axis] / unit_of(term.output)[1]
        found.append(ControlTable(term.output, term.inputs, nodes, tuple(um.tolist()), cast(Any, term.direction)))
    return found


def _table(term: Term) -> tuple[tuple[tuple[float, ...], ...], Array]:
    first, *others = term.factors
    if isinstance(first, Surface):
        return tuple(tuple(nodes.tolist()) for nodes in first.nodes), first.values
    if not others:
        return (tuple(first.nodes.tolist()),), first.values
    second = cast(Curve, others[0])
    nodes = (tuple(first.nodes.tolist()), tuple(second.nodes.tolist()))
    return nodes, np.outer(first.values, second.values)


def joined(model: ErrorModel, effects: Sequence[Effect], sign: float) -> ErrorModel:
    """A model and `sign` times further effects, which are known exactly."""
    scaled = [effect.with_parameters([sign * p for p in effect.parameters], effect.u) for effect in effects]
    covariance = model.covariance
    if covariance is not None:
        old, new = len(model.parameters), sum(len(effect.parameters) for effect in effects)
        square = np.zeros((old + new, old + new))
        square[:old, :old] = covariance
        covariance = tuple(map(tuple, square.tolist()))
    return msgspec.structs.replace(model, effects=(*model.effects, *scaled), covariance=covariance)
