"""`ncomp history show`: changes with their odds, drift, forecasts and limits, from results with known truth."""

from __future__ import annotations

import datetime
import json
from pathlib import Path

import numpy as np
import pytest
from support.command import refusal, succeed
from support.history_cases import entries

import ncomp
from history.database import opened
from history.entries import Quantity, Result, enter
from history.trends.changes import found_in
from history.trends.forecast import forecast
from history.trends.limits import leaving, limits_of
from history.trends.model import likeliest
from history.trends.series import Event, Series
from kinematics.error_model.priors import PRIORS
from machines import load

BEGIN = datetime.datetime(2022, 1, 1, tzinfo=datetime.UTC)
MONTHS = np.arange(48) / 12.0


def series(truth, times=MONTHS, u=1.5, seed=1, methods=None, events=()) -> Series:
    """Results of a truth `(n,)` with standard uncertainty u, and a scatter of 1 besides."""
    values = truth + np.random.default_rng(seed).normal(0.0, np.hypot(u, 1.0), len(times))
    methods = methods or ("ballbar",) * len(times)
    return Series(
        "squareness X-Y",
        "um/m",
        50.0 + times,
        values,
        np.full(len(times), u),
        methods,
        tuple(range(len(times))),
        events,
    )


def changes(own: Series):
    return found_in(likeliest(own, PRIORS))


@pytest.mark.parametrize("seed", range(6))
def test_a_machine_that_does_not_change_announces_nothing(seed):
    assert changes(series(0.0 * MONTHS, seed=seed)) == []


def test_many_results_do_not_take_the_scatter_for_a_walk():
    """260 results know their scatter, which is between two sizes of the prior, to 4 %."""
    weeks = np.arange(260) / 52.0
    assert changes(series(0.0 * weeks, weeks, u=1.0, seed=95)) == []


def test_a_change_is_announced_with_its_size_and_its_dates():
    (found,) = changes(series(np.where(MONTHS >= 2.0, 12.0, 0.0)))
    assert (found.kind, found.verdict) == ("change", "announced")
    assert abs(found.size - 12.0) < 3.0 * found.u
    assert found.u < 1.2
    assert found.between[0] < 52.0 <= found.between[1] < found.between[0] + 0.26


def test_an_event_makes_a_small_change_at_its_date_likelier():
    truth = np.where(MONTHS >= 2.0, 8.0, 0.0)
    plain, told = (changes(series(truth, events=events)) for events in ((), (Event(51.97, "crash"),)))
    assert [(each.kind, each.name) for each in told] == [("change", "crash")]
    assert max((each.log_odds for each in plain), default=0.0) < told[0].log_odds


def test_a_drift_is_announced_with_its_rate_and_forecast():
    structure = likeliest(series(4.0 * MONTHS), PRIORS)
    (found,) = found_in(structure)
    assert (found.kind, found.verdict) == ("drift", "announced")
    assert abs(found.size - 4.0) < 3.0 * found.u < 1.5
    low, high = forecast(structure, np.array([55.0])).band
    assert low[0] < 20.0 < high[0]


def test_another_instrument_is_not_the_machine():
    methods = tuple("tracker" if n % 3 == 0 else "ballbar" for n in range(len(MONTHS)))
    (found,) = changes(series(np.where(np.array(methods) == "tracker", 6.0, 0.0), methods=methods))
    assert (found.kind, found.name, found.verdict) == ("method", "tracker", "announced")
    assert abs(found.size - 6.0) < 3.0 * found.u


def test_a_change_with_the_instrument_is_open():
    methods = tuple("ballbar" if time < 2.0 else "tracker" for time in MONTHS)
    (found,) = changes(series(np.where(MONTHS >= 2.0, 12.0, 0.0), methods=methods))
    assert found.verdict == "tied"
    assert {found.kind, *found.tied_with} >= {"change", "method"}


def test_a_forecast_counts_both_where_machine_and_method_are_open():
    quarters = np.arange(16) / 4.0
    methods = tuple("tracker" if time < 3.0 else "other tracker" for time in quarters)
    own = series(np.where(quarters < 3.0, 0.0, -20.0), quarters, methods=methods)
    (found,) = changes(own)
    assert found.verdict == "tied"
    (low,), (high,) = forecast(likeliest(own, PRIORS), own.times[-1:] + 0.25).band
    assert low < -18.0
    assert high > 0.0


