"""`ncomp touches`: the log of a probing program in, a measurement file out."""

from __future__ import annotations

from pathlib import Path

import ncomp
from postproc.commands.options.declared import REQUIRED, argument, option, output_option
from postproc.commands.options.shared import MachineName, ResultOptions, whole_results

EPILOG = (
    "Examples:\n\n"
    "`ncomp touches ncomp48211.txt --machine dmu50 --plan spheres.csv -o data.csv`\n\n"
    "then `ncomp fit data.csv --machine dmu50 -o cal.json`"
)


def touches(
    *,
    log: Path = argument("Log of the probing program, as the control wrote it.", "LOG.txt", reads=True),
    machine: MachineName,
    plan: Path = option("Plan of which it is the log.", "PLAN.csv", default=REQUIRED, reads=True),
    output: str = output_option("File for the measurement; `-` is standard output.", "DATA.csv"),
    others: ResultOptions,
) -> None:
    """Read the log of a probing program: centres of the spheres, their scatter, and the drift between repetitions.

    The uncertainty of a centre (u_um of the measurement file) follows from the scatter of its contacts.
    """
    from calibration.measurement.written_file import write_measurement
    from calibration.reports.head import measured_head
    from calibration.reports.touches import touches_json, touches_report
    from postproc.commands.show.terminal import say, show

    probed = ncomp.touches(log, machine, plan)
    head = measured_head(probed.measurement, None, f"ncomp touches {log} --machine {machine} --plan {plan}")
    report = touches_report(probed, log.name, head)
    for note in probed.notes:
        say("note", note)
    with whole_results(output, *others.files) as (file, *files):
        write_measurement(probed.measurement, file)
        others.write(touches_json(probed), report, tuple(files), (log, plan))
    show(report, output, *others.files)
