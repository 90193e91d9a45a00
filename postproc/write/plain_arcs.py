"""Arcs in runs of plain lines with corrected ends: the numbers of their centres and radii, as of `CircleWriter`."""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec
import numpy as np

from kinematics.transforms import Array
from postproc.motion.circles import SAME, Point, centre_from_radius, sweep
from postproc.motion.motions import Motions
from postproc.motion.moves import Arc, Kind, Known
from postproc.write.arcs import LARGEST_DEVIATION, NominalArc, middle_deviation, radius_of

RADIUS = "R"
"""Address of a radius in plain lines."""
SMALLEST = 0.02
"""Radius and chord, mm, below which an arc is written by itself: rounding may change its sweep."""
LONGEST = 5.0
"""Sweep, rad, above which an arc is written by itself: its end may have to be rounded off."""
HALF_TURN = 0.5
"""Difference of a sweep from half a turn, rad, below which an arc by its radius is written by itself."""


def writable_arcs(motions: Motions, middle_shift: Mapping[int, Array]) -> dict[int, NominalArc]:
    """Arcs that can be written together, by row; some conditions are tested only when they are written.

    middle_shift: correction `(axes,)` of the middle of each arc, mm.
    """
    rows = np.array([row for row in motions.arcs if not motions.arcs[row].full and not motions.arcs[row].turns], int)
    if not len(rows):
        return {}
    arcs = [motions.arcs[row] for row in rows.tolist()]
    cells = rows[:, None], np.array([arc.plane[:2] for arc in arcs])
    shifts = np.array([middle_shift[row] for row in rows.tolist()])
    known = (motions.known_start[cells] == Known.PROGRAM).all(axis=1) & (motions.kind[rows] == Kind.ARC)
    in_plane = motions.start[cells], motions.target[cells], np.take_along_axis(shifts, cells[1], axis=1)
    columns = map(_points, in_plane)
    found = {}
    for row, arc, is_known, start, end, shift in zip(rows.tolist(), arcs, known.tolist(), *columns, strict=True):
        turned = sweep(start, end, arc.centre, arc.sense, arc.full)
        small = min(math.dist(start, end), math.dist(start, arc.centre)) < SMALLEST
        near_half = arc.form.startswith("radius") and abs(abs(turned) - math.pi) < HALF_TURN
        if is_known and not small and not near_half and abs(turned) < LONGEST and row not in motions.cutter_compensated:
            found[row] = NominalArc(arc, (start, end), turned, shift)
    return found


def _points(columns: Array) -> list[Point]:
    """Points of two columns `(k, 2)`."""
    return list(zip(columns[:, 0].tolist(), columns[:, 1].tolist(), strict=True))


class PlainArcs(msgspec.Struct, frozen=True):
    """Arcs of a run of plain lines with their ends on the control; one entry per arc."""

    lines: np.ndarray
    """Lines of the run `(k,)`."""
    arcs: list[NominalArc]
    ends: list[tuple[Point, Point]]
    """Positions on the control at start and end, mm."""
    centres: list[Point]
    """Centres with the middles corrected, mm."""

    @classmethod
    def of(
        cls, nominal: Mapping[int, NominalArc], corrected: Array, starts: Array, ends: Array
    ) -> tuple[PlainArcs, int]:
        """The arcs, by line, and the number of lines before the first that has to be written by itself.

        corrected `(lines, axes)`: ends before rounding. starts, ends `(lines, axes)`: positions on the control.
        """
        lines = list(nominal)
        found = cls(np.array(lines, int), list(nominal.values()), [], [])
        if not lines:
            return found, len(ends)
        cells = found.lines[:, None], np.array(found.arcs[0].arc.plane[:2])
        columns = (_points(of[cells]) for of in (starts, corrected, ends))
        for line, circle, start, wanted, end in zip(lines, found.arcs, *columns, strict=True):
            if circle.round_off(start, wanted) is not None or math.dist(start, end) < 2.0 * SAME:
                return found._first(len(found.centres)), line
            found.ends.append((start, end))
            found.centres.append(circle.centre(start, end))
        return found, len(ends)

    def _first(self, number: int) -> PlainArcs:
        return PlainArcs(self.lines[:number], self.arcs[:number], self.ends[:number], self.centres[:number])

    def centre_words(self, axis: int, unit: float) -> tuple[Array, Array]:
        """Numbers `(k,)` of the centres along the first (0) or second (1) axis of the plane, and their origins, mm."""
        origins = [
            0.0 if circle.arc.form == "absolute" else ends[0][axis]
            for circle, ends in zip(self.arcs, self.ends, strict=True)
        ]
        numbers = [(centre[axis] - origin) / unit for centre, origin in zip(self.centres, origins, strict=True)]
        return np.array(numbers, float), np.array(origins, float)

    def radius_words(self, programmed: Array, unit: float) -> Array:
        """Numbers `(k,)` of the radii; programmed `(k,)`: those of the program, for their signs."""
        found = [
            radius_of(circle, ends, centre, number, unit)
            for circle, ends, centre, number in zip(
                self.arcs, self.ends, self.centres, programmed.tolist(), strict=True
            )
        ]
        return np.array(found, float)

    def written(self, centres: Array, radii: Array) -> tuple[dict[int, Arc], int | None]:
        """The arcs, by line, as the control runs them, and the first line that has to be written by itself, or None.

        centres `(k, 2)`, radii `(k,)`: as written, mm; a radius nan for an arc by its centre.
        """
        found: dict[int, Arc] = {}
        columns = self.lines.tolist(), self.arcs, self.ends, self.centres, centres.tolist(), radii.tolist()
        for line, circle, (start, end), wanted, (x, y), radius in zip(*columns, strict=True):
            arc, centre = circle.arc, (x, y)
            if not math.isnan(radius):
                by_radius = centre_from_radius(start, end, radius, arc.sense)
                if by_radius is None or middle_deviation(start, end, wanted, by_radius, arc.sense) >= LARGEST_DEVIATION:
                    return found, line
                centre = by_radius
            turned = sweep(start, end, centre, arc.sense, arc.full, arc.turns)
            if abs(turned - circle.turned) > 1.0 or min(math.dist(start, centre), math.dist(end, centre)) < SAME:
                return found, line
            found[line] = arc._replace(centre=centre)
        return found, None
