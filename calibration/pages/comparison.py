"""The report of a comparison of two calibrations."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from calibration.evaluation.comparison import Comparison, Motion
from calibration.pages import Section, Table, figure, page
from calibration.pages.fit import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOTIONS = ("", "unit", "convention", "range A", "range B", "RMS B - A", "largest B - A", "at", "U (k=2)", "")
FIGURES = ("", "", "unit", "A", "B", "B - A", "U (k=2)", "")
ACROSS = 3
"""Curves side by side."""
SIGN = "Actual minus nominal, tool relative to workpiece. Differences are B minus A."


def comparison_page(found: Comparison, names: tuple[str, str], command: str) -> bytes:
    """The report as one HTML file; `command` is the command that made it."""
    aligned = found.volume.aligned
    verdict = (
        f"Over the volume that both know, the tool point differs by {aligned.rms:.2f} um RMS, at most "
        f"{aligned.largest:.2f} um, after alignment; standard uncertainty {found.volume.u_rms_um:.2f} um RMS."
    )
    lead = f"A: {names[0]} · B: {names[1]} · {command}"
    return page(f"Two calibrations of {found.machine.name}", lead, list(_sections(found)), verdict)


def _sections(found: Comparison) -> Iterator[Section]:
    reference = ", ".join(f"{axis} {at:g}" for axis, at in found.reference.items())
    text = (
        f"{SIGN}\nReference position: {reference}. Straightness from the {found.straightness} line. Both calibrations "
        "are moved into the frame of ncomp fit."
    )
    yield Section("Error motions, ISO 230-1", text, Table(MOTIONS, list(_motion_rows(found))))
    if found.figures:
        rows = list(_figure_rows(found))
        yield Section("Squareness, location errors, reversal", "Angles right-handed.", Table(FIGURES, rows))
    yield Section("Over the volume", table=_volume(found))
    for axis in dict.fromkeys(motion.axis for motion in found.motions):
        own = [motion for motion in found.motions if motion.axis == axis]
        yield Section(f"Axis {axis}", "Bands: U (k=2).", figure=_curves(own))
    if found.left_out:
        yield Section("Not compared", "\n".join(found.left_out))


def _motion_rows(found: Comparison) -> Iterator[tuple[str, ...]]:
    for motion in found.motions:
        summary, i = motion.json(), motion.largest
        ranges = [
            f"{summary['range'][letter]:.2f}" if known else "not known"
            for letter, known in zip("ab", motion.known, strict=True)
        ]
        at, off = f"{motion.positions[i]:.4g} {motion.position_unit}", float(motion.difference[i])
        rms, U = f"{summary['rms_difference']:.2f}", float(motion.U[i])
        yield motion.name, motion.unit, motion.convention, *ranges, rms, f"{off:+.2f}", at, f"{U:.2f}", _mark(off, U)


def _figure_rows(found: Comparison) -> Iterator[tuple[str, ...]]:
    for each in found.figures:
        off = each.b - each.a
        numbers = f"{each.a:.2f}", f"{each.b:.2f}", f"{off:+.2f}", f"{each.U:.2f}"
        yield each.name, each.title, each.unit, *numbers, _mark(off, each.U)


def _mark(difference: float, U: float) -> str:
    return "significant" if abs(difference) > max(U, 1e-9) else ""


def _volume(found: Comparison) -> Table:
    volume = found.volume
    bounds = "; ".join(f"{axis} {low:g} to {high:g}" for axis, (low, high) in volume.bounds.items())
    rows = [
        (title, f"{error.rms:.2f}", f"{error.p95:.2f}", f"{error.largest:.2f}")
        for title, error in (("as they are", volume.difference), ("aligned", volume.aligned))
    ]
    expected = ("standard uncertainty of the difference (k=1)", f"{volume.u_rms_um:.2f}", "", "")
    return Table((f"B - A, um; {bounds}; tool {volume.tool_mm:g} mm", "RMS", "95 %", "largest"), [*rows, expected])


def _curves(motions: list[Motion]) -> str:
    down = -(-len(motions) // ACROSS)
    with figure(9.0, 2.2 * down) as (canvas, drawn):
        places = canvas.subplots(down, ACROSS, squeeze=False).ravel()
        for place in places[len(motions) :]:
            place.set_axis_off()
        for place, motion in zip(places, motions, strict=False):
            _curve(place, motion)
        places[0].legend(frameon=False, loc="best")
    return drawn[0]


def _curve(place: Axes, motion: Motion) -> None:
    pairs = zip("AB", COLOURS, (motion.a, motion.b), (motion.U_a, motion.U_b), motion.known, strict=False)
    for name, colour, values, U, known in pairs:
        if known:
            place.fill_between(motion.positions, values - U, values + U, color=colour, alpha=0.2, linewidth=0)
            place.plot(motion.positions, values, color=colour, linewidth=1, label=name)
    place.set_title(f"{motion.name}, {motion.unit}", fontsize=8)
    place.set_xlabel(f"{motion.axis}, {motion.position_unit}")
