"""The parameters of a machine that a log of touches can show to drift: zeros, growth, squareness, lines of rotary axes.

Each place of the log, a feature at one position of the rotary axes, has a zero of its own, so that no error that stays
shows. A new run has new zeros: something was knocked, or the sphere was clamped again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from calibration.registration.observed_points import derivatives_by_errors
from kinematics.effects import DriftWithSensor, Effect, GrowthWithSensor, LocationJump, Scale, ToolShift
from kinematics.effects.base import UM, own_component
from kinematics.effects.combined.thermal import DistortionWithSensor
from kinematics.machine import Machine
from kinematics.transforms import Array

if TYPE_CHECKING:
    from calibration.measurement.measurement import Measurement

PLACE_DECIMALS = 2
"""Decimals of a rotary position, degrees, that belong to one place."""


@dataclass(frozen=True)
class Touches:
    """The readings of a log, in um."""

    measurement: Measurement
    values: Array
    """Deviations `(n, 3)` of the tool relative to the workpiece, from the median of their place."""
    covariances: Array
    """`(n, 3, 3)`, of the probing alone; unlimited in directions that the feature does not show."""
    places: np.ndarray
    """Number of the place `(n,)`."""
    effects: tuple[Effect, ...]
    """The parameters that may drift, each with the size 0."""
    typical: Array
    """Typical sizes of the parameters by 1 K `(p,)`, of the effects that follow a temperature at the same places."""
    jacobian: Array
    """Derivatives of the deviations `(n, 3, p)` by the parameters."""
    before: int = 0
    """Number of the first rows that are of earlier logs."""

    def __len__(self) -> int:
        return len(self.values)

    def rows(self, kept: np.ndarray) -> Touches:
        """Some of the readings."""
        return replace(
            self,
            measurement=self.measurement.rows(kept),
            values=self.values[kept],
            covariances=self.covariances[kept],
            places=self.places[kept],
            jacobian=self.jacobian[kept],
        )


def touches_of(measurement: Measurement, before: int = 0) -> Touches:
    """The readings of a measurement, and the parameters that they can show; before: rows of earlier logs."""
    places = _places(measurement)
    values = (measurement.observed - measurement.nominal_points) / UM
    for place in range(places.max() + 1):
        values[places == place] -= np.median(values[places == place], axis=0)
    covariances = measurement.instrument.row_covariances(measurement) / UM**2
    effects, typical = zip(*_candidates(measurement.machine), strict=True)
    model = msgspec.structs.replace(measurement.nominal_model, effects=effects)
    transform = derivatives_by_errors(measurement, measurement.tool)
    jacobian = model.design(measurement.machine, measurement.state, transform) / UM
    first = np.unique(places, return_index=True)[1]
    shown = _shown(effects, int((~measurement.machine.rotary).sum()), jacobian[first], covariances[first])
    kept = tuple(effects[k] for k in shown)
    return Touches(
        measurement, values, covariances, places, kept, np.array(typical)[shown], jacobian[:, :, shown], before
    )


def _places(measurement: Measurement) -> np.ndarray:
    rotary = measurement.machine.rotary
    angles = np.round(np.degrees(measurement.state.positions[:, rotary]), PLACE_DECIMALS) % 360.0
    runs = [""] * len(measurement) if measurement.run is None else measurement.run.tolist()
    each = zip(runs, measurement.groups.tolist(), angles.tolist(), strict=True)
    keys = [(run, name, *own) for run, name, own in each]
    number = {key: k for k, key in enumerate(dict.fromkeys(keys))}
    return np.array([number[key] for key in keys])


def _candidates(machine: Machine) -> Iterator[tuple[Effect, float]]:
    """All parameters with their typical sizes by 1 K.

    Of some that a log shows together only, the first ones, which heat moves most, are followed.
    """
    linear = [axis.name for axis in machine.axes if not axis.rotary]
    rotary = [axis.name for axis in machine.axes if axis.rotary]
    for axis in linear:
        drift: float = DriftWithSensor.QUANTITIES[0].typical
        yield LocationJump(own_component(axis), axis, 0.0, since_touch_off=True), drift
    for component in "ZXY":
        yield ToolShift(component, 0.0, since_touch_off=True), drift  # type: ignore[arg-type]
    yield from _lines(rotary, "XYZ")
    for axis in linear:
        yield Scale(axis, 0.0, since_touch_off=True), GrowthWithSensor.QUANTITIES[0].typical
    yield from _lines(linear, "ABC")
    yield from _lines(rotary, "ABC")


def _lines(axes: Sequence[str], components: str) -> Iterator[tuple[Effect, float]]:
    """Shifts or tilts of the lines of axes; not their turn about themselves."""
    for axis in axes:
        about = "ABC"["XYZ".index(own_component(axis))] if own_component(axis) in "XYZ" else own_component(axis)
        for component in components:
            if component != about:
                line = LocationJump(component, axis, 0.0, since_touch_off=True)  # type: ignore[arg-type]
                yield line, DistortionWithSensor.QUANTITIES[0].typical


def _shown(effects: Sequence[Effect], count: int, jacobian: Array, covariances: Array) -> list[int]:
    """The parameters whose typical size the places show beyond the zeros, by more than one reading scatters.

    count: of the zeros, which are the first effects. Those that the places show as one earlier parameter, apart from
    zeros, are left out. Those that they show as a sum of several others are followed with them: evidence decides, and
    the uncertainty elsewhere contains them.
    """
    white = np.linalg.cholesky(np.linalg.inv(covariances)).swapaxes(1, 2) @ jacobian
    columns = white.reshape(-1, len(effects))
    kept: list[int] = []
    zeros, others = np.zeros((len(columns), 0)), np.zeros((len(columns), 0))
    for k, effect in enumerate(effects):
        rest = columns[:, k] - zeros @ (zeros.T @ columns[:, k])
        rest -= zeros @ (zeros.T @ rest)
        forms = np.column_stack([rest, rest[:, None] - others * (others.T @ rest)])
        if np.linalg.norm(forms, axis=0).min() * effect.quantities()[0].typical > 1.0:
            kept.append(k)
            unit = rest / np.linalg.norm(rest)
            if k < count:
                zeros = np.column_stack([zeros, unit])
            else:
                others = np.column_stack([others, unit])
    return kept
