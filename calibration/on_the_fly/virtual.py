"""Virtual readings: the observations by a tracker of a machine with known errors that follows a path."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import BinaryIO, Literal

import numpy as np

from calibration.instruments import LaserTracker
from calibration.measurement.measurement import Measurement, Target, with_moves
from calibration.measurement.states import MADE_BY
from calibration.measurement.written_file import WRITTEN_ROWS, header_lines
from calibration.on_the_fly.drive import Driven, PathDynamics, driven
from calibration.on_the_fly.nominal_path import NominalPath
from calibration.simulation.simulate import observe, with_temperatures
from kinematics.error_model.model import ErrorModel
from kinematics.state import REFERENCE_DEGC, State
from kinematics.transforms import Array, Pose
from kinematics.version import VERSION

BETWEEN_S = 60.0
"""Time from the end of one pass to the start of the next, s."""


@dataclass(frozen=True)
class Vibration:
    """Vibration of the target: a sine wave in each direction (RMS in um, Hz), of random phase in each pass."""

    rms_um: float = 0.0
    hertz: float = 40.0


@dataclass(frozen=True)
class Session:
    """Consecutive passes along a path: with every target, at every feed, from every station."""

    path: NominalPath
    settings: Sequence[PathDynamics]
    targets: Mapping[str, Target]
    poses: Mapping[str, Pose]
    """Pose of each station, from the frame to which the tracker is fixed to its own."""
    stands_on: Literal["workpiece", "bed"] = "workpiece"
    vibration: Vibration = Vibration()


def readings_of(
    session: Session,
    model: ErrorModel,
    tracker: LaserTracker,
    rng: np.random.Generator,
    *,
    noise_scale: float = 1.0,
    temperatures: Mapping[str, tuple[float, float]] | None = None,
    progress: Callable[[int], None] = lambda _: None,
) -> Measurement:
    """The readings, with the true axis positions, which a file of readings does not contain.

    Exact kinematics and the full covariance of the tracker (`calibration.simulation.simulate`). Temperatures, start and
    end in K from 20 degC by sensor, change linearly over the whole session.
    """
    motions = [driven(session.path, dynamics) for dynamics in session.settings]
    state, run = _states(session, motions)
    if temperatures:
        state = with_temperatures(state, temperatures)
    seen = observe(
        session.path.machine, model, state, tracker, rng, session.poses, session.targets,
        stands_on=session.stands_on, run=run, noise_scale=noise_scale, progress=progress,
    )  # fmt: skip
    return replace(seen, observed=seen.observed + _vibration(session, state, run, rng))


def write_readings(readings: Measurement, file: BinaryIO, origin: str = "") -> None:
    """Write the readings in the form of a tracker: time and points; target, station and run if there are several.

    origin: of the data, for the header line `made_by`.
    """
    text = io.TextIOWrapper(file, encoding="utf-8", newline="")
    for line in (*header_lines(readings), f"{MADE_BY}: ncomp {VERSION}{origin}"):
        text.write(f"# {line}\n")
    state = readings.state
    assert state.time is not None
    columns: dict[str, np.ndarray] = {"time_s": np.round(state.time, 6)}
    columns |= {letter: np.round(readings.observed[:, i], 5) for i, letter in enumerate("xyz")}
    for name, column in (("target", state.target), ("station", state.station), ("run", readings.run)):
        if column is not None and np.any(column != column[0]):
            columns[name] = column
    columns |= {f"temp_{sensor}": np.round(kelvin + REFERENCE_DEGC, 3) for sensor, kelvin in state.temperatures.items()}
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for start in range(0, len(readings), WRITTEN_ROWS):
        writer.writerows(
            zip(*(column[start : start + WRITTEN_ROWS].tolist() for column in columns.values()), strict=True)
        )
    text.flush()
    text.detach()


def _states(session: Session, motions: Sequence[Driven]) -> tuple[State, np.ndarray]:
    """The states of all passes, and their runs: one per feed, numbered anew for each target and station."""
    parts, names, start = [], [], 0.0
    for station in session.poses:
        for target in session.targets:
            for number, motion in enumerate(motions, start=1):
                n = len(motion.time)
                parts.append((motion, start, station, target))
                names.append(np.full(n, str(number)))
                start += float(motion.time[-1]) + BETWEEN_S
    moved = [with_moves(State(motion.positions)) for motion, *_ in parts]
    approach = [each.approach for each in moved if each.approach is not None]
    last = [each.last_move for each in moved if each.last_move is not None]
    counts = [len(motion.time) for motion, *_ in parts]
    state = State(
        np.concatenate([motion.positions for motion, *_ in parts]),
        approach=np.concatenate(approach),
        last_move=np.concatenate(last),
        velocity=np.concatenate([motion.velocity for motion, *_ in parts]),
        acceleration=np.concatenate([motion.acceleration for motion, *_ in parts]),
        time=np.concatenate([motion.time + at for motion, at, *_ in parts]),
        station=np.repeat([station for *_, station, _ in parts], counts),
        target=np.repeat([target for *_, target in parts], counts),
        cycle=np.concatenate([column.astype(float) for column in names]) - 1.0,
    )
    return state, np.concatenate(names)


def _vibration(session: Session, state: State, run: np.ndarray, rng: np.random.Generator) -> Array:
    """Displacement by vibration `(n, 3)`, mm."""
    assert state.time is not None
    if not session.vibration.rms_um:
        return np.zeros((len(state), 3))
    phases = rng.uniform(0.0, 2.0 * np.pi, (int(run.astype(int).max()), 3))[run.astype(int) - 1]
    wave = np.sin(2.0 * np.pi * session.vibration.hertz * state.time[:, None] + phases)
    return np.asarray(session.vibration.rms_um * 1e-3 * np.sqrt(2.0) * wave)
