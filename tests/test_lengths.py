"""A ruler, a square and a dial gauge: files, fits of few readings by the command, mistakes that are named, simulation."""

import json
from pathlib import Path

import numpy as np
import pytest

import ncomp
from benchmarks import lengths as benchmark
from kinematics.error_model.model import read_model
from kinematics.user_error import UserError

MACHINE = benchmark.MACHINE
HEAD = "# machine: router\n# instrument: lengths\n# u_um: 250\n# u_scale_um_per_m: 100\n"
COLUMNS = "name,X1,Y1,X2,Y2,length_mm\n"
HOLES = {
    "AB": "0,0,600,0,599.5",
    "CD": "0,600,600,600,600",
    "AD": "0,0,0,600,601",
    "AC": "0,0,600,600,851",
    "BD": "600,0,0,600,846.5",
}
"""Four holes of a router at 600 mm, as its owner measured them."""
DIAL = "axis,along,position_mm,direction,reading_um,square,run\n"
DIAL_HEAD = "# machine: router\n# instrument: lengths\n# u_gauge_um: 5\n"


def text_of(rows: dict[str, str], head: str = HEAD) -> str:
    return head + COLUMNS + "".join(f"{name},{cells}\n" for name, cells in rows.items())


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "router.toml").write_text(MACHINE)
    return tmp_path


def fitted(command, folder: Path, text: str, *options: str) -> tuple[dict, dict, str]:
    """The effects of the calibration by name, the results, and what was printed."""
    (folder / "lengths.csv").write_text(text)
    outputs = "-o", folder / "cal.json", "--json", folder / "fit.json"
    done = command("fit", folder / "lengths.csv", "-m", folder / "router.toml", *outputs, *options)
    assert done.status == 0, done.err
    model = read_model(folder / "cal.json", ncomp.load_machine(folder / "router.toml"))
    effects = {effect.name: effect for effect in model.effects}
    return effects, json.loads((folder / "fit.json").read_text()), done.out.decode() + done.err


def refused(command, folder: Path, text: str) -> str:
    """The refusal of a file, which leaves no calibration."""
    (folder / "lengths.csv").write_text(text)
    done = command("fit", folder / "lengths.csv", "-m", folder / "router.toml", "-o", folder / "cal.json")
    assert done.status == 2
    assert not (folder / "cal.json").exists()
    return " ".join(done.err.split())


def slope(effect) -> float:
    """Mean slope of an error motion, um/m."""
    x = np.linspace(*effect.basis.interval, 201)
    return float(np.polyfit(x, effect.basis.columns(x) @ np.array(effect.parameters), 1)[0]) * 1e3


# ---- what few lengths show


@pytest.mark.parametrize(
    ("ac", "bd", "ad", "skew"),
    [(319.0, 318.0, 199.0, 0.003218), (141.22, 141.15, 100.0, 0.000496)],
)
def test_three_lengths_show_squareness(command, folder, ac, bd, ad, skew):
    """The reference results of the calibration of printers by AC, BD and AD: the tangent of the angle's error."""
    height = np.sqrt((ac**2 + bd**2) / 2.0 - ad**2) * np.cos(np.arctan(skew))
    rows = {"AC": f"0,0,{ad},{height},{ac}", "BD": f"0,{height},{ad},0,{bd}", "AD": f"0,0,{ad},0,{ad}"}
    effects, results, printed = fitted(command, folder, text_of(rows, HEAD.replace("250", "20")))
    assert effects["E_C0Y"].value == pytest.approx(-skew * 1e6, abs=1.0)
    u = np.hypot(ac, bd) * 0.02 / (2.0 * ad * height) * 1e6
    assert effects["E_C0Y"].u[0] == pytest.approx(u, rel=0.05)
    assert "no length checks another" in printed
    assert "length between X 0 Y 0 and X 0 Y" in printed
    assert results["n_observations"] == 6


def test_four_holes_with_diagonals_show_squareness_and_scales(command, folder):
    effects, _, printed = fitted(command, folder, text_of(HOLES))
    assert effects["E_C0Y"].value == pytest.approx(-1e6 * (851.0**2 - 846.5**2) / (4 * 600.0**2), rel=0.01)
    assert slope(effects["E_XX"]) == pytest.approx(1e3 * (-0.5 + 0.0) / 2 / 0.6, abs=150.0)
    assert slope(effects["E_YY"]) == pytest.approx(1e3 / 0.6, abs=500.0)
    assert "no length checks another" not in printed
    assert "ruler is not stated" not in printed


