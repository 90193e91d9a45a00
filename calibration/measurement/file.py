"""The measurement file: commands to the machine and observations as CSV (contract 4.2)."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

import msgspec
import numpy as np

from calibration.measurement.axis_positions import by_kind
from calibration.measurement.balls.ballbar import (
    BALLBAR,
    CENTRE,
    LENGTH,
    LENGTH_U,
    RADIUS,
    in_runs,
    read_ballbar,
    read_centre,
    read_radius,
)
from calibration.measurement.balls.ballbar import header_lines as bar_lines
from calibration.measurement.balls.touch_probe import (
    READINGS,
    SPHERE,
    SPINDLE,
    SQUARENESS,
    TIP,
    TOUCH_PROBE,
    is_sphere_key,
    read_distances,
    read_observed,
    read_spheres,
    read_squareness,
    readings,
    refuse_plan,
)
from calibration.measurement.balls.touch_probe import header_lines as probe_lines
from calibration.measurement.error_columns import spread
from calibration.measurement.instruments import Ballbar, Instrument, Interferometer, LaserTracker, Part, TouchProbe
from calibration.measurement.measurement import Measurement, in_space, with_moves
from calibration.measurement.states import (
    CARRIERS,
    MADE_BY,
    PLAIN_NAME,
    MeasurementStates,
    allow_columns,
    check_machine,
    is_simulated,
    note_unknown_keys,
    read_states,
    refuse_unstated,
    state_columns,
)
from calibration.measurement.text_table import Table, read_table
from kinematics.effects.base import UM, URAD, own_component
from kinematics.files.mistaken import none_of
from kinematics.forward import tool_point
from kinematics.machine import Machine
from kinematics.state import REFERENCE
from kinematics.transforms import Array
from kinematics.user_error import UserError
from kinematics.version import VERSION

KINDS: dict[str, type[Instrument]] = {
    "laser-tracker": LaserTracker,
    "interferometer": Interferometer,
    "part": Part,
    TOUCH_PROBE: TouchProbe,
    BALLBAR: Ballbar,
}
OBSERVED = {
    "laser-tracker": ["x", "y", "z"],
    "interferometer": ["axis", "component", "direction", "target_mm", "target_deg", "deviation_um", "deviation_urad"],
    "part": ["nominal_x", "nominal_y", "nominal_z", "x", "y", "z"],
    TOUCH_PROBE: [SPHERE, *READINGS],
    BALLBAR: [RADIUS],
}
"""Columns of the observations, in addition to those of the state."""
NEEDED = {
    "laser-tracker": (("u_range_um", "u_range_um_per_m"), ("u_angle_um", "u_angle_um_per_m")),
    "interferometer": (("u_um",),),
    "part": (("u_um",),),
    TOUCH_PROBE: (("u_um",),),
    BALLBAR: (("u_um",),),
}
"""Groups of uncertainties, of which at least one must be above zero; otherwise an observation had infinite weight."""
KEYS = {
    "laser-tracker": ["stands_on"],
    "interferometer": [],
    "part": ["part_offset"],
    TOUCH_PROBE: [TIP, SPINDLE, SQUARENESS],
    BALLBAR: [CENTRE, LENGTH, LENGTH_U],
}
CHUNK = 50_000
"""Number of rows converted to text at a time."""


def read_measurement(path: Path, machine: Machine) -> Measurement:
    """The measurement in a file; UserError with line and column for a value that cannot be used."""
    return measurement_of(read_table(path, "measurement file"), machine)


def measurement_of(table: Table, machine: Machine) -> Measurement:
    """The measurement in a table of the contract's columns."""
    notes: list[str] = []
    kind = _kind(table)
    if kind == "interferometer":
        table = spread(table, machine)
    check_machine(table, machine, notes)
    of_probe = kind == TOUCH_PROBE
    if of_probe:
        refuse_plan(table)
    instrument = read_instrument(table)
    keys = ["machine", "instrument", *uncertainty_keys(KINDS[kind]), *KEYS[kind]]
    note_unknown_keys(table, lambda key: key in keys or (of_probe and is_sphere_key(key)), notes)
    own = ["scatter_um"] if kind == "laser-tracker" else []
    allow_columns(table, [*OBSERVED[kind], *state_columns(machine), *own])
    if kind == "interferometer":
        table.need_columns(["axis", "run", "direction"], "an interferometer")
    spheres = read_spheres(table) if of_probe else read_centre(table) if kind == BALLBAR else {}
    distances = read_distances(table, spheres) if of_probe else ()
    states = read_states(table, machine, notes)
    _check_component_uncertainties(table, instrument, states)
    observed = _observed(table, machine, kind, states)
    if kind != "laser-tracker":
        refuse_unstated(table, states.targets, kind)
    if kind != "laser-tracker" and not all(target.known for target in states.targets.values()):
        raise UserError(
            f"{table.source}: only a laser tracker can have targets on the table or on the bed, but the instrument is "
            f"{kind}"
        )
    return Measurement(
        machine,
        instrument,
        replace(states.state, observed=in_space(observed)),
        observed,
        states.targets,
        states.stands_on,
        states.axis,
        states.run,
        states.actual,
        states.feed,
        states.part_zero,
        table.lines,
        table.source,
        table.fingerprint,
        tuple(notes),
        component=states.component,
        scatter=_scatter(table),
        spheres=spheres,
        distances=distances,
        simulated=is_simulated(table),
    )


