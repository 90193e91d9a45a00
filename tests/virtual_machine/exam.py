"""The exam of `ncomp diagnose`: questions are written to a folder, the real command answers, its files are judged."""

from __future__ import annotations

import json
import math
import multiprocessing
import os
import runpy
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from virtual_machine.chain import nominal_points, tool_points
from virtual_machine.draws import Draw
from virtual_machine.observe import aligned
from virtual_machine.scoring import Score, findings, score, title

GRID = 9
STATUS = "\nstatus of the command: "
"""Before its exit code, behind its words."""
FORKS = multiprocessing.get_context("forkserver")
FORKS.set_forkserver_preload(
    ["postproc.cli", "postproc.command_line", "calibration.diagnosis.diagnose", "calibration.reports.diagnosis"]
)
FINE_UM = 5.0
"""Amplitude of the finest wave of E_XX from which it has to be named; Table 1 draws up to 14."""


class Answered(NamedTuple):
    """What the command wrote."""

    diagnosis: Mapping[str, Any]
    calibration: Mapping[str, Any]
    """The new one."""
    seconds: float
    new: Path
    given: Path | None = None
    """The calibration that it started from."""


@dataclass(frozen=True)
class Result:
    """A question, judged."""

    name: str
    times: tuple[float, ...]
    """Sizes of the causes, in units of the noise of the mean."""
    score: Score
    heldout: float
    """Ratio of the held-out RMS after to that of the same data with nothing wrong; nan where that was not asked."""
    found: tuple[str, ...]
    seconds: float


def ncomp(*arguments: object) -> float:
    """Run the command in a process of its own, forked where its imports are done; seconds.

    RuntimeError with its words when it fails.
    """
    start = time.perf_counter()
    with tempfile.NamedTemporaryFile() as said:
        process = FORKS.Process(target=_command, args=([str(argument) for argument in arguments], said.name))
        process.start()
        process.join()
        # the exit code of a process that ends while another thread starts one can get lost
        words, _, status = Path(said.name).read_text(encoding="utf-8").rpartition(STATUS)
    if status != "0":
        raise RuntimeError(f"ncomp {' '.join(map(str, arguments))}: status {status or process.exitcode}\n{words}")
    return time.perf_counter() - start


def diagnose(draw: Draw, folder: Path, *, clean: bool = False) -> Answered:
    """The diagnosis of the data, `clean` with nothing wrong, against the calibration that goes with them."""
    machine = draw.setup.session.chain.name
    data, new, answer = folder / "data.csv", folder / "new.json", folder / "diagnosis.json"
    data.write_text(draw.sheet(clean=clean), encoding="utf-8")
    given = _calibration(draw, data, clean=clean)
    against = ["--calibration", given] if given else []
    seconds = ncomp("diagnose", data, "--machine", machine, *against, "-o", new, "--json", answer)
    return Answered(_json(answer), _json(new), seconds, new, given)


def ask(draw: Draw, *, with_twin: bool = False) -> Result:
    """A question judged by its causes; the twin is the same data, noise and all, with nothing wrong."""
    with tempfile.TemporaryDirectory() as name:
        answered = diagnose(draw, Path(name))
        heldout = math.nan
        if with_twin:
            twin = diagnose(draw, Path(name), clean=True).diagnosis
            heldout = answered.diagnosis["after"]["heldout_rms_um"] / twin["before"]["heldout_rms_um"]
    judged = score(answered.diagnosis, answered.calibration, [cause.answer() for cause in draw.causes])
    found = tuple(title(effect) for effect in findings(answered.diagnosis, answered.calibration))
    return Result(draw.name, draw.times, judged, heldout, found, answered.seconds)


def tied(draw: Draw, kinds: Sequence[str]) -> tuple[bool, str]:
    """Whether one of two kinds is named as tied and the other as its alternative, and nothing else; what was said."""
    with tempfile.TemporaryDirectory() as name:
        said = diagnose(draw, Path(name)).diagnosis["effects"]
    told = [(e["kind"], e["axis"], e["verdict"], sorted(a["kind"] for a in e.get("alternatives", ()))) for e in said]
    both = len(said) == 1 and any(
        kind == one and verdict == "tied" and other in alternatives
        for kind, _, verdict, alternatives in told
        for one, other in (tuple(kinds), tuple(kinds)[::-1])
    )
    return both, str(told)


