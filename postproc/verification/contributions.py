"""Contributions of the error motions to the tool point error before correction, at some moves of a program."""

from __future__ import annotations

import numpy as np

from kinematics.error_model.model import ErrorModel
from kinematics.error_transform import error_names_with_tool, error_transform_with_tool
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array
from postproc.compensation.conditions import Conditions
from postproc.compensation.datum import poses, touched
from postproc.evaluation.predicted_errors import Statistic
from postproc.motion.motions import Motions, merged

LEAST_CONTRIBUTION_MOVES = 2000
"""Least number of evaluated moves at which contributions are computed, where a program has so many."""


class Contributions:
    """Contribution of each error motion to the tool point error relative to the datum, um, first order.

    At the ends of evaluated moves, evenly spaced over the program. Location errors count with their error motions.
    """

    def __init__(self, machine: Machine, model: ErrorModel, conditions: Conditions) -> None:
        self._machine, self._model, self._conditions = machine, model, conditions
        self._parts: list[Motions] = []
        self._approach: list[Array] = []
        """Directions `(k, axes)` of their rows, if the model needs any."""
        self._count, self._spacing = 0, 1

    def add(self, motions: Motions, approach: Array | None) -> None:
        """Add the next moves, and the directions `(n, axes)` at their ends."""
        evaluated = np.flatnonzero(motions.evaluated)
        rows = evaluated[-self._count % self._spacing :: self._spacing]
        self._count += len(evaluated)
        if not len(rows):
            return
        self._parts.append(motions.bare.take(rows).with_used_frames)
        if approach is not None:
            self._approach.append(approach[rows])
        while sum(map(len, self._parts)) >= 2 * LEAST_CONTRIBUTION_MOVES:
            self._thin_out()

    def _thin_out(self) -> None:
        """Keep every second row."""
        self._spacing *= 2
        whole = merged(self._parts)
        self._parts = [whole.take(np.arange(0, len(whole), 2)).with_used_frames]
        if self._approach:
            self._approach = [np.concatenate(self._approach)[::2]]

    def statistics(self) -> dict[str, Statistic]:
        """Contributions, um, by name of the error motion; without those that contribute nothing."""
        if not self._parts:
            return {}
        motions = merged(self._parts)
        machine, (touch_offs, which) = self._machine, touched(motions)
        approach = np.concatenate(self._approach) if self._approach else None
        parts = self._at(self._conditions.state(motions.machine_target, approach), motions.tool)
        if touch_offs:
            q, tool = poses(machine, touch_offs)
            at_datum = self._at(self._conditions.state(q, np.zeros_like(q)), tool)
            parts = parts - np.concatenate([at_datum, np.zeros((1, *parts.shape[1:]))])[which]
        found: dict[str, Statistic] = {}
        for i, name in enumerate(error_names_with_tool(machine)):
            if parts[:, :, i].any():
                found.setdefault(name, Statistic()).add(np.linalg.norm(parts[:, :, i], axis=1) * 1e3)
        return found

    def _at(self, state: State, tool: Array) -> Array:
        """Displacement `(n, 3, error motions)` of the tool point by each error motion, mm, first order."""
        errors = self._model.errors(self._machine, state).reshape(len(state), -1)
        transform = error_transform_with_tool(self._machine, state.positions, tool)
        return np.asarray(transform[:, :3] * errors[:, None])
