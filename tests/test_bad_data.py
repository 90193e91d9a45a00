"""Bad data never end as a calibration: every mistake is refused in a sentence by every command that writes one.

The files are those of the shop: a good one is spoiled as text, and handed to the command.
"""

import csv
import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from support.command import refusal, run_command, succeed
from support.three_points_cases import measured, model, random_effects, station
from support.tiers import STATISTICAL, quick

import machines
from calibration.measurement.written_file import write_measurement

TRACKER = ("--tracker=-700,-900,300", "-u", "u_range_um=0.5", "-u", "u_angle_um=3", "-u", "u_angle_um_per_m=3")
TARGETS = ("--target", "t1=0,0,-120", "--target", "t2=90,40,-180", "--target", "t3=-60,80,-100")
SIMULATED = {
    "cframe": ("--machine", "cframe", "--strategy", "random", "--points", "40", *TARGETS, *TRACKER),
    "dmu50": (
        *("--machine", "dmu50", "--strategy", "space-filling", "--points", "50", "--rotary", "simultaneous"),
        *("--range", "C=0:360", *TARGETS, *TRACKER),
    ),
    "laser": (
        *("--machine", "cframe", "--strategy", "axes", "--points", "33", "--runs", "3"),
        *("--instrument", "interferometer", "-u", "u_um=0.3"),
    ),
    "part": ("--machine", "cframe", "--strategy", "grid", "--points", "60", "--instrument", "part", "-u", "u_um=1"),
}
MACHINE = {"cframe": "cframe", "dmu50": "dmu50", "laser": "cframe", "part": "cframe", "rounds": "dmu50"}
Lines = tuple[list[str], list[str], list[list[str]]]
"""Header lines, names of columns, rows."""
Spoil = Callable[[list[str], list[str], list[list[str]]], Lines]


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> dict[str, Path]:
    """Measurement files without a mistake, by name."""
    folder = tmp_path_factory.mktemp("good")
    files = {name: folder / f"{name}.csv" for name in MACHINE}
    for name, options in SIMULATED.items():
        order = ("--target-order", "alternating") if options.count("--target") > 1 else ()
        succeed("simulate", *options, *order, "-o", files[name])
    dmu50 = machines.load("dmu50")
    front = {"1": station((200.0, -1500.0, -300.0), 0.4)}
    with files["rounds"].open("wb") as file:
        write_measurement(measured(dmu50, model(dmu50, random_effects(3, size=6.0)), front), file)
    return files


def spoiled(path: Path, spoil: Spoil, into: Path) -> Path:
    """The file with a mistake in it."""
    lines = path.read_text().splitlines()
    head = [line for line in lines if line.startswith("#")]
    names, *rows = list(csv.reader(lines[len(head) :]))
    head, names, rows = spoil(head, names, rows)
    into.write_text("\n".join([*head, ",".join(names), *(",".join(row) for row in rows)]) + "\n")
    return into


def arguments(command: str, data: Path, machine: str, output: Path, *options: object) -> tuple[object, ...]:
    """Arguments of a command that makes a calibration from data."""
    return (command, data, "--machine", machine, "-o", output, *options)


# ---- mistakes


def times(factor: float, *columns: str) -> Spoil:
    def spoil(head, names, rows):
        where = [names.index(name) for name in columns]
        return head, names, [[str(float(v) * factor) if i in where else v for i, v in enumerate(row)] for row in rows]

    return spoil


def exchanged(one: str, other: str) -> Spoil:
    return lambda head, names, rows: (head, [{one: other, other: one}.get(name, name) for name in names], rows)


def only(number: int) -> Spoil:
    return lambda head, names, rows: (head, names, rows[:number])


def constant(*columns: str) -> Spoil:
    def spoil(head, names, rows):
        where = [names.index(name) for name in columns]
        return head, names, [["100.0" if i in where else v for i, v in enumerate(row)] for row in rows]

    return spoil


def repeated(head, names, rows):
    """One point, at later and later times."""
    return (
        head,
        names,
        [[str(15.0 * i) if name == "time_s" else v for name, v in zip(names, rows[3], strict=True)] for i in range(60)],
    )