def not_visible(draw: Draw, kind: str) -> tuple[bool, str]:
    """Whether the kind is named as not visible, and no cause; what was said."""
    with tempfile.TemporaryDirectory() as name:
        said = diagnose(draw, Path(name)).diagnosis
    kinds = [effect["kind"] for effect in said["effects"]]
    return not kinds and any(
        kind in what for what in said["not_visible"]
    ), f"{kinds}; not visible {said['not_visible']}"


def unexplained(draw: Draw, variables: set[str]) -> tuple[bool, str]:
    """Whether what is left depends on just these variables, and no effect of the table is blamed; what was said."""
    with tempfile.TemporaryDirectory() as name:
        said = diagnose(draw, Path(name)).diagnosis
    kinds, left = [effect["kind"] for effect in said["effects"]], said["unexplained"]
    return not kinds and left is not None and set(left["variables"]) == variables, f"{kinds}; left {left}"


def volumetric(draw: Draw) -> tuple[bool, float, float]:
    """The gantry of Table 1: whether X is said to need a higher frequency; volumetric error, um, before and after.

    And E_XX of it, where its fine wave is drawn larger than `FINE_UM`: in other draws it is that of other motions. The
    error is the RMS length, over a grid of positions, of what a calibration predicts less the truth, after rigid
    alignment.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        answered = diagnose(draw, folder)
        found = findings(answered.diagnosis, answered.calibration)
        finer = [e for e in found if e.get("kind") in ("higher-frequency", "cyclic") and e.get("axis") == "X"]
        assert answered.given is not None
        errors = [_error_of(draw, calibration, folder) for calibration in (answered.given, answered.new)]
    fine = float(np.hypot(*draw.setup.curves.coefficients["X"][0, 4:]))
    named = any(e.get("component") == "X" for e in finer) or (bool(finer) and fine < FINE_UM)
    return named, errors[0], errors[1]


def _calibration(draw: Draw, data: Path, *, clean: bool) -> Path | None:
    """The calibration that goes with the data; what is in order is not calibrated coarsely."""
    machine, given = draw.setup.session.chain.name, data.with_name("given.json")
    if draw.calibrated == "before":
        earlier = data.with_name("earlier.csv")
        earlier.write_text(draw.earlier_sheet(), encoding="utf-8")
        ncomp("fit", earlier, "--machine", machine, "-o", given)
        return given
    if draw.calibrated == "coarse" and not clean:
        ncomp("fit", data, "--machine", machine, "--basis", draw.coarse_basis, "-o", given)
        return given
    return None


def _error_of(draw: Draw, calibration: Path, folder: Path) -> float:
    """um; the calibration's own predictions against the truth, on a grid."""
    chain, setup = draw.setup.session.chain, draw.setup
    ladders = [np.linspace(*axis.travel, GRID) for axis in chain.axes]
    grid = np.stack([part.reshape(-1) for part in np.meshgrid(*ladders, indexing="ij")], axis=1)
    states, predicted = folder / "grid.csv", folder / "predicted.csv"
    rows = [",".join(chain.names), *(",".join(f"{value:.4f}" for value in row) for row in grid.tolist())]
    states.write_text(f"# machine: {chain.name}\n# target.t1: 0 0 0\n" + "\n".join(rows) + "\n", encoding="utf-8")
    ncomp("predict", states, "--machine", chain.name, "--calibration", calibration, "-o", predicted)
    lines = [line for line in predicted.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    columns = lines[0].split(",")
    wanted = [columns.index(f"d{letter}_um") for letter in "xyz"]
    said = np.array([[float(line.split(",")[i]) for i in wanted] for line in lines[1:]]) * 1e-3
    none = np.zeros((len(grid), 3))
    nominal = nominal_points(chain, grid, none)
    true = tool_points(chain, grid, setup.curves.errors(chain, grid), np.zeros((len(grid), 6)), none) - nominal
    left = aligned(said - true, nominal, np.zeros(len(grid)))
    return float(np.sqrt(np.mean(np.sum(left**2, axis=1))) * 1e3)


def _json(file: Path) -> Mapping[str, Any]:
    result: Mapping[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return result


def _command(arguments: list[str], output: str) -> None:
    """What the installed command does, its words going to a file."""
    with Path(output).open("ab", buffering=0) as said:
        for stream in (sys.stdout, sys.stderr):
            os.dup2(said.fileno(), stream.fileno())
    script = Path(sys.executable).with_name("ncomp")
    sys.argv = [str(script), *arguments]
    status: int | str | None = 0
    try:
        runpy.run_path(str(script), run_name="__main__")
    except SystemExit as ended:
        status = ended.code or 0
    sys.stdout.flush()
    with Path(output).open("a", encoding="utf-8") as words:
        words.write(f"{STATUS}{status}")
