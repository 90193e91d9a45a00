"""Optimised plans: the algebra of exchange, what is in the way, what has to be visible, and fresh draws that judge them."""

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.tiers import drawn, quick

import machines
from calibration.instruments import Interferometer, LaserTracker
from calibration.measurement.measurement import Target
from calibration.measurement.plan import Choices, Timing
from calibration.observation.reach import Reach
from calibration.optimal.candidates import Obstacle, places_around
from calibration.optimal.exchange import Selection, exchanged, filled
from calibration.optimal.optimise import VISIBLE, Request, optimised
from calibration.simulation.effect_text import read_effects
from calibration.study.cases import read_cases
from calibration.study.definition import study_of
from calibration.study.run import Draws, run
from calibration.study.spread import workers
from calibration.study.store import Store
from kinematics.forward import tool_point
from kinematics.user_error import UserError

GANTRY = machines.load("gantry")
TRACKER = LaserTracker(u_range_um_per_m=0.25, u_angle_um=10.0, u_angle_um_per_m=2.5)
PLACE = (-1500.0, 1500.0, 300.0)


def request(**more) -> Request:
    return Request(**{"choices": Choices(), "points": 60, "trackers": [PLACE], "candidates": 300, **more})


# ---- algebra


def selection_of(seed: int, chosen: int = 6) -> Selection:
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(25, 2, 5)) * rng.uniform(0.1, 3.0, (25, 1, 1))
    shown = rng.normal(size=(8, 5))
    mask = np.zeros(25, bool)
    mask[rng.permutation(25)[:chosen]] = True
    return Selection(rows, np.diag(rng.uniform(0.1, 2.0, 5)), shown.T @ shown, mask)


def variance(selection: Selection, mask: np.ndarray) -> float:
    some = selection.rows[mask].reshape(-1, 5)
    return float(np.trace(selection.evaluated @ np.linalg.inv(selection.prior + some.T @ some)))


@drawn(30, 100, seed=st.integers(0, 10_000))
def test_gains_and_losses_are_differences_of_the_variance(seed):
    selection = selection_of(seed)
    now = variance(selection, selection.chosen)
    assert selection.variance == pytest.approx(now)
    for inside, worked in ((True, selection.losses), (False, selection.improvements)):
        which = np.flatnonzero(selection.chosen == inside)
        for candidate, uncertainties in zip(which, worked(which), strict=True):
            other = selection.chosen.copy()
            other[candidate] = not inside
            assert uncertainties == pytest.approx(abs(variance(selection, other) - now), rel=1e-6, abs=1e-9)


@drawn(30, 100, seed=st.integers(0, 10_000))
def test_gains_are_right_after_parameters_of_which_nothing_was_known(seed):
    """The registration of an instrument has hardly a prior: the first candidates reduce a variance of 1e7 to 1."""
    selection = replace(selection_of(seed, chosen=0), prior=np.eye(5) * 1e-7)
    filled(selection, 8, np.ones(25, bool))
    free, now = np.flatnonzero(~selection.chosen), selection.variance
    for candidate, gain in zip(free, selection.improvements(free), strict=True):
        other = selection.chosen.copy()
        other[candidate] = True
        assert gain == pytest.approx(now - variance(selection, other), rel=1e-4, abs=1e-9)


@given(st.integers(0, 10_000), st.lists(st.integers(0, 24), max_size=30))
def test_updates_are_the_inverse_made_anew(seed, changed):
    selection = selection_of(seed)
    for candidate in changed:
        selection.change(candidate, -1 if selection.chosen[candidate] else 1)
    assert selection.variance == pytest.approx(variance(selection, selection.chosen), rel=1e-6)


@settings(max_examples=25)
@given(st.integers(0, 10_000))
def test_exchange_helps_and_keeps_number_and_limits(seed):
    selection = selection_of(seed, chosen=0)
    allowed = np.arange(25) % 4 != 0
    filled(selection, 8, allowed)
    first = selection.variance
    exchanged(selection, allowed, 10)
    assert np.count_nonzero(selection.chosen) == 8
    assert not selection.chosen[~allowed].any()
    assert selection.variance <= first * (1 + 1e-9)
    rng = np.random.default_rng(seed)
    for _ in range(5):
        mask = np.zeros(25, bool)
        mask[rng.permutation(np.flatnonzero(allowed))[:8]] = True
        assert selection.variance <= variance(selection, mask) * (1 + 1e-9)


