"""The JSON results of an export."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from postproc.control_data.parameters.export_parameters import ExportedParameters
from postproc.control_data.tables.export_tables import Exported

if TYPE_CHECKING:
    from postproc.control_data.exported import ExportedData, Unrepresented


def export_json(
    exported: ExportedData, left: list[Unrepresented], errors: dict[str, Any], files: list[str]
) -> dict[str, Any]:
    """What was exported, and the errors that remain."""
    unit: dict[str, Any] = {}
    contents: dict[str, Any] = {}
    further: dict[str, Any] = {}
    if isinstance(exported, Exported):
        unit, contents = {"unit": exported.unit}, {"tables": [row._asdict() for row in exported.rows]}
        further = {
            "not_carried_orientation_urad": errors["volume"]["tool_axis_urad"]["after_tables"],
            "datum_shift": {axis: round(value, 7) for axis, value in exported.datum.items()},
        }
    elif isinstance(exported, ExportedParameters):
        contents = _parameters(exported)
    return {
        "format": exported.format.name,
        "machine": exported.machine.name,
        "calibration": exported.whole.id,
        "demonstration": exported.whole.demonstration,
        **unit,
        "values_are": exported.sign,
        "sign_confirmed": exported.format.sign is not None,
        "tool_mm": -float(exported.tool[2]),
        "files": files,
        **contents,
        "errors": errors,
        "not_carried": [
            {"error": item.name, "rms_um": None if item.rms_um != item.rms_um else item.rms_um, "why": item.why}
            for item in left
        ],
        **further,
    }


def _parameters(exported: ExportedParameters) -> dict[str, Any]:
    shift = exported.best.frame
    return {
        "parameters": [
            {"name": new.name, "before": float(old.text), "value": float(new.text), "unit": new.unit}
            for old, new in zip(*exported.numbers, strict=True)
        ],
        "lines": [
            {"line": each.freedom.name, "change": each.value, "u": each.u, "unit": each.freedom.unit}
            for each in exported.changes
        ],
        "work_offset_shift": {"mm": shift[:3].tolist(), "urad": (1e6 * shift[3:]).tolist()},
    }
