"""The report of a drift: where it is, which sensors it follows, how far the readings allow it to be known."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from calibration.following.drift import Drift
from calibration.following.followed import Place
from kinematics.effects import Effect
from kinematics.effects.base import HOUR
from kinematics.files.number_text import plus_minus
from kinematics.files.report_head import ReportHead
from rendering.figures import COLOURS, Figure, Panel, bars_of_error, grid
from rendering.report import Report, Section, Table


def drift_json(found: Drift) -> dict[str, Any]:
    """The result for programs; um and urad, U with k = 2."""
    estimate, structure = found.estimate, found.followed.structure
    each = zip(
        estimate.effects, np.sqrt(np.diag(estimate.covariance)).tolist(), estimate.by_sensors.tolist(), strict=True
    )
    walk = np.sqrt(structure.sizes.walk[0]).tolist()
    return {
        "corrected": estimate.significant, "largest_um": estimate.largest, "U_um": estimate.U,
        "age_s": estimate.age_s,
        "parameters": [
            {
                "name": _name(effect), "value": effect.parameters[0], "U": 2.0 * u, "unit": _unit(effect),
                "by_sensors": part, "by_walk": effect.parameters[0] - part, "walk_in_one_hour": step,
            }
            for (effect, u, part), step in zip(each, walk, strict=True)
        ],
        "sensors": [
            {
                "parameter": _name(estimate.effects[term.parameter]), "sensor": term.sensor, "lag_s": term.lag_s,
                "per_K": value, "U_per_K": 2.0 * u, "log10_odds": term.log_odds / float(np.log(10.0)),
            }
            for term, (value, u) in zip(structure.terms, found.followed.coefficients(), strict=True)
        ],
        "places": [
            {
                "name": place.name, "drift_um": place.drift.tolist(),
                "U_um": [2.0 * u if np.isfinite(u) else None for u in place.u.tolist()],
            }
            for place in estimate.places
        ],
        "scatter_um": float(np.sqrt(structure.sizes.scatter[0])),
        "implausible": [
            {"line": line, "log10_odds": odds / float(np.log(10.0))} for line, odds in _implausible(found)
        ],
        "learned_with": [each._asdict() for each in found.followed.learned],
    }  # fmt: skip


def drift_verdict(found: Drift) -> str:
    """The result in sentences."""
    estimate = found.estimate
    place = max(estimate.places, key=lambda each: float(np.abs(np.where(np.isfinite(each.u), each.drift, 0.0)).max()))
    lines = [f"The machine has drifted by {_vector(place)} um (U, k=2) at {place.name}, tool relative to workpiece."]
    if not estimate.significant:
        cure = " Touch the sphere again." if estimate.age_s else ""
        lines = [
            f"The drift, {estimate.largest:.1f} um, is less than its uncertainty, {estimate.U:.1f} um (U, k=2), "
            f"{estimate.age_s / HOUR:.1f} h after the last reading: nothing is corrected.{cure}"
        ]
    for line, odds in _implausible(found):
        power = min(odds / float(np.log(10.0)), 6.0)
        lines.append(
            f"The reading in line {line} is implausible (odds {'above ' * (power == 6.0)}{10**power:.0f} to 1), and is "
            "left out: touch the sphere again."
        )
    lines += _learned(found)
    return "\n".join(lines)


def _learned(found: Drift) -> Iterator[str]:
    """Where walk, scatter and dependences are known from, beside the log."""
    learned = found.followed.learned
    if used := [f"{each.source} ({each.readings} readings)" for each in learned if each.readings]:
        yield f"Walk, scatter and sensors were learned from this log and from {', '.join(used)}."
    yield from (f"Nothing was learned from {each.source}: {each.reason}." for each in learned if each.reason)


def drift_report(found: Drift, lead: str, head: ReportHead) -> Report:
    """The result for people."""
    return Report("Drift of a machine", lead, list(_sections(found)), drift_verdict(found), head=head)


def _sections(found: Drift) -> Iterator[Section]:
    results = drift_json(found)
    rows = [
        (
            each["name"], f"{plus_minus(each['value'], each['U'], 1, '+')} {each['unit']}",
            f"{each['by_sensors']:+.1f}", f"{each['by_walk']:+.1f}", f"{each['walk_in_one_hour']:.2f}",
        )
        for each in results["parameters"]
    ]  # fmt: skip
    head = ("parameter", "drift, U (k=2)", "by sensors", "by walk", "walk in 1 h")
    yield Section("Parameters", "", Table(head, rows))
    rows_of_sensors = [
        (
            each["parameter"], each["sensor"], f"{each['lag_s'] / 60.0:.0f} min",
            plus_minus(each["per_K"], each["U_per_K"], 2, "+"), f"10^{each['log10_odds']:.0f}",
        )
        for each in results["sensors"]
    ]  # fmt: skip
    useless = sorted(set(found.followed.measurement.temperatures) - {each["sensor"] for each in results["sensors"]})
    text = f"No parameter follows {', '.join(useless)}." if useless else ""
    if rows_of_sensors or useless:
        head = ("parameter", "sensor", "lag", "per K, U (k=2)", "odds")
        yield Section("Sensors", text, Table(head, rows_of_sensors) if rows_of_sensors else None)
    places = [(place.name, _vector(place)) for place in found.estimate.places]
    yield Section("Places", "", Table(("sphere and rotary axes", "drift in x, y, z, um, U (k=2)"), places))
    yield Section(
        "Readings", "Deviations of the tool from the first reading of each place.", figure=partial(_figure, found)
    )


def _figure(found: Drift) -> Figure:
    return grid([_panel(found, k) for k in range(3)], 1)


def _panel(found: Drift, k: int) -> Panel:
    """The readings of all places in one direction."""
    touches = found.followed.structure.touches
    panel = Panel("time, h", f"{'xyz'[k]}, um", "xyz"[k])
    u = np.sqrt(touches.covariances[:, k, k] + found.followed.structure.sizes.scatter[0])
    for number, place in enumerate(found.estimate.places):
        own = touches.places == place.number
        if np.isfinite(place.u[k]):
            values, times = touches.values[own, k] - touches.values[own, k][0], found.followed.times[own] / HOUR
            bars_of_error(panel, times, values, 2.0 * u[own], COLOURS[number % len(COLOURS)], place.name, size=4)
    return panel


def _name(effect: Effect) -> str:
    """E_X0X, zero of X; scale of X."""
    return effect.line_name or f"{effect.name.removeprefix(f'{effect.kind} ')}, {effect.meaning}"


def _unit(effect: Effect) -> str:
    return effect.quantities()[0].unit


def _vector(place: Place) -> str:
    """The drift in the directions that a feature shows."""
    parts = zip("XYZ", place.drift.tolist(), place.u.tolist(), strict=True)
    return ", ".join(f"{name} {plus_minus(value, 2.0 * u, 1, '+')}" for name, value, u in parts if np.isfinite(u))


def _implausible(found: Drift) -> Iterator[tuple[int, float]]:
    """Line and log odds of the readings that are left out."""
    lines = found.followed.measurement.lines
    for each in found.followed.implausible:
        yield each.row + 1 if lines is None else int(lines[each.row]), each.log_odds
