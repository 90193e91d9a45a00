"""Normal matrices from products of arms and functions, against those of the columns themselves."""

from dataclasses import replace
from unittest.mock import patch

import msgspec
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from support.virtual_measurements import THREE, measured, positions, truth

import machines
from calibration.measurement.estimated_noise import Decorrelation, EstimatedNoise
from calibration.observation import products
from calibration.observation.full_model import BasisChoice, rigid_model
from calibration.observation.normal_equations import (
    NormalEquations,
    assemble,
    derivatives,
    residuals,
    whitened,
)
from calibration.observation.products import Functions, Products, arm_products, between
from kinematics.effects import Backlash
from kinematics.error_model.effect_sums import Design

BASES = ("b-spline:2", "b-spline:12", "cubic:3", "cubic:14", "legendre:0", "legendre:4", "fourier:1", "fourier:5")


def tables(n):
    """Tables of functions: dense, banded, with rows of zeros."""

    def banded(size, width, seed):
        rng = np.random.default_rng(seed)
        table = np.zeros((n, size))
        for row in range(n):
            first = rng.integers(0, size - width + 1)
            table[row, first : first + width] = rng.normal(size=width) * (rng.random() < 0.9)
        return table

    sizes = st.integers(1, 30)
    return sizes.flatmap(lambda size: st.builds(banded, st.just(size), st.integers(1, size), st.integers(0, 1000)))


@given(st.integers(1, 40).flatmap(lambda n: st.tuples(tables(n), tables(n))), st.integers(1, 3), st.integers(0, 4))
@settings(max_examples=60, deadline=None)
def test_blocks_are_those_of_the_columns(of_both, d, m):
    rng = np.random.default_rng(len(of_both[0]))
    parts = []
    for table, arms in zip(of_both, (m, 3), strict=True):
        functions = Functions.of(table)
        assert np.array_equal(functions.table, table)
        parts.append(Products(rng.normal(size=(len(table), d, arms)), functions))
    parts.append(Products(rng.normal(size=(len(table), d, 2))))
    for a in parts:
        parameters = rng.normal(size=a.width)
        np.testing.assert_allclose(a.times(parameters), a.columns @ parameters, rtol=0, atol=1e-11)
        for b in parts:
            columns = [part.columns.reshape(len(table) * d, part.width) for part in (a, b)]
            expected = columns[0].T @ columns[1]
            assert between(a, b).shape == expected.shape == (a.width, b.width)
            np.testing.assert_allclose(
                between(a, b), expected, rtol=0, atol=1e-12 * (1 + np.abs(expected).max(initial=0))
            )
            np.testing.assert_array_equal(between(a, b), between(a, b, arm_products(a, b)))


def data(name, n, seed, stops=0):
    """A measurement, with the noise of axes that do not repeat where stops have several rows."""
    machine, rng = machines.load(name), np.random.default_rng(seed)
    q = positions(machine, n, rng)
    if stops:
        q = np.repeat(q[: -(-n // stops)], stops, axis=0)[:n]
    found = measured(machine, q, THREE, truth(machine, rng), rng, stations=2)
    if not stops:
        return found
    arms = rng.normal(size=(n, 3, 2)) * 1e-3
    return replace(found, noise=EstimatedNoise(1.3, {"X": 0.001, "Y": 0.001}, np.arange(n) // stops, arms))


def by_columns(measurement, model, registration, white, residual, decorrelation):
    """The normal equations of all columns of the design, made one by one."""
    transform = measurement.instrument.transform(measurement, registration)
    design = Design(model.effects, measurement.machine, measurement.state, with_instrument=True).of(
        slice(None), transform
    )
    design = np.concatenate([measurement.instrument.registration_design(measurement, registration), design], axis=2)
    design = decorrelation.apply(white @ design).reshape(residual.size, -1)
    return NormalEquations(design.T @ design, design.T @ residual.reshape(-1))


@given(
    st.sampled_from(("gantry", "dmu50", "head_table")),
    st.lists(st.sampled_from(BASES), min_size=5, max_size=5),
    st.integers(0, 100),
    st.sampled_from((0, 2, 3)),
    st.sets(st.integers(0, 17), max_size=6),
    st.booleans(),
    st.sampled_from((0, 10_000, 1_000_000)),
)
@settings(max_examples=25, deadline=None)
def test_normal_equations_are_those_of_the_columns(name, bases, seed, stops, missing, besides, few):
    measurement = data(name, 60, seed, stops)
    axes = list(measurement.moving)
    model = rigid_model(measurement, dict(zip(axes, map(parsed, bases), strict=False)))
    effects = [effect for k, effect in enumerate(model.effects) if k not in missing]
    # the order of the effects is any
    effects = [effects[k] for k in np.random.default_rng(seed).permutation(len(effects))]
    if besides:
        effects.insert(2, Backlash("X", 3.0))
    model = msgspec.structs.replace(model, effects=tuple(effects))
    registration = measurement.instrument.first_registration(measurement, np.ones(60, bool))
    white = measurement.whiteners
    decorrelation = Decorrelation.of(measurement.noise, white)
    left = residuals(measurement, model, registration)
    residual = decorrelation.apply(whitened(white, left))
    expected = by_columns(measurement, model, registration, white, residual, decorrelation)
    with patch.object(products, "FEW_DERIVATIVES", few):
        assembled = assemble(measurement, model, registration, white, residual, decorrelation)
        kept = derivatives(measurement, model, registration, np.inf)
        assert derivatives(measurement, model, registration, 100) is None
    again = kept.whitened(white, decorrelation)
    for found in (assembled, again.normal(residual)):
        agree(found.matrix, expected.matrix)
        agree(found.right, expected.right)
    agree(again.along(residual), expected.right)


def test_functions_that_differ_within_a_stop_are_decorrelated_as_columns():
    measurement = data("gantry", 40, 5, 2)
    moved = np.array(measurement.state.positions)
    moved[1::2] += 0.5
    measurement = replace(measurement, state=replace(measurement.state, positions=moved))
    model = rigid_model(measurement, dict.fromkeys("XYZ", BasisChoice("cubic", 6)))
    registration = measurement.instrument.first_registration(measurement, np.ones(40, bool))
    white = measurement.whiteners
    decorrelation = Decorrelation.of(measurement.noise, white)
    assert decorrelation.stops
    residual = decorrelation.apply(whitened(white, residuals(measurement, model, registration)))
    with patch.object(products, "FEW_DERIVATIVES", 0):
        found = assemble(measurement, model, registration, white, residual, decorrelation)
    agree(found.matrix, by_columns(measurement, model, registration, white, residual, decorrelation).matrix)


def agree(found, expected):
    """Equal to rounding, in units of the diagonal where they are matrices."""
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected))) if expected.ndim == 2 else np.abs(expected).max()
    assert np.all(np.abs(found - expected) <= 1e-10 * scale + 1e-300)


def parsed(text):
    kind, size = text.split(":")
    return BasisChoice(kind, int(size))
