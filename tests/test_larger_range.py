"""A machine measured again over larger ranges than those of its calibration: what was unknown there is no cause."""

import msgspec
import numpy as np
import pytest
from support.tiers import quick
from support.virtual_measurements import THREE, measured, positions, truth

import machines
from calibration.diagnosis.diagnose import diagnose
from calibration.fit.calibrate import calibrate
from calibration.gaussian_terms.given.larger_range import Larger, extended, larger_ranges, within
from calibration.reports.diagnosis.document import diagnosis_json
from calibration.reports.diagnosis.page import diagnosis_report
from kinematics.basis import BSpline, Fourier, Legendre
from kinematics.effects import Backlash, ErrorMotion, LocationError
from kinematics.error_model.model import no_errors
from kinematics.turn import columns_of

CFRAME, DMU50 = machines.load("cframe"), machines.load("dmu50")
KNOWN, WHOLE = (0.0, 200.0), (-50.0, 360.0)


def motion(axis, basis):
    rng = np.random.default_rng(2)
    return ErrorMotion("X", axis, basis, tuple(rng.normal(0.0, 5.0, basis.size)), u=(0.2,) * basis.size)


@pytest.mark.parametrize(
    ("axis", "basis", "whole"),
    [
        ("X", BSpline((0.0, 40.0, 100.0, 200.0), 3), WHOLE),
        ("X", BSpline((0.0, 50.0, 100.0, 150.0, 200.0), 1), WHOLE),
        ("X", Legendre(KNOWN, 4), WHOLE),
        ("B", Fourier(KNOWN, (1.11, 2.22)), WHOLE),
        ("C", Fourier(KNOWN, (1.11, 2.22)), (0.0, 360.0)),
        ("C", BSpline((0.0, 60.0, 120.0, 200.0), 3), (0.0, 360.0)),
    ],
)
def test_a_calibration_stays_as_it_is_within_its_ranges_and_is_uncertain_outside(axis, basis, whole):
    model = msgspec.structs.replace(
        no_errors(DMU50), effects=(LocationError("C", "Y", 3.0, u=(1.0,)), motion(axis, basis))
    )
    longer = extended(model, DMU50, {axis: Larger(KNOWN, whole)})
    assert longer.effects[0] == model.effects[0]
    assert longer.effects[1].basis.interval == pytest.approx(whole)
    assert np.diff(longer.effects[1].basis.nodes).min() > 10.0
    own = DMU50.axes[DMU50.index(axis)]

    def error(model, x):
        columns, part = columns_of(own, model.effects[1].basis, x), model.slices[1]
        covariance = (
            np.array(model.covariance)[part, part] if model.covariance else np.diag(0.2**2 * np.ones(basis.size))
        )
        return columns @ model.parameters[part], np.sqrt(np.einsum("ij,jk,ik->i", columns, covariance, columns))

    inside, outside = np.linspace(*KNOWN, 50), np.linspace(KNOWN[1] + 40.0, whole[1] - 40.0, 20)
    (was, u_was), (now, u_now) = error(model, inside), error(longer, inside)
    size = np.sqrt(np.mean(was**2))
    np.testing.assert_allclose(now, was, atol=0.05 * size)
    np.testing.assert_allclose(u_now, u_was, atol=0.05 * size)
    now, u_now = error(longer, outside)
    assert u_now.max() > size
    assert np.abs(now - error(model, outside)[0]).max() < 3.0 * u_now.max()


def test_a_narrow_part_beyond_a_range_gets_no_nodes():
    model = msgspec.structs.replace(no_errors(DMU50), effects=(motion("X", Legendre(KNOWN, 4)),))
    (longer,) = extended(model, DMU50, {"X": Larger(KNOWN, (-1.0, 360.0))}).effects
    assert longer.basis.interval == (0.0, 360.0)


def seen(machine, model, seed, n, share=1.0, *, first=0.0):
    """Random positions of a machine, in a share of its travel from another share on."""
    rng = np.random.default_rng(seed)
    q = positions(machine, n, rng)
    low, high = machine.travel
    return measured(machine, low + first * (high - low) + share * (q - low), THREE, model, rng)