def write_measurement(measurement: Measurement, file: BinaryIO, origin: str = "") -> None:
    """Write the measurement; reading it gives the same measurement, with last moves from the order of rows.

    origin: of the data, for the header line `made_by`.
    """
    text = io.TextIOWrapper(file, encoding="utf-8", newline="")
    for line in (*header_lines(measurement), f"{MADE_BY}: ncomp {VERSION}{origin}"):
        text.write(f"# {line}\n")
    columns = _columns(measurement)
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for start in range(0, len(measurement), CHUNK):
        part = [column[start : start + CHUNK] for column in columns.values()]
        writer.writerows(zip(*map(_texts, part), strict=True))
    text.flush()
    text.detach()


# ---- reading


def _kind(table: Table) -> str:
    if "instrument" not in table.entries:
        plan = ": this is a plan, not its measurement" if "strategy" in table.entries else ""
        raise UserError(f"{table.source}{plan}: header line '# instrument: {' | '.join(KINDS)}' is missing")
    kind = table.entries["instrument"].value
    if kind not in KINDS:
        table.header_fault("instrument", none_of(kind, KINDS))
    return kind


LARGEST_U = 1e6
"""Largest accepted standard uncertainty of an instrument, um or um/m: a metre."""


def uncertainty_keys(kind: type[Instrument]) -> list[str]:
    """Header keys of an instrument's standard uncertainties."""
    return [field.name for field in msgspec.structs.fields(kind) if field.name.startswith("u_")]


def check_uncertainties(kind: str, values: Mapping[str, float], where: str, how: str) -> None:
    """UserError unless an instrument's standard uncertainties, by header key, give its observations a finite weight.

    The message begins with `where` and ends with `how`, in which a key is inserted.
    """
    for group in NEEDED[kind]:
        if not any(values.get(key) for key in group):
            raise UserError(
                f"{where}: the standard uncertainty (k=1) of the {kind} is missing: "
                f"state {' or '.join(group)} above zero ({how.format(group[0])})"
            )


def read_instrument(table: Table) -> Instrument:
    """The instrument with its uncertainties; UserError if the file does not give them."""
    kind = _kind(table)
    values: dict[str, float] = {}
    for key in uncertainty_keys(KINDS[kind]):
        if key in table.entries:
            (values[key],) = table.header_numbers(key, 1)
            if values[key] < 0:
                table.header_fault(key, f"{values[key]:g} is negative: expected 0 or more")
            if values[key] > LARGEST_U:
                table.header_fault(key, f"{values[key]:g} is more than {LARGEST_U:g}: this is not an uncertainty")
    if "component" not in table.names:
        check_uncertainties(kind, values, table.source, "header line '# {}: ...'")
    components = {} if kind != "part" else {"components": 3 if "z" in table.names else 2}
    own = read_ballbar(table) if kind == BALLBAR else {}
    own |= read_squareness(table) if kind == TOUCH_PROBE else {}
    instrument: Instrument = msgspec.convert({"kind": kind, **values, **components, **own}, Instrument)
    return instrument


