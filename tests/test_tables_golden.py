"""Tables as manuals, sources and public tools print them, through the readers; and what readers refuse."""

import re

import numpy as np
import pytest
from hypothesis import strategies as st
from support.programs import load, model_of
from support.table_cases import motions
from support.tiers import drawn

import machines
from kinematics.state import State
from kinematics.user_error import UserError
from postproc.control_data.format import parse_settings
from postproc.control_data.formats import FORMATS
from postproc.control_data.tables.export_tables import export

pytestmark = pytest.mark.usefixtures("few_positions")

MACHINE = machines.parse(
    """
name = "mill"
chain = "w b X Y Z A t"
[axes.X]
travel = [-400, 400]
[axes.Y]
travel = [-400, 400]
[axes.Z]
travel = [-400, 400]
[axes.A]
point = [0, 0, 0]
travel = [-inf, inf]
""",
    "mill",
)
OWN = {"X": 0, "Y": 1, "Z": 2, "A": 3}


def taken(format, files, sign, axis, q, way=0, **said):
    """Own error of an axis `(n,)`, um or urad, that the tables take away at positions `(n, 4)`, mm and degrees."""
    effects = FORMATS[format].read_files(MACHINE, files, sign, [f"{k}={v}" for k, v in said.items()]).effects
    q = np.atleast_2d(np.asarray(q, float)) * MACHINE.scale
    errors = model_of(MACHINE, *effects).errors(MACHINE, State(q, np.full(q.shape, float(way))))
    i = OWN[axis]
    return errors[:, i, i] * (1e6 if axis == "A" else 1e3)


def along(axis, positions):
    q = np.zeros((len(positions), 4))
    q[:, OWN[axis]] = positions
    return q


# FANUC Series 0i-PB Parameter Manual B-63980EN, p. 100: reference No. 40, interval 50 mm, No. 33 ... 49.
FANUC = [2, 1, 1, -2, 0, -1, 0, -1, 2, 1, 0, -1, -1, -2, 0, 1, 2]
FANUC_TEXT = "%\nN03620A1P40\nN03621A1P32\nN03622A1P49\nN03623A1P1\nN03624A1P50.0\n"
FANUC_TEXT += "".join(f"N{10000 + 33 + k}P{value}\n" for k, value in enumerate(FANUC)) + "%\n"
FANUC_SUMS = {450: 2, 400: 0, 350: -1, 300: -1, 250: 1, 200: 2, 150: 3, 100: 3, 50: 2, 0: 0, -50: 1, -100: 1, -150: 2}
FANUC_SUMS |= {-200: 2, -250: 4, -300: 3, -350: 2, -400: 0}


def test_the_manual_s_increments_of_fanuc():
    """Running sums from the reference point, in detection units of 1 um, added to the command."""
    found = taken("fanuc", {"pitch.txt": FANUC_TEXT}, "correction", "X", along("X", list(FANUC_SUMS)))
    assert -found == pytest.approx(list(FANUC_SUMS.values()), abs=1e-9)
    scaled = FANUC_TEXT.replace("N03623A1P1", "N03623A1P3")
    found = taken("fanuc", {"pitch.txt": scaled}, "error", "X", along("X", [50, -250]), unit_um="0.1")
    assert found == pytest.approx([0.6, 1.2], abs=1e-9)


def test_a_rotary_axis_of_fanuc_closes():
    """The manual's rotary axis: 8 sections of 45 degrees, reference No. 60, whose values sum to 0."""
    steps = [1, -2, 1, 3, -1, -1, -3, 2]
    text = "%\nN03620A4P60\nN03621A4P60\nN03622A4P68\nN03623A4P1\nN03624A4P45.0\nN03625A4P360.0\n"
    text += "".join(f"N{10061 + k}P{value}\n" for k, value in enumerate(steps)) + "%\n"
    found = taken("fanuc", {"p.txt": text}, "correction", "A", along("A", [0, 45, 90, 360]))
    assert -found / np.radians(1e-3) / 1e6 == pytest.approx([0, 1, -1, 0], abs=1e-9)


