"""`ncomp etve`: the environmental temperature variation error of ISO 230-3, from a log of displacements."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options.declared import argument, option
from postproc.commands.options.recorded import RecordedOptions, results_entry
from postproc.commands.options.shared import OptionalMachine, whole_results

EPILOG = (
    "Examples:\n\n"
    "`ncomp etve night.csv --report etve.html`  over the whole log\n\n"
    "`ncomp etve night.csv --period-h 2`  for a measurement that takes two hours\n\n"
    "`ncomp etve night.csv --period-h 2 --machine dmu50 --history`  entered into the life of this machine"
)


def etve(
    *,
    data: Path = argument(
        "Log: columns time, X1_um, X2_um, Y1_um, Y2_um, Z_um (or some of them), and temp_NAME.", "LOG.csv", reads=True
    ),
    period_h: float | None = option(
        "Time that a measurement takes, for which the variation is stated, h; default: the whole log.", "h", min=1e-3
    ),
    machine: OptionalMachine,
    others: RecordedOptions,
) -> None:
    """Evaluate how far a standing machine moves with the temperature of its environment (ETVE, ISO 230-3).

    Up to five sensors read the displacement of a mandrel in the spindle. The variation of each, and of the tilts about
    X and Y, is its largest range within the stated time, with U (k = 2), and that of the temperatures beside it. The
    machine is needed for its history alone.
    """
    from calibration.environment.report import etve_report
    from history.figures import of_etve
    from kinematics.files.report_head import ReportHead
    from postproc.commands.show.terminal import show

    if others.history and machine is None:
        raise UserError("--history: is the life of a machine: give --machine NAME too")
    of = None if machine is None else ncomp.load_machine(machine)
    found = ncomp.etve(data, period_h=period_h)
    results = found.json()
    report = etve_report(found, data.name, ReportHead(machine="" if of is None else of.name))
    with others.recorded(of) as record, whole_results(*others.files) as files:
        others.write(results, report, files, (data,))
        figures = partial(of_etve, results)
        day = found.measured
        record(results_entry("etve", found.headline, results, figures, (data,), method="etve", measured=day))
    show(report, *others.files)
