"""Several files as one measurement: runs at other times, temperatures and feeds, with one instrument on one machine.

Each file is a separate set-up: its stations and runs are named `file:name`. A quantity that is missing in one of the
files is dropped for all, with a note; missing feeds are refused if other files have rows in motion.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from calibration.instruments.touch_probe import TIP
from calibration.measurement.measurement import Distance, Measurement, Target
from kinematics.files import fingerprint
from kinematics.state import State
from kinematics.transforms import Array
from kinematics.user_error import UserError

UNNAMED = "1"
"""Station and run if the file names none."""
ALIKE: Mapping[str, Callable[[Measurement], object]] = {
    "the machine": lambda measurement: measurement.machine,
    "the instrument or its uncertainties": lambda measurement: measurement.instrument,
    "stands_on": lambda measurement: measurement.stands_on,
    "the zero of the part": lambda measurement: measurement.part_zero,
}
"""Quantities, by name, in which files of one measurement agree."""


def joined(measurements: Sequence[Measurement]) -> Measurement:
    """The measurements as one, in the given order; UserError if they do not belong together."""
    if not measurements:
        raise UserError("no measurement")
    if len(measurements) == 1:
        return measurements[0]
    measurements = _by_one(measurements)
    _check_alike(measurements)
    names = _names(measurements)
    measurements = _with_own_tips(measurements, names)
    first = measurements[0]
    notes = [f"{name}: {note}" for name, m in zip(names, measurements, strict=True) for note in m.notes]
    state = _state(measurements, names, notes)
    return replace(
        first,
        state=state,
        observed=np.concatenate([m.observed for m in measurements]),
        targets=_targets(measurements, names),
        spheres={
            f"{name}:{s}": xyz for name, m in zip(names, measurements, strict=True) for s, xyz in m.spheres.items()
        },
        distances=_distances(measurements, names),
        axis=_together("the axis", [m.axis for m in measurements], names, notes),
        component=_components(measurements),
        run=_named(names, [m.run for m in measurements], measurements),
        actual=_actual(measurements, names, notes),
        feed=_together("the feed", [m.feed for m in measurements], names, notes),
        lines=_lines(measurements),
        file=np.repeat(names, [len(m) for m in measurements]),
        source=" + ".join(names),
        scatter=_together("the scatter of the readings", [m.scatter for m in measurements], names, notes),
        fingerprint=fingerprint("\n".join(m.fingerprint for m in measurements).encode()),
        notes=tuple(notes),
        simulated=any(m.simulated for m in measurements),
        measured=min((m.measured for m in measurements if m.measured is not None), default=None),
    )


def by_instrument(measurements: Sequence[Measurement]) -> list[Measurement]:
    """The measurements, those by the same instrument as one; UserError where a file is given twice."""
    groups: list[list[Measurement]] = []
    for each in _by_one(measurements):
        same = next((group for group in groups if all(of(each) == of(group[0]) for of in ALIKE.values())), None)
        if same is None:
            groups.append([each])
        else:
            same.append(each)
    return [joined(group) for group in groups]


def _by_one(measurements: Sequence[Measurement]) -> list[Measurement]:
    """The measurements by instruments that several of them share."""
    instruments = [each.instrument for each in measurements]
    own = [each.instrument.shared(instruments) for each in measurements]
    return [
        each if each.instrument is one else replace(each, instrument=one)
        for each, one in zip(measurements, own, strict=True)
    ]


def _check_alike(measurements: Sequence[Measurement]) -> None:
    """UserError unless machine, instrument and frame are the same, and no file is given twice."""
    first = measurements[0]
    for number, m in enumerate(measurements):
        for quantity, of in ALIKE.items():
            if of(m) != of(first):
                raise UserError(f"{first.source} and {m.source} differ in {quantity}: they cannot be combined")
        for other in measurements[:number]:
            if m.fingerprint and m.fingerprint == other.fingerprint:
                raise UserError(f"{other.source} and {m.source} contain the same data: give each measurement once")


def _names(measurements: Sequence[Measurement]) -> list[str]:
    """Names of the files without folders if these differ, otherwise whole names, numbered if these are also equal."""
    for names in ([Path(m.source).name for m in measurements], [m.source for m in measurements]):
        if len(set(names)) == len(names) and all(names):
            return names
    return [f"{m.source}({number})" for number, m in enumerate(measurements, start=1)]


def _state(measurements: Sequence[Measurement], names: list[str], notes: list[str]) -> State:
    states = [m.state for m in measurements]
    stations = _named(names, [state.station for state in states], measurements)

    def column(name: str, quantity: str) -> Array | None:
        return _together(quantity, [getattr(state, name) for state in states], names, notes)

    return State(
        np.concatenate([state.positions for state in states]),
        approach=column("approach", "the direction of approach"),
        last_move=column("last_move", "the last move"),
        velocity=_velocity(measurements, names),
        acceleration=column("acceleration", "the acceleration"),
        time=_time(measurements, names, notes),
        temperatures=_temperatures(states, names, notes),
        spindle_speed=column("spindle_speed", "the speed of the spindle"),
        cycle=column("cycle", "run as a cycle"),
        station=None if measurements[0].axis_rows else stations,
        target=column("target", "the target"),
        observed=column("observed", "the observed point"),
    )


def _components(measurements: Sequence[Measurement]) -> np.ndarray | None:
    """Error motions `(n,)` observed by an interferometer; empty in files of positioning deviations."""
    if all(m.component is None for m in measurements):
        return None
    return np.concatenate([m.motions for m in measurements])


def _together(
    quantity: str, columns: Sequence[np.ndarray | None], names: list[str], notes: list[str]
) -> np.ndarray | None:
    """The concatenated columns; None if one is missing, with a note if only some are."""
    there = [column for column in columns if column is not None]
    if len(there) == len(columns):
        return np.concatenate(there)
    if there:
        missing = ", ".join(name for name, column in zip(names, columns, strict=True) if column is None)
        notes.append(f"{quantity} is unknown in {missing}: it is not used in the other files either")
    return None


def _named(names: list[str], columns: Sequence[np.ndarray | None], measurements: Sequence[Measurement]) -> np.ndarray:
    """Names `(n,)` of the form `file:name`."""
    return np.concatenate(
        [
            np.char.add(f"{name}:", np.full(len(m), UNNAMED) if column is None else column.astype(str))
            for name, column, m in zip(names, columns, measurements, strict=True)
        ]
    )


def _targets(measurements: Sequence[Measurement], names: list[str]) -> dict[str, Target]:
    """All targets, stated in one file or more, or in none; UserError if two files disagree on one."""
    found: dict[str, Target] = {}
    for file, m in zip(names, measurements, strict=True):
        for name, target in m.targets.items():
            if name not in found or found[name].free:
                found[name] = target
            elif not target.free and found[name] != target:
                raise UserError(
                    f"{file}: target {name} is at {_shown(target)}, in another file at {_shown(found[name])}: give the "
                    "two targets different names"
                )
    return found


def _with_own_tips(measurements: Sequence[Measurement], names: list[str]) -> Sequence[Measurement]:
    """The measurements; tips of touch probes that differ become targets `file:probe`."""
    if len({m.targets.get(TIP) for m in measurements}) == 1:
        return measurements
    if not measurements[0].instrument.OWN_TIP:
        return measurements
    result = []
    for name, m in zip(names, measurements, strict=True):
        own = f"{name}:{TIP}"
        result.append(replace(m, targets={own: m.targets[TIP]}, state=replace(m.state, target=np.full(len(m), own))))
    return result


def _distances(measurements: Sequence[Measurement], names: list[str]) -> tuple[Distance, ...]:
    """Distances between the spheres of each file."""
    return tuple(
        each._replace(one=f"{name}:{each.one}", other=f"{name}:{each.other}")
        for name, m in zip(names, measurements, strict=True)
        for each in m.distances
    )


def _shown(target: Target) -> str:
    return f"{' '.join(f'{value:g}' for value in target.position)} on the {target.carrier}"


def _time(measurements: Sequence[Measurement], names: list[str], notes: list[str]) -> Array | None:
    """Times `(n,)`, s; a file that begins before the end of the previous one is shifted to follow it."""
    times = [m.state.time for m in measurements]
    following: list[Array] = []
    for name, time in zip(names, times, strict=True):
        if time is None:
            return _together("the time", times, names, notes)
        late = float(following[-1].max() - time.min()) if following else 0.0
        if late > 0.0:
            notes.append(f"{name}: its time begins anew, and is shifted by {late:.6g} s to follow the file before")
        following.append(time + max(late, 0.0))
    return np.concatenate(following)


def _temperatures(states: Sequence[State], names: list[str], notes: list[str]) -> dict[str, Array]:
    """Temperatures of the sensors that all files have."""
    sensors = dict.fromkeys(sensor for state in states for sensor in state.temperatures)
    columns = {
        sensor: _together(f"the temperature {sensor}", [s.temperatures.get(sensor) for s in states], names, notes)
        for sensor in sensors
    }
    return {sensor: column for sensor, column in columns.items() if column is not None}


def _velocity(measurements: Sequence[Measurement], names: list[str]) -> Array | None:
    """Velocities `(n, axes)`, mm/s and rad/s; UserError if rows move in some files and others have no feed."""
    velocities = [m.state.velocity for m in measurements]
    known = [velocity for velocity in velocities if velocity is not None]
    if len(known) == len(velocities):
        return np.concatenate(known)
    if any(velocity.any() for velocity in known):
        missing = ", ".join(name for name, velocity in zip(names, velocities, strict=True) if velocity is None)
        raise UserError(
            f"{missing}: no column feed, while other files have rows in motion: state it (0 where the machine stood)"
        )
    return None


def _actual(measurements: Sequence[Measurement], names: list[str], notes: list[str]) -> Array | None:
    """Read-back positions `(n, axes)`, mm and rad; NaN in files without."""
    if all(m.actual is None for m in measurements):
        return None
    missing = [name for name, m in zip(names, measurements, strict=True) if m.actual is None]
    if missing:
        notes.append(f"no read-back in {', '.join(missing)}")
    return np.concatenate(
        [np.full(m.state.positions.shape, np.nan) if m.actual is None else m.actual for m in measurements]
    )


def _lines(measurements: Sequence[Measurement]) -> np.ndarray:
    """Line numbers `(n,)` in the files; 0 if unknown."""
    return np.concatenate([np.zeros(len(m), int) if m.lines is None else m.lines for m in measurements])