@drawn(few=3, many=12, seed=st.integers(0, 10_000), unit=st.sampled_from([0.5, 1.0, 2.0]))
def test_rounding_does_not_add_up(seed, unit):
    """The sum of rounded increments is never off by more than half a unit from the curve that was fitted."""
    machine = load("cframe")
    form = FORMATS["fanuc"]
    rng = np.random.default_rng(seed)
    (motion,) = motions(machine, "XX")
    model = model_of(machine, motion.with_parameters(rng.uniform(-12, 12, 4).tolist(), (0.0,) * 4))
    chosen = parse_settings(form.settings, [f"unit_um={unit}", "interval=20", "largest=127"])
    exported = export(machine, model, form, chosen, "correction", (0, 0, 0))
    rows = [line.split(",") for line in exported.files["pitch.csv"].splitlines()[1:]]
    x, steps = np.array([float(row[2]) for row in rows]), np.array([int(row[4]) for row in rows])
    sums = np.concatenate([[0], np.cumsum(steps[1:])]) * unit
    wanted = -model.errors(machine, State(np.outer(x, [1, 0, 0])))[:, 0, 0] * 1e3
    apart = sums - wanted
    assert np.abs(apart - apart[x == 0]).max() <= 1.01 * unit + 0.7  # both ends rounded; what linear pieces leave
    assert np.abs(steps).max() <= 127


# HEIDENHAIN, as a public tool writes them; the blanks are where it has them.
NEW = """BEGIN AXIS_X.COM MM
NR   AXISPOS       BACKLASH      X             Y             Z
0    +0.0000                     +0.0020
1    +50.0000                    -0.0040
[END]
"""
OLD = """BEGIN AXIS-X.COM  DATUM:+0.0000 DISTANCE:+50.0000
NR                  X          Y          Z
0       +0.0000     +0.0020
1       +50.0000    -0.0040
[END]
"""
SAG = """BEGIN SAG.COM MM
NR   AXISPOS       BACKLASH      X             Y             Z
0    -100.0000                                               +0.0100
1    +100.0000                                               -0.0100
[END]
"""


def cma(**files):
    axes = "".join(f"{axis:<16}" for axis in files)
    return "BEGIN CONFIG.CMA\nNR   ACTIVE  " + axes + "\n0    *       " + "".join(f"{f:<16}" for f in files.values()) + "\n[END]\n"  # fmt: skip


@pytest.mark.parametrize(("name", "text"), [("AXIS_X.COM", NEW), ("axis-x.com", OLD)])
def test_both_layouts_of_heidenhain(name, text):
    files = {name: text, "config.cma": cma(X=name.upper())}
    found = taken("heidenhain", files, "error", "X", along("X", [-10, 0, 25, 50, 60]))
    assert found == pytest.approx([2, 2, -1, -4, -4], abs=1e-9)


def test_a_table_named_in_column_y_with_values_in_column_z_is_z_by_y():
    """MANUALplus 620 technical manual: (column filled in the .COM) = F(column of the .CMA in which it is named)."""
    files = {"SAG.COM": SAG, "config.cma": cma(Y="SAG.COM")}
    assert taken("heidenhain", files, "error", "Z", along("Y", [-100, 0, 100])) == pytest.approx([10, 0, -10], abs=1e-9)
    assert not taken("heidenhain", files, "error", "Y", along("Y", [-100, 0, 100])).any()


# Beckhoff TF5200, example of a compensation value list: its third point, and our ends.
SSFK = """kopf.log_achs_nr                     2
kopf.log_achs_name                   Y
kw.ssfk.interval                     0
kw.ssfk.kw_startpos                 -200000
kw.ssfk.kw_nr_max                    3
kw.ssfk.unit                         1
kw.ssfk.bilateral                    1   # both ways
kw.ssfk.table[0].setpoint           -200000
kw.ssfk.table[1].setpoint           -199306
kw.ssfk.table[2].setpoint           -198667   /* mm/10000 */
kw.ssfk.table[0].pos                 0
kw.ssfk.table[1].pos                 24
kw.ssfk.table[2].pos                -102
kw.ssfk.table[0].neg                 0
kw.ssfk.table[1].neg                 67
kw.ssfk.table[2].neg                 80
"""


