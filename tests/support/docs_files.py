"""The files that the pages of the documentation presuppose: a user's program, machine, calibration and data."""

from __future__ import annotations

import csv
import re
import shlex
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

import machines
from calibration.measurement.measurement import Target
from calibration.measurement.written_file import write_measurement
from kinematics.effects import Effect, LocationError, Scale
from kinematics.error_model.model import ErrorModel, write_model
from kinematics.machine import Machine
from support import robot
from support import three_points_cases as three
from support.command import succeed
from support.docs_commands import DOCS, ROOT
from support.programs import model_of
from support.real_data import REAL_DATA
from support.tracker_logs import Stop, header, log_of

OUTPUTS = {
    *("-o", "--output", "--json", "--report", "--nc", "--truth", "--quasistatic", "--rest", "--write-calibration"),
    *("--data", "--pdf"),
}
"""Options that the name of an output follows."""
TIP = """\
G21 G17 G90 G94 G54
T1 M6
G0 B0 C0
G0 X10. Y20.
G43.4 H1 X10. Y20. Z100. B0 C0
G1 X12. Y20. Z95. B1. C.5 F1000.
M30
"""
PROGRAM = "G21 G17 G90 G54\nT5 M6\nG43 H5\nG0 X10. Y10. Z30.\nG1 Z5. F500\nX60.\nG2 X70. Y20. I0. J10.\nG1 Y35.\nG0 Z30.\nM30\n"
TURNTABLE = 'name = "turntable"\nchain = "w C b t"\n[axes.C]\ntravel = [-1, 361]\npoint = [0, 0, 0]\nhome = 0\n'
B89 = "test,range_mm,range_2_mm,length_mm,error_um\n" + "".join(
    f"{test},{first},{second},{length},{um}\n"
    for test, first, second, length, um in (
        *(("ranging", 2000, far, "", um) for far, um in ((4000, 0.9), (6000, -1.2), (10000, 1.4), (20000, 3.1))),
        *(("length", far, "", 2300, um) for far, um in ((2000, 9), (4000, -14), (6000, 18), (10000, -31))),
        *(("two-face", far, "", "", um) for far, um in ((2000, 14), (2000, 20), (5000, 30), (9000, 41))),
    )
)
STUDY = """machine = "gantry"
draws = 2
[instrument]
kind = "laser-tracker"
u_range_um_per_m = 0.5
u_angle_um = 3
[errors]
model = "table-1"
[[case]]
name = "grid"
strategy = "grid"
points = 40
tracker = [-1500, 1500, 300]
"""
TARGETS = "--target t1=0,0,-120 --target t2=90,40,-180 --target t3=-60,80,-150"
TRACKER = "--tracker=-1500,1500,300 -u u_range_um_per_m=0.5 -u u_angle_um=3"
CIRCLES = "--instrument ballbar --centre 300,225,150 --target t1=0,0,-120 --bar 150:0.5 --feed 1000 --feed 3000"
RUNS = "--axis X --start-mm 0 --end-mm 450 --feed 5000 --rate 1000 --spacing 45 --both"

Maker = str | Callable[[Path, str], object]
"""The ncomp command that writes the file, MACHINE its machine, or a function of the file's path and the machine."""


def text(content: str) -> Maker:
    """Writes a text."""
    return lambda path, _: path.write_text(content)


def copied(source: Path) -> Maker:
    """Copies a file."""
    return lambda path, _: shutil.copyfile(source, path)


def shown(page: str, words: str) -> Maker:
    """Writes the first block of a page that contains some words."""

    def write(path: Path, _: str) -> None:
        blocks = re.findall(r"(?:^    .*\n|^\n)+", (DOCS / page).read_text(), re.MULTILINE)
        block = next(each for each in blocks if words in each)
        path.write_text(re.sub(r"^    ", "", block.lstrip("\n"), flags=re.MULTILINE))

    return write


def examples(path: Path, _: str) -> None:
    """Copies the examples; the studies have two draws."""
    shutil.copytree(ROOT / "examples", path)
    for study in (path / "studies").glob("*.toml"):
        study.write_text(re.sub(r"^draws = \d+", "draws = 2", study.read_text(), flags=re.MULTILINE))


def programs(path: Path, _: str) -> None:
    """Makes a folder of programs."""
    (path / "roughing").mkdir(parents=True)
    for name in ("part.nc", "second.nc", "part.txt", "roughing/part.nc"):
        (path / name).write_text(PROGRAM)


def calibration(um: float) -> Maker:
    """Writes a calibration: displacements of the tool point along X and of the lines of rotary axes by so many um."""

    def write(path: Path, machine: str) -> None:
        mill = machines.load(machine)
        rotary = [axis.name for axis in mill.axes if axis.rotary]
        effects: list[Effect] = [LocationError("X", "X", um), *(LocationError("X", name, um) for name in rotary)]
        write_model(model_of(mill, *effects), path)

    return write


