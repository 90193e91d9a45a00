"""Readers of controller tables, one for each format; they share no code with the writers.

A reader gives the errors that the tables correct, as effects of an error model.
"""

from __future__ import annotations

from collections.abc import Callable

from kinematics.effects import Effect
from kinematics.files.mistaken import none_of
from kinematics.user_error import UserError
from postproc.tables.readers import etalon, fanuc, firmware, heidenhain, isg, iso_csv, linuxcnc, mitsubishi, siemens
from postproc.tables.readers.source import Source

READERS: dict[str, Callable[[Source], list[Effect]]] = {
    "linuxcnc": linuxcnc.read,
    "siemens-eec": siemens.read_eec,
    "siemens-cec": siemens.read_cec,
    "heidenhain": heidenhain.read,
    "heidenhain-kinematics": heidenhain.read_kinematics,
    "fanuc": fanuc.read,
    "isg": isg.read_ssfk,
    "isg-cross": isg.read_cross,
    "isg-volumetric": isg.read_volumetric,
    "etalon": etalon.read,
    "mitsubishi": mitsubishi.read,
    "klipper": firmware.read_klipper,
    "reprap": firmware.read_reprap,
    "csv": iso_csv.read,
}


def read_tables(format: str, source: Source) -> list[Effect]:
    """The errors that tables correct; UserError for an unknown format, or files without any table."""
    if format not in READERS:
        raise UserError(f"--format {none_of(format, READERS)}")
    found = READERS[format](source)
    if not found:
        raise UserError(f"no table of format {format} in {', '.join(source.files) or 'no file'}")
    return found
