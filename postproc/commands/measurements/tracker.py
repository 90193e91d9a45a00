"""`ncomp tracker`: the uncertainties of a laser tracker from its tests by ASME B89.4.19."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from postproc.commands.options.declared import argument, option
from postproc.commands.options.shared import JsonFile, check_files, whole_results, write_json

if TYPE_CHECKING:
    from rich.console import Console

    from calibration.measurement.tracker_tests import Fitted

EPILOG = (
    "Examples:\n\n"
    "`ncomp tracker b89.csv`\n\n"
    "`ncomp tracker b89.csv -o tracker.toml`  writes the lines of a study's [instrument]"
)


def tracker(
    *,
    data: Path = argument(
        "Tests: columns test, range_mm, range_2_mm, length_mm, and error_um or stated_um.", "TESTS.csv"
    ),
    output: str | None = option("File for the parameters; `-` is standard output.", "TRACKER.toml", "-o"),
    json: JsonFile,
) -> None:
    """Fit a laser tracker's standard uncertainties to its ranging, length and two-face tests (ASME B89.4.19)."""
    from calibration.measurement.tracker_tests import fit_tests, read_tests
    from postproc.commands.show.terminal import console
    from postproc.commands.show.terminal import output as screen

    check_files((data,), {"--output": output, "--json": json})
    found = fit_tests(read_tests(data))
    with whole_results(json, output) as (results, file):
        write_json(_summary(found), results)
        file.write(_toml(found).encode())
    _show(found, console if "-" in (json, output) else screen)


def _summary(found: Fitted) -> dict[str, Any]:
    """The result for programs."""
    from calibration.measurement.tracker_tests import KINDS, PARAMETERS

    return {
        "parameters": dict(zip(PARAMETERS, found.parameters.tolist(), strict=True)),
        "u": dict(zip(PARAMETERS, found.u.tolist(), strict=True)),
        "tests": {
            kind: {"n": int((found.tests.kind == kind).sum()), "doubtful": found.doubtful(kind)} for kind in KINDS
        },
    }


def _toml(found: Fitted) -> str:
    from calibration.measurement.tracker_tests import PARAMETERS

    values = zip(PARAMETERS, found.parameters.tolist(), found.u.tolist(), strict=True)
    lines = ["[instrument]", 'kind = "laser-tracker"', *(f"{name} = {v:.4g}  # u = {u:.2g}" for name, v, u in values)]
    return "\n".join(lines) + "\n"


def _show(found: Fitted, to: Console) -> None:
    """Show the result for people."""
    import numpy as np
    from rich.table import Table

    from calibration.measurement.tracker_tests import KINDS, PARAMETERS

    table = Table("standard uncertainty (k=1)", "value", "u (k=1)")
    for name, value, u in zip(PARAMETERS, found.parameters.tolist(), found.u.tolist(), strict=True):
        table.add_row(name, f"{value:.3f}", f"{u:.3f}")
    to.print(table)
    tests = found.tests
    for kind in KINDS:
        rows = tests.kind == kind
        if not rows.any():
            continue
        seen, k = float(np.sqrt(np.mean(tests.value[rows] ** 2))), tests.coverage or 1.0
        model = float(np.sqrt(np.mean(found.predicted[rows] ** 2))) * k
        to.print(f"{kind:<12} {rows.sum()} tests, RMS {seen:.2f} um, by the parameters {model:.2f} um (k={k:g})")
        if found.doubtful(kind):
            to.print(f"DOUBTFUL     {kind} tests scatter more than these parameters explain: systematic errors?")
    for name, value, u in zip(PARAMETERS, found.parameters.tolist(), found.u.tolist(), strict=True):
        if u >= value:
            to.print(f"NOT CERTAIN  {name}: not distinguished from zero by these tests; more ranges would do that")
