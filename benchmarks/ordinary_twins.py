"""Calibrations from the measurements of `ordinary_runs`, compared with those from the same data with nothing hidden.

    python benchmarks/ordinary_twins.py ../shared/data/ordinary_runs           # all of them
    python benchmarks/ordinary_twins.py ../shared/data/ordinary_runs gantry    # those whose name contains a text

The twin of a set is its readings less the hidden effect, to first order, with the size that its truth states. Both are
diagnosed. At 400 random poses the calibration of the set, less the effect as far as it is one of the machine, is
compared with that of the twin, a rigid motion apart. The error of the twin's calibration is not known; its standard
uncertainty there stands for it. Printed are, in um RMS: the difference, this uncertainty, and by how much the first
enlarges the second, if they are independent and if they add up.

A truth without sizes (knock, angles of the tracker, outliers) makes no twin. An error that is in no library changes
with time, and no calibration holds it: there the calibrations are compared as they are.
"""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from shop_floor.chain import without_rigid_motion

import ncomp
from calibration.fit.prediction import Prediction
from calibration.measurement.measurement import Measurement
from kinematics.effects import COMPONENTS
from kinematics.error_model.model import ErrorModel
from kinematics.error_transform import error_transform_with_tool
from kinematics.forward import forward
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array

POSES, DRAWS, MM = 400, 200, 1e3


def hidden(truth: dict[str, Any], machine: Machine, state: State, ranges: Array) -> Array:
    """Errors `(n, axes + 1, 6)`, mm and rad, of the hidden effects at some states; of the axes, then of the tool.

    ranges: least and largest positions `(2, axes)` of the measurement.
    """
    errors = np.zeros((len(state), len(machine.axes) + 1, 6))
    share = (state.positions - ranges[0]) / np.where(np.ptp(ranges, axis=0) > 0.0, np.ptp(ranges, axis=0), 1.0)
    for kind, values in zip(truth["kinds"], truth["params"], strict=True):
        if kind == "thermal-drift":
            course = 1.0 - np.exp(-state.need("time", kind) / values["tau"])
            # its vector is one of the workpiece frame
            into_tool = np.swapaxes(forward(machine, state.positions).rotation, 1, 2)
            errors[:, -1, :3] += course[:, None] * (into_tool @ values["vec"])
        elif kind == "unlisted":
            u, w, t = share[:, machine.index("X")], share[:, machine.index("Z")], state.need("time", kind)
            swing = np.cos(2.0 * np.pi * t / values["period"])
            errors[:, -1, 1] += values["amp"] * np.tanh(6.0 * (u - 0.5)) * np.exp(-2.0 * w) * swing
        else:
            axis = machine.index(values["ax"])
            own = COMPONENTS.index(values.get("comp", "E" + values["ax"])[1])
            errors[:, axis, own] += _of_axis(kind, values, state, share, machine)
    return errors


def _of_axis(kind: str, values: dict[str, Any], state: State, share: Array, machine: Machine) -> Array:
    """Error `(n,)` of an axis, mm; share: its place `(n, axes)` in the range of each axis."""
    axis = machine.index(values["ax"])
    if kind == "backlash":
        return np.asarray(-0.5 * values["b"] * state.need("approach", kind)[:, axis])
    if kind == "thermal-scale":
        return np.asarray(values["alpha"] * state.temperature("scale", kind) * state.positions[:, axis])
    u, v = share[:, axis], share[:, machine.index(values["by"])]
    course = 4.0 * u * (1.0 - u) if values["shape"] == "sag" else 2.0 * u - 1.0
    return np.asarray(values["amp"] * course * (2.0 * v - 1.0))


def unseen(measurement: Measurement, ranges: Array) -> State:
    """Random states in the ranges of a measurement, each at a moment of it."""
    rng, state = np.random.default_rng(1), measurement.state
    moment = rng.integers(len(state), size=POSES)
    return State(
        rng.uniform(ranges[0], ranges[1], (POSES, ranges.shape[1])),
        approach=rng.choice([-1.0, 1.0], (POSES, ranges.shape[1])),
        time=None if state.time is None else state.time[moment],
        temperatures={name: kelvin[moment] for name, kelvin in state.temperatures.items()},
    )


def compared(truth: dict[str, Any], measurement: Measurement) -> tuple[float, float, bool]:
    """Difference from the twin's calibration, its standard uncertainty, um RMS, and whether nothing was found in it."""
    machine, ranges = measurement.machine, np.stack([f(measurement.state.positions, axis=0) for f in (np.min, np.max)])
    found = ncomp.diagnose(measurement)
    registration = found.after.fit.registration
    transform = measurement.instrument.transform(measurement, registration)[:, :, :-3]
    errors = hidden(truth, machine, measurement.state, ranges).reshape(len(measurement), -1, 1)
    less = replace(measurement, observed=measurement.observed - (transform @ errors)[:, :, 0])
    twin = ncomp.diagnose(less)
    states, tool = unseen(measurement, ranges), np.zeros((POSES, 3)) + measurement.tool[0]
    points = forward(machine, states.positions).apply(tool)
    tips_by_errors = error_transform_with_tool(machine, states.positions, tool)[:, :3]
    own = np.zeros((POSES, 3))
    if "unlisted" not in truth["kinds"]:
        own = (tips_by_errors @ hidden(truth, machine, states, ranges).reshape(POSES, -1, 1))[:, :, 0] * MM
    with_effect, without = (Prediction(machine, each.model, states, tool).deviation_um for each in (found, twin))
    difference = without_rigid_motion(points, with_effect - own - without)
    u = _uncertainty(twin.model, machine, states, tips_by_errors, points)
    return _rms(difference), u, not twin.causes and twin.unexplained is None


def _uncertainty(model: ErrorModel, machine: Machine, states: State, transform: Array, points: Array) -> float:
    """RMS length, um, of the deviations that the covariance of a model draws, a rigid motion apart."""
    values, vectors = np.linalg.eigh(np.array(model.covariance))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    drawn = root @ np.random.default_rng(2).normal(size=(len(root), DRAWS))
    deviations = np.moveaxis(model.design(machine, states, transform) @ drawn, 2, 0) * MM
    return math.sqrt(float(np.mean([_rms(without_rigid_motion(points, each)) ** 2 for each in deviations])))


def _rms(errors: Array) -> float:
    """RMS length of errors `(n, 3)`."""
    return math.sqrt(float(np.mean(np.sum(errors**2, axis=1))))


def main() -> None:
    """Compare each set with its twin."""
    folder, name = Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else ""
    for file in sorted(folder.glob("*.truth.json")):
        truth = json.loads(file.read_text(encoding="utf-8"))
        if name not in truth["case"] or not truth["params"]:
            continue
        measurement = ncomp.read_measurement(folder / f"{truth['case']}.csv", truth["machine"])
        difference, u, blank = compared(truth, measurement)
        ratios = f"{math.hypot(difference, u) / u:.2f}, at most {(difference + u) / u:.2f}"
        found = "" if blank else "; in the twin something is found as well"
        print(f"{truth['case']:16} {difference:.2f} um apart, u {u:.2f} um: times {ratios}{found}", flush=True)


if __name__ == "__main__":
    main()