def test_few_results_with_a_large_scatter_announce_nothing():
    own = Series(
        "A X",
        "um",
        np.array([50.0, 50.2, 50.4, 50.6]),
        np.array([0.0, 9.0, 1.0, 10.0]),
        np.full(4, 0.5),
        ("laser",) * 4,
        (1, 2, 3, 4),
    )
    assert [each for each in changes(own) if each.verdict == "announced"] == []


@pytest.mark.parametrize(
    ("text", "limit"),
    [("squareness X-Y=0.02mm/400mm", 50.0), ("squareness X-Y = 20 um/m", 20.0), ("A X=0.008mm", 8.0), ("A X=8um", 8.0)],
)
def test_limits_are_in_the_unit_of_the_user(text, limit):
    known = {"squareness X-Y": "um/m", "A X": "um"}
    assert list(limits_of([text], known).values()) == [pytest.approx(limit)]


@pytest.fixture
def db(tmp_path: Path, request: pytest.FixtureRequest) -> str:
    """A machine whose squareness drifts by 6 um/m a year, and whose backlash grew by 9 um at a crash."""
    request.getfixturevalue("command")
    path, rng = str(tmp_path / "life.sqlite"), np.random.default_rng(5)
    with opened(path, writes=True) as session:
        for n, time in enumerate(MONTHS.tolist()):
            figures = [
                Quantity("squareness X-Y", "um/m", 6.0 * time + rng.normal(0.0, 1.5), 1.5),
                Quantity("backlash X", "um", 9.0 * (n >= 30) + rng.normal(0.0, 1.0), 1.0),
            ]
            at = BEGIN + datetime.timedelta(days=365.25 * time)
            enter(session, load("cframe"), Result(kind="check", at=at, title=f"{n}", method="ballbar", figures=figures))
        crash = BEGIN + datetime.timedelta(days=365.25 * MONTHS[30] - 10)
        enter(session, load("cframe"), Result(kind="crash", at=crash, title="table hit"))
    return path


def test_the_page_of_a_life(db, tmp_path):
    page = tmp_path / "life.html"
    done = succeed(
        "history", "show", "cframe", "--db", db, "--limit", "squareness X-Y=0.012mm/300mm", "--limit", "backlash X=0.05mm",
        "--json", tmp_path / "life.json", "--report", page,
    )  # fmt: skip
    assert "the dates of the crash" in done.shown
    assert "backlash X stays within 50 um" in done.shown
    assert "<html" in page.read_text()
    backlash, squareness = json.loads((tmp_path / "life.json").read_text())["trends"]
    (change,) = backlash["changes"]
    assert abs(change["size"] - 9.0) < 1.5 * change["U"]
    assert change["between"] == ["2024-06-01", "2024-07-02"]
    (slow,) = squareness["changes"]
    assert abs(slow["size"] - 6.0) < 1.5 * slow["U"]
    assert squareness["leaves"]["limit"] == pytest.approx(40.0)


def test_a_limit_that_is_none_is_refused(db):
    for limit, reason in {
        "squareness X-Y=0.02mm": "is an angle: state the length of the part, as in 0.02mm/300mm",
        "squareness XY=20um/m": "the history has no results of 'squareness XY' (did you mean 'squareness X-Y'?)",
        "backlash X=20um/m": "is a length, in um",
        "backlash X": "expected NAME=VALUE UNIT above 0",
    }.items():
        assert reason in refusal("history", "show", "cframe", "--db", db, "--limit", limit)


def test_when_a_limit_is_left_and_what_decides_it():
    own = series(5.0 * MONTHS, seed=2)
    structure = likeliest(own, PRIORS)
    ahead = forecast(structure, own.times[-1] + np.arange(105) / 52.0)
    left = leaving(structure, ahead, 24.0)  # the truth leaves it after 4.8 years
    assert left.first < 54.8 < left.last
    assert left.last - left.first < 1.0
    (ballbar,) = left.methods
    assert pytest.approx(3.0) == ballbar.U
    assert 0.0 < ballbar.probability < 1.0
    assert leaving(structure, ahead, 100.0).first is None


@pytest.mark.statistical
def test_forecasts_hold_and_what_does_not_change_is_not_announced():
    rng, held, false = np.random.default_rng(7), 0, 0
    for seed in range(80):
        walk = np.cumsum(rng.normal(0.0, 0.5 / np.sqrt(12.0), len(MONTHS)))
        moves = seed % 2 == 1
        truth = walk + rng.uniform(1.0, 5.0) * MONTHS if moves else 0.0 * MONTHS
        structure = likeliest(series(truth, seed=seed).until(53.0), PRIORS)
        low, high = forecast(structure, 50.0 + MONTHS[-1:]).band
        held += bool(low[0] < truth[-1] < high[0])
        false += not moves and any(each.verdict == "announced" for each in found_in(structure))
    print(f"{held} of 80 forecasts of 11 months held, {false} of 40 machines that do not change are said to change")
    assert held >= 0.9 * 80
    assert false == 0


