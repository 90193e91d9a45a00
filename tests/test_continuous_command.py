"""`ncomp continuous` and `ncomp simulate-continuous`: files in, a table out, and spoilt files refused."""

import csv
import json

import numpy as np
import pytest
from support.command import instead
from support.continuous_cases import virtual_case
from support.pages import figures

from calibration.continuous.reading import read_all
from calibration.continuous.record_file import write_records
from calibration.continuous.virtual import Targets
from calibration.measurement.written_file import write_measurement

TABLE = ["position_mm", "error_um", "u_um"]
SIMULATED = (
    "simulate-continuous", "--machine", "cframe", "--axis", "X", "--start-mm", 0, "--end-mm", 450, "--errors", "none",
    "--effect", "cyclic:component=X,axis=X,period=10,sine=[0.8],cosine=[0]", "--effect", "backlash:axis=X,width=8",
    "--spacing", 45, "-o", "run.csv", "--quasistatic", "targets.csv",
)  # fmt: skip


def rows_of(text):
    rows = list(csv.reader(text.decode().splitlines()))
    return rows[0], np.array(rows[1:], float)


@pytest.fixture
def files(tmp_path):
    """A run and its targets, as text that tests may spoil."""
    case = virtual_case(0, targets=Targets(45.0, both=False))
    with (tmp_path / "run.csv").open("wb") as file:
        write_records(case.measured.records, "X", "cframe", file)
    with (tmp_path / "targets.csv").open("wb") as file:
        write_measurement(case.measured.quasi, file)
    return tmp_path


def test_files_are_read_as_written(tmp_path):
    case = virtual_case(3, both=True, passes=2, targets=Targets(90.0, 2))
    with (tmp_path / "run.csv").open("wb") as file:
        write_records(case.measured.records, "X", "cframe", file)
    with (tmp_path / "targets.csv").open("wb") as file:
        write_measurement(case.measured.quasi, file)
    read = read_all([tmp_path / "targets.csv", tmp_path / "run.csv"], {})
    assert read.axis == "X"
    assert [(r.name, r.direction) for r in read.records] == [(r.name, r.direction) for r in case.measured.records]
    for ours, theirs in zip(read.records, case.measured.records, strict=True):
        np.testing.assert_allclose(ours.time, theirs.time, atol=1e-9)
        np.testing.assert_allclose(ours.displacement, theirs.displacement, atol=1e-9)
        assert (ours.start, ours.end, ours.feed) == (theirs.start, theirs.end, theirs.feed)
    expected = case.quasi
    assert read.quasi.runs == expected.runs
    np.testing.assert_allclose(read.quasi.target, expected.target)
    np.testing.assert_allclose(read.quasi.deviation, expected.deviation, atol=1e-9)
    np.testing.assert_array_equal(read.quasi.direction, expected.direction)
    assert read.quasi.u == expected.u


def test_from_a_virtual_machine_to_a_table(command, tmp_path):
    made = command(*SIMULATED, "--truth", "truth.json", "--both", "--runs", 2, "--seed", 5)
    assert made.status == 0, made.err
    done = command("continuous", "run.csv", "targets.csv", "-o", "table.csv", "--json", "-", "--report", "out.html")
    assert done.status == 0, done.err
    names, rows = rows_of((tmp_path / "table.csv").read_bytes())
    found = json.loads(done.out)
    assert names == TABLE
    assert len(rows) == found["rows"]
    assert np.all(np.diff(rows[:, 0]) > 0)
    assert np.all(rows[:, 2] > 0)
    assert found["direction"] == "mean"
    # the datum is the first reading, forward at 0: the mean of both directions lies half the backlash below
    wave = 0.8 * np.sin(2 * np.pi * rows[:, 0] / 10.0)
    inner = np.array(found["table"]["continuous"])
    off = (rows[:, 1] - wave)[inner]
    assert np.std(off) < 0.1
    assert abs(abs(off.mean()) - 4.0) < 0.3
    assert abs(found["reversal"]["mean_um"]) == pytest.approx(8.0, abs=0.3)
    assert found["cyclic"][0]["period_mm"] == pytest.approx(10.0, abs=0.01)
    page = (tmp_path / "out.html").read_text()
    assert len(figures(page)) == 3
    assert "Reversal" in page
    assert "Cyclic errors" in done.err


