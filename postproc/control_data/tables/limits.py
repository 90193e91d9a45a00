"""Limits of a control's tables, and refusals of tables beyond them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from kinematics.machine import Axis, Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.control_data.tables.terms import Curve, Term


@dataclass(frozen=True)
class Limits:
    """Limits of one format, with one user's settings; lengths are in the unit of its files, angles in degrees."""

    points: int
    """Most nodes of one table."""
    resolution: float
    """Least step of a value."""
    finest: float = 5e-6
    """RMS of the residual of a table, mm or degrees whatever the unit, below which no further nodes are added."""
    equidistant: bool = False
    spacing_step: float = 1e-4
    """Nodes lie on whole multiples of this from the reference position; of equidistant ones, their spacing."""
    interval: float | None = None
    """The spacing of equidistant nodes, when it is given."""
    on_grid: bool = False
    """True if free nodes are at whole intervals from the reference position."""
    shared: bool = False
    """True when all tables of one axis are columns over the same nodes."""
    cross: Limits | None = None
    """Limits of tables that add to another axis, if they differ."""
    cross_per_source: int | None = None
    """Most axes that one axis has tables for, besides its own."""
    surfaces_per_output: int | None = None
    """Most surfaces that add to one axis."""
    degree: int | None = None
    """Degree of the polynomial that a table is; None for a table that is linear between nodes."""
    through_zero: bool = False
    """True when this polynomial is 0 at position 0, or at the reference position where `zero_at_home`."""
    grid: int | None = None
    """Most nodes of a surface along either axis."""
    mesh: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    """Nodes of a surface by its axes, where the control has them already."""
    square: bool = False
    """True when the nodes of a surface are as far apart along both axes."""
    tables: int | None = None
    """Most tables in all; a product takes two."""
    largest: float = float("inf")
    """Size that no value may exceed."""
    steepest: float = float("inf")
    """Largest difference of two neighbouring values."""
    turns: int | None = None
    """Turns to either side that a table of an axis that turns without end is written out for; None: it repeats."""
    zero_at_home: bool = False
    """True when the value (forward) at the reference position must be 0, or the axis would jump when it is homed."""
    length_mm: float = 1.0
    """Unit of these lengths, mm."""

    def of(self, source: Axis, output: Axis) -> Limits:
        """The limits in mm and degrees of a table that adds to `output` by the position of `source`."""
        at, value = (1.0 if axis.rotary else self.length_mm for axis in (source, output))
        if at == value == 1.0:
            return self
        return replace(
            self,
            length_mm=1.0,
            resolution=self.resolution * value,
            largest=self.largest * value,
            steepest=self.steepest * value,
            spacing_step=self.spacing_step * at,
            interval=None if self.interval is None else self.interval * at,
        )


def check_terms(terms: Sequence[Term], limits: Limits, control: str, machine: Machine) -> None:
    """UserError, naming the table, for a table that `control` would refuse or truncate without a message."""
    count = sum(len(term.factors) for term in terms)
    if limits.tables is not None and count > limits.tables:
        raise UserError(f"{control} holds at most {limits.tables} tables, and the correction needs {count}")
    for term in terms:
        crossing = len(term.inputs) == 1 and term.inputs != (term.output,)
        axes = [machine.axes[machine.index(name)] for name in (term.inputs[0], term.output)]
        own = (limits.cross if limits.cross is not None and crossing else limits).of(axes[0], axes[1])
        where = f"{control}, table {term.name}"
        for factor in term.factors:
            for nodes in factor.nodes if isinstance(factor.nodes, tuple) else (factor.nodes,):
                _check_nodes(nodes, own, where)
            _check_values(factor.values, own, where)
            if isinstance(factor, Curve):
                _check_ends(factor, own, where, machine.axes[machine.index(factor.axis)], term.direction)


def _check_ends(curve: Curve, limits: Limits, where: str, axis: Axis, direction: int) -> None:
    """The constant of a table that must begin where it ends, or be 0 at the reference position.

    If the directions differ, that of forward travel.
    """
    if axis.turns_fully and curve.values[0] != curve.values[-1]:
        raise UserError(f"{where}: {axis.name} turns fully, so its first and last value must be equal")
    at_home = float(np.interp(axis.home, curve.nodes, curve.values))
    if limits.zero_at_home and direction >= 0 and abs(at_home) > limits.resolution:
        raise UserError(f"{where}: the value at the reference position {axis.home:g} is {at_home:g}; it must be 0")


def _check_nodes(nodes: Array, limits: Limits, where: str) -> None:
    if not np.isfinite(nodes).all() or not (np.diff(nodes) > 0).all():
        raise UserError(f"{where}: positions must be finite numbers that increase")
    if len(nodes) > limits.points:
        raise UserError(f"{where}: {len(nodes)} points exceed the most, {limits.points}")
    if limits.equidistant and len(nodes) > 2:
        apart = np.diff(nodes)
        if np.ptp(apart) > 1e-9 * max(1.0, float(np.abs(nodes).max())):
            raise UserError(f"{where}: its positions must be equidistant")


def _check_values(values: Array, limits: Limits, where: str) -> None:
    if not np.isfinite(values).all():
        raise UserError(f"{where}: a value is not a finite number")
    steps = np.abs(np.diff(values)).max(initial=0.0)
    if steps > limits.steepest * (1 + 1e-9):
        raise UserError(f"{where}: a step of {steps:g} between points exceeds the largest, {limits.steepest:g}")
    if np.abs(values).max(initial=0.0) > limits.largest:
        raise UserError(f"{where}: a value of {np.abs(values).max():g} exceeds the largest, {limits.largest:g}")
