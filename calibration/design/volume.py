"""Evaluation of a machine: deviations on a grid over the whole travel, after a rigid alignment."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from calibration.evaluation.volumetric import rigid_columns
from calibration.fit.linear import column_space
from calibration.measurement.measurement import with_moves
from calibration.planning.strategies import evaluation_grid
from kinematics.error_model.effect_sums import Design
from kinematics.error_model.model import ErrorModel
from kinematics.error_transform import error_transform_with_tool
from kinematics.forward import tool_point
from kinematics.machine import Machine, Vector
from kinematics.state import State
from kinematics.transforms import Array

GRID_POSITIONS = 9
"""Number of positions on each linear axis (contract 4.2)."""
RIGID = 1e-9
"""Share of the largest singular value below which a rigid motion moves no point."""
ROTARY_STEP_SHARES = (0.6180339887498949, 0.7548776662466927, 0.5698402909980532)
"""Steps, as shares of their range, of rotary axes from one position of the grid to the next: never in phase."""


@dataclass(frozen=True)
class Volume:
    """Positions, the transform of errors to tool points there, and the rigid motions that an alignment removes."""

    machine: Machine
    state: State
    tool: Array
    """Tool vectors `(3,)` or `(n, 3)`, mm."""
    transform: Array
    """Transform `(n, 3, (axes + 1) * 6)` of errors to displacements, mm."""
    rigid: Array
    """Rigid motions, as orthonormal columns `(3 n, 6 or fewer)`."""

    @classmethod
    def of(
        cls,
        machine: Machine,
        tool: Vector,
        turned: Mapping[str, tuple[float, float]] | None = None,
        sensors: Iterable[str] = (),
        ranges: Mapping[str, tuple[float, float]] | None = None,
    ) -> Volume:
        """The grid of the machine for a tool, mm; rotary axes at home, or spread over the ranges `turned`, degrees.

        ranges: those of axes, mm and degrees; linear axes without one are spread over their travel.

        The states are those of `standing`: positions in their order, at rest, 20 degC, also at the `sensors`.
        """
        positions = evaluation_grid(machine, GRID_POSITIONS, ranges)
        for step, (axis, (low, high)) in zip(ROTARY_STEP_SHARES, (turned or {}).items(), strict=False):
            i = machine.index(axis)
            positions[:, i] = (low + (np.arange(1, len(positions) + 1) * step % 1.0) * (high - low)) * machine.scale[i]
        return cls.at(machine, standing(positions, sensors), np.array(tool))

    @classmethod
    def at(cls, machine: Machine, state: State, tool: Array) -> Volume:
        """The volume of any positions, with a tool `(3,)` or `(n, 3)`, mm."""
        # points on one line leave a rotation undetermined
        rigid = column_space(rigid_columns(tool_point(machine, state.positions, tool)), RIGID).basis
        return cls(machine, state, tool, error_transform_with_tool(machine, state.positions, tool)[:, :3], rigid)

    def columns(self, model: ErrorModel) -> Array:
        """Derivatives `(3 n, p)`, um per unit of its parameters, of the deviations of a model, aligned."""
        design = Design(model.effects, self.machine, self.state, with_instrument=False).of(slice(None), self.transform)
        flat = design.reshape(-1, design.shape[2]) * 1e3
        return np.asarray(flat - self.rigid @ (self.rigid.T @ flat))


def standing(positions: Array, sensors: Iterable[str] = ()) -> State:
    """The machine at rest at positions `(n, axes)`, mm and rad, approached in this order, at 20 degC."""
    n, at_rest = len(positions), np.zeros(positions.shape)
    return with_moves(
        State(
            positions,
            velocity=at_rest,
            acceleration=at_rest,
            time=np.zeros(n),
            temperatures={sensor: np.zeros(n) for sensor in sensors},
            cycle=np.zeros(n),
        )
    )