def test_sides_alone_do_not_show_squareness(command, folder):
    sides = {name: HOLES[name] for name in ("AB", "CD", "AD")}
    _, results, printed = fitted(command, folder, text_of(sides))
    assert results["not_visible"] == ["E_XY"]
    assert "both diagonals of a rectangle" in " ".join(printed.split())


def test_both_diagonals_alone_do_not_show_which_axis_is_long(command, folder):
    """Their lengths have the sum of both scales: a calibration would say each of them within 100 mm in a metre."""
    message = refused(command, folder, text_of({name: HOLES[name] for name in ("AC", "BD")}))
    assert "E_XX and E_YY: only their sum is identifiable" in message
    assert "a length along X, Y, over the whole range, would show it" in message


def test_the_scale_of_a_ruler_without_a_statement_is_not_that_of_the_machine(command, folder):
    text = text_of(HOLES).replace("# u_scale_um_per_m: 100\n", "")
    unknown, _, printed = fitted(command, folder, text)
    assert "the scale of the machine cannot be told from that of the ruler" in " ".join(printed.split())
    stated, _, _ = fitted(command, folder, text_of(HOLES))
    assert unknown["E_C0Y"].u == pytest.approx(stated["E_C0Y"].u, rel=0.02)
    assert max(unknown["E_XX"].u) > 1.5 * max(stated["E_XX"].u)
    both = fitted(command, folder, text.replace("machine: router", "machine: router\n# u_scale_um_per_m: 1000"))[0]
    assert both["E_XX"].u == pytest.approx(unknown["E_XX"].u)


def test_large_errors_are_exact_not_to_first_order(command, folder):
    """A gantry that is 40 mm per metre out of square: first order would be off by its square, 800 urad."""
    corners = {"A": (0.0, 0.0), "B": (0.0, 700.0), "C": (700.0, 700.0), "D": (700.0, 0.0)}
    marks = {name: np.array([1.004 * x + 0.04 * y, 0.997 * y]) for name, (x, y) in corners.items()}
    rows = {
        one + two: f"{corners[one][0]},{corners[one][1]},{corners[two][0]},{corners[two][1]},"
        f"{np.linalg.norm(marks[one] - marks[two]):.6f}"
        for one, two in ("AB", "BC", "CD", "AD", "AC", "BD")
    }
    effects, _, _ = fitted(command, folder, text_of(rows, HEAD.replace("100\n", "1\n").replace("250", "10")))
    assert effects["E_C0Y"].value == pytest.approx(-40_000.0, abs=20.0)
    assert slope(effects["E_XX"]) == pytest.approx(4000.0, abs=20.0)
    assert slope(effects["E_YY"]) == pytest.approx(-3000.0, abs=20.0)


def test_an_octagon_shows_squareness_and_scales(command, folder):
    """The sides and diameters of an octagon, as LinuxCNC's guide to its matrix kinematics measures one."""
    angles = np.radians(22.5 + 45.0 * np.arange(8))
    corners = 400.0 + 300.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    marks = corners @ np.array([[1.001, 0.0], [0.003, 0.998]])
    rows = {}
    for one, two in [*((k, (k + 1) % 8) for k in range(8)), *((k, k + 4) for k in range(4))]:
        ends = ",".join(f"{value:.6f}" for value in (*corners[one], *corners[two]))
        rows[f"{one}{two}"] = f"{ends},{np.linalg.norm(marks[one] - marks[two]):.6f}"
    effects, _, _ = fitted(command, folder, text_of(rows, HEAD.replace("100\n", "5\n").replace("250", "20")))
    assert effects["E_C0Y"].value == pytest.approx(-3000.0, abs=5.0)
    assert slope(effects["E_XX"]) == pytest.approx(1000.0, abs=10.0)
    assert slope(effects["E_YY"]) == pytest.approx(-2000.0, abs=10.0)


def test_each_row_may_have_its_own_uncertainty(command, folder):
    rows = {
        name: f"{cells},20" for name, cells in (HOLES | {"AB": "0,0,600,0,600"}).items() if name not in ("AC", "BD")
    }
    rows |= {name: f"{HOLES[name]},2000" for name in ("AC", "BD")}
    text = text_of(rows, HEAD.replace("# u_um: 250\n", "")).replace("length_mm\n", "length_mm,u_um\n")
    effects, _, _ = fitted(command, folder, text)
    assert effects["E_C0Y"].u[0] == pytest.approx(1e3 * np.hypot(851, 846.5) * 2.0 / (2 * 600.0**2) * 1e3, rel=0.05)