def not_a_number(head, names, rows):
    return head, names, [*rows[:5], [*rows[5][:-1], "nan"], *rows[6:]]


def two_sessions(head, names, rows):
    """Halfway the instrument was set up anew, and nobody wrote it down."""
    where = {names.index(name): by for name, by in zip("xyz", (120.0, -45.0, 30.0), strict=True)}
    half = len(rows) // 2
    moved = [[str(float(v) + where.get(i, 0.0)) if i in where else v for i, v in enumerate(row)] for row in rows[half:]]
    return head, names, [*rows[:half], *moved]


def of_other_positions(head, names, rows):
    """The observations one row late."""
    where = [i for i, name in enumerate(names) if name in ("x", "y", "z")]
    late = [[rows[n - 1][i] if i in where else v for i, v in enumerate(row)] for n, row in enumerate(rows)]
    return head, names, late[1:]


def header(pattern: str, by: str) -> Spoil:
    return lambda head, names, rows: ([re.sub(pattern, by, line) for line in head], names, rows)


POINTS = {
    "inch observed": (times(1 / 25.4, *"xyz"), "inch and mm mixed up"),
    "inch commanded": (times(1 / 25.4, *"XYZ"), "inch and mm mixed up"),
    "um observed": (times(1e3, *"xyz"), "m, mm or um mixed up"),
    "axes exchanged": (exchanged("X", "Y"), "with columns X and Y exchanged"),
    "observed exchanged": (exchanged("x", "y"), "mirrored"),
    "sign of an axis": (times(-1.0, "X"), "with the sign of X reversed"),
    "sign of an observed column": (times(-1.0, "z"), "mirrored"),
    "one observed column constant": (constant("x"), "no exchange of columns"),
    "all observed columns constant": (constant(*"xyz"), "observations are the same"),
    "not a number": (not_a_number, "is no number"),
    "two sessions in one": (two_sessions, "no exchange of columns"),
    "observations one row late": (of_other_positions, "no exchange of columns"),
    "no rows": (only(0), "no rows"),
}
RADIANS = {
    "degrees as radians": (times(np.pi / 180.0, "B", "C"), "with C and B read as rad"),
    "sign of a rotary axis": (times(-1.0, "C"), "with the sign of C reversed"),
    "rotary axes exchanged": (exchanged("B", "C"), "with columns C and B exchanged"),
}
TOOL = {
    "tool 10 mm shorter": (header(r"(target.t1: \S+ \S+) -120", r"\1 -110"), "with target t1 at"),
    "sign of the tool": (header(r"(target.t\d: \S+ \S+) -", r"\1 "), "sign of z of all targets"),
    "another tool": (header(r"(target.t\d): .*", r"\1: 0 0 0"), "no exchange of columns"),
    "one point, many times": (repeated, "no axis moves"),
    "six rows": (only(6), "measure about"),
    "nine rows of three positions": (only(9), "measure about"),
    "a machine of another kind": (header(r"machine: \w+", "machine: other"), "other"),
}
LASER = {
    "readings for deviations": (times(1e3, "deviation_um"), "instead of deviations"),
    "axes exchanged": (exchanged("X", "Y"), "differs from the target"),
    "dead instrument": (constant("deviation_um"), "observations are the same"),
    # six readings of an axis show a slope, and that it predicts the readings that are left out
    "four rows": (only(4), "predicts held-out"),
    "not a number": (not_a_number, "is no number"),
}
COMMANDS = {"fit": ("cframe", "dmu50", "laser", "part"), "diagnose": ("cframe", "laser"), "three-points": ("rounds",)}
MISTAKES = {
    "cframe": POINTS | TOOL,
    "dmu50": RADIANS | {"six rows": TOOL["six rows"]},
    "laser": LASER,
    "part": {name: POINTS[name] for name in ("two sessions in one", "not a number", "observations one row late")},
    "rounds": POINTS | RADIANS,
}
FEW = {"diagnose": ("two sessions in one", "dead instrument"), "three-points": ("axes exchanged", "not a number")}
"""What the commands beside `fit` are asked in the default tiers."""
DIAGNOSED = ("inch observed", "axes exchanged", "two sessions in one", "six rows", "dead instrument", "not a number")
"""What `diagnose` is asked too: it looks at the data by the same function."""
FIRST = {case[1]: (data, name) for data in reversed(MISTAKES) for name, case in reversed(list(MISTAKES[data].items()))}
"""By sentence: data and mistake that `fit` is asked in the default tiers."""
CASES = [
    pytest.param(
        command,
        data,
        *case,
        id=f"{command}-{data}-{name}",
        marks=[]
        if name in FEW.get(command, ()) or (command == "fit" and FIRST[case[1]] == (data, name))
        else [STATISTICAL],
    )
    for command, files in COMMANDS.items()
    for data in files
    for name, case in MISTAKES[data].items()
    if command != "diagnose" or name in DIAGNOSED
] + [pytest.param("diagnose", "laser", only(4), "repeat the runs", id="diagnose-laser-four rows", marks=STATISTICAL)]