def test_the_example_of_beckhoff():
    """-102 x 0.1 um is the error, actual minus setpoint, going forward; 80 x 0.1 um going back."""
    q = along("Y", [-20.0, -19.9306, -19.8667])
    assert taken("isg", {"a.lis": SSFK}, "error", "Y", q, 1) == pytest.approx([0, 2.4, -10.2], abs=1e-9)
    assert taken("isg", {"a.lis": SSFK}, "error", "Y", q, -1) == pytest.approx([0, 6.7, 8.0], abs=1e-9)


def test_a_plane_of_beckhoff():
    """table[j][i]: j of the second master."""
    lines = ["kopf.log_achs_name Z", "kw.crosscomp2.unit 1", "kw.crosscomp2.interval 100000"]
    lines += ["kw.crosscomp2.master1_ax_nr 1", "kw.crosscomp2.master2_ax_nr 2"]
    lines += ["kw.crosscomp2.start_position_master1 0", "kw.crosscomp2.start_position_master2 -100000"]
    lines += ["kw.crosscomp2.last_index_master1 2", "kw.crosscomp2.last_index_master2 1"]
    lines += [f"kw.crosscomp2.table[{j}][ {i} ].correction {10 * j + i}" for j in range(2) for i in range(3)]
    q = np.array([[0, -10, 0, 0], [10, -10, 0, 0], [20, 0, 0, 0], [5, -5, 0, 0], [99, 99, 0, 0]], float)
    found = taken("isg-cross", {"a.lis": "\n".join(lines)}, "error", "Z", q)
    assert found == pytest.approx([0.0, 0.1, 1.2, 0.55, 1.2], abs=1e-9)


# Beckhoff TF5280: sample of an ISG_CSV file, its first block; of the Etalon exchange format.
ISG_CSV = """// sample
X      EXX    EYX    EZX    EAX    EBX    ECX
0.0    0.02   0.01   0.07   0.00   0.0042 0.003
10.0   0.00   -0.1   0.01   0.00   0.0011 0.002
"""
ETALON = """// comments with double slash, INI-like
[C0B]
VALUE = 0.000022355737
[EXY]
Gridpoints = {
          -280.0 -0.001358635132
          -270.0 -0.000240680764
}  // end of EXY
"""


def test_the_samples_of_volumetric_files():
    effects = FORMATS["isg-volumetric"].read_files(MACHINE, {"v.csv": ISG_CSV}, "error").effects
    errors = model_of(MACHINE, *effects).errors(MACHINE, State(np.array([[0.0, 0, 0, 0], [5.0, 0, 0, 0]])))
    assert errors[:, 0] == pytest.approx(
        np.array([[0.02, 0.01, 0.07, 0.0, 0.0042, 0.003], [0.01, -0.045, 0.04, 0, 0.00265, 0.0025]]), abs=1e-12
    )
    turned = FORMATS["isg-volumetric"].read_files(MACHINE, {"v.csv": ISG_CSV}, "error", ["angle=deg"]).effects
    assert turned[4].parameters[0] == pytest.approx(np.radians(0.0042) * 1e6)
    five = load("dmu50")
    location, motion = FORMATS["etalon"].read_files(five, {"e.txt": ETALON}, "error").effects
    assert (location.name, location.value) == ("E_C0B", pytest.approx(22.355737))
    assert motion.name == "E_XY"
    assert motion.basis.nodes == (-280.0, -270.0)
    assert motion.parameters == pytest.approx((-1.358635132, -0.240680764))


def test_klipper_s_own_transform():
    """calc_skew of klippy/extras/skew_correction.py (84104bb), written out; the mesh is added to z."""
    text = "[skew_correction]\n[skew_correction p]\nxy_skew = 0.001\nxz_skew = -0.002\nyz_skew = 0.0005\n"
    text += "#*# [bed_mesh p]\n#*# version = 1\n#*# points =\n#*#   0.1, 0.2\n#*#   0.3, 0.4\n#*# min_x = 0\n#*# max_x = 100\n"
    text += "#*# min_y = 0\n#*# max_y = 200\n#*# x_count = 2\n#*# y_count = 2\n#*# mesh_x_pps = 0\n#*# mesh_y_pps = 0\n"
    rng = np.random.default_rng(3)
    q = np.column_stack([rng.uniform(-300, 300, (50, 3)), np.zeros(50)])
    _, y, z, _ = q.T
    xy, xz, yz = 0.001, -0.002, 0.0005
    moved = {"X": -y * xy - z * (xz - xy * yz), "Y": -z * yz}
    for axis, shift in moved.items():
        assert -taken("klipper", {"a.cfg": text}, "correction", axis, q) * 1e-3 == pytest.approx(shift, abs=1e-12)
    at = np.array([[0, 0, 0, 0], [100, 0, 0, 0], [0, 200, 0, 0], [50, 100, 7, 0], [-50, 900, 0, 0]], float)
    heights = -taken("klipper", {"a.cfg": text}, "correction", "Z", at) * 1e-3
    assert heights == pytest.approx([0.1, 0.2, 0.3, 0.25, 0.3], abs=1e-12)


