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
    add_unexplained: bool,
    force: bool,
) -> None:
    """Diagnose measurement files, and write the calibration and the results."""
    from calibration.diagnosis.diagnose import diagnosed
    from calibration.fit.beyond_measured import calibration_file
    from calibration.reports.diagnosis.commands import Files
    from calibration.reports.diagnosis.document import answer_json
    from calibration.reports.diagnosis.page import answer_report
    from postproc.commands.show.terminal import console, show

    found_machine = ncomp.load_machine(machine)
    present = None if calibration is None else ncomp.load_calibration(found_machine, calibration)
    measurement = form.read(data, found_machine)
    with console.status("reading") as status:
        answer = diagnosed(measurement, present, force=force, add_unexplained=add_unexplained, progress=status.update)
    against = "" if calibration is None else f" --calibration {calibration}"
    command = f"ncomp diagnose {' '.join(map(str, data))} --machine {machine}{against}"
    files = Files(machine, str(output), None if calibration is None else str(calibration))
    shown = answer_report(answer, command, files)
    with whole_results(*others.files, str(output) if answer.accepted else None) as (results, page, file):
        if answer.accepted:
            file.write(calibration_file(answer.model, found_machine))
        others.write(answer_json(answer), shown, (results, page), (*data, form.plan, calibration))
    show(shown, *others.files, str(output))
    if not answer.accepted:
        raise UserError(f"{measurement.source}: {answer.reason}")
    form.note_date([measurement])
