"""Every command that writes a calibration marks one that was made from simulated data, and no other one."""

import itertools
import shlex
from pathlib import Path

import msgspec
import numpy as np
import pytest
from support.command import succeed
from support.three_points_cases import QUIET, measured, model, random_effects, station
from support.tiers import quick

import machines
from calibration.measurement.written_file import write_measurement
from kinematics.error_model.model import decode_model, write_model

COMMANDS = Path(__file__).parents[1] / "postproc" / "commands"
CFRAME = machines.load("cframe")
WRITERS = ("encode_model(", "write_model(", "calibration_file(")
"""Functions that write a calibration."""
M = "--machine cframe"
POINTS = f"simulate {M} --strategy random --points 20 --target t1=0,0,-120 --target t2=90,40,-180 --seed"
RUNS = (
    f"simulate-continuous {M} --axis X --start-mm 0 --end-mm 450 --feed 5000 --spacing 90 "
    "-o run.csv --quasistatic targets.csv"
)
PATH = "G21 G90\nG0 X0 Y0 Z0\nG1 X600 F2500\nY450\nZ300\nX0\nY0\nZ0\nX600 Y450 Z300\nM30\n"
FIT = f"fit a.csv {M} --basis legendre:1 -o cal.json"
JOIN = f"continuous run.csv targets.csv -o table.csv {M} --write-calibration cal.json"
TABLES = f"export {M} -c made.json --format linuxcnc -o tables"
CASES = {
    "fit": ("fit", (f"{POINTS} 1 -o a.csv",), FIT),
    "fit of two files": (
        "fit",
        (f"{POINTS} 1 -o a.csv", f"{POINTS} 2 -o b.csv"),
        FIT.replace("a.csv", "a.csv b.csv"),
    ),
    "fit on the fly": (
        "fit",
        (f"simulate {M} --path path.nc --target t=0,0,-100 --feed 2500 --rate 20 -o fly.csv",),
        f"fit fly.csv {M} --path path.nc --basis legendre:1 --corner-mm 1 --force -o cal.json",
    ),
    "diagnose": ("diagnose", (f"{POINTS} 1 -o a.csv",), f"diagnose a.csv {M} -o cal.json"),
    "diagnose with a calibration": (
        "diagnose",
        (f"{POINTS} 1 -o a.csv",),
        f"diagnose a.csv {M} -c real.json --force -o cal.json",
    ),
    "continuous": ("continuous", (RUNS,), JOIN),
    "continuous into a calibration": ("continuous", (RUNS,), f"{JOIN} --add-to real.json"),
    "three-points": ("three_points", (), "three-points rounds.csv --machine dmu50 --degree XX=2 -o cal.json"),
    "drift": ("drift", (), "drift touches.csv --machine dmu50 -c none -o cal.json"),
    "export": ("export", (), f"{TABLES} --rest cal.json"),
    "export of parameters": (
        "export",
        (),
        "export --machine dmu50 -c made.json --format fanuc-kinematics -o tables --rest cal.json",
    ),
    "import": ("import_tables", (), f"import tables {M} --format linuxcnc --less-tables-from made.json -o cal.json"),
}
"""The module of the command, the simulations of its data, and its command line."""


@pytest.fixture(name="prepared")
def _prepared(tmp_path, monkeypatch):
    """A function that makes the inputs of a case: of a virtual machine, or by their headers of a real one."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "path.nc").write_text(PATH)
    write_model(model(CFRAME, random_effects(3, axes="XYZ")), tmp_path / "real.json")

    def prepare(case, simulated):
        for line in CASES[case][1]:
            succeed(*shlex.split(line))
        if case == "three-points":
            rounds(tmp_path)
        if case == "drift":
            touches(tmp_path)
        if "made.json" in CASES[case][2]:  # a calibration from such data
            machine = "dmu50" if "dmu50" in CASES[case][2] else "cframe"
            made_of(machine, simulated, tmp_path)
        if case == "import":
            succeed(*shlex.split(TABLES))
        for data in tmp_path.glob("*.csv"):
            text = data.read_text()
            assert text.count(", simulated\n") == 1
            if not simulated:
                data.write_text(text.replace(", simulated\n", "\n"))

    return prepare


def rounds(folder):
    """Three reflectors on the spindle of a DMU 50, which X, Y and Z move one after another."""
    places = {"1": (800.0, -850.0, -650.0), "2": (-800.0, 850.0, -650.0)}
    stations = {name: station(place, float(name)) for name, place in places.items()}
    machine = machines.load("dmu50")
    with (folder / "rounds.csv").open("wb") as file:
        seen = measured(
            machine, model(machine, random_effects(3, degree=2)), stations,
            axes="XYZ", instrument=QUIET, rng=np.random.default_rng(5),
        )  # fmt: skip
        write_measurement(seen, file, ", simulated")


def touches(folder):
    """Touches of one sphere by a machine whose zero of X goes 30 um in two hours."""
    head = "# machine: dmu50", "# instrument: touch-probe", "# u_um: 0.5", "# probe: 0 0 -150", "# sphere.s1: 100 20 60"
    rows = [f"{600 * k},{100.0 + 3e-3 * min(k, 10):.4f},20,210,0,0,s1" for k in range(14)]
    lines = *head, "# made_by: ncomp 0.1.0, simulated", "time_s,X,Y,Z,B,C,sphere", *rows
    (folder / "touches.csv").write_text("\n".join(lines) + "\n")


def made_of(machine, simulated, folder):
    """A calibration, by its source from simulated data or from real ones."""
    found = machines.load(machine)
    effects = random_effects(3, degree=2, axes="XYZBC" if len(found.axes) == 5 else "X")
    content = model(found, effects)
    made = content.provenance
    source = "fit of 99 observations, simulated data" if simulated else "fit of 99 observations"
    write_model(
        msgspec.structs.replace(content, provenance=msgspec.structs.replace(made, source=source)), folder / "made.json"
    )


@pytest.mark.parametrize(
    ("case", "simulated"),
    quick(
        itertools.product(CASES, [True, False]),
        [("fit on the fly", True), ("continuous", True), ("continuous into a calibration", False), ("export", True)],
    ),
)
def test_a_calibration_from_simulated_data_is_marked(prepared, case, simulated):
    prepared(case, simulated)
    succeed(*shlex.split(CASES[case][2]))
    assert decode_model(Path("cal.json").read_bytes(), "cal.json").invented is simulated


def test_every_command_that_writes_a_calibration_is_tried():
    """Those that simulate write the true errors, which are marked as a demonstration; `square` reads no data.

    `watch` has the drift from the function of `drift` (`drifting`).
    """
    writers = {path.stem for path in COMMANDS.rglob("*.py") if any(name in path.read_text() for name in WRITERS)}
    tried = {name for name in writers if not name.startswith("simulate")} - {"square", "drifting"}
    assert tried == {module for module, _, _ in CASES.values()}
    assert {"simulate", "simulate_continuous", "simulate_on_the_fly"} < writers


@pytest.mark.parametrize("line", [f"{POINTS} 1 -o a.csv", RUNS, CASES["fit on the fly"][1][0]])
def test_true_errors_are_marked(tmp_path, monkeypatch, line):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "path.nc").write_text(PATH)
    succeed(*shlex.split(line), "--truth", "truth.json")
    assert decode_model(Path("truth.json").read_bytes(), "truth.json").invented
