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
from three_points_data import measured, model, random_effects, station
from typer.testing import CliRunner, Result

import machines
from calibration.measurement_file import write_measurement
from kinematics.errors import UserError
from postproc.cli import app

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
        done = CliRunner().invoke(app, ["simulate", *options, "--target-order", "alternating", "-o", str(files[name])])
        assert done.exit_code == 0, done.exception
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


def run(command: str, data: Path, machine: str, output: Path, *options: str) -> Result:
    return CliRunner().invoke(app, [command, str(data), "--machine", machine, "-o", str(output), *options])


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
    "twelve rows of four positions": (only(12), "measure about"),
    "a machine of another kind": (header(r"machine: \w+", "machine: other"), "other"),
}
LASER = {
    "readings for deviations": (times(1e3, "deviation_um"), "instead of deviations"),
    "axes exchanged": (exchanged("X", "Y"), "differs from the target"),
    "dead instrument": (constant("deviation_um"), "observations are the same"),
    "six rows": (only(6), "repeat the runs"),
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
DIAGNOSED = ("inch observed", "axes exchanged", "two sessions in one", "six rows", "dead instrument", "not a number")
"""What `diagnose` is asked too: it looks at the data by the same function."""
CASES = [
    pytest.param(command, data, *case, id=f"{command}-{data}-{name}")
    for command, files in COMMANDS.items()
    for data in files
    for name, case in MISTAKES[data].items()
    if command != "diagnose" or name in DIAGNOSED
]


@pytest.mark.parametrize(("command", "data", "spoil", "sentence"), CASES)
def test_a_mistake_is_refused_in_a_sentence_and_nothing_written(good, tmp_path, command, data, spoil, sentence):
    path, output = spoiled(good[data], spoil, tmp_path / "bad.csv"), tmp_path / "cal.json"
    done = run(command, path, MACHINE[data], output)
    assert isinstance(done.exception, UserError), done.exception
    assert sentence in str(done.exception)
    assert str(path) in str(done.exception)
    assert not output.exists()


@pytest.mark.parametrize("data", ["cframe", "laser", "part"])
def test_good_data_are_fitted_and_predicted_better_than_by_the_nominal_machine(good, tmp_path, data):
    output = tmp_path / "cal.json"
    done = run("fit", good[data], MACHINE[data], output, "--json", str(tmp_path / "fit.json"))
    assert done.exit_code == 0, done.exception
    figures = json.loads((tmp_path / "fit.json").read_text())
    assert figures["after"]["heldout_rms_um"] < figures["before"]["rms_um"]
    assert figures["significant_share"] > 0.5
    assert "NOT SIGNIFICANT" not in done.output


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
        done = run(command, path, "cframe", tmp_path / "cal.json")
        assert isinstance(done.exception, UserError)
        assert "worse" in str(done.exception)
        assert not (tmp_path / "cal.json").exists()


def test_a_correction_that_is_mostly_not_significant_says_so_first(good, tmp_path):
    """An instrument that is a thousand times less certain."""
    uncertain = header(r"(u_\w+): (\S+)", r"\1: \g<2>e3")
    done = run("fit", spoiled(good["part"], uncertain, tmp_path / "bad.csv"), "cframe", tmp_path / "cal.json")
    if done.exit_code:
        assert "worse" in str(done.exception)
    else:
        assert done.stdout.startswith("NOT SIGNIFICANT")


def test_commands_in_a_small_part_of_the_travel_are_asked_for_their_unit(good, tmp_path):
    path = spoiled(
        good["part"], times(1 / 25.4, *"XYZ", *"xyz", "nominal_x", "nominal_y", "nominal_z"), tmp_path / "b.csv"
    )
    done = run("fit", path, "cframe", tmp_path / "cal.json")
    assert "is the unit of the commands right (inch or m)?" in (done.stdout or str(done.exception))


def test_a_dead_instrument_beside_a_continuous_run_is_refused(tmp_path):
    run_file, targets, table = (str(tmp_path / name) for name in ("run.csv", "targets.csv", "table.csv"))
    simulated = (
        "--axis",
        "X",
        "--start-mm",
        "0",
        "--end-mm",
        "450",
        "--feed",
        "5000",
        "--rate",
        "500",
        "--spacing",
        "45",
    )
    files = ("-o", run_file, "--quasistatic", targets)
    assert CliRunner().invoke(app, ["simulate-continuous", "--machine", "cframe", *simulated, *files]).exit_code == 0
    spoiled(Path(targets), constant("deviation_um"), Path(targets))
    done = CliRunner().invoke(app, ["continuous", run_file, targets, "-o", table])
    assert isinstance(done.exception, UserError)
    assert "the instrument did not measure" in str(done.exception)
    assert not Path(table).exists()
