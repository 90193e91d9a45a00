"""Height maps of programs that send G-code to a router."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np

from kinematics.user_error import UserError
from postproc.control_data.height_maps.height_map import MAP_NODES, HeightMap, Point, even, grid, refuse_holes
from postproc.control_data.readers.control_source import numbers, refusal


def read_bcnc(name: str, text: str) -> HeightMap:
    """bCNC's `.probe`: ends and number of points in X, in Y; depth, height and feed of the probing; rows of x y z.

    Source: class Probe of `bCNC/CNC.py`, vlachoudis/bCNC 01a97e4. Bilinear; outside, bCNC extrapolates the last cell.
    """
    rows = [(line, row.split(), row) for line, row in enumerate(text.splitlines(), 1) if row.strip()]
    if len(rows) < 3 or any(len(words) != 3 for _, words, _ in rows):
        line, _, row = next((row for row in rows if len(row[1]) != 3), (1, [], ""))
        raise refusal(
            f"height map {name}", line, row, "expected three numbers: a .probe of bCNC has ends and number, then x y z"
        )
    values = [(line, numbers(words, f"height map {name}", line, row), row) for line, words, row in rows]
    points = [Point(line, row, *value) for line, value, row in values[3:]]
    x, y, heights = grid(name, points)
    for letter, nodes, (line, (low, high, count), row) in zip("XY", (x, y), values[:2], strict=True):
        step = (high - low) / max(count - 1, 1)
        if len(nodes) != count or max(abs(nodes[0] - low), abs(nodes[-1] - high)) > abs(step) / 10:
            found = f"the points below have {len(nodes)} positions in {letter}, {nodes[0]:g} to {nodes[-1]:g}"
            raise refusal(f"height map {name}", line, row, f"{found}: the file is cut or mixed up; save the map again")
    return HeightMap(x, y, heights, "bCNC")


def read_candle(name: str, text: str) -> HeightMap:
    """Candle's `.map`: x, y, width, height; number of points in X and Y and depths; interpolation; rows of heights.

    Source: `frmmain.cpp` (saveHeightMap) and `utils/interpolation.h`, Denvi/Candle 402bc13. Bicubic: Catmull-Rom, with
    the rows at the edges repeated; outside, Candle extrapolates.
    """
    rows = [(line, row) for line, row in enumerate(text.splitlines(), 1) if row.strip()]
    where = f"height map {name}"
    if len(rows) < 4:
        raise UserError(f"{where}: the file ends before its heights: save the map again")
    (x, y, width, height), (across, along) = _cells(where, rows[0], 4), _cells(where, rows[1], 4)[:2]
    found = rows[3:]
    if len(found) != along:
        raise UserError(f"{where}: {len(found)} rows of heights; line {rows[1][0]} gives {along:g}: save the map again")
    heights = np.array([_cells(where, row, int(across), holes=True) for row in found]).T
    nodes = even(x, x + width, len(heights)), even(y, y + height, len(found))
    refuse_holes(name, *nodes, heights)
    return HeightMap(*nodes, heights, "Candle", "cubic")


def _cells(where: str, row: tuple[int, str], count: int, *, holes: bool = False) -> list[float]:
    """The numbers of a row; holes: `nan` stands for a point that was not probed."""
    line, text = row
    cells = [cell.strip() for cell in text.strip().rstrip(";").split(";")]
    if len(cells) != count:
        raise refusal(where, line, text, f"expected {count} numbers with ';' between them, found {len(cells)}")
    empty = [holes and cell.lower() in ("nan", "-nan", "") for cell in cells]
    values = numbers(["0" if none else cell for cell, none in zip(cells, empty, strict=True)], where, line, text)
    return [np.nan if none else value for value, none in zip(values, empty, strict=True)]


def read_opencncpilot(name: str, text: str) -> HeightMap:
    """OpenCNCPilot's `.hmap`, which ioSender writes as well: XML with the ends, the numbers and the points by index.

    Source: `HeightMap.cs`, martin2250/OpenCNCPilot 0d573c4 and terjeio/ioSender 0957c49. Bilinear; outside, both take
    the largest height of the map.
    """
    where = f"height map {name}"
    try:
        root = ET.fromstring(text)
        low = [float(root.attrib[f"Min{axis}"]) for axis in "XY"]
        high = [float(root.attrib[f"Max{axis}"]) for axis in "XY"]
        counts = [int(root.attrib[f"Size{axis}"]) for axis in "XY"]
        points = [(int(p.attrib["X"]), int(p.attrib["Y"]), p.text or "") for p in root.iter("point")]
    except ET.ParseError as fault:
        raise UserError(
            f"{where}:{fault.position[0]}: the file is cut or damaged ({fault.msg}): save the map"
        ) from None
    except KeyError as fault:
        raise UserError(f"{where}: {fault} is missing: save the map again") from None
    except ValueError as fault:
        raise UserError(f"{where}: {fault}: expected numbers with '.' as the decimal point") from None
    rising = all(-np.inf < a < b < np.inf for a, b in zip(low, high, strict=True))
    if not rising or min(counts) < 2 or max(counts) > MAP_NODES:
        raise UserError(
            f"{where}: {counts[0]} x {counts[1]} points from {low} to {high}: a map has 2 to {MAP_NODES} points along "
            "each axis"
        )
    heights = np.full(counts, np.nan)
    for i, j, z in points:
        if not (0 <= i < counts[0] and 0 <= j < counts[1]):
            raise UserError(f"{where}: point X={i} Y={j} is outside the {counts[0]} x {counts[1]} points of the map")
        (heights[i, j],) = numbers([z], where, 1, f"X={i} Y={j}")
    x, y = (even(*ends) for ends in zip(low, high, counts, strict=True))
    refuse_holes(name, x, y, heights)
    return HeightMap(x, y, heights, "OpenCNCPilot or ioSender")


def read_gsender(name: str, text: str) -> HeightMap:
    """gSender's `.gshmap`: JSON with `points` of x, y and z, mm.

    Source: `src/app/src/features/HeightMap`, Sienci-Labs/gsender 0ca717f. Bilinear; outside, the height of the edge.
    Earlier versions wrote the unit of the screen beside values in mm, and shifted the lowest point to 0, which loses
    the work zero; gSender warns of these (`describeLegacyNormalizedMap`).
    """
    where = f"height map {name}"
    try:
        content: dict[str, Any] = json.loads(text)
        rows = [(point["x"], point["y"], point["z"]) for point in content["points"]]
        texts = [(k, f"point {k}", list(map(str, row))) for k, row in enumerate(rows, 1)]
        points = [Point(k, said, *numbers(row, where, k, said)) for k, said, row in texts]
    except json.JSONDecodeError as fault:
        raise UserError(f"{where}:{fault.lineno}: the file is cut or damaged ({fault.msg}): save the map") from None
    except (KeyError, TypeError, ValueError) as fault:
        raise UserError(f"{where}: expected points with x, y and z, numbers ({fault!r}): save the map again") from None
    if content.get("units", "mm") != "mm":
        raise UserError(f"{where}: units {content['units']}: maps of gSender are in mm: probe again")
    if points and min(point.z for point in points) == 0.0 < max(point.z for point in points):
        raise UserError(
            f"{where}: its lowest point is exactly 0, as in the maps of earlier versions of gSender, whose work zero "
            "is lost: probe again; or, if the zero was set on that point, give the points as a list of X Y Z"
        )
    return HeightMap(*grid(name, points), "gSender", unit="mm")