def scales(path: Path, _: str) -> None:
    """Writes a calibration with the scales of a router."""
    router = machines.load(str(path.with_name("router.toml")))
    write_model(model_of(router, Scale("X", 90.0), Scale("Y", -45.0)), path)


def crooked(machine: Machine) -> ErrorModel:
    """A machine with errors that every measurement shows: scales and squareness of hundreds of um and urad."""
    effects: list[Effect] = [Scale(name, 300.0) for name in "XYZ"]
    effects += [LocationError("C", "Y", 400.0), LocationError("B", "Z", 300.0)]
    return model_of(machine, *effects)


def reflectors(path: Path, machine: str) -> None:
    """Writes a measurement of one axis at a time by three reflectors, from one station on the bed."""
    mill = machines.load(machine)
    pose = three.station((800.0, -850.0, -650.0), 0.4)
    taken = three.measured(mill, crooked(mill), {"1": pose}, rng=np.random.default_rng(1))
    with path.open("wb") as file:
        write_measurement(taken, file)


def log(path: Path, machine: str) -> None:
    """Writes a plan, and the stream of a tracker that follows the machine along it."""
    mill, plan = machines.load(machine), path.with_name(path.name.replace("log", "plan"))
    if machine == "dmu50":
        targets, stands_on = three.TARGETS, "bed"
        positions, names, runs = three.rows(mill, "XC", ["1"], targets)
        rows = zip(np.round(positions, 4), names, runs, strict=True)
        keys = {name: "target" if each.carrier == "tool" else "table" for name, each in targets.items()}
        lines = [f"# {keys[name]}.{name}: {' '.join(map(str, each.position))}" for name, each in targets.items()]
        lines += [",".join([*mill.names, "target", "run"])]
        lines += [",".join([*(f"{q:.4f}" for q in position), name, run]) for position, name, run in rows]
        plan.write_text("\n".join(["# machine: dmu50", *lines]) + "\n")
        pose = three.station((800.0, -850.0, -650.0), 0.4)
    else:
        targets, stands_on = {"t1": Target((0.0, 0.0, -120.0))}, "workpiece"
        succeed(
            "plan",
            "--machine",
            machine,
            *["--strategy", "random", "--points", "40", "--target", "t1=0,0,-120", "-o"],
            plan,
        )
        lines = [line for line in plan.read_text().splitlines() if not line.startswith("#")]
        table = list(csv.DictReader(lines))
        positions = np.array([[float(row[name]) for name in mill.names] for row in table])
        names = ["t1"] * len(table)
        pose = three.station((-2500.0, 1500.0, 300.0), 0.4)
    stops = [
        Stop(q.tolist(), str(name), 0.6, broken_before=i > 0 and name != names[i - 1])
        for i, (q, name) in enumerate(zip(positions, names, strict=True))
    ]
    taken = log_of(
        mill, crooked(mill), stops, targets, pose, np.random.default_rng(1), speed=400.0, stands_on=stands_on
    )
    path.write_text(taken.text(header(mill, stands_on)))


def arm(path: Path, _: str) -> None:
    """Writes the points of a robot's reflector, or the joint angles."""
    joints = robot.random_joints(60)
    points = path.name == "points.csv"
    columns = robot.measured(joints).T if points else joints.T
    names = "xyz" if points else [f"A{n}" for n in range(1, 7)]
    path.write_text(robot.table(dict(zip(names, columns, strict=True))))


