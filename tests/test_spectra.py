"""Spectra over positions, and periods that positions cannot tell apart."""

import numpy as np
import pytest
from calibration.diagnosis.search.shapes.spectra import Waves, aliases, lattice
from hypothesis import given
from hypothesis import strategies as st


@pytest.mark.parametrize("count", [1, 2, 7, 100])
def test_spectra_against_their_definition(count):
    rng = np.random.default_rng(count)
    x, values = rng.uniform(-300.0, 500.0, 60), rng.normal(size=(2, 60))
    frequencies = 0.01 + np.arange(count) * 3e-4
    expected = values @ np.exp(2j * np.pi * x[:, None] * frequencies)
    waves = Waves.of(x, frequencies)
    np.testing.assert_allclose(waves.sums(values), expected, atol=1e-9)
    some = np.array([count - 1, 0])
    np.testing.assert_allclose(waves.at(some), np.exp(2j * np.pi * x[:, None] * frequencies[some]), atol=1e-9)


@given(
    pitch=st.floats(0.5, 50.0),
    start=st.floats(-500.0, 500.0),
    steps=st.lists(st.integers(1, 3), min_size=5, max_size=40).filter(lambda steps: 1 in steps),
)
def test_positions_on_a_lattice_are_known_as_such(pitch, start, steps):
    x = start + pitch * np.cumsum([0, *steps])
    assert lattice(x) == pytest.approx(pitch, abs=2e-3)


@given(st.integers(0, 10_000))
def test_random_positions_are_no_lattice(seed):
    assert lattice(np.random.default_rng(seed).uniform(0.0, 600.0, 60)) is None


def test_aliases_are_the_periods_that_a_lattice_can_not_tell_apart():
    x = 10.0 * np.arange(40)
    told = aliases(x, 23.0)
    assert len(told) == 4
    for period in told:
        alike = [np.cos(2 * np.pi * x / each) for each in (23.0, period)]
        assert alike[0] == pytest.approx(alike[1], abs=1e-6)


def test_irregular_positions_have_no_aliases():
    assert aliases(np.random.default_rng(3).uniform(0.0, 600.0, 60), 8.0) == []
