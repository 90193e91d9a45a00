"""Two temperatures that rise together: both sensors are named, and a measurement in which they part decides."""

import json
from pathlib import Path

import pytest

GROWTH = "thermal-scale-sensor:axis=X,sensor=column,coefficient=11"
TRAVEL = "--strategy", "axes", "--range", "Y=200", "--range", "Z=200", "--spacing", 25, "--runs", 3
LASER = "--machine", "cframe", "--errors", "none", "--instrument", "interferometer", "-u", "u_um=0.2", *TRAVEL


def measured(command, path: Path, bed: str, seed: int = 0) -> Path:
    """X grows by 11 um/m for each K of the column, which warms by 6 K."""
    warm = "--temperature", "column=20:26", "--temperature", f"bed=20:{bed}"
    done = command("simulate", *LASER, "--effect", GROWTH, *warm, "--seed", seed, "-o", path)
    assert done.status == 0, done.err
    return path


def diagnosed(command, folder: Path, *data: Path) -> tuple[dict, str, dict]:
    """The only cause, what is printed, and the whole answer."""
    out = folder / "answer.json"
    done = command("diagnose", *data, "--machine", "cframe", "-o", folder / "new.json", "--json", out)
    assert done.status == 0, done.err
    answer = json.loads(out.read_text())
    (cause,) = answer["effects"]
    assert (cause["kind"], cause["axis"]) == ("thermal-scale", "X")
    return cause, " ".join(done.out.decode().split()), answer


def test_sensors_that_rise_together_are_tied_until_one_of_them_warms_alone(command, tmp_path):
    """The bed warms by 5/6 of what the column does: by the data 11 um/m/K of one are 13.2 um/m/K of the other."""
    together = measured(command, tmp_path / "together.csv", "25")
    cause, printed, answer = diagnosed(command, tmp_path, together)
    (other,) = cause["alternatives"]
    assert cause["verdict"] == "tied"
    assert {cause["sensor"], other["name"].split()[-1]} == {"bed", "column"}
    assert other["odds"] == pytest.approx(1.0, abs=0.5)
    names = [f"thermal-scale-sensor X {sensor}" for sensor in (cause["sensor"], other["name"].split()[-1])]
    assert f"TIED with {names[1]}" in printed
    assert {each["move"] for each in answer["moves"]} == {"bed alone", "column alone"}
    assert " alone warms, and cools from half time on" in answer["next_measurement"]
    assert f"separates {names[0]} from {names[1]} (odds above 1,000,000 to 1 expected)" in answer["next_measurement"]
    apart = measured(command, tmp_path / "apart.csv", "20", seed=1)
    cause, _, answer = diagnosed(command, tmp_path, together, apart)
    assert (cause["sensor"], cause["verdict"], answer["moves"]) == ("column", "strong", [])
    size, u = (cause[name]["coefficient_um_per_m_per_k"] for name in ("parameters", "u"))
    assert size == pytest.approx(11.0, abs=3.0 * u)
