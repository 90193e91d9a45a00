"""The figures of ISO 230-1 from a three-point identification: straightness, squareness, motions of a rotary axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.single_axis.reference_lines import Kind, Straightness, straightness
from calibration.single_axis.three_points import AxisResult, ThreePoints
from kinematics.effects import COMPONENTS, unit_of
from kinematics.effects.base import own_component

LINES: tuple[Kind, ...] = ("least-squares", "end-point", "minimum-zone")


@dataclass(frozen=True)
class Figure:
    """A number with its standard uncertainty."""

    name: str
    description: str
    value: float
    u: float
    unit: str


def kind_of(result: AxisResult, component: int) -> str:
    """Term of ISO 230-1 for an error motion."""
    own = component % 3 == COMPONENTS.index(own_component(result.axis.name)) % 3
    if result.axis.rotary:
        return ("axial" if own else "radial") if component < 3 else ("angular positioning" if own else "tilt")
    return ("positioning" if own else "straightness") if component < 3 else "angular"


def ranges(result: AxisResult) -> list[Figure]:
    """Range of each of the six error motions over the positions."""
    found = []
    for component, letter in enumerate(COMPONENTS):
        values, covariance = result.errors[:, component], result.block(component)
        top, low = int(np.argmax(values)), int(np.argmin(values))
        variance = covariance[top, top] + covariance[low, low] - 2.0 * covariance[top, low]
        u = float(np.sqrt(max(variance, 0.0)))
        name = f"E_{letter}{result.axis.name}"
        found.append(Figure(name, kind_of(result, component), float(np.ptp(values)), u, unit_of(letter)[0]))
    return found


def straightnesses(result: AxisResult) -> dict[str, list[Straightness]]:
    """Straightness about each reference line, um (slopes um/mm), by error motion; empty for a rotary axis."""
    found = {}
    for component, letter in enumerate(COMPONENTS):
        if kind_of(result, component) == "straightness":
            values, covariance = result.errors[:, component], result.block(component)
            found[f"E_{letter}{result.axis.name}"] = [
                straightness(kind, result.positions, values, covariance) for kind in LINES
            ]
    return found


def locations(found: ThreePoints) -> list[Figure]:
    """Location errors of all axes."""
    figures = []
    for effect, _ in found.model.location_errors:
        unit = unit_of(effect.component)[0]
        figures.append(Figure(effect.name, "location", effect.value, effect.uncertainties[0], unit))
    return figures


def squarenesses(found: ThreePoints) -> list[Figure]:
    """Squareness of Y to X (E_C0Y - E_C0X), Z to X and Z to Y, right-handed, with standard uncertainties."""
    model = found.model
    columns = {effect.name: part.start for effect, part in model.location_errors}
    covariance, values = np.array(model.covariance), model.parameters
    figures = []
    for first, second, about in (("X", "Y", "C"), ("X", "Z", "B"), ("Y", "Z", "A")):
        names = [f"E_{about}0{second}", f"E_{about}0{first}"]
        if all(name in columns for name in names):
            a, b = (columns[name] for name in names)
            u = float(np.sqrt(max(covariance[a, a] + covariance[b, b] - 2.0 * covariance[a, b], 0.0)))
            description = f"{second} to {first}: {' - '.join(names)}"
            figures.append(Figure(f"E_{about}(0{first}){second}", description, float(values[a] - values[b]), u, "urad"))
    return figures
