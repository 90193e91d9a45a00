"""`ncomp ballbar`: circular tests by ISO 230-4, and the shares of the causes of their deviations."""

from __future__ import annotations

from pathlib import Path

import ncomp
from postproc.commands.options.declared import argument
from postproc.commands.options.measurement import DataOptions
from postproc.commands.options.shared import MachineName, ResultOptions, check_files, whole_results

EPILOG = (
    "Examples:\n\n"
    "`ncomp ballbar circles.csv --machine cframe`\n\n"
    "`ncomp ballbar circles.csv --machine cframe --json circles.json --report circles.html`"
)


def ballbar(
    *,
    data: Path = argument("Measurement file of a ballbar.", "DATA.csv"),
    machine: MachineName,
    form: DataOptions,
    others: ResultOptions,
) -> None:
    """Evaluate circles of a ballbar by ISO 230-4, with the share of each cause: backlash, spikes, play, squareness, ...

    The causes are effects of the table of effects, fitted together with centre and radius. U (k = 2) contains the
    uncertainties of the bar; causes that these circles do not distinguish are named as tied.
    """
    from calibration.circles.circles import circles_of, need_ballbar, one_way_planes
    from calibration.circles.figures import circular_tests
    from calibration.circles.shares import shares
    from calibration.plausibility.checks import usable
    from calibration.reports.ballbar import ballbar_json, ballbar_report
    from calibration.reports.head import measured_head
    from postproc.commands.show.terminal import say, show

    inputs = check_files((data, form.plan), others.by_option)
    measurement = form.read([data], ncomp.load_machine(machine))
    need_ballbar(measurement)
    findings = usable(measurement)
    circles = circles_of(measurement)
    tests, found = circular_tests(measurement, circles), shares(measurement, circles)
    head = measured_head(measurement, None, f"ncomp ballbar {data} --machine {machine}")
    report = ballbar_report(tests, found, measurement.source, head)
    for finding in findings:
        say("note", finding.message)
    for plane in one_way_planes(circles):
        say(
            "note",
            f"plane {plane} was measured in one direction only: there backlash, lateral play and reversal spikes are "
            "not sure beside other error motions; measure both directions",
        )
    with whole_results(*others.files) as files:
        others.write(ballbar_json(tests, found), report, files, inputs)
    show(report, *others.files)
