"""The centre of a corrected arc, also where its ends lie in one direction from the centre."""

import math

from hypothesis import given
from hypothesis import strategies as st

from postproc.motion.circles import SHORT_ARC, moved_centre

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
