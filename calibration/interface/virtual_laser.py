"""The public function that simulates a laser along an axis in motion."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from kinematics.running.caller import public
from kinematics.running.given_texts import Texts, numbers, texts
from kinematics.user_error import UserError
from machines.given import load_calibration, load_machine

if TYPE_CHECKING:
    from calibration.continuous.virtual import Measured
    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine


@public
def simulate_continuous(
    machine: str | Path | Machine,
    calibration: str | Path | ErrorModel,
    axis: str,
    start_mm: float,
    end_mm: float,
    *,
    feed: Annotated[float, 0.1, None] = 500.0,
    acceleration: Annotated[float, 0.001, None] = 1.0,
    jerk: Annotated[float, 0.01, None] = 50.0,
    lag: Annotated[float, 0, None] = 20.0,
    passes: Annotated[int, 1, None] = 1,
    both: bool = False,
    rate: Annotated[float, 1, None] = 100.0,
    noise_um: Annotated[float, 0, None] = 0.1,
    vibration: Texts = (),
    settling: str | None = None,
    jitter: Annotated[float, 0, None] = 0.0,
    dropped: Annotated[float, 0, 0.9] = 0.0,
    spacing: float = 100.0,
    runs: Annotated[int, 1, None] = 1,
    dwell: Annotated[float, 0, None] = 4.0,
    u_um: Annotated[float, 1e-06, None] = 0.2,
    temperature: Mapping[str, Sequence[float]] | None = None,
    seed: Annotated[int, 0, None] = 0,
) -> Measured:
    """Laser runs of a linear axis at constant velocity (`records`), and readings at targets before them (`quasi`).

    calibration: the true errors, for instance of `virtual_machine`. Motion: feed, mm/min; acceleration, m/s2; jerk,
    m/s3; lag: time constant of the position loop, ms; passes: number of runs; both: forward and backward each time.
    Laser: rate, Hz; noise_um: of a sample; vibration: `35:0.3` in Hz and um; settling: `18:20:0.2` in Hz, um and s;
    jitter: of the time stamps, us; dropped: share of lost samples. Targets: spacing, mm; runs: cycles; dwell, s; u_um:
    standard uncertainty (k = 1) of a reading. temperature: by sensor, at the start and at the end, degC.

    UserError for an axis that is not linear, and for a run outside its travel.
    """
    from calibration.continuous.virtual import Laser, Motion, Targets, measure
    from calibration.instruments import Interferometer
    from calibration.simulation.measure_plan import streams

    found, axis = load_machine(machine), axis.strip().upper()
    _check_run(found, axis, start_mm, end_mm)
    if spacing <= 0.0:
        raise UserError(f"--spacing {spacing:g}: expected a length above zero")
    motion = Motion(start_mm, end_mm, feed, acceleration * 1e3, jerk * 1e3, lag * 1e-3)
    laser = Laser(rate, noise_um, _vibrations(vibration), _settling(settling), jitter * 1e-6, dropped)
    temperatures = _courses(temperature or {})
    return measure(
        found, load_calibration(found, calibration), axis, motion, laser, Targets(spacing, runs, dwell=dwell),
        Interferometer(u_um=u_um), streams(seed, 2)[1], passes=passes, both=both, temperatures=temperatures,
    )  # fmt: skip


def _check_run(machine: Machine, axis: str, start_mm: float, end_mm: float) -> None:
    """UserError unless the run is that of a linear axis within its travel, with different ends."""
    own = machine.axes[machine.index(axis)]
    if own.rotary:
        raise UserError(f"--axis {axis}: a laser follows linear axes only")
    low, high = own.travel
    for name, position in (("--start-mm", start_mm), ("--end-mm", end_mm)):
        if not low <= position <= high:
            raise UserError(f"{name} {position:g}: outside the travel of {axis}, {low:g} to {high:g} mm")
    if start_mm == end_mm:
        raise UserError(f"--end-mm {end_mm:g}: expected another position than --start-mm")


def _courses(given: Mapping[str, Sequence[float]]) -> dict[str, tuple[float, float]]:
    """Temperatures at the start and at the end by sensor, degC, as differences from 20 degC, K."""
    from kinematics.state import REFERENCE_DEGC

    courses = {}
    for name, course in given.items():
        if not isinstance(name, str):
            raise UserError(f"temperature[{name!r}]: expected a name of a sensor")
        try:
            start, end = map(float, course)
        except (TypeError, ValueError):
            start = end = math.nan
        if not (math.isfinite(start) and math.isfinite(end)):
            raise UserError(f"temperature[{name!r}]: expected two numbers, at the start and at the end, degC")
        courses[name] = (start - REFERENCE_DEGC, end - REFERENCE_DEGC)
    return courses


def _vibrations(given: Texts) -> tuple[tuple[float, float], ...]:
    found = []
    for text in texts(given):
        frequency, amplitude = numbers(text, 2, f"--vibration {text}", ":")
        if frequency <= 0.0:
            raise UserError(f"--vibration {text}: expected a frequency above zero")
        found.append((frequency, amplitude))
    return tuple(found)


def _settling(given: str | None) -> tuple[float, float, float] | None:
    if given is None:
        return None
    frequency, amplitude, constant = numbers(given, 3, f"--settling {given}", ":")
    if frequency <= 0.0 or constant <= 0.0:
        raise UserError(f"--settling {given}: expected a frequency and a time constant above zero")
    return frequency, amplitude, constant
