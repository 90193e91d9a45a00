"""Names, sizes and remedies of causes as text."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from kinematics.effects import (
    AngleStep,
    Cyclic,
    DistortionWithSensor,
    DistortionWithTime,
    Effect,
    GrowthWithDuty,
    GrowthWithSensor,
    GrowthWithTime,
    LocationError,
    LocationJump,
    Parameter,
    QuadraticGrowth,
    Scale,
    StationShift,
    TargetOffset,
    Unnamed,
    WorkpieceDrift,
    WorkpieceDriftWithSensor,
)
from kinematics.effects.base import HOUR, own_component
from kinematics.effects.workshop import WORKSHOP, Workshop
from rendering.report import shortened

if TYPE_CHECKING:
    from calibration.diagnosis.verdict import Named

MANY = 8
"""Most parameters of a cause that are printed; the JSON has all."""
COVERAGE = 2
TURN = 360.0
WHOLE = 0.02
"""Relative difference of a period from a whole part of the turn up to which its order is given."""
SMALL_WAVE = 0.05
"""Least amplitude of a harmonic in words, as a share of the largest."""
LARGE = 1000.0
"""Amplitude, urad, above which it is also given in degrees."""
REMEDIES = {
    "program": "The corrected program (ncomp) compensates it; a table of one axis cannot.",
    "table": "A compensation table of the axis or the corrected program compensates it.",
    "bidirectional table": "A bidirectional table compensates it, or the corrected program at each reversal.",
    "none": "A correction in advance is not possible: mend the machine or its control.",
}
"""Meaning of an effect's remedy (docs/effects.md) in the workshop."""


def title(cause: Named) -> str:
    """Title of a cause: its kind and its axis or component, with a mark for the instrument."""
    if cause.kind == "higher-frequency":
        return f"{cause.effect.name} needs a higher spatial frequency"
    if isinstance(cause.effect, Unnamed):
        return f"{cause.effect.name}: no cause"
    changed = cause.present is not None or isinstance(cause.effect, (LocationError, Scale))
    change = "change of " if changed else ""
    name = cause.effect.name if cause.kind == "location" else in_full(cause.effect.name)
    meaning = meaning_of(cause.effect)
    return f"{change}{name}" + (f" ({meaning})" if meaning else " (instrument)" if cause.where == "instrument" else "")


def meaning_of(effect: Effect) -> str:
    """Meaning of a location error or of a drift, period of a cyclic error; empty for others."""
    if isinstance(effect, LocationError):
        return line_meaning(effect.component, effect.axis)
    if isinstance(effect, Cyclic):
        return f"period {effect.period:.4g} {'deg' if effect.axis[0] in 'ABC' else 'mm'}"
    if isinstance(effect, (WorkpieceDrift, WorkpieceDriftWithSensor)):
        return "of the table, the fixture or the part, in the workpiece's directions"
    if isinstance(effect, (LocationJump, DistortionWithTime, DistortionWithSensor)):
        return _motion_meaning(effect)
    return ""


def _motion_meaning(effect: LocationJump | DistortionWithTime | DistortionWithSensor) -> str:
    """Meaning of an error motion that changes."""
    axis, component = effect.axis, effect.component
    if axis[0] in "ABC" or isinstance(effect, LocationJump):
        other = "line" if axis[0] in "ABC" else "squareness"
        return f"{'zero' if component == own_component(axis) else other} of {axis}"
    if component in "ABC":
        return f"roll, pitch or yaw of {axis}"
    return f"squareness of {axis}" if effect.degree == 1 else f"straightness of {axis}"


def line_meaning(component: str, axis: str) -> str:
    """Name of a location error by ISO 230-1: squareness of two linear axes, position and tilt of a rotary axis."""
    along = own_component(axis)
    if component == along:
        return f"zero of {axis}"
    if axis[0] in "ABC":
        return f"{'position' if component in 'XYZ' else 'tilt'} of the line of {axis} " + (
            f"in {component}" if component in "XYZ" else f"about {'XYZ'['ABC'.index(component)]}"
        )
    (other,) = (letter for letter in "XYZ" if letter not in (along, "XYZ"["ABC".index(component)]))
    return f"squareness of {axis} to {other}"


def present(cause: Named) -> Iterator[str]:
    """Parameters in the present calibration of an effect that has changed, and their new values."""
    if cause.present is None:
        return
    table = zip(cause.present.parameter_table, cause.present.parameters, cause.effect.parameters, strict=True)
    for quantity, before, change in table:
        if quantity.linear:
            yield f"{quantity_name(quantity)} {before:.4g} {quantity.unit}, now {before + change:.4g} {quantity.unit}"


def in_full(name: str) -> str:
    """Name of an effect in a list with others: `cross-axis E_XY(X)`."""
    return f"cross-axis {name}" if name.startswith("E_") and "(" in name else name


