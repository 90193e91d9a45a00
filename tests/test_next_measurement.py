"""What to measure next: designs that answer what the data leave open, and no others."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from support.bench import (
    BENCH,
    by_interferometer,
    five_axes,
    in_motion,
    planned,
    seen,
    shuffled,
    swept,
    to_and_fro,
    together,
)
from support.tiers import quick

from calibration.diagnosis.conclusion.result import Diagnosis
from calibration.diagnosis.diagnose import diagnose
from calibration.diagnosis.forms import plain
from calibration.diagnosis.named import named
from calibration.diagnosis.next.questions import Known, Question, Signal
from calibration.diagnosis.next.stacked_rows import StackedRows
from calibration.follow_up.designs import follow_up_designs
from calibration.gaussian_terms.observations import Observations
from calibration.gaussian_terms.structure import Data, Structure
from calibration.measurement.measurement import Measurement
from kinematics.effects import (
    AirScale,
    Backlash,
    CrossAxis,
    Cyclic,
    DriftWithSensor,
    Effect,
    GrowthWithTime,
    RangeOffset,
    Settling,
    ThermalDrift,
    TrackerDrift,
    Unnamed,
)

BACKLASH = Backlash("X", 12.0)
SPANS = (0.0, 600.0), (0.0, 600.0)
UNNAMED = Unnamed(
    component="Z", variables=("X", "Y"), ranges=SPANS, terms=((3, 2), (2, 3), (4, 4)), coefficients=(12.0, -9.0, 14.0)
)


@cache
def tied() -> Diagnosis:
    """Backlash, measured with moves by which it looks like other causes of the drive."""
    return diagnose(seen(to_and_fro(), BACKLASH))


def separated(answer: Diagnosis, rival: str) -> set[str]:
    """Designs that separate the backlash from a rival, as it is said."""
    return {each.name for each in answer.proposals if each.minutes and rival in each.text}


def test_the_design_that_tells_most_in_a_minute_comes_first():
    (cause,) = tied().causes
    assert cause.verdict == "tied"
    designs = [each for each in tied().proposals if each.minutes]
    gains = [each.gain_per_minute for each in designs]
    assert gains == sorted(gains, reverse=True)
    assert len(set(gains)) > 1
    assert all(f"({each.minutes:.0f} min)" in each.text and "to 1 expected" in each.text for each in designs)
    assert "separates backlash X from settling X" in designs[0].text


DESIGNS = [
    "shuffled, fewer", "move lengths", "other side", "target below", "retrace", "bar", "second station across the volume",
]  # fmt: skip


@pytest.mark.parametrize("design", quick(DESIGNS, ["move lengths", "bar"]))
def test_a_tie_ends_by_the_designs_that_are_said_to_end_it_and_by_no_others(design):
    """The designs are measured on the virtual machine with the backlash, and both measurements diagnosed as one."""
    data = seen(to_and_fro(), BACKLASH)
    again = diagnose(together(data, planned(data, design), BACKLASH))
    (cause,) = again.causes
    assert cause.kind == "backlash"
    left = {each.kind for each in cause.alternatives}
    for rival in ("settling", "reversal-spike"):
        assert (design in separated(tied(), rival)) == (rival not in left)
    assert (cause.verdict == "strong") == (not left)


def test_another_order_shows_whether_a_function_without_a_name_recurs():
    found = diagnose(seen(swept(), UNNAMED))
    assert found.unexplained
    asking = [each for each in found.proposals if "recurs with the position or with the time" in each.text]
    assert {"retrace", "shuffled"} <= {each.name for each in asking}
    assert not {"other side", "bar", "move lengths"} & {each.name for each in asking}
    assert found.proposals[0] in asking


@pytest.mark.statistical
def test_irregular_positions_find_a_period_that_equal_steps_leave_open():
    """At steps of 20 mm a wave of 12.5 mm looks like waves of 33.3, 7.7, 4.8 mm and others."""
    rng, wave = np.random.default_rng(1), Cyclic("X", "X", 12.5, (8.0,), (5.0,))
    q = rng.uniform(0.0, 450.0, (150, 3))
    q[:, BENCH.index("X")] = 20.0 * rng.integers(0, 31, 150)
    data = seen(q, wave, seed=1)
    found = diagnose(data)
    assert [len(each.periods) > 1 for each in found.unexplained] == [True]
    best = found.proposals[0]
    assert (best.name, "finds the period" in best.text) == ("finer X", True)
    (cause,) = diagnose(together(data, planned(data, best.name), wave)).causes
    assert (cause.kind, cause.verdict) == ("cyclic", "strong")
    assert isinstance(cause.effect, Cyclic)
    assert cause.effect.period == pytest.approx(12.5, abs=0.05)


@pytest.mark.statistical
def test_a_weak_cause_is_confirmed_by_the_first_design():
    weak = Backlash("X", 0.7)
    data = seen(shuffled(), weak, seed=11)
    (before,) = (found := diagnose(data)).causes
    assert before.log_odds < np.log(150.0)
    best = found.proposals[0]
    assert "confirms backlash X" in best.text
    (after,) = diagnose(together(data, planned(data, best.name), weak)).causes
    assert after.kind == "backlash"
    assert after.log_odds > np.log(150.0)


@pytest.mark.statistical
def test_fixed_targets_tell_a_drifting_machine_from_a_drifting_tracker():
    drift = ThermalDrift(component="X", rate=2.0)
    data = seen(shuffled(), drift, seed=1)
    (before,) = (found := diagnose(data)).causes
    assert "tracker-range-drift" in {each.kind for each in before.alternatives}
    separating = [each for each in found.proposals if each.minutes and "tracker-range-drift" in each.text]
    assert separating
    assert all("fixed targets" in each.text for each in separating)
    (after,) = diagnose(together(data, planned(data, separating[0].name), drift)).causes
    assert (after.kind, after.axis) == ("thermal-drift", "X")
    assert not {each.kind for each in after.alternatives if each.kind.startswith(("tracker", "air"))}


def test_where_nothing_is_in_doubt_nothing_is_proposed():
    found = diagnose(seen(shuffled(), BACKLASH))
    assert [(cause.effect.name, cause.verdict) for cause in found.causes] == [("backlash X", "strong")]
    assert not found.proposals


# ---- causes that are parallel in some data: designs in which they are not


SIZE = 3.0
"""Size of a cause, in typical sizes."""
CLEARLY, NOT_CLEARLY = 20.0, 5.0
"""Log odds by which causes are separated for certain, and that leave a tie."""
ORDERS = {"retrace", "shuffled", "cold start"}
STATIONS = {"second station across the volume", "second station a quarter round the volume"}
GROWN_WITH_Y = CrossAxis(
    component="X", axis="X", other="Y", own_interval=SPANS[0], other_interval=SPANS[1], own_degree=1,
    other_degree=2, coefficients=(0.0,) * 4,
)  # fmt: skip
PARALLEL = {
    "tool and tracker": (
        shuffled, ThermalDrift(component="X", rate=0.0), TrackerDrift(), {"fixed references", "many fixed references"},
        {*ORDERS, *STATIONS, "other side", "target below"},
    ),
    "range and air": (
        shuffled, RangeOffset(offset_um=0.0), AirScale(scale_um_per_m=0.0), {"bar"}, {*ORDERS, "other side", "finer X"},
    ),
    "moves of one length": (
        to_and_fro, Backlash("X", 0.0), Settling(axis="X", share_ppm=0.0), {"move lengths", "other side", "shuffled"},
        {"retrace", "fixed references", "bar", *STATIONS},
    ),
    "growth in time and bending": (
        swept, GrowthWithTime(axis="X", rate=0.0), GROWN_WITH_Y, ORDERS, {"other side", "bar", *STATIONS},
    ),
}  # fmt: skip
"""Positions, two causes that are parallel in them, designs that part them, and designs in which they stay parallel."""


def expected_odds(data: Measurement, one: Effect, other: Effect) -> dict[str, float]:
    """Expected log odds of either cause against the other, by design."""
    observations = Observations.of(data)
    structure = Structure.first(Data.of(observations)).fitted()
    terms = [plain(observations, effect) for effect in (one, other)]
    registration, _ = data.first_registration
    rows = StackedRows.of(structure, registration, terms, np.zeros_like(observations.residual))
    signals = [Signal(structure.with_terms(terms).columns_of(i), np.full(terms[i].width, SIZE)) for i in range(2)]
    tie = Question("tie", one.name, signals[0], ((signals[1], 0.0),), ())
    now = Known(rows.products(), structure)
    designs = follow_up_designs(data, registration)
    return {each.name: tie.answer(now, Known(rows.products(each), structure)) for each in designs}


@pytest.mark.parametrize("case", PARALLEL)
def test_only_designs_in_which_two_causes_are_not_parallel_separate_them(case):
    where, one, other, parting, staying = PARALLEL[case]
    found = expected_odds(seen(where()), one, other)
    assert all(found[name] > CLEARLY for name in parting)
    assert all(found[name] < NOT_CLEARLY for name in staying)


def test_sensors_that_rise_together_are_separated_where_one_of_them_warms_alone():
    """The tracker is set up again, and its drift is unknown: the place cools again, as no steady drift does."""
    data = seen(shuffled())
    warm = np.linspace(20.0, 26.0, len(data))
    data = replace(data, state=replace(data.state, temperatures={"column": warm, "bed": 20.0 + (warm - 20.0) * 0.8}))
    column, bed = (DriftWithSensor(component="X", sensor=name, coefficient=0.0) for name in ("column", "bed"))
    found = expected_odds(data, column, bed)
    assert {name for name, odds in found.items() if odds > NOT_CLEARLY} == {
        f"{name} alone{fewer}" for name in ("column", "bed") for fewer in ("", ", fewer")
    }
    assert found["column alone"] > CLEARLY


# ---- after other measurements


SMALL = 1e-3
"""Signal, in standard deviations of the noise, that is rounding."""


@pytest.mark.parametrize("make", [pytest.param(five_axes, marks=pytest.mark.statistical), in_motion, by_interferometer])
def test_no_design_takes_information_away(make):
    """Whatever unknowns it brings: all causes that the data can show, with all designs that may follow."""
    observations = Observations.of(make())
    structure = Structure.first(Data.of(observations)).fitted()
    terms = list({term.family: term for term in named(observations)}.values())
    registration, _ = observations.measurement.first_registration
    rows = StackedRows.of(structure, registration, terms, np.zeros_like(observations.residual))
    now, designs = rows.products(), list(follow_up_designs(observations.measurement, registration))
    assert designs
    for design in designs:
        after = rows.products(design)
        scale = np.maximum(np.linalg.norm(rows.root[:, : rows.width], axis=0), np.sqrt(np.diag(after)))
        scale = np.maximum(scale, SMALL)
        assert np.linalg.eigvalsh((after - now) / scale[:, None] / scale).min() > -1e-6
