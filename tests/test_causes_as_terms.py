"""Causes and functions without a name as terms: their columns, their odds, their finer members."""

from collections import defaultdict
from functools import cache

import numpy as np
import pytest
from support.ballbar_cases import circles_of
from support.diagnosis_cases import CFRAME, data_with
from support.interferometer_runs import runs
from support.probe_cases import probed
from support.tiers import quick
from support.virtual_measurements import ONE, THREE, measured, positions

import machines
from calibration.diagnosis.candidates import Candidates
from calibration.diagnosis.contract import family_of
from calibration.diagnosis.diagnose import diagnose
from calibration.diagnosis.dictionary import Dictionary
from calibration.diagnosis.named import named, shape_of
from calibration.diagnosis.nameless import nameless, second_moment
from calibration.diagnosis.prior_odds import with_prior_odds
from calibration.diagnosis.waves import waves
from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.structure import Data, Structure
from calibration.gaussian_terms.term import Term
from calibration.instruments import Part
from calibration.simulation.simulate import observe
from kinematics.effects import (
    Backlash,
    Cyclic,
    GrowthWithTime,
    LocationJump,
    QuantisedCompensation,
    StationShift,
    ThermalDrift,
)
from kinematics.error_model.model import no_errors
from kinematics.error_model.priors import PRIORS
from kinematics.state import State

CUBE = 100.0 * (1.0 + np.array(list(np.ndindex(3, 3, 3)), float))
"""Positions `(27, 3)` of the C-frame, mm."""
GANTRY, DMU50 = machines.load("gantry"), machines.load("dmu50")


def grid(n, rng):
    """Positions of the gantry that most rows share with another one."""
    low, high = GANTRY.travel
    return low + rng.integers(0, 25, (n, 3)) / 24.0 * (high - low)


@cache
def observed(name: str) -> Observations:
    """A short measurement; one with temperatures that are no trend, on a grid; one of five axes from two stations."""
    rng = np.random.default_rng(7)
    machine, q, targets, stations = {
        "cframe": (CFRAME, positions(CFRAME, 60, rng), ONE, 1),
        "gantry": (GANTRY, grid(200, rng), THREE, 1),
        "dmu50": (DMU50, positions(DMU50, 60, rng), ONE, 2),
    }[name]
    kelvin = np.cumsum(rng.normal(size=len(q)))
    more = {"temperatures": {"column": kelvin}, "spindle_speed": rng.uniform(0.0, 6000.0, len(q))}
    columns = more if name == "gantry" else {}
    return Observations.of(measured(machine, q, targets, no_errors(machine), rng, stations=stations, **columns))


@cache
def terms_of(name: str) -> list[Term]:
    return with_prior_odds([*named(observed(name)), *nameless(observed(name))], PRIORS)


MEASUREMENTS = pytest.mark.parametrize("name", ["cframe", "gantry", "dmu50"])


@MEASUREMENTS
def test_columns_are_finite(name):
    for term in terms_of(name):
        columns = term.make()
        assert columns.shape == (*observed(name).residual.shape, term.width), term.name
        assert np.isfinite(columns).all(), term.name
        assert term.named or columns.any(), term.name


def assert_derivatives(observations: Observations, terms: list[Term]) -> None:
    for term in terms:
        linear = np.concatenate([effect.linear for effect in term.effects])
        expected = observations.columns(term.effects)[:, :, linear] @ term.parameters
        assert np.abs(term.make() - expected).max() <= 1e-9 * np.abs(expected).max(), term.name


@MEASUREMENTS
def test_columns_are_derivatives_by_the_parameters_of_the_effects(name):
    """But for swings and walks, whose effects have their size only."""
    compared = [term for term in terms_of(name) if term.effects and term.kind not in {"swing", "walk"}]
    assert {"backlash", "location-jump", "smooth", "cross-axis"} <= {term.kind for term in compared}
    assert_derivatives(observed(name), compared)


OTHERS = {
    "interferometer": lambda: runs(lambda x: 0.01 * x, np.linspace(0.0, 4000.0, 21), np.random.default_rng(1)),
    "ballbar": lambda: circles_of(step=5.0)[0],
    "probe": lambda: probed("dmu50", 20)[0],
    "part": lambda: observe(CFRAME, no_errors(CFRAME), State(CUBE), Part(u_um=2.0), np.random.default_rng(1)),
}


