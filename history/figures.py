"""The figures of results, by one name and in one frame for each quantity of a machine, whatever measured it.

Figures of a calibration are those of `ncomp compare` against the machine without errors: in its common frame, over the
range of the calibration.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np

from history.entries import Quantity
from kinematics.error_model.model import ErrorModel, no_errors
from kinematics.machine import Machine

if TYPE_CHECKING:
    from calibration.evaluation.comparison.result import Comparison
    from kinematics.effects import Effect

ISO230_2 = {"mean B": "backlash", **{symbol: symbol for symbol in ("A", "E", "M", "R")}}
"""Names of the values of ISO 230-2 of both directions, before that of the axis; mean B is the reversal of `compare`."""
ISO230_4 = ("G(b)", "G(ccw)", "G(cw)", "H")
"""Values of ISO 230-4 that need no calibrated length."""
EXACT_U = 1e-6
"""Standard uncertainty, um or urad, below which a figure is stated to be exact: the calibration does not have it."""


def of_calibration(machine: Machine, model: ErrorModel) -> list[Quantity]:
    """Squareness, location errors, backlash, positioning and volumetric error of a calibration."""
    from calibration.evaluation.comparison.compare import compare

    return of_comparison(machine, compare(machine, (no_errors(machine), model)))


def of_comparison(machine: Machine, found: Comparison) -> list[Quantity]:
    """The figures of a calibration that was compared with the machine without errors."""
    figures = [Quantity(_name(each.name, each.title), each.unit, each.b, each.U_b / 2.0) for each in found.figures]
    return [each for each in (*figures, *_positioning(found), *_volume(machine, found)) if each.u > EXACT_U]


def _name(name: str, title: str) -> str:
    """`squareness X-Y`, `backlash X`, or the name by ISO 230-1 of a location error."""
    if title.startswith("squareness of "):
        second, first = title.removeprefix("squareness of ").split(" to ")
        return f"squareness {first}-{second}"
    return f"backlash {name[2:]}" if name.startswith("B ") else name


def _positioning(found: Comparison) -> Iterator[Quantity]:
    """Ranges of the positioning errors; their uncertainty from both extremes, as if these were independent."""
    for each in found.motions:
        if each.name == f"E_{each.axis[0]}{each.axis}" and len(each.positions):
            ends = [int(np.argmax(each.b)), int(np.argmin(each.b))]
            u = float(np.hypot(*each.U_b[ends])) / 2.0
            yield Quantity(f"positioning {each.axis}", each.unit, float(np.ptp(each.b)), u)


def _volume(machine: Machine, found: Comparison) -> Iterator[Quantity]:
    """RMS of the volumetric error after alignment, where all linear axes were measured.

    Its uncertainty is at most that of the errors themselves.
    """
    if all(axis.rotary or axis.name in found.volume.bounds for axis in machine.axes):
        yield Quantity("volumetric error", "um", found.volume.aligned.rms, found.volume.u_rms_um)


def of_axes(axes: Iterable[Mapping[str, Any]]) -> list[Quantity]:
    """The values of ISO 230-2, from the results of `ncomp iso230` for programs."""
    found = []
    for test in axes:
        for symbol, value in test["values"].items():
            if symbol in ISO230_2:
                unit = next(key for key in value if key.startswith("value_")).removeprefix("value_")
                own = value[f"value_{unit}"], value[f"U_{unit}"] / 2.0
                found.append(Quantity(f"{ISO230_2[symbol]} {test['axis']}", unit, *own))
    return found


def of_circles(machine: Machine, results: Mapping[str, Any]) -> list[Quantity]:
    """The values of ISO 230-4, and the squareness where the circles show one, from the results of `ncomp ballbar`."""
    from kinematics.effects import LocationError

    found = [
        Quantity(f"{symbol} {test['plane']} at {test['feed_mm_min']:g} mm/min", "um", one["value_um"], one["U_um"] / 2)
        for test in results["tests"]
        for symbol, one in test["figures"].items()
        if symbol in ISO230_4
    ]
    effects = []
    for cause in results["causes"]:
        if cause["kind"] == "squareness" and not cause["tied_with"]:
            first, second = cause["where"].split()
            normal = "ABC"[3 - sum("XYZ".index(axis[0]) for axis in (first, second))]
            angle, u = cause["parameters"]["angle_urad"], cause["U"]["angle_urad"] / 2.0
            effects.append(LocationError(normal, second, angle, u=(u,)))  # type: ignore[arg-type]
    return [*found, *of_effects(machine, effects)]


def of_etve(results: Mapping[str, Any]) -> list[Quantity]:
    """The variations of a standing machine, from the results of `ncomp etve`; those of one period are comparable."""
    within = f"in {results['period_h']:.3g} h"
    return [
        Quantity(f"ETVE {each['name']} {within}", each["unit"], each["value"], each["U"] / 2.0)
        for each in results["etve"]
    ]


def of_effects(machine: Machine, effects: Iterable[Effect]) -> list[Quantity]:
    """The squarenesses that single effects give."""
    effects = tuple(effects)
    if not effects:
        return []
    model = msgspec.structs.replace(no_errors(machine), effects=effects)
    return [each for each in of_calibration(machine, model) if each.name.startswith("squareness")]
