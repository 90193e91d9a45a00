"""A calibration with a second explanation of its data: U contains both."""

import numpy as np
import pytest

import machines
from calibration.fit.two_explanations import with_other
from calibration.simulation.true_model import model_of
from kinematics.basis import BSpline, Legendre
from kinematics.effects import ErrorMotion, LocationError

DMU50 = machines.load("dmu50")
X = np.linspace(-150.0, 150.0, 13)


def curve(basis, values, location, rng):
    """A straightness error motion and a squareness, with a random covariance."""
    model = model_of(DMU50, [ErrorMotion("Y", "X", basis, tuple(values)), LocationError("C", "Y", location)])
    root = rng.normal(size=(len(values) + 1,) * 2)
    return model.with_parameters(np.append(values, location), root @ root.T)


def functions(model):
    """Values `(14,)` of the error motion at positions and of the squareness, and their covariance."""
    basis = model.effects[0].basis
    columns = np.zeros((len(X) + 1, len(model.parameters)))
    columns[:-1, :-1] = basis.columns(X)
    columns[-1, -1] = 1.0
    return columns @ np.array(model.parameters), columns @ np.array(model.covariance) @ columns.T


@pytest.mark.parametrize("finer", [BSpline(tuple(np.linspace(-150.0, 150.0, 7).tolist()), 1), Legendre((-150, 150), 1)])
def test_the_mean_square_of_the_errors_is_that_of_both(finer):
    rng = np.random.default_rng(0)
    one = curve(finer, rng.normal(size=finer.size), 3.0, rng)
    straight = Legendre((-150.0, 150.0), 1)
    other = curve(straight, [1.0, -2.0], -1.0, rng)
    both = with_other(one, other, 0.3)
    (value, own), (second, theirs) = functions(one), functions(other)
    np.testing.assert_array_equal(both.parameters, one.parameters)
    wanted = 0.7 * own + 0.3 * (theirs + np.outer(second - value, second - value))
    np.testing.assert_allclose(functions(both)[1], wanted, atol=1e-9)
    np.testing.assert_allclose(both.effects[1].uncertainties[0] ** 2, wanted[-1, -1])


def test_an_effect_that_the_other_lacks_is_as_uncertain_as_before():
    rng = np.random.default_rng(1)
    one = curve(Legendre((-150.0, 150.0), 1), [1.0, 2.0], 3.0, rng)
    lacking = one.part(lambda effect: not isinstance(effect, LocationError))
    both = with_other(one, lacking, 0.5)
    assert both.effects[1].uncertainties[0] == pytest.approx(one.effects[1].uncertainties[0])
    np.testing.assert_allclose(np.array(both.covariance)[:2, :2], np.array(one.covariance)[:2, :2])