def test_a_height_map_of_reprap():
    """Grid.cpp of RepRapFirmware (fc1cd16): labels, values, rows of x; M556 adds tangents."""
    text = "RepRapFirmware height map file v2 generated at 2026-01-01 10:00, min error -0.1\n"
    text += "axis0,axis1,min0,max0,min1,max1,radius,spacing0,spacing1,num0,num1\n"
    text += "X,Y,0.00,100.00,0.00,50.00,-1.00,50.00,50.00,3,2\n  0.100,  0.200,  0.000\n -0.100,  0.000,  0.400\n"
    files = {"heightmap.csv": text, "config.g": "G28 ; home\nM556 S100 X0.2 Y-0.1 Z0.05 ; skew\n"}
    at = np.array([[0, 0, 0, 0], [50, 0, 0, 0], [100, 50, 0, 0], [25, 25, 0, 0], [400, 400, 0, 0]], float)
    assert -taken("reprap", files, "correction", "Z", at) * 1e-3 == pytest.approx([0.1, 0.2, 0.4, 0.05, 0.4], abs=1e-12)
    q = np.array([[5.0, 100.0, 50.0, 0.0]])
    assert -taken("reprap", files, "correction", "X", q) * 1e-3 == pytest.approx([0.2 + 0.025], abs=1e-12)
    assert -taken("reprap", files, "correction", "Y", q) * 1e-3 == pytest.approx([-0.05], abs=1e-12)


def test_mitsubishi_s_formula():
    """(interval - actual travel) x 2 in half output units of 1 um: travels 100.003 and 99.996 mm give -6 and 8."""
    files = {
        "parameters.csv": "axis,reference point,interval,scale\nX,0,100.0,1\n",
        "error_data.csv": "axis,point,position,value\nX,0,0,0\nX,1,100,-6\nX,2,200,8\n",
    }
    found = taken("mitsubishi", files, "correction", "X", along("X", [0, 100, 200, 400]))
    assert found == pytest.approx([0, 3, -1, -1], abs=1e-9)