def _check_component_uncertainties(table: Table, instrument: Instrument, states: MeasurementStates) -> None:
    """UserError for observed error motions without a given uncertainty."""
    if not isinstance(instrument, Interferometer) or states.component is None or states.axis is None:
        return
    own = np.array([own_component(name) for name in states.axis.tolist()])
    positioning, angular = (states.component == "") | (states.component == own), np.isin(states.component, list("ABC"))
    across = instrument.u_straightness_um + instrument.u_straightness_um_per_m
    for rows, u, key, quantity in (
        (positioning, instrument.u_um, "u_um", "positioning"),
        (~positioning & angular, instrument.u_angle_urad, "u_angle_urad", "angles"),
        (~positioning & ~angular, across, "u_straightness_um", "straightness"),
    ):
        if rows.any() and not u:
            raise UserError(
                f"{table.source}: the standard uncertainty (k=1) of {quantity} is missing: state {key} above zero "
                f"(header line '# {key}: ...')"
            )


def _observed(table: Table, machine: Machine, kind: str, states: MeasurementStates) -> Array:
    """Observations `(n, components)`, mm; rad for angles."""
    if kind == "interferometer":
        assert states.axis is not None
        rotary = np.isin(states.axis, [axis.name for axis in machine.axes if axis.rotary])
        angular = None if states.component is None else rotary | np.isin(states.component, list("ABC"))
        sizes = np.where(rotary if angular is None else angular, URAD, UM)
        return (by_kind(table, machine, "deviation_um", "deviation_urad", angular) * sizes)[:, None]
    if kind == TOUCH_PROBE:
        return read_observed(table, machine, states.state.positions)
    if kind == BALLBAR:
        return read_radius(table)
    points = ["x", "y", "z"] if kind == "laser-tracker" or "z" in table.names else ["x", "y"]
    table.need_columns(points, kind)
    if kind == "part":
        table.need_columns([f"nominal_{letter}" for letter in points], kind)
    return np.stack(list(table.numbers(points).values()), axis=1)


def _scatter(table: Table) -> Array | None:
    """Standard uncertainties `(n,)`, mm, of the means in the rows; None without the column."""
    if "scatter_um" not in table.names:
        return None
    column = table.numbers(["scatter_um"])["scatter_um"]
    if np.any(column < 0.0):
        table.fault(int(np.argmax(column < 0.0)), "scatter_um", "below 0")
    if np.any(column > LARGEST_U):
        table.fault(int(np.argmax(column > LARGEST_U)), "scatter_um", f"more than {LARGEST_U:g}, and no uncertainty")
    return column * UM


# ---- writing


def header_lines(measurement: Measurement) -> Iterator[str]:
    """Header lines, without `# `."""
    instrument = measurement.instrument
    kind = next(name for name, kind in KINDS.items() if isinstance(instrument, kind))
    yield f"machine: {measurement.machine.name}"
    yield f"instrument: {kind}"
    for name in uncertainty_keys(type(instrument)):
        yield f"{name}: {getattr(instrument, name)!r}"
    if kind == "laser-tracker":
        yield f"stands_on: {measurement.stands_on}"
    if kind == "part":
        yield f"part_offset: {_numbers(measurement.part_zero)}"
    if isinstance(instrument, TouchProbe):
        placed = measurement.targets[TIP], measurement.spheres, measurement.distances
        yield from probe_lines(*placed, instrument.squareness_urad)
        return
    if isinstance(instrument, Ballbar):
        yield from bar_lines(measurement, instrument)
    keys = {carrier: key for key, carrier in CARRIERS.items()}
    for name, target in measurement.targets.items():
        if not PLAIN_NAME.fullmatch(name):
            raise UserError(f"target {name!r}: its name must not contain blanks, commas or colons")
        if not target.free:
            yield f"{keys[target.carrier]}.{name}: {_numbers(target.position)}"


