"""Views of a cause: the reading of each row over the variable that the cause depends on.

A row's reading of one error component is the value of the fitted cause plus the residual, both along the component's
own direction: value + a.e / a.a, with a the whitened derivative of the observation by the component and e the whitened
residual. Its standard uncertainty is 1 / |a|.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from calibration.diagnosis.conclusion.fitted_rows import FittedRows
from calibration.reports.causes.view import BLUNT, IN_ORDER, CauseInFit, Curve, View, lined, motions_of
from kinematics.effects import COMPONENTS, INSTRUMENT, UM, URAD, Effect, unit_of
from kinematics.effects.base import own_motion
from kinematics.effects.combined.where import beam, workpiece_direction
from kinematics.effects.friction import way_since_reversal
from kinematics.effects.probe import turn_of_probe
from kinematics.effects.tracker import CIRCLES
from kinematics.state import REFERENCE_DEGC, TIME, State
from kinematics.transforms import Array
from rendering.figures import clock

DENSE = 400
"""Points of a curve."""


def views(data: FittedRows, effect: Effect) -> list[View]:
    """The panels of a cause with its size, beside the residuals that it and all others leave."""
    return list(VIEWS[effect.SHOWN_OVER](CauseInFit(data, effect)))


def _by_row(cause: CauseInFit) -> Iterator[View]:
    yield from cause.over(np.arange(len(cause.data.good), dtype=float), IN_ORDER)


def _by_direction(cause: CauseInFit) -> Iterator[View]:
    yield from _in_both_directions(cause, cause.position(cause.effect.axis), cause.label(cause.effect.axis))


def _by_way(cause: CauseInFit) -> Iterator[View]:
    """Over the distance since the last reversal; rows before the first reversal count as behind the longest."""
    measurement, effect = cause.data.measurement, cause.effect
    way = way_since_reversal(measurement.machine, measurement.state, effect.axis, effect.name)
    way = np.minimum(way, way[np.isfinite(way)].max(initial=0.0))
    unit = measurement.machine.axes[measurement.machine.index(effect.axis)].unit
    yield from _in_both_directions(cause, way, f"way of {effect.axis} since its last reversal, {unit}")


def _in_both_directions(cause: CauseInFit, x: Array, label: str) -> Iterator[View]:
    """Rows forward and backward in colours of their own, each with the line of the fitted cause."""
    side = cause.of_axis("approach")
    groups = (("forward", side > 0), ("backward", side < 0))
    for view in cause.over(x, label):
        curves = []
        for number, (_, group) in enumerate(groups):
            order = np.argsort(view.x[group])
            curves.append(Curve(view.x[group][order], view.fitted[group][order], number))
        yield replace(view, groups=groups, curves=tuple(curves))


def _by_position(cause: CauseInFit) -> Iterator[View]:
    x = cause.position(cause.effect.axis)
    for view in cause.over(x, cause.label(cause.effect.axis)):
        yield replace(view, curves=(_course(cause, view, np.linspace(x.min(), x.max(), DENSE)),))


def _course(cause: CauseInFit, view: View, x: Array) -> Curve:
    """Curve along its axis of a cause that depends on positions alone, in the component of the view."""
    machine = cause.data.measurement.machine
    positions = np.zeros((len(x), len(machine.axes)))
    i = machine.index(cause.effect.axis)
    positions[:, i] = x * machine.scale[i]
    for (acts_at, component), values in motions_of(cause.effect, State(positions), machine).items():
        if cause._title(acts_at, component) == view.title:
            return Curve(x, values / unit_of(COMPONENTS[component])[1])
    raise KeyError(view.title)


def _folded(cause: CauseInFit) -> Iterator[View]:
    effect = cause.effect
    period = getattr(effect, "period", None) or effect.pitch
    start = getattr(effect, "offset", 0.0)
    label = f"{cause.label(effect.axis)}, folded at {period:.5g}"
    phases = np.linspace(0.0, period, DENSE, endpoint=False)
    for view in cause.over((cause.position(effect.axis) - start) % period, label):
        yield replace(view, curves=(Curve(phases, _course(cause, view, start + phases).y),))


def _by_velocity(cause: CauseInFit) -> Iterator[View]:
    machine = cause.data.measurement.machine
    own = getattr(cause.effect, "axis", "")
    velocity = cause.state.need("velocity", cause.effect.name)
    for i, name in enumerate(machine.names):
        speed = velocity[:, i] / machine.scale[i]
        if np.ptp(speed) > 0 and own in ("", name):
            unit = machine.axes[i].unit
            for view in cause.over(speed, f"velocity of {name}, {unit}/s"):
                if view.title.endswith(name):
                    yield view if getattr(cause.effect, "compliance_ms2", None) else lined(view)


def _by_last_move(cause: CauseInFit) -> Iterator[View]:
    machine = cause.data.measurement.machine
    move = cause.of_axis("last_move") / machine.scale[machine.index(cause.effect.axis)]
    yield from map(lined, cause.over(move, f"last move of {cause.label(cause.effect.axis)}"))


def _by_cycle(cause: CauseInFit) -> Iterator[View]:
    yield from map(lined, cause.over(cause.state.need("cycle", cause.effect.name), "cycle"))


def _drive_of_heat(cause: CauseInFit) -> tuple[Array, str]:
    """Time, or the temperature where the cause follows it without lag."""
    sensor = getattr(cause.effect, "sensor", None)
    if sensor is None or getattr(cause.effect, "lag_s", None):
        return cause.time()
    return cause.state.temperature(sensor, cause.effect.name) + REFERENCE_DEGC, f"temperature {sensor}, degC"


def _by_heat(cause: CauseInFit) -> Iterator[View]:
    yield from map(lined, cause.over(*_drive_of_heat(cause)))


def _of_workpiece(cause: CauseInFit) -> Iterator[View]:
    """Along the drift's own direction, which turns with the workpiece in the frame of the axis that carries it."""
    letter = cause.effect.component
    direction = workpiece_direction(cause.data.measurement.machine, cause.state, letter)
    motions = motions_of(cause.effect, cause.state, cause.data.measurement.machine)
    values = sum(row * direction[:, k] for (_, k), row in motions.items())
    arm = (cause.data.transform[:, :, :3] @ direction[:, :, None])[:, :, 0]
    title = f"workpiece {letter}"
    yield lined(cause.along(arm, np.asarray(values), UM, (title, f"{title}, um"), _drive_of_heat(cause)))


