"""`ncomp tracker`: the uncertainties of a laser tracker from its tests by ASME B89.4.19."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import ncomp
from postproc.commands.options.declared import argument, output_option
from postproc.commands.options.shared import ResultOptions, whole_results

if TYPE_CHECKING:
    from calibration.measurement.tracker_tests import Fitted

EPILOG = (
    "Examples:\n\n"
    "`ncomp tracker b89.csv --report tracker.html`\n\n"
    "`ncomp tracker b89.csv -o tracker.toml`  writes the lines of a study's [instrument]"
)


def tracker(
    *,
    data: Path = argument(
        "Tests: columns test, range_mm, range_2_mm, length_mm, and error_um or stated_um.", "TESTS.csv", reads=True
    ),
    output: str | None = output_option("File for the parameters; `-` is standard output.", "TRACKER.toml", None),
    others: ResultOptions,
) -> None:
    """Fit a laser tracker's standard uncertainties to its ranging, length and two-face tests (ASME B89.4.19)."""
    from calibration.reports.tracker import tracker_json, tracker_report
    from postproc.commands.show.terminal import show

    found = ncomp.tracker(data)
    report = tracker_report(found, data.name)
    with whole_results(*others.files, output) as (results, page, file):
        others.write(tracker_json(found), report, (results, page), (data,))
        file.write(_toml(found).encode())
    show(report, *others.files, output)


def _toml(found: Fitted) -> str:
    from calibration.measurement.tracker_tests import PARAMETERS

    values = zip(PARAMETERS, found.parameters.tolist(), found.u.tolist(), strict=True)
    lines = ["[instrument]", 'kind = "laser-tracker"', *(f"{name} = {v:.4g}  # u = {u:.2g}" for name, v, u in values)]
    return "\n".join(lines) + "\n"