@pytest.mark.parametrize("instrument", OTHERS)
def test_other_instruments_have_the_same_terms(instrument):
    observations = Observations.of(OTHERS[instrument]())
    terms = with_prior_odds([*named(observations), *nameless(observations), *waves(fitted(observations))], PRIORS)
    assert terms
    for term in terms:
        assert term.make().shape == (*observations.residual.shape, term.width), term.name
        assert np.isfinite(term.make()).all(), term.name
    assert_derivatives(observations, [term for term in terms if term.effects and term.kind not in {"swing", "walk"}])


@MEASUREMENTS
def test_families_share_the_odds_of_their_kind(name):
    terms, kinds = terms_of(name), defaultdict(set)
    own = [np.exp(term.log_prior) for term in terms]
    for term in terms:
        kinds[term.family].add(term.kind)
    assert sum(own[i] for i, term in enumerate(terms) if "thermal-drift" in kinds[term.family]) == pytest.approx(
        PRIORS.common / (1.0 - PRIORS.common)
    )
    for kind in {term.kind for term in terms}:
        whole = sum(odds for odds, term in zip(own, terms, strict=True) if kind in kinds[term.family])
        most = getattr(PRIORS, kind, PRIORS.common)
        assert 0.0 < whole <= most / (1.0 - most) * (1 + 1e-9), kind


def test_a_shift_of_the_tool_is_likelier_than_a_tilt():
    odds = defaultdict(float)
    for term in terms_of("cframe"):
        if term.kind == "thermal-drift":
            odds[term.where] += np.exp(term.log_prior)
    assert odds["X"] == pytest.approx(odds["Z"])
    assert odds["X"] > 10.0 * odds["A"]


@MEASUREMENTS
def test_the_families_of_other_causes_differ(name):
    """Members of a family have one place; those of one form differ in a time constant, a moment or an angle."""
    families = defaultdict(list)
    for term in terms_of(name):
        families[term.family].append(term)
    for members in families.values():
        assert len({term.where for term in members}) == 1
        effects = [(term.name, term.effects, term.width) for term in members if term.kind not in {"swing", "smooth"}]
        assert len(set(effects)) == len(effects)


def test_growth_about_any_fixed_point_has_two_effects():
    term = next(term for term in terms_of("cframe") if term.kind == "thermal-scale" and len(term.effects) == 2)
    low, high = observed("cframe").measurement.moving[term.where]
    assert [effect.fixed_point for effect in term.effects] == pytest.approx([(low + high) / 2.0, high])
    # whatever the coefficients, the growth of the two together leaves one position where it is
    rates = term.parameters @ [1.5, 0.4]
    fixed = sum(rate * effect.fixed_point for rate, effect in zip(rates, term.effects, strict=True)) / rates.sum()
    assert fixed == pytest.approx((low + high) / 2.0 + 0.4 / 1.5 * (high - low) / 2.0)


def value_of(term: Term) -> float | None:
    """The time constant, lag, length, moment or angle of a term."""
    (effect, *_) = term.effects or (None,)
    if effect is None:
        return None
    if effect.moment is not None or hasattr(effect, "above_deg"):
        return effect.moment if effect.moment is not None else effect.above_deg
    shape = shape_of(effect)
    value = None if shape is None else getattr(effect, shape.name)
    return value[0] if isinstance(value, tuple) else value