def zigzag(path: Path, _: str) -> None:
    """Writes a program through the volume of the gantry, along its axes and diagonals."""
    corners = [(x, y, z) for z in (-150, 150) for y in (-1200, 1200) for x in (-2000, 2000)]
    moves = [f"G1 X{x}. Y{y}. Z{z}. F2500" for one in corners for x, y, z in (one, corners[len(corners) // 2 - 1])]
    path.write_text("\n".join(["G21 G90 G54", "G0 X0. Y0. Z0.", *moves, "M30", ""]))


def control_tables(path: Path, _: str) -> None:
    """Writes a table of LinuxCNC, or the lines that name it."""
    path.write_text("[JOINT_0]\nCOMP_FILE = comp_x.txt\nCOMP_FILE_TYPE = 0\n" if path.suffix == ".ini" else TABLE)


TABLE = "-250 -250.01 -250.01\n0 0 0.002\n250 250.02 250.02\n"


def corrected(path: Path, _: str) -> None:
    """Corrects a user's program."""
    prepare(["part.nc"], path.parent)
    succeed("part.nc", "--machine", "dmu50", "--set-up-zero", "-o", path.name)


FILES: dict[str, Maker] = {
    "part.nc": text(PROGRAM),
    "library": lambda path, _: path.mkdir(),
    "tip.nc": text(TIP),
    "job.toml": text('machine = "dmu50"\n[programs]\n"posted/part.nc" = "corrected/job.nc"\n'),
    "posted": programs,
    "mill.toml": shown("machines.md", "chain ="),
    "centre.toml": shown("measurements/ranging.md", "chain ="),
    "router.toml": shown("measurements/lengths.md", "chain ="),
    "holes.csv": shown("measurements/lengths.md", "AC,0,0"),
    "square.csv": shown("measurements/lengths.md", "u_square_urad: 50"),
    "router.json": scales,
    "my_router.toml": shown("router.md", "chain ="),
    "marks.nc": shown("router.md", "G1 Z-0.3 F200"),
    "sign.nc": shown("router.md", "M3 S10000"),
    "from_cam": lambda path, _: (path.mkdir(), shown("router.md", "M3 S10000")(path / "sign.nc", "")),
    "details.toml": shown("certificate.md", "identifier ="),
    "list.csv": shown("measurements/lists.md", "target_mm,reading_mm"),
    "errors.csv": shown("measurements/lists.md", "E_XX,X"),
    "night.csv": shown("standards.md", "time,X1_um"),
    "touches.csv": shown("drift.md", "temp_spindle,temp_air"),
    "rail.csv": shown("measurements/log.md", "time,axis,run"),
    "air.csv": shown("measurements/log.md", "temp_air;temp_bed"),
    "logger.csv": shown("measurements/log.md", "Serial 4711"),
    "logger.toml": shown("measurements/log.md", "skip_lines = 1"),
    "turntable.toml": text(TURNTABLE),
    "robot.toml": lambda path, _: path.write_text(robot.toml()),
    "examples": examples,
    **dict.fromkeys(("cal.json", "mill.json", "before.json", "march.json"), calibration(-10.0)),
    **dict.fromkeys(("true.json", "after.json", "june.json"), calibration(4.0)),
    **dict.fromkeys(
        ("data.csv", "measured.csv"), f"simulate --machine MACHINE --strategy grid --points 60 {TRACKER} -o FILE"
    ),
    "part_c.nc": corrected,
    "plan.csv": "plan --machine MACHINE --strategy random --points 40 -o FILE",
    "circles.csv": f"simulate --machine MACHINE {CIRCLES} --errors none --effect backlash:axis=X,width=8 -o FILE",
    "run.csv": f"simulate-continuous --machine cframe {RUNS} -o FILE --quasistatic targets.csv",
    "targets.csv": f"simulate-continuous --machine cframe {RUNS} -o run.csv --quasistatic FILE",
    "axes.csv": "plan --machine MACHINE --strategy axes --spacing 200 --runs 5 -o FILE",
    "axes_data.csv": "simulate --machine MACHINE --strategy axes --spacing 200 --runs 5 --instrument interferometer -o FILE",
    "points.csv": text("X,Y,Z\n0,0,0\n100,100,100\n"),
    "joints.csv": arm,
    "path.nc": zigzag,
    "moving.csv": (
        f"simulate --machine MACHINE --path path.nc --target t=0,0,-100 --feed 2500 {TRACKER} --errors none "
        "--effect scale:axis=X,scale=300 --effect location:component=C,axis=Y,value=400 -o FILE"
    ),
    "log.csv": log,
    "log_dmu50.csv": log,
    "comp_x.txt": control_tables,
    "machine.ini": control_tables,
    "b89.csv": text(B89),
    "study.toml": text(STUDY),
    "my_study.toml": text(STUDY),
    "scope.csv": copied(REAL_DATA / "resolver" / "ResolverCiclicError2.csv"),
    "axis1_resolver_openloop.log": copied(REAL_DATA / "slit_axis" / "axis1_resolver_openloop.log"),
    "reflectors.csv": reflectors,
    "tools.tbl": text("T5 P5 Z96.3 ;mill\n"),
}
"""What a page may name as an input that no earlier command of the page has written."""


def prepare(words: Sequence[str], folder: Path) -> None:
    """Make the inputs that a command names and that are not in the folder."""
    machine = words[words.index("--machine") + 1] if "--machine" in words else "gantry"
    for before, word in zip(("", *words), words, strict=False):
        name = word.partition("/")[0]
        if name == "job.toml":
            prepare(["posted"], folder)
        if "--path" in words and "fit" in words:
            prepare([words[words.index("--path") + 1]], folder)
        if before not in OUTPUTS and name in FILES and not (folder / name).exists():
            if machine in FILES and not (folder / machine).exists():
                prepare([machine], folder)
            make = arm if "robot.toml" in words and name == "points.csv" else FILES[name]
            if isinstance(make, str):
                succeed(*shlex.split(make.replace("MACHINE", machine).replace("FILE", name)))
            else:
                make(folder / name, machine)