# ---- a square and a dial gauge


def square_rows(skew: float, angle: float, turn: float, side: str) -> str:
    """Readings, um, of both legs of a square whose angle is more than 90 degrees by `angle` rad.

    side: the cell of the column square. Y leans towards +X by skew per mm; the square lies turned by `turn` rad.
    """
    other = -angle if side == "reversed" else angle
    rows = [f"X,Y,{x},,{-turn * x * 1e3:.3f},{side}," for x in (50.0, 250.0)]
    rows += [f"Y,X,{y},,{(skew + turn + other) * y * 1e3:.3f},{side}," for y in (50.0, 250.0)]
    return "\n".join(rows) + "\n"


def test_a_square_shows_squareness_whatever_way_it_lies(command, folder):
    """Y leans by 2 mrad towards +X, the exact square lies turned by 5 mrad."""
    text = DIAL_HEAD + "# u_square_urad: 30\n" + DIAL + square_rows(0.002, 0.0, 0.005, "1")
    effects, _, _ = fitted(command, folder, text)
    assert effects["E_C0Y"].value == pytest.approx(-2000.0, abs=5.0)
    # two legs of two readings, 5 um over 200 mm each, and the angle of the square; both axes may also bend
    straight = np.sqrt(2 * (5.0 * np.sqrt(2) / 0.2) ** 2 + 30.0**2)
    assert straight < effects["E_C0Y"].u[0] < 1.7 * straight


def test_the_square_turned_round_shows_its_own_error(command, folder):
    rows = square_rows(0.002, 0.0007, 0.001, "1") + square_rows(0.002, 0.0007, -0.003, "reversed")
    effects, _, _ = fitted(command, folder, DIAL_HEAD + DIAL + rows)
    assert effects["E_C0Y"].value == pytest.approx(-2000.0, abs=10.0)
    text = DIAL_HEAD + "# u_square_urad: 30\n" + DIAL + square_rows(0.002, 0.0007, 0.001, "1")
    alone, _, _ = fitted(command, folder, text)
    assert alone["E_C0Y"].value == pytest.approx(-2700.0, abs=10.0)


def test_a_dial_gauge_shows_backlash_and_bending(command, folder):
    """X turns back by 0.12 mm; along a wire that lies askew its line is a bow of 0.08 mm."""
    rows = [f"X,X,{x},{side},{x * 1e3 - (60 if side == '+' else -60)},,a" for x in (10, 12) for side in "+-+-"]
    rows += [f"X,Y,{x},,{7 * x * 0.1 + 80 * (1 - ((x - 200) / 200) ** 2):.2f},,w" for x in range(0, 401, 50)]
    effects, results, _ = fitted(command, folder, DIAL_HEAD + DIAL + "\n".join(rows) + "\n")
    assert abs(effects["backlash X"].parameters[0]) == pytest.approx(120.0, abs=5.0)
    motion = effects["E_YX"]
    bow = motion.basis.columns(np.array([0.0, 200.0, 400.0])) @ np.array(motion.parameters)
    assert bow[1] - (bow[0] + bow[2]) / 2 == pytest.approx(80.0, abs=8.0)
    assert results["after"]["rms_um"] < 5.0


def test_lengths_and_readings_in_one_file_and_with_other_files(command, folder):
    """The square and the diagonals of one machine agree, in one file and in two."""
    sides = ",,,,,,"
    head = HEAD + "# u_gauge_um: 5\n# u_square_urad: 30\n"
    skew = (851.0**2 - 846.5**2) / (4 * 600.0**2)
    readings = square_rows(skew, 0.0, 0.001, "1")
    lengths = "".join(f"{name},{cells},{sides}\n" for name, cells in HOLES.items())
    both = head + COLUMNS.strip() + "," + DIAL + lengths + "".join(f",,,,,,{row}\n" for row in readings.split())
    one, _, _ = fitted(command, folder, both)
    assert one["E_C0Y"].value == pytest.approx(-skew * 1e6, abs=60.0)
    assert one["E_C0Y"].u[0] < 100.0
    (folder / "square.csv").write_text(DIAL_HEAD + "# u_square_urad: 30\n" + DIAL + readings)
    (folder / "lengths.csv").write_text(text_of(HOLES))
    files = folder / "lengths.csv", folder / "square.csv"
    done = command("fit", *files, "-m", folder / "router.toml", "-o", folder / "two.json")
    assert done.status == 0, done.err
    model = read_model(folder / "two.json", ncomp.load_machine(folder / "router.toml"))
    (square,) = (effect for effect in model.effects if effect.name == "E_C0Y")
    assert square.value == pytest.approx(one["E_C0Y"].value, abs=20.0)
    assert square.u[0] == pytest.approx(one["E_C0Y"].u[0], rel=0.2)


