"""`ncomp ballbar`: circular tests by ISO 230-4, and the shares of the causes of their deviations."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import ncomp
from postproc.commands.options.declared import argument
from postproc.commands.options.measurement import DataOptions
from postproc.commands.options.recorded import RecordedOptions, results_entry
from postproc.commands.options.shared import MachineName, whole_results

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
    others: RecordedOptions,
) -> None:
    """Evaluate circles of a ballbar by ISO 230-4, with the share of each cause: backlash, spikes, play, squareness, ...

    The causes are effects of the table of effects, fitted together with centre and radius. U (k = 2) contains the
    uncertainties of the bar; causes that these circles do not distinguish are named as tied.
    """
    from calibration.reports.ballbar import ballbar_report
    from calibration.reports.head import measured_head
    from history.figures import of_circles
    from postproc.commands.show.terminal import say, show

    inputs = (data, *form.files)
    found_machine = ncomp.load_machine(machine)
    measurement = form.read([data], found_machine)
    found = ncomp.ballbar(measurement)
    head = measured_head(measurement, None, f"ncomp ballbar {data} --machine {machine}")
    report = ballbar_report(found.tests, found.shares, measurement.source, head)
    for note in found.notes:
        say("note", note)
    with others.recorded(found_machine) as record, whole_results(*others.files) as files:
        others.write(found.json(), report, files, inputs)
        figures = partial(of_circles, found_machine, found.json())
        record(results_entry("iso230-4", found.headline, found.json(), figures, inputs, measurement))
    show(report, *others.files)
