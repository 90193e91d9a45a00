"""Logs of a virtual tracker: a machine with errors moves from stand to stand, the tracker records continuously."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.instruments import LaserTracker
from calibration.measurement.measurement import Measurement, Target
from calibration.registration.observed_points import target_points
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine
from kinematics.state import State
from kinematics.transforms import Array, Pose

SHEET = LaserTracker(u_range_um=0.5, u_range_um_per_m=0.4, u_angle_um=3.0, u_angle_um_per_m=2.5)


@dataclass(frozen=True)
class Stop:
    """The machine goes to a position, mm and degrees, and dwells."""

    position: Sequence[float]
    target: str = "t1"
    dwell: float = 1.0
    creep: float = 0.0
    """Speed of the first axis during the dwell, mm/s."""
    settle: float = 0.0
    """Settling amplitude of the first axis, mm, with a time constant of 80 ms."""
    broken: tuple[float, float] | None = None
    """Shares of the dwell between which the beam is broken."""
    broken_before: bool = False
    """The beam is interrupted during the move to this position, as it is at a change of the target."""


@dataclass(frozen=True)
class Log:
    """Readings of a tracker."""

    time: Array
    points: Array
    target: np.ndarray

    def kept(self, mask: np.ndarray) -> Log:
        return Log(self.time[mask], self.points[mask], self.target[mask])

    def text(self, header: Mapping[str, str], columns: Sequence[str] = ()) -> str:
        lines = [f"# {key}: {value}" for key, value in header.items()] + [",".join(["time_s", "x", "y", "z", *columns])]
        own = {"target": self.target.tolist()}
        values = zip(self.time.tolist(), *self.points.T.tolist(), *(own[name] for name in columns), strict=True)
        row = ",".join(["%.3f", "%.5f", "%.5f", "%.5f", *("%s" for _ in columns)])
        lines += [row % each for each in values]
        return "\n".join(lines) + "\n"


def header(machine: Machine, stands_on: str = "workpiece", instrument: LaserTracker = SHEET) -> dict[str, str]:
    return {
        "machine": machine.name, "instrument": "laser-tracker", "stands_on": stands_on,
        "u_range_um": str(instrument.u_range_um), "u_range_um_per_m": str(instrument.u_range_um_per_m),
        "u_angle_um": str(instrument.u_angle_um), "u_angle_um_per_m": str(instrument.u_angle_um_per_m),
    }  # fmt: skip


def log_of(
    machine: Machine,
    model: ErrorModel,
    stops: Sequence[Stop],
    targets: Mapping[str, Target],
    pose: Pose,
    rng: np.random.Generator,
    *,
    rate: float = 250.0,
    speed: float = 200.0,
    reading_um: float = 2.0,
    vibration_um: float = 1.0,
    stands_on: str = "workpiece",
) -> Log:
    """Everything that the tracker records; speed in mm/s, degrees/s of a rotary axis."""
    times, axes, seen, names, clock = [], [], [], [], 0.0
    before = np.array(stops[0].position, float)
    for stop in stops:
        here = np.array(stop.position, float)
        way = float(np.max(np.abs(here - before)))
        duration = max(way / speed * 1.5, 0.04) if way > 0.0 else 0.0
        t = np.arange(0.0, duration, 1.0 / rate) / max(duration, 1e-9)
        moving = before + (3 * t**2 - 2 * t**3)[:, None] * (here - before)
        t_stand = np.arange(0.0, stop.dwell, 1.0 / rate)
        standing = np.tile(here, (len(t_stand), 1))
        standing[:, 0] += stop.creep * t_stand + stop.settle * np.exp(-t_stand / 0.08)
        beam = np.ones(len(t_stand), bool)
        if stop.broken is not None:
            share = t_stand / stop.dwell
            beam = (share < stop.broken[0]) | (share > stop.broken[1])
        axes += [moving, standing]
        seen += [np.full(len(moving), not stop.broken_before), beam]
        n = len(moving) + len(standing)
        times.append(clock + np.arange(n) / rate)
        names += [stop.target] * n
        clock += n / rate
        before = standing[-1] if len(standing) else here
    q, target = np.concatenate(axes) * machine.scale, np.array(names)
    state = State(q, target=target)
    blank = Measurement(machine, SHEET, state, np.zeros((len(q), 3)), targets, stands_on)  # type: ignore[arg-type]
    points = pose.apply(target_points(blank, model.errors(machine, state), blank.tool))
    time = np.concatenate(times)
    wave = np.sin(2 * np.pi * 11.3 * time)[:, None] * np.array([0.6, -0.5, 0.6])
    noise = reading_um * rng.standard_normal(points.shape) + vibration_um * wave
    return Log(time, points + noise * 1e-3, target).kept(np.concatenate(seen))


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path
