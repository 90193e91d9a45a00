"""The table of kinematic parameter formats."""

from __future__ import annotations

from postproc.kinematic_parameters.format import ParameterFormat
from postproc.kinematic_parameters.formats import fanuc, heidenhain, linuxcnc, siemens

FORMATS: dict[str, ParameterFormat] = {
    form.name: form
    for form in (
        linuxcnc.FORMAT,
        siemens.TRAFO5,
        siemens.TCARR,
        heidenhain.FORMAT,
        fanuc.FORMAT,
    )
}
