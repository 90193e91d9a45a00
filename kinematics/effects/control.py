"""Tables over positions of axes: those in the control that compensate errors, and the map of a surface."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar, Literal

import numpy as np

from kinematics.basis import Basis, BSpline, Interval
from kinematics.effects.base import BY_DIRECTION, EffectBase, Remedy, own_motion, unit_of
from kinematics.effects.records import Columns, Parameter, Workshop
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array

UNEVEN = 1e-6
"""Largest difference of two distances between nodes that are even, as a share of these distances."""
CATMULL_ROM = 0.5
"""Tension with which a cardinal spline is a Catmull-Rom spline."""


class ControlTable(EffectBase, frozen=True, tag="control-table"):
    """A compensation table in the control, as the error of an axis that it removes: the negative of its correction.

    A function of the position of one axis, or of two (`values` row by row, those of the second axis running first):
    linear between the nodes, with the values at the edge outside. `way` 1 or -1: only while the first of them moves in
    this direction; an axis that has not moved yet counts half of each. The error is counted forward, as commands are.
    """

    TITLE: ClassVar[str] = "compensation table in the control, as the error that it removes"
    NEEDS: ClassVar[tuple[str, ...]] = ("approach",)
    REMEDY: ClassVar[Remedy] = "table"
    OF_SEVERAL_CLASSES = True
    SHOWN_OVER = "table"
    WORKSHOP = Workshop(
        "A compensation table is active in the control.", "Keep it, or switch it off and write the new one instead."
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("values", BY_DIRECTION, 30.0),)

    axis: str
    of: tuple[str, ...]
    nodes: tuple[tuple[float, ...], ...]
    values: tuple[float, ...]
    way: Literal[-1, 0, 1] = 0

    def __post_init__(self) -> None:
        if len(self.of) not in (1, 2) or len(self.nodes) != len(self.of):
            raise ValueError(f"{self.name}: a function of one axis or two, with nodes of each")
        if len(set(self.of)) != len(self.of):
            raise ValueError(f"{self.name}: a function of two axes that differ")
        for nodes in self.nodes:
            if not nodes or not np.isfinite(nodes).all() or not (np.diff(nodes) > 0).all():
                raise ValueError(f"{self.name}: nodes must be finite and ascending, at least one")
        if len(self.values) != np.prod(self._shape):
            raise ValueError(f"{self.name}: its nodes take {np.prod(self._shape)} values, got {len(self.values)}")
        if not np.isfinite(self.values).all():
            raise ValueError(f"{self.name}: values must be finite")
        super().__post_init__()

    @property
    def name(self) -> str:
        """control-table X(X) forward, ..."""
        return f"{self.kind} {self.axis}({','.join(self.of)})" + {1: " forward", -1: " backward"}.get(self.way, "")

    @property
    def axes(self) -> tuple[str, ...]:
        """See `EffectBase.axes`."""
        return tuple(dict.fromkeys((self.axis, *self.of)))

    @property
    def needs(self) -> tuple[str, ...]:
        """The direction only with `way`."""
        return ("approach",) if self.way else ()

    @property
    def feature_lengths(self) -> Mapping[str, float]:
        """See `EffectBase.feature_lengths`: between two nodes."""
        spaced = zip(self.of, self.nodes, strict=True)
        return {axis: float(np.diff(nodes).min()) for axis, nodes in spaced if len(nodes) > 1}

    @property
    def position_bases(self) -> Mapping[str, Basis | None] | None:
        """See `EffectBase.position_bases`."""
        nodes = self.nodes[0]
        return {self.axis: BSpline(nodes, 1) if len(nodes) > 1 else None} if self.of == (self.axis,) else None

    def columns(self, machine: Machine, state: State) -> Iterator[Columns]:
        """See `EffectBase.columns`."""
        shares = self._shares(machine, state)
        products = shares[0] if len(shares) == 1 else (shares[0][:, :, None] * shares[1][:, None, :])
        i, component, forward = own_motion(machine, self.axis)
        weights = self._weights(machine, state)[:, None] * (forward * unit_of(self.axis)[1])
        yield Columns(i, component, products.reshape(len(state), -1) * weights)

    def contributions(self, machine: Machine, state: State) -> Iterator[tuple[int, int, Array]]:
        """See `EffectBase.contributions`; without building the columns of a surface."""
        values = np.reshape(self.values, self._shape) * unit_of(self.axis)[1]
        first, *second = self._shares(machine, state)
        total = first @ values
        found = np.sum(total * second[0], axis=1) if second else total
        i, component, forward = own_motion(machine, self.axis)
        yield i, component, found * self._weights(machine, state) * forward

    @property
    def _shape(self) -> tuple[int, ...]:
        return tuple(map(len, self.nodes))

    def _shares(self, machine: Machine, state: State) -> list[Array]:
        """Weights `(n, k)` of the nodes in the value at a position, by axis."""
        found = []
        for axis, nodes in zip(self.of, self.nodes, strict=True):
            one = np.ones((len(state), 1))
            found.append(one if len(nodes) == 1 else state.basis_columns(machine, axis, BSpline(nodes, 1)))
        return found

    def _weights(self, machine: Machine, state: State) -> Array:
        if not self.way:
            return np.ones(len(state))
        came = state.need("approach", self.name)[:, machine.index(self.of[0])]
        return np.asarray((1.0 + self.way * came) / 2.0)


class WorkpieceSurface(ControlTable, frozen=True, tag="surface"):
    """The surface of the workpiece, or of the bed: `values` are its heights over the positions of two axes.

    The tool is to stay above the surface at the programmed distance: where the surface is high, the tool is too low by
    the height. Between its nodes a surface is bilinear, or bicubic (Catmull-Rom; the rows at the edges are repeated, as
    Candle does). Outside it has the height of the edge. Its heights count from the work zero. How printed boards bow:
    IPC-6012B, 3.4.3.
    """

    TITLE: ClassVar[str] = "surface of the workpiece that is not flat (height map)"
    ACTS_ON = "workpiece"
    NEEDS: ClassVar[tuple[str, ...]] = ()
    REMEDY: ClassVar[Remedy] = "program"
    OF_SEVERAL_CLASSES = False
    WORKSHOP = Workshop(
        "The workpiece is bowed, or does not lie flat on the bed.",
        "Clamp it flat, mill the bed flat, or correct the program by the map.",
    )
    QUANTITIES: ClassVar[tuple[Parameter, ...]] = (Parameter("values", BY_DIRECTION, 300.0),)

    interpolation: Literal["linear", "cubic"] = "linear"

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.of) != 2 or min(self._shape) < 2:
            raise ValueError(f"{self.name}: a surface has at least two nodes along each of two axes")
        steps = [np.diff(nodes) for nodes in self.nodes]
        if self.interpolation == "cubic" and any(np.ptp(step) > UNEVEN * step.max() for step in steps):
            raise ValueError(f"{self.name}: the nodes of a cubic surface are evenly spaced")

    @property
    def area(self) -> Mapping[str, Interval]:
        """See `EffectBase.area`."""
        return {axis: (nodes[0], nodes[-1]) for axis, nodes in zip(self.of, self.nodes, strict=True)}

    @property
    def size_summary(self) -> tuple[str, ...]:
        """The range of its heights and the number of its nodes."""
        low, high = min(self.values), max(self.values)
        return f"heights {low:.0f} to {high:.0f} um", " x ".join(map(str, self._shape)) + " nodes"

    def _shares(self, machine: Machine, state: State) -> list[Array]:
        """See `ControlTable._shares`."""
        if self.interpolation == "linear":
            return super()._shares(machine, state)
        found = []
        for axis, nodes in zip(self.of, self.nodes, strict=True):
            x = (state.position(machine, axis) - nodes[0]) / (nodes[-1] - nodes[0]) * (len(nodes) - 1)
            found.append(cardinal(len(nodes), np.clip(x, 0.0, len(nodes) - 1.0), CATMULL_ROM))
        return found

    def _weights(self, machine: Machine, state: State) -> Array:  # noqa: ARG002  of the base
        """See `ControlTable._weights`; where the surface is high, the tool is low."""
        return -np.ones(len(state))


def cardinal(nodes: int, at: Array, tension: float) -> Array:
    """Weights `(k, nodes)` of evenly spaced values in a cardinal spline, at places `(k,)` counted in nodes from 0.

    The slope at a node is `tension` times the difference of its neighbours; beyond its ends the row is continued with
    the value of its end.
    """
    first = np.clip(np.floor(at).astype(int), 0, nodes - 2)
    t = at - first
    begin, end = tension * (t**3 - 2 * t**2 + t), tension * (t**3 - t**2)
    rises = 3 * t**2 - 2 * t**3
    found = np.zeros((len(at), nodes))
    rows = np.arange(len(at))
    for step, weight in ((-1, -begin), (0, 1 - rises - end), (1, rises + begin), (2, end)):
        np.add.at(found, (rows, np.clip(first + step, 0, nodes - 1)), weight)
    return found
