"""The results of the touches of spheres, for programs and for people."""

from __future__ import annotations

from typing import Any

from calibration.probing.centres import Probed
from kinematics.files.report_head import ReportHead
from rendering.report import Report, Section, Table, facts


def touches_json(probed: Probed) -> dict[str, Any]:
    """The result for programs."""
    return {
        "centres": len(probed.measurement),
        "scatter_um": probed.scatter_um,
        "u_um": probed.u_um,
        "contact_radius_mm": probed.radii,
        "repeats": [
            {"row": each.row + 1, "shift_um": each.shift_um.tolist(), "U_um": each.U_um, "drift": each.significant}
            for each in probed.repeats
        ],
        "notes": list(probed.notes),
    }


def touches_report(probed: Probed, lead: str, head: ReportHead) -> Report:
    """The result for people."""
    rows = [
        ("centres", str(len(probed.measurement))),
        ("scatter of the contacts", "-" if probed.scatter_um is None else f"{probed.scatter_um:.2f} um (k = 1)"),
        ("uncertainty of a centre", f"{probed.u_um:.2f} um in each coordinate (k = 1)"),
        *((f"radius of contact {name}", f"{radius:.4f} mm") for name, radius in probed.radii.items()),
    ]
    repeats = [
        (
            str(each.row + 1),
            *(f"{v:+.1f}" for v in each.shift_um),
            f"{each.U_um:.1f}",
            "drift" if each.significant else "",
        )
        for each in probed.repeats
    ]
    sections = [facts("Contacts", rows)]
    if repeats:
        text = "The first centre, measured again, has these shifts in the workpiece frame, um, with U (k = 2)."
        sections.append(
            Section("Repetitions", text, Table(("row", "x, um", "y, um", "z, um", "U, um", "result"), repeats))
        )
    return Report("Touches of spheres", lead, sections, _verdict(probed), head=head)


def _verdict(probed: Probed) -> str:
    drifted = [each for each in probed.repeats if each.significant]
    if not probed.repeats:
        return "The first centre was not measured again: a drift would not show."
    if not drifted:
        return "No drift: the first centre, measured again, has not moved by more than its uncertainty."
    last = max(drifted, key=lambda each: float(abs(each.shift_um).max()))
    moved = ", ".join(f"{v:+.1f}" for v in last.shift_um)
    return (
        f"DRIFT: the first centre moved by ({moved}) um until row {last.row + 1}, beyond U {last.U_um:.1f} um: "
        "spheres, spindle or table moved or warmed up. ncomp diagnose separates a drift (thermal-drift) from a knock "
        "(station-shift)."
    )
