"""`ncomp ballbar`: circular tests by ISO 230-4, and the shares of the causes of their deviations."""

from __future__ import annotations

from pathlib import Path

import ncomp
from postproc.commands.options.declared import argument
from postproc.commands.options.measurement import DataOptions
from postproc.commands.options.shared import MachineName, ResultOptions, whole_results

EPILOG = (
    "Examples:\n\n"
    "`ncomp ballbar circles.csv --machine cframe`\n\n"
    "`ncomp ballbar circles.csv --machine cframe --json circles.json --report circles.html`"
)


def ballbar(
    *,
    data: Path = argument("Measurement file of a ballbar.", "DATA.csv", reads=True),
    machine: MachineName,
    form: DataOptions,
    others: ResultOptions,
) -> None:
    """Evaluate circles of a ballbar by ISO 230-4, with the share of each cause: backlash, spikes, play, squareness, ...

    The causes are effects of the table of effects, fitted together with centre and radius. U (k = 2) contains the
    uncertainties of the bar; causes that these circles do not distinguish are named as tied.
    """
    from calibration.reports.ballbar import ballbar_report
    from calibration.reports.head import measured_head
    from postproc.commands.show.terminal import say, show

    inputs = (data, form.plan)
    measurement = form.read([data], ncomp.load_machine(machine))
    found = ncomp.ballbar(measurement)
    head = measured_head(measurement, None, f"ncomp ballbar {data} --machine {machine}")
    report = ballbar_report(found.tests, found.shares, measurement.source, head)
    for note in found.notes:
        say("note", note)
    with whole_results(*others.files) as files:
        others.write(found.json(), report, files, inputs)
    show(report, *others.files)