# ---- what is in the way


@example((0.0, 2.0, 1.0), (0.0, 2.0, 0.0))
@given(st.tuples(*[st.floats(-5, 5)] * 3), st.tuples(*[st.floats(-5, 5)] * 3))
def test_a_beam_crosses_a_box_where_one_of_its_points_is_inside(origin, end):
    box = Obstacle((-1.0, -2.0, -np.inf), (1.0, 2.0, 0.5))
    start, stop = np.array(origin), np.array(end)
    share = np.linspace(0.0, 1.0, 2001)[:, None]
    if box.contains(start + share * (stop - start)).any():
        assert box.between(start, stop[None]).all()
    grown = Obstacle((-1.1, -2.1, -np.inf), (1.1, 2.1, 0.6))
    if not grown.contains(start + share * (stop - start)).any():
        assert not box.between(start, stop[None]).any()


def test_no_target_in_an_obstacle_no_beam_through_it():
    box = Obstacle((500.0, 1000.0, -np.inf), (1500.0, 2000.0, np.inf))
    plan = optimised(GANTRY, TRACKER, request(points=40, candidates=150, obstacles=[box])).plan
    points = tool_point(GANTRY, plan.positions)
    share = np.linspace(0.0, 1.0, 400)[:, None, None]
    beams = np.array(PLACE) + share * (points - PLACE)
    assert not box.contains(beams.reshape(-1, 3)).any()
    assert len(plan) == 40


def test_limits_of_the_tracker_and_the_travel_are_kept():
    reach = Reach((-5.0, 20.0), 40.0)
    found = optimised(GANTRY, TRACKER, request(points=20, candidates=100, reach=reach, trackers=[]))
    points = tool_point(GANTRY, found.plan.positions) - found.plan.stations["s1"]
    elevation = np.degrees(np.arcsin(points[:, 2] / np.linalg.norm(points, axis=1)))
    assert np.all((elevation > -5.0) & (elevation < 20.0))
    low, high = GANTRY.travel
    assert np.all((found.plan.positions >= low) & (found.plan.positions <= high))
    assert found.plan.stations["s1"] in places_around(GANTRY, Choices())


@pytest.mark.statistical
def test_minutes_are_kept_with_moves_and_changes_of_target():
    targets = {"a": Target((0.0, 0.0, -100.0)), "b": Target((90.0, 40.0, -180.0)), "c": Target((-80.0, 60.0, -150.0))}
    timing = Timing(dwell_s=3.0, feed=5000.0)
    choices = Choices(targets=targets, timing=timing)
    plan = optimised(GANTRY, TRACKER, request(points=None, minutes=40.0, candidates=150, choices=choices)).plan
    assert 34.0 < plan.minutes <= 42.0
    assert set(plan.state.target) == set(targets)
    assert np.count_nonzero(plan.state.target[1:] != plan.state.target[:-1]) == 2


# ---- what has to be visible


@pytest.mark.parametrize("seeds", quick([range(4), range(12)], [], [range(4)]), ids=len)
def test_an_effect_that_has_to_be_visible_is(seeds):
    """By 40 points of some of the random candidates; a plan that does not show it is refused with its uncertainty."""
    effects = read_effects(["backlash:axis=X,width=0", "backlash:axis=Y,width=0"], GANTRY)
    shown = 0
    for seed in seeds:
        wanted = request(points=40, candidates=150, visible=effects, choices=Choices(seed=seed))
        try:
            found = optimised(GANTRY, TRACKER, wanted)
        except UserError as refused:
            share = re.search(r"determine backlash [XY] width to (\d+)% of its typical size only", str(refused))
            assert share
            assert float(share[1]) >= 100.0 * VISIBLE
        else:
            assert len(found.visible) == 2
            assert max(found.visible.values()) <= VISIBLE
            shown += 1
    assert shown >= len(seeds) / 4