@pytest.mark.parametrize(("command", "data", "spoil", "sentence"), CASES)
def test_a_mistake_is_refused_in_a_sentence_and_nothing_written(good, tmp_path, command, data, spoil, sentence):
    path, output = spoiled(good[data], spoil, tmp_path / "bad.csv"), tmp_path / "cal.json"
    message = refusal(*arguments(command, path, MACHINE[data], output))
    assert sentence in message
    assert str(path) in message
    assert not output.exists()


@pytest.mark.parametrize("data", quick(["cframe", "laser", "part"], ["laser", "part"]))
def test_good_data_are_fitted_and_predicted_better_than_by_the_nominal_machine(good, tmp_path, data):
    output = tmp_path / "cal.json"
    done = succeed(*arguments("fit", good[data], MACHINE[data], output, "--json", tmp_path / "fit.json"))
    figures = json.loads((tmp_path / "fit.json").read_text())
    assert figures["after"]["heldout_rms_um"] < figures["before"]["rms_um"]
    assert figures["significant_share"] > 0.5
    assert "NOT SIGNIFICANT" not in done.shown


def test_a_fit_that_predicts_worse_than_nothing_is_not_written(good, tmp_path):
    """Deviations of an interferometer in no order: no machine moves like that."""

    def shuffled(head, names, rows):
        column = names.index("deviation_um")
        order = np.random.default_rng(0).permutation(len(rows))
        return (
            head,
            names,
            [[rows[n][i] if i == column else v for i, v in enumerate(row)] for row, n in zip(rows, order, strict=True)],
        )

    path = spoiled(good["laser"], shuffled, tmp_path / "bad.csv")
    for command in ("fit", "diagnose"):
        assert "worse" in refusal(*arguments(command, path, "cframe", tmp_path / "cal.json"))
        assert not (tmp_path / "cal.json").exists()


def test_an_instrument_that_is_far_more_certain_than_stated_is_said(good, tmp_path):
    """By a thousand times: the residuals contradict the header, and their noise is that of the fit."""
    uncertain = header(r"(u_\w+): (\S+)", r"\1: \g<2>e3")
    path = spoiled(good["part"], uncertain, tmp_path / "bad.csv")
    done = run_command(*arguments("fit", path, "cframe", tmp_path / "cal.json"))
    assert done.status == 0, done.err
    assert "by the instrument specification, which the residuals contradict" in done.shown
    assert re.search(r"The instrument scatters less than 0\.1 times as much as specified", done.shown)


def test_commands_in_a_small_part_of_the_travel_are_asked_for_their_unit(good, tmp_path):
    path = spoiled(
        good["part"], times(1 / 25.4, *"XYZ", *"xyz", "nominal_x", "nominal_y", "nominal_z"), tmp_path / "b.csv"
    )
    done = run_command(*arguments("fit", path, "cframe", tmp_path / "cal.json"))
    assert "is the unit of the commands right (inch or m)?" in done.shown


