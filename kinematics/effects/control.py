"""Compensation tables in the control."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar, Literal

import numpy as np

from kinematics.basis import Basis, BSpline
from kinematics.effects.base import BY_DIRECTION, EffectBase, Remedy, own_motion, unit_of
from kinematics.effects.records import Columns, Parameter, Workshop
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array


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
        for nodes in self.nodes:
            if not nodes or not np.isfinite(nodes).all() or not (np.diff(nodes) > 0).all():
                raise ValueError(f"{self.name}: nodes must be finite and ascending, at least one")
        if len(self.values) != np.prod(self._shape):
            raise ValueError(f"{self.name}: its nodes take {np.prod(self._shape)} values, got {len(self.values)}")
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