@MEASUREMENTS
def test_finer_members_lie_between_their_neighbours(name):
    forms = defaultdict(list)
    for term in terms_of(name):
        if term.finer is not None and term.named:
            forms[term.family, type(term.effects[0]), len(term.effects), term.width].append(term)
    assert forms
    for members in forms.values():
        values = sorted(value_of(term) for term in members)
        for term in members[:: max(len(members) // 3, 1)]:
            at = values.index(value_of(term))
            low, high = (values[at - 1] if at else -np.inf), (values[at + 1] if at + 1 < len(values) else np.inf)
            finer = list(term.finer())
            assert all(low < value_of(each) < high for each in finer)
            assert all(each.family == term.family and each.log_prior == term.log_prior for each in finer)
            assert all(len(each.effects) == len(term.effects) for each in finer)
            for each in finer[:1]:
                again = [value_of(other) for other in each.finer()]
                assert all(low < value < high for value in again)
                assert not again or np.ptp(again) < high - low


def test_every_moment_of_a_jump_can_be_reached():
    """From each moment to those between its neighbours, and so on."""
    jumps = [term for term in terms_of("cframe") if term.kind == "station-shift"]
    reached, left = set(), list(jumps)
    while left:
        term = left.pop()
        if value_of(term) not in reached:
            reached.add(value_of(term))
            left += term.finer()
    times = observed("cframe").measurement.state.time
    assert reached == set(times[8:-8].tolist())


def test_the_size_of_a_swing_is_that_of_both_phases():
    term = next(term for term in terms_of("cframe") if term.kind == "swing")
    rng = np.random.default_rng(1)
    mean = rng.normal(size=term.width)
    moment = second_moment(term, mean, np.zeros((term.width, term.width)))
    (effect,) = term.effects
    position = observed("cframe").columns([effect])
    sine, cosine = (position @ part for part in (term.parameters * mean).reshape(len(moment), 2, -1).sum(axis=2).T)
    variance = np.einsum("ndp,pq,ndq->nd", position, moment, position)
    assert variance == pytest.approx(sine**2 + cosine**2)
    # the course itself is never larger
    assert np.all((term.make() @ mean) ** 2 <= variance * (1.0 + 1e-9))


def test_the_size_of_a_walk_is_its_rms():
    term = next(term for term in terms_of("gantry") if term.kind == "walk")
    mean = np.random.default_rng(1).normal(size=term.width)
    moment = second_moment(term, mean, np.zeros((term.width, term.width)))
    course = term.make() @ mean
    constant = observed("gantry").columns(term.effects)[:, :, 0]
    um = np.sum(course * constant, axis=1) / np.sum(constant**2, axis=1)
    assert moment == pytest.approx(np.mean(um**2), rel=0.3)


def test_finer_swings_are_as_likely_and_depend_on_two_axes():
    swing = next(term for term in terms_of("gantry") if term.kind == "swing")
    assert swing.finer is not None
    finer = list(swing.finer())
    assert {term.family for term in finer} == {swing.family}
    assert {round(term.log_prior, 6) for term in finer} == {round(swing.log_prior, 6)}
    assert {term.variables[1:] for term in finer} >= {("X", "Y"), ("X", "Z"), ("Y", "Z")}
    assert all(np.isfinite(term.make()).all() and term.effects for term in finer)


def test_errors_of_positions_that_are_visited_again():
    fine = {term.where: term for term in terms_of("gantry") if term.kind == "fine"}
    assert set(fine) == {"X", "Y", "Z"}
    assert not any(term.kind == "fine" for term in terms_of("cframe"))


def test_a_temperature_that_is_no_trend_is_a_variable():
    assert any("temperature column" in term.variables for term in terms_of("gantry"))
    assert not any("temperature column" in term.variables for term in terms_of("cframe"))


def fitted(observations: Observations) -> Structure:
    return Structure.first(Data.of(observations)).fitted()


def test_the_odds_of_all_terms_at_once_are_those_of_each():
    """Also of errors of X at its single positions, which are no displacement along the X of a tool that swivels."""
    machine, rng = machines.load("head_head"), np.random.default_rng(3)
    low, high = (np.array(ends) for ends in machine.travel)
    q = low + rng.integers(0, 23, (140, len(low))) / 22.0 * (high - low)
    own = Observations.of(measured(machine, q, ONE, no_errors(machine), rng))
    terms = with_prior_odds([*named(own), *nameless(own)], PRIORS)
    terms = [term for i, term in enumerate(terms) if i % 7 == 0 or term.kind == "fine"]
    assert {term.where for term in terms if term.kind == "fine"} >= {"X", "Y", "Z"}
    candidates = Candidates.of(fitted(own), Dictionary(terms))
    np.testing.assert_allclose(candidates.odds(), candidates.exact(terms), rtol=1e-4, atol=1e-3)


def likeliest(candidates: Candidates, count: int) -> list[Term]:
    """The best members of the likeliest families."""
    families = candidates.by_family(candidates.odds()).values()
    return [candidates.terms[best] for _, best in sorted(families, key=lambda each: -each[0])[:count]]


LIKELIEST = [
    Backlash("Y", 15.0),
    LocationJump("X", "X", 30.0, 800.0),
    ThermalDrift(component="Z", amplitudes=(40.0,), time_constants_s=(300.0,)),
    GrowthWithTime("X", rate=900.0, fixed_point=250.0),
    LocationJump("C", "Y", 250.0, 700.0, fixed_point=200.0),
    StationShift("s1", (10.0, -20.0, 5.0), (10.0, 0.0, 20.0), since_s=700.0),
]


@pytest.mark.parametrize("effect", quick(LIKELIEST, LIKELIEST[:2]), ids=lambda effect: effect.name)
def test_a_cause_is_the_likeliest_in_its_own_data(effect):
    observations = Observations.of(data_with(effect))
    terms = with_prior_odds([*named(observations), *nameless(observations)], PRIORS)
    structure = fitted(observations)
    best = likeliest(Candidates.of(structure, Dictionary(terms)), 4)
    totals = [structure.with_terms([term]).fitted().total for term in best]
    found = best[int(np.argmax(totals))]
    assert found.family == family_of(effect)
    assert max(totals) > structure.total + 5.0
    if effect.moment is not None:
        assert abs(value_of(found) - effect.moment) <= 60.0


@pytest.mark.parametrize(
    ("effect", "period"),
    [
        (Cyclic("X", "X", 10.0, (8.0,), (3.0,)), 10.0),
        (Cyclic("Y", "Y", 60.0, (0.0,), (10.0,)), 60.0),
        (QuantisedCompensation("Y", 14.0, 25.0, 3.0), 25.0),
    ],
    ids=lambda each: getattr(each, "name", ""),
)
def test_a_wave_is_proposed(effect, period):
    structure = fitted(Observations.of(data_with(effect, n=160)))
    candidates = Candidates.of(structure, Dictionary([]), waves(structure))
    (found,) = likeliest(candidates, 1)
    assert found.family == family_of(effect)
    assert value_of(found) == pytest.approx(period, rel=0.02)
    own = candidates.exact([found])[0]
    for _ in range(2):
        closer = list(found.finer())
        found = closer[int(np.argmax(candidates.exact(closer)))]
    assert value_of(found) == pytest.approx(period, rel=0.005)
    assert candidates.exact([found])[0] > own - 1.0
    assert found.log_prior == closer[0].log_prior


def test_the_period_of_a_wave_is_within_its_uncertainty():
    (found,) = diagnose(data_with(Cyclic("Y", "Y", 60.0, (0.0,), (10.0,)), n=160)).causes
    assert found.kind == "cyclic"
    assert found.effect.period == pytest.approx(60.0, abs=3.0 * found.effect.u[-1])
    assert found.effect.u[-1] < 0.5


def test_a_second_wave_of_an_axis_is_a_cause_of_its_own():
    two = [Cyclic("X", "X", 10.0, (12.0,), (3.0,)), Cyclic("X", "X", 36.0, (8.0,), (8.0,))]
    structure = fitted(Observations.of(data_with(*two, n=200)))
    (first,) = likeliest(Candidates.of(structure, Dictionary([]), waves(structure)), 1)
    structure = structure.with_terms([first]).fitted()
    (second,) = likeliest(Candidates.of(structure, Dictionary([]), waves(structure)), 1)
    assert sorted(map(value_of, (first, second))) == pytest.approx([10.0, 36.0], rel=0.01)
    assert second.family != first.family
    # in the place of the first one: the same wave again
    again = [term for term in waves(structure, without=(0,)) if term.family == first.family]
    assert min(abs(value_of(term) / value_of(first) - 1.0) for term in again) < 0.01


def test_the_odds_of_waves_are_shared_by_all_that_are_scanned():
    structure = fitted(observed("cframe"))
    own = [np.exp(term.log_prior) for term in waves(structure) if term.kind == "cyclic"]
    assert 0.05 * PRIORS.common < sum(own) < PRIORS.common
    assert not any(term.kind == "cyclic" for term in terms_of("cframe"))
