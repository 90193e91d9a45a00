"""`ncomp import`: compensation tables of a control as an error model."""

from __future__ import annotations

from pathlib import Path

import ncomp
from postproc.commands.controls.export import FORMAT_LIST, TableOptions, check_format
from postproc.commands.options.declared import argument, option, output_option
from postproc.commands.options.shared import MachineName

EPILOG = (
    f"{FORMAT_LIST}Examples:\n\n"
    "`ncomp import machine.ini comp_x.txt comp_y.txt --machine gantry --format linuxcnc -o in_control.json`\n\n"
    "`ncomp import tables --machine mill.toml --format siemens-cec --sign error --less-tables-from cal.json "
    "-o rest.json`"
)


def import_tables(
    *,
    files: tuple[Path, ...] = argument("Tables, or folders with tables.", "FILES", reads=True),
    machine: MachineName,
    tables: TableOptions,
    output: Path = output_option("File for the error model.", "OUT.json"),
    less_tables_from: Path | None = option(
        "Calibration without the tables: write it less the errors that the tables compensate.", "CAL.json", reads=True
    ),
    with_tables_to: Path | None = option(
        "Calibration measured with the tables active: write the errors of the machine without the tables.",
        "CAL.json",
        reads=True,
    ),
) -> None:
    """Read a control's tables as the errors that they compensate.

    A calibration measured without the tables, less their errors, leaves the errors for programs to correct. A
    calibration measured with the tables active, plus their errors, is that of the machine itself, for new tables.
    """
    from kinematics.error_model.model import write_model
    from postproc.commands.show.terminal import say

    check_format(tables.format)
    found = ncomp.import_tables(
        files, machine, **vars(tables), less_tables_from=less_tables_from, with_tables_to=with_tables_to
    )
    write_model(found.model, output)
    say("read", ", ".join(effect.name for effect in found.effects))
    if found.unit_assumed:
        say("note", "the unit of the tables is assumed: mm; state unit under [control] of the machine file")
    if found.not_read:
        say("not read", f"{', '.join(found.not_read)}: nothing of these files belongs to the tables")
