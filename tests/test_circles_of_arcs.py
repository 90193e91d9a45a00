"""The centre of a corrected arc, also where its ends lie in one direction from the centre."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from postproc.motion.circle_columns import moved_centres
from postproc.motion.circles import OUT_OF_ROUND, RADIUS_DIFFERENCE_MM, SHORT_ARC, moved_centre, point_at
from postproc.motion.moves import Arc
from postproc.write.arcs import NominalArc

ANGLES = st.floats(-math.pi, math.pi)
RADII = st.sampled_from([1e-4, 0.0254, 1.0, 100.0, 1e4])
SHIFTS = st.tuples(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05))
SWEEPS = st.one_of(st.just(0.0), st.floats(-7.0, 7.0), st.sampled_from([1e-9, 1e-5, 1e-3]))


@given(ANGLES, SWEEPS, st.tuples(RADII, RADII), st.tuples(SHIFTS, SHIFTS, SHIFTS))
def test_the_shift_of_a_centre_is_bounded(begun, turned, radii, shifts):
    """By the shifts of the arc, and along its chord by its radius: larger shifts have no first order."""
    start, end = (
        (radius * math.cos(angle), radius * math.sin(angle))
        for radius, angle in zip(radii, (begun, begun + turned), strict=True)
    )
    centre = moved_centre((start, end), (0.0, 0.0), turned, shifts)
    largest = max(math.hypot(*shift) for shift in shifts)
    assert math.hypot(*centre) <= largest * (3.0 + 4.0 / SHORT_ARC) + min(math.hypot(*start), math.hypot(*end)) * 1.001


@st.composite
def shifted_arcs(draw, sweeps, largest, together):
    """An arc about the origin, and its new ends: shifted by at most `largest` radii, from each other by `together`."""
    radius, turned, sense = draw(st.floats(0.5, 100.0)), draw(st.floats(*sweeps)), draw(st.sampled_from([-1, 1]))
    start = point_at((radius, 0.0), (0.0, 0.0), draw(ANGLES))
    end = point_at(start, (0.0, 0.0), sense * turned)
    share = st.floats(-1.0, 1.0).map(lambda part: part * largest * radius)
    common, *apart = (draw(st.tuples(share, share)) for _ in range(4))
    shifts = [(common[0] + together * x, common[1] + together * y) for x, y in apart]
    arc = Arc((0, 1, 2), sense, (0.0, 0.0), full=False, form="incremental", words=(None, None))
    new = [(at[0] + by[0], at[1] + by[1]) for at, by in ((start, shifts[0]), (end, shifts[2]))]
    return NominalArc(arc, (start, end), sense * turned, shifts[1]), new[0], new[1]


def difference(circle, start, end):
    """Difference of the radii at both ends of the corrected arc, mm."""
    centre = circle.centre(start, end)
    return abs(math.dist(start, centre) - math.dist(end, centre))


@given(shifted_arcs((1.5, 4.5), 0.03, 1.0))
def test_ends_of_an_arc_that_are_shifted_differently_stay_on_one_circle(arc):
    """Also by a share of the radius that has no first order: an end that was not corrected, before a rotary axis."""
    circle, start, end = arc
    assert difference(circle, start, end) <= 2 * RADIUS_DIFFERENCE_MM + 1e-3 * math.dist(start, circle.arc.centre)
    assert circle.round_off(start, end) is None or difference(circle, start, end) > OUT_OF_ROUND / 2


@given(shifted_arcs((5.8, 6.28), 0.01, 0.02))
def test_a_nearly_full_circle_is_rounded_off_about_the_centre_that_is_written(arc):
    circle, start, end = arc
    moved = circle.round_off(start, end)
    if moved is not None:
        end = (end[0] + moved[0], end[1] + moved[1])
    assert difference(circle, start, end) < 0.6 * OUT_OF_ROUND


@given(st.lists(shifted_arcs((0.001, 6.28), 0.03, 1.0), min_size=1, max_size=5))
def test_centres_in_columns_are_those_of_single_arcs(arcs):
    circles, starts, ends = zip(*arcs, strict=True)
    shifts = [
        [complex(new[0] - at[0], new[1] - at[1]) for new, at in zip(of, nominal, strict=True)]
        for of, nominal in ((starts, [c.ends[0] for c in circles]), (ends, [c.ends[1] for c in circles]))
    ]
    nominal = [np.array([complex(*c.ends[i]) for c in circles]) for i in (0, 1)]
    middles = np.array([complex(*c.middle_shift) for c in circles])
    moved = (np.array(shifts[0]), middles, np.array(shifts[1]))
    turned = np.array([c.turned for c in circles])
    found = moved_centres((nominal[0], nominal[1]), np.zeros(len(circles), complex), turned, moved)
    expected = [complex(*c.centre(start, end)) for c, start, end in arcs]
    assert found == pytest.approx(expected, abs=1e-9)
