"""Results of a joint estimate of continuous and quasi-static runs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

import numpy as np

from calibration.continuous.estimate import Estimate, OneDirection, Wave
from calibration.continuous.reading import Data
from calibration.continuous.records import DIRECTION_NAMES
from calibration.reports.head import instrument_text
from kinematics.files.number_text import plus_minus, uncertainty
from kinematics.files.report_head import ReportHead
from kinematics.transforms import Array
from rendering.figures import COLOURS, MOST_DRAWN_POINTS, Figure, Panel, band, dots, level, some
from rendering.report import Report, Section, Table, facts

LISTED_FEATURES = 50
"""Most listed jumps of one direction, and most waves; the JSON has all."""
DRAWN_CURVE_POINTS = 2000
"""Most points of a curve."""
HARMONIC_DEVIATION = 2e-3
"""Largest relative deviation of a harmonic from a multiple of the basic frequency."""
SIGN = "Measured minus target: positive where the axis goes too far in its positive direction."
HINT = "ncomp diagnose, with the quasi-static data or a finer run of targets, finds the cause in the drive."


def continuous_json(found: Estimate, data: Data) -> dict[str, Any]:
    """All results, with units in the names; uncertainties are standard ones (k = 1)."""
    rows = found.table()
    return {
        "axis": data.axis,
        "direction": found.direction,
        "segment_mm": list(found.segment),
        "rows": len(rows.position),
        "error_um": {"min": float(rows.error.min()), "max": float(rows.error.max())},
        "u_um": {"min": float(rows.u.min()), "max": float(rows.u.max())},
        "continuous": list(_runs_json(found)),
        "quasi_static": _quasi_static_json(found),
        "reversal": _reversal(found),
        "shape": {DIRECTION_NAMES[sign]: _shape_json(each) for sign, each in found.by_direction.items()},
        "cyclic": [
            {"direction": DIRECTION_NAMES[sign], **wave._asdict()}
            for sign, each in found.by_direction.items()
            for wave in each.waves
        ],
        "jumps": [
            {"direction": DIRECTION_NAMES[sign], **_jumps_json(each)}
            for sign, each in found.by_direction.items()
            if each.jumps.positions_mm
        ],
        "methods_minus_ours_rms_um": {
            name: {method: _rms(off) for method, off in _differences(found, name).items()} for name in found.comparisons
        },
        "table": {
            "position_mm": rows.position.tolist(),
            "error_um": rows.error.tolist(),
            "u_um": rows.u.tolist(),
            "continuous": rows.continuous.tolist(),
        },
        "notes": [*data.notes, *found.notes],
        "inputs": dict(data.fingerprints),
    }


def _runs_json(found: Estimate) -> Iterator[dict[str, Any]]:
    """The runs in motion."""
    for each in found.by_direction.values():
        for course, noise in zip(each.courses, each.noises, strict=True):
            yield {
                "run": course.record.name,
                "direction": DIRECTION_NAMES[course.record.direction],
                "source": course.record.source,
                "segment_mm": [float(course.x.min()), float(course.x.max())],
                "samples": len(course.raw_x),
                "blocks": len(course),
                "samples_left_out": course.dropped,
                "samples_missing": course.missing,
                "feed_mm_min": course.feed,
                "programmed_feed_mm_min": course.record.feed,
                "noise_um": noise.total,
                "noise_order": noise.order,
                "noise_scale": each.shape.noise_scale,
                "vibrations": _frequencies(noise.vibrations),
            }


def _quasi_static_json(found: Estimate) -> dict[str, Any]:
    """The readings at targets."""
    spread = found.fused.spread
    return {
        "readings": len(found.quasi),
        "readings_inside": len(found.fused.inside),
        "u_um": spread.noise,
        "sheet_um": found.quasi.u,
        "degrees_of_freedom": spread.free,
        "residual_rms_um": _rms(found.fused.residual),
        "drift_offset_um": spread.offset,
        "runs": [asdict(drift) for drift in found.fused.drift],
    }


def _shape_json(each: OneDirection) -> dict[str, Any]:
    """The shape of the error in one direction."""
    return {
        "finest_mm": each.shape.finest_mm,
        "degree": each.shape.basis.degree,
        "bound_to_time": _frequencies(each.found.bound_to_time),
    }


def _frequencies(waves: Iterable[tuple[float, float]]) -> list[dict[str, float]]:
    """Frequencies, Hz, and amplitudes, um."""
    return [{"frequency_hz": f, "amplitude_um": a} for f, a in waves]


def _jumps_json(each: OneDirection) -> dict[str, Any]:
    """The steps of a table of the control in one direction."""
    pitch = each.jumps.pitch
    return {
        "pitch_mm": None if pitch is None else pitch[0],
        "u_pitch_mm": None if pitch is None else pitch[1],
        "positions_mm": list(each.jumps.positions_mm),
        "sizes_um": list(each.jumps.sizes_um),
        "u_um": list(each.jumps.u_um),
    }


def _reversal(found: Estimate) -> dict[str, float] | None:
    """Reversal error, forward minus backward, over the segment; None where one direction is not known."""
    if not found.both:
        return None
    values, covariance = found.curve("reversal")
    return {
        "mean_um": float(values.mean()),
        "u_um": float(np.sqrt(max(covariance.mean(), 0.0))),
        "min_um": float(values.min()),
        "max_um": float(values.max()),
    }


def _differences(found: Estimate, run: str) -> dict[str, Array]:
    """Errors by the paper's methods less those of the joint estimate, um, by method."""
    compared = found.comparisons[run]
    sign = next(
        DIRECTION_NAMES[sign]
        for sign, each in found.by_direction.items()
        if run in {c.record.name for c in each.courses}
    )
    values, _ = found.curve(sign)
    ours = np.interp(compared.x, found.fused.positions, values)
    return {method: errors - ours for method, errors in compared.errors.items()}


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def continuous_report(found: Estimate, data: Data, command: str) -> Report:
    """The result for people; `command`: the command that made it."""
    rows = found.table()
    of = f"{found.direction} of both directions" if found.direction == "mean" else found.direction
    verdict = (
        f"Positioning error of {data.axis} ({of}): {rows.error.min():z.2f} to {rows.error.max():z.2f} um, U (k=2) at "
        f"most {uncertainty(2 * rows.u.max(), 2)} um."
    )
    if (reversal := _reversal(found)) is not None:
        verdict += (
            f"\nReversal, forward minus backward: {plus_minus(reversal['mean_um'], 2 * reversal['u_um'], 2)} um (mean "
            "over the segment, k=2)."
        )
    lead, head = (
        ", ".join(data.fingerprints),
        ReportHead(machine=data.machine, instrument=instrument_text("interferometer", data.simulated), command=command),
    )
    return Report(f"Positioning error of axis {data.axis}", lead, list(_sections(found, data)), verdict, head=head)


