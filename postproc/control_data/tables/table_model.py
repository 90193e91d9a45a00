"""The errors that tables correct, as effects."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, cast

import numpy as np

from kinematics.effects import ControlTable, Effect
from kinematics.effects.base import unit_of
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
