"""What the rows of a measurement can show and separate, before any reading of them is looked at."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest
from support.bench import BENCH_TOML, seen, shuffled, to_and_fro
from support.command import run_command
from support.virtual_measurements import written

from calibration.diagnosis.conclusion.design import Designed
from calibration.diagnosis.diagnose import diagnose
from kinematics.effects import Backlash, Effect


def of_design(positions: np.ndarray, *effects: Effect) -> dict[str, Designed]:
    """The design of a measurement of the bench with some effects, by the names of the causes."""
    return {each.name: each for each in diagnose(seen(positions, *effects)).design}


@pytest.fixture(scope="module")
def found() -> dict[str, Designed]:
    return of_design(to_and_fro())


@cache
def in_any_order() -> dict[str, Designed]:
    return of_design(shuffled())


def test_each_cause_is_visible_or_tied_or_not_visible(found):
    assert {each.verdict for each in found.values()} == {"visible", "tied", "not visible"}
    assert found["air-scale"].verdict == "not visible"
    assert "length standard" in found["air-scale"].remedy
    for each in found.values():
        assert (each.verdict == "tied") == bool(each.tied_with)
        assert 0.0 <= each.share <= 1.0
        assert all(0.0 <= cosine <= 1.0 and name in found and name != each.name for name, cosine in each.tied_with)


def test_moves_of_one_length_do_not_tell_backlash_from_settling_and_others_do(found):
    ties = dict(found["settling X"].tied_with)
    assert ties["backlash X"] == pytest.approx(1.0, abs=1e-3)
    assert in_any_order()["settling X"].verdict == "visible"


def test_axes_that_move_alone_in_one_direction_show_no_backlash(found):
    """Y moves once only between two positions of the others, always forward."""
    assert found["backlash Y"].verdict == "not visible"
    assert in_any_order()["backlash Y"].verdict != "not visible"


def test_the_readings_do_not_change_it(found):
    again = of_design(to_and_fro(), Backlash("X", 300.0))
    assert {name: each.verdict for name, each in again.items()} == {name: each.verdict for name, each in found.items()}
    assert [each.log_odds for each in again.values()] == pytest.approx(
        [each.log_odds for each in found.values()], rel=0.02, abs=0.2
    )


def test_the_command_writes_it(tmp_path):
    written(seen(to_and_fro()), tmp_path / "data.csv")
    (tmp_path / "bench.toml").write_text(BENCH_TOML, encoding="utf-8")
    out = tmp_path / "out.json"
    words = ("-m", tmp_path / "bench.toml", "-o", tmp_path / "new.json", "--json", out, "--force")
    done = run_command("diagnose", tmp_path / "data.csv", *words)
    assert done.status == 0, done.shown
    design = {each["name"]: each for each in json.loads(out.read_text(encoding="utf-8"))["design"]}
    assert design["settling X"]["verdict"] == "tied"
    assert {"kind", "name", "verdict", "share", "tied_with", "remedy", "log10_odds"} == set(design["settling X"])