# ---- other machines


def drawn(*, spread: float) -> Spoil:
    """Observations that are nothing but noise, mm."""

    def spoil(head, names, rows):
        rng, where = np.random.default_rng(0), [i for i, name in enumerate(names) if name in ("x", "y", "z")]
        return head, names, [[str(rng.normal(0, spread)) if i in where else v for i, v in enumerate(r)] for r in rows]

    return spoil


def at_one_position(head, names, rows):
    where = [i for i, name in enumerate(names) if re.fullmatch("[A-CX-Z]", name)]
    return head, names, [[rows[0][i] if i in where else v for i, v in enumerate(row)] for row in rows]


def backwards(head, names, rows):
    return head, names, rows[::-1]


def decimal_commas(head, names, rows):
    return head, names, [[value.replace(".", ",") for value in row] for row in rows]


def cell(text: str) -> Spoil:
    return lambda head, names, rows: (head, names, [*rows[:5], [*rows[5][:-2], text, rows[5][-1]], *rows[6:]])


OTHERS = {
    "gantry": (
        *("--machine", "gantry", "--strategy", "random", "--points", "60", "--tracker=-1500,1500,300"),
        *(*TARGETS, "-u", "u_range_um=0.5", "-u", "u_angle_um=3", "-u", "u_angle_um_per_m=3"),
    ),
    "trunnion_ac": (
        *("--machine", "trunnion_ac", "--strategy", "space-filling", "--points", "60", "--rotary", "simultaneous"),
        *("--range", "C=0:360", *TARGETS, *TRACKER),
    ),
}
ANYWHERE = POINTS | {
    "um commanded": (times(1e3, *"XYZ"), "m, mm or um mixed up"),
    "target metres off": (header(r"(target.t1: \S+ \S+) -120", r"\1 -9120"), "target t1 lies"),
    "noise alone": (drawn(spread=0.01), "no exchange of columns"),
    "one position": (at_one_position, "no exchange of columns"),
    "time backwards": (backwards, "sort them by time"),
    "decimal commas": (decimal_commas, "a decimal comma?"),
    "infinite": (cell("inf"), "is no number"),
    "empty": (cell(""), "empty"),
    "six rows": (only(6), "measure about"),
}
TURNING = {
    "radians": (times(np.pi / 180.0, "C"), "with C read as rad"),
    "radians of the other": (times(np.pi / 180.0, "A"), "with A read as rad"),
    "sign of C": (times(-1.0, "C"), "with the sign of C reversed"),
    "rotary axes exchanged": (exchanged("A", "C"), "with columns C and A exchanged"),
}


OWN = {"gantry": ANYWHERE.keys() - (POINTS | TOOL).keys() - {"one position"}, "trunnion_ac": {"radians of the other"}}
"""Mistakes by machine in the default tiers: the others are asked of the machines above."""


@pytest.fixture(scope="module")
def others(tmp_path_factory) -> dict[str, Path]:
    """Measurement files of other machines, by machine."""
    folder = tmp_path_factory.mktemp("others")
    for name, options in OTHERS.items():
        succeed("simulate", *options, "-o", folder / name)
    return {name: folder / name for name in OTHERS}


@pytest.mark.parametrize(
    ("machine", "spoil", "sentence"),
    [
        pytest.param(
            machine,
            *case,
            id=f"{machine}-{name}",
            marks=[] if name in OWN[machine] else [STATISTICAL],
        )
        for machine in OTHERS
        for name, case in (ANYWHERE | (TURNING if machine == "trunnion_ac" else {})).items()
    ],
)
def test_mistakes_are_refused_on_other_machines(others, tmp_path, machine, spoil, sentence):
    path, output = spoiled(others[machine], spoil, tmp_path / "bad.csv"), tmp_path / "cal.json"
    assert sentence in refusal(*arguments("fit", path, machine, output))
    assert not output.exists()