def _growth(cause: CauseInFit) -> Iterator[View]:
    """Growth per metre of distance from the fixed point; rows near it are not shown."""
    axis = cause.effect.axis
    forward = own_motion(cause.data.measurement.machine, axis)[2]
    metres = forward * (cause.position(axis) - cause.effect.fixed_point) * 1e-3
    far = np.abs(metres) > np.median(np.abs(metres)) / BLUNT
    per = np.where(far, metres, 1.0)
    for view in cause.over(*_drive_of_heat(cause)):
        u = np.where(far, view.u / np.abs(per), np.inf)
        grown = replace(view, title=f"scale of {axis}", y=view.y / per, u=u, fitted=view.fitted / per)
        marked = np.flatnonzero(far)
        order = marked[np.argsort(view.x[marked], kind="stable")]
        yield replace(grown, y_label=f"scale of {axis}, um/m", curves=(Curve(view.x[order], grown.fitted[order]),))


def _distortion(cause: CauseInFit) -> Iterator[View]:
    """A map over time or temperature and the position."""
    axis = cause.effect.axis
    for view in cause.over(*_drive_of_heat(cause)):
        yield replace(view, over=cause.position(axis), over_label=cause.label(axis))


def _over_position(cause: CauseInFit) -> Iterator[View]:
    """Row by row over the position of its axis, since other variables count too."""
    yield from cause.over(cause.position(cause.effect.axis), cause.label(cause.effect.axis))


def _over_coordinate(cause: CauseInFit) -> Iterator[View]:
    """Over the coordinate of the measuring machine that the error grows with."""
    letter = getattr(cause.effect, "direction", "") or cause.effect.plane[1]
    column = cause.state.need("observed", cause.effect.name)[:, "xyz".index(letter)]
    yield from map(lined, cause.over(column, f"measured {letter}, mm"))


def _map(cause: CauseInFit) -> Iterator[View]:
    axis, other = cause.effect.axis, cause.effect.other
    for view in cause.over(cause.position(axis), cause.label(axis)):
        yield replace(view, over=cause.position(other), over_label=cause.label(other))


def _of_table(cause: CauseInFit) -> Iterator[View]:
    first, *second = cause.effect.of
    for view in cause.over(cause.position(first), cause.label(first)):
        yield replace(view, over=cause.position(second[0]), over_label=cause.label(second[0])) if second else view


def _by_variable(cause: CauseInFit) -> Iterator[View]:
    """A panel for each variable."""
    machine, effect = cause.data.measurement.machine, cause.effect
    for name in effect.variables:
        x, label = cause.state.variable(machine, name, effect.name), f"{name}, degC"
        if name in machine.names:
            label = cause.label(name)
        elif name == TIME:
            x, label = cause.time()
        else:
            x = x + REFERENCE_DEGC
        views = cause.over(x, label)
        yield from map(lined, views) if len(effect.variables) == 1 else views


def _by_time(cause: CauseInFit) -> Iterator[View]:
    since = cause.effect.moment
    if cause.state.time is None:
        yield from _by_row(cause)
        return
    unit, _ = clock(cause.state.time)
    for view in cause.over(*cause.time()):
        yield view if since is None else replace(view, moment=since / unit)


