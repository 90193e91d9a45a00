"""A joint estimate of continuous and quasi-static runs, for programs and for people at a terminal."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from calibration.continuous.records import WAYS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    from calibration.continuous.error_curve import Course
    from calibration.continuous.estimate import Estimate, OneWay, Wave
    from calibration.continuous.noise import Noise
    from calibration.continuous.reading import Data
    from kinematics.transforms import Array

MOST_WAVES = 6
"""Largest number of printed waves; the JSON has all."""
HARMONIC = 2e-3
"""Largest relative deviation of a harmonic from a multiple of the basic frequency."""
HINT = "ncomp diagnose, with the quasi-static data or a finer run of targets, tells which part of the drive it is"


def summary(found: Estimate, data: Data) -> dict[str, Any]:
    """All results, with units in the names; uncertainties are standard ones (k = 1)."""
    rows, spread = found.table(), found.fused.spread
    low, high = found.segment
    return {
        "axis": data.axis,
        "direction": found.direction,
        "segment_mm": [low, high],
        "rows": len(rows.position),
        "error_um": {"min": float(rows.error.min()), "max": float(rows.error.max())},
        "u_um": {"min": float(rows.u.min()), "max": float(rows.u.max())},
        "continuous": [
            _run(course, noise, each)
            for each in found.ways.values()
            for course, noise in zip(each.courses, each.noises, strict=True)
        ],
        "quasi_static": {
            "readings": len(found.quasi),
            "readings_inside": len(found.fused.inside),
            "u_um": spread.noise,
            "sheet_um": found.quasi.u,
            "degrees_of_freedom": spread.free,
            "residual_rms_um": _rms(found.fused.residual),
            "drift_offset_um": spread.offset,
            "runs": [asdict(drift) for drift in found.fused.drift],
        },
        "reversal": _reversal(found),
        "shape": {WAYS[way]: _shape(each) for way, each in found.ways.items()},
        "cyclic": [
            {"direction": WAYS[way], **wave._asdict()} for way, each in found.ways.items() for wave in each.waves
        ],
        "jumps": [
            {
                "direction": WAYS[way],
                "pitch_mm": None if each.jumps.pitch is None else each.jumps.pitch[0],
                "u_pitch_mm": None if each.jumps.pitch is None else each.jumps.pitch[1],
                "positions_mm": list(each.jumps.places_mm),
                "sizes_um": list(each.jumps.sizes_um),
                "u_um": list(each.jumps.u_um),
            }
            for way, each in found.ways.items()
            if each.jumps.places_mm
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


def show(found: Estimate, data: Data, to: Console) -> None:
    """Show the estimate for people."""
    rows, spread = found.table(), found.fused.spread
    low, high = found.segment
    to.print(f"axis         {data.axis}, table {found.direction}: {len(rows.position)} rows")
    for each in found.ways.values():
        for course, noise in zip(each.courses, each.noises, strict=True):
            to.print(
                f"run          {course.record.name}: {len(course.raw_x)} samples at "
                f"constant velocity, {course.feed:.6g} mm/min, {course.x.min():.3f} to {course.x.max():.3f} mm; "
                f"noise {noise.total:.3g} um"
            )
        to.print(f"detail       {WAYS[each.courses[0].record.direction]}: {_detail(each)}")
    by = f"{spread.sheet:.3g} um by the sheet" if spread.sheet else "no sheet"
    to.print(
        f"targets      {len(found.fused.inside)} of {len(found.quasi)} readings from {low:.3f} to {high:.3f} mm, "
        f"standard uncertainty of one {spread.noise:.3g} um ({by}, {spread.free} degrees of freedom)"
    )
    to.print(
        f"error        {rows.error.min():.2f} to {rows.error.max():.2f} um, standard uncertainty (k=1) "
        f"{rows.u.min():.2f} to {rows.u.max():.2f} um"
    )
    reversal = _reversal(found)
    if reversal is not None:
        to.print(
            f"reversal     {reversal['mean_um']:.2f} um, u {reversal['u_um']:.2f} (forward minus backward, mean over "
            f"the segment; {reversal['min_um']:.2f} to {reversal['max_um']:.2f})"
        )
    _show_drift(found, to)
    for way, each in found.ways.items():
        _show_features(WAYS[way], each, to)


def _show_drift(found: Estimate, to: Console) -> None:
    drift = found.fused.drift
    if not drift:
        return
    low, high = min(drift, key=lambda d: d.offset_um), max(drift, key=lambda d: d.offset_um)
    steep = max(drift, key=lambda d: abs(d.slope_um_per_m))
    to.print(
        f"drift        runs lie from {low.offset_um:.2f} ({low.run}) to {high.offset_um:.2f} um ({high.run}) about "
        f"their mean, u {high.u_offset_um:.2f}; scale up to {steep.slope_um_per_m:.2f} um/m ({steep.run}), "
        f"u {steep.u_slope_um_per_m:.2f}"
    )


def _show_features(direction: str, each: OneWay, to: Console) -> None:
    families = with_harmonics(each.waves)
    for wave, harmonics in families[:MOST_WAVES]:
        numbers = f", harmonics {', '.join(map(str, harmonics))}" if harmonics else ""
        to.print(
            f"cyclic       {direction}: period {wave.period_mm:.4g} mm (u {wave.u_period_mm:.2g}), amplitude "
            f"{wave.amplitude_um:.3g} um (u {wave.u_amplitude_um:.2g}){numbers}; {wave.frequency_hz:.3g} Hz here"
        )
    if len(families) > MOST_WAVES:
        to.print(f"             {len(families) - MOST_WAVES} more, weaker ones (--json)")
    jumps = each.jumps
    if jumps.places_mm:
        sizes = np.abs(jumps.sizes_um)
        where = ", ".join(f"{x:.2f}" for x in jumps.places_mm[:5]) + (", ..." if len(jumps.places_mm) > 5 else "")
        to.print(
            f"jumps        {direction}: {len(jumps.places_mm)}, up to {sizes.max():.3g} um "
            f"(u {max(jumps.u_um):.2g}), at {where} mm{_pitch(each)}"
        )
    if each.waves or jumps.places_mm:
        to.print(f"             {HINT}")
    if each.waves and len(each.courses) == 1:
        to.print(
            "             one run can't tell a wave along the axis from a vibration of that frequency: "
            "run again at another feed"
        )
    for frequency, amplitude in vibrations(each):
        to.print(f"vibration    {direction}: {frequency:.3g} Hz, amplitude {amplitude:.2g} um; not in the table")


def with_harmonics(waves: Sequence[Wave]) -> list[tuple[Wave, list[int]]]:
    """Waves, strongest first, each with the numbers of its harmonics; harmonics are not listed as waves."""
    left, found = list(waves), []
    while left:
        wave = left.pop(0)
        numbers = {other: wave.period_mm / other.period_mm for other in left if other.period_mm < wave.period_mm / 1.5}
        own = {other: round(ratio) for other, ratio in numbers.items() if abs(ratio / round(ratio) - 1.0) < HARMONIC}
        left = [other for other in left if other not in own]
        found.append((wave, sorted(own.values())))
    return found


def vibrations(each: OneWay) -> list[tuple[float, float]]:
    """Frequency, Hz, and amplitude, um, of vibrations, which depend on time and not on position."""
    return [*each.found.bound_to_time, *(found for noise in each.noises[:1] for found in noise.vibrations)]


def _pitch(each: OneWay) -> str:
    if each.jumps.pitch is None:
        return ""
    pitch, u = each.jumps.pitch
    return f"; every {pitch:.4g} mm (u {u:.2g}): steps of a compensation table"


def _detail(each: OneWay) -> str:
    kind = "cubic spline" if each.shape.order == 2 else "random walk"
    return f"{kind}, detail down to {each.shape.finest_mm:.3g} mm told from noise"


def _run(course: Course, noise: Noise, each: OneWay) -> dict[str, Any]:
    """The results of one continuous run, for programs."""
    return {
        "run": course.record.name,
        "direction": WAYS[course.record.direction],
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
        "vibrations": [{"frequency_hz": f, "amplitude_um": a} for f, a in noise.vibrations],
    }


def _shape(each: OneWay) -> dict[str, Any]:
    return {
        "prior_order": each.shape.order,
        "finest_mm": each.shape.finest_mm,
        "nodes": len(each.shape.nodes),
        "bound_to_time": [{"frequency_hz": f, "amplitude_um": a} for f, a in each.found.bound_to_time],
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
    way = next(WAYS[way] for way, each in found.ways.items() if run in {c.record.name for c in each.courses})
    values, _ = found.curve(way)
    ours = np.interp(compared.x, found.fused.positions, values)
    return {method: errors - ours for method, errors in compared.errors.items()}


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
