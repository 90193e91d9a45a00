"""Values for parameters of a control instead of tables: backlash, thermal growth, positions of rotary axes.

Names of parameters are marked as in sheet.md: [manual] read in a maker's manual, [common] common knowledge that no
source was found for. None of them is written into a control by ncomp.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from kinematics.error_model.model import ErrorModel
from postproc.control_data.tables.content import Content


class Row(NamedTuple):
    """One parameter: its subject, value with unit, name in the control, and whether the tables contain it already."""

    subject: str
    value: str
    control_parameter: str
    held: str


NOT_HELD = "no"
HELD = "yes: do not enter it as well"
CONSTANT = "its constant part, with the constants of the tables: do not enter it as well"


CONTROL_PARAMETERS: Mapping[str, Mapping[str, str]] = {
    "linuxcnc": {
        "backlash": "[JOINT_n] BACKLASH [manual]; ignored where the joint has a COMP_FILE",
        "growth": "no parameter: external offset by a HAL component [common]",
        "rotary": "x-offset, y-offset, z-offset and *-rot-point pins of xyzac/xyzbc-trt-kins [manual]: "
        "--format linuxcnc-kinematics writes them",
    },
    "siemens": {
        "backlash": "MD32450 $MA_BACKLASH [common]; only where no table holds both directions",
        "growth": "MD32750 TEMP_COMP_TYPE, SD43900 ... SD43920 temperature compensation [common]",
        "rotary": "TRAORI: MD24500, MD24550, MD24558, MD24560 offsets, MD24570/24572 axis vectors; "
        "swivel data $TC_CARR1..20, fine offsets $TC_CARR41..60 [manual]: --format siemens-trafo5, siemens-tcarr",
    },
    "heidenhain": {
        "backlash": "MP_backLash; MP750.x on older controls [manual]; only where no table has a BACKLASH column",
        "growth": "no public description found",
        "rotary": "COORD of the Trans rows before the MachAxis row in the kinematics description [manual]: "
        "--format heidenhain-transformations",
    },
    "fanuc": {
        "backlash": "1851 backlash, 1852 in rapid traverse, detection units [common]; 0 with bidirectional tables",
        "growth": "thermal growth compensation along the tool: an option [common]",
        "rotary": "19700 ... 19714 offsets of the five-axis kinematics [manual]: --format fanuc-kinematics",
    },
    "isg": {
        "backlash": "lr_param.backlash [common]; included in tables with bilateral 1 [manual]",
        "growth": "temperature compensation, keyword TEMP of COMP ON [manual: existence only]",
        "rotary": "kinematic parameters of the channel; X0C ... of the volumetric compensation [manual]",
    },
    "mitsubishi": {
        "backlash": "#2011 and #2012 backlash compensation [common]",
        "growth": "no source found",
        "rotary": "rotary axis configuration parameters [common]",
    },
    "firmware": {
        "backlash": "M425 on Marlin and on newer RepRapFirmware; none on Klipper and grbl [common]",
        "growth": "none",
        "rotary": "none",
    },
}


def parameter_rows(model: ErrorModel, content: Content, family: str) -> list[Row]:
    """The rows of sheet.md for one control, in the order of the calibration."""
    machine, control_parameters = content.machine, CONTROL_PARAMETERS.get(family, {})
    bidirectional = {term.output for term in content.terms if term.direction}
    bidirectional |= {table.axis for table in content.motions if (table.forward != table.backward).any()}
    lines = HELD if content.motions else CONSTANT
    rows = []
    for effect in model.effects:
        value = effect.in_control(machine)
        if value is not None:
            reversal = HELD if {*effect.axes} & bidirectional else NOT_HELD
            held = {"backlash": reversal, "rotary": lines}.get(effect.CONTROL_PARAMETER, NOT_HELD)
            rows.append(Row(*value, control_parameters.get(effect.CONTROL_PARAMETER, ""), held))
    return rows