def _sections(found: Estimate, data: Data) -> Iterator[Section]:
    yield Section("Error", f"{SIGN} The band is U (k=2).", figure=partial(_errors, found))
    yield facts("Data", list(_facts(found, data)))
    if found.both:
        text = "The curve is forward minus backward. The band is U (k=2)."
        yield Section("Reversal", text, figure=partial(_reversal_figure, found))
    text = (
        "The points are quasi-static readings inside the segment, less the estimate and the drift of their run. The "
        "lines are at twice the standard uncertainty u of a reading."
    )
    yield Section("Readings against the estimate", text, figure=partial(_residuals, found))
    yield _runs(found)
    if waves := [row for sign, each in found.by_direction.items() for row in _waves(DIRECTION_NAMES[sign], each)]:
        text = f"The table contains them. {HINT}"
        if any(each.waves and len(each.courses) == 1 for each in found.by_direction.values()):
            text += (
                "\nOne run does not distinguish a wave along the axis from a vibration of that frequency: "
                "measure another run at another feed."
            )
        head = ("direction", "period, mm", "u (k=1)", "amplitude, um", "u (k=1)", "harmonics", "in this run, Hz")
        yield Section("Cyclic errors", text, Table(head, waves))
    if jumps := [row for sign, each in found.by_direction.items() for row in _jumps(DIRECTION_NAMES[sign], each)]:
        table = Table(("direction", "position, mm", "size, um", "u (k=1)"), jumps)
        yield Section("Jumps", f"These are steps of a compensation table, or a fault. {HINT}", table)
    if found.fused.drift:
        yield _drift(found)
    if data.notes or found.notes:
        yield Section("Notes", "\n".join((*data.notes, *found.notes)), detail=True)


def _facts(found: Estimate, data: Data) -> Iterator[tuple[str, str]]:
    spread, (low, high) = found.fused.spread, found.segment
    yield "axis", f"{data.axis}, table {found.direction}: {len(found.table().position)} rows"
    specified = f"{spread.specified:.3g} um by the instrument specification" if spread.specified else "not specified"
    yield (
        "targets",
        f"{len(found.fused.inside)} of {len(found.quasi)} readings from {low:.3f} to {high:.3f} mm, standard "
        f"uncertainty of one {spread.noise:.2g} um ({specified}, {spread.free} degrees of freedom)",
    )
    for sign, each in found.by_direction.items():
        yield "detail", f"{DIRECTION_NAMES[sign]}: above noise down to {each.shape.finest_mm:.3g} mm"
    if (reversal := _reversal(found)) is not None:
        yield (
            "reversal",
            f"{reversal['mean_um']:.2f} um, u {reversal['u_um']:.2f} (forward minus backward, mean over the segment; "
            f"{reversal['min_um']:.2f} to {reversal['max_um']:.2f})",
        )