def test_table_on_standard_output_and_its_options(command, files):
    done = command("continuous", "run.csv", "targets.csv", "-o", "-", "--spacing-mm", 30)
    assert done.status == 0, done.err
    names, rows = rows_of(done.out)
    assert names == TABLE
    inner = [x for x in rows[:, 0] if x % 30 == 0]
    assert len(inner) == 16
    one = command("continuous", "run.csv", "targets.csv", "-o", "t.csv", "--run", "1", "--direction", "forward")
    assert one.status == 0, one.err
    for arguments, says in (
        (("--run", "9"), "has runs 1"),
        (("--direction", "backward"), "only forward"),
        (("--direction", "up"), "expected auto, forward, backward or mean"),
        (("--spacing-mm", "0"), "above zero"),
        (("--spacing-mm", "1e-3"), "rows over"),
        (("--json", "out.csv"), "both name"),
    ):
        refused = command("continuous", "run.csv", "targets.csv", "-o", "out.csv", *arguments)
        assert refused.status == 2
        assert says in refused.err
        assert not (files / "out.csv").exists()


def test_a_renishaw_file_of_targets(command, files):
    case = virtual_case(0, targets=Targets(45.0, both=False))
    quasi = case.quasi
    lines = ["HEADER::", "TARGET DATA::", f"Target-count: {len(quasi)}", "Targets :"]
    lines += [f"{x:.4f}" for x in quasi.target]
    lines += ["Flags: 0 0", "USER-TEXT::", "Axis: X", "RUNS::", "Run-count: 1", "DEVIATIONS::", "Run Target Data:"]
    lines += [f"1 {i} {value:.4f}" for i, value in enumerate(quasi.deviation, start=1)]
    (files / "targets.rtl").write_text("\n".join([*lines, "EOF::", ""]))
    first = command("continuous", "run.csv", "targets.rtl", "--header", "u_um=0.2", "-o", "-")
    assert first.status == 0, first.err
    second = command("continuous", "run.csv", "targets.csv", "-o", "-")
    np.testing.assert_allclose(rows_of(first.out)[1], rows_of(second.out)[1], atol=2e-3)


def spoilt(name, old, new, count=-1):
    """A change of one file's text."""
    return lambda folder: (folder / name).write_text((folder / name).read_text().replace(old, new, count))


