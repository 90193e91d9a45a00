"""How far the curve of a spline through corrected points may be from the corrected curve.

The control works out the curve from the points alone, the same for points that are shifted or turned together. So a
correction that is an affine function of the position moves the curve exactly, and what remains is bounded by the rest
of the correction, without knowledge of the curve itself:

- The curve is a mean of its control points (BSPLINE, weights of 0 and more), or a cubic polynomial between two points,
  whose tangents at them are means of the directions of the chords (ASPLINE) or at most three times the steepest of them
  (CSPLINE: a system of equations with a dominant diagonal). A rest r of the correction moves it by no more than the
  largest |r|, and by 4/27 of a chord for each of the two tangents.
- Chords whose lengths change by different factors change the parameter along the curve, and with it the curve by no
  more than a share (PARAMETER) of that difference times the longest chord.
- The weights of the Akima tangents change as well where the chords before and behind a point hardly bend. A corner
  between straight lines has no stable tangent.
"""

from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np

from kinematics.error_model.model import ErrorModel
from kinematics.transforms import Array
from postproc.compensation.conditions import Conditions
from postproc.compensation.correction import corrected_positions
from postproc.compensation.datum import datum_shifts
from postproc.motion.motions import Motions
from postproc.motion.moves import Spline
from postproc.motion.reversals import axes_with_backlash

TANGENT = 4.0 / 27.0
"""Largest value of the cubic polynomial with the slope 1 at one end of an interval of 1, and 0 otherwise."""
PARAMETER = {"ASPLINE": 2.0 * TANGENT, "BSPLINE": 3.0 / 4.0, "CSPLINE": 12.0 * TANGENT}
"""Largest change of a curve by lengths of chords that change by different factors, per longest chord.

ASPLINE: a tangent is a mean of directions, each by its chord. CSPLINE: so are the right sides of its equations (4.5 of
6), and the equations themselves change (1.5). BSPLINE: three times in a row a mean whose share changes by a quarter."""
STEEPEST = {"ASPLINE": 1.0, "CSPLINE": 3.0}
"""Largest tangent of a spline by the steepest chord."""


def check_splines(
    motions: Motions,
    models: tuple[ErrorModel, ErrorModel | None],
    conditions: Conditions,
    tolerance_um: float,
    left: np.ndarray,
) -> None:
    """Refusal for a spline whose curve may deviate by more than the tolerance.

    models: of the tool point and, if it is corrected, of the orientation. left: blocks that stay as programmed.
    """
    if not motions.splines:
        return
    blocks, (first, *_) = motions.blocks, motions.splines
    if why := _refused(motions, models, left):
        raise blocks[int(motions.block[first])].refuse(why)
    near = {row: _near(spline) for row, spline in motions.splines.items()}
    counts = [len(places) for places in near.values()]
    rows, places = np.repeat(list(near), counts), np.vstack(list(near.values()))
    shifts = np.split(_shifts(motions, rows, places, models, conditions), np.cumsum(counts)[:-1])
    for (row, spline), moved in zip(motions.splines.items(), shifts, strict=True):
        bound = 1e3 * _bound(motions, spline, near[row], moved)
        if bound > tolerance_um:
            raise blocks[int(motions.block[row])].refuse(
                f"the curve of {spline.name} may be {bound:.2f} um from the corrected curve, more than --tolerance-um: "
                "write its points closer together, or the path as G1"
            )


def _refused(motions: Motions, models: tuple[ErrorModel, ErrorModel | None], left: np.ndarray) -> str:
    """Why no spline of the moves is corrected; empty if splines are."""
    if models[1] is not None and motions.machine.rotary.any():
        return "the orientation along a spline is not corrected: write G1, or other --classes"
    if axes_with_backlash(models[0], motions.machine):
        return "the places where axes with backlash reverse along a spline are not known: write the path as G1"
    if np.isin(motions.block[list(motions.splines)], left).any():
        return "a spline leaves the range of the calibration, which would change its curve: write the path as G1"
    return ""


