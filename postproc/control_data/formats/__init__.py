"""The formats of controls: compensation tables first, then kinematic parameters."""

from __future__ import annotations

from typing import TypeVar

from kinematics.files.mistaken import none_of
from kinematics.user_error import UserError
from postproc.control_data.format import Format
from postproc.control_data.formats import (
    error_motions_csv,
    etalon_exchange,
    fanuc_kinematics,
    fanuc_pitch,
    heidenhain_com,
    heidenhain_transformations,
    isg_compensation,
    linuxcnc_comp,
    linuxcnc_kinematics,
    linuxcnc_matrix,
    mitsubishi_pitch,
    siemens_eec_cec,
    siemens_trafo5_tcarr,
)
from postproc.control_data.formats.firmware import grbl, klipper_and_reprap, marlin

Kind = TypeVar("Kind", bound=Format)

FORMATS: dict[str, Format] = {
    form.name: form
    for form in (
        linuxcnc_comp.FORMAT,
        siemens_eec_cec.EEC,
        siemens_eec_cec.CEC,
        heidenhain_com.COM,
        heidenhain_com.KINEMATICS,
        fanuc_pitch.FORMAT,
        isg_compensation.SSFK,
        isg_compensation.CROSS,
        isg_compensation.VOLUMETRIC,
        etalon_exchange.FORMAT,
        mitsubishi_pitch.FORMAT,
        klipper_and_reprap.KLIPPER,
        klipper_and_reprap.REPRAP,
        marlin.FORMAT,
        grbl.FORMAT,
        linuxcnc_matrix.MATRIX,
        linuxcnc_matrix.CALIBRATED,
        error_motions_csv.FORMAT,
        linuxcnc_kinematics.FORMAT,
        siemens_trafo5_tcarr.TRAFO5,
        siemens_trafo5_tcarr.TCARR,
        heidenhain_transformations.FORMAT,
        fanuc_kinematics.FORMAT,
    )
}
"""By the name of `--format`."""


def formats_of(kind: type[Kind]) -> dict[str, Kind]:
    """The formats of a kind, `TableFormat` or `ParameterFormat`, by their names."""
    return {name: form for name, form in FORMATS.items() if isinstance(form, kind)}


def find_format(name: str, kind: type[Kind]) -> Kind:
    """The format of that name and kind; UserError names those there are."""
    known = formats_of(kind)
    if name not in known:
        raise UserError(f"--format {none_of(name, known)}")
    return known[name]
