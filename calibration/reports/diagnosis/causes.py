"""The causes of a diagnosis: sizes, evidence, repair, similar causes, and a figure of each."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Sequence
from functools import partial

from calibration.diagnosis.conclusion.at_tool import AtTool
from calibration.diagnosis.conclusion.cause import Cause
from calibration.diagnosis.conclusion.fitted_rows import FittedRows
from calibration.diagnosis.conclusion.result import Diagnosis
from calibration.reports.causes import text as words
from calibration.reports.causes.at_positions import at_positions
from calibration.reports.causes.figures import cause_figure, share_chart
from calibration.reports.causes.views import views
from calibration.reports.diagnosis.verdict import at_tool_text, by_size
from kinematics.error_model.covariance import COVERAGE_FACTOR
from kinematics.files.number_text import odds, odds_by_log
from rendering.figures import Figure, percent
from rendering.report import Section, Table

SIGNS = (
    "Errors are actual minus nominal, tool relative to workpiece (ISO 841, ISO 230-1), in um and urad. Errors of the "
    "instrument are observed minus true. A correction has the opposite sign. U is the expanded uncertainty (k=2). At "
    "the tool point: the largest difference between two states of the measured region."
)
LEGEND = (
    "The odds tell how many times likelier the data are with the cause than without it. Held out is the change of the "
    "RMS of held-out blocks by the cause. TIED means that these data do not tell the cause from another one."
)
SHARES = (
    "Blue: the machine. Orange: the instrument. 100 % are the squared residuals of the model without these causes; a "
    "share is the part of them that follows the cause."
)
READINGS = "residuals plus the fitted cause"
HOW_DRAWN = {
    "dots": f"Small dots are single rows ({READINGS}), large dots their means; black or a line is the fitted cause.",
    "map": f"The left map has means of rows ({READINGS}), without uncertain ones; the right map is the fitted cause.",
}


def cause_sections(answer: Diagnosis) -> Iterator[Section]:
    """The causes, the largest at the tool point first."""
    ordered = by_size(answer)
    if not ordered:
        return
    numbered = [(str(number), cause, size) for number, (cause, size) in enumerate(ordered, start=1)]
    held_out = f"held out, {answer.measurement.unit}"
    head = (
        "number",
        "cause",
        f"size ± U (k={COVERAGE_FACTOR:g})",
        "at the tool point",
        "odds",
        held_out,
        "share",
        "verdict",
    )
    yield Section("Causes", f"{SIGNS}\n{LEGEND}", Table(head, [_row(answer, *each) for each in numbered]))
    shop = [(number, words.title(cause), *cause.effect.workshop) for number, cause, _ in numbered]
    yield Section("Origin and repair", table=Table(("number", "cause", "usual origin", "repair"), shop))
    yield from _similar(numbered)
    rows = FittedRows.of(answer.structure)
    for number, cause, _ in numbered:
        title = f"Cause {number}: {words.title(cause)}"
        yield Section(title, "\n".join(_about(cause)), figure=partial(_figure, rows, cause))
    chart = partial(share_chart, answer.causes, answer.unexplained_share)
    yield Section("Share by cause", SHARES, figure=chart, detail=True)


def _figure(rows: FittedRows, cause: Cause) -> Figure:
    return cause_figure(views(rows, cause.effect))


def _row(answer: Diagnosis, number: str, cause: Cause, size: AtTool | None) -> Sequence[str]:
    positions = at_positions(answer.measurement.machine, cause.effect, cause.covariance)
    return (
        number,
        words.title(cause),
        "\n".join(positions or words.sizes(cause)),
        at_tool_text(size),
        odds_by_log(cause.log_odds),
        words.held_out(cause),
        percent(cause.share),
        words.verdict(cause),
    )


def _similar(numbered: Sequence[tuple[str, Cause, AtTool | None]]) -> Iterator[Section]:
    """The causes beside others that the data do not tell from them."""
    similar = [
        (
            number,
            words.title(cause),
            words.in_full(other.name),
            words.similarity(other.cosine, tied=True),
            odds(other.odds),
        )
        for number, cause, _ in numbered
        for other in cause.alternatives
    ]
    if similar:
        text = (
            "These data do not decide between a cause and these other ones (TIED). A similarity of 1 is the same "
            "signal. The odds tell how many times likelier the cause is than the similar one, by all data together."
        )
        columns = ("number", "cause", "similar cause", "similarity", "odds for the cause")
        yield Section("Similar causes", text, Table(columns, similar))


def _about(cause: Cause) -> Iterator[str]:
    effect = cause.effect
    title = type(effect).TITLE
    meaning = " ".join((inspect.getdoc(type(effect)) or "").replace("`", "").split())
    yield f"{title[0].upper()}{title[1:]}. {meaning}"
    if cause.kind != "outliers":
        yield HOW_DRAWN["map" if effect.SHOWN_OVER == "two axes" else "dots"]
    yield f"Remedy: {words.remedy(effect)}"
    yield from (f"Present calibration: {text}." for text in words.present(cause))
    yield from (f"Note: {note}." for note in effect.remarks)
