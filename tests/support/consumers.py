"""Exports for routers and printers in the controls that they are for: errors of the tool point before and after.

The machine is that of `machines/bzt_pfu.toml` with skew, scales and a bow of its bed, moved by `virtual_machine`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from clients import klipper, linuxcnc_sim
from virtual_machine.calibrated import read_calibration
from virtual_machine.chain import load as chain_of
from virtual_machine.chain import nominal_points, tool_points

import ncomp
from kinematics.basis import Legendre, Polynomial
from kinematics.effects import ErrorMotion, LocationError
from kinematics.error_model.model import write_model
from postproc.control_data.sheet import sheet
from postproc.control_data.tables.mesh_moves import DEFAULT
from support import firmware
from support.firmware import Array, Files
from support.programs import load, model_of

MACHINE = "bzt_pfu"
REACH = {"X": 1800.0, "Y": 1500.0, "Z": 400.0}
HOME = np.array([0.0, 0.0, 400.0])
STEPS = np.array([250.0, 320.0, 1600.0])
"""Steps a mm of the drives, which the control has before the export."""
BED = firmware.Bed((0.0, 1800.0), (0.0, 1500.0))
MESH = (np.linspace(0.0, 1800.0, 13), np.linspace(0.0, 1500.0, 11))
"""Points of Marlin's mesh."""
SKEW = [LocationError("C", "Y", 60.0), LocationError("B", "Z", -35.0), LocationError("A", "Z", 45.0)]
SCALES = [
    ErrorMotion(axis, axis, Polynomial((0.0, REACH[axis]), 1), (0.0, um), u=(0.0, 0.0))
    for axis, um in (("X", 90.0), ("Y", -45.0), ("Z", 20.0))
]
BOW = [
    ErrorMotion("Z", axis, Legendre((0.0, REACH[axis]), 2), (0.0, 0.0, um), u=(0.0,) * 3)
    for axis, um in (("X", 30.0), ("Y", -20.0))
]


class Consumer(NamedTuple):
    """A control with an export."""

    settings: tuple[str, ...]
    """Of the export."""
    moves: Callable[[Files, Array], Array]
    """Where it sends X, Y and Z `(n, 3)`, mm, for commands."""
    within: float
    """mm: how far it may be from there by its numbers and its steps."""
    runs: str
    """In words: what ran."""
    client: str = ""
    """Fixture of the program that must be there."""


def in_klipper(files: Files, commands: Array) -> Array:
    """Ends of moves, by Klipper's own code."""
    settings = {"split_delta_z": DEFAULT.split_delta_z, "move_check_distance": DEFAULT.move_check_distance}
    moves = klipper.corrected(files["ncomp.cfg"], settings, [[0.0, 0.0, 0.0], *commands.tolist()])
    return np.array([parts[-1] for parts in moves])


def in_linuxcnc(files: Files, commands: Array) -> Array:
    """Joints at rest in LinuxCNC's simulator, with the lines of the HAL file."""
    hal = files["matrixkins.hal"].splitlines()
    config = linuxcnc_sim.Config("XYZ", kinematics="matrixkins", hal=hal)
    blocks = ["G53 G0 " + " ".join(f"{a}{v:.9f}" for a, v in zip("XYZ", row, strict=True)) for row in commands]
    return linuxcnc_sim.at_rest(config, blocks).joint


def linuxcnc_has_matrixkins() -> bool:
    """True of LinuxCNC after 2.9."""
    return linuxcnc_sim.available() and Path("/usr/lib/linuxcnc/modules/matrixkins.so").exists()


CONSUMERS = {
    "grbl": Consumer(
        ("steps=X:250,Y:320,Z:1600",),
        lambda files, commands: firmware.grbl(files, commands, HOME, STEPS),
        0.5 * float(np.linalg.norm(1.0 / STEPS)) + 2e-4,
        "its formula in single precision, whole steps",
    ),
    "marlin": Consumer(
        ("x=0:1800:13", "y=0:1500:11"),
        lambda files, commands: firmware.marlin(files, commands, BED, MESH),
        3e-4,
        "its formulas in single precision",
    ),
    "reprap": Consumer((), firmware.reprap, 3e-4, "its formulas in single precision"),
    "klipper": Consumer((), in_klipper, 2e-5, "Klipper's code", "klipper"),
    "linuxcnc-matrix": Consumer((), firmware.matrixkins, 1e-6, "its formula"),
    "linuxcnc-calibxyz": Consumer((), firmware.calibxyzkins, 2e-4, "its search"),
}
IN_LINUXCNC = Consumer((), in_linuxcnc, 1e-6, "LinuxCNC's simulator", "linuxcnc_sim")


class Outcome(NamedTuple):
    """An export in its control, at commands `(n, 3)`, mm."""

    before: Array
    """Errors of the tool point `(n, 3)` in X, Y and Z of the machine, um, without the export."""
    after: Array
    """The same with the export, and with the zeros of the axes shifted as its page states."""
    apart: Array
    """Distances `(n,)`, mm, of the control's positions from those of the exported tables."""
    told: Mapping[str, float]
    """RMS, 95 % and largest error over the volume that the page states for the same, um."""
    along: Mapping[str, Array]
    """RMS `(3,)` in X, Y and Z that the page states, um, `before` and `after`."""


def outcome(form: str, consumer: Consumer, count: int = 400, before: tuple[str, Consumer] | None = None) -> Outcome:
    """The export of the machine in its control; `before`: of another format that was exported first, its `--rest`."""
    machine, chain = load(MACHINE), chain_of(MACHINE)
    model = model_of(machine, *SKEW, *SCALES, *BOW)
    with tempfile.TemporaryDirectory() as folder:
        write_model(model, Path(folder) / "cal.json")
        truth = read_calibration(Path(folder) / "cal.json")
    first = None if before is None else ncomp.export(machine, before[0], model, settings=before[1].settings)
    exported = ncomp.export(machine, form, first.rest if first else model, settings=consumer.settings)
    columns = [chain.index(axis) for axis in "XYZ"]
    rng = np.random.default_rng(7)
    commands = rng.uniform([2.0, 2.0, 0.0], [1798.0, 1498.0, 400.0], (count, 3)).round(3)
    q, moved = np.zeros((2, count, 3))
    q[:, columns], moved[:, columns] = commands, consumer.moves(exported.files, commands)
    if before and first:
        moved[:, columns] = before[1].moves(first.files, moved[:, columns])
    shift = np.array([exported.datum.get(axis.name, 0.0) for axis in chain.axes])
    tip = np.zeros((count, 3))

    def error(positions: Array) -> Array:
        zero = np.zeros((count, 6))
        actual = tool_points(chain, positions, truth.errors(chain, positions), zero, tip)
        return np.asarray(1e3 * (actual - nominal_points(chain, q, tip)))

    stages = exported.errors_in_the_volume()["tool_point_um"]
    return Outcome(
        error(q),
        error(moved + shift),
        np.linalg.norm(moved - exported.moves(q, np.zeros_like(q)), axis=1),
        stages.get("after_tables_and_datum_shift", stages["after_tables"]),
        _along(sheet(exported, exported.left, exported.errors_in_the_volume())),
    )


def _along(page: str) -> dict[str, Array]:
    """The table of sheet.md on X, Y and Z."""
    rows = page.partition("## Errors along X, Y and Z")[2].partition("\n## ")[0].split("|---|---|---|---|")[1]
    found = [np.array(row.strip("| ").split("|")[1:], float) for row in rows.strip().splitlines()]
    return dict(zip(("before", "after"), found, strict=True))
