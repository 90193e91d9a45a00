"""Positions of the labels of a drawing: beside their points, and off the lines and other labels."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import pairwise, product

import numpy as np

from kinematics.transforms import Array

LETTER_WIDTH_PX, LETTER_HEIGHT_PX = 7.0, 14.0
"""Size of a letter, px."""
LINE_POINT_PX = 3.0
"""Distance of the points by which a line is represented, px."""
LABEL_DISTANCE_PX = 3.0
"""Least distance of a label from lines and other labels, px."""
RINGS = (8.0, 18.0, 30.0, 44.0, 60.0)
"""Distances of a label from its point, px."""


def dense(line: Array) -> Array:
    """Points along a line `(n, 2)`, px."""
    parts = [np.linspace(a, b, int(np.linalg.norm(b - a) / LINE_POINT_PX) + 2) for a, b in pairwise(line)]
    return np.concatenate(parts) if parts else line


BASE = 11.0
"""Base line of a label below its upper edge, px."""


def placed(labels: Sequence[tuple[str, Array]], lines: Sequence[Array], width: float) -> list[Array]:
    """Box of each label at its point `(2,)`: left and upper edge, width and height, px, on a page of this width."""
    points, boxes = np.concatenate([dense(line) for line in lines]), list[Array]()
    for text, at in labels:
        size = np.array([LETTER_WIDTH_PX * len(text), LETTER_HEIGHT_PX])
        corners = [at + _shift(size, *side, ring) for ring, side in product(RINGS, product((1, -1, 0), (-1, 1, 0)))]
        inside = [corner for corner in corners if corner[0] >= 0 and corner[0] + size[0] <= width] or corners
        best = min(inside, key=partial(_cost, size, at, points, list(boxes)))
        boxes.append(np.concatenate([best, size]))
    return boxes


def leader(box: Array, at: Array) -> Array | None:
    """Ends `(2, 2)` of a line from a point to its distant label; None beside the point."""
    end = np.clip(at, box[:2], box[:2] + box[2:])
    return np.array([at, end]) if np.linalg.norm(end - at) > RINGS[1] else None


def _shift(size: Array, right: int, down: int, ring: float) -> Array:
    """Upper left corner of a box from its point, on one of the eight sides of it, or upon it."""
    return np.array([(right - 1) / 2.0, (down - 1) / 2.0]) * size + np.array([right, down]) * ring


def _cost(size: Array, at: Array, points: Array, boxes: Sequence[Array], corner: Array) -> float:
    """Covered points of lines, and much more for another label; then the distance from the own point."""
    low, high = corner - LABEL_DISTANCE_PX, corner + size + LABEL_DISTANCE_PX
    covered = np.count_nonzero(np.all((points > low) & (points < high), axis=1))
    others = sum(bool(np.all((box[:2] < high) & (box[:2] + box[2:] > low))) for box in boxes)
    return 25.0 * covered + 4000.0 * others + float(np.linalg.norm(corner + size / 2.0 - at))
