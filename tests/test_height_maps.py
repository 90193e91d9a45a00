"""Height maps of a workpiece: read as their programs write them, applied in work coordinates, refused in words."""

import math
from pathlib import Path

import numpy as np
import pytest
from support.height_map_files import FORMS, KLIPPER, SMALL, TABLE, UBL, gsender, hmap, rows
from support.programs import load

import ncomp
from kinematics.effects import Backlash, LocationError
from kinematics.error_model.joined import joined
from kinematics.error_model.model import no_errors, write_model

ROUTER = """name = "router"
chain = "w b Y X Z t"
[axes.X]
travel = [0, 400]
resolution = 1e-4
[axes.Y]
travel = [0, 300]
resolution = 1e-4
[axes.Z]
travel = [-60, 60]
resolution = 1e-4
[priors]
kind = "router"
"""
X, Y = np.arange(0.0, 121.0, 20.0), np.arange(0.0, 81.0, 20.0)
HEIGHTS = np.round(0.25 * np.sin((X[:, None] + Y) / 40) + 0.002 * X[:, None], 3)
"""A warped board, mm."""
BOARD = """G21 G90 G17
G0 Z5
G0 X10 Y10
G1 Z-0.1 F100
G1 X110 Y15 F300
G2 X110 Y55 I0 J20
G3 X70 Y60 R30
G91
G1 X-30 Y5
G1 X-20
G2 X-10 Y-10 R10
G90
G1 X12 Y12
G0 Z5
G0 X0 Y0
M30
"""
AT = ("--work-offset", "G54=100,50,-20")


@pytest.fixture(autouse=True)
def files(tmp_path, monkeypatch):
    """A machine, a program and its map in the folder of the run."""
    monkeypatch.chdir(tmp_path)
    Path("router.toml").write_text(ROUTER)
    Path("board.nc").write_text(BOARD)
    Path("board.probe").write_text(probe(X, Y, HEIGHTS))


def probe(x, y, heights) -> str:
    """The text that bCNC writes."""
    rows = [f"{x[0]:g} {x[-1]:g} {len(x)}", f"{y[0]:g} {y[-1]:g} {len(y)}", "-2 1 20", "", ""]
    for j, b in enumerate(y):
        rows += [*(f"{a:g} {b:g} {heights[i, j]:g}" for i, a in enumerate(x)), ""]
    return "\n".join(rows)


@pytest.mark.parametrize(("end", "accepted"), [(121.8, True), (122.2, False), (118.2, True), (117.8, False)])
def test_the_ends_that_bcnc_states_are_those_of_the_points_to_a_tenth_of_a_step(ncomp, end, accepted):
    Path("board.probe").write_text(probe(X, Y, HEIGHTS).replace("0 120 7", f"0 {end} 7", 1))
    done = ncomp("board.nc", "--machine", "router.toml", "--calibration", "none", *AT, "--height-map", "board.probe")
    assert (done.status == 0) == accepted, done.shown
    assert accepted or "board.probe:1: " in done.shown


