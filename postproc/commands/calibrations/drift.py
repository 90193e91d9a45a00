"""`ncomp drift`: a log of touches in, a calibration and a work offset that correct the drift of the machine out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

import ncomp
from kinematics.user_error import UserError
from postproc.commands.options.declared import SET_UP, argument, option, output_option
from postproc.commands.options.earlier_touches import drift_entry, earlier_touches
from postproc.commands.options.measurement import DataOptions
from postproc.commands.options.recorded import RecordedOptions
from postproc.commands.options.shared import CalibrationName, MachineName, whole_results

if TYPE_CHECKING:
    from calibration.following.drift import Drift

EPILOG = (
    "Examples:\n\n"
    "`ncomp drift touches.csv --machine mill.toml --calibration cal.json -o now.json`\n\n"
    "`ncomp drift touches.csv --machine mill.toml --calibration none -o now.json --since '2026-11-30 07:10:00' "
    "--at '2026-11-30 15:00:00' --temperature spindle=31.5 --tolerance-um 5`\n\n"
    "`ncomp drift touches.csv --machine mill.toml --calibration none -o now.json --offsets zero.nc "
    "--dialect fanuc --work-offset G54=-210.5,-95,-310`\n\n"
    "`ncomp drift touches.csv --machine mill.toml --calibration none -o now.json --history`  "
    "learns from earlier logs too\n\n"
    "then `ncomp part.nc --machine mill.toml --calibration now.json -o part_c.nc`"
)


@dataclass(frozen=True, kw_only=True)
class TimeOptions:
    """The time of the drift, and how well it has to be known."""

    at: str | None = option(
        "Time for which the drift is predicted, by the clock of the log ('2025-11-24 16:00:00', or s); default: that "
        "of the last reading.",
        "TIME",
    )
    since: str | None = option(
        "Time at which the work offsets were touched off, from which the drift counts; default: the first reading.",
        "TIME",
    )
    temperature: tuple[str, ...] = option(
        "Temperature of a sensor at that time; default: that of the last reading.", "NAME=degC"
    )
    tolerance_um: float | None = option(
        "Largest uncertainty U (k=2), um, with which the drift is corrected; beyond it nothing is written.",
        "UM",
        min=0.0,
    )
    accept_jumps: bool = option(
        "Take a jump between two readings as drift; otherwise it is refused, because a sphere may have been knocked.",
        default=False,
    )


@dataclass(frozen=True, kw_only=True)
class OffsetOptions:
    """The program that sets the work offset."""

    PANEL: ClassVar[str] = SET_UP

    offsets: str | None = option(
        "Program that sets the work offset for the drift instead; needs --work-offset.", "FILE", writes="file"
    )
    dialect: Literal["linuxcnc", "fanuc", "siemens", "heidenhain"] = option(
        "Control of this program.", default="linuxcnc"
    )
    work_offset: str | None = option("Work offset as it was touched off, mm: G54=-30,-20,150.", "G54=x,y,z")

    def program(self, found: Drift) -> bytes:
        """The program, empty without one; UserError where one of both options is missing."""
        if self.offsets is None and self.work_offset is None:
            return b""
        if self.offsets is None or self.work_offset is None:
            raise UserError(
                "--offsets FILE and --work-offset G54=x,y,z, as it was touched off, belong together: give both"
            )
        from kinematics.error_model.model import no_errors
        from postproc.control_data.work_offsets import offset_program

        estimate, mill, control = found.estimate, found.followed.measurement.machine, self.dialect
        model = estimate.on(no_errors(mill)) if estimate.significant else no_errors(mill)
        untried = f"NOT TRIED ON A CONTROL: CHECK IT BLOCK BY BLOCK - {control.upper()}"
        remarks = [f"NCOMP DRIFT - {mill.name.upper()} - U {estimate.U:.1f} UM", *[untried] * (control != "linuxcnc")]
        return offset_program(mill, model, self.work_offset, control, remarks).encode()


def drift(
    *,
    touches: Path = argument("Log of touches: a measurement file of a touch probe with times.", "LOG.csv", reads=True),
    machine: MachineName,
    calibration: CalibrationName,
    output: str = output_option("File for the calibration with the drift; `-` is standard output.", "NEW.json"),
    times: TimeOptions,
    offset: OffsetOptions,
    data: DataOptions,
    others: RecordedOptions,
) -> None:
    """Follow the drift of a machine by repeated touches of a sphere, and correct the next programs for it.

    The drift since the first reading, or since the work offsets were touched off, is a random walk and what follows the
    temperatures, both learned from the log, and with --history from the earlier ones of the machine. Implausible
    readings are left out. A drift that is less than its uncertainty is not corrected (docs/drift.md).
    """
    from calibration.following.report import drift_json, drift_report
    from calibration.reports.head import measured_head
    from kinematics.error_model.model import encode_model
    from postproc.commands.show.terminal import show

    mill = ncomp.load_machine(machine)
    measurement = data.read([touches], mill)
    earlier = earlier_touches(mill, others.address(mill))
    found = ncomp.drift(measurement, calibration, **vars(times), earlier=earlier)
    program = offset.program(found)
    head = measured_head(measurement, found.model, f"ncomp drift {touches} --machine {machine}")
    report = drift_report(found, touches.name, head)
    results = drift_json(found)
    with (
        others.recorded(mill) as record,
        whole_results(output, offset.offsets, *others.files) as (file, offset_file, *files),
    ):
        file.write(encode_model(found.model))
        offset_file.write(program)
        others.write(results, report, tuple(files), (touches, *data.files))
        if not times.accept_jumps:  # a log with a jump is no example for others
            record(drift_entry(found, results, (touches, *data.files)))
    show(report, output, offset.offsets, *others.files)
