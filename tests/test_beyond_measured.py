"""Outside the measured range no error motion of a calibration that is written grows."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

import machines
from calibration.fit.beyond_measured import check_beyond_measured, growths
from kinematics.basis import Legendre
from kinematics.effects import Effect, ErrorMotion, LocationError, Wobble
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.machine import Machine
from kinematics.turn import columns_of
from kinematics.user_error import UserError

DMU50 = machines.load("dmu50")
TRUNNION = machines.load("trunnion_ac")


def model(machine: Machine, *effects: Effect) -> ErrorModel:
    return msgspec.structs.replace(no_errors(machine), effects=effects)


def cancelling(machine: Machine, axis: str, interval: tuple[float, float], size: float) -> tuple[Effect, ...]:
    """A wobble and curves that cancel over an interval, as older calibrations by three points hold them."""
    wobble = Wobble(axis, "radial", 1, 1, size, 0.0)
    basis, x = Legendre(interval, 15), np.linspace(*interval, 501)
    columns = columns_of(machine.axes[machine.index(axis)], basis, x)
    pairs = {"C": ("X", "Y"), "B": ("Z", "X")}[axis]
    waves = (np.cos(np.deg2rad(x)), np.sin(np.deg2rad(x)))
    found: list[Effect] = [wobble]
    for component, wave in zip(pairs, waves, strict=True):
        values = np.linalg.lstsq(columns, -size * wave, rcond=None)[0]
        found.append(ErrorMotion(component, axis, basis, tuple(values.tolist())))  # type: ignore[arg-type]
    return tuple(found)


@pytest.mark.parametrize(
    ("machine", "axis", "interval"),
    [(TRUNNION, "C", (0.0, 340.0)), (DMU50, "C", (90.0, 200.0)), (DMU50, "B", (0.0, 150.0))],
)
def test_what_only_cancels_inside_is_refused(machine, axis, interval):
    grown = {
        growth.name: growth for growth in growths(model(machine, *cancelling(machine, axis, interval, 1000.0)), machine)
    }
    assert max(growth.inside for growth in grown.values()) < 1.0
    assert max(growth.outside for growth in grown.values()) > 5.0
    with pytest.raises(UserError, match=f"E_.{axis} changes by .* in the measured range"):
        check_beyond_measured(model(machine, *cancelling(machine, axis, interval, 1000.0)), machine)


@pytest.mark.parametrize("axis", ["C", "B", "X"])
def test_curves_alone_are_held_and_never_refused(axis):
    rng = np.random.default_rng(1)
    low, high = DMU50.axes[DMU50.index(axis)].travel
    for _ in range(20):
        interval = tuple(sorted(rng.uniform(low, high, 2).tolist()))
        curve = ErrorMotion("Y", axis, Legendre(interval, 6), tuple(rng.uniform(-50, 50, 7).tolist()))
        check_beyond_measured(model(DMU50, curve, LocationError("C", "Y", 500.0)), DMU50)


def test_a_wobble_of_usual_size_beside_a_whole_travel_is_written():
    curve = ErrorMotion("Y", "B", Legendre((0.0, 180.0), 2), (1.0, 5.0, 2.0))
    check_beyond_measured(model(DMU50, curve, Wobble("B", "radial", 1, 1, 8.0, 3.0)), DMU50)
