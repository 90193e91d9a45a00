"""Comparison of two calibrations of one machine, error motion by error motion, in the conventions of ISO 230-1.

Every error motion is calculated from all effects that depend on positions alone, as a function of its own
axis with the others at home, without a direction of approach, over the common range of both calibrations:

| | convention |
|---|---|
| positioning and angular error motions of a linear axis | zero at the reference position |
| straightness | deviation from the end-point or least-squares line, whose slope is part of squareness |
| angular positioning of a rotary axis | zero at the reference position |
| radial, axial and tilt error motions of a rotary axis | minus their mean, listed separately as location error |

Both calibrations are first transformed into one frame (`common_frame`). The difference is B minus A. All values are
linear in the errors, so that uncertainties follow from the parameters' covariance to first order (GUM). The two
calibrations are assumed to be independent.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from calibration.evaluation.common_frame import Sampled, common_frame
from calibration.evaluation.comparison.figures import location_figure, reversal_figures, squareness_figures
from calibration.evaluation.comparison.result import Comparison, Motion, Straightness, Volume
from calibration.evaluation.comparison.sides import (
    ZERO_ERROR_UM,
    Curve,
    Side,
    common_range,
    positions_over,
    reason_left_out,
    reference_of,
)
from calibration.evaluation.volumetric import volumetric_error_um
from calibration.single_axis.reference_lines import reference_line
from kinematics.basis import Interval
from kinematics.deviation import exact_deviation
from kinematics.effects import COMPONENTS
from kinematics.effects.base import own_component, unit_of
from kinematics.error_model.covariance import COVERAGE_FACTOR
from kinematics.error_model.model import ErrorModel
from kinematics.error_transform import error_transform_with_tool
from kinematics.forward import tool_point
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array

VOLUME_POSITIONS = 1000
"""Number of positions in the common volume, random with a fixed seed."""
CONFIDENCE = 0.95
"""Probability with which two calibrations that agree show no significant difference of an error motion."""


def compare(
    machine: Machine,
    models: tuple[ErrorModel, ErrorModel],
    straightness: Straightness = "end-point",
    references: Mapping[str, float] | None = None,
    tool_mm: float = 100.0,
) -> Comparison:
    """Comparison of two calibrations of the machine; `references`: positions by axis, mm or degrees, default home."""
    sides = (Side(machine, models[0]), Side(machine, models[1]))
    left_out = [
        f"{effect.name} of {letter}: {reason_left_out(effect)}"
        for letter, model in zip("AB", models, strict=True)
        for effect in model.effects
        if reason_left_out(effect)
    ]
    tracks, outside = _tracks(machine, sides, references or {})
    left_out += outside
    motions, figures = [], []
    for track, pair in zip(tracks, _in_common_frame(machine, sides, tracks), strict=True):
        rule = _rule(machine, track, straightness)
        motions.append(_motion(machine, sides, track, pair, rule))
        if rule.mean:
            figures.append(location_figure(sides, track.name(machine), pair, unit_of(COMPONENTS[track.component])[0]))
    figures = [*squareness_figures(machine, sides, straightness), *figures, *reversal_figures(machine, sides)]
    return Comparison(
        machine,
        {machine.names[track.axis]: track.reference for track in tracks},
        straightness,
        tuple(motions),
        tuple(figures),
        _volume(machine, sides, tool_mm),
        tuple(left_out),
    )


def _tracks(
    machine: Machine, sides: Sequence[Side], references: Mapping[str, float]
) -> tuple[list[Sampled], list[str]]:
    """The error motions of either calibration over their common ranges, and notes on those without a common range."""
    tracks, outside = [], []
    used: dict[str, float] = {}
    for i, axis in enumerate(machine.axes):
        for k in range(6):
            ends = common_range(sides, i, k)
            name = f"E_{COMPONENTS[k]}{axis.name}"
            if ends is None:
                continue
            if ends[0] >= ends[1]:
                outside.append(f"{name}: the two calibrations have no common range")
                continue
            at = used.setdefault(axis.name, reference_of(machine, i, ends, references))
            tracks.append(Sampled(i, k, ends, positions_over(machine, i, ends), at))
    return tracks, outside


def _in_common_frame(machine: Machine, sides: Sequence[Side], tracks: Sequence[Sampled]) -> Iterator[tuple[Curve, ...]]:
    """Each error motion of both calibrations, at its positions and, last, at the reference."""
    if not tracks:
        return
    frame = common_frame(machine, tracks)
    ends = np.cumsum([len(track.everywhere) for track in tracks])[:-1]
    pairs = []
    for side in sides:
        curve = [
            side.curve(track.axis, track.component, track.everywhere * machine.scale[track.axis]) for track in tracks
        ]
        values = np.split(frame.moved(np.concatenate([each.values for each in curve])), ends)
        designs = np.split(frame.moved(np.concatenate([each.design for each in curve])), ends)
        pairs.append(map(Curve, values, designs))
    yield from zip(*pairs, strict=True)


class _Rule(NamedTuple):
    """Linear map of the values of an error motion to its convention."""

    text: str
    matrix: Array
    """Factors `(n, n + 1)` of its values at the positions and, last, at the reference."""
    mean: bool = False
    """True if the mean of the error motion is a location error."""


def _rule(machine: Machine, track: Sampled, straightness: Straightness) -> _Rule:
    axis, k, x, n = machine.axes[track.axis], track.component, track.positions, len(track.positions)
    own = COMPONENTS[k] == own_component(axis.name)
    if axis.rotary and not own:
        return _Rule("less its mean", np.eye(n, n + 1) - np.append(np.full(n, 1.0 / n), 0.0), mean=True)
    if axis.rotary or own or k >= 3:
        return _Rule("zero at the reference", np.eye(n, n + 1) - np.eye(1, n + 1, n))
    line = reference_line(straightness, x, np.zeros(n))
    matrix = np.concatenate([line.residual_of(x), np.zeros((n, 1))], axis=1)
    return _Rule(f"from the {straightness} line", matrix)


def _motion(machine: Machine, sides: Sequence[Side], track: Sampled, pair: Sequence[Curve], rule: _Rule) -> Motion:
    axis, key = machine.axes[track.axis], (track.axis, track.component)
    values = [rule.matrix @ curve.values for curve in pair]
    covariances = [side.covariance(rule.matrix @ curve.design) for side, curve in zip(sides, pair, strict=True)]
    U = [COVERAGE_FACTOR * np.sqrt(np.maximum(np.diag(covariance), 0.0)) for covariance in covariances]
    significant = _significant(values[1] - values[0], covariances[0] + covariances[1])
    known = (key in sides[0].intervals, key in sides[1].intervals)
    unit = unit_of(COMPONENTS[track.component])[0]
    return Motion(
        track.name(machine),
        axis.name,
        axis.unit,
        unit,
        rule.text,
        track.positions,
        values[0],
        values[1],
        U[0],
        U[1],
        known,
        significant,
    )


def _significant(difference: Array, covariance: Array) -> bool:
    """True if a difference `(n,)` exceeds its uncertainty at any position, tested over all positions together.

    The coverage factor is that of Sidak for the number of independent positions that follows from the correlations
    (participation ratio): one position gives k = 1.96, a polynomial of five terms about 2.5.
    """
    u = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    size, known = np.maximum(np.abs(difference) - ZERO_ERROR_UM, 0.0), u > ZERO_ERROR_UM
    if np.any(size[~known] > 0.0) or not known.any():
        return bool(np.any(size > 0.0))
    correlation = covariance[np.ix_(known, known)] / np.outer(u[known], u[known])
    independent = known.sum() ** 2 / np.sum(correlation**2)
    k = ndtri((1.0 + CONFIDENCE ** (1.0 / independent)) / 2.0)
    return bool(np.any(size[known] > k * u[known]))


def _volume(machine: Machine, sides: Sequence[Side], tool_mm: float) -> Volume:
    """The difference of the tool point at random positions of the common volume; other axes at home."""
    bounds: dict[str, Interval] = {}
    low, high = (np.array([axis.home for axis in machine.axes]) for _ in range(2))
    for i, axis in enumerate(machine.axes):
        known = [ends for k in range(6) if (ends := common_range(sides, i, k)) is not None]
        ends = (max((e[0] for e in known), default=axis.home), min((e[1] for e in known), default=axis.home))
        if ends[0] < ends[1]:
            low[i], high[i] = ends
            bounds[axis.name] = ends
    q = np.random.default_rng(0).uniform(low, high, (VOLUME_POSITIONS, len(machine.axes))) * machine.scale
    tool = (0.0, 0.0, -tool_mm)
    state = State(q, approach=np.zeros(q.shape))
    deviations = [exact_deviation(machine, q, side.model.errors(machine, state), tool).position for side in sides]
    difference = deviations[1] - deviations[0]
    transform = error_transform_with_tool(machine, q, tool)[:, :3]
    u = [side.model.standard_uncertainty(machine, state, transform) * 1e3 for side in sides]
    expected = float(np.sqrt(np.mean(np.sum(u[0] ** 2 + u[1] ** 2, axis=1))))
    return Volume(
        bounds,
        tool_mm,
        volumetric_error_um(difference),
        volumetric_error_um(difference, tool_point(machine, q, tool)),
        expected,
    )
