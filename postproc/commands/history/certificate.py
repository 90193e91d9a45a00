"""`ncomp certificate`: a calibration, or results of ISO 230-2, as a Digital Calibration Certificate and a page."""

from __future__ import annotations

from pathlib import Path

from postproc.commands.options.declared import REQUIRED, argument, option, output_option
from postproc.commands.options.shared import OptionalMachine, ResultOptions, whole_results

EPILOG = (
    "Examples:\n\n"
    "`ncomp certificate cal.json --details details.toml -o certificate.xml --report certificate.html`\n\n"
    "`ncomp certificate laser.json --details details.toml -o certificate.xml`  results of ncomp iso230 --json"
)


def certificate(
    *,
    result: Path = argument("A calibration, or results of ncomp iso230 (--json).", "CAL.json|RESULT.json", reads=True),
    details: Path = option(
        "Laboratory, customer, machine, instruments and persons, dates, limits and the decision rule.",
        "DETAILS.toml",
        default=REQUIRED,
        reads=True,
    ),
    machine: OptionalMachine,
    output: str = output_option("The certificate, DCC 3.3.0; `-` is standard output.", "CERTIFICATE.xml"),
    others: ResultOptions,
) -> None:
    """Write a calibration certificate: results with U (k = 2), and statements of conformity by a named decision rule.

    The certificate carries the calibration: every command that reads one reads the certificate too, and ncomp history
    add enters it. One that was edited is refused. --report writes the page to sign. Without --machine it is the shipped
    machine of the calibration.
    """
    from history.certificate.conformity import answer_of, statements
    from history.certificate.dcc import certificate_xml
    from history.certificate.details import read_details
    from history.certificate.page import certificate_report
    from history.certificate.results import read_results
    from postproc.commands.show.terminal import console, show

    given = read_details(details)
    with console.status("results"):
        found = read_results(result, machine).fitting(given, str(details))
    stated = statements(given.certificate, found.figures)
    report = certificate_report(given, found, stated)
    answer = answer_of(given.certificate, found.figures, stated)
    with whole_results(*others.files, output) as (results, page, file):
        file.write(certificate_xml(given, found, stated))
        others.write(answer, report, (results, page), (result, details))
    show(report, *others.files, output)
