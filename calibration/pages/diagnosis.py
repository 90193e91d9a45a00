"""The report of a diagnosis: missing causes, their verdicts and improvement, and causes that the data cannot show."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Sequence

from calibration.diagnosis import report_text as words
from calibration.diagnosis.diagnose import LEFT, Diagnosis
from calibration.diagnosis.next.ranking import ProposedMeasurement
from calibration.diagnosis.residual.whiteness import Test, combined
from calibration.diagnosis.verdict import Named
from calibration.pages import Section, Table, page
from calibration.pages.cause_figures import cause_figure
from calibration.pages.cause_views import views
from calibration.pages.left_figures import against_noise, before_and_after, share_chart, unexplained_shape
from kinematics.effects import CrossAxis

SIGNS = (
    "Errors are actual minus nominal, tool relative to workpiece (ISO 841, ISO 230-1), in um and urad; of the "
    "instrument observed minus true; a correction has the opposite sign. U is the expanded uncertainty, k = 2."
)
PUT_BACK = "what the fit leaves, with the cause put back"
HOW_DRAWN = {
    "dots": f"Small dots: single rows, {PUT_BACK}; large ones: their means; black, or a line: the fitted cause.",
    "map": f"Left: {PUT_BACK}, means of rows; cells that these leave uncertain are blank. Right: the fitted cause.",
}
OBSERVED = "Residuals are observed minus expected, of points in x, y, z of what the instrument stands on."


def diagnosis_page(found: Diagnosis, command: str) -> bytes:
    """The report as one HTML file; `command` is the command that made it."""
    title = f"Diagnosis of {found.measurement.machine.name}"
    lead = f"{found.measurement.source} · {found.model.provenance.made_at:%Y-%m-%d %H:%M} UTC · {command}"
    return page(title, lead, list(_sections(found)), _verdict(found))


def _verdict(found: Diagnosis) -> str:
    """The result in a few sentences."""
    before, after = found.before, found.after
    brought = (
        f"residual {before.fit.rms_um:.2f} -> {after.fit.rms_um:.2f} um RMS, "
        f"held out {before.heldout_um:.2f} -> {after.heldout_um:.2f} um"
    )
    if found.causes:
        names = "; ".join(map(_named, found.causes))
        said = f"Missing in the present model: {names}. With {'it' if len(found.causes) == 1 else 'them'}: {brought}."
        if found.with_unnamed:
            said += " What is unnamed is no cause: something is missing that no cause of the library explains."
        elif found.unexplained is not None:
            said += " Something else is missing that no cause of the library explains."
    elif not words.missing(found):
        said = f"Nothing is missing: the present model explains the data down to their noise; {brought}."
    elif found.unexplained is not None:
        said = f"Something is missing that no cause of the library explains; {brought}."
    else:
        said = f"Of the data that could be used the present model leaves nothing but noise; {brought}."
    if after.fit.failed:
        said += f" NOT USED: {', '.join(after.fit.failed)}, of which nothing is said."
    refused = "" if found.accepted else f"NOT WRITTEN: {found.reason}. "
    return f"{refused}{said} Left: {words.left_line(found)}."


def _named(cause: Named) -> str:
    """A cause, its size where that is one number, and its verdict."""
    one = len(cause.effect.parameters) == 1 or cause.kind == "outliers"
    size = f" ({', '.join(words.sizes(cause))})" if one else ""
    tie = f" with {words.in_full(cause.alternatives[0].name)}" if cause.verdict == "tied" and cause.alternatives else ""
    return f"{words.title(cause)}{size}, {words.verdict(cause)}{tie}"


def _sections(found: Diagnosis) -> Iterator[Section]:
    yield from _given(found)
    yield from _found(found)
    yield from _what_is_left(found)
    yield from _in_the_dark(found)
    yield from _what_now(found)


def _given(found: Diagnosis) -> Iterator[Section]:
    """Data, model, noise."""
    lines = [
        f"Data: {words.data_line(found)}.",
        f"Present model: {words.model_line(found)}.",
        *(f"Note: {finding.says}." for finding in found.findings),
    ]
    if found.repeats is None:
        yield Section(
            "Data, model, noise", "\n".join([*lines, "Noise: by the instrument's sheet; no place was seen again."])
        )
        return
    rows = [(part.name, f"{part.noise:.3g}", f"{part.sheet:.3g}", part.unit) for part in found.repeats.components]
    when = "long after one another, with all drifts in them" if found.repeats.apart else "soon after one another"
    lines.append(
        f"Noise: from {found.repeats.places} places seen again {when} "
        f"({found.repeats.degrees_of_freedom} degrees of freedom); "
        f"p of the sheet {found.repeats.p_value:.2g}. Standard uncertainties, k = 1:"
    )
    yield Section("Data, model, noise", "\n".join(lines), Table(("", "from repeats", "by the sheet", ""), rows))


def _found(found: Diagnosis) -> Iterator[Section]:
    """The causes."""
    if not found.causes:
        return
    yield Section(
        "Share by cause",
        "Blue: the machine. Orange: the instrument. Causes that overlap share what they explain, so that the bars need "
        "not add up to 100 %.",
        figure=share_chart(found),
    )
    rows = [_row(number, cause) for number, cause in enumerate(found.causes, start=1)]
    head = ("", "cause", "size ± U (k=2)", "dBIC", "held out, um", "share", "verdict", "like it", "cosine", "odds")
    text = (
        f"{SIGNS}\ndBIC below -10: odds above 150 to 1. Held out: change of the RMS of residuals that the fit has not "
        "seen, once the cause is known. Like it: what does much the same to these data; odds: for the named cause. "
        "TIED: these data can't tell it from the first of those."
    )
    yield Section("Causes", text, Table(head, rows))
    for number, cause in enumerate(found.causes, start=1):
        yield Section(
            f"{number}  {words.title(cause)}",
            "\n".join(_about(cause)),
            figure=cause_figure(views(found.after.linearised, cause.effect)),
        )


def _row(number: int, cause: Named) -> Sequence[str]:
    others = cause.alternatives[: words.SIBLINGS]
    return (
        str(number),
        words.title(cause),
        "\n".join(words.sizes(cause)),
        f"{cause.delta_bic:.0f}",
        words.held_out(cause),
        f"{cause.share:.0%}",
        words.verdict(cause),
        "\n".join(words.in_full(other.name) for other in others) or "none",
        "\n".join(f"{other.cosine:.2f}" for other in others),
        "\n".join(words.odds(other.odds) for other in others),
    )


def _about(cause: Named) -> Iterator[str]:
    effect = cause.effect
    what = type(effect).TITLE
    meaning = " ".join((inspect.getdoc(type(effect)) or "").replace("`", "").split())
    yield f"{what[0].upper()}{what[1:]}. {meaning}"
    if cause.kind != "outliers":
        drawn = HOW_DRAWN["map" if isinstance(effect, CrossAxis) else "dots"]
        yield f"{cause.visible:.0%} of its signal is its own; model or registration could do the rest. {drawn}"
    yield f"Remedy: {words.remedy(effect)}."
    yield from (f"Note: {note}." for note in cause.notes)


def _what_is_left(found: Diagnosis) -> Iterator[Section]:
    rows = [
        (name, f"{s.fit.rms_um:.2f}", f"{s.fit.max_um:.1f}", f"{s.fit.chi2_reduced:.2f}", f"{s.heldout_um:.2f}")
        for name, s in (("before", found.before), ("after", found.after))
    ]
    rows.append(("noise alone", f"{found.noise_um:.2f}", "", "1", ""))
    yield Section(
        "Residual before and after",
        f"{OBSERVED} Max: the largest length.",
        Table(("um", "RMS", "max", "chi2/dof", "held out, RMS"), rows),
        before_and_after(found),
    )
    yield Section("By direction, and in the volume", _volume(found), _directions(found))
    yield Section("Against the noise", figure=against_noise(found))
    if found.tests:
        text = (
            f"Chance of as much under pure noise; marked where all tests together leave less than {LEFT:.0%} to it. "
            "Along: do rows next to each other err alike? The others: do means differ, is there a slope?"
        )
        yield Section("Is it noise?", text, _tests(found))
    yield _unexplained(found)


def _volume(found: Diagnosis) -> str:
    volume = found.volume
    lines = [
        f"Error of the machine over the measured positions, by the new model: {volume.machine_rms:.2f} um RMS, "
        f"{volume.machine_max:.1f} um at most (a shift of the whole taken off).",
    ]
    if found.causes:
        lines.append(
            f"What a correction by the present model leaves of it, by the new one: {volume.left_rms:.2f} um RMS, "
            f"{volume.left_max:.1f} um at most."
        )
    if found.closure:
        lines.append(
            f"Of the residual beyond the noise {found.closure:.0%} can't be an error motion of an axis, of any course."
        )
    return "\n".join(lines)


def _directions(found: Diagnosis) -> Table:
    before, after = found.by_direction["before"], found.by_direction["after"]
    rows = [(name, f"{before[name]:.2f}", f"{after.get(name, float('nan')):.2f}") for name in before]
    return Table(("residual RMS, um (rotary axes urad)", "before", "after"), rows)


def _tests(found: Diagnosis) -> Table:
    after = {test.what: test for test in found.tests_after}
    marked = [{test.what for test in combined(tests, LEFT)} for tests in (found.tests, found.tests_after)]
    rows = [(test.what, *_tested(test, marked[0]), *_tested(after.get(test.what), marked[1])) for test in found.tests]
    return Table(("residuals", "p before", "", "p after", ""), rows)


def _tested(test: Test | None, marked: set[str]) -> tuple[str, str]:
    if test is None:
        return "", ""
    return f"{test.p_value:.2g}", "not noise" if test.what in marked else ""


def _unexplained(found: Diagnosis) -> Section:
    left = found.unexplained
    if left is None:
        return Section("Unexplained", "Nothing: what is left depends on nothing that is known of the data.")
    text = (
        f"{found.unexplained_um:.2f} um RMS depend on {', '.join(left.variables)} (p = {left.p_value:.2g}), and no "
        f"cause of the library explains them. Their smooth shape over these variables, um. {OBSERVED}"
    )
    if found.unnamed:
        text += f"\n{found.unnamed[0].upper()}{found.unnamed[1:]}."
    text += (
        "\nEach variable alone: squared distance correlation (without bias, about 0 where independent), and p-value "
        "among residuals permuted in blocks, as it is and adjusted by Benjamini and Hochberg. Variables that act only "
        "jointly show nothing here."
    )
    rows = [(o.variable, f"{o.correlation:.3f}", f"{o.p_value:.2g}", f"{o.adjusted:.2g}") for o in found.one_by_one]
    alone = Table(("variable", "distance correlation, squared", "p", "adjusted p"), rows)
    return Section("Unexplained", text, alone, unexplained_shape(found))


def _in_the_dark(found: Diagnosis) -> Iterator[Section]:
    """Causes that these data cannot show or test, and the sizes from which they show the others."""
    hidden = [("\n".join(names), remedy) for remedy, names in words.hidden(found).items()]
    hidden += [
        (" + ".join(b.effects), b.remedy)
        for b in (found.identifiability.unidentifiable if found.identifiability else ())
    ]
    if hidden:
        text = "Never named by these data. In brackets: share of its signal that survives model and registration."
        yield Section("Not visible in these data", text, Table(("cause", "what would show it"), hidden))
    lacking: dict[str, list[str]] = {}
    for entry in found.untested:
        lacking.setdefault(entry.lacks, []).append(words.in_full(entry.name))
    if lacking:
        untested = [(lacks, ", ".join(names)) for lacks, names in lacking.items()]
        yield Section("Not tested", table=Table(("the data do not give", "so nothing is said of"), untested))
    smallest: dict[tuple[str, str], list[str]] = {}
    for name, size, unit in sorted(found.smallest):
        kind, _, where = name.partition(" ")
        smallest.setdefault((kind, unit), []).append(f"{where} {size:.2g}".strip())
    if smallest:
        seen = [(kind, ", ".join(sizes), unit) for (kind, unit), sizes in smallest.items()]
        text = "The smallest sizes that these data would show."
        yield Section("What would have been seen", text, Table(("cause", "from", ""), seen))


def _what_now(found: Diagnosis) -> Iterator[Section]:
    says = f"{found.next_measurement[0].upper()}{found.next_measurement[1:]}."
    rows = [_move(move) for move in found.proposed_measurements if move.minutes]
    table = Table(("move", "minutes", "gain, noise variances per minute", "what to do, and what it tells"), rows)
    yield Section("What to measure next", says, table if rows else None)
    lost = list(words.left_out(found))
    if lost:
        yield Section("Left out", "\n".join(lost))
    text = (
        f"NEW.json holds the machine with what was found (calibration {found.model.id}), nothing of the instrument's."
    )
    yield Section("How to use it", text, Table(("to", "command"), _commands(found.measurement.machine.name)))


def _move(move: ProposedMeasurement) -> Sequence[str]:
    return move.name, f"{move.minutes:.0f}", f"{move.gain_per_minute:.2g}", move.says


def _commands(machine: str) -> list[Sequence[str]]:
    """Tasks and their commands."""
    new, old = (f"--machine {machine} --calibration {name}.json" for name in ("NEW", "OLD"))
    left = f"ncomp PART.nc {old} -o PART_OLD.nc\nncomp verify PART.nc PART_OLD.nc {new}"
    return [
        ("correct a program", f"ncomp PART.nc {new} -o PART_NEW.nc"),
        (
            "see the part's error by this model and by the one so far",
            f"ncomp verify PART.nc PART_NEW.nc {new} --old OLD.json",
        ),
        ("see what the calibration so far, OLD.json, leaves of it", left),
    ]
