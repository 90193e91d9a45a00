"""Data of a simulation, at positions or on the fly: machine, instrument, faults and output files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Literal, NamedTuple

if TYPE_CHECKING:
    import numpy as np

    from calibration.measurement.instruments import Instrument
    from calibration.simulation.simulate import Faults
    from kinematics.effects import Effect
    from kinematics.error_model.model import ErrorModel


class Simulation(NamedTuple):
    """A virtual machine and a virtual instrument."""

    model: ErrorModel
    told: Sequence[Effect]
    """Effects from the options, which are part of the model and may name a target or a station."""
    instrument: Instrument
    stands_on: Literal["workpiece", "bed"]
    noise_scale: float
    faults: Faults
    temperatures: Mapping[str, tuple[float, float]]
    """Start and end, K from 20 degC."""
    seed: int
    draws: Sequence[np.random.Generator]
    """Random numbers of the true model, the poses, the noise and the faults: one stream each, so that a different
    instrument measures the same machine."""
    outputs: tuple[str, str | None]
    """Files of the measurement and of the true model."""
