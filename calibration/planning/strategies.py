"""Strategies: positions to measure (virtual calibration paper 3.1; Montavon et al. 5; ISO 230-2, ISO 230-6).

A strategy gives positions. The measuring sequence - order, approach, runs, targets, references - is independent of it
(`calibration.planning.measuring_sequence`).
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import get_args, get_type_hints

import numpy as np

from calibration.measurement.plan import Choices, MeasuringSequence, Plan
from calibration.planning import patterns
from calibration.planning.measuring_sequence import measuring_plan
from kinematics.files.mistaken import none_of
from kinematics.machine import Machine
from kinematics.transforms import Array
from kinematics.user_error import UserError

STRATEGIES = (*patterns.SPACED, *patterns.SCATTERED, "axes", "rectangles")
DEFAULT_POINTS = 600
"""Number of points above which the improvement is small: virtual calibration paper, 3.2."""
ON_AN_AXIS = 11
"""Default number of positions on an axis that is measured alone; ISO 230-2 requires five per metre."""
LETTERS = {
    "planes": "P", "hexahedron": "H", "diagonals": "D", "face-diagonals": "F", "space-diagonals": "S", "grid": "G",
    "random": "R", "space-filling": "Q",
}  # fmt: skip
"""First letter of the names of points, by strategy."""
PLAN_DECIMALS = 3
"""Decimals of the positions, in mm and degrees."""
SIDES_AND_DIAGONALS = ("AD", "BC", "AB", "DC", "AC", "BD")
"""Lengths of a rectangle whose corner A is at the low ends of both axes, and D at the high end of the first one."""
ROTARY_TRAVERSES = (3, 5, 7, 11, 13, 17)
"""Number of traverses of each rotary axis along the path if all axes move together; primes, so that they differ."""


def plan(
    machine: Machine,
    strategy: str,
    points: int | Sequence[int] | None = None,
    spacing_mm: float | None = None,
    choices: Choices | None = None,
) -> Plan:
    """The plan of a strategy, or of several joined by `+` (`hexahedron+random`), with a number of points each.

    `points` counts positions before order, targets, runs and references multiply them. UserError for invalid arguments.
    """
    choices = choices or Choices()
    _check(machine, choices, points, spacing_mm)
    parts = [part.strip() for part in strategy.split("+")]
    for part in parts:
        if part not in STRATEGIES:
            raise UserError(f"strategy {none_of(part, STRATEGIES)}; several are joined by +")
    if "axes" in parts:
        if len(parts) > 1 or choices.order != "given" or choices.approach != "any":
            raise UserError(
                "strategy axes measures one axis at a time, forward and backward: it excludes other strategies, orders "
                "and approaches"
            )
        laid = _axes(machine, points, spacing_mm, choices)
    elif "rectangles" in parts:
        if len(parts) > 1 or choices.order != "given" or points is not None or spacing_mm is not None:
            raise UserError(
                "strategy rectangles has the two positions of a length in each pair of rows: it excludes other "
                "strategies and orders, and has no number of points"
            )
        laid = _rectangles(machine, choices)
    else:
        laid = _volume(machine, parts, points, spacing_mm, choices)
    requested = None if points is None else int(np.sum(points))
    reference = rounded(fixed_positions(machine, choices), machine, choices)
    return measuring_plan(laid, machine, strategy, choices, requested, reference)


def evaluation_grid(machine: Machine, n: int = 9, ranges: Mapping[str, tuple[float, float]] | None = None) -> Array:
    """Positions `(n ** linear axes, axes)`, mm and rad, over the travel, or stated ranges; rotary axes at home."""
    linear = [i for i, axis in enumerate(machine.axes) if not axis.rotary]
    low, high = limits(machine, Choices(ranges=ranges or {}))
    ticks = [np.linspace(low[i], high[i], n) for i in linear]
    for i in linear:
        need_ends(machine, i, low, high)
    positions = np.tile([axis.home for axis in machine.axes], (n ** len(linear), 1))
    positions[:, linear] = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, len(linear))
    return np.asarray(positions * machine.scale)


# ---- positions


def _volume(
    machine: Machine, parts: list[str], points: int | Sequence[int] | None, spacing: float | None, choices: Choices
) -> MeasuringSequence:
    """Positions of patterns in the volume of the linear axes, with those of the rotary axes during and after these."""
    rng = np.random.default_rng(choices.seed)
    low, high = limits(machine, choices)
    moving, rotary = _moving_axes(machine, parts, choices, low, high)
    box = patterns.Box(low[moving], high[moving], choices.planes_at)
    sequences = []
    for part, number in zip(parts, _shared(points, parts), strict=True):
        together = rotary if choices.rotary == "simultaneous" else []
        if part in patterns.SCATTERED:
            share = patterns.SCATTERED[part](len(moving + together), number or DEFAULT_POINTS, rng)
            share_moving, share_rotary = share[:, : len(moving)], share[:, len(moving) :]
            laid = low[moving] + share_moving * (high - low)[moving]
            names = [f"{LETTERS[part]}{k}" for k in range(1, len(laid) + 1)]
        else:
            if len(moving) < 2:
                raise UserError(f"strategy {part} needs two linear axes that move, {machine.names[moving[0]]} is one")
            chosen = _spaced(part, box, number, spacing)
            laid, share_rotary = chosen.positions, _waves(len(chosen.positions), len(together))
            names = _numbered(LETTERS[part], chosen.line)
        positions = np.tile(fixed_positions(machine, choices), (len(laid), 1))
        positions[:, moving] = laid
        if choices.rotary == "random":
            together, share_rotary = rotary, rng.uniform(size=(len(laid), len(rotary)))
        positions[:, together] = low[together] + share_rotary * (high - low)[together]
        sequences.append(MeasuringSequence(positions, np.array(names)))
    if choices.rotary == "swept":
        sequences += [_sweep(machine, i, low, high, choices) for i in rotary]
    positions = np.concatenate([sequence.positions for sequence in sequences])
    return MeasuringSequence(
        rounded(positions, machine, choices), np.concatenate([sequence.names for sequence in sequences])
    )


def _moving_axes(
    machine: Machine, parts: list[str], choices: Choices, low: Array, high: Array
) -> tuple[list[int], list[int]]:
    """Columns of the axes that the patterns move, and of the rotary axes beside them; UserError without the former."""
    moving = [i for i, axis in enumerate(machine.axes) if not axis.rotary and low[i] < high[i]]
    rotary = [i for i, axis in enumerate(machine.axes) if axis.rotary and low[i] < high[i]]
    if machine.rotary.all():
        moving, rotary = rotary, []
    if not moving or (machine.rotary.all() and not set(parts) <= set(patterns.SCATTERED)):
        raise UserError(
            f"machine {machine.name}: no linear axis is left to move; {', '.join(patterns.SCATTERED)} and axes measure "
            "rotary axes alone"
        )
    for i in (*moving, *(rotary if choices.rotary != "fixed" else ())):
        need_ends(machine, i, low, high)
    return moving, rotary


def _spaced(name: str, box: patterns.Box, points: int | None, spacing: float | None) -> patterns.Points:
    if spacing is not None:
        return patterns.SPACED[name](box, spacing)
    return patterns.spaced(name, box, points or DEFAULT_POINTS)


def _axes(
    machine: Machine, points: int | Sequence[int] | None, spacing: float | None, choices: Choices
) -> MeasuringSequence:
    """Each axis alone, forward and backward, with the others in the middle (linear) or at home (rotary); ISO 230-2."""
    both = replace(choices, approach="positive"), replace(choices, approach="negative")
    (low, _), (_, high) = (limits(machine, each) for each in both)
    moving = [
        i
        for i in range(len(machine.axes))
        if low[i] < high[i] and not (machine.rotary[i] and choices.rotary == "fixed")
    ]
    if not moving:
        raise UserError(f"machine {machine.name}: no axis is left to move")
    linear = sum(not machine.rotary[i] for i in moving)
    sequences = []
    for i in moving:
        need_ends(machine, i, low, high)
        if machine.rotary[i]:
            count = choices.rotary_points
        elif spacing is not None:
            count = max(int(np.ceil((high[i] - low[i]) / spacing - 1e-9)) + 1, 2)
        else:
            count = ON_AN_AXIS if points is None else max(round(int(np.sum(points)) / linear / 2), 2)
        forward = np.linspace(low[i], high[i], count)
        positions = np.tile(fixed_positions(machine, choices), (2 * count, 1))
        positions[:, i] = np.append(forward, forward[::-1])
        side = np.zeros_like(positions)
        side[[0, count], i] = 1.0, -1.0
        number = np.append(np.arange(1, count + 1), np.arange(count, 0, -1))
        names = np.array([f"{machine.names[i]}.{k}" for k in number])
        sequences.append(MeasuringSequence(positions, names, np.full(2 * count, machine.names[i]), side))
    positions, names, axis, side = (np.concatenate(column) for column in zip(*sequences, strict=True))
    return MeasuringSequence(rounded(positions, machine, choices), names, axis, side)


def _rectangles(machine: Machine, choices: Choices) -> MeasuringSequence:
    """The sides and diagonals of a rectangle in each plane of two linear axes: two rows for each length."""
    low, high = limits(machine, choices)
    moving, _ = _moving_axes(machine, ["rectangles"], choices, low, high)
    if len(moving) < 2:
        raise UserError(f"strategy rectangles needs two linear axes that move, {machine.names[moving[0]]} is one")
    positions, names = [], []
    for i, k in itertools.combinations(moving, 2):
        corners = {"A": (low[i], low[k]), "B": (low[i], high[k]), "C": (high[i], high[k]), "D": (high[i], low[k])}
        for letter in "".join(SIDES_AND_DIAGONALS):
            position = fixed_positions(machine, choices)
            position[[i, k]] = corners[letter]
            positions.append(position)
            names.append(f"{machine.names[i]}{machine.names[k]}.{letter}")
    return MeasuringSequence(rounded(np.array(positions), machine, choices), np.array(names))


def _sweep(machine: Machine, i: int, low: Array, high: Array, choices: Choices) -> MeasuringSequence:
    count = choices.rotary_points
    positions = np.tile(fixed_positions(machine, choices), (count, 1))
    positions[:, i] = np.linspace(low[i], high[i], count)
    return MeasuringSequence(positions, np.array([f"{machine.names[i]}.{k}" for k in range(1, count + 1)]))


def limits(machine: Machine, choices: Choices) -> tuple[Array, Array]:
    """Lower and upper ends `(axes,)` in file units, rounded inward (`PLAN_DECIMALS`); infinite without ends."""
    low, high = (machine.travel / machine.scale).copy()
    run_in = choices.overrun * (np.array([choices.approach == "positive", choices.approach == "negative"]))
    for i, axis in enumerate(machine.axes):
        margin = 0.0 if axis.rotary else choices.margin_mm
        first, last = choices.ranges.get(axis.name, (axis.travel[0] + margin, axis.travel[1] - margin))
        if first < axis.travel[0] or last > axis.travel[1]:
            raise UserError(
                f"range {axis.name}={first:g}:{last:g} is not inside its travel {axis.travel[0]:g}..{axis.travel[1]:g}"
                ": choose a range within it"
            )
        if first > last or (first == last and axis.name not in choices.ranges):
            cure = "write the lower end first" if axis.name in choices.ranges else "choose a smaller margin"
            raise UserError(f"axis {axis.name}: nothing is left between {first:g} and {last:g} {axis.unit}: {cure}")
        low[i], high[i] = first, last
        if first < last:
            low[i] = max(first, axis.travel[0] + run_in[0])
            high[i] = min(last, axis.travel[1] - run_in[1])
    size = 10.0**PLAN_DECIMALS
    return np.ceil(low * size - 1e-6) / size + 0.0, np.floor(high * size + 1e-6) / size + 0.0


def need_ends(machine: Machine, i: int, low: Array, high: Array) -> None:
    """UserError for an axis without finite ends."""
    if not (np.isfinite(low[i]) and np.isfinite(high[i])):
        name = machine.names[i]
        raise UserError(f"axis {name} has no end of travel: state its range, for instance --range {name}=0:360")


def fixed_positions(machine: Machine, choices: Choices) -> Array:
    """Positions `(axes,)` of axes that do not move: linear axes in the middle, rotary axes nearest to home."""
    # axes that move elsewhere in the plan need room for their approach here as well
    moved = choices if choices.rotary != "fixed" else replace(choices, approach="any")
    low, high = limits(machine, moved)
    home = np.clip([axis.home for axis in machine.axes], low, high)
    endless = ~np.isfinite(high - low)
    middle = np.where(endless, home, (np.where(endless, 0.0, low) + np.where(endless, 0.0, high)) / 2)
    return np.where(machine.rotary, home, middle)


def rounded(positions: Array, machine: Machine, choices: Choices) -> Array:
    """Positions rounded to `PLAN_DECIMALS`, inside the ends."""
    return np.clip(np.round(positions, PLAN_DECIMALS) + 0.0, *limits(machine, replace(choices, approach="any")))


def _waves(n: int, axes: int) -> Array:
    """Triangular waves `(n, axes)` between 0 and 1, with a different number of traverses for each axis."""
    phase = np.arange(n)[:, None] / max(n - 1, 1) * np.array(ROTARY_TRAVERSES[:axes])
    return np.asarray(1.0 - np.abs(1.0 - phase % 2.0))


def _numbered(letter: str, line: np.ndarray) -> list[str]:
    """Names of points, such as H3.7 for the seventh point on the third line."""
    starts = np.flatnonzero(np.diff(line, prepend=0))
    rank = np.arange(len(line)) - np.repeat(starts, np.diff(np.append(starts, len(line)))) + 1
    return [f"{letter}{a}.{b}" for a, b in zip(line.tolist(), rank.tolist(), strict=True)]


def _shared(points: int | Sequence[int] | None, parts: list[str]) -> Sequence[int | None]:
    """The number of points for each part of a strategy."""
    if points is None:
        return [None] * len(parts)
    counts = (
        [points // len(parts) + (k < points % len(parts)) for k in range(len(parts))]
        if isinstance(points, int)
        else list(points)
    )
    if len(counts) != len(parts) or min(counts) < 1:
        raise UserError(f"{'+'.join(map(str, counts))} points for {len(parts)} strategies: at least one point for each")
    return counts


# ---- checks of the arguments


def _check(machine: Machine, choices: Choices, points: int | Sequence[int] | None, spacing: float | None) -> None:
    for name in choices.ranges:
        machine.index(name)
    if points is not None and spacing is not None:
        raise UserError("either a number of points or a spacing, not both: give one of them")
    if points is not None and not np.size(points):
        raise UserError("points: the list is empty: give the number of positions of each strategy")
    if points is not None and not 1 <= np.min(points) <= np.max(points) <= patterns.MOST_PLANNED_POINTS:
        raise UserError(f"{points} points: expected a number from 1 to {patterns.MOST_PLANNED_POINTS}")
    if spacing is not None and not (spacing > 0 and np.isfinite(spacing)):
        raise UserError(f"a spacing of {spacing:g} mm: it must be positive")
    bounds = {
        "margin": (choices.margin_mm, 0.0, np.inf),
        "overrun": (choices.overrun, 0.0, np.inf),
        "references": (choices.references, 0, np.inf),
        "runs": (choices.runs, 1, np.inf),
        "rotary points": (choices.rotary_points, 2, np.inf),
        "position of the planes": (choices.planes_at, 0.0, 1.0),
    }
    for option, (value, least, most) in bounds.items():
        if not (least <= value <= most and np.isfinite(value)):
            raise UserError(
                f"{option}: {value:g} is not {f'between {least:g} and {most:g}' if most == 1 else f'{least} or more'}"
            )
    hints = get_type_hints(Choices)
    for name in ("rotary", "order", "target_order", "approach"):
        known, value = get_args(hints[name]), getattr(choices, name)
        if value not in known:
            raise UserError(f"{name.replace('_', ' ')} {value!r}: expected one of {', '.join(known)}")
    if not choices.targets:
        raise UserError("no target to measure with: give one by --target NAME=x,y,z")