def test_what_is_tied_to_the_error_motions_is_not_visible():
    (effect,) = read_effects(
        ["cross-axis:component=Z,axis=X,other=Y,own_interval=[0,5000],other_interval=[0,3000],own_degree=0,"
         "other_degree=1,coefficients=[0]"], GANTRY,
    )  # fmt: skip
    with pytest.raises(UserError, match=r"E_ZX\(Y\) coefficients"):
        optimised(GANTRY, TRACKER, request(points=40, candidates=150, visible=[effect]))


def test_what_no_plan_can_show_is_refused():
    (effect,) = read_effects(["air-scale:scale_um_per_m=0"], GANTRY)
    with pytest.raises(UserError, match=r"air-scale .* cannot be separated"):
        optimised(GANTRY, TRACKER, request(points=40, candidates=150, visible=[effect]))


# ---- judged by fresh draws


@pytest.mark.statistical
def test_better_than_hand_made_plans_at_equal_time():
    common = {"points": 200, "tracker": list(PLACE)}
    names = ("optimised", "hexahedron", "grid", "planes", "random")
    content = {
        "machine": "gantry",
        "seed": 11,
        "fit": {"basis": "cubic:8", "prior": 30.0},
        "case": [{**common, "name": name, "strategy": name} for name in names],
    }
    # no more time than the shortest of the others
    content["case"][0] = {**content["case"][0], "points": None, "minutes": 67.0, "candidates": 500}
    with workers(1, None) as team:
        found = run(read_cases(study_of(content, "test"), Path()), Draws(100), team, Store(None))
    means = {result.case.name: result.after.mean() for result in found}
    assert found[0].minutes <= min(result.minutes for result in found[1:])
    assert means["optimised"] < 0.97 * min(means[name] for name in names[1:])


# ---- the command


def test_command_writes_plan_and_program(command):
    done = command(
        "plan", "--machine", "gantry", "--optimise", "--points", 30, "--candidates", 100, "--tracker", "-1500,1500,300",
        "-o", "plan.csv", "--nc", "plan.nc",
    )  # fmt: skip
    assert done.status == 0, done.err
    assert "expected" in done.err
    assert "station s1" in done.err
    lines = [line for line in Path("plan.csv").read_text().splitlines() if not line.startswith("#")]
    assert len(list(csv.DictReader(lines))) == 30
    assert Path("plan.nc").read_text().count("G53 G1") >= 30
    again = command(
        "simulate", "--machine", "gantry", "--strategy", "plan.csv", "--tracker", "-1500,1500,300", "-o", "d.csv"
    )
    assert again.status == 0, again.err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--optimise"], "either a number of points or a number of minutes"),
        (["--optimise", "--points", "20", "--minutes", "30"], "either a number of points or a number of minutes"),
        (["--optimise", "--points", "20+30"], "--points 20+30: expected a whole number"),
        (["--optimise", "--points", "5"], "at least 10"),
        (["--optimise", "--points", "50", "--strategy", "grid"], "--strategy is an option of ncomp plan points"),
        (["--optimise", "--points", "50", "--order", "shuffled"], "--order is an option of ncomp plan points"),
        (["--optimise", "--points", "50", "--obstacle", "q=0:1"], "expected ranges of x, y, z"),
        (["--optimise", "--points", "50", "--obstacle", "x=5:1"], "lower to a higher"),
        (["--optimise", "--points", "50", "--obstacle", "x=-9e9:9e9"], "observes none of the positions"),
        (["--optimise", "--points", "50", "--tracker", "1,2"], "--tracker 1,2"),
        (["--optimise", "--points", "50", "--visible", "nonsense:x=1"], "--visible nonsense"),
        (["--strategy", "grid", "--tracker", "0,0,0"], "--tracker is an option of ncomp plan optimised"),
        ([], "--strategy NAME[+NAME...] is missing: strategy of the positions"),
    ],
)
def test_what_cant_be_used_is_refused(command, options, said):
    place = [] if "--tracker" in options else ["--tracker", "-1500,1500,300"]
    chosen = ["--candidates", "200", *place] if "--optimise" in options else []
    done = command("plan", "--machine", "gantry", *chosen, *options, "-o", "plan.csv")
    assert done.status == 2
    assert said in done.err
    assert not Path("plan.csv").exists()


def test_only_trackers():
    with pytest.raises(UserError, match="laser tracker"):
        optimised(GANTRY, Interferometer(u_um=0.3), request())
