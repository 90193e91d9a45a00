"""`ncomp etve`: the variation of a standing machine with its environment (ISO 230-3), by a log of displacements."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from support.command import refusal, succeed
from support.history_cases import entries

import ncomp

HOURS = np.arange(0.0, 12.01, 1.0 / 12.0)
HEAD = "# u_um: 0.2\n# distance_mm: 200\n"


@pytest.fixture(autouse=True)
def _folder(command):
    """Every test is in a folder of its own."""


def log(columns: dict[str, np.ndarray], head: str = HEAD, name: str = "night.csv") -> Path:
    """A log with these columns."""
    rows = [",".join(f"{value:.6f}" for value in row) for row in zip(*columns.values(), strict=True)]
    path = Path(name)
    path.write_text(head + "\n".join([",".join(columns), *rows]) + "\n")
    return path


def night() -> dict[str, np.ndarray]:
    """A hall that cools down by 4 K in the night and is heated in the morning: the column bends to +Y and leans."""
    air = 20.0 - 4.0 * np.sin(np.pi * HOURS / 12.0)
    lag = 20.0 - 4.0 * np.sin(np.pi * np.clip(HOURS - 1.0, 0.0, None) / 12.0)
    bend = -2.0 * (lag - 20.0)
    return {
        "time_s": 3600.0 * HOURS, "X1_um": 0.2 * bend, "X2_um": 0.2 * bend, "Y1_um": bend, "Y2_um": 1.5 * bend,
        "Z_um": -0.5 * bend, "temp_air": air,
    }  # fmt: skip


def found(*words: object) -> dict:
    """The results, by the name of the reading."""
    return json.loads(succeed("etve", *words, "--json", "-").out)


def test_the_whole_log_gives_the_range_of_each_reading_and_tilt():
    columns = night()
    answer = found(log(columns))
    sizes = {each["name"]: each for each in answer["etve"]}
    assert list(sizes) == ["X1", "X2", "Y1", "Y2", "Z", "A", "B"]
    for name in ("X1", "Y1", "Y2", "Z"):
        assert sizes[name]["value"] == pytest.approx(np.ptp(columns[f"{name}_um"]), abs=1e-5)
        assert sizes[name]["U"] == pytest.approx(2.0 * np.sqrt(2.0) * 0.2)
    # 4 um over 200 mm are 20 urad
    assert (sizes["A"]["value"], sizes["A"]["unit"]) == (pytest.approx(20.0, abs=0.01), "urad")
    assert sizes["A"]["U"] == pytest.approx(4.0 * 0.2 / 200.0 * 1e3)
    assert sizes["B"]["value"] == 0.0
    assert sizes["Y1"]["u_measurement"] == pytest.approx(sizes["Y1"]["value"] / np.sqrt(12.0))
    assert answer["temperatures"][0]["range_in_period_K"] == pytest.approx(4.0, abs=1e-4)


def test_a_shorter_measurement_meets_less_of_the_variation():
    rng = np.random.default_rng(3)
    columns = {"time_s": np.cumsum(rng.uniform(60.0, 600.0, 300)), "Z_um": np.cumsum(rng.normal(0.0, 0.3, 300))}
    path = log(columns, "# u_um: 0.1\n")
    time, z = (columns["time_s"] - columns["time_s"][0]) / 3600.0, columns["Z_um"]
    for period in (0.5, 2.0, 7.0):
        (answer,) = found(path, "--period-h", period)["etve"]
        each = [np.ptp(z[(time >= begin) & (time <= begin + period)]) for begin in time]
        assert answer["value"] == pytest.approx(max(each), abs=1e-5)
        assert 0.0 < answer["end_h"] - answer["begin_h"] <= period
    assert answer["value"] < np.ptp(z)


def test_the_function_is_that_of_the_command():
    path = log(night())
    done = ncomp.etve(path, period_h=3)
    assert json.loads(json.dumps(done.json()))["etve"] == found(path, "--period-h", 3)["etve"]
    assert repr(done).startswith("<Etve: ETVE over 3 h: X1 ")
    assert "<table>" in done._repr_html_()
    assert done.columns.keys() >= {"time_h", "Y2_um", "A_urad", "temp_air_degC"}
    assert "Over time" in done.plots


def test_time_stamps_of_a_clock_with_summer_time():
    Path("night.csv").write_text(
        "# u_um: 0.2\n# zone: Europe/Berlin\ntime,Z_um\n2026-10-25 01:30:00,0\n2026-10-25 02:30:00,1\n"
        "2026-10-25 02:10:00,3\n2026-10-25 03:30:00,2\n"
    )
    answer = found("night.csv", "--period-h", 1)
    assert answer["duration_h"] == pytest.approx(3.0)
    assert answer["etve"][0]["value"] == pytest.approx(2.0)


WRONG = {
    "no uncertainty": (night(), "# distance_mm: 200\n", (), "# u_um: is missing"),
    "no distance": (night(), "# u_um: 0.2\n", (), "the distance of the sensors Y1_um and Y2_um and of X1_um and X2_um"),
    "negative distance": (night(), "# u_um: 0.2\n# distance_mm: -200\n", (), "distance_mm: expected a number above 0"),
    "another entry": (night(), HEAD + "# u_mm: 3\n", (), "u_mm: is not known (did you mean 'u_um'?)"),
    "unknown column": (night() | {"W_um": HOURS}, HEAD, (), "column W_um: not known"),
    "no displacement": ({"time_s": HOURS}, "# u_um: 0.2\n", (), "one or more of the columns X_um, X1_um"),
    "no time": ({"Z_um": HOURS}, "# u_um: 0.2\n", (), "add the column time"),
    "time goes back": ({"time_s": HOURS[::-1], "Z_um": HOURS}, "# u_um: 0.2\n", (), "night.csv:4 column time_s"),
    "two readings": ({"time_s": HOURS[:2], "Z_um": HOURS[:2]}, "# u_um: 0.2\n", (), "needs 3 or more"),
    "no number": ({"time_s": HOURS, "Z_um": HOURS * np.nan}, "# u_um: 0.2\n", (), "column Z_um: 'nan'"),
    "longer than the log": (night(), HEAD, ("--period-h", 13), "--period-h 13: night.csv covers 12 h"),
}


@pytest.mark.parametrize("fault", WRONG)
def test_a_log_that_cannot_be_used_is_refused_in_words(fault):
    columns, head, words, reason = WRONG[fault]
    path = log(columns, head)
    assert reason in refusal("etve", path, *words, "--json", "out.json")
    assert not Path("out.json").exists()


def test_the_variation_of_a_standing_machine_is_a_part_of_its_life(tmp_path):
    path, db = log(night(), HEAD + "# measured: 2026-03-01\n"), str(tmp_path / "life.sqlite")
    machine = ("--machine", "cframe")
    succeed("etve", path, "--period-h", 3, *machine, "--history", "--db", db, "--json", "night.json")
    (entered,) = entries(db)
    assert (entered["kind"], entered["at"][:10], entered["method"]) == ("etve", "2026-03-01", "etve")
    sizes = json.loads(Path("night.json").read_text())["etve"]
    own = [(f"ETVE {each['name']} in 3 h", each["unit"], each["value"], each["U"] / 2) for each in sizes]
    assert [(each["name"], each["unit"], each["value"], each["u"]) for each in entered["figures"]] == own
    succeed("etve", path, "--json", "whole.json")  # of no machine: that of the command
    succeed("history", "add", "cframe", "whole.json", "--at", "2026-04-01", "--db", db)
    assert [each["kind"] for each in entries(db)] == ["etve", "etve"]
    assert "is of machine 'cframe'" in refusal(
        "history", "add", "gantry", "night.json", "--at", "2026-03-01", "--db", db
    )
    assert "--history: is the life of a machine: give --machine" in refusal("etve", path, "--history", "--db", db)