def bilinear(x: float, y: float) -> float:
    """The formula of bCNC's Probe.interpolate, on the grid of 20 mm."""
    i, j = min(int(x // 20), len(X) - 2), min(int(y // 20), len(Y) - 2)
    a, b = x / 20 - i, y / 20 - j
    low = (1 - a) * HEIGHTS[i, j] + a * HEIGHTS[i + 1, j]
    high = (1 - a) * HEIGHTS[i, j + 1] + a * HEIGHTS[i + 1, j + 1]
    return (1 - b) * low + b * high


def path(text: str, step: float) -> np.ndarray:
    """Points `(n, 3)` of the feed moves of a program, read here: G90, G91, G1, and G2 and G3 with I and J or R."""
    at, points, absolute, motion = np.zeros(3), [], True, 0
    for line in text.splitlines():
        words = [
            (w[0], float(w[1:])) for w in line.partition("(")[0].split() if w[1:].strip("-.").replace(".", "").isdigit()
        ]
        for letter, value in words:
            if letter == "G" and value in (90, 91):
                absolute = value == 90
            elif letter == "G" and value <= 3:
                motion = int(value)
        given = dict(words)
        if not given.keys() & set("XYZ"):
            continue
        base = np.full(3, np.nan) if absolute else at
        end = np.array(
            [given[k] if absolute and k in given else b + given.get(k, 0.0) for k, b in zip("XYZ", base, strict=True)]
        )
        end = np.where(np.isnan(end), at, end)
        shares = np.linspace(0, 1, max(2, int(np.linalg.norm(end - at) / step) * 2))
        if motion == 1 and (end[:2] != at[:2]).any():
            points.append(at + shares[:, None] * (end - at))
        elif motion in (2, 3):
            points.append(arc(at, end, given, motion, shares))
        at = end
    return np.concatenate(points)


def arc(at, end, given, motion, shares) -> np.ndarray:
    """Points of a helix about Z."""
    a, b, way = complex(*at[:2]), complex(*end[:2]), 1 if motion == 3 else -1
    if "R" in given:
        half = (b - a) / 2
        centre = a + half + way * 1j * half / abs(half) * math.sqrt(max(given["R"] ** 2 - abs(half) ** 2, 0.0))
    else:
        centre = a + complex(given.get("I", 0.0), given.get("J", 0.0))
    turned = np.angle((b - centre) / (a - centre)) % (2 * math.pi)
    turned = turned if way == 1 else turned - 2 * math.pi
    at_circle = centre + (a - centre) * np.exp(1j * turned * shares)
    return np.stack([at_circle.real, at_circle.imag, at[2] + shares * (end[2] - at[2])], axis=1)


def corrected(command, *options: str, status: int = 0) -> str:
    done = command("board.nc", "--machine", "router.toml", "-o", "out.nc", *options)
    assert done.status == status, done.err
    return Path("out.nc").read_text() if status == 0 else done.err


def test_the_path_lies_on_the_map_within_the_tolerance(command):
    text = corrected(command, "-c", "none", *AT, "--height-map", "board.probe", "--tolerance-um", "2")
    points = path(text, 0.2)
    chosen = points[np.linspace(0, len(points) - 1, 1000).astype(int)]
    away = [z + 0.1 - bilinear(x, y) for x, y, z in chosen]
    assert np.abs(away).max() < 2.0e-3 + 0.1e-3
    assert len([line for line in text.splitlines() if line.startswith(("G2 ", "G3 "))]) > 10, "arcs stay arcs"
    relative = text.partition("G91")[2].partition("G90")[0]
    assert "G1 X-20" in relative, "G91 stays G91"
    assert "R10" in relative
    done = command(
        "verify", "board.nc", "out.nc", "-m", "router.toml", "-c", "none", *AT, "--height-map", "board.probe"
    )
    assert done.status == 0, done.err


def test_the_map_lies_at_its_work_offset_wherever_that_is(command):
    here = corrected(command, "-c", "none", *AT, "--height-map", "board.probe")
    there = corrected(command, "-c", "none", "--set-up-zero", "--height-map", "board.probe@G54")
    assert np.abs(path(here, 5.0) - path(there, 5.0)).max() < 1.1e-4  # the last digit
    assert "probed at G55, and the program uses G54" in corrected(
        command, "-c", "none", "--set-up-zero", "--height-map", "board.probe@G55", status=2
    )
    refused = corrected(command, "-c", "none", "--height-map", "board.probe", status=2)
    assert "the coordinates of G54, which is not given" in refused


def machine_with(*effects) -> None:
    """A calibration of the router, `cal.json`."""
    write_model(joined(no_errors(load("router.toml")), effects, 1.0), Path("cal.json"))


def test_squareness_backlash_and_map_in_one_run(command):
    # X runs along its line, and Y leaves it by 2 mrad: the tool at y is at x - 0.002 y (E_XY = -E_C0Y y)
    machine_with(LocationError("C", "Y", 2000.0), Backlash("X", 40.0))
    Path("board.nc").write_text(
        "G21 G90\nG0 X10 Y10 Z5\nG1 Z-0.1 F100\nG1 X110 Y10\nG1 X110 Y70\nG1 X30 Y70\nG0 Z5\nM30\n"
    )
    text = corrected(command, "-c", "cal.json", *AT, "--height-map", "board.probe", "--tolerance-um", "4")
    rows = [{w[0]: float(w[1:]) for w in line.split() if w[0] in "XYZ"} for line in text.splitlines()[2:]]
    ends = []
    for row in rows:
        ends.append({**(ends[-1] if ends else {}), **row})
    first, corner, last = ends[0], next(end for end in ends if end["Y"] == 70.0), ends[-3]
    # relative to the touch-off at Y 50 of the machine, the squareness shifts x by -0.002 y; half the backlash is 0.02
    assert first["X"] == pytest.approx(10 + 0.002 * 10, abs=2e-3), "X has not moved yet"
    assert corner["X"] == pytest.approx(110 + 0.002 * 70 + 0.02, abs=2e-3)
    assert last["X"] == pytest.approx(30 + 0.002 * 70 - 0.02, abs=2e-3), "on the way back"
    for end in (corner, last):
        assert end["Z"] == pytest.approx(-0.1 + bilinear(end["X"], end["Y"]), abs=5e-4), (
            "the map at the commanded place"
        )


def test_a_probed_map_contains_the_errors_of_the_machine_once(command):
    # the bridge sags: the tool is low by 1 um per mm of X; the probe found the surface with the same sag
    machine_with(LocationError("B", "X", 1000.0))
    with_errors = corrected(command, "-c", "cal.json", *AT, "--height-map", "board.probe")
    by_map = corrected(command, "-c", "none", *AT, "--height-map", "board.probe")

    def ends(text: str) -> list[float]:
        return [float(w[1:]) for line in text.splitlines() if "Y15.0000" in line for w in line.split() if w[0] == "Z"]

    assert ends(with_errors) == pytest.approx(ends(by_map), abs=2e-4)
    assert len(ends(by_map)) == 1


def test_a_map_is_followed_whatever_classes_are_corrected(command):
    machine_with(LocationError("C", "Y", 2000.0))
    all_but_squareness = corrected(
        command, "-c", "cal.json", *AT, "--height-map", "board.probe", "--classes", "L-POS", "--accept", "insignificant"
    )
    by_map = corrected(command, "-c", "none", *AT, "--height-map", "board.probe")
    assert all_but_squareness.splitlines()[1:] == by_map.splitlines()[1:]


def test_a_feed_move_beyond_the_map_is_refused_or_takes_the_edge(command):
    Path("board.nc").write_text("G21 G90\nG0 X10 Y10 Z5\nG1 Z-0.1 F100\nG1 X130 Y10\nG0 Z5\nG0 X200 Y200\nM30\n")
    refused = corrected(command, "-c", "none", *AT, "--height-map", "board.probe", status=2)
    assert "board.nc:4: 'G1 X130 Y10': this feed move leads beyond the height map board.probe (bCNC) at G54" in refused
    assert "X 0 to 120, Y 0 to 80" in refused
    assert not Path("out.nc").exists()
    text = corrected(command, "-c", "none", *AT, "--height-map", "board.probe", "--accept", "outside")
    assert path(text, 1.0)[-1] == pytest.approx([130, 10, -0.1 + bilinear(120, 10)], abs=2e-4)


@pytest.mark.parametrize(
    ("cut", "reason"),
    [
        pytest.param("G0 X10 Y10 Z5\nG81 X130 Y10 R2 Z-1 F100\nG80", "leads beyond the height map", id="hole beyond"),
        pytest.param("G0 X130 Y10 Z-1\nG1 X100 F100", "leads beyond the height map", id="begins beyond"),
        pytest.param(
            "G0 Z5\nG1 Z-1 F100", "the program has not given X and Y, so that the place", id="place not given"
        ),
        pytest.param("G0 Z5\nG0 X10\nG1 Z-1 F100", "the program has not given Y, so that the place", id="Y not given"),
    ],
)
def test_a_cut_at_a_place_that_is_not_on_the_map_is_refused(command, cut, reason):
    Path("board.nc").write_text(f"G21 G90\n{cut}\nG0 Z5\nM30\n")
    assert reason in corrected(command, "-c", "none", *AT, "--height-map", "board.probe", status=2)


def test_a_program_without_z_follows_no_map(command):
    """A laser program, for instance: its output would be its input, though a map is given."""
    Path("board.nc").write_text("G21 G90\nG0 X10 Y10\nM4 S0\nG1 X50 S200 F900\nM5\nM30\n")
    refused = corrected(command, "-c", "none", *AT, "--height-map", "board.probe", status=2)
    assert "gives Z to no feed move, so that nothing follows the height map" in refused


def test_a_map_of_another_zero_in_z_is_refused_by_the_limit_of_the_kind(command):
    Path("deep.probe").write_text(probe(X, Y, HEIGHTS - 35.0))
    refused = corrected(command, "-c", "none", *AT, "--height-map", "deep.probe", status=2)
    assert "more than 3000 um" in refused
    assert "the limit of this kind of machine" in refused
    assert "heights -35044 to -34613 um of the map deep.probe (bCNC) at G54" in refused
    Path("router.toml").write_text(ROUTER.partition("[priors]")[0])
    Path("half.probe").write_text(probe(X, Y, HEIGHTS + 0.6))
    assert "more than 500 um" in corrected(command, "-c", "none", *AT, "--height-map", "half.probe", status=2)


def test_the_file_beside_a_program_names_its_map(command):
    by_option = corrected(command, "-c", "none", *AT, "--height-map", "board.probe")
    Path("board.nc.toml").write_text('height_map = "board.probe"\n[work_offsets]\nG54 = {X = 100, Y = 50, Z = -20}\n')
    assert corrected(command, "-c", "none") == by_option


def test_a_machine_that_turns_the_workpiece_has_no_map():
    with pytest.raises(ncomp.UserError, match=r"height map board.probe: machine dmu50 .* other axes than X, Y and Z"):
        ncomp.set_up("dmu50", zero=True, height_map="board.probe")


# ---- the formats, and the interpolation of each, by the formulas of their sources


def heights(file: str, *places: tuple[float, float], **options) -> list[float]:
    """Heights, mm, of the surface at places, mm in X and Y."""
    from kinematics.state import State

    machine = load("router.toml")
    surface = ncomp.set_up(machine, zero=True, height_map=file, **options).surface
    q = np.array([[{"X": x, "Y": y, "Z": 0.0}[name] for name in machine.names] for x, y in places])
    ((_, _, errors),) = surface.contributions(machine, State(q))
    return [-round(error, 9) for error in errors.tolist()]


PLACES = ((0.0, 0.0), (2.5, 0.0), (12.5, 2.5), (30.0, 10.0), (45.0, -7.0))
LINEAR = [0.0, 0.05, 0.25 * 0.25 + 0.75 * 0.25, 0.3, 0.1]
"""At X 12.5, Y 2.5: 3/4 of (0.2 + 0.3) / 2 and 1/4 of (0.0 + 0.5) / 2; beyond the map the height of its edge."""


@pytest.mark.parametrize("name", FORMS)
def test_a_bilinear_map(name):
    Path(name).write_text(FORMS[name])
    assert heights(name, *PLACES) == pytest.approx(LINEAR, abs=1e-9)


def test_version_1_of_reprap_has_one_spacing():
    table = "\n".join(",".join(f"{z:.3f}" for z in SMALL[:3, j]) for j in range(3))
    labels = "xmin,xmax,ymin,ymax,radius,spacing,xnum,ynum\n0,20,0,20,-1,10,3,3"
    Path("old.csv").write_text(f"RepRapFirmware height map file v1\n{labels}\n{table}\n")
    assert heights("old.csv", (10.0, 10.0), (20.0, 5.0)) == pytest.approx([0.3, 0.25])


def test_candle_is_bicubic():
    lines = ["0;0;30;10", "4;3;-1;1", "0;10;5", *(";".join(f"{z:g}" for z in SMALL[:, j]) for j in range(3))]
    Path("board.map").write_text("\r\n".join(lines) + "\r\n")
    # cubicInterpolate(p0 p1 p2 p3, 1/2) = (9 p1 + 9 p2 - p0 - p3) / 16, in X over the rows, then in Y
    at_rows = [(9 * (a + b) - p - q) / 16 for p, a, b, q in (SMALL[[0, 1, 2, 3], j] for j in range(3))]
    between = (9 * (at_rows[0] + at_rows[1]) - at_rows[0] - at_rows[2]) / 16  # the first row is repeated
    found = heights("board.map", (15.0, 0.0), (15.0, 2.5), (5.0, 5.0), (20.0, 10.0))
    first = (9 * (SMALL[0, 1] + SMALL[1, 1]) - SMALL[0, 1] - SMALL[2, 1]) / 16
    assert found == pytest.approx([at_rows[0], between, first, 0.2])


def test_klipper_samples_its_mesh_before_it_is_bilinear():
    table = TABLE.strip().replace("\n", "\n#*#   ")
    Path("spline.cfg").write_text(KLIPPER.format(table, pps=1, algo="bicubic"))
    # halfway between points a and b with neighbours p and q: a / 2 + b / 2 + 0.2 (b - p) / 8 - 0.2 (q - a) / 8
    p, a, b, q = SMALL[:, 0]
    middle = (a + b) / 2 + 0.2 * ((b - p) - (q - a)) / 8
    assert heights("spline.cfg", (15.0, 0.0), (12.5, 0.0)) == pytest.approx([middle, (a + middle) / 2])
    Path("lagrange.cfg").write_text(KLIPPER.format(table, pps=1, algo="lagrange"))
    cubic = np.polynomial.Polynomial.fit([0, 10, 20, 30], SMALL[:, 1], 3)
    assert heights("lagrange.cfg", (5.0, 5.0), (25.0, 5.0)) == pytest.approx([cubic(5.0), cubic(25.0)])


def test_a_map_without_a_unit_is_in_that_of_the_tables():
    Path("inch.txt").write_text("0 0 0.01\n1 0 0.02\n0 1 0.03\n1 1 0.04\n")
    assert heights("inch.txt", (25.4, 25.4), table_unit="inch") == pytest.approx([0.04 * 25.4])


FAULTS = {
    "hole.probe": (
        FORMS["map.probe"].replace("20 5 0.5\n", ""),
        "the map has a hole: one point has no height, the first at X 20 Y 5",
    ),
    "cut.probe": (
        "0 30 4\n0 10 3\n-2 1 20\n0 0 0\n10 0 0.2\n0 5 0\n10 5 0.1\n",
        "cut.probe:1: '0 30 4': the points below have 2 positions in X, 0 to 10",
    ),
    "four.probe": ("0 30 4\n0 10 3\n-2 1 20 7\n", "four.probe:3: '-2 1 20 7': expected three numbers"),
    "nan.map": (
        "0;0;30;10\n4;2;-1;1\n0;10;5\n0;0;nan;0\n0;0;0;0\n",
        "a hole: one point has no height, the first at X 20 Y 0",
    ),
    "short.map": ("0;0;30;10\n4;3;-1;1\n0;10;5\n0;0;0;0\n0;0;0;0\n", "2 rows of heights; line 2 gives 3"),
    "comma.map": ("0;0;30;10\n4;2;-1;1\n0;10;5\n0;0,1;0;0\n0;0;0;0\n", "comma.map:4: '0;0,1;0;0': could not convert"),
    "hole.hmap": (
        hmap().replace('<point X="2" Y="1">0.5</point>', ""),
        "one point has no height, the first at X 20 Y 5",
    ),
    "cut.hmap": (hmap()[:200], "the file is cut or damaged"),
    "inch.gshmap": (gsender("in"), "maps of gSender are in mm: probe again"),
    "old.gshmap": (gsender(lowest=0.0), "its lowest point is exactly 0, as in the maps of earlier versions"),
    "cut.json": (gsender()[:90], "cut.json:1: the file is cut or damaged"),
    "twice.txt": (
        rows(" ") + "10 5 0.31\n",
        "twice.txt:13: '10 5 0.31': X 10 Y 5 has a height already: delete one of them",
    ),
    "words.txt": ("0 0 0\n1 0 high\n", "words.txt:2: '1 0 high': could not convert"),
    "german.txt": (
        "0,0 0,0 0,1\n",
        "german.txt:1: '0,0 0,0 0,1': expected X, Y and Z in the coordinates of the work offset",
    ),
    "log.txt": (
        "[PRB:-700.000,-700.000,-59.900:1]\nok\n",
        "log.txt:1: '[PRB:-700.000,-700.000,-59.900:1]': expected X, Y",
    ),
    "unit.csv": ("x,y,z_um\n0,0,100\n", "unit.csv:1: 'x,y,z_um': a list is in mm, or all of it in inches"),
    "inch.csv": ("X(in),Y(in),Z(in)\n0,0,1\n", "inch.csv:1: 'X(in),Y(in),Z(in)': a list is in mm, or all"),
    "line.txt": ("0 0 0\n1 0 0\n2 0 0\n", "3 positions in X and 1 in Y: a map has at least two of each"),
    "empty.txt": ("\n", "it has no heights"),
    "unset.csv": (FORMS["heightmap.csv"].replace("0.200,0.300", "0.200,0"), "was not probed, so the map has a hole"),
    "m420.txt": (
        "Bilinear Leveling Grid:\n      0      1\n 0 +0.1 +0.2\n 1 +0.1 +0.3\n",
        "these heights have no positions",
    ),
    "large.hmap": (
        hmap().replace('SizeX="4"', 'SizeX="900000000"'),
        "900000000 x 3 points from [0.0, 0.0] to [30.0, 10.0]: a map has 2 to 1001 points along each axis",
    ),
    "endless.hmap": (hmap().replace('MaxX="30"', 'MaxX="inf"'), "4 x 3 points from [0.0, 0.0] to [inf, 10.0]"),
    "infinite.hmap": (hmap().replace(">0.5<", ">inf<"), "'X=2 Y=1': a number is not finite"),
    "infinite.gshmap": (gsender().replace('"z": 0.5', '"z": Infinity'), "a number is not finite"),
    "soft.cfg": (
        FORMS["printer.cfg"].replace("tension = 0.2", "tension = soft"),
        "could not convert string to float: 'soft'",
    ),
    "half.cfg": (FORMS["printer.cfg"].replace("x_count = 4", "x_count = 3.5"), "x_count 3.5: expected a whole number"),
    "dense.cfg": (
        FORMS["printer.cfg"].replace("direct", "lagrange").replace("x_pps = 0", "x_pps = 400000000"),
        "1200000004 points along x with mesh_x_pps 400000000: a mesh has at most 1001",
    ),
    "axes.csv": (FORMS["heightmap.csv"].replace("X,Y,0", "X,X,0"), "a function of two axes that differ"),
    "corner.txt": (UBL.replace("(0,", "(0.0.0,", 1), "these heights have no positions"),
    "dot.txt": (UBL.replace("+0.500", "  .   "), "a hole: one point has no height, the first at X 20 Y 5"),
}


@pytest.mark.parametrize("heading", ["y,x,z", "Y (mm);X (mm);Z (mm)", "# by hand\nY_mm\tX_mm\tZ_mm"])
def test_the_heading_of_a_list_names_its_columns(heading):
    Path("list.csv").write_text(heading + "\n0,0,0.1\n0,20,0.2\n20,0,0.3\n20,20,0.4\n")
    assert heights("list.csv", (20.0, 0.0), (0.0, 20.0)) == [0.2, 0.3]


@pytest.mark.parametrize("name", FAULTS)
def test_a_faulty_map_is_refused_with_row_and_reason(name):
    text, reason = FAULTS[name]
    Path(name).write_text(text)
    with pytest.raises(ncomp.UserError) as fault:
        heights(name, (0.0, 0.0))
    assert reason in str(fault.value)
    assert name in str(fault.value)
