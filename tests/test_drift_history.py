"""A machine whose earlier logs of touches are in its history, from the command line."""

from __future__ import annotations

import datetime
import json
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from support.command import succeed

HEAD = "# machine: dmu50\n# instrument: touch-probe\n# u_um: 0.5\n# probe: 0 0 -150\n# zone: UTC\n"
SPHERE = 100.0, 20.0, 60.0
SCATTER = 0.0, 0.3, -0.2, 0.1, -0.3, 0.2, -0.1
"""um, in each direction; what a probe repeats to."""
BASE = ("--machine", "dmu50", "--calibration", "none")
OUTPUT = (*BASE, "-o", "now.json", "--json", "drift.json", "--history", "--db", "shop.sqlite")
WARM = [*range(9), *range(7, -1, -1)] * 2
MORNING = [0, 1, 2]


@pytest.fixture(autouse=True)
def _folder(command: Callable[..., object]) -> None:
    """Every test is in a folder of its own."""


def log(name: str, begin: datetime.datetime, warm: Sequence[float], per_kelvin: float, sensor: str = "bed") -> Path:
    """Touches every 20 minutes of a machine whose tip goes to -Y with the temperature of its bed, um/K."""
    x, y, z = SPHERE
    rows = [
        f"{begin + datetime.timedelta(minutes=20 * k):%Y-%m-%d %H:%M:%S},{x + 1e-3 * s},"
        f"{y + 1e-3 * (s - per_kelvin * kelvin):.5f},{z + 150.0 + 1e-3 * s:.5f},0,0,s1,{20.0 + kelvin}"
        for k, (kelvin, s) in enumerate(zip(warm, SCATTER * 9, strict=False))
    ]
    path = Path(name)
    head = HEAD + f"# sphere.s1: {x} {y} {z}\ntime,X,Y,Z,B,C,sphere,temp_{sensor}\n"
    path.write_text(head + "\n".join(rows) + "\n")
    return path


def day(number: int) -> datetime.datetime:
    """The morning of a day."""
    return datetime.datetime(2026, 3, number, 6, tzinfo=datetime.UTC)


def result() -> dict[str, object]:
    """The results for programs."""
    found: dict[str, object] = json.loads(Path("drift.json").read_text())
    return found


def drift_at(kelvin: float, options: Sequence[str] = OUTPUT) -> tuple[float, float]:
    """The drift in Y of a morning of three readings, and U, predicted for another temperature of the bed; um."""
    when = f"{day(12) + datetime.timedelta(minutes=50):%Y-%m-%d %H:%M:%S}"
    succeed("drift", "morning.csv", *options, "--temperature", f"bed={20 + kelvin}", "--at", when)
    place = result()["places"][0]  # type: ignore[index]
    return place["drift_um"][1], place["U_um"][1]


def test_a_morning_knows_what_earlier_days_have_taught():
    alone = (*BASE, "-o", "now.json", "--json", "drift.json")
    log("morning.csv", day(12), MORNING, 3.0)
    _, U_alone = drift_at(8.0, options=alone)
    for number in (10, 11):
        succeed("drift", log(f"{number}.csv", day(number), WARM, 3.0), *OUTPUT)
    assert [each["readings"] for each in result()["learned_with"]] == [len(WARM)]  # type: ignore[attr-defined]
    drift, U = drift_at(8.0)
    assert drift == pytest.approx(3.0 * 8.0, abs=1.5)
    assert U_alone > 3.0 * U
    assert abs(drift - 24.0) < U
    sources = [each["source"] for each in result()["learned_with"]]  # type: ignore[attr-defined]
    assert sources == ["entry 2 of 2026-03-11", "entry 1 of 2026-03-10"]
    shown = succeed("drift", "morning.csv", *OUTPUT).shown
    assert "learned from this log and from entry 2 of 2026-03-11 (34 readings)" in " ".join(shown.split())
    assert "learned with entry 2 of 2026-03-11" in json.loads(Path("now.json").read_text())["provenance"]["source"]
    assert "2026-03-11" in succeed("history", "list", "dmu50", "--db", "shop.sqlite").shown


def test_a_log_that_was_entered_before_it_went_on_counts_once():
    succeed("drift", log("day.csv", day(12), WARM[:20], 3.0), *OUTPUT)
    succeed("drift", log("day.csv", day(12), WARM, 3.0), *OUTPUT)
    (learned,) = result()["learned_with"]  # type: ignore[misc]
    assert learned["readings"] == 0
    assert "same readings" in learned["reason"]


def test_a_machine_that_moves_otherwise_than_before_learns_nothing_from_then():
    succeed("drift", log("10.csv", day(10), WARM, 3.0), *OUTPUT)
    succeed("drift", log("12.csv", day(12), WARM, -3.0), *OUTPUT)
    (learned,) = result()["learned_with"]  # type: ignore[misc]
    assert "does not move by it as it moved then" in learned["reason"]
    (sensor,) = result()["sensors"]  # type: ignore[misc]
    assert sensor["per_K"] == pytest.approx(-3.0, abs=0.2)


def test_a_service_ends_what_was_learned():
    succeed("drift", log("10.csv", day(10), WARM, 3.0), *OUTPUT)
    succeed("history", "event", "dmu50", "service", "--at", "2026-03-11", "--db", "shop.sqlite")
    log("morning.csv", day(12), MORNING, 3.0)
    drift_at(8.0)
    assert result()["learned_with"] == []


def test_another_sensor_is_no_earlier_knowledge():
    succeed("drift", log("10.csv", day(10), WARM, 3.0, sensor="air"), *OUTPUT)
    log("morning.csv", day(12), MORNING, 3.0)
    drift_at(8.0)
    (learned,) = result()["learned_with"]  # type: ignore[misc]
    assert learned["reason"] == "it has no temperature bed"


def test_watched_programs_know_it_as_well():
    begin = datetime.datetime.now(datetime.UTC) - datetime.timedelta(minutes=62)
    succeed("drift", log("10.csv", begin - datetime.timedelta(days=2), WARM, 3.0), *OUTPUT)
    log("touches.csv", begin, [0, 2, 4, 6], 3.0)
    Path("in").mkdir()
    Path("in/part.nc").write_text("G21 G90 G54\nT1 M6\nG43 H1\nG0 X0 Y0 Z50\nG1 X60 Y10 F500\nM30\n")
    set_up = "--work-offset", "G54=-30,-20,150", "--tool-length", "T1=80"
    follow = "--drift", "touches.csv", "--history", "--db", "shop.sqlite", "--settle", "0.1", "--idle", "0.5"
    shown = succeed("watch", "in", "out", *BASE, *set_up, *follow).shown
    assert "learned from this log and from entry 1" in " ".join(shown.split())
    assert "Y10 " not in Path("out/part.nc").read_text()