# ---- mistakes


def changed(name: str, cells: str) -> str:
    return text_of(HOLES | {name: cells})


INCHES = {
    name: f"{cells.rpartition(',')[0]},{float(cells.rpartition(',')[2]) / 25.4:.4f}" for name, cells in HOLES.items()
}
MORE = {"BC": "600,0,600,600,600.4"}
MISTAKES = {
    "zero": (changed("AD", "0,0,0,600,0"), "lengths.csv:8 column length_mm: 0 is not above 0: correct it"),
    "negative": (changed("AD", "0,0,0,600,-601"), "lengths.csv:8 column length_mm: -601 is not above 0"),
    "equal ends": (changed("AD", "0,600,0,600,601"), "lengths.csv:8 column X2: both ends are at the same position"),
    "no number": (changed("AD", "0,0,0,600,6o1"), "lengths.csv:8 column length_mm: '6o1' is no number"),
    "inches": (text_of(INCHES), "lengths.csv: line 6: AB: 23.6024 between positions 600 mm apart, and the same factor in all rows: the lengths are in inches; write them in mm"),
    "exchanged": (
        text_of(HOLES | {"AC": "0,0,0,600,851", "AD": "0,0,600,600,601"}),
        "line 9: AC: 851 mm between positions 600 mm apart: it fits the positions of AD or BD: are the positions of two rows exchanged?",
    ),
    "without names": (
        HEAD + COLUMNS.removeprefix("name,") + "0,0,600,0,601\n0,0,0,500,600.5\n",
        "lengths.csv: line 7: 600.5 mm between positions 500 mm apart: it fits the positions of line 6: are the positions",
    ),
    "one wrong": (
        text_of(HOLES | MORE | {"AB": "0,0,600,0,589.5"}),
        "lengths.csv: line 6: AB: 589.5 mm contradicts the other lengths, which say 599.96 mm",
    ),
    "any wrong": (changed("AC", "0,0,600,600,831"), "the lengths contradict each other by about"),
    "no u": (text_of(HOLES, HEAD.replace("250", "0")), "standard uncertainty (k=1) of the lengths is missing: state u_um or u_um_per_m"),
    "no positions": (changed("AD", ",,,,601"), "lengths.csv:8 column X1: the row has no positions"),
    "other column": (text_of(HOLES).replace("length_mm", "length"), "expected the column length_mm"),
    "empty": (changed("AD", "0,0,0,600,"), "lengths.csv:8 column length_mm: empty: fill in what was measured, or delete the row"),
    "one leg": (
        DIAL_HEAD + "# u_square_urad: 30\n" + DIAL + "Y,X,50,,0,1,\nY,X,250,,400,1,\n",
        "square 1 has readings of Y read along X: a square has two legs",
    ),
    "unknown square": (DIAL_HEAD + DIAL + square_rows(0.001, 0.0, 0.0, "1"), "header line '# u_square_urad: ...' is missing"),
    "along": (DIAL_HEAD + DIAL + "Y,up,50,,0,,\n", "lengths.csv:5 column along: 'UP' is none of X, Y and Z"),
    "axis": (DIAL_HEAD + DIAL + "U,X,50,,0,,\n", "lengths.csv:5 column axis: 'U' is none of X, Y, Z"),
    "square word": (DIAL_HEAD + DIAL + "Y,X,50,,0,maybe,\n", "lengths.csv:5 column square: 'maybe' is none of 1 (against a square), reversed"),
}  # fmt: skip


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_named_with_its_row_and_its_cure(command, folder, name):
    text, words = MISTAKES[name]
    assert words in refused(command, folder, text)


