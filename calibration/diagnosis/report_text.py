"""Text of a diagnosis, shared by the terminal and the page."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from kinematics.effects import Effect, GrowthWithSensor, GrowthWithTime, Parameter, StationShift, Unnamed
from kinematics.effects.base import HOUR

if TYPE_CHECKING:
    from calibration.diagnosis.diagnose import Diagnosis
    from calibration.diagnosis.search.start_model import Origin
    from calibration.diagnosis.verdict import Alternative, Named

MANY = 8
"""Most parameters of a cause, and most outliers, that are printed; the JSON has all."""
SIBLINGS = 3
FAR = 4.0
"""Ratio of the residual variance to the specified variance, or its inverse, above which a note is printed."""
FEW = 20.0
"""Degrees of freedom below which a note is printed: a result without causes then means little."""
COVERAGE = 2
ORIGINS: dict[Origin, str] = {
    "automatic": "error motions of all axes, their basis by the evidence",
    "refitted": "the given calibration, made from these data: its structure, fitted anew",
    "updated": "the given calibration, with its uncertainties as prior knowledge",
}
REMEDIES = {
    "program": "the corrected program (ncomp) puts it right; no table of one axis can",
    "table": "a compensation table of the axis puts it right, and so does the corrected program",
    "bidirectional table": "a bidirectional table puts it right, and so does the corrected program, at each reversal",
    "none": "nothing that is known before the cut puts it right: it is a matter for the machine or its control",
}
"""Meaning of an effect's remedy (docs/effects.md) in the workshop."""


def title(cause: Named) -> str:
    """Title of a cause: its kind and its axis or component, with a mark for the instrument."""
    if cause.kind == "higher-frequency":
        return f"{cause.effect.name} needs a higher spatial frequency"
    if isinstance(cause.effect, Unnamed):
        return f"{cause.effect.name}: no cause"
    change = "change of " if cause.kind == "error-motion" else ""
    name = cause.effect.name if change or cause.kind == "location" else in_full(cause.effect.name)
    return f"{change}{name}" + (" (instrument)" if cause.where == "instrument" else "")


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
    told = [f"{quantity_name(q)} {with_uncertainty(value, u)} {q.unit}" for q, value, u in table]
    return [*told[:MANY], *([f"and {len(told) - MANY} more"] if len(told) > MANY else []), *_given(effect)]


def _given(effect: Effect) -> Iterator[str]:
    """Conditions of a size: the moment of a station shift, the fixed point of a growth."""
    if isinstance(effect, StationShift) and effect.since_s is not None:
        yield f"from {effect.since_s / HOUR:.4g} h on"
    if isinstance(effect, (GrowthWithSensor, GrowthWithTime)):
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
    return f"{name} {'xyz'[int(index) % 3] if vector else int(index) + 1}"


def odds(value: float) -> str:
    """Odds as text, with few digits."""
    return f"{value:.0f}" if value < 1e4 else f"{value:.0e}" if value < 1e99 else "> 1e99"


def held_out(cause: Named) -> str:
    """Change of the held-out RMS, um, that the cause brought."""
    return f"{round(-cause.heldout_gain_um, 2) + 0.0:+.2f}"


def sibling(other: Alternative) -> str:
    """Name of another cause, its cosine, and the odds of the named cause against it."""
    return f"{in_full(other.name)} (cosine {other.cosine:.2f}, odds {odds(other.odds)})"


def verdict(cause: Named) -> str:
    """The verdict in one word; a tie in capitals."""
    return cause.verdict.upper() if cause.verdict == "tied" else cause.verdict


def remedy(effect: Effect) -> str:
    """Remedy of an effect, as text."""
    if effect.ACTS_ON == "instrument":
        return "it is the instrument's: taken out of the data, not written into the machine"
    return REMEDIES[effect.REMEDY]


def hidden(found: Diagnosis) -> dict[str, list[str]]:
    """Causes that the data do not show, by remedy, each with the share of its signal that is its own."""
    by_remedy: dict[str, list[str]] = {}
    for entry in found.not_visible:
        by_remedy.setdefault(entry.remedy, []).append(f"{in_full(entry.name)} ({entry.share:.2f})")
    return by_remedy


def notes(found: Diagnosis) -> Iterator[str]:
    """Notes on the unnamed effects, on the causes and on effects of the instrument."""
    if found.unnamed:
        yield found.unnamed
    for cause in found.causes:
        for note in cause.notes:
            yield f"{in_full(cause.effect.name)}: {note}"
        if cause.where == "instrument":
            yield f"{cause.effect.name}: {remedy(cause.effect)}"


def model_line(found: Diagnosis) -> str:
    """One line on the present model."""
    choice = found.base.choice
    bases = "" if choice is None else ": " + ", ".join(f"{axis} {basis}" for axis, basis in choice.bases.items())
    return f"{ORIGINS[found.base.origin]}{bases}; {len(found.before.fit.model.parameters)} parameters"


def data_line(found: Diagnosis) -> str:
    """One line on the data."""
    measurement = found.measurement
    count = 0 if measurement.run is None else len(set(measurement.run.tolist()))
    runs = f", {count} run{'s' if count > 1 else ''}" if count else ""
    return f"{measurement.source}: {len(measurement)} rows, {found.before.fit.observations} observations{runs}"


def missing(found: Diagnosis) -> bool:
    """True unless the present model explains all the data."""
    return bool(found.causes or found.unexplained or found.after.fit.failed)


def left_out(found: Diagnosis) -> Iterator[str]:
    """Runs, set-ups and rows that were left out of the fit, with the reasons."""
    fit = found.after.fit
    if fit.failed:
        what = "runs" if fit.measurement.instrument.components == 1 else "set-ups"
        yield f"{what} {', '.join(fit.failed)}: most of their rows disagree with the rest or the model, none was used"
    for row in fit.outliers[:MANY]:
        yield f"{found.measurement.where(int(row))}: outlier, {fit.residual_um[row]:.1f} um from the rest"
    if len(fit.outliers) > MANY:
        yield f"... and {len(fit.outliers) - MANY} more outliers"


def doubt(found: Diagnosis) -> Iterator[str]:
    """Notes on weaknesses of the result: few degrees of freedom, or residuals far from the specified noise."""
    fit = found.after.fit
    if fit.degrees_of_freedom < FEW:
        freedom = f"{fit.degrees_of_freedom:.0f} degrees of freedom"
        yield f"{fit.observations} observations leave {freedom}: too few to say much"
    elif fit.variance_factor == 1.0:
        estimate = "--noise estimate takes it from the residuals"
        if fit.chi2_reduced < 1 / FAR:
            yield f"chi2/dof {fit.chi2_reduced:.2g}: the sheet says more noise than there is; {estimate}"
        elif fit.chi2_reduced > FAR and found.unexplained is None:
            yield (
                f"chi2/dof {fit.chi2_reduced:.2g} with nothing left that depends on anything: the sheet says less "
                f"noise than there is; {estimate}"
            )


def left_line(found: Diagnosis) -> str:
    """Remaining residual, also in units of the noise, and the variables that it depends on."""
    rms, left = found.after.fit.rms_um, found.unexplained
    depends = "depends on nothing that is known of the data"
    if left is not None:
        share = "more" if found.with_unnamed else "of it"
        depends = (
            f"{found.unexplained_um:.2f} um {share} depend on {', '.join(left.variables)} (p = {left.p_value:.2g})"
        )
        depends += ", added without a name" if found.with_unnamed else ""
    return f"{rms:.2f} um RMS, {rms / max(found.noise_um, 1e-12):.2f} times the noise; {depends}"
