"""A virtual laser that measures one axis in motion, and at targets at standstill.

The axis follows a command of limited acceleration and jerk with a lag, and has the errors of the exact kinematics of
its machine. It vibrates, in addition where its acceleration jumps. The laser has noise; its time stamps may scatter and
samples may be lost. All error effects act as usual: backlash by direction of approach, following errors by speed,
growth by time and temperature. The laser reads zero at the start of its first run.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from calibration.continuous.records import DIRECTION_NAMES, Record
from calibration.instruments import Interferometer
from calibration.measurement.measurement import Measurement
from calibration.simulation.simulate import observe, read_out
from kinematics.basis import BSpline
from kinematics.effects import Effect, ErrorMotion
from kinematics.effects.base import own_component
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError

FINE_S = 2.5e-4
"""Largest time step of the motion, s; the sampling period over `VIRTUAL_OVERSAMPLING` if that is shorter."""
VIRTUAL_OVERSAMPLING = 4
MOST_SAMPLES = 5_000_000
PAUSE_S = 60.0
"""Pause between the quasi-static measurement and the continuous runs, s."""
END_NODES = 400
"""Number of nodes of the table of an end effect."""


@dataclass(frozen=True)
class Motion:
    """Commanded motion of the axis, and its dynamics."""

    start: float
    """Start position, mm; `end`: end position, mm."""
    end: float
    feed: float
    """Feed, mm/min."""
    acceleration: float = 1000.0
    """Acceleration, mm/s2."""
    jerk: float = 50_000.0
    """Jerk, mm/s3."""
    lag: float = 0.02
    """Time constant of the position loop, s; 0 for no lag."""
    standstill_s: float = 1.0
    """Rest before and after the motion, s."""


@dataclass(frozen=True)
class Laser:
    """Sampling of the axis, and its disturbances."""

    rate: float = 100.0
    """Sampling rate, Hz."""
    noise: float = 0.1
    """Standard deviation of the noise, um."""
    vibrations: tuple[tuple[float, float], ...] = ()
    """Frequency, Hz, and amplitude, um, of permanent vibrations, whose random phase drifts."""
    settling: tuple[float, float, float] | None = None
    """Frequency, Hz, amplitude, um, and time constant, s, of the decaying vibration after a change of acceleration."""
    jitter: float = 0.0
    """Standard deviation of the time stamps, s."""
    dropped: float = 0.0
    """Share of lost samples."""


@dataclass(frozen=True)
class Targets:
    """Targets of the quasi-static measurement, and their sequence."""

    spacing: float
    """Distance of the targets, mm."""
    runs: int = 1
    both: bool = True
    """True for measurement in both directions."""
    dwell: float = 4.0
    """Dwell at a target, s."""
    overrun: float = 1.0
    """Overrun beyond the ends before the reversal, mm."""


class Measured(NamedTuple):
    """Data of the virtual laser."""

    records: tuple[Record, ...]
    """The continuous runs: times, s, and displacements, mm."""
    quasi: Measurement
    """The readings at targets."""


def measure(
    machine: Machine,
    model: ErrorModel,
    axis: str,
    motion: Motion,
    laser: Laser,
    targets: Targets,
    instrument: Interferometer,
    rng: np.random.Generator,
    *,
    passes: int = 1,
    both: bool = False,
    temperatures: Mapping[str, tuple[float, float]] | None = None,
) -> Measured:
    """The quasi-static measurement of an axis, and then `passes` continuous runs, in one or both directions.

    temperatures: start and end, K from 20 degC, of linear changes over the whole measurement.
    """
    low, high = sorted((motion.start, motion.end))
    stood = _standing(machine, axis, low, high, motion.feed, targets)
    signs = [sign for _ in range(passes) for sign in ((1, -1) if both else (1 if motion.end > motion.start else -1,))]
    profile = _profile(motion, laser.rate)
    if len(profile.time) * len(signs) > MOST_SAMPLES:
        raise UserError(f"{len(profile.time) * len(signs)} samples, more than {MOST_SAMPLES}")
    length = float(profile.time[-1]) + 1.0
    assert stood.time is not None
    start_s = float(stood.time[-1]) + PAUSE_S
    moved = [_moving(machine, axis, motion, profile, sign, start_s + i * length) for i, sign in enumerate(signs)]
    total = start_s + len(signs) * length
    courses = temperatures or {}
    stood, *moved = (_warmed(state, courses, total) for state in (stood, *moved))
    quasi = _observed(machine, model, axis, stood, instrument, rng)
    records, shift = [], None
    for i, (sign, state) in enumerate(zip(signs, moved, strict=True)):
        displacement = _displacement(machine, model, axis, state, rng)
        if shift is None:
            shift = displacement[0]
        records.append(_record(f"{i // (1 + both) + 1}", sign, motion, profile, displacement - shift, laser, rng))
    return Measured(tuple(records), quasi)


def _displacement(machine: Machine, model: ErrorModel, axis: str, state: State, rng: np.random.Generator) -> Array:
    """Exact position `(n,)`, mm, of an axis as a laser reads it."""
    observation = observe(
        machine, model, state, Interferometer(u_um=1.0), rng, axis=np.full(len(state), axis),
        run=np.full(len(state), "1"), noise_scale=0.0,
    )  # fmt: skip
    return np.asarray(state.position(machine, axis) + observation.observed[:, 0])


def end_effect(machine: Machine, axis: str, low: float, high: float, size: float, length: float) -> Effect:
    """An error that changes fast at both ends: -size exp(-(x - low) / length) + size exp(-(high - x) / length), um.

    It is a table, like the error in Miller et al. 2017, Fig. 5.
    """
    nodes = np.linspace(low, high, END_NODES)
    values = -size * np.exp(-(nodes - low) / length) + size * np.exp(-(high - nodes) / length)
    machine.index(axis)
    return ErrorMotion(own_component(axis), axis, BSpline(tuple(nodes.tolist()), 1), tuple(values.tolist()))


class _Profile(NamedTuple):
    """The motion from 0 to the whole travel, at the samples."""

    time: Array
    along: Array
    """Position from the start, mm."""
    speed: Array
    acceleration: Array
    changes: Array
    """Times of the changes of acceleration, s."""


def _profile(motion: Motion, rate: float) -> _Profile:
    """The motion as a trapezoid of speed, smoothed by a moving mean according to the jerk, and delayed by the lag."""
    sign = abs(motion.end - motion.start)
    top = min(motion.feed / 60.0, np.sqrt(sign * motion.acceleration))
    ramp, rounding = top / motion.acceleration, motion.acceleration / motion.jerk
    cruise = sign / top - ramp
    step = min(FINE_S, 1.0 / (VIRTUAL_OVERSAMPLING * rate))
    total = motion.standstill_s + 2.0 * ramp + cruise + rounding + motion.standstill_s + 10.0 * motion.lag
    if total / step > 8 * MOST_SAMPLES or total * rate > MOST_SAMPLES:
        raise UserError(f"a run of {total:.0f} s at {rate:g} Hz: more than {MOST_SAMPLES} samples")
    fine = np.arange(0.0, total, step)
    since = fine - motion.standstill_s
    speed = np.clip(np.minimum(since, 2.0 * ramp + cruise - since) * motion.acceleration, 0.0, top)
    box = max(round(rounding / step), 1)
    sums = np.concatenate([np.zeros(box), np.cumsum(speed)])
    speed = (sums[box:] - sums[:-box]) / box
    if motion.lag > 0.0:
        share = float(np.exp(-step / motion.lag))
        speed = lfilter([1.0 - share], [1.0, -share], speed)
    along = np.cumsum(speed) * step
    along *= sign / along[-1]
    time = np.arange(0.0, total, 1.0 / rate)
    changes = motion.standstill_s + np.array([0.0, ramp, ramp + cruise, 2.0 * ramp + cruise])
    return _Profile(
        time,
        np.interp(time, fine, along),
        np.interp(time, fine, speed),
        np.interp(time, fine, np.gradient(speed, step)),
        changes,
    )


def _moving(machine: Machine, axis: str, motion: Motion, profile: _Profile, sign: int, start_s: float) -> State:
    """The states of the machine at the samples of one run."""
    low, high = sorted((motion.start, motion.end))
    along = low + profile.along if sign > 0 else high - profile.along
    positions = _at(machine, axis, along)
    own = machine.index(axis)
    velocity, acceleration, approach = (np.zeros(positions.shape) for _ in range(3))
    velocity[:, own], acceleration[:, own] = sign * profile.speed, sign * profile.acceleration
    approach[:, own] = sign
    return State(
        positions, approach=approach, last_move=approach * (high - low), velocity=velocity, acceleration=acceleration,
        time=start_s + profile.time, cycle=np.zeros(len(along)),
    )  # fmt: skip


def _standing(machine: Machine, axis: str, low: float, high: float, feed: float, targets: Targets) -> State:
    """The states at the targets, run by run, in one or both directions."""
    count = round((high - low) / targets.spacing)
    if count < 1 or abs(low + count * targets.spacing - high) > 1e-6:
        raise UserError(f"{high - low:g} mm are no whole number of {targets.spacing:g} mm between targets")
    there = low + targets.spacing * np.arange(count + 1)
    one = np.concatenate([there, there[::-1]]) if targets.both else there
    signs = np.repeat([1.0, -1.0], count + 1) if targets.both else np.ones(count + 1)
    along, approach = np.tile(one, targets.runs), np.tile(signs, targets.runs)
    moves = np.abs(np.diff(along, prepend=along[0]))
    moves[1:][approach[1:] != approach[:-1]] += 2.0 * targets.overrun
    time = np.cumsum(moves / feed * 60.0 + targets.dwell)
    sides = np.zeros((len(along), len(machine.axes)))
    sides[:, machine.index(axis)] = approach
    cycle = np.repeat(np.arange(float(targets.runs)), len(one))
    return State(_at(machine, axis, along), approach=sides, last_move=sides * targets.spacing, time=time, cycle=cycle)


def _at(machine: Machine, axis: str, along: Array) -> Array:
    """Axis positions `(n, axes)`, mm and rad: one axis at the given positions `(n,)`, mm, the others at home."""
    positions = np.tile(np.array([each.home for each in machine.axes]) * machine.scale, (len(along), 1))
    positions[:, machine.index(axis)] = along
    return positions


def _warmed(state: State, courses: Mapping[str, tuple[float, float]], total: float) -> State:
    assert state.time is not None
    share = state.time / total
    return replace(state, temperatures={name: a + share * (b - a) for name, (a, b) in courses.items()})


def _observed(
    machine: Machine, model: ErrorModel, axis: str, state: State, instrument: Interferometer, rng: np.random.Generator
) -> Measurement:
    """The readings at targets: one zero for all runs, which keep their names."""
    names, n = np.full(len(state), axis), len(state)
    measured = observe(machine, model, state, instrument, rng, axis=names, run=np.full(n, "1"))
    assert state.cycle is not None
    return read_out(replace(measured, run=(state.cycle.astype(int) + 1).astype(str)))


def _record(
    name: str, sign: int, motion: Motion, profile: _Profile, displacement: Array, laser: Laser, rng: np.random.Generator
) -> Record:
    """The record of a run by the laser: with noise, vibration, scattered time stamps and lost samples."""
    time, n = profile.time, len(profile.time)
    off = laser.noise * rng.standard_normal(n)
    for frequency, amplitude in laser.vibrations:
        wander = np.cumsum(rng.standard_normal(n)) * np.sqrt(frequency / laser.rate) * 0.3
        off += amplitude * np.sin(2.0 * np.pi * frequency * time + rng.uniform(0.0, 2.0 * np.pi) + wander)
    if laser.settling is not None:
        frequency, amplitude, constant = laser.settling
        for moment in profile.changes.tolist():
            since = time - moment
            dies = np.exp(-np.maximum(since, 0.0) / constant) * np.sin(2.0 * np.pi * frequency * since)
            off += np.where(since > 0.0, amplitude * dies, 0.0)
    stamps = time + laser.jitter * rng.standard_normal(n)
    kept = rng.random(n) >= laser.dropped
    low, high = sorted((motion.start, motion.end))
    shown = np.round(displacement + 1e-3 * off, 6)
    order = np.argsort(stamps[kept], kind="stable")
    return Record(
        f"{name} {DIRECTION_NAMES[sign]}",
        sign,
        np.round(stamps[kept][order], 6),
        shown[kept],
        low if sign > 0 else high,
        high if sign > 0 else low,
        motion.feed,
        f"virtual run {name} {DIRECTION_NAMES[sign]}",
    )
