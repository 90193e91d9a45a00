"""Firmware and LinuxCNC's kinematics with the files of an export: where each sends the axes. Nothing of ncomp is used.

Commands and positions are `(n, 3)`, mm, X Y Z in machine coordinates. Marlin, RepRapFirmware and grbl are their own
formulas written out, in single precision as they reckon; Klipper and LinuxCNC are their own code (`clients`).

- Marlin 2.1: Planner::skew (planner.h), LevelingBilinear::get_z_correction (bbl.cpp), in this order (apply_modifiers).
- RepRapFirmware: Move::AxisTransform, then BedTransform by HeightMap::GetInterpolatedHeightError (Grid.cpp).
- grbl 1.1: read_float (nuts_bolts.c), whole steps (plan_buffer_line of planner.c), the homed position (limits.c).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Files = Mapping[str, str]
F = np.float32


class Bed(NamedTuple):
    """Travel of X and Y, mm."""

    x: tuple[float, float]
    y: tuple[float, float]


def marlin(files: Files, commands: Array, bed: Bed, mesh: tuple[Array, Array]) -> Array:
    """bed: X_MIN_POS to Y_MAX_POS; mesh: positions of its points along X and Y."""
    rows = [row.split() for row in files["marlin.gcode"].splitlines()]
    said = next({word[0]: F(word[1:]) for word in words} for code, *words in rows if code == "M852")
    xy, xz, yz = (said.get(letter, F(0.0)) for letter in "IJK")
    x, y, z = commands.astype(F).T.copy()
    skewed_x, skewed_y = x - y * xy - z * (xz - (xy * yz)), y - z * yz
    within = (x >= bed.x[0] + 1) & (x <= bed.x[1]) & (y >= bed.y[0] + 1) & (y <= bed.y[1])
    within &= (skewed_x >= bed.x[0]) & (skewed_x <= bed.x[1]) & (skewed_y >= bed.y[0]) & (skewed_y <= bed.y[1])
    x, y = np.where(within, skewed_x, x), np.where(within, skewed_y, y)
    heights = np.zeros((len(mesh[0]), len(mesh[1])), F)
    for code, *words in rows:
        if code == "M421":
            point = {word[0]: float(word[1:]) for word in words}
            heights[int(point["I"]), int(point["J"])] = point["Z"]
    return np.column_stack([x, y, z + _bilinear(heights, mesh, x, y)]).astype(float)


def reprap(files: Files, commands: Array) -> Array:
    """M556 of `skew.g`, and `heightmap.csv`."""
    words = {word[0]: F(word[1:]) for word in files["skew.g"].split()[1:]}
    tan_xy, tan_yz, tan_xz = (words[letter] / words["S"] for letter in "XYZ")
    compensate_xy = words["P"] <= 0
    x, y, z = commands.astype(F).T.copy()
    x = x + (tan_xy * y if compensate_xy else F(0.0)) + tan_xz * z
    y = y + (F(0.0) if compensate_xy else tan_xy * x) + tan_yz * z
    _, labels, values, *rows = files["heightmap.csv"].splitlines()
    grid = dict(zip(labels.split(","), values.split(","), strict=True))
    heights = np.array([[F(cell) for cell in row.split(",")] for row in rows]).T
    mesh = tuple(float(grid[f"min{k}"]) + float(grid[f"spacing{k}"]) * np.arange(int(grid[f"num{k}"])) for k in "01")
    return np.column_stack([x, y, z + _bilinear(heights, mesh, x, y)]).astype(float)


def _bilinear(heights: np.ndarray, mesh: tuple[Array, Array], x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Heights `(n,)` between points `(i, j)` of a mesh, held at its edge, in single precision."""
    cells, shares = [], []
    for at, nodes in ((x, mesh[0]), (y, mesh[1])):
        ratio = np.clip((at - F(nodes[0])) / F(nodes[1] - nodes[0]), F(0.0), F(len(nodes) - 1))
        cell = np.minimum(ratio.astype(int), len(nodes) - 2)
        cells.append(cell)
        shares.append(ratio - cell.astype(F))
    (i, j), (s, t) = cells, shares
    low = heights[i, j] + (heights[i, j + 1] - heights[i, j]) * t
    high = heights[i + 1, j] + (heights[i + 1, j + 1] - heights[i + 1, j]) * t
    return low + s * (high - low)


def grbl(files: Files, commands: Array, home: Array, geared: Array) -> Array:
    """home: position after homing; geared: steps that the drives need for a mm, by their gears."""
    rows = re.findall(r"^\$(\d+)=(\d+)\.(\d+)$", files["grbl.txt"], re.MULTILINE)
    assert [int(number) for number, _, _ in rows] == [100, 101, 102]
    assert all(len(whole + decimals) <= 8 for _, whole, decimals in rows), "grbl drops further digits"
    steps = np.array([F(f"{whole}.{decimals}") for _, whole, decimals in rows])
    target, start = (np.round(at.astype(F) * steps).astype(int) for at in (commands, home))
    return home + (target - start) / geared


def matrixkins(files: Files, commands: Array) -> Array:
    """kinematicsInverse of matrixkins.comp."""
    pins = dict(re.findall(r"^setp matrixkins\.C_(\w\w) (\S+)$", files["matrixkins.hal"], re.MULTILINE))
    matrix = np.array([[float(pins[i + j]) for j in "xyz"] for i in "xyz"])
    return commands @ matrix.T


def calibxyzkins(files: Files, commands: Array) -> Array:
    """calib_xyz_inverse of calibxyzlib.c: Newton's search from the command on, until the rest is below its tolerance."""
    pins = dict(re.findall(r"^setp calibxyzkins\.(\S+) (\S+)$", files["calibxyzkins.hal"], re.MULTILINE))
    a, b = (np.array([[float(pins[f"calib-{m}.{i}{j}"]) for j in "xyz"] for i in "xyz"]) for m in "ab")
    c = np.array([float(pins[f"calib-c.{i}"]) for i in "xyz"])
    return np.array([_searched(a, b, c - position, position, float(pins["tol"])) for position in commands])


def _searched(a: Array, b: Array, less: Array, start: Array, tolerance: float) -> Array:
    """Joints `(3,)` at which A j + B j^2 + less is 0."""
    joints = start
    for _ in range(10):
        rest = a @ joints + b @ joints**2 + less
        if np.linalg.norm(rest) < tolerance:
            break
        joints = joints - np.linalg.solve(a + 2 * b * joints, rest)
    return joints