def test_the_ranges_of_the_data_are_compared_with_those_of_the_calibration():
    model = truth(CFRAME, np.random.default_rng(0))
    small, large = seen(CFRAME, model, 1, 100, 0.6), seen(CFRAME, model, 2, 100)
    calibration = calibrate(small, basis="b-spline:4", hold_out=False).model
    assert larger_ranges(calibration, small) == {}
    assert within(calibration, small).all()
    assert set(larger_ranges(calibration, large)) == {"X", "Y", "Z"}
    assert 0.1 < within(calibration, large).mean() < 0.4


@pytest.mark.parametrize(
    ("known", "degrees", "whole"),
    [
        ((0.0, 200.0), (0.0, 355.0), (0.0, 360.0)),
        ((300.0, 420.0), (0.0, 355.0), (300.0, 660.0)),
        ((300.0, 420.0), (-80.0, 100.0), (280.0, 460.0)),
        ((-60.0, 60.0), (290.0, 430.0), (-70.0, 70.0)),
    ],
)
def test_an_arc_is_extended_from_its_own_turn(known, degrees, whole):
    """The same positions of C may be counted from another turn, and an arc may go through zero."""
    model = msgspec.structs.replace(no_errors(DMU50), effects=(motion("C", Fourier(known, (1.0, 2.0))),))
    q = np.zeros((73, 5))
    q[:, DMU50.index("C")] = np.radians(np.linspace(*degrees, 73))
    (found,) = larger_ranges(model, measured(DMU50, q, THREE, no_errors(DMU50), np.random.default_rng(1))).values()
    assert found.known == known
    assert found.whole == pytest.approx(whole, abs=0.1)
    (longer,) = extended(model, DMU50, {"C": found}).effects
    assert longer.basis.interval == pytest.approx(whole, abs=0.1)
    own, x = DMU50.axes[DMU50.index("C")], np.linspace(*known, 50)
    was, now = (columns_of(own, each.basis, x) @ each.parameters for each in (*model.effects, longer))
    np.testing.assert_allclose(now, was, atol=0.05 * np.sqrt(np.mean(was**2)))


HIDDEN = [(hidden, basis) for hidden in ((), (Backlash("Y", 30.0),)) for basis in ("cubic:5", "legendre:4")]


@pytest.mark.parametrize(("hidden", "basis"), quick(HIDDEN, [], HIDDEN[2:3]))
def test_errors_outside_the_ranges_of_a_calibration_are_no_cause(hidden, basis):
    model = truth(CFRAME, np.random.default_rng(0))
    given = calibrate(seen(CFRAME, model, 1, 250, 0.6), basis=basis).model
    now = msgspec.structs.replace(model, effects=(*model.effects, *hidden))
    found = diagnose(seen(CFRAME, now, 5, 250), given)
    assert [(cause.kind, cause.axis) for cause in found.causes] == [("backlash", "Y") for _ in hidden]
    assert found.accepted
    assert sum(finding.check == "range" for finding in found.findings) == 3
    assert found.figures[1].chi2_reduced < 1.3
    names = [effect.name for effect in found.model.effects]
    assert len(set(names)) == len(names)
    assert not found.machine_change.significant or hidden


@pytest.mark.statistical
def test_with_no_row_in_common_nothing_says_whether_the_machine_has_changed():
    model = truth(CFRAME, np.random.default_rng(0))
    given = calibrate(seen(CFRAME, model, 1, 200, 0.4), basis="cubic:4").model
    found = diagnose(seen(CFRAME, model, 5, 200, 0.3, first=0.7), given)
    assert found.causes == ()
    assert not found.machine_change.significant
    assert diagnosis_json(found)["machine_change"]["u_um"] > found.machine_change.rms_um
    assert "CHANGED" not in diagnosis_report(found, "ncomp diagnose").verdict
