"""A diagnosis for programs (contract 4.3) and for people at a terminal."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from calibration.diagnosis import report_text as words

if TYPE_CHECKING:
    from rich.console import Console

    from calibration.diagnosis.diagnose import Diagnosis
    from calibration.diagnosis.search.selection import Stage
    from calibration.diagnosis.verdict import Named

WIDTH = 100
"""Number of characters in a line that is printed into a pipe."""


def summary(found: Diagnosis) -> dict[str, Any]:
    """The diagnosis for programs by contract 4.3; further keys at the end."""
    fit, left, seen = found.after.fit, found.unexplained, found.identifiability
    hidden = [entry.name for entry in found.not_visible]
    return {
        "before": figures(found.before),
        "after": figures(found.after),
        "noise_um": found.noise_um,
        "n_observations": fit.observations,
        "n_parameters": len(fit.model.parameters),
        "rank": fit.solved.rank - fit.solved.registered,
        "not_visible": [*(seen.not_visible if seen else ()), *hidden],
        "accepted": found.accepted,
        "reason": found.reason,
        "effects": [_effect(cause) for cause in found.causes],
        "unexplained": None
        if left is None
        else {"variables": list(left.variables), "p_value": left.p_value, "rms_um": found.unexplained_um},
        "next_measurement": found.next_measurement,
        "one_by_one": [dependence._asdict() for dependence in found.one_by_one],
        "moves": [
            {"move": move.name, "minutes": move.minutes, "gain_per_minute": move.gain_per_minute, "says": move.says}
            for move in found.proposed_measurements
        ],
        "origin": found.base.origin,
        "basis": {} if found.base.choice is None else {a: str(b) for a, b in found.base.choice.bases.items()},
        "sanity": [{"what": finding.what, "says": finding.says} for finding in found.findings],
        "noise_from_repeats": None if found.repeats is None else found.repeats.says,
        "whiteness": {"before": _tests(found.tests), "after": _tests(found.tests_after)},
        "closure": found.closure,
        "by_direction_um": found.by_direction,
        "volume_um": found.volume._asdict(),
        "visibility": {each.candidate.effect.name: each.projected.visible for each in reversed(found.evaluated)},
        "would_show_from": [{"name": name, "size": size, "unit": unit} for name, size, unit in found.smallest],
        "not_tested": [{"name": entry.name, "lacks": entry.lacks} for entry in found.untested],
        "outliers": [found.measurement.where(int(row)) for row in fit.outliers],
        "significant_share": found.significant_share,
        "calibration": found.model.id,
    }


def figures(stage: Stage) -> dict[str, float | None]:
    """Residuals of a model; the held-out residual is None where there are too few rows to hold any out."""
    return {
        "rms_um": stage.fit.rms_um,
        "max_um": stage.fit.max_um,
        "chi2_reduced": stage.fit.chi2_reduced,
        "heldout_rms_um": None if math.isnan(stage.heldout_um) else stage.heldout_um,
    }


def _effect(cause: Named) -> dict[str, Any]:
    effect = cause.effect
    return {
        "kind": cause.kind,
        "where": cause.where,
        "axis": cause.axis,
        **cause.fields,
        "parameters": effect.by_key(effect.parameters),
        "u": effect.by_key(effect.uncertainties),
        "delta_bic": cause.delta_bic,
        "heldout_gain_um": cause.heldout_gain_um,
        "share": cause.share,
        "verdict": cause.verdict,
        "visible": cause.visible,
        "alternatives": [
            {"kind": other.kind, "axis": other.axis, "name": other.name, "cosine": other.cosine, "odds": other.odds}
            for other in cause.alternatives
        ],
        "notes": list(cause.notes),
    }


def _tests(tests: Any) -> list[dict[str, Any]]:
    return [{"what": test.what, "p_value": test.p_value, "statistic": test.statistic} for test in tests]


def show(found: Diagnosis, to: Console) -> None:
    """Show the diagnosis for people."""
    from rich import box
    from rich.table import Table

    width = to.width if to.is_terminal else WIDTH
    for line in _head(found):
        to.print(line)
    if found.causes:
        table = Table(box=box.SIMPLE, padding=(0, 1, 0, 0), width=width)
        table.add_column("")
        table.add_column("cause", overflow="fold", min_width=24)
        table.add_column(f"size ± U (k={words.COVERAGE})", overflow="fold")
        for head in ("dBIC", "held, um", "share", "verdict"):
            table.add_column(head, no_wrap=True, justify="left" if head == "verdict" else "right")
        for number, cause in enumerate(found.causes, start=1):
            table.add_row(
                str(number),
                words.title(cause),
                "\n".join(words.sizes(cause)),
                f"{cause.delta_bic:.0f}",
                words.held_out(cause),
                f"{cause.share:.0%}",
                words.verdict(cause),
            )
        to.print(table)
        for number, cause in enumerate(found.causes, start=1):
            for other in cause.alternatives[: words.SIBLINGS]:
                to.print(f"{f'{number} is like':<13}{words.sibling(other)}")
    figure = Table("residual, um", "RMS", "max", "chi2/dof", "held out", box=box.SIMPLE, padding=(0, 1, 0, 0))
    for name, stage in (("before", found.before), ("after", found.after)):
        fit = stage.fit
        figure.add_row(
            name, f"{fit.rms_um:.2f}", f"{fit.max_um:.1f}", f"{fit.chi2_reduced:.2f}", f"{stage.heldout_um:.2f}"
        )
    to.print(figure)
    for line in _tail(found):
        to.print(line)


def _head(found: Diagnosis) -> Iterator[str]:
    yield f"data         {words.data_line(found)}"
    yield f"model        {words.model_line(found)}"
    for finding in found.findings:
        yield f"note         {finding.says}"
    if found.repeats is not None:
        yield f"noise        {found.repeats.says.removeprefix('noise ')}"
    significant = [test for test in found.tests if test.p_value < 1e-3]
    because = "; ".join(f"{test.what} p = {test.p_value:.1g}" for test in significant[: words.MANY])
    verdict = "SOMETHING IS MISSING" if words.missing(found) else "nothing is missing"
    yield f"residual     chi2/dof {found.before.fit.chi2_reduced:.3g}{'; ' if because else ''}{because} -> {verdict}"
    for remedy, names in words.hidden(found).items():
        more = f" and {len(names) - words.MANY} more" if len(names) > words.MANY else ""
        yield f"NOT VISIBLE  {', '.join(names[: words.MANY])}{more}: it needs {remedy}"
    for unidentifiable in found.identifiability.unidentifiable if found.identifiability else ():
        yield f"NOT VISIBLE  {unidentifiable}"


def _tail(found: Diagnosis) -> Iterator[str]:
    yield f"{'UNEXPLAINED' if found.unexplained else 'LEFT':<13}{words.left_line(found)}"
    for line in words.left_out(found):
        yield f"left out     {line}"
    for note in (*words.doubt(found), *words.notes(found)):
        yield f"note         {note}"
    yield f"DO NEXT      {found.next_measurement}"