def sizes(cause: Named) -> list[str]:
    """Parameters with their expanded uncertainties and units."""
    effect = cause.effect
    if cause.kind == "higher-frequency":
        basis = getattr(effect, "basis", None)
        return [f"{len(effect.parameters)} parameters" if basis is None else f"written with {basis.size} parameters"]
    if isinstance(effect, Unnamed):
        return [f"{effect.rms_um:.2g} um RMS over its ranges", f"{len(effect.terms)} terms"]
    if cause.kind == "outliers":
        return [f"{len(getattr(effect, 'rows', ()))} rows"]
    table = zip(effect.parameter_table, effect.parameters, effect.uncertainties, strict=True)
    texts = [f"{_label(q)} {with_uncertainty(value, u)} {q.unit}" for q, value, u in table]
    return [*_waves(effect), *shortened(texts, MANY, "parameters"), *_given(effect)]


def _waves(effect: Effect) -> Iterator[str]:
    """Order and amplitude of a cyclic error: waves per turn of a rotary axis, and its largest harmonics."""
    if not isinstance(effect, Cyclic):
        return
    unit, rotary = effect.parameter_table[1].unit, effect.axis[0] in "ABC"
    amplitudes = [math.hypot(sine, cosine) for sine, cosine in zip(effect.sine, effect.cosine, strict=True)]
    order = round(TURN / effect.period)
    whole = rotary and order > 0 and abs(order * effect.period / TURN - 1.0) < WHOLE
    for k, amplitude in enumerate(amplitudes, start=1):
        if amplitude >= SMALL_WAVE * max(amplitudes):
            name = (
                f"order {order * k} of the turn"
                if whole
                else f"wave of {effect.period / k:.4g} {'deg' if rotary else 'mm'}"
            )
            degrees = f" ({math.degrees(amplitude * 1e-6):.3g} deg)" if unit == "urad" and amplitude > LARGE else ""
            yield f"{name}: amplitude {amplitude:.4g} {unit}{degrees}"


def _given(effect: Effect) -> Iterator[str]:
    """Conditions of a size: the moment of a jump, the fixed point of a growth."""
    if isinstance(effect, (StationShift, TargetOffset, LocationJump)) and effect.since_s is not None:
        yield f"from {effect.since_s / HOUR:.4g} h on"
    if isinstance(effect, LocationJump) and effect.turns and effect.fixed_point:
        yield f"about {effect.axis} {effect.fixed_point:.5g} mm"
    if isinstance(effect, AngleStep):
        yield f"from {effect.over} {effect.above_deg:.4g} deg on"
    if isinstance(effect, (GrowthWithSensor, GrowthWithTime, QuadraticGrowth, GrowthWithDuty)):
        yield f"from {effect.axis} {effect.fixed_point:.5g} mm"


def with_uncertainty(value: float, u: float) -> str:
    """A value with its expanded uncertainty, rounded to two digits of the latter; `u` is the standard uncertainty."""
    expanded = COVERAGE * u
    if not 0.0 < expanded < math.inf:
        return f"{value:.4g}"
    digits = max(1 - math.floor(math.log10(expanded)), 0)
    return f"{round(value, digits) + 0.0:.{digits}f} ± {expanded:.{digits}f}"


def quantity_name(quantity: Parameter) -> str:
    """Name of a parameter without its unit; of a vector or list with its component or number: `shift x`, `sine 1`."""
    name, _, index = quantity.name.rstrip("]").partition("[")
    name = name.removesuffix(f"_{quantity.unit.replace('/', '_per_').lower()}").replace("_", " ")
    if not index:
        return name
    vector = name in ("shift", "turn", "offset")
    return f"{name} {'xyz'[int(index) % 3]}" if vector else f"{name.removesuffix('s')} {int(index) + 1}"


def _label(quantity: Parameter) -> str:
    """Name of a parameter before its value; a number at its end is divided from the value."""
    name = quantity_name(quantity)
    return f"{name}:" if name[-1].isdigit() else name


def odds(value: float) -> str:
    """Odds as text, with few digits."""
    return f"{value:.0f}" if value < 1e4 else f"{value:.0e}" if value < 1e99 else "> 1e99"


def held_out(cause: Named) -> str:
    """Change of the held-out RMS, um, that the cause brought."""
    return f"{round(-cause.heldout_gain_um, 2) + 0.0:+.2f}"


def verdict(cause: Named) -> str:
    """The verdict in one word; a tie in capitals."""
    return cause.verdict.upper() if cause.verdict == "tied" else cause.verdict


def workshop(effect: Effect) -> Workshop:
    """Usual origin of an effect in the workshop, and its repair."""
    return WORKSHOP[effect.kind]


def remedy(effect: Effect) -> str:
    """Remedy of an effect, as text."""
    if effect.ACTS_ON == "instrument":
        return "It is an effect of the instrument: it is removed from the data and not written to the calibration."
    return REMEDIES[effect.REMEDY]
