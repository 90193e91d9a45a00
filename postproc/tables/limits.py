"""What a control's tables can hold, in numbers; and the refusal of what they can't."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from kinematics.errors import UserError
from kinematics.transforms import Array
from postproc.tables.terms import Term


@dataclass(frozen=True)
class Limits:
    """Of one format, with one user's settings."""

    points: int
    """Most nodes of one table."""
    resolution: float
    """Least step of a value, mm or degrees."""
    finest: float = 5e-6
    """RMS of what is left of a table, mm or degrees, that is not worth further nodes."""
    equidistant: bool = False
    spacing_step: float = 1e-4
    """Nodes lie on whole multiples of this from the reference position; of equidistant ones, their spacing."""
    interval: float | None = None
    """The spacing of equidistant nodes, mm or degrees, when it is given."""
    tables: int | None = None
    """Most tables in all; a product takes two."""
    largest: float = float("inf")
    """Size that no value may exceed, mm or degrees."""
    zero_at_home: bool = False
    """True when the value at the reference position must be 0, or the axis would jump when it is homed."""


def check_terms(terms: Sequence[Term], limits: Limits, what: str) -> None:
    """UserError, naming the table, for anything that the control `what` would refuse or cut off without a word."""
    count = sum(len(term.factors) for term in terms)
    if limits.tables is not None and count > limits.tables:
        raise UserError(f"{what} holds {limits.tables} tables, these are {count}")
    for term in terms:
        for factor in term.factors:
            for nodes in factor.nodes if isinstance(factor.nodes, tuple) else (factor.nodes,):
                _check_nodes(nodes, limits, f"{what}, table {term.name}")
            _check_values(factor.values, limits, f"{what}, table {term.name}")


def _check_nodes(nodes: Array, limits: Limits, where: str) -> None:
    if not np.isfinite(nodes).all() or not (np.diff(nodes) > 0).all():
        raise UserError(f"{where}: positions must be numbers that increase")
    if len(nodes) > limits.points:
        raise UserError(f"{where}: {len(nodes)} points, and no more than {limits.points} fit")
    if limits.equidistant and len(nodes) > 2:
        apart = np.diff(nodes)
        if np.ptp(apart) > 1e-9 * max(1.0, float(np.abs(nodes).max())):
            raise UserError(f"{where}: its positions must be equidistant")


def _check_values(values: Array, limits: Limits, where: str) -> None:
    if not np.isfinite(values).all():
        raise UserError(f"{where}: a value is no number")
    if np.abs(values).max(initial=0.0) > limits.largest:
        raise UserError(f"{where}: a value of {np.abs(values).max():g}, and none may exceed {limits.largest:g}")
