"""Another order of the linear axes: the machine's file may be wrong.

The order of linear axes next to each other changes no nominal point, only the lever arms of their angular errors. A
chain in another order is a structure like others: without any cause it is compared with the structure that was found.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from calibration.diagnosis.search import LEAST_RETRIED_LOG_ODDS
from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.structure import CLEAR_LOG_ODDS, Data, Structure
from calibration.measurement.measurement import Measurement
from kinematics.transforms import Array


def other_order(found: Structure) -> str:
    """What to check where the data fit a chain in another order clearly better than a structure; else empty.

    Only neighbours on one side of the bed that both move are exchanged.
    """
    measurement = found.data.observations.measurement
    if measurement.components < len("XYZ") or measurement.across is not None or found.data.observations.given:
        return ""
    others = [_fitted(other, found) for other in _exchanged(measurement)]
    best = max(others, key=lambda each: each.total, default=found)
    if best.total - found.total < CLEAR_LOG_ODDS:
        return ""
    chain = best.data.observations.measurement.machine.chain
    return (
        f"the data fit the chain {chain} better than {measurement.machine.chain} of the machine's file, with odds of "
        f"1e{(best.total - found.total) / math.log(10.0):.0f} to 1. Check the order of the axes: the file's order is "
        "used, and a cross-axis error may be a consequence of it"
    )


def _fitted(measurement: Measurement, found: Structure) -> Structure:
    """The structure of a measurement without causes; its noise is found again where that may make it likelier."""
    first = Structure.first(Data.of(Observations.of(measurement)))
    sized = replace(first, noise=found.noise, band_sizes=_sizes_of(first, found)).with_sizes()
    return sized.fitted() if sized.total > found.total + LEAST_RETRIED_LOG_ODDS else sized


def _sizes_of(first: Structure, found: Structure) -> Array:
    """Sizes of the bands to begin with: those of another structure without causes; else those before any data."""
    sizes = first.band_sizes.copy()
    if not found.terms:
        known = dict(zip(_columns(found), found.sizes.tolist(), strict=True))
        sizes[first.data.geometry.bands] = [known[column] for column in _columns(first)]
    return sizes


def _columns(structure: Structure) -> list[tuple[str, int]]:
    """Name of the effect of each column of the geometry, and the number of the column in it."""
    return [(effect.name, i) for effect in structure.data.geometry.effects for i in range(len(effect.parameters))]


def _exchanged(measurement: Measurement) -> Iterator[Measurement]:
    """The measurement as one of machines with two linear axes exchanged."""
    machine, moving = measurement.machine, measurement.moving
    for i, (one, other) in enumerate(zip(machine.axes[:-1], machine.axes[1:], strict=True)):
        linear = not (one.rotary or other.rotary) and one.side == other.side
        if linear and one.name in moving and other.name in moving:
            order = np.arange(len(machine.axes))
            order[[i, i + 1]] = i + 1, i
            axes = tuple(machine.axes[k] for k in order.tolist())
            yield _in_order(replace(measurement, machine=replace(machine, axes=axes), actual=None), order)


def _in_order(measurement: Measurement, order: np.ndarray) -> Measurement:
    """The measurement with the columns of its axes in another order."""
    state = measurement.state
    columns: dict[str, Any] = {"positions": state.positions[:, order]}
    for name in ("approach", "last_move", "velocity", "acceleration"):
        column = getattr(state, name)
        columns[name] = None if column is None else column[:, order]
    return replace(measurement, state=replace(state, **columns))
