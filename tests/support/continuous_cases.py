"""Continuous runs whose truth is known: the synthetic case of Miller et al. 2017 (Fig. 5-9), and a virtual machine."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

import machines
from calibration.continuous.records import QuasiStatic, Record
from calibration.continuous.virtual import Laser, Measured, Motion, Targets, end_effect, measure
from calibration.instruments import Interferometer
from calibration.measurement.measurement import Measurement
from calibration.simulation.effect_text import read_effects
from calibration.simulation.simulate import observe
from calibration.simulation.true_model import model_of
from kinematics.basis import Fourier
from kinematics.effects import ErrorMotion
from kinematics.error_model.model import ErrorModel
from kinematics.state import State
from kinematics.transforms import Array

LENGTH, FEED, RATE = 1000.0, 500.0, 100.0
"""Travel, mm, feed, mm/min, and rate, Hz, of the paper's synthetic case; the rest as in its published re-making."""
MACHINE = machines.load("cframe")
TRAVEL = 450.0
"""Travel of the virtual machine's runs, mm, as in the paper's first case study."""
SMOOTH_UM = (0.0, 15.0, 4.0, 4.0, 3.0, 3.0, 2.0, 2.0, 1.0, 1.0)
"""Half-widths of a smooth error: constant, slope, four waves over the travel."""


class Paper(NamedTuple):
    """One draw of the paper's synthetic case."""

    record: Record
    quasi: QuasiStatic
    phases: Array

    def truth(self, x: Array) -> Array:
        """Error, um, at positions, mm."""
        return paper_error(x, self.phases)


def paper_error(x: Array, phases: Array) -> Array:
    """3e-3 x, waves of 400, 60 and 10 mm, and 5 um at both ends that die away over 30 mm; um."""
    waves = zip((1.0, 0.4, 0.3), (400.0, 60.0, 10.0), phases, strict=True)
    smooth = 3e-3 * x + sum(a * np.sin(2 * np.pi * x / period + phase) for a, period, phase in waves)
    return np.asarray(smooth - 5.0 * np.exp(-x / 30.0) + 5.0 * np.exp(-(LENGTH - x) / 30.0))


def paper_case(seed: int, noise: float = 0.15, noise_quasi: float = 0.15, spacing: float = 100.0) -> Paper:
    """A run with a second of acceleration, sampled with noise, um, and targets with noise of their own."""
    rng = np.random.default_rng(seed)
    phases = rng.uniform(0.0, 2.0 * np.pi, 3)
    speed, ramp = FEED / 60.0, 1.0
    whole = LENGTH / speed + ramp
    time = np.arange(-1.0, whole + 1.0, 1.0 / RATE)
    since = np.clip(time, 0.0, whole)
    rising, falling = speed / ramp * since**2 / 2.0, LENGTH - speed / ramp * (whole - since) ** 2 / 2.0
    x = np.where(since < ramp, rising, np.where(since < whole - ramp, speed * (since - ramp / 2.0), falling))
    shown = x + 1e-3 * (paper_error(x, phases) + noise * rng.standard_normal(len(x)))
    targets = np.arange(0.0, LENGTH + 1.0, spacing)
    readings = paper_error(targets, phases) + noise_quasi * rng.standard_normal(len(targets))
    ones = np.ones(len(targets), int)
    quasi = QuasiStatic(targets, readings, ones, ones.astype(str), noise_quasi, source="targets")
    return Paper(Record("1 forward", 1, time + 1.0, shown - shown[0], 0.0, LENGTH, FEED, "run"), quasi, phases)


class Virtual(NamedTuple):
    """A virtual machine's axis, measured."""

    model: ErrorModel
    measured: Measured

    @property
    def quasi(self) -> QuasiStatic:
        """Its readings at targets."""
        return quasi_of(self.measured.quasi)

    def truth(self, x: Array, way: int) -> Array:
        """Error of X, um, at positions, mm, in a direction, with the datum of the first reading."""
        positions = np.tile(np.array([axis.home for axis in MACHINE.axes]) * MACHINE.scale, (len(x) + 1, 1))
        own = MACHINE.index("X")
        positions[1:, own], positions[0, own] = x, 0.0
        approach = np.zeros(positions.shape)
        approach[:, own] = way
        approach[0, own] = 1.0
        state = State(positions, approach=approach, last_move=5.0 * approach, time=np.zeros(len(positions)))
        names, run = np.full(len(positions), "X"), np.full(len(positions), "1")
        exact, rng = Interferometer(u_um=1.0), np.random.default_rng(0)
        seen = observe(MACHINE, self.model, state, exact, rng, axis=names, run=run, noise_scale=0.0)
        return np.asarray(seen.observed[1:, 0] * 1e3)


def quasi_of(measured: Measurement) -> QuasiStatic:
    """The readings of a virtual laser, as their file would be read."""
    own = MACHINE.index("X")
    assert measured.state.approach is not None
    assert measured.run is not None
    assert isinstance(measured.instrument, Interferometer)
    return QuasiStatic(
        np.round(measured.state.positions[:, own], 6),
        measured.observed[:, 0] * 1e3,
        measured.state.approach[:, own].astype(int),
        measured.run.astype(str),
        measured.instrument.u_um,
        measured.instrument.u_um_per_m,
        "targets",
    )


def virtual_case(
    seed: int,
    effects: tuple[str, ...] = ("cyclic:component=X,axis=X,period=10,sine=[0.6],cosine=[0.3]",),
    *,
    feed: float = FEED,
    laser: Laser | None = None,
    targets: Targets | None = None,
    u_um: float = 0.2,
    passes: int = 1,
    both: bool = False,
    ends: bool = True,
) -> Virtual:
    """A smooth error at random with the effects given, measured over the travel."""
    rng = np.random.default_rng(seed)
    drawn = tuple((rng.uniform(-1.0, 1.0, len(SMOOTH_UM)) * SMOOTH_UM).tolist())
    found = [ErrorMotion("X", "X", Fourier((0.0, TRAVEL), (0.5, 1.0, 2.0, 4.0)), drawn)]
    found += read_effects(list(effects), MACHINE)
    if ends:
        found.append(end_effect(MACHINE, "X", 0.0, TRAVEL, 4.0, 20.0))
    model = model_of(MACHINE, found)
    motion, laser = Motion(0.0, TRAVEL, feed), laser or Laser(RATE if feed <= FEED else 1000.0)
    instrument = Interferometer(u_um=u_um)
    measured = measure(
        MACHINE, model, "X", motion, laser, targets or Targets(25.0), instrument, rng, passes=passes, both=both
    )
    return Virtual(model, measured)
