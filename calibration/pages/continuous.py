"""The report of a joint estimate of continuous and quasi-static runs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from calibration.continuous.estimate import Estimate, OneWay
from calibration.continuous.reading import Data
from calibration.continuous.records import WAYS
from calibration.pages import Section, Table, figure, page
from calibration.pages.fit import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MANY = 4000
"""Most points that are drawn of one kind."""
SIGN = "Measured minus target: positive where the axis goes too far in its positive direction."


def continuous_page(found: Estimate, data: Data, command: str) -> bytes:
    """The report as one HTML file; `command` is the command that made it."""
    rows = found.table()
    lead = f"{', '.join(data.fingerprints)} · {command}"
    verdict = (
        f"Error {rows.error.min():.2f} to {rows.error.max():.2f} um ({found.direction}), standard uncertainty (k=1) "
        f"{rows.u.min():.2f} to {rows.u.max():.2f} um."
    )
    return page(f"Positioning error of axis {data.axis}", lead, list(_sections(found, data)), verdict)


def _sections(found: Estimate, data: Data) -> Iterator[Section]:
    yield Section("Error", f"{SIGN} Band: U (k=2).", figure=_errors(found))
    if found.both:
        yield Section("Reversal", "Forward minus backward. Band: U (k=2).", figure=_reversal(found))
    yield Section(
        "Readings against the estimate",
        "Quasi-static readings inside the segment, less the estimate and the drift of their run.",
        figure=_residuals(found),
    )
    yield Section("Continuous runs", table=_runs(found))
    waves = [
        (WAYS[way], f"{w.period_mm:.4g}", f"{w.u_period_mm:.2g}", f"{w.amplitude_um:.3g}", f"{w.u_amplitude_um:.2g}")
        for way, each in found.ways.items()
        for w in each.waves
    ]
    if waves:
        yield Section(
            "Cyclic errors",
            "In the table already; ncomp diagnose tells which part of the drive has that period.",
            Table(("direction", "period, mm", "u (k=1)", "amplitude, um", "u (k=1)"), waves),
        )
    jumps = [row for way, each in found.ways.items() for row in _jumps(WAYS[way], each)]
    if jumps:
        yield Section("Jumps", "Steps of a compensation table, or a fault.", Table(_JUMP_HEAD, jumps))
    if found.fused.drift:
        yield Section("Drift of the quasi-static runs, against their mean", table=_drift(found))
    notes = (*data.notes, *found.notes)
    if notes:
        yield Section("Notes", "\n".join(notes))


_JUMP_HEAD = ("direction", "position, mm", "size, um", "u (k=1)")


def _jumps(direction: str, each: OneWay) -> Iterator[tuple[str, ...]]:
    jumps = each.jumps
    for x, size, u in list(zip(jumps.places_mm, jumps.sizes_um, jumps.u_um, strict=True))[:50]:
        yield direction, f"{x:.3f}", f"{size:.2f}", f"{u:.2g}"
    if jumps.pitch is not None:
        yield direction, f"every {jumps.pitch[0]:.4g} (u {jumps.pitch[1]:.2g})", "", ""


def _runs(found: Estimate) -> Table:
    rows = [
        (
            course.record.name,
            WAYS[way],
            f"{course.feed:.6g}",
            f"{course.x.min():.3f} to {course.x.max():.3f}",
            str(len(course.raw_x)),
            f"{noise.total:.3g}",
            "; ".join(f"{f:.3g} Hz, {a:.2g} um" for f, a in noise.vibrations),
        )
        for way, each in found.ways.items()
        for course, noise in zip(each.courses, each.noises, strict=True)
    ]
    return Table(("run", "direction", "feed, mm/min", "segment, mm", "samples", "noise, um", "vibrations"), rows)


def _drift(found: Estimate) -> Table:
    rows = [
        (
            drift.run,
            f"{drift.offset_um:.2f}",
            f"{drift.u_offset_um:.2g}",
            f"{drift.slope_um_per_m:.2f}",
            f"{drift.u_slope_um_per_m:.2g}",
        )
        for drift in found.fused.drift
    ]
    return Table(("run", "offset, um", "u (k=1)", "slope, um/m", "u (k=1)"), rows)


def _errors(found: Estimate) -> str:
    """Errors by direction with their uncertainties, and the readings."""
    with figure(9.0, 3.6) as (canvas, drawn):
        place = canvas.subplots()
        directions = [WAYS[way] for way in found.fused.ways]
        for colour, direction in zip(COLOURS, directions, strict=False):
            _curve(place, found, direction, colour)
            way = next(way for way, name in WAYS.items() if name == direction)
            rows = found.quasi.direction == way
            place.plot(
                found.quasi.target[rows],
                found.quasi.deviation[rows],
                "o",
                color=colour,
                markersize=3,
                markerfacecolor="none",
                label=f"readings {direction}",
            )
        place.set_xlabel("position, mm")
        place.set_ylabel("error, um")
        place.legend(frameon=False, loc="best")
    return drawn[0]


def _curve(place: Axes, found: Estimate, direction: str, colour: str) -> None:
    rows = found.table(direction)
    inner = rows.continuous
    x, error, u = rows.position[inner], rows.error[inner], rows.u[inner]
    place.fill_between(x, error - 2 * u, error + 2 * u, color=colour, alpha=0.2, linewidth=0)
    place.plot(x, error, color=colour, linewidth=1, label=direction)


def _reversal(found: Estimate) -> str:
    with figure(9.0, 2.4) as (canvas, drawn):
        place = canvas.subplots()
        values, covariance = found.curve("reversal")
        u = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        x = found.fused.positions
        place.fill_between(x, values - 2 * u, values + 2 * u, color=COLOURS[0], alpha=0.2, linewidth=0)
        place.plot(x, values, color=COLOURS[0], linewidth=1)
        place.set_xlabel("position, mm")
        place.set_ylabel("forward minus backward, um")
    return drawn[0]


def _residuals(found: Estimate) -> str:
    with figure(9.0, 2.4) as (canvas, drawn):
        place = canvas.subplots()
        quasi, residual = found.quasi, found.fused.residual
        for colour, (way, name) in zip(COLOURS, WAYS.items(), strict=False):
            rows = quasi.direction[found.fused.inside] == way
            if rows.any():
                at = quasi.target[found.fused.inside][rows][:MANY]
                place.plot(at, residual[rows][:MANY], "o", color=colour, markersize=3, label=name)
        for sign in (-2.0, 2.0):
            place.axhline(sign * found.fused.spread.noise, color="#888", linewidth=0.6)
        place.set_xlabel("target, mm")
        place.set_ylabel("reading minus estimate, um")
        place.legend(frameon=False)
    return drawn[0]
