"""The table of formats."""

from __future__ import annotations

from kinematics.files.mistaken import none_of
from kinematics.user_error import UserError
from postproc.tables.format import Format
from postproc.tables.formats import etalon, fanuc, firmware, heidenhain, isg, iso_csv, linuxcnc, mitsubishi, siemens

FORMATS: dict[str, Format] = {
    form.name: form
    for form in (
        linuxcnc.FORMAT,
        siemens.EEC,
        siemens.CEC,
        heidenhain.COM,
        heidenhain.KINEMATICS,
        fanuc.FORMAT,
        isg.SSFK,
        isg.CROSS,
        isg.VOLUMETRIC,
        etalon.FORMAT,
        mitsubishi.FORMAT,
        firmware.KLIPPER,
        firmware.REPRAP,
        iso_csv.FORMAT,
    )
}


def find_format(name: str) -> Format:
    """The format of that name; UserError names those there are."""
    if name not in FORMATS:
        raise UserError(f"--format {none_of(name, FORMATS)}")
    return FORMATS[name]
