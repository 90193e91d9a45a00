"""Results of a diagnosis (contract 4.3): missing causes, their verdicts, the residual and the next measurement."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from calibration.diagnosis.result import Diagnosis
from calibration.diagnosis.search.linearised_fit import LinearisedFit
from calibration.diagnosis.terms.conclusion.fitted_rows import FittedRows
from calibration.diagnosis.verdict import Named
from calibration.observation.normal_equations import whitened, whiteners
from calibration.reports.causes import text as words
from calibration.reports.causes.at_positions import at_positions, covariance_of
from calibration.reports.causes.figures import cause_figure, share_chart
from calibration.reports.causes.residual import residual_sections
from calibration.reports.causes.views import views
from calibration.reports.diagnosed.commands import Files, use_section
from calibration.reports.fit import acceptance, between_positions, insignificant, left_out_sentence
from calibration.reports.head import foot_of, measured_head
from calibration.reports.machine_change import change_sections, change_sentences
from calibration.reports.run_zeros import zeros_section
from calibration.reports.separability import separability_section
from kinematics.files.number_text import probability, rounded
from rendering.figures import percent
from rendering.report import Report, Section, Table, facts, shortened
from rendering.volume import Field, uncertainty_of, volume_section

if TYPE_CHECKING:
    from calibration.diagnosis.search.start_model import Origin

ORIGINS: dict[Origin, str] = {
    "automatic": "error motions of all axes, their bases selected by the evidence",
    "refitted": "the given calibration, made from these data: its structure, fitted again",
    "updated": "the given calibration, with its uncertainties as prior knowledge",
}
LISTED = 8
"""Most outliers that are listed, and most tests; the JSON has all."""
SIMILAR = 3
"""Most similar causes that are listed for one cause."""
SIGNS = (
    "Errors are actual minus nominal, tool relative to workpiece (ISO 841, ISO 230-1), in um and urad. Errors of the "
    "instrument are observed minus true. A correction has the opposite sign. U is the expanded uncertainty (k=2)."
)
LEGEND = (
    "A dBIC below -10 means odds above 150 to 1. Held out is the change of the RMS of held-out residuals by the cause. "
    "TIED means that these data do not distinguish the cause from the similar causes that are marked so."
)
READINGS = "residuals plus the fitted cause"
HOW_DRAWN = {
    "dots": f"Small dots are single rows ({READINGS}), large dots their means; black or a line is the fitted cause.",
    "map": f"The left map has means of rows ({READINGS}), without uncertain ones; the right map is the fitted cause.",
}


def _worse_than_none(found: Diagnosis) -> Iterator[str]:
    """The first sentence where the machine is better without its present calibration."""
    worse = found.acceptance.worse_than_none
    if worse is not None:
        unit = found.measurement.unit
        yield (
            f"The present calibration is WORSE THAN NONE: on these rows it leaves {worse.rms_um:.3g} {unit} RMS, and "
            f"the machine without a correction {worse.other_rms_um:.3g} {unit}. It is of another state of the machine, "
            "or an axis was referenced anew. Do not correct with it, and repeat the diagnosis without --calibration."
        )


def _confirmed(found: Diagnosis) -> Iterator[str]:
    """The first sentence where the data confirm the present calibration."""
    present = found.acceptance.present
    if found.acceptance.confirmed and present is not None:
        larger, unit = " but for larger uncertainties" if found.widened > 1.0 else "", found.measurement.unit
        yield (
            f"CONFIRMED: the present calibration predicts held-out {present.name} as well "
            f"({present.other_rms_um:.2f} {unit} RMS) as one that these data update ({present.rms_um:.2f} {unit}). It "
            f"stays: the new file holds it unchanged{larger}."
        )


def diagnosis_report(found: Diagnosis, command: str, files: Files | None = None) -> Report:
    """The diagnosis for people; `command`: the command that made it; files: those of the commands in the report."""
    files = files or Files(found.measurement.machine.name, "NEW.json", "OLD.json")
    title = f"Diagnosis of {found.measurement.machine.name}"
    lead = f"{found.measurement.source} · {found.model.provenance.made_at:%Y-%m-%d %H:%M} UTC"
    verdict = [
        *_worse_than_none(found),
        *_confirmed(found),
        *(f"NOTE: {each.message}." for each in found.findings if each.check == "chain"),
        *change_sentences(found.machine_change),
        *insignificant(found.significant_share),
        _verdict(found),
        *left_out_sentence(found.after.fit),
    ]
    head = measured_head(found.measurement, found.model if found.accepted else None, command)
    refusal, foot = acceptance(found.acceptance), foot_of(title, lead, found.model if found.accepted else None)
    return Report(title, lead, list(_sections(found, files)), "\n".join(verdict), refusal, head, foot)


def _verdict(found: Diagnosis) -> str:
    """The result in a few sentences."""
    before, after = found.figures
    unit = found.measurement.unit
    improvement = (
        f"residual {_changed(before.rms_um, after.rms_um)} {unit} RMS, held-out {found.held_out_name} "
        f"{_changed(before.heldout_rms_um, after.heldout_rms_um)} {unit}"
    )
    missing = found.conclusion.missing("; ".join(map(_named, found.causes)), improvement)
    return f"{missing} Unexplained residual: {found.conclusion.residual(after.rms_um, found.noise_um)}."


def _changed(before: float, after: float) -> str:
    """A figure before and after; once where it has not changed."""
    texts = f"{before:.2f}", f"{after:.2f}"
    return " -> ".join(dict.fromkeys(texts))


def _named(cause: Named) -> str:
    """A cause, its size where that is one number, and its verdict."""
    one = len(cause.effect.parameters) == 1 or cause.kind == "outliers"
    size = f" ({', '.join(words.sizes(cause))})" if one else ""
    tied = [words.in_full(other.name) for other in cause.alternatives if other.tied] if cause.verdict == "tied" else []
    tie = f" with {', '.join(shortened(tied, SIMILAR, 'causes'))}" if tied else ""
    return f"{words.title(cause)}{size}, {words.verdict(cause)}{tie}"


def _sections(found: Diagnosis, files: Files) -> Iterator[Section]:
    yield from _causes(found)
    yield from _map(found)
    yield facts("Data, model, noise", list(_facts(found)))
    if found.repeats is not None:
        rows = [(c.name, f"{c.noise:.3g}", f"{c.specified:.3g}", c.unit) for c in found.repeats.components]
        table = Table(("standard uncertainty (k=1)", "from repeats", "specified", "unit"), rows)
        yield Section("Noise of the instrument", table=table, detail=True)
    yield from change_sections(found.machine_change)
    yield from residual_sections(found)
    yield from _not_shown(found)
    yield from zeros_section(found.after.fit)
    if left_out := list(_left_out(found)):
        yield Section("Left out", "\n".join(left_out))
    if notes := list(_notes(found)):
        yield Section("Notes", "\n".join(notes))
    yield Section("Next", found.next_measurement)
    rows = [
        (move.name, f"{move.minutes:.0f}", f"{move.gain_per_minute:.2g}", move.text)
        for move in found.proposed_measurements
        if move.minutes
    ]
    if rows:
        head = ("measurement", "minutes", "information, noise variances per minute", "instruction and expected result")
        yield Section("Proposed measurements", table=Table(head, rows), detail=True)
    yield use_section(files, found.model)


def _map(found: Diagnosis) -> Iterator[Section]:
    """The errors of the machine by the new model, those that a correction by the present one leaves, and after."""
    old, new = (stage.fit.model for stage in (found.before, found.after))
    fields = [Field("without a correction", new)]
    if found.causes:
        fields.append(Field("with a correction by the present model", new, old))
    return volume_section(found.measurement.machine, [*fields, uncertainty_of(new)])


def _facts(found: Diagnosis) -> Iterator[tuple[str, str]]:
    measurement, choice, fit = found.measurement, found.base.choice, found.before.fit
    runs = 0 if measurement.run is None else len(set(measurement.run.tolist()))
    counted = f", {runs} run{'s' if runs > 1 else ''}" if runs else ""
    yield "data", f"{measurement.source}: {len(measurement)} rows, {fit.observations} observations{counted}"
    bases = "" if choice is None else ": " + ", ".join(f"{axis} {basis}" for axis, basis in choice.bases.items())
    finer = "".join(f", {effect.name} with {len(effect.parameters)}" for effect in found.finer)
    yield "model", f"{ORIGINS[found.base.origin]}{bases}; {len(fit.model.parameters)} parameters{finer}"
    for finding in found.findings:
        yield "note", finding.message
    repeats = found.repeats
    yield (
        "noise",
        "by the instrument specification; no position was measured again" if repeats is None else repeats.text,
    )
    if found.estimated_noise is not None:
        yield "estimated", found.estimated_noise.text
    significant = [f"{test.name} {probability(test.p_value)}" for test in found.tests if test.p_value < 1e-3]
    yield from between_positions(found.between_positions)
    yield "residual", "; ".join([f"chi2/dof {rounded(fit.chi2_reduced, 3)}", *shortened(significant, LISTED, "tests")])


def _causes(found: Diagnosis) -> Iterator[Section]:
    if not found.causes:
        return
    text = (
        "Blue: the machine. Orange: the instrument. 100 % are the squared residuals of the model without these causes. "
        "A share is what they would grow by if this cause alone were left out again. What two causes could both "
        "explain counts for neither or for both, so the shares need not sum up to 100 %."
    )
    ordered = sorted(found.causes, key=lambda cause: -cause.share)
    shop = [(words.title(cause), percent(cause.share), *cause.effect.workshop) for cause in ordered]
    table = Table(("cause", "share", "usual origin", "repair"), shop)
    yield Section("Share by cause", text, table, partial(share_chart, ordered, found.unexplained_share), detail=True)
    machine = found.measurement.machine
    numbered = [(str(number), words.title(cause), cause) for number, cause in enumerate(found.causes, start=1)]
    sizes = {n: at_positions(machine, c.effect, covariance_of(c.effect, found.model)) for n, _, c in numbered}
    rows = [
        (
            number,
            title,
            "\n".join(sizes.get(number) or words.sizes(cause)),
            f"{cause.delta_bic:.0f}",
            f"{round(-cause.heldout_gain_um, 2) + 0.0:+.2f}",
            percent(cause.share),
            words.verdict(cause),
        )
        for number, title, cause in numbered
    ]
    held_out = f"held out, {found.measurement.unit}"
    head = ("number", "cause", f"size ± U (k={words.COVERAGE})", "dBIC", held_out, "share", "verdict")
    yield Section("Causes", f"{SIGNS}\n{LEGEND}", Table(head, rows))
    yield from _similar(numbered)
    for number, title, cause in numbered:
        drawn = partial(cause_figure, views(_rows(found.after.linearised), cause.effect))
        yield Section(f"Cause {number}: {title}", "\n".join(_about(cause)), figure=drawn)


def _rows(linearised: LinearisedFit) -> FittedRows:
    """The rows of the measurement with the residuals of a linearised fit; those that it lacks are not good."""
    fit, rows, own = linearised.fit, linearised.rows, linearised.transform
    transform, good = np.zeros((len(fit.measurement), *own.shape[1:])), np.zeros(len(fit.measurement), bool)
    residual = whitened(whiteners(fit.measurement), fit.residual) / fit.variance_factor**0.5
    transform[rows], good[rows] = own, linearised.good
    residual[rows[linearised.good]] = linearised.residual.reshape(own.shape[:2])[linearised.good]
    return FittedRows(fit.measurement, transform, residual, good)


def _similar(numbered: Sequence[tuple[str, str, Named]]) -> Iterator[Section]:
    """The causes, with numbers and titles, beside others that would have nearly the same signal."""
    similar = [
        (
            number,
            title,
            words.in_full(other.name),
            words.similarity(other.cosine, tied=other.tied),
            words.odds(other.odds),
            "TIED" if other.tied else "less likely",
        )
        for number, title, cause in numbered
        for other in sorted(cause.alternatives, key=lambda other: not other.tied)[:SIMILAR]
    ]
    if similar:
        text = (
            "These other causes would have nearly the same signal in these data: a similarity of 1 is the same signal. "
            "The odds tell how many times likelier the cause is than the similar one, by all data together. TIED "
            "means that the data do not decide between them."
        )
        columns = ("number", "cause", "similar cause", "similarity", "odds for the cause", "verdict")
        yield Section("Similar causes", text, Table(columns, similar))


def _about(cause: Named) -> Iterator[str]:
    effect = cause.effect
    title = type(effect).TITLE
    meaning = " ".join((inspect.getdoc(type(effect)) or "").replace("`", "").split())
    yield f"{title[0].upper()}{title[1:]}. {meaning}"
    if cause.kind != "outliers":
        drawn = HOW_DRAWN["map" if effect.SHOWN_OVER == "two axes" else "dots"]
        yield f"Model and registration cannot imitate {cause.visible:.0%} of its signal. {drawn}"
    yield f"Remedy: {words.remedy(effect)}"
    yield from (f"Present calibration: {text}." for text in words.present(cause))
    yield from (f"Note: {note}." for note in cause.notes)


def _not_shown(found: Diagnosis) -> Iterator[Section]:
    """Causes that these data cannot show or test, and the smallest sizes of the others that they would show."""
    yield separability_section(found.design)
    by_remedy: dict[str, list[str]] = {}
    for entry in found.not_visible:
        by_remedy.setdefault(entry.remedy, []).append(f"{words.in_full(entry.name)} ({entry.share:.2f})")
    for motion in found.identifiability.unidentifiable if found.identifiability else ():
        by_remedy.setdefault(motion.remedy, []).append(" + ".join(motion.effects))
    if by_remedy:
        text = (
            "These data do not show the following causes (NOT VISIBLE). The number in brackets is the share of the "
            "signal that model and registration cannot imitate."
        )
        hidden = [(", ".join(names), remedy) for remedy, names in by_remedy.items()]
        yield Section("Unidentifiable causes", text, Table(("cause", "measurement that would show it"), hidden))
    lacking: dict[str, list[str]] = {}
    for cause in found.untested:
        lacking.setdefault(cause.lacks, []).append(words.in_full(cause.name))
    if lacking:
        untested = [(", ".join(names), lacks) for lacks, names in lacking.items()]
        yield Section("Not tested", table=Table(("cause", "columns that the data lack"), untested), detail=True)
    smallest: dict[tuple[str, str], list[str]] = {}
    for name, size, unit in sorted(found.smallest):
        kind, _, where = name.partition(" ")
        smallest.setdefault((kind, unit), []).append(f"{where} {rounded(size)}".strip())
    if smallest:
        sizes = [(kind, ", ".join(sizes), unit) for (kind, unit), sizes in smallest.items()]
        table = Table(("cause", "smallest size that these data show", "unit"), sizes)
        yield Section("Detection limits", table=table, detail=True)


def _left_out(found: Diagnosis) -> Iterator[str]:
    """Runs, set-ups and rows that were left out of the fit, with the reasons."""
    fit = found.after.fit
    if fit.failed:
        kind = "runs" if fit.measurement.axis is not None else "set-ups"
        yield f"{kind} {', '.join(fit.failed)}: most of their rows disagree with the other rows or the model"
    outliers = [
        f"{found.measurement.where(int(row))}: outlier, {fit.residual_um[row]:.1f} {fit.measurement.unit} from the "
        "other rows"
        for row in fit.outliers
    ]
    yield from shortened(outliers, LISTED, "outliers")


def _notes(found: Diagnosis) -> Iterator[str]:
    """Weaknesses of the result, and notes on unnamed effects, on the causes and on effects of the instrument."""
    yield from found.conclusion.notes
    if found.unnamed:
        yield found.unnamed
    for cause in found.causes:
        yield from (f"{words.in_full(cause.effect.name)}: {note}" for note in cause.notes)
        if cause.where == "instrument":
            yield f"{cause.effect.name}: {words.remedy(cause.effect)}"
