"""Results of a comparison of two calibrations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np

from calibration.evaluation.comparison.result import Comparison, Motion
from calibration.evaluation.comparison.result import Figure as Compared
from calibration.evaluation.comparison.sides import ZERO_ERROR_UM
from kinematics.error_model.model import ErrorModel
from kinematics.files.number_text import uncertainty
from kinematics.files.report_head import calibration_text
from rendering.figures import COLOURS, Figure, Panel, band, grid
from rendering.report import Report, Section, Table, shortened
from rendering.volume import Field, volume_section

MOTIONS = ("error motion", "convention", "range A", "range B", "RMS B - A", "largest B - A", "at", "U (k=2)", "result")
FIGURES = ("error", "meaning", "unit", "A", "B", "B - A", "U (k=2)", "result")
RESULTS = {True: "significant", False: "not significant"}
CURVES_ACROSS = 3
"""Curves side by side."""
NAMED = 12
"""Most errors that the verdict names."""
SIGN = "Actual minus nominal, tool relative to workpiece. Differences are B minus A."


def comparison_report(found: Comparison, models: Sequence[ErrorModel], names: tuple[str, str], command: str) -> Report:
    """The result for people; `names`: of the two calibrations; `command`: the command that made it."""
    aligned = found.volume.aligned
    verdict = (
        f"Over the common volume of both calibrations the tool point differs by {aligned.rms:.2f} um RMS, at most "
        f"{aligned.largest:.2f} um, after alignment; standard uncertainty {found.volume.u_rms_um:.2f} um RMS.\n"
        f"{_significant(found)}"
    )
    demonstrations = [letter for letter, model in zip("AB", models, strict=True) if model.demonstration]
    if demonstrations:
        verdict = f"DEMONSTRATION CALIBRATION {' and '.join(demonstrations)}: it describes no real machine.\n{verdict}"
    lead = f"A: {names[0]} · B: {names[1]}"
    both = "; ".join(f"{letter}: {calibration_text(model)}" for letter, model in zip("AB", models, strict=True))
    head = found.machine.report.filled(machine=found.machine.name, calibration=both, command=command)
    maps = volume_section(found.machine, [Field("B minus A", models[1], models[0])])
    return Report(f"Two calibrations of {found.machine.name}", lead, [*maps, *_sections(found)], verdict, head=head)


def _significant(found: Comparison) -> str:
    """The error motions and other figures whose difference exceeds its uncertainty, in a sentence."""
    names = [motion.name for motion in found.motions if motion.significant]
    names += [figure.shown for figure in found.figures if _differs(figure)]
    count = len(found.motions) + len(found.figures)
    if not names:
        return f"None of {count} compared errors differs significantly (k=2)."
    listed = ", ".join(shortened(names, NAMED, "in the tables"))
    return f"{len(names)} of {count} compared errors differ significantly (k=2): {listed}."


def _differs(figure: Compared) -> bool:
    return bool(abs(figure.b - figure.a) > max(figure.U, ZERO_ERROR_UM))


def _sections(found: Comparison) -> Iterator[Section]:
    unit = _units(found)
    reference = ", ".join(f"{axis} {at:.5g} {unit[axis]}" for axis, at in found.reference.items())
    text = (
        f"{SIGN}\nReference position: {reference}. Straightness from the {found.straightness} line; its slope belongs "
        "to the squareness. Both calibrations are transformed into the frame of ncomp fit. Significant: two "
        "calibrations that agree differ so much, at any position, with a probability below 5 %."
    )
    for axis in dict.fromkeys(motion.axis for motion in found.motions):
        own = [motion for motion in found.motions if motion.axis == axis]
        yield Section(f"Axis {axis}", "The band is U (k=2).", figure=partial(_curves, own))
    yield Section("Error motions, ISO 230-1", text, Table(MOTIONS, list(map(_motion_row, found.motions))))
    if found.figures:
        rows = [
            (f.shown, f.title, f.unit, f"{f.a:z.2f}", f"{f.b:z.2f}", f"{f.b - f.a:+z.2f}", uncertainty(f.U, 2),
             RESULTS[_differs(f)])
            for f in found.figures
        ]  # fmt: skip
        yield Section("Squareness, location errors, reversal", "Angles right-handed.", Table(FIGURES, rows))
    yield _volume(found)
    if found.left_out:
        yield Section("Not compared", "\n".join(found.left_out))


def _motion_row(motion: Motion) -> tuple[str, ...]:
    i = motion.largest
    mark = RESULTS[motion.significant]
    if not all(motion.known):
        mark = f"in {'A' if motion.known[0] else 'B'} only"
    return (
        f"{motion.name}, {motion.unit}",
        motion.convention,
        *(
            f"{np.ptp(values):.2f}" if known else "not known"
            for values, known in zip((motion.a, motion.b), motion.known, strict=True)
        ),
        f"{np.sqrt(np.mean(motion.difference**2)):.2f}",
        f"{motion.difference[i]:+.2f}",
        f"{motion.axis} {motion.positions[i]:.4g} {motion.position_unit}",
        uncertainty(motion.U[i], 2),
        mark,
    )


def _units(found: Comparison) -> dict[str, str]:
    """Unit of the position of each axis."""
    return {axis.name: axis.unit for axis in found.machine.axes}


def _volume(found: Comparison) -> Section:
    volume = found.volume
    unit = _units(found)
    bounds = "; ".join(f"{axis} {low:.4g} to {high:.4g} {unit[axis]}" for axis, (low, high) in volume.bounds.items())
    rows = [
        (title, f"{error.rms:.2f}", f"{error.p95:.2f}", f"{error.largest:.2f}")
        for title, error in (("as they are", volume.difference), ("aligned", volume.aligned))
    ]
    rows.append(("standard uncertainty of the difference (k=1)", f"{volume.u_rms_um:.2f}", "", ""))
    text = (
        f"{bounds or 'One position'}; tool {volume.tool_mm:g} mm. Aligned: without the common shift and "
        "rotation, which depend on the datum."
    )
    return Section("Over the volume", text, Table(("B - A, um", "RMS", "95 %", "largest"), rows))


def _curves(motions: list[Motion]) -> Figure:
    return grid(list(map(_curve, motions)), CURVES_ACROSS)


def _curve(motion: Motion) -> Panel:
    panel = Panel(f"{motion.axis}, {motion.position_unit}", f"{motion.name}, {motion.unit}", motion.name)
    pairs = zip("AB", COLOURS, (motion.a, motion.b), (motion.U_a, motion.U_b), motion.known, strict=False)
    for name, colour, values, U, known in pairs:
        if known:
            band(panel, motion.positions, values, U, colour, name)
    return panel