def test_positions_outside_the_travel_are_noted(command, folder):
    far = {name: cells.replace("600", "900") for name, cells in HOLES.items()}
    scaled = {n: f"{c.rpartition(',')[0]},{float(HOLES[n].rpartition(',')[2]) * 1.5}" for n, c in far.items()}
    _, _, printed = fitted(command, folder, text_of(scaled))
    assert "X leaves its travel 0..800 mm by 100 mm" in " ".join(printed.split())


# ---- a virtual ruler


def test_rectangles_are_planned_and_measured_by_a_virtual_ruler(command, folder):
    location = "location:component=C,axis=Y,value=-4000"
    machine = "--machine", folder / "router.toml"
    given = "--strategy", "rectangles", "--instrument", "lengths", "--errors", "none", "--effect", location
    done = command("simulate", *machine, *given, "-o", folder / "data.csv", "--range", "Z=0:0", "--seed", "3")
    assert done.status == 0, done.err
    lines = [line for line in (folder / "data.csv").read_text().splitlines() if not line.startswith("#")]
    assert lines[0] == "name,X1,Y1,Z1,X2,Y2,Z2,length_mm"
    assert len(lines) == 7
    diagonals = [float(line.rpartition(",")[2]) for line in lines[5:]]
    assert diagonals[0] - diagonals[1] == pytest.approx(0.004 * 800 * np.sqrt(2), abs=1.5)
    effects, _, _ = fitted(command, folder, (folder / "data.csv").read_text())
    assert effects["E_C0Y"].value == pytest.approx(-4000.0, abs=3 * effects["E_C0Y"].u[0])


def test_a_written_file_is_read_back(folder):
    machine = ncomp.load_machine(folder / "router.toml")
    path, again = folder / "a.csv", folder / "b.csv"
    sides = ",,,,,,"
    lengths = "".join(f"{name},{cells},{sides}\n" for name, cells in HOLES.items())
    readings = (
        "".join(f",,,,,,{row}\n" for row in square_rows(0.001, 0.0, 0.002, "1").split()) + ",,,,,,X,Y,5,-,3.5,,w\n"
    )
    path.write_text(HEAD + "# u_gauge_um: 5\n# u_square_urad: 30\n" + COLUMNS.strip() + "," + DIAL + lengths + readings)
    first = ncomp.read_measurement(path, machine)
    ncomp.save(first, again)
    second = ncomp.read_measurement(again, machine)
    assert second.observed == pytest.approx(first.observed)
    assert second.state.positions == pytest.approx(first.state.positions)
    assert second.scatter == pytest.approx(first.scatter)
    assert second.state.approach.tolist() == first.state.approach.tolist()
    assert second.run.tolist() == first.run.tolist()


@pytest.mark.statistical
@pytest.mark.parametrize("count", [3, 8, 20])
def test_uncertainties_hold_for_few_readings(count):
    """In units of their standard uncertainties the errors are as large as they should be; chi2 of the draws, p = 1e-4."""
    draws = 30
    for name, off in benchmark.errors(count, draws, seed=7).items():
        assert 0.6 < np.sqrt(np.mean(off**2)) < 1.5, name


@pytest.mark.statistical
def test_the_uncertainties_cover_95_of_100_draws():
    for count in benchmark.READINGS:
        for name, off in benchmark.errors(count, 200, seed=11).items():
            within = np.mean(np.abs(off) < 1.96)
            assert 0.90 < within < 0.99, f"{count} readings: {name}: {within}"


def test_one_length_alone_is_enough_for_the_scale_of_one_axis(command, folder):
    effects, _, _ = fitted(command, folder, text_of({"AB": HOLES["AB"]}))
    assert slope(effects["E_XX"]) == pytest.approx(-500.0 / 0.6, rel=0.05)


def test_an_odd_number_of_positions_is_no_set_of_lengths(command, folder):
    machine = "--machine", folder / "router.toml"
    given = "--strategy", "random", "--points", "7", "--instrument", "lengths"
    done = command("simulate", *machine, *given, "-o", folder / "data.csv")
    assert done.status == 2
    assert "the plan has 7 rows, not pairs" in done.err


def test_the_public_functions_name_the_mistake(folder):
    (folder / "lengths.csv").write_text(changed("AD", "0,0,0,600,0"))
    with pytest.raises(UserError, match="is not above 0"):
        ncomp.read_measurement(folder / "lengths.csv", folder / "router.toml")
