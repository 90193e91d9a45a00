"""Progress: the step in work with its share, on a terminal only."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
from functools import partial
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest
from support.programs import load

import ncomp
from calibration.fit.together import calibrate_together
from calibration.instruments import LaserTracker
from calibration.measurement.measurement import Target
from calibration.measurement.plan import Choices
from calibration.optimal.optimise import Request, optimised
from calibration.simulation.measure_plan import VirtualInstrument
from calibration.simulation.true_model import random_true_model
from rendering.figures import Figure, Panel
from rendering.page import page
from rendering.report import Report, Section

ROOT = Path(__file__).parents[1]
BOX = ROOT / "examples" / "box.nc"
SET_UP = {"work_offset": ["G54=-30,-20,150"], "tool_length": ["T1=80"]}
THREE = {"a": Target((0.0, 0.0, -100.0)), "b": Target((90.0, 40.0, -180.0)), "c": Target((-80.0, 60.0, -150.0))}
TRACKER = LaserTracker(u_range_um=0.5, u_angle_um=1.0)
NUMBERED = re.compile(r"(\d+) of (\d+): ")


class Recorded:
    """Steps and shares, as they are shown."""

    def __init__(self) -> None:
        self.steps: list[tuple[str, float | None]] = []

    def __call__(self, step: str, share: float | None = None, /) -> None:
        self.steps.append((step, share))

    def check(self) -> None:
        """Shares grow from the begin of a step, and the numbers of the steps do not fall and reach their known number.

        A step without a share begins another turn.
        """
        for (step, begins), found in groupby(self.steps, lambda each: (each[0], each[1] is None)):
            shares = [] if begins else [share for _, share in found]
            assert all(0.0 <= share <= 1.0 for share in shares), step
            assert shares == sorted(shares), step
        found = [NUMBERED.match(step) for step, _ in self.steps]
        assert all(found)
        numbers = [int(each[1]) for each in found]
        (of,) = {int(each[2]) for each in found}
        assert numbers == sorted(numbers)
        assert set(numbers) == set(range(1, of + 1))

    def shares(self, words: str) -> list[float]:
        """Shares of the steps with these words."""
        return [share for step, share in self.steps if words in step and share is not None]


def measured(seed, points=24):
    plan = ncomp.plan("gantry", "random", points, choices=Choices(targets=THREE))
    model = random_true_model(plan.machine, np.random.default_rng(seed))
    return ncomp.simulate(plan, model, VirtualInstrument(TRACKER), seed=seed).measurement


def test_the_steps_of_a_fit():
    shown, without = Recorded(), Recorded()
    ncomp.fit(measured(3), basis="legendre:1", force=True, progress=shown)
    shown.check()
    shares = shown.shares("held-out residuals")
    assert len(shares) > 2
    assert shares == pytest.approx([k / len(shares) for k in range(len(shares))])
    ncomp.fit(measured(3), basis="legendre:1", hold_out=False, force=True, progress=without)
    without.check()
    assert without.steps[-1] == ("2 of 2: identifiability", None)


@pytest.mark.statistical
def test_the_steps_of_a_fit_of_several_measurements():
    shown = Recorded()
    calibrate_together([measured(3), measured(4)], basis="legendre:1", force=True, progress=shown)
    shown.check()
    assert shown.shares("predicting each") == [0.0, 0.5]


@pytest.mark.statistical
def test_the_steps_of_an_optimised_plan():
    shown = Recorded()
    choices = Choices(targets=THREE)
    optimised(load("gantry"), TRACKER, Request(choices, 12, candidates=60), shown)
    shown.check()
    assert shown.shares("choosing positions") == pytest.approx([k / 12 for k in range(12)])
    assert any("places of the instrument" in step for step, _ in shown.steps)


@pytest.mark.statistical
def test_the_steps_of_a_diagnosis():
    shown = Recorded()
    ncomp.diagnose(measured(3, 60), progress=shown)
    shown.check()
    assert [step for step, _ in shown.steps][:: len(shown.steps) - 1] == [
        "1 of 3: checking the data",
        "3 of 3: verdicts and calibration",
    ]


def test_the_share_of_a_verification_is_that_of_both_texts():
    setup, done = ncomp.set_up("dmu50", **SET_UP), []
    corrected = ncomp.correct(BOX, "dmu50", setup=setup).text
    ncomp.verify(BOX, corrected, "dmu50", setup=setup, progress=done.append)
    assert sum(done) == BOX.stat().st_size + len(corrected)


def test_the_share_of_a_page_is_that_of_its_figures():
    sections = [Section(f"{k}", figure=partial(Figure, [Panel()])) for k in range(4)]
    shares = []
    page(Report("title", "", [*sections, Section("text", "Text.")]), shares.append)
    assert shares == [0.0, 0.25, 0.5, 0.75]


def on_a_terminal(folder, *words):
    """The output of a command whose standard error is a terminal."""
    ours, theirs = pty.openpty()
    words = [sys.executable, "-m", "ncomp", *map(str, words)]
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "120", "PYTHONPATH": str(ROOT)}
    with (folder / "out").open("wb") as out:
        process = subprocess.Popen(words, stderr=theirs, stdout=out, cwd=folder, env=environment)
    os.close(theirs)
    parts = []
    try:
        while part := os.read(ours, 1 << 16):
            parts.append(part)
    except OSError:  # the other end is closed
        pass
    os.close(ours)
    assert process.wait() == 0
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", b"".join(parts).decode()), (folder / "out").read_text()


def long_verification(folder):
    """A command that verifies a long program."""
    line = "G1 X62.500 Y40.000 Z1.000 F600.\nG1 X60.000 Y42.500 Z1.000\n"
    (folder / "long.nc").write_text("G21 G90 G54\nT1 M6\nG0 X0. Y0. Z50. B0. C0.\n" + 17_000 * line)
    words = ("verify", "long.nc", "long.nc", "--machine", "dmu50", "--work-offset", "G54=-30,-20,150", "--tool-length")
    return (*words, "T1=80", "--json", "-")


def test_a_terminal_shows_steps_and_shares_and_a_pipe_nothing(command, tmp_path):
    words = long_verification(tmp_path)
    shown, result = on_a_terminal(tmp_path, *words)
    shares = [int(share) for share in re.findall(r"verifying\s.*?(\d+) %", shown)]
    assert len(set(shares)) > 2
    assert shares == sorted(shares)
    piped = command(*words)
    assert piped.out.decode() == result
    assert "verifying" not in piped.err


@pytest.mark.statistical
def test_a_quiet_command_shows_no_progress(tmp_path):
    shown, _ = on_a_terminal(tmp_path, *long_verification(tmp_path), "--quiet")
    assert "verifying" not in shown
    assert "%" not in shown