def lines(name, change):
    """A change of one file's lines."""
    return lambda folder: (folder / name).write_text("\n".join(change((folder / name).read_text().splitlines())) + "\n")


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (spoilt("run.csv", "# axis: X\n", ""), "'# axis: X' is missing"),
        (spoilt("run.csv", "# axis: X", "# axis: C"), "no linear axis"),
        (spoilt("run.csv", "# axis: X", "# axis: Y"), "no reading of axis Y"),
        (spoilt("run.csv", "# start_mm: 0", "# start_mm: zero"), "expected a number"),
        (spoilt("run.csv", "# start_mm: 0", "# start_mm: 450"), "the run has no length"),
        (spoilt("run.csv", "# feed_mm_min: 500", "# feed_mm_min: -500"), "not above zero"),
        (spoilt("run.csv", "# end_mm: 450", "# end_mm: 440"), "from standstill to standstill"),
        (spoilt("run.csv", "# start_mm: 0\n# end_mm: 450", "# start_mm: 450\n# end_mm: 0"), "no quasi-static reading"),
        (spoilt("run.csv", "# machine: cframe", "# machine: gantry"), "gantry"),
        (spoilt("run.csv", "displacement_mm", "displacement_um"), "neither a continuous run"),
        (spoilt("run.csv", "time_s,", "seconds,"), "seconds"),
        (lines("run.csv", lambda all_: [*all_[:3000], "nan,1.0", *all_[3000:]]), "is no number"),
        (lines("run.csv", lambda all_: [*all_[:3000], all_[2000], *all_[3000:]]), "does not follow"),
        (lines("run.csv", lambda all_: [*all_[:3000], "1;2", *all_[3000:]]), "cells"),
        (lines("run.csv", lambda all_: all_[:60]), "samples"),
        (lines("run.csv", lambda all_: all_[:7]), "no rows"),
        (spoilt("targets.csv", "interferometer", "laser-tracker"), "no interferometer"),
        (spoilt("targets.csv", "# u_um: 0.2", "# u_um: -0.2"), "negative"),
        (spoilt("targets.csv", "deviation_um", "deviation"), "neither a continuous run"),
        (
            lines("targets.csv", lambda all_: [*(line for line in all_ if line[0] not in "-0123456789"), all_[-1]]),
            "at least 2",
        ),
        (lambda folder: (folder / "targets.csv").write_bytes((folder / "run.csv").read_bytes()), "no quasi-static"),
        (lambda folder: (folder / "run.csv").write_bytes((folder / "targets.csv").read_bytes()), "no continuous run"),
        (lambda folder: (folder / "run.csv").write_text(""), "empty"),
        (lambda folder: (folder / "run.csv").write_bytes(b"\x00\xff" * 500), "not"),
        (lambda folder: (folder / "targets.csv").unlink(), "No such file"),
    ],
)
def test_spoilt_files_are_refused(command, files, spoil, says):
    spoil(files)
    done = command("continuous", "run.csv", "targets.csv", "-o", "table.csv", "--json", "out.json")
    assert done.status == 2, done.err
    assert says in done.err
    assert "Traceback" not in done.err
    assert not (files / "table.csv").exists()
    assert not (files / "out.json").exists()


@pytest.mark.parametrize("kind", ["run.csv", "targets.csv"])
def test_two_files_of_one_name_are_refused(command, files, kind):
    (files / "second").mkdir()
    other = (files / kind).read_text().splitlines()
    (files / "second" / kind).write_text("\n".join(other[:-1]) + "\n")  # without its last row, so that it is no copy
    failed = command("continuous", "run.csv", "targets.csv", f"second/{kind}", "-o", "table.csv")
    assert failed.status == 2
    assert f"second/{kind} has the file name of {kind}" in " ".join(failed.err.split())
    assert not (files / "table.csv").exists()


def test_the_same_seed_makes_the_same_files(command, tmp_path):
    for _ in range(2):
        assert command(*SIMULATED, "--seed", 7, "--end-effect", "3:20", "--settling", "18:5:0.1").status == 0
        once = [(tmp_path / name).read_bytes() for name in ("run.csv", "targets.csv")]
        (tmp_path / "run.csv").unlink()
    assert command(*SIMULATED, "--seed", 7, "--end-effect", "3:20", "--settling", "18:5:0.1").status == 0
    assert once == [(tmp_path / name).read_bytes() for name in ("run.csv", "targets.csv")]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--spacing", "40"), "no whole number"),
        (("--spacing", "-1"), "above zero"),
        (("--end-mm", "4500"), "outside the travel"),
        (("--end-mm", "0"), "expected another position than --start-mm"),
        (("--axis", "Q"), "Q"),
        (("--vibration", "35"), "2 numbers"),
        (("--vibration", "-1:2"), "frequency above zero"),
        (("--settling", "1:2"), "3 numbers"),
        (("--end-effect", "3:0"), "length above zero"),
        (("--truth", "run.csv"), "both name"),
        (("--rate", "1e9"), "samples"),
        (("--feed", "nan"), "feed"),
    ],
)
def test_runs_that_can_not_be_simulated(command, tmp_path, arguments, says):
    done = command(*instead(SIMULATED, *arguments))
    assert done.status == 2
    assert says in done.err
    assert not (tmp_path / "targets.csv").exists()


def test_simulate_points_to_the_command_for_continuous_runs(command):
    done = command("simulate", "--machine", "cframe", "--strategy", "continuous", "-o", "x.csv")
    assert done.status == 2
    assert "simulate-continuous" in done.err
