"""Tables of coordinate measuring machines, one row per feature: measured, nominal, and the error Meas - Nom.

        Meas X    Meas Y     Nom X     Nom Y     Err X     Err Y  Meas D   Nom D   Round
       -73.126   121.717   -73.140   121.705     0.014     0.012   2.174   2.167   0.007

The format is that of the plug plates of the Sloan survey (ApachePointObservatory/fitPlugPlateMeas): columns of `Meas`
and `Nom` in X, Y and possibly Z, blanks between numbers, any lines above. Lengths are assumed to be mm, because the
file does not give the unit; the measurement has a note on it. Diameters and roundness are not read.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from calibration.measurement.readers.text import given_entries
from calibration.measurement.text_table import Table, table_of
from kinematics.files import fingerprint
from kinematics.files.text_cells import number_at, numbered_lines
from kinematics.machine import Machine
from kinematics.user_error import UserError

_NAME = re.compile(r"(?:Meas|Nom|Err)\s+[XYZD]|Round", re.I)
CMM_ROUNDING_MM = 2.5e-3
"""Largest difference, mm, of Err from Meas - Nom, because each of these is rounded to um."""


def recognises(head: str) -> bool:
    """True for the beginning of such a file."""
    return any(_is_names(line) for line in head.splitlines())


def to_table(data: bytes, source: str, machine: Machine, header: Mapping[str, str]) -> tuple[Table, list[str]]:  # noqa: ARG001 - as all readers
    """The file as a table of the contract's columns, and notes."""
    lines = numbered_lines(data)
    start = next(i for i, (_, line) in enumerate(lines) if _is_names(line))
    names = [" ".join(name.lower().split()) for name in _NAME.findall(lines[start][1])]
    axes = [letter for letter in "xyz" if f"meas {letter}" in names and f"nom {letter}" in names]
    columns: dict[str, list[str]] = {name: [] for name in (*(f"nominal_{letter}" for letter in axes), *axes)}
    numbers = []
    for number, line in lines[start + 1 :]:
        if not line.strip():
            continue
        where, cells = f"{source}:{number}", line.split()
        if len(cells) != len(names):
            raise UserError(f"{where}: {len(cells)} numbers, but {len(names)} columns have names")
        row = {name: number_at(cell, f"{where} column {name}") for name, cell in zip(names, cells, strict=True)}
        for letter in axes:
            nominal, measured = row[f"nom {letter}"], row[f"meas {letter}"]
            error = row.get(f"err {letter}", measured - nominal)
            if abs(measured - nominal - error) > CMM_ROUNDING_MM:
                raise UserError(f"{where}: Err {letter.upper()} is {error:g}, Meas - Nom is {measured - nominal:.4g}")
            columns[f"nominal_{letter}"].append(repr(nominal))
            columns[letter].append(repr(measured))
        numbers.append(number)
    entries = given_entries(header, {"instrument": "part"})
    notes = ["lengths are read as mm: the file names no unit"]
    return table_of(source, fingerprint(data), entries, columns, numbers), notes


def _is_names(line: str) -> bool:
    names = {" ".join(name.lower().split()) for name in _NAME.findall(line)}
    return {"meas x", "meas y", "nom x", "nom y"} <= names and not _NAME.sub("", line).strip()
