"""Identifiability of the errors in the volume from deviations across a path: noise gain and hidden directions.

Noise gain: RMS over the volume of the error of one coordinate of the deviation, after rigid alignment, for noise of
1 um (k = 1) in both directions across the path in each of its cells. The fit estimates all six error motions of every
axis that moves, together with the pose of the instrument.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import msgspec
import numpy as np

from calibration.fit.linear import Posterior, pseudo_inverse
from calibration.measurement.measurement import Target
from calibration.observation.full_model import BasisChoice
from kinematics.columns import cross, rows_of, vector
from kinematics.effects import COMPONENTS, ErrorMotion
from kinematics.effects.base import unit_of
from kinematics.error_model.model import no_errors
from kinematics.error_transform import error_transform_with_tool
from kinematics.forward import tool_point
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array, by_turn, read_only
from kinematics.turn import columns_of

NODE_MM = 50.0
"""Node spacing of the error motions of linear axes, mm; larger on long axes, which have `GAIN_NODES` nodes."""
GAIN_NODES, GAIN_HARMONICS = 13, 2
PRIOR = 200.0
"""Prior standard deviation of the error motions, um and urad, so that unidentifiable directions count."""
LARGEST_CELL_MM = 12.0
"""Largest distance, mm, of the positions on a move that represent its cells."""
GAIN_GRID_POSITIONS, GAIN_RANDOM_POSITIONS = 9, 600
"""Positions in the volume: grid points per axis for up to three axes; number of random positions for more axes."""
UNIDENTIFIABLE_INFORMATION = 1e-9
"""Information in a direction, relative to the best direction, below which it is unidentifiable."""
ROUNDING_OF_SQUARE = 1e-15
"""Mean square of a deviation, relative to the largest, that is rounding error."""
RELEVANT_UM = 1e-3
"""Deviation in the volume, um, by one prior standard deviation of a hidden direction; below, only the frame moves."""


_UNITS = read_only(np.array([unit_of(component)[1] for component in COMPONENTS])[:, None])
"""Unit of each error motion `(6, 1)`, mm or rad."""


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
        motions = _motions(machine, ends)
        self.model = msgspec.structs.replace(no_errors(machine), effects=tuple(motions))
        self.size = len(self.model.parameters)
        self._bases = {machine.index(each.axis): each.basis for each in motions}
        """Basis of the six error motions of each axis that moves, by its column."""
        tips = tool_point(machine, ends, self.tools[0])
        self._centre = tips.mean(axis=0)
        self._size = max(float(np.ptp(tips, axis=0).max()), 1.0)
        self._grid, self._squares = self._volume_deviations()

    def information(self, start: Array, end: Array) -> Array:
        """J' J `(6 + p, 6 + p)` of a straight move between two positions `(axes,)`, mm and rad, with all targets.

        Registration first, then the parameters in units of their prior; noise of 1 um in each cell.
        """
        (found,) = self.informations([(start, end)])
        return found

    def informations(self, moves: Sequence[tuple[Array, Array]]) -> list[Array]:
        """The information of several moves, each by its start and end."""
        totals = [np.zeros((6 + self.size, 6 + self.size)) for _ in moves]
        starts, ends = (np.array(each) for each in zip(*moves, strict=True))
        ways = ends - starts
        shares = np.linspace(0.0, 1.0, 9)[:, None]
        for tool in self.tools:
            along = (starts[:, None] + shares * ways[:, None]).reshape(-1, ways.shape[1])
            chords = np.diff(tool_point(self.machine, along, tool).reshape(len(moves), 9, 3), axis=1)
            lengths = np.linalg.norm(chords, axis=2).sum(axis=1)
            used = lengths - 2.0 * self.corner_mm
            counts = np.where(used > 0.0, np.maximum(np.ceil(used / LARGEST_CELL_MM), 2), 0).astype(int)
            move, lasts = np.repeat(np.arange(len(moves)), counts), np.cumsum(counts)
            number = np.arange(len(move)) - (lasts - counts)[move]
            at = (self.corner_mm + (number + 0.5) * used[move] / counts[move]) / lengths[move]
            rows = self._across(starts[move] + at[:, None] * ways[move], ways[move], tool)
            for i in np.flatnonzero(counts).tolist():
                own = rows[2 * (lasts[i] - counts[i]) : 2 * lasts[i]]
                totals[i] += own.T @ own * (used[i] / self.cell_mm / counts[i])
        return totals

    def noise_gain(self, information: Array) -> NoiseGain:
        """Identifiability from moves whose information adds up to `(6 + p, 6 + p)`."""
        reduced = _without_registration(information)
        root, null, _ = pseudo_inverse(reduced, UNIDENTIFIABLE_INFORMATION)
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

    def _across(self, positions: Array, ways: Array, tool: tuple[float, float, float]) -> Array:
        """Rows `(2 n, 6 + p)`, um across the path of a target, per motion of the frame and per prior of a parameter.

        shifts `(n, axes)`: in the directions of the moves, mm and rad.
        """
        machine, n = self.machine, len(positions)
        step = ways * (1e-4 / np.maximum(np.abs(ways).max(axis=1, keepdims=True), 1e-12))
        tips = tool_point(machine, np.concatenate([positions, positions + step, positions - step]), tool)
        points, ahead, behind = tips.reshape(3, n, 3)
        across = _perpendicular(ahead - behind)
        arms = across @ error_transform_with_tool(machine, positions, tool)[:, :3]
        rows = np.empty((n, 2, 6 + self.size))
        rows[:, :, :3], rows[:, :, 3:6] = across, across @ by_turn((points - self._centre) / self._size)
        first = 6
        for column, basis in self._bases.items():
            axis = machine.axes[column]
            values = columns_of(axis, basis, positions[:, column] / machine.scale[column])
            own = arms[:, :, 6 * column : 6 * column + 6, None] * (_UNITS * (PRIOR * 1e3))
            last = first + 6 * basis.size
            np.multiply(own, values[:, None, None], out=rows[:, :, first:last].reshape(n, 2, 6, basis.size))
            first = last
        return rows.reshape(2 * n, 6 + self.size)

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
        present = values > values[-1] * ROUNDING_OF_SQUARE
        self._root = vectors[:, present] * np.sqrt(values[present])
        return columns.reshape(design.shape), squares


def _perpendicular(along: Array) -> Array:
    """Two unit vectors `(n, 2, 3)` across each of n vectors `(n, 3)`; 0 where the vector is 0."""
    way = vector(along)
    first = cross(way, vector(np.eye(3)[np.abs(along).argmin(axis=1)]))
    both = np.stack([rows_of(each, len(along)) for each in (first, cross(way, first))], axis=1)
    return np.asarray(both / np.maximum(np.linalg.norm(both, axis=2, keepdims=True), 1e-300))


def _without_registration(information: Array) -> Array:
    """The information `(p, p)` on the parameters when the pose of the instrument is unknown."""
    eliminated = information[6:, :6] @ pseudo_inverse(information[:6, :6], 1e-12).root
    return np.asarray(information[6:, 6:] - eliminated @ eliminated.T)


def _motions(machine: Machine, ends: Array) -> list[ErrorMotion]:
    """The six error motions of each axis that moves, in the order of the axes, with one basis for an axis."""
    found = []
    for axis, (low, high) in zip(machine.axes, (ends / machine.scale).T.tolist(), strict=True):
        if high > low:
            nodes = min(max(round((high - low) / NODE_MM) + 1, 3), GAIN_NODES)
            choice = BasisChoice("fourier", GAIN_HARMONICS) if axis.rotary else BasisChoice("b-spline", nodes)
            basis = choice.over((low, high))
            found += [ErrorMotion(each, axis.name, basis, (0.0,) * basis.size) for each in COMPONENTS]  # type: ignore[arg-type]
    return found


def _grid_positions(machine: Machine, ends: Array) -> Array:
    """Positions `(n, axes)`, mm and rad, that cover the volume."""
    moving = np.flatnonzero(np.ptp(ends, axis=0) > 0.0)
    if len(moving) > 3:
        share = np.random.default_rng(0).uniform(size=(GAIN_RANDOM_POSITIONS, len(machine.axes)))
        return np.asarray(ends[0] + share * (ends[1] - ends[0]))
    ticks = [np.linspace(ends[0, i], ends[1, i], GAIN_GRID_POSITIONS) for i in moving]
    positions = np.tile(ends[0], (GAIN_GRID_POSITIONS ** len(moving), 1))
    positions[:, moving] = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, len(moving))
    return positions