REFUSED = {
    "fanuc: a point missing": ("fanuc", {"p.txt": FANUC_TEXT.replace("N10035P1\n", "")}, "the value of point 35 (N10035) is missing"),
    "fanuc: a point twice": ("fanuc", {"p.txt": FANUC_TEXT + "N10035P1\n"}, "p.txt:25: 'N10035P1': a second value"),
    "fanuc: half an increment": ("fanuc", {"p.txt": FANUC_TEXT.replace("N10035P1", "N10035P1.5")}, "whole number"),
    "fanuc: a program": ("fanuc", {"p.txt": "G10 L50\nN10035 R1\nG11\n"}, "p.txt:1: 'G10 L50': expected N...P..."),
    "fanuc: no interval": ("fanuc", {"p.txt": FANUC_TEXT.replace("N03624", "N03699")}, "N03624 missing"),
    "fanuc: reference outside": ("fanuc", {"p.txt": FANUC_TEXT.replace("P40", "P99")}, "the reference point 99 is outside"),
    "heidenhain: no end": ("heidenhain", {"A.COM": NEW[:-6], "c.cma": cma(X="A.COM")}, "the last line must be [END]"),
    "heidenhain: a gap": (
        "heidenhain",
        {"A.COM": NEW.replace("-0.0040", ""), "c.cma": cma(X="A.COM")},
        "column X has values in 1 of 2 rows",
    ),
    "heidenhain: no assignment": ("heidenhain", {"A.COM": NEW}, "expected one file *.cma with the assignment of the tables to axes, found none among A.COM"),
    "heidenhain: a file that is not there": ("heidenhain", {"c.cma": cma(X="A.COM")}, "not among the files"),
    "heidenhain: unevenly spaced": (
        "heidenhain",
        {"A.COM": OLD.replace("+50.0000    -", "+60.0000    -"), "c.cma": cma(X="A.COM")},
        "the position differs from DATUM plus a multiple of DISTANCE",
    ),
    "heidenhain: two active lines": (
        "heidenhain",
        {"A.COM": NEW, "c.cma": cma(X="A.COM").replace("[END]", "1    *       A.COM\n[END]")},
        "2 active lines",
    ),
    "isg: increments": ("isg", {"a.lis": SSFK.replace("unit                         1", "unit 0")}, "unit must be 1"),
    "isg: more than said": ("isg", {"a.lis": SSFK.replace("nr_max                    3", "nr_max 2")}, "beyond"),
    "isg: no value": ("isg", {"a.lis": SSFK.replace("kw.ssfk.table[1].neg", "kw.x")}, "kw.ssfk.table[1].neg is missing"),
    "isg: twice": ("isg", {"a.lis": SSFK + "kw.ssfk.unit 1\n"}, "the entry has a value already"),
    "isg: no axis": ("isg", {"a.lis": "kw.ssfk.kw_nr_max 0\n"}, "kopf.log_achs_name is missing"),
    "isg-volumetric: two arguments": ("isg-volumetric", {"v.csv": "Z X EXX\n0 0 1\n"}, "X over Z is not read"),
    "isg-volumetric: a column short": ("isg-volumetric", {"v.csv": "X EXX\n0 0\n1\n"}, "expected 2 columns"),
    "etalon: no end": ("etalon", {"e.txt": "[EXX]\nGridpoints = {\n0 0\n"}, "after the last grid points is missing"),
    "etalon: no block": ("etalon", {"e.txt": "VALUE = 3\n"}, "e.txt:1"),
    "etalon: another axis": ("etalon", {"e.txt": ETALON}, "has no such axis"),
    "klipper: two profiles": ("klipper", {"k.cfg": "[skew_correction a]\n[skew_correction b]\n"}, "2 profiles"),
    "klipper: no ends": ("klipper", {"k.cfg": "[bed_mesh a]\nmesh_x_pps = 2\nmesh_y_pps = 2\n"}, "min_x is missing"),
    "reprap: not probed": (
        "reprap",
        {"h.csv": "RepRapFirmware height map file v2\naxis0,axis1,min0,max0,min1,max1,radius,spacing0,spacing1,num0,num1\n"
         "X,Y,0,1,0,1,-1,1,1,2,2\n 0.1, 0\n 0.1, 0.2\n"},
        "the position was not probed",
    ),
    "mitsubishi: out of range": (
        "mitsubishi",
        {"parameters.csv": "h\nX,0,100.0,1\n", "error_data.csv": "h\nX,0,0,0\nX,1,100,128\n"},
        "expected a value in -128 ... 127",
    ),
    "csv: another unit": ("csv", {"e.csv": "error,axis,position,forward,backward,unit\nE_XX,X,0,1,1,mm\n"}, "E_XX in mm"),
    "heidenhain: inches": ("heidenhain", {"A.COM": NEW.replace("MM", "INCH"), "c.cma": cma(X="A.COM")}, "tables in inches are not read"),
    "linuxcnc: no number of a joint": ("linuxcnc", {"a.ini": "[JOINT_X]\nCOMP_FILE = a.txt\n"}, "[JOINT_X] is not one of the joints"),
    "linuxcnc: another type": (
        "linuxcnc", {"a.ini": "[JOINT_0]\nCOMP_FILE = a.txt\nCOMP_FILE_TYPE = 2\n", "a.txt": "0 0 0\n"}, "COMP_FILE_TYPE 2: expected 0 or 1"
    ),
    "siemens-cec: no number of a table": ("siemens-cec", {"c.ini": "$AN_CEC[x,0]=1\n"}, "c.ini:1: '$AN_CEC[x,0]=1': an index must be"),
    "siemens-eec: half a point": ("siemens-eec", {"e.ini": "$AA_ENC_COMP[0,1.5,X1]=1\n"}, "an index must be a whole number"),
    "siemens-eec: more points than memory": (
        "siemens-eec",
        {"e.ini": "$AA_ENC_COMP[0,0,X1]=1\n$AA_ENC_COMP_STEP[0,X1]=1\n$AA_ENC_COMP_MIN[0,X1]=0\n$AA_ENC_COMP_MAX[0,X1]=1e15\n"},
        "found 1",
    ),
    "fanuc: more points than memory": ("fanuc", {"p.txt": FANUC_TEXT.replace("A1P49", "A1P99999999999")}, "the value of point 50 (N10050) is missing"),
    "isg: no points": ("isg", {"a.lis": SSFK.partition("kw.ssfk.table")[0].replace("nr_max                    3", "nr_max 0")}, "the table of Y has no points"),
    "isg: no start": ("isg", {"a.lis": SSFK.replace("interval                     0", "interval 10").replace("kw_startpos", "x")}, "kw.ssfk.kw_startpos is missing"),
    "isg-cross: more points than memory": (
        "isg-cross",
        {"a.lis": "kopf.log_achs_name Z\nkw.crosscomp2.unit 1\nkw.crosscomp2.interval 1\nkw.crosscomp2.master1_ax_nr 1\n"
         "kw.crosscomp2.start_position_master1 0\nkw.crosscomp2.last_index_master1 999999999999\n"},
        "exceeds the most, 10200",
    ),
    "klipper: more points than memory": (
        "klipper",
        {"k.cfg": "[bed_mesh a]\nmesh_x_pps = 0\nmesh_y_pps = 0\npoints =\n  0, 1\n  0, 1\nmin_x = 0\nmax_x = 9\nx_count = 999999999999\n"},
        "x_count 999999999999",
    ),
    "reprap: another axis": (
        "reprap",
        {"h.csv": "RepRapFirmware height map file v2\naxis0,axis1,min0,max0,min1,max1,radius,spacing0,spacing1,num0,num1\n"
         "X,Q,0,1,0,1,-1,1,1,2,2\n 0.1, 0.3\n 0.1, 0.2\n"},
        "Q",
    ),
    "reprap: a label missing": (
        "reprap",
        {"h.csv": "RepRapFirmware height map file v2\naxis0,axis1,min0,spacing0,num0,num1\nX,Y,0,1,2,2\n 0.1, 0.3\n"},
        "expected a value for each label",
    ),
    "isg-volumetric: one row": ("isg-volumetric", {"v.csv": "X EXX\n0 1\n"}, "v.csv: E_XX: nodes must be at least two"),
    "nothing": ("siemens-eec", {"e.ini": "M17\n"}, "no table of format siemens-eec"),
}  # fmt: skip


