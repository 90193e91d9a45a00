"""grbl: steps per mm of X, Y and Z, `$100` to `$102`."""

from __future__ import annotations

from kinematics.user_error import UserError
from postproc.control_data.format import Settings
from postproc.control_data.formats.firmware.skew_and_mesh import slopes
from postproc.control_data.readers.firmware.read_grbl import AXES, read, steps_of
from postproc.control_data.tables.build import Capabilities
from postproc.control_data.tables.content import Content, number
from postproc.control_data.tables.limits import Limits
from postproc.control_data.tables.table_format import TableFormat

MAX_INT_DIGITS = 8
"""Digits of a setting that grbl reads (MAX_INT_DIGITS of nuts_bolts.c); it drops the others."""


class GrblSettings(Settings, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """`steps`: the present steps per mm of each axis, as `X:250,Y:250,Z:400`."""

    steps: str


def write(content: Content) -> dict[str, str]:
    """`grbl.txt`: the settings of all axes whose steps per mm are given."""
    present = steps_of(content.settings.steps)
    scales = {letters[0]: slope for letters, slope in slopes(content).items()}
    for axis in scales:
        if axis not in present:
            raise UserError(
                f"--set steps={content.settings.steps}: expected the present steps per mm of {axis} as well"
            )
    rows = []
    for axis, steps in present.items():
        value = steps * (1.0 + scales.get(axis, 0.0))
        rows.append(f"${AXES[axis]}={number(value, MAX_INT_DIGITS - len(str(int(value))))}\n")
    return {"grbl.txt": "".join(rows)}


def _limits(settings: GrblSettings) -> Limits:
    steps_of(settings.steps)
    return Limits(points=2, resolution=1e-7, degree=1, through_zero=True, zero_at_home=True)


def _way_back(content: Content) -> str:
    present = ", ".join(f"${AXES[axis]}={steps:g}" for axis, steps in steps_of(content.settings.steps).items())
    homes = ", ".join(f"{axis.name} {axis.home:g}" for axis in content.machine.axes if axis.name[0] in AXES)
    return f"""\
The present values, to go back: {present}. The axes are homed at {homes} by the machine file (`home`)."""


FORMAT = TableFormat(
    name="grbl",
    title="grbl, steps per mm",
    settings=GrblSettings,
    limits=_limits,
    capabilities=lambda _: Capabilities(outputs="XYZ"),
    write=write,
    read=read,
    remark=_way_back,
    sign="correction",
    family="firmware",
    meaning="""\
$100, $101, $102: steps per mm of X, Y and Z. An axis makes its steps from the position on at which it was homed, so a
larger value moves it farther from there. This is the scale of each axis and no more: no squareness, no straightness,
no height, and nothing of a positioning error that is no straight line. grbl keeps 24 bits of a number: 0.06 um a m.""",
    loading="""\
Send the lines while the machine stands idle; grbl stores them. Ask for `$$`: grbl prints three decimals, and keeps the
others. Home the machine and touch off again: after the change its position is that of other steps. $110 to $132 are in
mm and stay. FluidNC has the same numbers as steps_per_mm in its configuration file.""",
    certainty="""\
grbl's source (gnea/grbl, 1.1): settings.c, limits.c (homing), nuts_bolts.c (digits), report.c. Its formula, in single
precision and whole steps, moves the machine of ncomp's tests; the firmware itself was not run.""",
)