def test_the_life_of_a_machine_is_that_of_the_command(db, tmp_path):
    limit = {"squareness X-Y": "0.012mm/300mm"}
    found = ncomp.machine_history("cframe", db=db, limit=limit)
    shown = tmp_path / "life.json"
    succeed("history", "show", "cframe", "--db", db, "--limit", "squareness X-Y=0.012mm/300mm", "--json", shown)
    as_shown = json.loads(shown.read_text())
    assert json.loads(json.dumps(found.json()))["entries"] == as_shown["entries"]
    assert [each["changes"] for each in found.json()["trends"]] == [each["changes"] for each in as_shown["trends"]]
    assert found.trends[1].leaves.limit == pytest.approx(40.0)
    assert repr(found) == f"<MachineHistory: cframe, {len(MONTHS) + 1} entries, 2 trends, 2 changes announced>"
    assert "the dates of the crash" in found._repr_html_()
    backlash = found.columns["name"] == "backlash X"
    assert found.columns["value"][backlash].tolist() == found.trends[0].series.values.tolist()
    with pytest.raises(ncomp.UserError, match="the history has no machine 'nobody'"):
        ncomp.machine_history("nobody", db=db)
    with pytest.raises(ncomp.UserError, match='limit="backlash": expected NAME=VALUE UNIT'):
        ncomp.machine_history("cframe", db=db, limit="backlash")


@pytest.mark.statistical
@pytest.mark.usefixtures("command")
def test_which_cause_changed_is_kept_and_shown(tmp_path):
    """A calibration, then a diagnosis against it, of a machine whose backlash has grown."""
    db, mill = tmp_path / "life.sqlite", ("--machine", "cframe")
    laser = ("--strategy", "axes", "--spacing", 100, "--runs", 3, "--instrument", "interferometer", "--errors", "none")
    for name, width, day in (("march", 3, "2026-03-01"), ("june", 9, "2026-06-01")):
        file = tmp_path / f"{name}.csv"
        effect = ("--effect", f"backlash:axis=X,width={width}", "--seed", width)
        succeed("simulate", *mill, *laser, *effect, "-o", file)
        file.write_text(f"# measured: {day}\n{file.read_text()}")
    new, results = tmp_path / "june.json", tmp_path / "results.json"
    history = ("--history", "--db", db)
    succeed("diagnose", tmp_path / "march.csv", *mill, "-o", tmp_path / "march.json", *history)
    succeed(
        "diagnose", tmp_path / "june.csv", *mill, "-c", tmp_path / "march.json", "-o", new, "--json", results, *history
    )
    march, june = entries(str(db))
    assert [(each["name"], each["sizes"][0]["before"]) for each in march["causes"]] == [("backlash X", None)]
    (backlash,) = (each for each in june["causes"] if each["name"] == "backlash X")
    (width,) = backlash["sizes"]
    assert (width["name"], backlash["verdict"]) == ("width_um", "strong")
    assert abs(width["value"] - 6.0) < 1.0
    assert 0.0 < width["u"] < 0.5
    assert abs(width["before"] - 3.0) < 1.0
    succeed("history", "event", "cframe", "crash", "--at", "2026-05-01", "--db", db)
    for day, read in {"01-01": -3, "02-01": -3.3, "04-01": -2.8, "07-01": -9.1, "08-01": -8.8}.items():
        check = ("--check", f"backlash X={read} +- 0.5 um", "--at", f"2026-{day}")
        succeed("history", "add", "cframe", *check, "--db", db)
    shown = succeed("history", "show", "cframe", "--db", db, "--report", tmp_path / "life.html").shown
    assert "Which cause changed from 2026-03-01 to 2026-06-01" in shown
    page = (tmp_path / "life.html").read_text()
    assert f"width {width['value']:.2f} ±" in page
    assert ">2026-03-01<" in page
    succeed("history", "add", "cframe", results, "--at", "2026-06-02", "--db", db)
    (again,) = (each for each in entries(str(db)) if each["title"] == "diagnosis, results.json")
    assert again["causes"] == june["causes"]