def _by_target(cause: CauseInFit) -> Iterator[View]:
    if cause.effect.since_s is not None:
        yield from _by_time(cause)
        return
    names, number = np.unique(cause.state.need("target", cause.effect.name), return_inverse=True)
    for view in cause.over(number.astype(float), "target"):
        yield replace(lined(view), ticks=tuple(map(str, names.tolist())))


def _by_angle(cause: CauseInFit) -> Iterator[View]:
    effect = cause.effect
    x, y, z = cause.state.need("observed", effect.name).T
    angle = np.arctan2(y, x) if effect.circle == "azimuth" else np.arctan2(z, np.hypot(x, y))
    sin, cos = np.sin(effect.harmonic * angle), np.cos(effect.harmonic * angle)
    arm = _beam_columns(cause) @ np.stack([sin, cos], axis=1)[:, :, None] / URAD
    values = (effect.sine_urad * sin + effect.cosine_urad * cos) * URAD
    title = f"{effect.circle} reading", f"{effect.circle} reading, urad"
    yield lined(
        cause.along(_white(cause, arm[:, :, 0]), values, URAD, title, (np.degrees(angle), f"{effect.circle}, deg"))
    )


def _over_angle(cause: CauseInFit) -> Iterator[View]:
    effect = cause.effect
    _, *arms, angles = beam(cause.state.need("observed", effect.name))
    here = np.linalg.norm(_beam_columns(cause)[:, :, 0], axis=1) > 0.0
    title = f"{effect.circle} reading", f"{effect.circle} reading, urad"
    over = np.degrees(angles[:, CIRCLES.index(effect.over)]), f"{effect.over}, deg"
    arm = _white(cause, arms[CIRCLES.index(effect.circle)])
    yield cause.along(arm, effect.step_urad * URAD * here, URAD, title, over)


def _by_range(cause: CauseInFit) -> Iterator[View]:
    observed = cause.state.need("observed", cause.effect.name)
    length = np.linalg.norm(observed, axis=1)
    column = np.linalg.norm(_beam_columns(cause)[:, :, 0], axis=1)
    arm = _white(cause, observed / length[:, None])
    values = column * cause.effect.parameters[0]
    yield lined(cause.along(arm, values, UM, ("range", "range, um"), (length * 1e-3, "range, m")))


def _by_turn_of_probe(cause: CauseInFit) -> Iterator[View]:
    turn = turn_of_probe(cause.data.measurement.machine, cause.state)
    yield from map(lined, cause.over(np.degrees(turn), "turn of the probe about its axis, deg"))


def _beam_columns(cause: CauseInFit) -> Array:
    """Derivatives `(n, 3, parameters)` of the observed point by an instrument's parameters, mm."""
    made = {c.component: c.values for c in cause.effect.columns(cause.data.measurement.machine, cause.state)}
    return np.stack([made[k] for k in range(3)], axis=1)


def _white(cause: CauseInFit, vectors: Array) -> Array:
    """Vectors `(n, 3)` of the instrument's frame, whitened."""
    at = 6 * (len(cause.data.measurement.machine.axes) + 2 + INSTRUMENT)
    return np.asarray((cause.data.transform[:, :, at : at + 3] @ vectors[:, :, None])[:, :, 0])


def _outliers(cause: CauseInFit) -> Iterator[View]:
    """Sizes of the residuals of all rows, the outliers in a colour of their own."""
    sizes = np.linalg.norm(cause.data.residual, axis=1)
    rows = np.arange(len(sizes))
    astray = np.isin(rows, cause.effect.rows)
    groups = (("all others", ~astray), ("outliers", astray))
    label, one = "residual / standard uncertainty", np.ones(len(rows))
    yield View("residuals", rows.astype(float), sizes, one, sizes, IN_ORDER, label, groups, means=False)


VIEWS: Mapping[str, Callable[[CauseInFit], Iterator[View]]] = {
    "angle": _by_angle,
    "angle of a step": _over_angle,
    "coordinate": _over_coordinate,
    "cycle": _by_cycle,
    "distance since reversal": _by_way,
    "heat": _by_heat,
    "heat along the workpiece": _of_workpiece,
    "heat and position": _distortion,
    "heat per metre": _growth,
    "last move": _by_last_move,
    "period": _folded,
    "position": _by_position,
    "position by direction": _by_direction,
    "range": _by_range,
    "rows": _by_row,
    "rows over position": _over_position,
    "size of the residual": _outliers,
    "table": _of_table,
    "target": _by_target,
    "time": _by_time,
    "turn of the probe": _by_turn_of_probe,
    "two axes": _map,
    "variables": _by_variable,
    "velocity": _by_velocity,
}
"""Views by the variable over which an effect is drawn, its `SHOWN_OVER`."""