def _bound(motions: Motions, spline: Spline, places: Array, shifts: Array) -> float:
    """Largest distance, mm, of the curve at the last points of a spline from the corrected curve.

    places `(k, axes)`: its different points and positions near the curve, with their corrections.
    """
    linear = list(motions.machine.translators)
    count = len(_points(spline))
    if count < 2:
        return 0.0
    places, shifts = places[:, linear], shifts[:, linear]
    columns = np.column_stack([np.ones(len(places)), places - places[0]])
    rest = shifts - columns @ np.linalg.lstsq(columns, shifts, rcond=None)[0]
    chords = np.diff(places[:count], axis=0)
    lengths = np.linalg.norm(chords, axis=1)
    stretched = np.ptp(np.linalg.norm(chords + np.diff(shifts[:count], axis=0), axis=1) / lengths)
    bound = _largest(rest) + _largest(rest[:count]) + PARAMETER[spline.name] * stretched * lengths.max()
    if spline.name in STEEPEST:
        steps = np.linalg.norm(np.diff(rest[:count], axis=0), axis=1) / lengths
        bound += 2.0 * TANGENT * STEEPEST[spline.name] * steps.max() * lengths.max()
        if spline.name == "ASPLINE":
            turned = float((steps + stretched + 2.0 * motions.machine.rounding_mm / lengths).max())
            bound += _unstable(chords / lengths[:, None], lengths, turned)
    return float(bound)


def _points(spline: Spline) -> Array:
    """The points `(k, axes)` of a spline without repetitions."""
    points = np.array(spline.points)
    return np.asarray(points[np.r_[True, (np.diff(points, axis=0) != 0.0).any(axis=1)]])


def _largest(vectors: Array) -> float:
    return float(np.linalg.norm(vectors, axis=1).max())


def _near(spline: Spline) -> Array:
    """The points of a spline, and positions around which its curve lies `(k, axes)`.

    Between any two points and, of curves through the points, outside of them.
    """
    points = _points(spline)
    found = [*points, *((a + b) / 2.0 for a, b in combinations(points, 2))]
    if spline.name in STEEPEST:
        found += [q for a, b in pairwise(points) for q in (1.5 * a - 0.5 * b, 1.5 * b - 0.5 * a)]
    return np.array(found)


def _shifts(
    motions: Motions,
    rows: np.ndarray,
    places: Array,
    models: tuple[ErrorModel, ErrorModel | None],
    conditions: Conditions,
) -> Array:
    """Corrections `(k, axes)`, programmed coordinates, of positions in the frames of rows `(k,)`."""
    bare, datum = motions.bare.take(rows), datum_shifts(motions, models[0], conditions)[rows]
    nominal, movable = bare.in_machine(places), motions.movable[rows]
    corrected = corrected_positions(motions.machine, models, conditions.states(), nominal, bare.tool, movable, datum)
    return np.asarray(bare.in_program(corrected) - places)


def _unstable(directions: Array, lengths: Array, turned: float) -> float:
    """Change of the curve, mm, by the weights of the Akima tangents.

    directions `(k, 3)` and lengths `(k,)` of the chords; turned: largest change of a direction, rad.
    """
    ahead, behind = 2.0 * directions[0] - directions[1:2], 2.0 * directions[-1] - directions[-2:-1]
    chords = np.vstack([2.0 * ahead - directions[:1], ahead, directions, behind, 2.0 * behind - directions[-1:]])
    bends = np.linalg.norm(np.diff(chords, axis=0), axis=1)
    found = 0.0
    for point in range(1, len(lengths)):
        before, here, after = bends[point : point + 3]
        weight = min(1.0, 4.0 * turned / (before + after)) if before + after else 1.0
        found = max(found, 2.0 * TANGENT * here * weight * max(lengths[point - 1 : point + 1]))
    return found
