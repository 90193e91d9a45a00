"""Arcs in runs of plain lines with corrected ends: the numbers of their centres and radii, as of `CircleWriter`.

Points in the planes of arcs are complex numbers, mm: the first axis is real.
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np

from kinematics.machine import NDArrayBool
from kinematics.transforms import Array
from postproc.motion.circle_columns import centres_by_radius, moved_centres, sweeps
from postproc.motion.circles import OUT_OF_ROUND, SAME_POINT_MM
from postproc.motion.motions import Motions
from postproc.motion.moves import Arc, Kind, Known
from postproc.write.arcs import HALF, LARGEST_DEVIATION

RADIUS = "R"
"""Address of a radius in plain lines."""
SMALLEST_PLAIN_ARC_MM = 0.02
"""Radius and chord, mm, below which an arc is written by itself: rounding may change its sweep."""
LARGEST_PLAIN_SWEEP_RAD = 5.0
"""Sweep, rad, above which an arc is written by itself: its end may have to be rounded off."""
HALF_TURN_MARGIN_RAD = 0.5
"""Difference of a sweep from half a turn, rad, below which an arc by its radius is written by itself."""


class WritableArcs(msgspec.Struct, frozen=True):
    """Arcs before their correction that can be written together; one entry per arc."""

    rows: np.ndarray
    """Their rows `(k,)`, in increasing order."""
    arcs: list[Arc]
    start: np.ndarray
    end: np.ndarray
    centre: np.ndarray
    sense: np.ndarray
    turned: Array
    """Sweeps, rad, positive counter-clockwise."""
    middle_shift: np.ndarray
    """Corrections of their middles."""
    by_radius: NDArrayBool
    absolute: NDArrayBool
    """True where the words of the centre are a position."""

    @classmethod
    def of(cls, motions: Motions, middle_shift: Mapping[int, Array]) -> WritableArcs:
        """The arcs of a chunk; some conditions are tested only when they are written.

        middle_shift: correction `(axes,)` of the middle of each arc, mm; those that it leaves out are written singly.
        """
        circles = motions.circles
        rows, cells = circles.rows, np.stack([circles.first, circles.second], axis=1)
        arcs = [motions.arcs[row] for row in rows.tolist()]
        none = np.full(motions.target.shape[1], np.nan)
        shifts = np.array([middle_shift.get(row, none) for row in rows.tolist()]).reshape(-1, len(none))
        start, end = (_points(of[rows[:, None], cells]) for of in (motions.start, motions.target))
        shift = _points(np.take_along_axis(shifts, cells, axis=1))
        centre = circles.centre[0] + 1j * circles.centre[1]
        by_radius = np.fromiter((arc.form.startswith("radius") for arc in arcs), bool, len(rows))
        absolute = np.fromiter((arc.form == "absolute" for arc in arcs), bool, len(rows))
        sense = np.fromiter((arc.sense for arc in arcs), int, len(rows))
        found = cls(rows, arcs, start, end, centre, sense, circles.turned, shift, by_radius, absolute)
        known = (motions.known_start[rows[:, None], cells] == Known.PROGRAM).all(axis=1)
        whole = np.fromiter((arc.full or arc.turns > 0 for arc in arcs), bool, len(rows))
        small = np.minimum(np.abs(start - end), np.abs(start - centre)) < SMALLEST_PLAIN_ARC_MM
        near_half = by_radius & (np.abs(np.abs(found.turned) - np.pi) < HALF_TURN_MARGIN_RAD)
        alone = (
            small
            | near_half
            | whole
            | (np.abs(found.turned) >= LARGEST_PLAIN_SWEEP_RAD)
            | (motions.kind[rows] != Kind.ARC)
        )
        compensated = np.fromiter((row in motions.cutter_compensated for row in rows.tolist()), bool, len(rows))
        return found.take(np.flatnonzero(known & ~alone & ~compensated & ~np.isnan(shift)))

    def take(self, chosen: np.ndarray) -> WritableArcs:
        """Some of the arcs, by their indices."""
        columns = self.start, self.end, self.centre, self.sense, self.turned, self.middle_shift
        arcs, forms = [self.arcs[i] for i in chosen.tolist()], (self.by_radius, self.absolute)
        return WritableArcs(self.rows[chosen], arcs, *(column[chosen] for column in (*columns, *forms)))

    def of_lines(self, first: int, lines: int) -> WritableArcs:
        """The arcs of rows from `first` on, by line."""
        low, high = np.searchsorted(self.rows, (first, first + lines)).tolist()
        some = self.take(np.arange(low, high))
        return msgspec.structs.replace(some, rows=some.rows - first)


def _points(columns: Array) -> np.ndarray:
    """Points of two columns `(k, 2)`."""
    return np.asarray(columns[:, 0] + 1j * columns[:, 1])


class PlainArcs(msgspec.Struct, frozen=True):
    """Arcs of a run of plain lines with their ends on the control; one entry per arc."""

    nominal: WritableArcs
    """The arcs by their lines."""
    start: np.ndarray
    end: np.ndarray
    """Positions on the control."""
    centre: np.ndarray
    """Centres with the middles corrected."""

    @property
    def lines(self) -> np.ndarray:
        """Lines of the run `(k,)`."""
        return self.nominal.rows

    @classmethod
    def of(cls, nominal: WritableArcs, corrected: Array, starts: Array, ends: Array) -> tuple[PlainArcs, int]:
        """The arcs, by line, and the number of lines before the first that has to be written by itself.

        corrected `(lines, axes)`: ends before rounding. starts, ends `(lines, axes)`: positions on the control.
        """
        cells = nominal.rows[:, None], np.array(nominal.arcs[0].plane[:2])
        start, wanted, end = (_points(of[cells]) for of in (starts, corrected, ends))
        before = _centres(nominal, start, wanted)
        programmed = np.abs(nominal.start - nominal.centre) - np.abs(nominal.end - nominal.centre)
        fault = np.abs(start - before) - np.abs(wanted - before) - programmed
        alone = (np.abs(fault) - OUT_OF_ROUND / 2 > SAME_POINT_MM) | (np.abs(start - end) < 2.0 * SAME_POINT_MM)
        lines, number = (int(nominal.rows[alone][0]), int(alone.argmax())) if alone.any() else (len(ends), len(alone))
        found = cls(nominal, start, end, _centres(nominal, start, end))
        return found._first(number), lines

    def _first(self, number: int) -> PlainArcs:
        some = slice(number)
        return PlainArcs(self.nominal.take(np.arange(number)), self.start[some], self.end[some], self.centre[some])

    def centre_words(self, axis: int, unit: float) -> tuple[Array, Array]:
        """Numbers `(k,)` of the centres along the first (0) or second (1) axis of the plane, and their origins, mm."""
        start, centre = (of.imag if axis else of.real for of in (self.start, self.centre))
        origins = np.where(self.nominal.absolute, 0.0, start)
        return np.asarray((centre - origins) / unit), np.asarray(origins)

    def radius_words(self, programmed: Array, unit: float) -> Array:
        """Numbers `(k,)` of the radii; programmed `(k,)`: those of the program, for their signs."""
        chord, to_centre = self.end - self.start, self.centre - self.start
        height = np.abs(chord.real * to_centre.imag - chord.imag * to_centre.real) / np.abs(chord)
        radius = np.hypot(np.abs(chord) / 2, height) / unit
        signs = np.where(np.abs(self.nominal.turned) > np.pi - HALF, programmed, 1.0)
        return np.asarray(np.copysign(radius, signs))

    def written(self, centres: Array, radii: Array) -> tuple[dict[int, Arc], int | None]:
        """The arcs, by line, as the control runs them, and the first line that has to be written by itself, or None.

        centres `(k, 2)`, radii `(k,)`: as written, mm; a radius nan for an arc by its centre.
        """
        sense = self.nominal.sense
        by_radius = ~np.isnan(radii)
        around = centres_by_radius(self.start, self.end, radii, sense)
        centre = np.where(by_radius, around, _points(centres))
        turned = sweeps(self.start, self.end, centre, sense)
        wanted = sweeps(self.start, self.end, self.centre, sense)
        middles = (c + (self.start - c) * np.exp(0.5j * t) for c, t in ((self.centre, wanted), (centre, turned)))
        apart = np.abs(np.subtract(*middles))
        alone = by_radius & (np.isnan(around) | (apart >= LARGEST_DEVIATION))
        alone |= np.abs(turned - self.nominal.turned) > 1.0
        alone |= np.minimum(np.abs(self.start - centre), np.abs(self.end - centre)) < SAME_POINT_MM
        number = int(alone.argmax()) if alone.any() else len(alone)
        some = zip(self.lines[:number].tolist(), self.nominal.arcs, centre.tolist(), strict=False)
        found = {line: arc._replace(centre=(at.real, at.imag)) for line, arc, at in some}
        return found, int(self.lines[number]) if alone.any() else None


def _centres(nominal: WritableArcs, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Centres of arcs with new ends and their middles corrected."""
    shifts = start - nominal.start, nominal.middle_shift, end - nominal.end
    return moved_centres((nominal.start, nominal.end), nominal.centre, nominal.turned, shifts)
