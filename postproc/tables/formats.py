"""The table of formats."""

from __future__ import annotations

from kinematics.errors import UserError
from postproc.tables import iso_csv, linuxcnc, siemens
from postproc.tables.format import Format

FORMATS: dict[str, Format] = {
    form.name: form
    for form in (
        linuxcnc.FORMAT,
        siemens.EEC,
        siemens.CEC,
        iso_csv.FORMAT,
    )
}


def find_format(name: str) -> Format:
    """The format of that name; UserError names those there are."""
    if name not in FORMATS:
        raise UserError(f"--format {name}: none of {', '.join(FORMATS)}")
    return FORMATS[name]