def _columns(measurement: Measurement) -> dict[str, np.ndarray]:
    """The columns of the file, in its units."""
    machine, state, instrument = measurement.machine, measurement.state, measurement.instrument
    columns: dict[str, np.ndarray | None] = {"time_s": state.time}
    for i, name in enumerate(machine.names):
        columns[name] = _in_units(state.positions[:, i], machine.scale[i])
    columns |= _directions(measurement)
    of_probe = isinstance(instrument, TouchProbe)
    named = {SPHERE: state.station} if of_probe else {"target": state.target, "station": state.station}
    columns |= {**named, "run": measurement.run}
    if of_probe:
        columns |= readings(machine, state.positions, measurement.observed)
    elif isinstance(instrument, Ballbar):
        columns[RADIUS] = measurement.observed[:, 0]
    elif isinstance(instrument, Interferometer):
        columns |= _deviations(measurement)
    else:
        if isinstance(instrument, Part):
            nominal = tool_point(machine, state.positions, measurement.tool) - measurement.part_zero
            columns |= {f"nominal_{xyz}": nominal[:, i] for i, xyz in enumerate("xyz"[: instrument.components])}
        columns |= {xyz: measurement.observed[:, i] for i, xyz in enumerate("xyz"[: instrument.components])}
    if measurement.scatter is not None:
        columns["scatter_um"] = _in_units(measurement.scatter, UM)
    columns |= {"feed": measurement.feed, "spindle_rpm": state.spindle_speed}
    if measurement.actual is not None:
        for i in np.flatnonzero(~np.isnan(measurement.actual).any(axis=0)).tolist():
            columns[f"actual_{machine.names[i]}"] = _in_units(measurement.actual[:, i], machine.scale[i])
    for sensor, kelvin in state.temperatures.items():
        columns[f"temp_{sensor}"] = _written(kelvin, lambda k: k + REFERENCE, lambda degrees: degrees - REFERENCE)
    return {name: column for name, column in columns.items() if column is not None}


def _directions(measurement: Measurement) -> dict[str, np.ndarray]:
    """Columns dir_X ..., unless the order of the rows gives the same (for a part it gives no direction)."""
    state = measurement.state
    if state.approach is None:
        return {}
    from_order = (in_runs if isinstance(measurement.instrument, Ballbar) else with_moves)(state).approach
    assert from_order is not None
    if not isinstance(measurement.instrument, Part) and np.array_equal(state.approach, from_order):
        return {}
    signs = state.approach.astype(int)
    return {f"dir_{name}": signs[:, i] for i, name in enumerate(measurement.machine.names)}


def _deviations(measurement: Measurement) -> dict[str, np.ndarray]:
    """Columns of an interferometer; separate columns for linear and rotary axes, empty in the rows of the others."""
    machine, state = measurement.machine, measurement.state
    assert measurement.axis is not None
    assert state.approach is not None
    own = np.arange(len(measurement)), np.array([machine.index(name) for name in measurement.axis.tolist()])
    columns = {"axis": measurement.axis, "direction": state.approach[own].astype(int)}
    if measurement.component is not None:
        columns["component"] = measurement.component
    turns, angular = machine.rotary[own[1]], measurement.angular
    for rows, scale, unit in ((~turns, 1.0, "mm"), (turns, np.pi / 180.0, "deg")):
        if rows.any():
            columns[f"target_{unit}"] = _only(rows, _in_units(state.positions[own], scale))
    for rows, size, unit in ((~angular, UM, "um"), (angular, URAD, "urad")):
        if rows.any():
            columns[f"deviation_{unit}"] = _only(rows, _in_units(measurement.observed[:, 0], size))
    return columns


def _only(rows: np.ndarray, column: Array) -> np.ndarray:
    """The column as texts, empty in other rows."""
    return np.where(rows, _texts(column), "")


def _in_units(column: Array, size: float) -> Array:
    """Numbers in units of `size` that give the same values when read, with few digits if possible."""
    return _written(column, lambda inside: inside / size, lambda outside: outside * size)


def _written(column: Array, out: Callable[[Array], Array], back: Callable[[Array], Array]) -> Array:
    exact = out(column)
    result = exact
    for candidate in (np.nextafter(exact, np.inf), np.nextafter(exact, -np.inf), exact, np.round(exact, 9)):
        result = np.where(back(candidate) == column, candidate, result)
    return result


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(f"{value!r}" for value in values)


def _texts(column: np.ndarray) -> list[str]:
    return list(map(str, column.tolist()))