def some_off(head, names, rows):
    """Every fifth row 50 mm off."""
    rng, where = np.random.default_rng(0), [i for i, name in enumerate(names) if name in ("x", "y", "z")]
    return (
        head,
        names,
        [
            [str(float(v) + rng.normal(0, 50)) if i in where and n % 25 == 0 else v for i, v in enumerate(row)]
            for n, row in enumerate(rows)
        ],
    )


@pytest.mark.parametrize(
    ("spoil", "key", "number"),
    [(some_off, "outliers", 3), (lambda head, names, rows: (head, names, [*rows, *rows]), "copies", 64)],
    ids=["outliers", "rows twice"],
)
def test_outliers_and_copies_are_left_out_and_listed(good, tmp_path, spoil, key, number):
    path = spoiled(good["part"], spoil, tmp_path / "bad.csv")
    succeed(*arguments("fit", path, "cframe", tmp_path / "cal.json", "--json", tmp_path / "fit.json"))
    figures = json.loads((tmp_path / "fit.json").read_text())
    assert len(figures[key]) == number
    assert figures["after"]["heldout_rms_um"] < figures["before"]["rms_um"]


# ---- on the fly

PATH = "G21 G90 G17\nG0 X0 Y0 Z0\nF6000\nG1 X600 Z300\nG1 Y600 Z0\nG1 X0 Z300\nG1 X600 Y300 Z100\nG1 X0 Y0 Z0\nM30\n"
FLYING = {
    "inch": (times(1 / 25.4, *"xyz"), "is it another program?"),
    "um": (times(1e3, *"xyz"), "is it another program?"),
    "left-handed": (times(-1.0, "y"), "away from the path of the program"),
    "noise alone": (drawn(spread=0.01), "is it another program?"),
    "half of it": (lambda head, names, rows: (head, names, rows[: len(rows) // 2]), "is it another program?"),
    "target metres off": (header(r"(target.t: \S+ \S+) \S+", r"\1 -9120"), "target t lies"),
    "time backwards": (backwards, "not later than in the row before"),
    "rows twice": (lambda head, names, rows: (head, names, [*rows, *rows]), "not later than in the row before"),
    "not a number": (not_a_number, "is no number"),
    "six rows": (only(6), "too few to follow a path"),
    "dead instrument": (constant(*"xyz"), "is it another program?"),
    "no uncertainty": (
        lambda head, names, rows: ([line for line in head if "u_" not in line], names, rows),
        "standard uncertainty",
    ),
}


@pytest.fixture(scope="module")
def flying(tmp_path_factory) -> tuple[Path, Path]:
    """Readings taken on the fly, and the program."""
    folder = tmp_path_factory.mktemp("flying")
    data, program = folder / "points.csv", folder / "path.nc"
    program.write_text(PATH)
    options = ("--machine", "cframe", "--path", str(program), "--target", "t=0,0,-100", "--feed", "6000")
    succeed("simulate", *options, *TRACKER, "--rate", "50", "-o", data)
    return data, program


@pytest.mark.parametrize("name", FLYING)
def test_a_mistake_of_data_taken_on_the_fly_is_refused(flying, tmp_path, name):
    spoil, sentence = FLYING[name]
    data, program = flying
    path, output = spoiled(data, spoil, tmp_path / "bad.csv"), tmp_path / "cal.json"
    assert sentence in refusal(*arguments("fit", path, "cframe", output, "--path", program))
    assert not output.exists()


# ---- continuous runs


def steps(head, names, rows):
    """Every fifth sample 30 mm off."""
    return head, names, [[row[0], str(float(row[1]) + 30.0 * (i % 5 == 0))] for i, row in enumerate(rows)]


def random_readings(head, names, rows):
    rng, where = np.random.default_rng(0), names.index("deviation_um")
    return head, names, [[str(rng.normal(0, 100)) if i == where else v for i, v in enumerate(row)] for row in rows]


UNEXPLAINED = "the runs do not explain them"
RUN = {
    "inch": (times(1 / 25.4, "displacement_mm"), "or the unit"),
    "um": (times(1e3, "displacement_mm"), "or the unit"),
    "sign": (times(-1.0, "displacement_mm"), "reverse its sign"),
    "dead instrument": (constant("displacement_mm"), "the axis did not move"),
    "steps": (steps, UNEXPLAINED),
    "time backwards": (backwards, "does not follow"),
    "columns exchanged": (exchanged("time_s", "displacement_mm"), "does not follow"),
    "not a number": (not_a_number, "is no number"),
    "decimal commas": (decimal_commas, "a decimal comma?"),
    "six rows": (only(6), "at least 100 needed"),
}
READINGS = {
    "readings for deviations": (times(1e3, "deviation_um"), "or the unit"),
    "mm for um": (times(1e-3, "deviation_um"), UNEXPLAINED),
    "inch": (times(1 / 25.4, "deviation_um"), UNEXPLAINED),
    "sign": (times(-1.0, "deviation_um"), UNEXPLAINED),
    "noise alone": (random_readings, UNEXPLAINED),
    "another axis": (lambda head, names, rows: (head, names, [["Y" if v == "X" else v for v in r] for r in rows]), "X"),
    "two rows": (only(2), "at least 2 are needed"),
    "dead instrument": (constant("deviation_um"), "the instrument did not measure"),
}


@pytest.fixture(scope="module")
def continuous(tmp_path_factory) -> tuple[Path, Path]:
    """A continuous run, and readings at targets."""
    folder = tmp_path_factory.mktemp("continuous")
    moving, standing = folder / "run.csv", folder / "targets.csv"
    options = [
        "--machine",
        "cframe",
        "--axis",
        "X",
        "--start-mm",
        "0",
        "--end-mm",
        "450",
        "--feed",
        "5000",
        "--rate",
        "200",
        "--spacing",
        "45",
    ]
    files = ("-o", str(moving), "--quasistatic", str(standing))
    succeed("simulate-continuous", *options, *files)
    return moving, standing


@pytest.mark.parametrize(
    ("number", "spoil", "sentence"),
    [pytest.param(number, *case, id=name) for number, of in enumerate((RUN, READINGS)) for name, case in of.items()],
)
def test_a_mistake_of_a_continuous_run_or_its_readings_is_refused(continuous, tmp_path, number, spoil, sentence):
    files = list(continuous)
    files[number] = spoiled(files[number], spoil, tmp_path / "bad.csv")
    table, calibration = tmp_path / "table.csv", tmp_path / "cal.json"
    more = ("--machine", "cframe", "--write-calibration", str(calibration))
    assert sentence in refusal("continuous", *files, "-o", table, *more)
    assert not table.exists()
    assert not calibration.exists()


# ---- a tracker's tests

TESTS = "test,range_mm,range_2_mm,length_mm,error_um\n" + "".join(
    f"ranging,2000,{r},,{e}\nlength,{r},,2300,{-4 * e}\ntwo-face,{r},,,{9 * e}\n"
    for r, e in ((4000, 0.8), (6000, -1.2), (8000, 1.5), (10000, -1.4))
)


@pytest.mark.parametrize(
    ("pattern", "by", "sentence"),
    [
        (r",([-\d.]+)\n", lambda found: f",{float(found[1]) * 1e-4}\n", "um?"),
        (r",([-\d.]+)\n", lambda found: f",{float(found[1]) * 1e3}\n", "um?"),
        (r",[-\d.]+\n", ",0\n", "um?"),
        ("000,", ",", "mm?"),
        ("-1.2", "nan", "is no number"),
        ("-1.2", "1e9", "um?"),
        (r"\.", ",", "a decimal comma?"),
        ("two-face", "2-face", "is none of"),
        (r"\n(length|two-face)[^\n]*", "", "are needed"),
    ],
)
def test_a_mistake_in_the_tests_of_a_tracker_is_refused(tmp_path, pattern, by, sentence):
    path, output = tmp_path / "tests.csv", tmp_path / "tracker.toml"
    path.write_text(re.sub(pattern, by, TESTS))
    assert sentence in refusal("tracker", path, "-o", output)
    assert not output.exists()
