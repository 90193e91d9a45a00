"""`--tcp`: programs of the tool point as positions of the axes, and back; positions and feeds are worked by hand."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from support.programs import model_of

import machines
from kinematics.basis import Fourier
from kinematics.effects import ErrorMotion
from kinematics.error_model.model import write_model

TABLE = (
    'name = "mill"\nchain = "w C b X Y Z t"\naxes.X = { travel = [-500, 500] }\naxes.Y = { travel = [-500, 500] }\n'
    'axes.Z = { travel = [-500, 500] }\naxes.C = { travel = [-inf, inf], point = [0, 0, 0], rollover = "as-written" }\n'
)
"""A table that turns about Z through the machine zero: X Y of the axes are those of the part, turned back by C."""
HEAD = (
    'name = "mill"\nchain = "w b X Y Z B t"\naxes.X = { travel = [-500, 500] }\naxes.Y = { travel = [-500, 500] }\n'
    "axes.Z = { travel = [-500, 500] }\naxes.B = { travel = [-100, 100], point = [0, 0, 250] }\n"
)
"""A head with its pivot 250 mm above the spindle nose: 350 mm above the tip of a tool of 100 mm."""
OPTIONS = ("--machine", "mill.toml", "--calibration", "none", "--tool-length", "T1=100")
ISO = "G21 G17 G90 G94 G54\nT1 M6\nG0 {start}\nG43.4 H1 {first}\n{moves}\nG49\nM30\n"
COARSE = ("--tolerance-um", "1e6")


def convert(ncomp, text, *options, machine=TABLE, file="tip.nc", offset="G54=0,0,0", to="to-axes"):
    """The converted program; the file `out` has its name with `out` in front."""
    Path("mill.toml").write_text(machine)
    Path(file).write_text(text)
    own = [*OPTIONS, "--work-offset", offset]
    done = ncomp(file, *own, "--tcp", to, *options, "-o", f"out_{file}")
    if done.status == 0:
        checked = ncomp("verify", file, f"out_{file}", *own, "--json", "v.json")
        assert checked.status == 0, checked.err
    return done, Path(f"out_{file}").read_text() if done.status == 0 else ""


def largest():
    """Largest deviations of the converted program, um: at the ends of moves, and along feed moves."""
    told = json.loads(Path("v.json").read_text())
    return told["block_ends_um"]["after"]["max"], told["along_feed_moves_um"]["after"]["max"]


def moved(text):
    """The lines that move, without comments."""
    lines = (re.sub(r" *\(.*?\)| *;.*", "", line) for line in text.splitlines())
    return [line for line in lines if re.match(r"(\d+ L|G93|G0|G1|[XYZBC])", line) and re.search("[XYZBC]", line)]


def table(moves, start="X0 Y0 Z100 C0", first="X10. Y0 Z100. C0"):
    return ISO.format(start=start, first=first, moves=moves)


# ---- positions and feeds


def test_a_table_turns_the_part_back(ncomp):
    done, text = convert(ncomp, table("G1 Z5. F1000.\nX10. Y0. C9. F360.\nG0 C90."), *COARSE)
    assert done.status == 0, done.err
    # 9 degrees: 10 cos 9 = 9.8769, -10 sin 9 = -1.5643; the tool point stands, 9 deg at 360 deg/min: 1/40 min
    assert "G43 H1 X10.0000 Y0 Z100. C0" in text.replace("X10. ", "X10.0000 ")
    assert "G93 G1 Z5. F10.5263" in text  # 95 mm at 1000 mm/min
    assert "X9.8769 Y-1.5643 C9. F40" in text
    assert moved(text)[-1].startswith("G0 X0.0000 Y-10.0000 C90.") or "X0.0000 Y-10.0000 C90.0000" in text
    assert largest()[0] < 0.2


def test_a_head_moves_about_its_pivot(ncomp):
    text = table("G1 Z0. F1000.\nG1 X0. Y0. Z0. B90. F900.", start="X0 Y0 Z100 B0", first="X0. Y0. Z100. B0")
    done, written = convert(ncomp, text, *COARSE, machine=HEAD)
    assert done.status == 0, done.err
    # the tool lies along X: the pivot is 350 mm beside the tip, and 250 + 100 mm below its place with the tool upright
    assert re.search(r"^G1 X350\.0000 Z-350\.0000 B90\.0000 F", written, re.MULTILINE)
    assert "hold for these tool lengths only: T1 100 mm" in done.err
    assert largest()[0] < 0.2


def test_the_path_stays_within_the_tolerance(ncomp):
    for tolerance, few in ((1000.0, 1), (10.0, 4)):
        done, text = convert(ncomp, table("G1 Z5. F1000.\nX90. C30."), "--tolerance-um", tolerance)
        assert done.status == 0, done.err
        assert text.count("NCOMP FROM") >= few
        assert largest()[1] < tolerance


def test_with_a_calibration_the_tool_point_is_right(ncomp):
    text = "G21 G17 G90 G94 G54\nT1 M6\nG0 X0 Y0 Z100. B0 C0\nG43.4 H1 X10. Y20. Z100. B0 C0\nG1 X30. B20. C40. F900.\nM30\n"
    Path("tip.nc").write_text(text)
    own = ("--machine", "dmu50", "--work-offset", "G54=0,0,0", "--tool-length", "T1=100")
    done = ncomp("tip.nc", *own, "--tcp", "to-axes", "--tolerance-um", "4", "-o", "out.nc")
    assert done.status == 0, done.err
    checked = json.loads(ncomp("verify", "tip.nc", "out.nc", *own, "--json", "-").out)
    assert checked["along_feed_moves_um"]["before"]["max"] > 10.0
    assert checked["along_feed_moves_um"]["after"]["max"] < 4.0
    assert checked["block_ends_um"]["after"]["max"] < 0.2


def test_segments_of_the_conversion_are_cut_again_where_the_error_changes_along_them(ncomp):
    """X errs by 60 um in waves of 40 mm: the 200 mm of the move cross five of them."""
    waves = ErrorMotion("X", "X", Fourier((-250.0, 250.0), (40.0,)), (0.0, 0.0, 60.0, 0.0), u=(0.1,) * 4)
    write_model(model_of(machines.load("dmu50"), waves), Path("waves.json"))
    moves = "G1 X-100. Y20. Z95. F2000.\nX100. B.2 C1. F1000."
    Path("tip.nc").write_text(table(moves, start="X-100. Y20. Z100. B0 C0", first="X-100. Y20. Z100. B0 C0"))
    own = ("--machine", "dmu50", "--calibration", "waves.json", "--work-offset", "G54=0,0,0", "--tool-length", "T1=100")
    done = ncomp("tip.nc", *own, "--tcp", "to-axes", "--tolerance-um", "8", "-o", "out.nc")
    assert done.status == 0, done.err
    checked = json.loads(ncomp("verify", "tip.nc", "out.nc", *own, "--json", "-").out)
    assert checked["along_feed_moves_um"]["before"]["max"] > 50.0
    assert checked["along_feed_moves_um"]["after"]["max"] < 8.0
    begins = [int(a) / int(b) for a, b in re.findall(r"FROM (\d+)/(\d+)", Path("out.nc").read_text())]
    assert begins == sorted(set(begins))
    assert max(map(len, Path("out.nc").read_text().splitlines()[1:])) < 90


@pytest.mark.parametrize("how", ["inverse-time", "scaled", "programmed"])
def test_the_tool_point_keeps_its_speed_from_end_to_end(ncomp, how):
    """20 mm past the centre of the table at 1000 mm/min: 0.02 min, the same share of it in each segment."""
    machine = f'{TABLE}\n[control]\nfamily = "fanuc"\n'
    text = table("G1 Z5. F2000.\nX10. Y1.\nX-10. C90. F1000.")
    if how == "programmed":
        text = text.replace("X-10. C90. F1000.", "G93 X-10. C90. F50.")
    own = () if how == "programmed" else ("--tcp-feed", how)
    done, written = convert(ncomp, text, "--tolerance-um", "50", *own, machine=machine)
    assert done.status == 0, done.err
    at, minutes = [10.0, 1.0, 0.0], []
    for line in [line for line in moved(written) if "C" in line][1:]:
        to = [float(re.search(rf"{axis}(\S+)", line)[1]) for axis in "XYC"]
        number = float(re.search(r"F(\S+)", line)[1])
        way = sum((b - a) ** 2 for a, b in zip(at, to, strict=True)) ** 0.5
        minutes.append(way / number if how == "scaled" else 1.0 / number)
        at = to
    assert len(minutes) > 5
    assert minutes == pytest.approx([0.02 / len(minutes)] * len(minutes), rel=1e-4)


@pytest.mark.parametrize("family", ["linuxcnc", "fanuc"])
def test_scaled_feeds(ncomp, family):
    """X 10 to 30 in 0.1 min, C by 10 degrees: F counts X Y Z on LinuxCNC, the degrees too on FANUC."""
    machine = f'{TABLE}\n[control]\nfamily = "{family}"\n'
    if family == "linuxcnc":  # TCP is that of the kinematics there
        machine += "tcp_at_start = true\n"
    text = table("G1 Z5. F1000.\nX30. C10. F200.\nX40.")
    if family == "linuxcnc":
        text = text.replace("G43.4 H1 ", "").replace("T1 M6\n", "T1 M6\nG43 H1\n")
    done, written = convert(ncomp, text, *COARSE, "--tcp-feed", "scaled", machine=machine)
    assert done.status == 0, done.err
    assert "G93" not in written
    number = float(re.search(r"C10\..*? F([\d.]+)", written)[1])
    straight = ((30 * 0.984807753 - 10) ** 2 + (30 * 0.173648178) ** 2) ** 0.5
    wanted = straight if family == "linuxcnc" else (straight**2 + 100.0) ** 0.5
    assert number == pytest.approx(wanted / 0.1, rel=1e-4)
    assert re.search(r"^X39\.3923 Y-6\.9459.* F200\.?$", written, re.MULTILINE)  # F of the program again


def test_a_block_that_moves_nothing_has_a_feed_too(ncomp):
    done, written = convert(ncomp, table("G1 X20. F1000.\nX20.\nC5."), *COARSE)
    assert done.status == 0, done.err
    (number,) = re.findall(r"^X20\.\S* F(\d+)", written, re.MULTILINE)
    assert 0.0 < float(number) < 1e6


def test_the_feed_is_restored_before_a_cycle_and_a_dwell_is_no_feed(ncomp):
    text = table("G1 Z5. F1000.\nX30. C10. F200.\nG0 C0.\nG4 P2.\nG1 X40. C5.").replace(
        "G49\n", "G49\nG43 H1 Z50.\nG81 X1. Y1. Z5. R10. F70.\nG80\n"
    )
    done, written = convert(ncomp, text, *COARSE)
    assert done.status == 0, done.err
    lines = written.splitlines()
    assert lines[lines.index("G49") - 1] == "G94 F200 (NCOMP FEED)"
    assert lines[lines.index("G4 P2.") - 1] == "G94 F200 (NCOMP FEED)"
    assert re.search(r"^G93 G1 X39\.8478 Y-3\.4862 C5\. F\d+", written, re.MULTILINE)
    siemens = SIEMENS.replace("X10 Y0 C9 F360", "X20 Y0 F100\nG4 F2\nG1 X30 C9")
    done, written = convert(ncomp, siemens, *COARSE, file="tip.mpf")
    assert done.status == 0, done.err
    assert re.search(r"X29\.6307 Y-4\.6930 C9 F10\.?0*", written)  # 10 mm at 100 mm/min, whatever the dwell


# ---- dialects

SIEMENS = (
    "G17 G90 G71 G94 G54\nT1 D1 M6\nG0 X0 Y0 Z100 C0\nTRAORI\nG0 X10 Y0 Z100 C0\nG1 Z5 F1000\nX10 Y0 C9 F360\nTRAFOOF\n"
    "SUPA G0 Z300 D0\nM30\n"
)
KLARTEXT = (
    "0 BEGIN PGM K MM\n1 TOOL CALL 1 Z S1000\n2 L X+0 Y+0 Z+100 C+0 R0 FMAX\n{on}4 L X+10 Y+0 Z+100 C+0 FMAX\n"
    "5 L Z+5 F1000 M8\n6 L X+10 Y+0 C+9 F360\n{off}8 L Z+300 FMAX M91\n9 M30\n10 END PGM K MM\n"
)


def test_siemens(ncomp):
    done, text = convert(ncomp, SIEMENS, *COARSE, file="tip.mpf")
    assert done.status == 0, done.err
    assert "TRAORI" not in text
    assert "\nX9.8769 Y-1.5643 C9 F40" in text
    assert "\nG94 F360 ; NCOMP FEED\nM30\n" in text or "\nG94 F360 ; NCOMP FEED\n" in text


@pytest.mark.parametrize(("on", "off"), [
    ("3 M128 F5000\n", "7 M129\n"), ("3 FUNCTION TCPM F TCP AXIS POS PATHCTRL AXIS\n", "7 FUNCTION RESET TCPM\n"),
])  # fmt: skip
def test_klartext(ncomp, on, off):
    done, text = convert(ncomp, KLARTEXT.format(on=on, off=off), *COARSE, file="tip.h", offset="0=0,0,0")
    assert done.status == 0, done.err
    assert not re.search(r"^\d+ (M128|M129|FUNCTION)", text, re.MULTILINE)
    # the path of X Y is 2 * 10 sin 4.5 = 1.5692 mm long, and takes 1/40 min
    assert re.search(r"L X\+9\.8769 Y-1\.5643 C\+9 F62\.76\d*\n", text)
    assert largest()[0] < 0.2


def test_tool_vectors_become_positions(ncomp):
    text = SIEMENS.replace("X10 Y0 C9 F360", "X10 Y0 Z6 A3=0 B3=0.6 C3=0.8").replace("C0", "B0 C0")
    Path("v.mpf").write_text(text)
    own = ("--machine", "dmu50", "--calibration", "none", "--work-offset", "G54=0,0,0", "--tool-length", "T1=100")
    done = ncomp("v.mpf", *own, "--tcp", "to-axes", "--tolerance-um", "1e6", "-o", "out.mpf")
    assert done.status == 0, done.err
    written = Path("out.mpf").read_text()
    assert "A3" not in written
    assert re.search(r"X\S+ Y\S+ Z\S+ B\d+\.\d+ C\S+ F", written)
    checked = json.loads(ncomp("verify", "v.mpf", "out.mpf", *own, "--json", "-").out)
    assert checked["block_ends_um"]["after"]["max"] < 3.0  # with the rounding of the tool's direction


# ---- the other way

AXES = {
    "iso": ("ax.nc", "G21 G17 G90 G94 G54\nT1 M6\nG0 X0 Y0 Z200. C0\nG43 H1 X10. Y0 Z100. C0\nG93 G1 X0. Y-10. C90. F4.\nG49\nM30\n"),
    "siemens": ("ax.mpf", "G17 G90 G71 G94 G54\nT1 D1 M6\nG0 X10 Y0 Z100 C0\nG93 G1 X0 Y-10 C90 F4\nSUPA G0 Z300 D0\nM30\n"),
    "klartext": ("ax.h", "0 BEGIN PGM K MM\n1 TOOL CALL 1 Z S1000\n2 L X+10 Y+0 Z+100 C+0 R0 FMAX\n"
                         "3 L X+0 Y-10 C+90 F360\n4 L Z+300 R0 FMAX M91\n5 M30\n6 END PGM K MM\n"),
}  # fmt: skip
SWITCHES = {"iso": ("G43.4 H1", "G49"), "siemens": ("TRAORI\n", "TRAFOOF\nSUPA"), "klartext": ("M128\n", "M129\n")}


@pytest.mark.parametrize("dialect", AXES)
def test_positions_of_the_axes_as_the_tool_point(ncomp, dialect):
    file, text = AXES[dialect]
    offset = "0=0,0,0" if dialect == "klartext" else "G54=0,0,0"
    done, written = convert(ncomp, text, "--tolerance-um", "500", file=file, offset=offset, to="to-tcp")
    assert done.status == 0, done.err
    on, off = (written.index(word) for word in SWITCHES[dialect])
    assert on < written.index("NCOMP FROM") < off
    # the chord of the axes passes the centre at 10 cos 45: the part sees a loop that ends where it began
    last = [line for line in written[:off].splitlines() if re.search(r"C\+?90", line)][-1]
    assert re.search(r"X\+?10\.0000 Y[+-]?0\.0000", last)
    assert largest()[1] < 500.0


def test_there_and_back_with_a_real_program(ncomp, nc_data):
    lines = (nc_data / "iso" / "five_axis_ac" / "impeller-7bl-xyzac.ngc").read_text().splitlines()[:400]
    machine = (Path(__file__).parents[1] / "machines" / "trunnion_ac.toml").read_text()
    machine = machine.replace("[axes.C]", '[axes.C]\nrollover = "as-written"')
    machine = machine.replace('"trunnion_ac"', '"mill"') + '\n[control]\ntcp_at_start = true\nfamily = "linuxcnc"\n'
    Path("mill.toml").write_text(machine)
    Path("tip.ngc").write_text("\n".join([*lines, "M30", ""]))
    own = ("--machine", "mill.toml", "--calibration", "none", "--set-up-zero")
    out = ("--no-travel-check", "--tolerance-um", "10")
    there = ncomp("tip.ngc", *own, *out, "--tcp", "to-axes", "-o", "axes.ngc")
    assert there.status == 0, there.err
    back = ncomp("axes.ngc", *own, *out, "--tcp", "to-tcp", "--force", "-o", "back.ngc")
    assert back.status == 0, back.err
    for file, most in (("axes.ngc", 5.0), ("back.ngc", 0.5)):
        told = json.loads(ncomp("verify", "tip.ngc", file, *own, "--json", "-").out)
        assert told["moves"] > 350
        assert told["along_feed_moves_um"]["after"]["max"] < most


# ---- notes and refusals


def test_a_singular_position_is_named(ncomp):
    text = (
        "G21 G17 G90 G94 G54\nT1 M6\nG0 X0 Y0 Z100. B0 C0\nG43.4 H1 X10. Y20. Z100. B0.1 C0\nG1 C170. B0.1 F900.\nM30\n"
    )
    Path("tip.nc").write_text(text)
    done = ncomp("tip.nc", "--machine", "dmu50", "--calibration", "none", "--work-offset", "G54=0,0,0",
                 "--tool-length", "T1=100", "--tcp", "to-axes", *COARSE, "-o", "out.nc")  # fmt: skip
    assert done.status == 0, done.err
    assert re.search(
        r"near a singular position: C turns 170\.0 degrees while the tool tilts 0\.\d+ \(line 5\)", done.err
    )


def test_an_arc_on_a_turned_table_becomes_straight_lines(ncomp):
    """The full circle about the centre of the table, at C30 of the part: the axes go round it from -30 degrees on."""
    moves = "G1 Z5. C30. F1000.\nG3 X10. Y0. I-10. J0.\nX0. Y10. R10.\nG1 Z9."
    done, written = convert(ncomp, table(moves), *("--tolerance-um", "100"))
    assert done.status == 0, done.err
    assert set(re.findall(r"G\d+", written.split("G43 H1")[1])) == {"G1", "G93", "G94", "G49"}
    assert not re.search(r"[IJR]-?\d", written)
    ends = [(float(x), float(y)) for x, y in re.findall(r"X(-?[\d.]+) Y(-?[\d.]+)", written.split("G93 G1", 1)[1])]
    assert all(math.hypot(*end) == pytest.approx(10.0, abs=2e-4) for end in ends)
    assert (8.6603, -5.0) in ends  # 10 at -30 degrees
    assert ends[-1] == (5.0, 8.6603)  # 10 at 60 degrees: the part's +Y
    # a chord of the angle a is 10 (1 - cos(a / 2)) from the circle: 0.05 mm allow 11.4 degrees
    turned = np.rad2deg(np.unwrap([math.atan2(y, x) for x, y in ends]))
    assert np.diff(turned).max() < 11.5
    assert np.ptp(turned) == pytest.approx(450.0, abs=0.01)
    assert largest()[0] < 0.2
    assert 10.0 < largest()[1] < 100.0


def test_a_helix_along_which_the_table_turns(ncomp):
    """Half a turn of the part to the left, and 90 degrees of C back: 90 degrees of the axes, and Z falls evenly."""
    done, written = convert(
        ncomp, table("G1 Z5. F1000.\nG3 X-10. Y0. Z1. I-10. J0. C90. F400."), "--tolerance-um", "10"
    )
    assert done.status == 0, done.err
    found = re.findall(r"X(-?[\d.]+) Y(-?[\d.]+) Z(-?[\d.]+) C(-?[\d.]+)", written)
    for x, y, z, c in [tuple(map(float, each)) for each in found if float(each[3])]:
        share = c / 90.0
        angle = math.radians(180.0 * share - c)
        assert (x, y, z) == pytest.approx((10 * math.cos(angle), 10 * math.sin(angle), 5.0 - 4.0 * share), abs=2e-4)
    assert tuple(map(float, found[-1])) == pytest.approx((0.0, 10.0, 1.0, 90.0), abs=2e-4)
    assert largest()[1] < 10.0


def test_an_arc_that_stays_one_gets_its_code_again_behind_straight_lines(ncomp):
    moves = "G1 Z5. C30. F1000.\nG3 X0. Y10. I-10. J0.\nX-10. Y0. C0. J-10.\nX10. Y0. I10. J0."
    done, written = convert(ncomp, table(moves), "--tolerance-um", "50")
    assert done.status == 0, done.err
    assert len(re.findall(r"G3 X10", written)) == 1  # C0: the coordinates differ by the tool length alone
    siemens = SIEMENS.replace("X10 Y0 C9 F360", "C30 F360\nG3 X-10 Y0 CR=10\nG3 X10 Y0 I=AC(0) J=AC(0) TURN=1")
    done, written = convert(ncomp, siemens, "--tolerance-um", "50", file="tip.mpf")
    assert done.status == 0, done.err
    assert not re.search(r"G3|CR=|AC\(|TURN", written)


def test_arcs_of_klartext_on_a_turned_table_become_straight_lines(ncomp):
    """C, CR, CT and CP at C30 of the part, all on the circle of 10 mm about the centre of the table.

    The axes go round it from -30 degrees on: 180 degrees by C, 90 by CR, 90 by CT, 720 by CP with 2 mm down, and 90.
    """
    arcs = (
        "6 CC X+0 Y+0\n6 C X-10 Y+0 DR+\n6 CR X+0 Y-10 R+10 DR+ R0 M8\n6 CT X+10 Y+0\n6 CP IPA+720 IZ-2 DR+\n"
        "6 CP PA+90 DR+\n6 L"
    )
    text = KLARTEXT.format(on="3 M128\n", off="7 M129\n").replace("6 L", arcs).replace("Z+5 F1000", "Z+5 C+30 F1000")
    done, written = convert(ncomp, text, "--tolerance-um", "100", file="tip.h", offset="0=0,0,0")
    assert done.status == 0, done.err
    lines = written.split("CC X+0 Y+0\n")[1].splitlines()
    assert not [line for line in lines if re.search(r"\d (C|CR|CT|CP) |DR|R\+10|PA", line)]
    assert [line for line in lines if line.endswith(" R0 M8")]
    at, z, found = (8.6603, -5.0), 5.0, []
    for line in lines:
        for axis, value in re.findall(r" (I?[XYZ])([+-][\d.]+)", line.split("C+9")[0]):
            at = (float(value), at[1]) if axis == "X" else (at[0], float(value)) if axis == "Y" else at
            z = z + float(value) if axis == "IZ" else float(value) if axis == "Z" else z
        found.append((math.degrees(math.atan2(at[1], at[0])), math.hypot(*at), z))
        if at == (5.0, 8.6603) and z == 3.0:  # 10 at 60 degrees of the axes: the +Y of the part
            break
    turned = np.unwrap([-30.0, *(angle for angle, _, _ in found)], period=360.0)
    assert [radius for _, radius, _ in found] == pytest.approx([10.0] * len(found), abs=1e-4)
    assert turned[-1] == pytest.approx(-30.0 + 180.0 + 90.0 + 90.0 + 720.0 + 90.0, abs=1e-3)
    assert 0.0 < np.diff(turned).min() < np.diff(turned).max() < 11.5
    below = [5.0 - 2.0 * min(max((angle - 330.0) / 720.0, 0.0), 1.0) for angle in turned[1:]]
    assert [depth for _, _, depth in found] == pytest.approx(below, abs=2e-4)
    assert 10.0 < largest()[1] < 100.0


def test_a_tangential_arc_behind_straight_lines_becomes_straight_lines_too(ncomp):
    """At C0 both kinds of coordinates are one, but CT would go on in the direction of the last chord."""
    arcs = "6 CC X+0 Y+0\n6 C X-10 Y+0 DR+ C+0\n6 CT X+0 Y-10\n6 L"
    text = KLARTEXT.format(on="3 M128\n", off="7 M129\n").replace("6 L", arcs).replace("Z+5 F1000", "Z+5 C+30 F1000")
    done, written = convert(ncomp, text, "--tolerance-um", "100", file="tip.h", offset="0=0,0,0")
    assert done.status == 0, done.err
    assert "CT" not in written.replace("END", "")
    assert re.search(r"L X\+0\.0000 Y-10\.0000", written)
    assert largest()[1] < 100.0


def test_an_arc_whose_block_cannot_be_cut_is_refused_with_the_reason(ncomp):
    text = KLARTEXT.format(on="3 M128\n", off="7 M129\n").replace("6 L", "6 CC X+0 Y+0\n6 C X-10 Y+0 DR+ M9\n6 L")
    done, _ = convert(ncomp, text.replace("Z+5 F1000", "Z+5 C+9 F1000"), *COARSE, file="tip.h", offset="0=0,0,0")
    assert (done.status, "an M function in its block may run before or after the move" in done.err) == (2, True)
    assert not Path("out_tip.h").exists()


# ---- drilling cycles: with C90 the part's X 10 Y 5 is at X 5 Y -10 of the axes, and Z is that of the part

DRILLED = "G0 C90. Z50.\n{modes}G81 X10. Y5. Z-5. R2.{feed}\nX20.\nG99 G83 Y0. Z-7. Q2.\nG80\nG1 X10. Y0. C0. F300."
DRILLED_KLARTEXT = (
    "4 L X+10 Y+0 Z+100 C+90 FMAX\n5 L Z+5 F1000 M8\n5 CYCL DEF 200 DRILLING ~\n Q200=2 ~\n Q201=-15 ~\n Q206=250 ~\n"
    " Q202=5 ~\n Q210=0 ~\n Q203=+0 ~\n Q204=50 ~\n Q211=0\n6 L X+10 Y+5 FMAX M99\n7 CYCL CALL POS X+20 Y+5 Z+1\n"
    "8 L X+20 Y+0 FMAX\n9 CYCL CALL\n"
)


def test_a_canned_cycle_of_iso_stays_one_with_the_tool_along_z(ncomp):
    done, written = convert(ncomp, table(DRILLED.format(modes="G98 ", feed=" F100.")), *COARSE)
    assert done.status == 0, done.err
    assert (
        "G98 G81 X5.0000 Y-10.0000 Z-5. R2. F100.\nX5.0000 Y-20.0000\nG99 G83 X0.0000 Y-20.0000 Z-7. Q2.\nG80\n"
        in written
    )
    assert largest()[0] < 0.2


@pytest.mark.parametrize(("how", "line"), [("inverse-time", "G94 F400 (NCOMP FEED)"), ("scaled", "F400 (NCOMP FEED)")])
def test_a_canned_cycle_drills_with_the_feed_of_the_program(ncomp, how, line):
    machine = f'{TABLE}\n[control]\nfamily = "fanuc"\n'
    moves = f"G1 Z60. C1. F400.\n{DRILLED.format(modes='G98 ', feed='')}"
    done, written = convert(ncomp, table(moves), *COARSE, "--tcp-feed", how, machine=machine)
    assert done.status == 0, done.err
    assert f"\n{line}\nG98 G81 X5.0000 Y-10.0000 Z-5. R2.\n" in written


def test_a_canned_cycle_in_the_coordinates_of_the_axes_becomes_one_of_the_tool_point_on_linuxcnc(ncomp):
    """X 5 Y -10 of the axes at C90 is X 10 Y 5 of the part."""
    machine = f'{TABLE}\n[control]\nfamily = "linuxcnc"\ntcp_at_start = true\n'
    text = "G21 G17 G90 G94 G54\nT1 M6\nG43 H1\nG0 X10. Y0 Z100. C0\nG0 X0. Y-10. C90.\nG98 G81 X5. Y-10. Z-5. R2. F100.\nG80\nM30\n"
    done, written = convert(ncomp, text, *COARSE, machine=machine, to="to-tcp")
    assert done.status == 0, done.err
    assert "G98 G81 X10.0000 Y5.0000 Z-5. R2. F100.\n" in written
    again, _ = convert(ncomp, text, *COARSE, to="to-tcp")
    assert (again.status, "controls differ in canned cycles under G43.4" in again.err) == (2, True)


def test_siemens_drilling_cycles_run_at_the_converted_positions(ncomp):
    text = SIEMENS.replace(
        "X10 Y0 C9 F360",
        "G0 X10 Y0 C90\nMCALL CYCLE81(50,0,2,-5)\nX10 Y5\nX20\nMCALL\nY0\nCYCLE83(60,0,1,-9)\nG1 X21 F100",
    )
    done, written = convert(ncomp, text, *COARSE, file="tip.mpf")
    assert done.status == 0, done.err
    assert (
        "; NCOMP FEED\nMCALL CYCLE81(50,0,2,-5)\nX5.0000 Y-10.0000\nX5.0000 Y-20.0000\nMCALL\nX0.0000 Y-20.0000\nCYCLE83(60,0,1,-9)\n"
        in written
    )
    assert largest()[0] < 0.2


def test_klartext_drilling_cycles_run_at_the_converted_positions(ncomp):
    text = KLARTEXT.format(on="3 M128\n", off="7 M129\n").replace(
        "4 L X+10 Y+0 Z+100 C+0 FMAX\n5 L Z+5 F1000 M8\n", DRILLED_KLARTEXT
    )
    done, written = convert(ncomp, text, *COARSE, file="tip.h", offset="0=0,0,0")
    assert done.status == 0, done.err
    for line in ("L X+5.0000 Y-10.0000 FMAX M99", "CYCL CALL POS X+5.0000 Y-20.0000 Z+1", "L X+0.0000 Y-20.0000 FMAX"):
        assert f" {line}\n" in written
    assert largest()[0] < 0.2


LEANING = {
    "iso": ("a.nc", table("G0 B30.\nG98 G81 X10. Y5. Z-5. R2. F100."), "the tool stands along Z of the part"),
    "siemens": ("a.mpf", SIEMENS.replace("X10 Y0 C9 F360", "B30\nCYCLE81(50,0,2,-5)"), "the tool stands along Z of the part"),
    "siemens off the wall": ("a.mpf", SIEMENS.replace("X10 Y0 C9 F360", "CYCLE86(50,0,2,-5)"), "CYCLE86 while TRAORI is on"),
    "klartext": ("a.h", KLARTEXT.format(on="3 M128\n", off="").replace("4 L X+10 Y+0 Z+100 C+0 FMAX\n5 L Z+5 F1000 M8\n",
                 DRILLED_KLARTEXT.replace("C+90", "B+30 C+90")), "the tool stands along Z of the part"),
    "klartext off the wall": ("a.h", KLARTEXT.format(on="3 M128\n", off="").replace("4 L X+10 Y+0 Z+100 C+0 FMAX\n5 L Z+5 F1000 M8\n",
                 DRILLED_KLARTEXT.replace("DEF 200", "DEF 202")), "cycle 202 while M128 is on"),
    "repeated by increments": ("a.nc", table("G0 C90.\nG91 G99 G83 X5. Y5. Z-5. R-98. Q2. F100.\nX10. K3"), "write each hole in a block of its own"),
    "a move before it": ("a.mpf", SIEMENS.replace("X10 Y0 C9 F360", "MCALL CYCLE81(50,0,2,-5)\nX11\nMCALL"), "run with another feed"),
}  # fmt: skip


@pytest.mark.parametrize("name", LEANING)
def test_drilling_cycles_that_are_refused_under_tcp(ncomp, name):
    file, text, words = LEANING[name]
    Path(file).write_text(text.replace("C0\n", "B0 C0\n").replace("C+0", "B+0 C+0"))
    offset = "0=0,0,0" if file.endswith(".h") else "G54=0,0,0"
    own = ("--machine", "dmu50", "--calibration", "none", "--work-offset", offset, "--tool-length", "T1=100")
    done = ncomp(file, *own, "--tcp", "to-axes", *COARSE, "-o", f"out_{file}")
    assert (done.status, words in done.err) == (2, True), done.err
    assert not Path(f"out_{file}").exists()


REFUSED = {
    "no TCP": ("G21 G90 G17 G94 G54\nG0 X1 Y1 Z1 C0\nM30\n", (), "nothing to convert"),
    "half a turn": (table("G1 Z5. F100.\nC200."), (), None),
    "no feed": (table("G1 Z5. C5."), (), "the feed of this move is not known"),
    "family": (table("G1 Z5. C5. F100."), ("--tcp-feed", "scaled"), "controls differ in the meaning of F"),
    "rotated": (table("G1 Z5. F100.").replace("G43.4", "G68 X0 Y0 R30.\nG43.4"), (), "while the coordinates are rotated"),
    "position before the switch": ("G21 G17 G90 G94 G54\nT1 M6\nG0 X50. Y10. Z100. C0\nG43.4 H1\nG0 C60.\nM30\n", (), "only before it switched TCP on"),
    "unknown position": ("G21 G17 G90 G94 G54\nT1 M6\nG43.4 H1\nG1 X5. C5. F100.\nM30\n", (), "given the positions of all"),
    "travel": (table("G1 Z5. F100.\nX600. C1."), (), "outside its travel"),
    "travel between": (table("G1 Z5. F100.\nX480. Y300. C0\nC80."), (), "outside its travel"),
    "no move at all": ("G21 G90 G94 G54\nT1 M6\nM30\n", (), "nothing to convert"),
    "no move before the refusal": ("G21 G90 G94 G54\nT1 M6\nG43.4 H1 X10. Y0 Z100. C0\nM30\n", (), "have no G0, G1, G2 or G3"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("tip.nc", "G21 G17 G90 G94 G54\nT1 M6\nG43.4 H1\nG0 X0 Y0 Z100. C0\nG1 X5. C5. F100.\nG49\nM30\n"),
        ("tip.mpf", "G71 G17 G90 G94 G54\nT1 D1 M6\nTRAORI\nG0 X0 Y0 Z100 C0\nG1 X5 C=5 F100\nTRAFOOF\nM30\n"),
    ],
)
def test_a_program_of_the_tool_point_is_not_converted_to_one(ncomp, file, text):
    done, _ = convert(ncomp, text, *COARSE, file=file, to="to-tcp")
    assert done.status == 2
    assert f"{file}:4:" in done.err
    assert "TCP is on in this move already" in done.err
    assert not Path(f"out_{file}").exists()


@pytest.mark.parametrize("name", REFUSED)
def test_refused(ncomp, name):
    text, options, words = REFUSED[name]
    done, _ = convert(ncomp, text, *COARSE, *options)
    if words is None:  # the machine file states how C counts
        assert done.status == 0, done.err
        done, _ = convert(ncomp, text, *COARSE, machine=TABLE.replace(', rollover = "as-written"', ""))
        words = 'write rollover = "as-written" or "shortest"'
        Path("out_tip.nc").unlink()
    assert done.status == 2, done.err
    assert words in done.err
    assert not Path("out_tip.nc").exists()


def test_the_shortest_way_beyond_the_travel_of_a_table(ncomp):
    """From 0 the shortest way to 355 is through -5: outside a travel of 0 to 360, inside that of a table without end."""
    text = SIEMENS.replace("G1 Z5 F1000\nX10 Y0 C9 F360", "G1 Z5 F1000\nX10 Y0 C=DC(355) F360")
    limited = TABLE.replace("[-inf, inf]", "[0, 360]").replace(', rollover = "as-written"', "")
    done, _ = convert(ncomp, text, *COARSE, machine=limited, file="tip.mpf")
    assert done.status == 2
    assert "the shorter way would leave its travel, 0 to 360 degrees: write travel = [-inf, inf]" in done.err
    done, written = convert(ncomp, text, *COARSE, machine=limited.replace("[0, 360]", "[-inf, inf]"), file="tip.mpf")
    assert done.status == 0, done.err
    assert re.search(r"X9\.9619 Y0\.8716 C=DC\(355\)", written)  # turned by -5 degrees


def test_feeds_without_a_conversion(ncomp):
    Path("mill.toml").write_text(TABLE)
    Path("tip.nc").write_text(table("G1 Z5. F1000."))
    done = ncomp("tip.nc", *OPTIONS, "--work-offset", "G54=0,0,0", "--tcp-feed", "scaled", "-o", "out.nc")
    assert done.status == 2
    assert "give --tcp too" in done.err
    assert not Path("out.nc").exists()


def test_klartext_has_no_inverse_time(ncomp):
    text = KLARTEXT.format(on="3 M128\n", off="7 M129\n")
    done, _ = convert(ncomp, text, "--tcp-feed", "inverse-time", file="tip.h", offset="0=0,0,0")
    assert done.status == 2
    assert "Klartext has no G93" in done.err
