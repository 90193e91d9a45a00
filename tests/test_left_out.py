"""Rows that disagree with the others are in the head of every report, with their size and their run."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

BAD = {100.0: 117.0, 300.0: -51.0}
"""Deviations, um, of two readings of the first run, by target."""


def two_bad_rows():
    """Five runs there and back to five targets, two readings of the first run far off."""
    rng, targets = np.random.default_rng(1), np.linspace(0.0, 400.0, 5)
    rows = []
    for run in range(1, 6):
        for direction, order in (("+", targets), ("-", targets[::-1])):
            for target in order.tolist():
                error = 8.0 * np.sin(target / 90.0) + (3.0 if direction == "+" else -3.0) + rng.uniform(-2.0, 2.0)
                error += BAD.get(target, 0.0) if (run, direction) == (1, "+") else 0.0
                rows.append(f"X,{run},{direction},{target:g},{error:.3f}")
    head = "# machine: cframe\n# instrument: interferometer\n# u_um: 0.5\naxis,run,direction,target_mm,deviation_um\n"
    Path("runs.csv").write_text(head + "\n".join(rows) + "\n")


@pytest.mark.parametrize("command_name", ["fit", "diagnose"])
def test_the_head_names_the_rows_that_were_left_out(command, command_name):
    two_bad_rows()
    done = command(command_name, "runs.csv", "--machine", "cframe", "-o", "out.json", "--report", "page.html")
    assert done.status == 0, done.err
    (line,) = re.findall(r"LEFT OUT: .*", done.out.decode())
    assert "2 of 50 rows, all of run 1" in line
    assert re.search(r"runs\.csv:6 \(1[12]\d um\)", line)
    assert re.search(r"runs\.csv:8 \((4|5)\d(\.\d)? um\)", line)
    assert "LEFT OUT: 2 of 50 rows" in Path("page.html").read_text()


def test_rows_of_angles_are_in_urad(command):
    two_bad_rows()
    text = (
        Path("runs.csv")
        .read_text()
        .replace("u_um: 0.5", "u_angle_urad: 0.5")
        .replace("target_mm,deviation_um", "target_mm,component,deviation_urad")
    )
    Path("runs.csv").write_text(re.sub(r"(?m)^(X,\d,[+-],\d+),", r"\1,B,", text))
    done = command("fit", "runs.csv", "--machine", "cframe", "-o", "out.json")
    assert done.status == 0, done.err
    (line,) = re.findall(r"LEFT OUT: .*", done.out.decode())
    assert re.search(r"runs\.csv:6 \(1[12]\d urad\)", line)


def test_iso_230_2_says_which_readings_make_its_repeatability(command):
    two_bad_rows()
    done = command("iso230", "runs.csv", "--machine", "cframe", "--json", "r.json")
    assert done.status == 0, done.err
    assert "2 of 50 readings disagree with the others of their target, all in run 1" in done.out.decode()
    (axis,) = json.loads(Path("r.json").read_text())["axes"]
    assert axis["values"]["R"]["value_um"] > 200.0
    assert axis["values_without_astray"]["R"] < 20.0
    assert [round(each["deviation_um"], -1) for each in axis["astray"]] == [120.0, -50.0]


def test_no_reading_is_marked_where_none_is_off(command):
    two_bad_rows()
    lines = Path("runs.csv").read_text().splitlines()
    Path("runs.csv").write_text("\n".join(line for i, line in enumerate(lines) if i not in (5, 7)) + "\n")
    done = command("iso230", "runs.csv", "--machine", "cframe", "--json", "r.json")
    assert "disagree" not in done.out.decode()
    (axis,) = json.loads(Path("r.json").read_text())["axes"]
    assert axis["astray"] == []


def test_a_second_run_is_proposed_only_where_there_is_one(command):
    two_bad_rows()
    lines = Path("runs.csv").read_text().splitlines()
    found = {}
    for runs in (5, 1):
        Path("some.csv").write_text("\n".join(lines[: 4 + 10 * runs]) + "\n")
        done = command("diagnose", "some.csv", "--machine", "cframe", "-o", "out.json", "--force")
        found[runs] = re.findall(r"first-cycle.*", done.out.decode())
    assert found[5]
    assert not any("second run" in line for line in found[5])
