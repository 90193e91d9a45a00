"""`ncomp diagnose --engine terms`: a diagnosis by a search among structures of Gaussian terms."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options.measurement import DataOptions
from postproc.commands.options.shared import ResultOptions, whole_results


def diagnose_by_terms(
    data: Sequence[Path],
    machine: str,
    output: Path,
    calibration: Path | None,
    form: DataOptions,
    others: ResultOptions,
    *,
    force: bool,
) -> None:
    """Diagnose measurement files, and write the calibration and the results."""
    from calibration.diagnosis.terms.conclusion.document import document
    from calibration.diagnosis.terms.conclusion.report import report
    from calibration.diagnosis.terms.diagnosed import diagnosed
    from calibration.fit.beyond_measured import calibration_file
    from postproc.commands.show.terminal import console, show

    found_machine = ncomp.load_machine(machine)
    present = None if calibration is None else ncomp.load_calibration(found_machine, calibration)
    measurement = form.read(data, found_machine)
    with console.status("reading") as status:
        answer = diagnosed(measurement, present, force=force, progress=status.update)
    shown = report(answer)
    with whole_results(*others.files, str(output) if answer.accepted else None) as (results, page, file):
        if answer.accepted:
            file.write(calibration_file(answer.calibration, found_machine))
        others.write(document(answer), shown, (results, page), (*data, form.plan, calibration))
    show(shown, *others.files, str(output))
    if not answer.accepted:
        raise UserError(f"{measurement.source}: {answer.reason}")
    form.note_date([measurement])


def refuse_options(given: dict[str, bool]) -> None:
    """UserError for the first option that is given and that this engine does not know."""
    for name, is_given in given.items():
        if is_given:
            raise UserError(f"{name} and --engine terms exclude each other: leave out one of them")
