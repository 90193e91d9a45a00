"""Identifiability of the errors in the volume from deviations across a path: noise gain and hidden directions.

Noise gain: RMS over the volume of the error of one coordinate of the deviation, after rigid alignment, for noise of
1 um (k = 1) in both directions across the path in each of its cells. The fit estimates all six error motions of every
axis that moves, together with the pose of the instrument.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import msgspec
import numpy as np

from calibration.fit.linear import Posterior, pseudo_inverse
from calibration.measurement.measurement import Target
from calibration.observation.full_model import BasisChoice
from kinematics.effects import COMPONENTS, ErrorMotion
from kinematics.error_model.model import Design, no_errors
from kinematics.error_transform import error_transform_with_tool
from kinematics.forward import tool_point
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array, by_turn

NODE_MM = 50.0
"""Node spacing of the error motions of linear axes, mm; larger on long axes, which have MOST_NODES nodes."""
MOST_NODES, HARMONICS = 13, 2
PRIOR = 200.0
"""Prior standard deviation of the error motions, um and urad, so that unidentifiable directions count."""
SAMPLE_MM = 12.0
"""Largest distance, mm, of the positions on a move that represent its cells."""
GRID, SCATTERED = 9, 600
"""Positions in the volume: grid points per axis for up to three axes; number of random positions for more axes."""
UNIDENTIFIABLE = 1e-9
"""Information in a direction, relative to the best direction, below which it is unidentifiable."""
RELEVANT_UM = 1e-3
"""Deviation in the volume, um, by one prior standard deviation of a hidden direction; below, only the frame moves."""


class NoiseGain(NamedTuple):
    """Identifiability of the errors in the volume from a path."""

    noise: float
    """Noise gain of the identifiable directions, RMS over the volume, um per um."""
    worst: float
    """Noise gain at the worst position, um per um."""
    hidden: int
    """Number of unidentifiable directions that cause deviations in the volume."""
    score: float
    """As `noise`, with hidden directions at the size of their prior; planning minimises it."""


class Volume:
    """The errors of a machine in a part of its travel, as observed on one or several targets along moves."""

    def __init__(
        self, machine: Machine, ends: Array, targets: Mapping[str, Target], cell_mm: float, corner_mm: float
    ) -> None:
        """ends `(2, axes)`, mm and rad; an axis whose two ends are equal does not move."""
        self.machine, self.ends, self.cell_mm, self.corner_mm = machine, ends, cell_mm, corner_mm
        self.tools = [target.position for target in targets.values()]
        self.model = msgspec.structs.replace(no_errors(machine), effects=tuple(_motions(machine, ends)))
        self.size = len(self.model.parameters)
        tips = tool_point(machine, ends, self.tools[0])
        self._centre = tips.mean(axis=0)
        self._size = max(float(np.ptp(tips, axis=0).max()), 1.0)
        self._grid, self._squares = self._volume_deviations()

    def information(self, start: Array, end: Array) -> Array:
        """J' J `(6 + p, 6 + p)` of a straight move between two positions `(axes,)`, mm and rad, with all targets.

        Registration first, then the parameters in units of their prior; noise of 1 um in each cell.
        """
        total = np.zeros((6 + self.size, 6 + self.size))
        for tool in self.tools:
            share = np.linspace(0.0, 1.0, 9)[:, None]
            chords = np.diff(tool_point(self.machine, start + share * (end - start), tool), axis=0)
            length = float(np.linalg.norm(chords, axis=1).sum())
            used = length - 2.0 * self.corner_mm
            if used <= 0.0:
                continue
            n = max(int(np.ceil(used / SAMPLE_MM)), 2)
            at = (self.corner_mm + (np.arange(n) + 0.5) * used / n) / length
            rows = self._across(start + at[:, None] * (end - start), end - start, tool)
            total += rows.T @ rows * (used / self.cell_mm / n)
        return total

    def noise_gain(self, information: Array) -> NoiseGain:
        """Identifiability from moves whose information adds up to `(6 + p, 6 + p)`."""
        reduced = _without_registration(information)
        root, null, _ = pseudo_inverse(reduced, UNIDENTIFIABLE)
        relevant = np.linalg.eigvalsh(null.T @ self._squares @ null)
        covariance = root @ root.T
        # variances of the aligned coordinates, um2
        variances = np.einsum("nip,pq,niq->n", self._grid, covariance, self._grid, optimize=True) / 3.0
        hidden = int(np.count_nonzero(np.sqrt(np.maximum(relevant, 0.0)) > RELEVANT_UM))
        return NoiseGain(
            float(np.sqrt(variances.mean())), float(np.sqrt(variances.max())), hidden, self.score(information)
        )

    def score(self, information: Array) -> float:
        """`NoiseGain.score` alone, at less cost."""
        return float(np.linalg.norm(Posterior(_without_registration(information), 1.0).whitened(self._root)))

    def length(self, start: Array, end: Array) -> float:
        """Distance that the feed refers to, mm; degrees where only rotary axes move."""
        move = (end - start) / self.machine.scale
        linear = float(np.linalg.norm(move[~self.machine.rotary]))
        return linear or float(np.linalg.norm(move))

    def _across(self, positions: Array, direction: Array, tool: tuple[float, float, float]) -> Array:
        """Rows `(3 n, 6 + p)`, um across the path of a target, per motion of the frame and per prior of a parameter."""
        machine, n = self.machine, len(positions)
        points = tool_point(machine, positions, tool)
        step = direction * (1e-4 / max(float(np.abs(direction).max()), 1e-12))
        along = tool_point(machine, positions + step, tool) - tool_point(machine, positions - step, tool)
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-15)
        across = np.eye(3) - along[:, :, None] * along[:, None, :]
        design = Design(self.model, machine, State(positions), with_instrument=False).of(
            slice(None), across @ error_transform_with_tool(machine, positions, tool)[:, :3]
        )
        frame = np.concatenate([across, across @ by_turn((points - self._centre) / self._size)], axis=2)
        return np.concatenate([frame, design * (PRIOR * 1e3)], axis=2).reshape(3 * n, -1)

    def _volume_deviations(self) -> tuple[Array, Array]:
        """Aligned deviations `(n, 3, p)`, um, in the volume per prior of a parameter; their mean products `(p, p)`."""
        machine = self.machine
        positions = _grid_positions(machine, self.ends)
        points = tool_point(machine, positions, self.tools[0])
        transform = error_transform_with_tool(machine, positions, self.tools[0])[:, :3]
        design = self.model.design(machine, State(positions), transform) * (PRIOR * 1e3)
        motions = np.concatenate(
            [np.broadcast_to(np.eye(3), (len(points), 3, 3)), by_turn((points - self._centre) / self._size)], axis=2
        ).reshape(-1, 6)
        columns = design.reshape(-1, self.size)
        columns = columns - motions @ np.linalg.lstsq(motions, columns, rcond=1e-12)[0]
        squares = columns.T @ columns / len(columns)
        values, vectors = np.linalg.eigh(squares)
        self._root = vectors * np.sqrt(np.maximum(values, 0.0))
        return columns.reshape(design.shape), squares


def _without_registration(information: Array) -> Array:
    """The information `(p, p)` on the parameters when the pose of the instrument is unknown."""
    eliminated = information[6:, :6] @ pseudo_inverse(information[:6, :6], 1e-12).root
    return np.asarray(information[6:, 6:] - eliminated @ eliminated.T)


def _motions(machine: Machine, ends: Array) -> list[ErrorMotion]:
    """The error motions of the axes that move."""
    found = []
    for axis, (low, high) in zip(machine.axes, (ends / machine.scale).T.tolist(), strict=True):
        if high > low:
            nodes = min(max(round((high - low) / NODE_MM) + 1, 3), MOST_NODES)
            choice = BasisChoice("fourier", HARMONICS) if axis.rotary else BasisChoice("b-spline", nodes)
            basis = choice.over((low, high))
            found += [ErrorMotion(each, axis.name, basis, (0.0,) * basis.size) for each in COMPONENTS]  # type: ignore[arg-type]
    return found


def _grid_positions(machine: Machine, ends: Array) -> Array:
    """Positions `(n, axes)`, mm and rad, that cover the volume."""
    moving = np.flatnonzero(np.ptp(ends, axis=0) > 0.0)
    if len(moving) > 3:
        share = np.random.default_rng(0).uniform(size=(SCATTERED, len(machine.axes)))
        return np.asarray(ends[0] + share * (ends[1] - ends[0]))
    ticks = [np.linspace(ends[0, i], ends[1, i], GRID) for i in moving]
    positions = np.tile(ends[0], (GRID ** len(moving), 1))
    positions[:, moving] = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, len(moving))
    return positions
