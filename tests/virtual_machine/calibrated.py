"""The error motions that a calibration file describes, worked out from its text (docs/effects.md) a second time.

Only the effects of the machine's geometry, error motions in every basis and location errors; and backlash.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial import legendre

from virtual_machine.chain import Array, Axis, Chain
from virtual_machine.truth import MICRO


@dataclass(frozen=True)
class Calibrated:
    """A machine with the errors of a calibration file."""

    effects: tuple[Mapping[str, Any], ...]

    def errors(self, chain: Chain, positions: Array, ways: Array | None = None) -> Array:
        """`(n, axes, 6)`, mm and rad, at positions `(n, axes)`, mm and degrees, by directions `(n, axes)`, 1 or -1."""
        result = np.zeros((*positions.shape, 6))
        for effect in self.effects:
            i = chain.index(effect["axis"])
            axis, x = chain.axes[i], positions[:, i]
            if effect["kind"] == "backlash" and ways is not None:
                forward = np.sign(axis.frame[:, axis.own % 3] @ axis.direction)
                result[:, i, axis.own] -= 0.5 * forward * effect["width"] * MICRO[axis.own] * ways[:, i]
                continue
            k = "XYZABC".index(effect["component"])
            if effect["kind"] == "error-motion":
                result[:, i, k] += MICRO[k] * motion(axis, effect["basis"], effect["parameters"], x)
            elif effect["kind"] == "location" and (axis.rotary or k < 3):
                result[:, i, k] += MICRO[k] * effect["value"]
            elif effect["kind"] == "location":
                result[:, i, :3] += MICRO[k] * effect["value"] * np.outer(x, _sideways(axis, k - 3))
            else:
                raise ValueError(f"{effect['kind']}: not an effect of the geometry")
        return result


def read_calibration(file: Path) -> Calibrated:
    """The effects of a calibration file."""
    return Calibrated(tuple(json.loads(file.read_text(encoding="utf-8"))["effects"]))


def _sideways(axis: Axis, about: int) -> Array:
    """Direction of the displacement of the carriage of a linear axis for each rad and mm, in the frame of its errors."""
    return np.asarray(axis.frame.T @ np.cross(axis.frame[:, about], axis.direction))


def motion(axis: Axis, basis: Mapping[str, Any], parameters: Sequence[float], x: Array) -> Array:
    """An error motion of an axis; of one that can turn once round it repeats with the turn, the mean of several."""
    if not axis.rotary or axis.travel[1] - axis.travel[0] < 360.0:
        return _curve(basis, parameters, x)
    if basis["kind"] == "harmonics":
        q, (constant, *waves) = np.radians(x), parameters
        pairs = zip(waves[::2], waves[1::2], strict=True)
        terms = [a * np.sin(n * q) + b * np.cos(n * q) for n, (a, b) in enumerate(pairs, 1)]
        return np.asarray(constant + sum(terms, np.zeros_like(q)))
    low, high = (basis["nodes"][0], basis["nodes"][-1]) if basis["kind"] == "b-spline" else basis["interval"]
    here = low + (x - low) % 360.0
    if high - low < 359.0:  # linear across the arc that was not measured
        ends = _curve(basis, parameters, np.array([high, low]))
        return np.where(here <= high, _curve(basis, parameters, here), np.interp(here, [high, low + 360.0], ends))
    if basis["kind"] == "b-spline":
        seam = (parameters[0] + parameters[-1]) / 2.0
        return _curve(basis, [seam, *parameters[1:-1], seam], here)
    starts = np.arange(low, high - 1.0, 360.0)
    start, end = _curve(basis, parameters, np.array([low, high]))
    turns = [_curve(basis, parameters, here + first - low) for first in starts.tolist()]
    return np.asarray(np.mean(turns, axis=0) - (end - start) / len(starts) * (here - low) / 360.0)


def _curve(basis: Mapping[str, Any], parameters: Sequence[float], x: Array) -> Array:
    """A function of an axis position, in its own unit; beyond its interval it keeps the value at the end."""
    if basis["kind"] == "b-spline":
        return _spline(basis["nodes"], basis["degree"], parameters, x)
    low, high = basis["interval"]
    u = (np.clip(x, low, high) - low) / (high - low)
    if basis["kind"] == "polynomial":
        return np.asarray(np.polynomial.polynomial.polyval(u, parameters))
    if basis["kind"] == "legendre":
        return np.asarray(legendre.legval(2.0 * u - 1.0, parameters))
    constant, slope, *waves = parameters
    total = constant + slope * u
    for n, sine, cosine in zip(basis["harmonics"], waves[::2], waves[1::2], strict=True):
        total = total + sine * np.sin(n * np.pi * u) + cosine * np.cos(n * np.pi * u)
    return np.asarray(total)


def _spline(nodes: Sequence[float], degree: int, parameters: Sequence[float], x: Array) -> Array:
    """By de Boor's algorithm."""
    knots = np.array([nodes[0]] * degree + list(nodes) + [nodes[-1]] * degree)
    place, values = np.clip(x, nodes[0], nodes[-1]), np.array(parameters)
    k = np.minimum(np.searchsorted(knots, place, side="right") - 1, len(knots) - degree - 2)
    d = [values[j + k - degree] for j in range(degree + 1)]
    for r in range(1, degree + 1):
        for j in range(degree, r - 1, -1):
            left, right = knots[j + k - degree], knots[j + 1 + k - r]
            share = (place - left) / (right - left)
            d[j] = (1.0 - share) * d[j - 1] + share * d[j]
    return d[degree]
