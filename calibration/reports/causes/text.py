"""Names, sizes and remedies of causes as text."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Protocol

from kinematics.effects import Effect, Parameter
from kinematics.error_model.covariance import COVERAGE_FACTOR
from rendering.report import shortened

MOST_PRINTED_PARAMETERS = 8
"""Most parameters of a cause that are printed; the JSON has all."""
MOST_PRINTED_WAVES = 3
"""Most waves of a cause that are printed."""
REMEDIES = {
    "program": "The corrected program (ncomp) compensates it; a table of one axis cannot.",
    "table": "A compensation table of the axis or the corrected program compensates it.",
    "bidirectional table": "A bidirectional table compensates it, or the corrected program at each reversal.",
    "none": "A correction in advance is not possible: mend the machine or its control.",
}
"""Meaning of an effect's remedy (docs/effects.md) in the workshop."""


class Told(Protocol):
    """A cause as reports need it."""

    @property
    def kind(self) -> str:
        """Kind in the contract of the diagnosis."""

    @property
    def effect(self) -> Effect:
        """The effect with its size."""

    @property
    def where(self) -> str:
        """What it is an error of: the machine or the instrument."""

    @property
    def present(self) -> Effect | None:
        """Effect of the present calibration that it changes; None where it is a cause of its own."""

    @property
    def share(self) -> float:
        """Share of the squared residuals without causes that it explains."""

    @property
    def verdict(self) -> str:
        """How sure it is."""

    @property
    def heldout_gain_um(self) -> float:
        """Improvement of the prediction of held-out blocks."""


def title(cause: Told) -> str:
    """Title of a cause: its kind and its axis or component, with a mark for the instrument."""
    if cause.kind == "higher-frequency":
        return f"{cause.effect.name} needs a higher spatial frequency"
    if not cause.effect.NAMES_CAUSE:
        return f"{cause.effect.name}: no cause"
    changed = cause.present is not None or cause.effect.OF_AXIS_LINE
    change = "change of " if changed else ""
    name = cause.effect.name if cause.kind == "location" else in_full(cause.effect.name)
    meaning = cause.effect.meaning
    return f"{change}{name}" + (f" ({meaning})" if meaning else " (instrument)" if cause.where == "instrument" else "")


def present(cause: Told) -> Iterator[str]:
    """Parameters in the present calibration of an effect that has changed, and their new values.

    None of an error motion whose change is in another basis.
    """
    if cause.present is None or getattr(cause.present, "basis", None) != getattr(cause.effect, "basis", None):
        return
    table = zip(cause.present.parameter_table, cause.present.parameters, cause.effect.parameters, strict=True)
    for quantity, before, change in table:
        if quantity.linear:
            yield f"{quantity_name(quantity)} {before:.4g} {quantity.unit}, now {before + change:.4g} {quantity.unit}"


def in_full(name: str) -> str:
    """Name of an effect in a list with others: `cross-axis E_XY(X)`."""
    return f"cross-axis {name}" if name.startswith("E_") and "(" in name else name


def sizes(cause: Told) -> list[str]:
    """Parameters with their expanded uncertainties and units; of a periodic error its waves and its period."""
    effect = cause.effect
    if cause.kind == "higher-frequency":
        basis = getattr(effect, "basis", None)
        return [f"{len(effect.parameters)} parameters" if basis is None else f"written with {basis.size} parameters"]
    if effect.size_summary:
        return list(effect.size_summary)
    table = zip(effect.parameter_table, effect.parameters, effect.uncertainties, strict=True)
    listed = [row for row in table if not (row[0].held or (effect.waves and row[0].linear))]
    texts = [f"{_label(q)} {with_uncertainty(value, u)} {q.unit}" for q, value, u in listed]
    return [
        *shortened(effect.waves, MOST_PRINTED_WAVES, "waves"),
        *shortened(texts, MOST_PRINTED_PARAMETERS, "parameters"),
        *effect.conditions,
    ]


def with_uncertainty(value: float, u: float) -> str:
    """A value with its expanded uncertainty, rounded to two digits of the latter; `u` is the standard uncertainty."""
    expanded = COVERAGE_FACTOR * u
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


def similarity(cosine: float, *, tied: bool) -> str:
    """The cosine of two signals; only signals that the data do not separate are shown as the same."""
    text = f"{cosine:.2f}"
    return text if tied or text != "1.00" else "> 0.99"


def held_out(cause: Told) -> str:
    """Change of the held-out RMS, um, that the cause brought."""
    return f"{round(-cause.heldout_gain_um, 2) + 0.0:+.2f}"


def verdict(cause: Told) -> str:
    """The verdict in one word; a tie in capitals."""
    return cause.verdict.upper() if cause.verdict == "tied" else cause.verdict


def remedy(effect: Effect) -> str:
    """Remedy of an effect, as text."""
    if effect.ACTS_ON == "instrument":
        return "It is an effect of the instrument: it is removed from the data and not written to the calibration."
    return REMEDIES[effect.REMEDY]