@pytest.mark.parametrize(("format", "files", "said"), REFUSED.values(), ids=REFUSED)
def test_what_is_not_understood_is_refused(format, files, said):
    with pytest.raises(UserError, match=re.escape(said)):
        FORMATS[format].read_files(MACHINE, files, "error")


WRITERS = {
    "fanuc increments": ("fanuc", ("interval=400", "unit_um=0.1"), "XX", "do not reach"),
    "fanuc points": ("fanuc", ("total=5", "largest=60"), "XX YY ZZ", "and the control has 5"),
    "heidenhain old with backlash": ("heidenhain", ("layout=old", "backlash=true"), "XX", "no column BACKLASH"),
    "heidenhain old, too many rows": ("heidenhain", ("layout=old", "distance=0.5"), "XX", "do not reach"),
    "mitsubishi steps": ("mitsubishi", ("unit_um=0.01", "interval=300"), "XX", "do not reach"),
    "straightness without interval": ("fanuc", ("straightness=true",), "YX", "give --set interval="),
}


@pytest.mark.parametrize(("format", "chosen", "errors", "said"), WRITERS.values(), ids=WRITERS)
def test_what_a_control_cannot_hold_is_not_written(format, chosen, errors, said):
    machine, form = load("cframe"), FORMATS[format]
    with pytest.raises(UserError, match=said):
        export(
            machine, model_of(machine, *motions(machine, errors)), form, parse_settings(form.settings, chosen),
            form.sign or "error", (0, 0, 0),
        )  # fmt: skip