def _runs(found: Estimate) -> Section:
    rows = [
        (
            course.record.name,
            DIRECTION_NAMES[sign],
            f"{course.feed:.5g}",
            f"{course.x.min():.3f} to {course.x.max():.3f}",
            str(len(course.raw_x)),
            f"{noise.total:.2g}",
            "\n".join(f"{f:.3g} Hz, {a:.2g} um" for f, a in [*each.found.bound_to_time, *noise.vibrations])
            or "none found",
        )
        for sign, each in found.by_direction.items()
        for course, noise in zip(each.courses, each.noises, strict=True)
    ]
    head = ("run", "direction", "feed, mm/min", "segment, mm", "samples", "noise, um", "vibrations")
    text = "Only samples at constant velocity count. Vibrations depend on time: the table does not contain them."
    return Section("Continuous runs", text, Table(head, rows))


def _waves(direction: str, each: OneDirection) -> Iterator[tuple[str, ...]]:
    for wave, harmonics in with_harmonics(each.waves)[:LISTED_FEATURES]:
        period = f"{wave.period_mm:.4g}", f"{wave.u_period_mm:.2g}"
        amplitude = f"{wave.amplitude_um:.3g}", f"{wave.u_amplitude_um:.2g}"
        yield direction, *period, *amplitude, ", ".join(map(str, harmonics)), f"{wave.frequency_hz:.3g}"


def with_harmonics(waves: Sequence[Wave]) -> list[tuple[Wave, list[int]]]:
    """Waves, strongest first, each with the numbers of its harmonics; harmonics are not listed as waves."""
    left, found = list(waves), []
    while left:
        wave = left.pop(0)
        numbers = {other: wave.period_mm / other.period_mm for other in left if other.period_mm < wave.period_mm / 1.5}
        own = {
            other: round(ratio)
            for other, ratio in numbers.items()
            if abs(ratio / round(ratio) - 1.0) < HARMONIC_DEVIATION
        }
        left = [other for other in left if other not in own]
        found.append((wave, sorted(own.values())))
    return found


def _jumps(direction: str, each: OneDirection) -> Iterator[tuple[str, ...]]:
    jumps = each.jumps
    for x, size, u in list(zip(jumps.positions_mm, jumps.sizes_um, jumps.u_um, strict=True))[:LISTED_FEATURES]:
        yield direction, f"{x:.3f}", f"{size:.2f}", f"{u:.2g}"
    if jumps.pitch is not None:
        yield direction, f"every {jumps.pitch[0]:.4g} (u {jumps.pitch[1]:.2g})", "", ""


def _drift(found: Estimate) -> Section:
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
    head = ("run", "offset, um", "u (k=1)", "slope, um/m", "u (k=1)")
    return Section("Drift of the quasi-static runs", "Drifts are relative to their mean.", Table(head, rows))


def _errors(found: Estimate) -> Figure:
    """Errors by direction with their uncertainties, and the readings."""
    panel = Panel("position, mm", "error, um")
    for colour, sign in zip(COLOURS, found.fused.signs, strict=False):
        rows = found.table(DIRECTION_NAMES[sign])
        inner = some(np.flatnonzero(rows.continuous), DRAWN_CURVE_POINTS)
        band(panel, rows.position[inner], rows.error[inner], 2 * rows.u[inner], colour, DIRECTION_NAMES[sign])
        own, label = found.quasi.direction == sign, f"readings {DIRECTION_NAMES[sign]}"
        form = {"symbol": "circle-open", "size": 6, "opacity": 1}
        dots(panel, found.quasi.target[own], found.quasi.deviation[own], colour, label, **form)
    return Figure([panel], height=420)


def _reversal_figure(found: Estimate) -> Figure:
    panel = Panel("position, mm", "forward minus backward, um")
    values, covariance = found.curve("reversal")
    rows = some(np.arange(len(values)), DRAWN_CURVE_POINTS)
    u = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    band(panel, found.fused.positions[rows], values[rows], 2 * u[rows])
    return Figure([panel], height=300)


def _residuals(found: Estimate) -> Figure:
    panel = Panel("target, mm", "reading minus estimate, um")
    quasi, residual = found.quasi, found.fused.residual
    for colour, (sign, name) in zip(COLOURS, DIRECTION_NAMES.items(), strict=False):
        rows = quasi.direction[found.fused.inside] == sign
        if rows.any():
            at = quasi.target[found.fused.inside][rows]
            dots(panel, at[:MOST_DRAWN_POINTS], residual[rows][:MOST_DRAWN_POINTS], colour, name, size=6, opacity=0.9)
    for k in (-2.0, 2.0):
        level(panel, k * found.fused.spread.noise, f"{k:+g} u")
    return Figure([panel], height=300)
