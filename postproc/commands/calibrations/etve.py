"""`ncomp etve`: the environmental temperature variation error of ISO 230-3, from a log of displacements."""

from __future__ import annotations

from pathlib import Path

import ncomp
from postproc.commands.options.declared import argument, option
from postproc.commands.options.shared import ResultOptions, whole_results

EPILOG = (
    "Examples:\n\n"
    "`ncomp etve night.csv --report etve.html`  over the whole log\n\n"
    "`ncomp etve night.csv --period-h 2`  for a measurement that takes two hours"
)


def etve(
    *,
    data: Path = argument(
        "Log: columns time, X1_um, X2_um, Y1_um, Y2_um, Z_um (or some of them), and temp_NAME.", "LOG.csv", reads=True
    ),
    period_h: float | None = option(
        "Time that a measurement takes, for which the variation is stated, h; default: the whole log.", "h", min=1e-3
    ),
    others: ResultOptions,
) -> None:
    """Evaluate how far a standing machine moves with the temperature of its environment (ETVE, ISO 230-3).

    Up to five sensors read the displacement of a mandrel in the spindle. The variation of each, and of the tilts about
    X and Y, is its largest range within the stated time, with U (k = 2), and that of the temperatures beside it.
    """
    from calibration.environment.report import etve_report
    from kinematics.files.report_head import ReportHead
    from postproc.commands.show.terminal import show

    found = ncomp.etve(data, period_h=period_h)
    report = etve_report(found, data.name, ReportHead())
    with whole_results(*others.files) as files:
        others.write(found.json(), report, files, (data,))
    show(report, *others.files)
