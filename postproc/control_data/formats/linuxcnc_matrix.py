"""LinuxCNC: kinematics that are a matrix of X, Y and Z (matrixkins), or a matrix and squares (calibxyzkins)."""

from __future__ import annotations

import numpy as np

from kinematics.transforms import Array
from postproc.control_data.format import Settings, of_control
from postproc.control_data.readers.read_linuxcnc_matrix import read_calibrated, read_matrix
from postproc.control_data.tables.build import CHORDS, Capabilities
from postproc.control_data.tables.content import Content, curves_by_letters
from postproc.control_data.tables.limits import Limits
from postproc.control_data.tables.table_format import TableFormat

AXES = "XYZ"
PAIRS = tuple(a + b for a in AXES for b in AXES if a != b)
TOLERANCE = "1e-9"
"""calibxyzkins.tol: the module stops its search below it, and its default of 1e-3 would leave errors of 1 um."""


def polynomials(content: Content) -> Array:
    """Coefficients `(output, source, power)` of the corrections, power 0 to 2, mm per mm to the power."""
    found = np.zeros((3, 3, 3))
    for letters, curve in curves_by_letters(content).items():
        degree = 1 if len(curve.nodes) == 2 else 2
        coefficients = np.polynomial.polynomial.polyfit(curve.nodes, curve.values, degree)
        found[AXES.index(letters[0]), AXES.index(letters[1]), : degree + 1] = coefficients
    return found


def _entries(matrix: Array) -> list[tuple[str, str]]:
    """Name and value of each entry of a matrix: the letter of its row, then of its column."""
    letters = AXES.lower()
    return [(letters[i] + letters[j], f"{matrix[i, j] + 0.0:.12g}") for i in range(3) for j in range(3)]


def write_matrix(content: Content) -> dict[str, str]:
    """`matrixkins.hal`: joint = C axis."""
    matrix = np.eye(3) + polynomials(content)[:, :, 1]
    return {"matrixkins.hal": "".join(f"setp matrixkins.C_{name} {value}\n" for name, value in _entries(matrix))}


def write_calibrated(content: Content) -> dict[str, str]:
    """`calibxyzkins.hal`: axis = A joint + B joint^2 + c, which are errors, minus the corrections."""
    errors = -polynomials(content)
    rows = [f"a.{name} {value}" for name, value in _entries(np.eye(3) + errors[:, :, 1])]
    rows += [f"b.{name} {value}" for name, value in _entries(errors[:, :, 2])]
    rows += [f"c.{a.lower()} {value + 0.0:.9g}" for a, value in zip(AXES, errors[:, :, 0].sum(axis=1), strict=True)]
    tolerance = f"setp calibxyzkins.tol {TOLERANCE}\n"
    return {"calibxyzkins.hal": "".join(f"setp calibxyzkins.calib-{row}\n" for row in rows) + tolerance}


MATRIX = TableFormat(
    name="linuxcnc-matrix",
    title="LinuxCNC matrixkins",
    settings=Settings,
    limits=lambda _: Limits(points=2, resolution=1e-7, degree=1, through_zero=True),
    capabilities=lambda _: Capabilities(outputs=AXES, cross=True, pairs=PAIRS),
    write=write_matrix,
    read=read_matrix,
    sign="correction",
    family="linuxcnc",
    meaning="""\
joint = C axis: C_xx, C_yy and C_zz are the scales of X, Y and Z, the others what an axis (first letter) moves by the
position of another (second letter), mm per mm. They act from machine position 0 on, before the COMP_FILE of the joints.
Straightness, angular errors and a positioning error that is no straight line are not in them.""",
    loading="""\
The LinuxCNC of the machine must have the module matrixkins (LinuxCNC after 2.9). In the INI file: KINEMATICS =
matrixkins under [KINS], with joints 0, 1 and 2 for X, Y and Z; more joints pass as they are. Add the lines to the HAL
file behind loadrt [KINS]KINEMATICS, and restart. Home first: joints and axes differ, so a move of one axis may move all
three joints, and the limits of joints need the room for it.""",
    certainty="""\
LinuxCNC's source (src/hal/components/matrixkins.comp, master, 2022 to 2026). LinuxCNC 2.9 has no such module; a
module with the same formulas, written for LinuxCNC 2.9.0~pre1, moved the joints of its simulator to the exported
positions.""",
)
CALIBRATED = TableFormat(
    name="linuxcnc-calibxyz",
    title="LinuxCNC calibxyzkins",
    settings=Settings,
    limits=lambda _: Limits(points=3 * CHORDS + 1, resolution=1e-7, degree=2),
    capabilities=lambda _: Capabilities(outputs=AXES, cross=True, pairs=PAIRS),
    write=write_calibrated,
    read=read_calibrated,
    unit=of_control,
    sign="error",
    family="linuxcnc",
    meaning="""\
axis = A joint + B joint^2 + c, lengths in {unit}: where the machine is when its joints are there. calib-a has scales
and skew, calib-b the bows of axes over their own position and over others (positioning and straightness of second
degree), calib-c a constant. LinuxCNC searches the joints for a position until it is within calibxyzkins.tol, whose
default of 1e-3 leaves errors up to that size as they are: the file sets it to 1e-9.""",
    loading="""\
calibxyzkins is a module of another source than LinuxCNC: build it from there. In the INI file: KINEMATICS =
calibxyzkins coordinates=xyz under [KINS], and LINEAR_UNITS in {unit} under [TRAJ]. Add the lines to the HAL file
behind loadrt [KINS]KINEMATICS, and restart. Versions of 2025 may call the parameters calibxzkins, without the y:
LinuxCNC then does not start, and names the line; write the name of that version.""",
    certainty="""\
Its source (GTEC-UDC/linuxcnc_gantry_robot, linuxcnc/components/linuxcnc_calibrated_xyz_kins, 1bb9778). Its search,
written out, moves the machine of ncomp's tests; the module itself was not run.""",
)
