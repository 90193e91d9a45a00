"""Nested bases: a refined basis reproduces every function of the coarse one exactly."""

import numpy as np
import pytest
from hypothesis import strategies as st
from support.tiers import drawn

from calibration.gaussian_terms.given.nested_bases import embedding, refined
from kinematics.basis import BSpline, Fourier, Harmonics, Legendre, Polynomial

NODES = st.lists(st.integers(-40, 40), min_size=2, max_size=9, unique=True).map(
    lambda nodes: tuple(12.5 * node for node in sorted(nodes))
)
BASES = st.one_of(
    st.builds(BSpline, NODES, st.sampled_from((1, 3))),
    st.builds(Legendre, st.just((-225.0, 225.0)), st.integers(0, 8)),
    st.builds(Polynomial, st.just((0.0, 600.0)), st.integers(0, 5)),
    st.builds(Harmonics, st.just((-180.0, 180.0)), st.integers(0, 6)),
    st.builds(lambda n: Fourier((0.0, 5000.0), tuple(0.5 * k for k in range(1, n + 1))), st.integers(1, 3)),
)


@drawn(few=60, many=400, basis=BASES, times=st.integers(1, 2), seed=st.integers(0, 999))
def test_a_refined_basis_contains_every_function_of_the_coarse_one(basis, times, seed):
    fine = basis
    for _ in range(times):
        fine = refined(fine)
    rng = np.random.default_rng(seed)
    parameters = rng.normal(size=basis.size)
    low, high = basis.interval
    x = rng.uniform(low - 0.2 * (high - low), high + 0.2 * (high - low), 200)  # end values hold outside
    found = fine.columns(x) @ (embedding(basis, fine) @ parameters)
    assert found == pytest.approx(basis.columns(x) @ parameters, abs=1e-8)
    assert fine.size > basis.size
    assert fine.interval == basis.interval


@drawn(few=20, many=100, basis=BASES)
def test_a_coarse_basis_does_not_contain_the_refined_one(basis):
    assert embedding(refined(basis), basis) is None
    assert np.array_equal(embedding(basis, basis), np.eye(basis.size))


def test_other_nodes_are_not_nested():
    assert embedding(BSpline((0.0, 4.0, 10.0), 1), BSpline((0.0, 5.0, 10.0), 1)) is None
    assert embedding(BSpline((0.0, 4.0, 10.0), 3), BSpline((0.0, 4.0, 7.0, 10.0), 3)) is not None
