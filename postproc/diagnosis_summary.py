"""A diagnosis for programs (contract 4.3) and for people at a terminal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console

    from calibration.diagnosis.diagnose import Diagnosis
    from calibration.diagnosis.selection import Stage
    from calibration.diagnosis.verdict import Named

MANY = 8
"""Names of one sort that are printed; all are in the JSON."""
COVERAGE = 2
ORIGINS = {
    "automatic": "error motions of all axes, their basis by the evidence",
    "refitted": "the given calibration, made from these data: its structure, fitted anew",
    "updated": "the given calibration, with its uncertainties as prior knowledge",
}


def summary(found: Diagnosis) -> dict[str, Any]:
    """Contract 4.3; keys beyond it at the end."""
    fit, left, seen = found.after.fit, found.unexplained, found.visibility
    hidden = [entry.name for entry in found.not_visible]
    return {
        "before": figures(found.before),
        "after": figures(found.after),
        "noise_um": found.noise_um,
        "n_observations": fit.observations,
        "n_parameters": len(fit.model.parameters),
        "rank": fit.solved.rank - fit.solved.registered,
        "not_visible": [*(seen.not_visible if seen else ()), *hidden],
        "effects": [_effect(cause) for cause in found.causes],
        "unexplained": None
        if left is None
        else {"variables": list(left.variables), "p_value": left.p_value, "rms_um": found.unexplained_um},
        "next_measurement": found.next_measurement,
        "moves": [
            {"move": move.name, "minutes": move.minutes, "gain_per_minute": move.gain_per_minute, "says": move.says}
            for move in found.moves
        ],
        "origin": found.base.origin,
        "basis": {} if found.base.choice is None else {a: str(b) for a, b in found.base.choice.bases.items()},
        "sanity": [{"what": finding.what, "says": finding.says} for finding in found.findings],
        "noise_from_repeats": None if found.repeats is None else found.repeats.says,
        "whiteness": {"before": _tests(found.tests), "after": _tests(found.tests_after)},
        "closure": found.closure,
        "by_direction_um": found.by_direction,
        "volume_um": found.volume._asdict(),
        "visibility": {each.candidate.effect.name: each.projected.visible for each in reversed(found.judged)},
        "would_show_from": [{"name": name, "size": size, "unit": unit} for name, size, unit in found.smallest],
        "not_tested": [{"name": entry.name, "lacks": entry.lacks} for entry in found.untested],
        "outliers": [found.measurement.where(int(row)) for row in fit.outliers],
        "calibration": found.model.id,
    }


def figures(stage: Stage) -> dict[str, float]:
    """How well a model explains the data."""
    return {
        "rms_um": stage.fit.rms_um,
        "max_um": stage.fit.max_um,
        "chi2_reduced": stage.fit.chi2_reduced,
        "heldout_rms_um": stage.heldout_um,
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
    """The diagnosis for people."""
    from rich.table import Table

    for line in _head(found):
        to.print(line)
    if found.causes:
        table = Table("", "cause", f"size ± U (k={COVERAGE})", "dBIC", "held out", "share", "verdict", "siblings (cos)")
        for number, cause in enumerate(found.causes, start=1):
            siblings = ", ".join(
                f"{other.name} ({other.cosine:.2f}, odds {odds(other.odds)})" for other in cause.alternatives[:2]
            )
            table.add_row(
                str(number),
                title(cause),
                "\n".join(sizes(cause)),
                f"{cause.delta_bic:.0f}",
                f"{-cause.heldout_gain_um:+.2f} um",
                f"{cause.share:.0%}",
                cause.verdict.upper() if cause.verdict == "tied" else cause.verdict,
                siblings or "none",
            )
        to.print(table)
    figure = Table("residual, um", "RMS", "max", "chi2/dof", "held out")
    for name, stage in (("before", found.before), ("after", found.after)):
        fit = stage.fit
        figure.add_row(
            name, f"{fit.rms_um:.2f}", f"{fit.max_um:.1f}", f"{fit.chi2_reduced:.2f}", f"{stage.heldout_um:.2f}"
        )
    to.print(figure)
    for line in _tail(found):
        to.print(line)


def title(cause: Named) -> str:
    """Kind and place, for people."""
    words = {"location": cause.effect.name, "error-motion": f"change of {cause.effect.name}"}
    if cause.kind == "higher-frequency":
        return f"{cause.effect.name} needs a higher spatial frequency"
    return words.get(cause.kind, cause.effect.name) + (" (instrument)" if cause.where == "instrument" else "")


def sizes(cause: Named) -> list[str]:
    """Parameters with their expanded uncertainties."""
    if cause.kind == "higher-frequency":
        basis = getattr(cause.effect, "basis", None)
        return [
            f"{len(cause.effect.parameters)} parameters" if basis is None else f"written with {basis.size} parameters"
        ]
    if cause.kind == "outliers":
        return [f"{len(getattr(cause.effect, 'rows', ()))} rows"]
    rows = zip(cause.effect.parameter_table, cause.effect.parameters, cause.effect.uncertainties, strict=True)
    return [f"{q.name} {value:.4g} ± {COVERAGE * u:.2g} {q.unit}" for q, value, u in list(rows)[:MANY]]


def odds(value: float) -> str:
    """Odds in few digits."""
    return f"{value:.0f}" if value < 1e4 else f"{value:.0e}" if value < 1e99 else "> 1e99"


def _head(found: Diagnosis) -> Iterator[str]:
    fit, m = found.before.fit, found.measurement
    runs = "" if m.run is None else f", {len(set(m.run.tolist()))} runs"
    yield f"data         {m.source}: {len(m)} rows, {fit.observations} observations{runs}"
    bases = (
        "" if found.base.choice is None else ": " + ", ".join(f"{a} {b}" for a, b in found.base.choice.bases.items())
    )
    yield f"model        {ORIGINS[found.base.origin]}{bases}; {len(fit.model.parameters)} parameters"
    for finding in found.findings:
        yield f"note         {finding.says}"
    if found.repeats is not None:
        yield f"noise        {found.repeats.says}"
    significant = [test for test in found.tests if test.p_value < 1e-3]
    because = "; ".join(f"{test.what} p = {test.p_value:.1g}" for test in significant[:MANY])
    verdict = "SOMETHING IS MISSING" if found.causes or found.unexplained else "nothing is missing"
    yield f"residual     chi2/dof {fit.chi2_reduced:.3g}{'; ' if because else ''}{because} -> {verdict}"
    by_remedy: dict[str, list[str]] = {}
    for entry in found.not_visible:
        by_remedy.setdefault(entry.remedy, []).append(f"{entry.name} ({entry.share:.2f})")
    for remedy, names in by_remedy.items():
        more = f" and {len(names) - MANY} more" if len(names) > MANY else ""
        yield f"NOT VISIBLE  {', '.join(names[:MANY])}{more}: it needs {remedy}"
    for blind in found.visibility.blind if found.visibility else ():
        yield f"NOT VISIBLE  {blind}"


def _tail(found: Diagnosis) -> Iterator[str]:
    fit = found.after.fit
    left = found.unexplained
    depends = "depends on nothing that is known of the data"
    if left is not None:
        depends = f"{found.unexplained_um:.2f} um of it depend on {', '.join(left.variables)} (p = {left.p_value:.2g})"
    times, head = fit.rms_um / max(found.noise_um, 1e-12), "LEFT" if left is None else "UNEXPLAINED"
    yield f"{head:<13}{fit.rms_um:.2f} um RMS, {times:.2f} times the noise; {depends}"
    for row in fit.outliers[:MANY]:
        yield f"left out     {found.measurement.where(int(row))}: outlier, {fit.residual_um[row]:.1f} um from the rest"
    if len(fit.outliers) > MANY:
        yield f"left out     ... and {len(fit.outliers) - MANY} more outliers"
    for cause in found.causes:
        for note in cause.notes:
            yield f"note         {cause.effect.name}: {note}"
        if cause.where == "instrument":
            yield f"note         {cause.effect.name} is the instrument's: taken out of the data, not written"
    yield f"DO NEXT      {found.next_measurement}"
