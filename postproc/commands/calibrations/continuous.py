"""`ncomp continuous`: laser runs in motion and a quasi-static measurement of an axis, joined into one error table."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, ClassVar, Literal

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options.declared import DATA, MODEL, argument, option, output_option, refuse_given
from postproc.commands.options.measurement import HeaderLines
from postproc.commands.options.shared import OptionalMachine, ResultOptions, whole_results

if TYPE_CHECKING:
    from calibration.continuous.estimate import TableRows

EPILOG = (
    "Examples:\n\n"
    "`ncomp continuous x_run.csv x_targets.csv -o x_table.csv --report x.html`\n\n"
    "`ncomp continuous forward.csv backward.csv x_axis.rtl --header u_um=0.3 -o x_table.csv --direction backward`\n\n"
    "`ncomp continuous x_run.csv x_targets.csv --run 1 -o x_table.csv`  uses only the first cycle\n\n"
    "`ncomp continuous x_run.csv x_targets.csv -o x_table.csv --machine cframe --write-calibration cal.json`  writes a "
    "calibration for *ncomp part.nc*, *ncomp export* and every other command with --calibration\n\n"
    "`ncomp continuous y_run.csv y_targets.csv -o y_table.csv --machine cframe --add-to cal.json "
    "--write-calibration cal_xy.json`  adds the next axis"
)


@dataclass(frozen=True, kw_only=True)
class CalibrationOptions:
    """The estimate as a calibration of a machine."""

    PANEL: ClassVar[str] = MODEL

    write_calibration: str | None = option(
        "File for the errors of both directions, with their uncertainties, as a calibration of --machine.",
        "CAL.json",
        writes="file",
    )
    machine: OptionalMachine
    add_to: Path | None = option(
        "Calibration of the machine, in which the errors along this axis are replaced.", "OLD.json", reads=True
    )

    def check(self) -> None:
        """UserError for other options without --write-calibration, and for that without --machine."""
        if self.write_calibration is not None and self.machine is None:
            raise UserError("--write-calibration: give the machine of the calibration with --machine")
        if self.write_calibration is None:
            refuse_given("is an option of --write-calibration: give it too", self, "machine", "add_to")


def continuous(
    *,
    data: tuple[Path, ...] = argument(
        "Continuous runs and quasi-static data, which their columns distinguish.",
        "CONTINUOUS.csv... QUASISTATIC.csv...",
        reads=True,
    ),
    output: str = output_option("File for the error table; `-` is standard output.", "TABLE.csv"),
    spacing_mm: float | None = option("Distance of the rows of the table, mm; default: about 500 rows.", "mm"),
    direction: Literal["auto", "forward", "backward", "mean"] = option(
        "Direction of the table; auto: mean where both directions have continuous runs, else that of the run.",
        default="auto",
    ),
    run: tuple[str, ...] = option("Quasi-static run to use; default: all.", "NAME", panel=DATA),
    header: HeaderLines,
    model: CalibrationOptions,
    others: ResultOptions,
) -> None:
    """Join laser runs at constant velocity with a coarse quasi-static measurement of the same axis: one fine table.

    The run shows the shape of the error in full detail, the targets its scale and datum. Errors are measured minus
    target, positive where the axis goes too far in its positive direction; u_um is their standard uncertainty (k = 1).
    Cyclic errors, table steps, vibrations, reversal and drift between runs are reported.
    """
    from calibration.fit.beyond_measured import calibration_file
    from calibration.reports.continuous import continuous_json, continuous_report
    from postproc.commands.show.terminal import console, say, show

    model.check()
    machine = None if model.machine is None else ncomp.load_machine(model.machine)
    with console.status("joining"):
        result = ncomp.continuous(
            data,
            machine,
            spacing_mm=spacing_mm,
            direction=direction,
            run=run,
            header=header,
            add_to=model.add_to,
        )
    found, read, made = result.estimate, result.data, result.calibration
    report = continuous_report(found, read, f"ncomp continuous {' '.join(map(str, data))}")
    for note in result.notes:
        say("note", note)
    with whole_results(*others.files, model.write_calibration, output) as (results, page, calibration, file):
        _write_table(result.table, file)
        if made is not None and machine is not None:
            calibration.write(calibration_file(made.model, machine))
        others.write(continuous_json(found, read), report, (results, page), (*data, model.add_to))
    show(report, output, model.write_calibration, *others.files)
    if made is not None:
        say("calibration", f"{model.write_calibration}: {', '.join(made.effects)}; {made.nodes} nodes")


def _write_table(rows: TableRows, file: BinaryIO) -> None:
    """Write the error table: position_mm, error_um, u_um (k = 1)."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["position_mm", "error_um", "u_um"])
    for x, error, u in zip(rows.position.tolist(), rows.error.tolist(), rows.u.tolist(), strict=True):
        writer.writerow([f"{x:.6f}".rstrip("0").rstrip("."), f"{error:z.4f}", f"{u:.4f}"])
    file.write(text.getvalue().encode())
