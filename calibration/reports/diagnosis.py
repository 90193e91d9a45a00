"""Results of a diagnosis (contract 4.3): missing causes, their verdicts, the residual and the next measurement."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Sequence
from functools import partial
from shlex import quote
from typing import TYPE_CHECKING, NamedTuple

from calibration.diagnosis.residual.dependence import Unexplained
from calibration.diagnosis.residual.whiteness import Test, combined
from calibration.diagnosis.result import LEFT, Diagnosis
from calibration.diagnosis.unseen.swing import FoundSwing
from calibration.diagnosis.verdict import Named
from calibration.reports.causes import text as words
from calibration.reports.causes.figures import cause_figure
from calibration.reports.causes.views import views
from calibration.reports.diagnosis_json import models_compared
from calibration.reports.figures.residuals import (
    against_noise,
    before_and_after,
    by_direction,
    share_chart,
    unexplained_shape,
)
from calibration.reports.fit import acceptance, between_positions, insignificant
from calibration.reports.head import measured_head
from calibration.reports.machine_change import change_sections, change_sentences
from calibration.reports.run_zeros import zeros_section
from calibration.reports.separability import separability_section
from kinematics.effects import CrossAxis
from kinematics.files.number_text import p_value, probability, rounded
from rendering.figures import percent
from rendering.report import Report, Section, Table, facts, shortened
from rendering.volume import Field, volume_section

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
OBSERVED = "Residuals are observed minus expected, in x, y, z of the part that carries the instrument."


def _confirmed(found: Diagnosis) -> Iterator[str]:
    """The first sentence where the data confirm the present calibration."""
    present = found.acceptance.present
    if found.acceptance.confirmed and present is not None:
        larger = " but for larger uncertainties" if found.widened > 1.0 else ""
        yield (
            f"CONFIRMED: the present calibration predicts held-out {present.name} as well "
            f"({present.other_rms_um:.2f} um RMS) as one that these data update ({present.rms_um:.2f} um). It stays: "
            f"the new file holds it unchanged{larger}."
        )


class Files(NamedTuple):
    """Names for the commands of a report: machine or its file, file of the new calibration, and of the present one."""

    machine: str
    new: str
    present: str | None = None


def diagnosis_report(found: Diagnosis, command: str, files: Files | None = None) -> Report:
    """The diagnosis for people; `command`: the command that made it; files: those of the commands in the report."""
    files = files or Files(found.measurement.machine.name, "NEW.json", "OLD.json")
    title = f"Diagnosis of {found.measurement.machine.name}"
    lead = f"{found.measurement.source} · {found.model.provenance.made_at:%Y-%m-%d %H:%M} UTC"
    verdict = [
        *_confirmed(found),
        *(f"NOTE: {each.message}." for each in found.findings if each.check == "chain"),
        *change_sentences(found.machine_change),
        *insignificant(found.significant_share),
        _verdict(found),
    ]
    refusal, design = acceptance(found.acceptance), [separability_section(found.design)]
    head = measured_head(found.measurement, found.model if found.accepted else None, command)
    return Report(title, lead, list(_sections(found, files)), "\n".join(verdict), refusal, design, head)


def _verdict(found: Diagnosis) -> str:
    """The result in a few sentences."""
    before, after = found.figures
    improvement = (
        f"residual {before.rms_um:.2f} -> {after.rms_um:.2f} um RMS, held-out {found.held_out_name} "
        f"{before.heldout_rms_um:.2f} -> {after.heldout_rms_um:.2f} um"
    )
    missing = found.conclusion.missing("; ".join(map(_named, found.causes)), improvement)
    return f"{missing} Unexplained residual: {found.conclusion.residual(after.rms_um, found.noise_um)}."


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
    yield from _residuals(found)
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
    text = f"{files.new} holds the machine with the causes of the machine (calibration {found.model.id})."
    commands = Table(("task", "command"), _commands(files))
    yield Section("Use of the new calibration", text, commands, detail=True)


def _map(found: Diagnosis) -> Iterator[Section]:
    """The errors of the machine by the new model, those that a correction by the present one leaves, and after."""
    old, new = (stage.fit.model for stage in (found.before, found.after))
    fields = [Field("without a correction", new)]
    if found.causes:
        fields.append(Field("before, with a correction by the present model", new, old))
    fields.append(Field("after a correction by the new model, U (k=2)", new, uncertain=True))
    return volume_section(found.measurement.machine, fields)


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
        "Blue: the machine. Orange: the instrument. Overlapping causes explain a common part: the sum of "
        "the bars may differ from 100 %."
    )
    ordered = sorted(found.causes, key=lambda cause: -cause.share)
    shop = [(words.title(cause), percent(cause.share), *words.workshop(cause.effect)) for cause in ordered]
    table = Table(("cause", "share", "usual origin", "repair"), shop)
    yield Section("Share by cause", text, table, partial(share_chart, found), detail=True)
    numbered = [(str(number), words.title(cause), cause) for number, cause in enumerate(found.causes, start=1)]
    rows = [
        (
            number,
            title,
            "\n".join(words.sizes(cause)),
            f"{cause.delta_bic:.0f}",
            f"{round(-cause.heldout_gain_um, 2) + 0.0:+.2f}",
            percent(cause.share),
            words.verdict(cause),
        )
        for number, title, cause in numbered
    ]
    head = ("number", "cause", f"size ± U (k={words.COVERAGE})", "dBIC", "held out, um", "share", "verdict")
    yield Section("Causes", f"{SIGNS}\n{LEGEND}", Table(head, rows))
    similar = [
        (number, title, words.in_full(other.name), f"{other.cosine:.2f}", words.odds(other.odds), "TIED" * other.tied)
        for number, title, cause in numbered
        for other in sorted(cause.alternatives, key=lambda other: not other.tied)[:SIMILAR]
    ]
    if similar:
        text = "Their effect on these data is nearly the same; odds: of the cause against the similar one."
        yield Section(
            "Similar causes", text, Table(("number", "cause", "similar cause", "cosine", "odds", "verdict"), similar)
        )
    for number, title, cause in numbered:
        drawn = partial(cause_figure, views(found.after.linearised, cause.effect))
        yield Section(f"Cause {number}: {title}", "\n".join(_about(cause)), figure=drawn)


def _about(cause: Named) -> Iterator[str]:
    effect = cause.effect
    title = type(effect).TITLE
    meaning = " ".join((inspect.getdoc(type(effect)) or "").replace("`", "").split())
    yield f"{title[0].upper()}{title[1:]}. {meaning}"
    if cause.kind != "outliers":
        drawn = HOW_DRAWN["map" if isinstance(effect, CrossAxis) else "dots"]
        yield f"Model and registration cannot imitate {cause.visible:.0%} of its signal. {drawn}"
    yield f"Remedy: {words.remedy(effect)}"
    yield from (f"Present calibration: {text}." for text in words.present(cause))
    yield from (f"Note: {note}." for note in cause.notes)


def _residuals(found: Diagnosis) -> Iterator[Section]:
    rows = [
        (name, f"{f.rms_um:.2f}", f"{f.max_um:.1f}", f"{f.chi2_reduced:.2f}", f"{f.heldout_rms_um:.2f}")
        for name, f in zip(("before", "after"), found.figures, strict=True)
    ]
    rows += [(f"the same rows, {name}", "", "", "", f"{rms:.2f}") for name, rms in models_compared(found)]
    rows.append(("noise alone", f"{found.noise_um:.2f}", "", "1", ""))
    table = Table(("residual, um", "RMS", "max", "chi2/dof", "held out, RMS"), rows)
    text = (
        f"{OBSERVED} Max is the largest length. Before and after are of the same rows. Held-out residuals are those of "
        f"{found.held_out_name}, each predicted by a fit of all others."
    )
    yield Section("Residual before and after", text, table, partial(before_and_after, found))
    before, after = found.by_direction["before"], found.by_direction["after"]
    directions = [(name, f"{before[name]:.2f}", f"{after.get(name, float('nan')):.2f}") for name in before]
    table = Table(("residual RMS, um (rotary axes urad)", "before", "after"), directions)
    approached = found.measurement.state.approach is not None
    drawn = partial(by_direction, found) if approached else None
    yield Section("By direction, and in the volume", "\n".join(_volume(found)), table, drawn)
    yield Section("Residual against noise", figure=partial(against_noise, found))
    if found.tests:
        text = (
            "Each p is the probability of so large a value under pure noise. A test is marked where all tests together "
            f"leave a probability below {100 * LEFT:.0f} %. The tests along a variable use the correlation of adjacent "
            "rows, the others different means, or a slope."
        )
        yield Section("Tests of the residual", text, _tests(found), detail=True)
    yield _unexplained(found)


def _volume(found: Diagnosis) -> Iterator[str]:
    volume = found.volume
    yield (
        f"Error of the machine over the measured positions, by the new model: {volume.machine_rms:.2f} um RMS, "
        f"{volume.machine_max:.1f} um at most (after the best common shift and rotation)."
    )
    if found.causes:
        yield (
            f"Error after a correction by the present model, by the new one: {volume.left_rms:.2f} um RMS, "
            f"{volume.left_max:.1f} um at most."
        )
    if found.closure:
        yield f"No error motion of an axis explains {found.closure:.0%} of the residual beyond the noise."


def _tests(found: Diagnosis) -> Table:
    after = {test.name: test for test in found.tests_after}
    marked = [{test.name for test in combined(tests, LEFT)} for tests in (found.tests, found.tests_after)]
    rows = [(test.name, *_tested(test, marked[0]), *_tested(after.get(test.name), marked[1])) for test in found.tests]
    return Table(("residuals", "p before", "result before", "p after", "result after"), rows)


def _tested(test: Test | None, marked: set[str]) -> tuple[str, str]:
    return ("", "") if test is None else (p_value(test.p_value), "not noise" if test.name in marked else "")


def _unexplained(found: Diagnosis) -> Section:
    left = found.unexplained
    if left is None:
        return Section("Unexplained", f"{found.conclusion.unexplained}{_few_rows(found.widened)}")
    consequences = (
        f"{_of_readings(left)}{_of_any_period(left)}{_swing(found.swing)}{_beside(found)}{_widened(found.widened)}"
    )
    text = (
        f"{found.unexplained_um:.2f} um RMS depend on {left.listed} ({probability(left.p_value, 2)}), and no cause "
        f"of the library explains them.{consequences}\n"
        "The table tests each variable alone: its squared distance correlation (without bias, about 0 where "
        "independent), and the p-value among residuals permuted in blocks, as it is and adjusted by Benjamini and "
        "Hochberg. Variables that act only jointly are not found.\nThe figure is "
        f"the smooth shape over these variables, um. {OBSERVED}"
    )
    rows = [(o.variable, f"{o.correlation:.3f}", f"{o.p_value:.2g}", f"{o.adjusted:.2g}") for o in found.one_by_one]
    alone = Table(("variable", "distance correlation, squared", "p", "adjusted p"), rows)
    return Section("Unexplained", text, alone, partial(unexplained_shape, found))


def _few_rows(factor: float) -> str:
    if factor == 1.0:
        return ""
    return (
        " The data leave open further causes, other forms of those named or waves of rotary axes, or show errors finer "
        f"than the bases: the uncertainties of the calibration are {factor:.2g} times those that follow from the noise."
    )


def _of_readings(left: Unexplained) -> str:
    if not left.of_readings:
        return ""
    return " A function of the tracker's readings explains them better than an error of the machine does."


def _of_any_period(left: Unexplained) -> str:
    if not left.periods:
        return ""
    axis = left.variables[0]
    listed = shortened([f"{period:.4g}" for period in left.periods], LISTED, "periods")
    return (
        f" They may be a wave along {axis}, or steps, but the positions of {axis} do not determine its period: "
        f"{', '.join(listed)} {'deg' if axis[0] in 'ABC' else 'mm'} explain them nearly equally. Between the positions "
        f"the error is unknown: measure {axis} at irregular, finer spacing."
    )


def _swing(swing: FoundSwing | None) -> str:
    if swing is None:
        return ""
    by = f", by different amounts along {' and '.join(swing.variables)}" if swing.variables else ""
    period = f"{swing.period:.5g} s +- {2.0 * swing.u:.2g} s (k=2)"
    return (
        f" The error is periodic in time: {swing.component} of the tool swings with a period of {period}{by}. Look for "
        "a cause with this period: the control of the hall's air, of a coolant or an oil, a door, another machine."
    )


def _beside(found: Diagnosis) -> str:
    if not found.beside_function:
        return ""
    return (
        " The new calibration has learned as little of them as possible: it was fitted beside a function of these "
        "variables, which it does not contain. The residuals after are those of the fit without the function."
    )


def _widened(factor: float) -> str:
    if factor == 1.0:
        return ""
    return f" Therefore the uncertainties of the calibration are {factor:.2g} times those that follow from the noise."


def _not_shown(found: Diagnosis) -> Iterator[Section]:
    """Causes that these data cannot show or test, and the smallest sizes of the others that they would show."""
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
        f"{found.measurement.where(int(row))}: outlier, {fit.residual_um[row]:.1f} um from the other rows"
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


def _commands(files: Files) -> list[Sequence[str]]:
    """Tasks and their commands."""
    new = f"--machine {quote(files.machine)} --calibration {quote(files.new)}"
    tasks: list[Sequence[str]] = [("correct a program", f"ncomp PART.nc {new} -o PART_NEW.nc")]
    verify = f"ncomp verify PART.nc PART_NEW.nc {new}"
    if files.present is None:
        return [*tasks, ("evaluate the part's error before and after", verify)]
    old = f"--machine {quote(files.machine)} --calibration {quote(files.present)}"
    left = f"ncomp PART.nc {old} -o PART_OLD.nc\nncomp verify PART.nc PART_OLD.nc {new} --accept calibration"
    return [
        *tasks,
        ("evaluate the part's error by this and the present model", f"{verify} --old {quote(files.present)}"),
        ("evaluate the part's error after a correction by the present model", left),
    ]
