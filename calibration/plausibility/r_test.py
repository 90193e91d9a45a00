"""Mistakes in the readings of an R-test: in another frame, with another sign, or columns exchanged.

The readings of a machine under tool centre point are its errors alone: where their signs or frame are wrong, another
machine is as plausible. Where the commanded positions lie beside the spheres, the readings have to bring the tip there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations

import numpy as np

from calibration.measurement.balls.touch_probe import READINGS
from calibration.measurement.instruments import TouchProbe
from calibration.measurement.measurement import Measurement
from calibration.plausibility.recording_mistakes import TIED, Alternative, misfit, trimmed_rms
from kinematics.forward import forward
from kinematics.transforms import Array, turn

BETTER = 2.0
"""Factor by which the residual must fall with other readings: below that with the readings as they are, and without."""
MEANING = "they are the position of the sphere's centre from the tip, in the directions of the tool"


def wrong_readings(measurement: Measurement) -> tuple[float, list[tuple[float, Alternative]]]:
    """RMS residual, mm, of the readings as they are, and of the other readings that explain the commanded positions."""
    if not isinstance(measurement.instrument, TouchProbe) or not measurement.observed.any():
        return 0.0, []
    before, without = (_size(replace(measurement, observed=k * measurement.observed)) for k in (1.0, 0.0))
    tried = [(_size(other.measurement), other) for other in _other_readings(measurement)]
    best = min(after for after, _ in tried)
    limit = min(TIED * best, min(before, without) / BETTER)
    return before, sorted((pair for pair in tried if pair[0] <= limit), key=lambda pair: pair[0])


def _size(measurement: Measurement) -> float:
    return trimmed_rms(np.linalg.norm(misfit(measurement)[0], axis=1))


def _other_readings(measurement: Measurement) -> Iterator[Alternative]:
    """The measurement with each mistake in the readings reversed in turn."""
    machine, q = measurement.machine, measurement.state.positions
    of_head = np.array([axis.side == "tool" for axis in machine.axes]) & machine.rotary
    tool, bed = (forward(machine, positions).rotation for positions in (q, np.where(of_head, 0.0, q)))
    readings = -turn(tool.swapaxes(1, 2), measurement.observed)

    def read(by: str, frame: Array, own: Array) -> Alternative:
        return Alternative("readings", f"{by} ({MEANING})", replace(measurement, observed=-turn(frame, own)))

    yield read("with the signs of dx, dy and dz reversed", tool, -readings)
    for k, letter in enumerate(READINGS):
        yield read(f"with the sign of {letter} reversed", tool, readings * np.where(np.arange(3) == k, -1.0, 1.0))
    for order in list(permutations(range(3)))[1:]:
        columns = ", ".join(READINGS[k] for k in order)
        yield read(f"with the columns dx, dy, dz in the order {columns}", tool, readings[:, order])
    same = np.broadcast_to(np.eye(3), tool.shape)
    frames = {"the workpiece": same} if not of_head.any() else {"the workpiece": same, "the machine": bed}
    for name, frame in frames.items():
        for words, sign in (("", 1.0), (" and of the opposite sign", -1.0)):
            yield read(f"with dx, dy and dz in the directions of {name}{words}", frame, sign * readings)
