"""Rotary positions of a measurement on spheres: published designs, and candidates for an optimised one."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np

from calibration.planning.strategies import PLAN_DECIMALS
from kinematics.machine import TURN_DEG, Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError

DESIGNS = ("optimised", "grid", "bk", "samba", "random")
"""Designs: optimised; a grid of angles; each rotary axis alone (BK of ISO 10791-6); a grid with several spheres."""


def rotary_ranges(machine: Machine, stated: Mapping[str, tuple[float, float]]) -> dict[int, tuple[float, float]]:
    """Range of each rotary axis that moves, degrees, by its number: stated, or its travel, of which one turn at most.

    UserError for a range outside the travel, for ranges of linear axes, and where no rotary axis moves.
    """
    found = {}
    for name in stated:
        if not machine.axes[machine.index(name)].rotary:
            raise UserError(f"--range {name}: the linear axes follow from the spheres; state ranges of rotary axes")
    for i, axis in enumerate(machine.axes):
        if not axis.rotary:
            continue
        low, high = stated.get(axis.name, axis.travel)
        if low < axis.travel[0] or high > axis.travel[1] or low > high:
            raise UserError(f"--range {axis.name}={low:g}:{high:g} is not inside its travel")
        if high - low > TURN_DEG:
            low = max(low, 0.0) if high >= TURN_DEG else high - TURN_DEG
            high = low + TURN_DEG
        found[i] = (low, high)
    if not any(high > low for low, high in found.values()):
        raise UserError(f"machine {machine.name}: no rotary axis moves, and spheres show errors of rotary axes")
    return found


def laid(machine: Machine, ranges: Mapping[int, tuple[float, float]], angles: Array) -> Array:
    """Positions `(n, axes)`, mm and rad, with angles `(n, rotary axes)`, degrees, and the linear axes at home."""
    positions = np.tile([axis.home for axis in machine.axes], (len(angles), 1))
    positions[:, list(ranges)] = np.round(angles, PLAN_DECIMALS) + 0.0
    return positions * machine.scale


def candidates(ranges: Mapping[int, tuple[float, float]], number: int, seed: int) -> Array:
    """Angles `(number, rotary axes)`, degrees: a grid over the ranges with their ends, and evenly spread ones."""
    from scipy.stats import qmc

    low, high = (np.array(ends) for ends in zip(*ranges.values(), strict=True))
    corners = grid(ranges, number // 4)
    spread = qmc.Halton(len(low), seed=seed).random(number)
    return np.concatenate([corners, low + spread * (high - low)])


def grid(ranges: Mapping[int, tuple[float, float]], number: int) -> Array:
    """Angles `(number or so, rotary axes)`, degrees: every combination, with counts in proportion to the ranges."""
    spans = np.array([high - low for low, high in ranges.values()])
    counts, left, free = np.ones(len(spans)), float(number), spans > 0.0
    while free.any():
        each = spans * (left / np.prod(spans[free])) ** (1.0 / free.sum())
        # two angles for the ends of a small range, and the others share the remaining ones
        small = free & (each < 2.0)
        now = small if small.any() else free
        counts[now] = np.maximum(np.round(each[now]), 2.0)
        left /= float(np.prod(counts[now]))
        free &= ~now
    angles = [_spread(ends, int(n)) for ends, n in zip(ranges.values(), counts.tolist(), strict=True)]
    return np.array(list(itertools.product(*angles)))


def circles(machine: Machine, ranges: Mapping[int, tuple[float, float]], number: int) -> Array:
    """Angles, degrees, of each rotary axis alone, there and back, with the others at home: BK of ISO 10791-6."""
    moving = [k for k, (low, high) in enumerate(ranges.values()) if high > low]
    home = np.array([np.clip(machine.axes[i].home, *ends) for i, ends in ranges.items()])
    each = max(number // len(moving) // 2, 3)
    found = []
    for k in moving:
        ticks = np.linspace(*list(ranges.values())[k], each)
        angles = np.tile(home, (2 * each, 1))
        angles[:, k] = np.append(ticks, ticks[::-1])
        found.append(angles)
    return np.concatenate(found)


def _spread(ends: tuple[float, float], number: int) -> list[float]:
    """Angles over a range with its ends; over a whole turn without the end, which is the start again."""
    low, high = ends
    return np.linspace(low, high, number, endpoint=high - low < TURN_DEG).tolist() if number > 1 else [low]
