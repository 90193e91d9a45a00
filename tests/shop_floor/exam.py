"""Questions put to the command line of ncomp; each answer is a record, a line of a JSON-lines file."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np

from shop_floor.chain import Array
from shop_floor.hidden import Answer
from shop_floor.question import Question, ask, earlier
from shop_floor.sampling import PREDICT, STUDENT_95, write_samples
from shop_floor.scoring import score, title

ROOT = Path(__file__).parents[2]
NCOMP = "from postproc.cli import run; run()"
K_95 = 1.959964
Record = dict[str, Any]


class Key(NamedTuple):
    """What identifies a question."""

    design: str
    cause: str
    machine: str
    draw: int
    seed: int


class Ended(NamedTuple):
    """How a command ended."""

    status: int
    seconds: float
    """Time on the processor, user and system."""
    words: str


class Failure(RuntimeError):
    """A command that ended with a fault, or not in time."""


def key_of(record: Mapping[str, Any]) -> Key:
    """The key of a record."""
    return Key(*(record[name] for name in Key._fields))


def answer(key: Key, *, timeout: float, options: Sequence[str] = (), keep: Path | None = None) -> Record:
    """The record of a question; a failure is one too. `options` are passed on to `ncomp diagnose`."""
    record: Record = key._asdict()
    try:
        question = ask(key.design, key.cause, key.machine, key.draw, key.seed)
    except RuntimeError as invisible:
        return record | {"not_asked": str(invisible)}
    record |= {
        "rows": len(question.run),
        "hidden": [{"effect": type(one).__name__, **_plain(asdict(one))} for one in question.hidden],
        "times_noise": [round(size.times_noise, 2) for size in question.sizes],
        "left": [round(size.left) for size in question.sizes],
        "visible": [round(size.share, 2) for size in question.sizes],
    }
    with TemporaryDirectory() as name:
        folder = Path(name)
        try:
            record |= _asked(key, question, folder, timeout, options)
        except Failure as fault:
            record["failure"] = str(fault)
        if keep is not None:
            _keep(folder, keep / "-".join(map(str, key)))
    return record


def _asked(key: Key, question: Question, folder: Path, timeout: float, options: Sequence[str]) -> Record:
    data, new, out = folder / "data.csv", folder / "new.json", folder / "diagnosis.json"
    data.write_text(question.sheet(), encoding="utf-8")
    given = _calibrated(key, folder, timeout) if key.design == "again" else None
    against = [] if given is None else ["--calibration", given]
    ended = ncomp(timeout, "diagnose", data, "--machine", key.machine, *against, "-o", new, "--json", out, *options)
    refused = ended.status == 2 and out.exists()
    if ended.status != 0 and not refused:
        raise Failure(f"diagnose: status {ended.status}: {ended.words[-1500:]}")
    diagnosis = json.loads(out.read_text(encoding="utf-8"))
    calibration = json.loads(new.read_text(encoding="utf-8")) if new.exists() else None
    logged = question.logged
    answers = [effect.answer(logged) for effect in question.hidden]
    scored = score(diagnosis, answers, question.run.machine, calibration, _allowed(question))
    before = _unseen(question, given, folder, timeout).error_um
    after = _unseen(question, new if calibration else given, folder, timeout)
    u = None if calibration is None else _sampled_u(question, calibration, folder, timeout)
    nameable = Unseen(question.nameable().unseen_errors(after.predicted), after.predicted)
    # a confirmed calibration is written as it was
    heldout = [
        diagnosis[when]["heldout_rms_um"] for when in ("before", "before" if diagnosis["confirmed"] else "after")
    ]
    return {
        "named": scored.named,
        "tied": scored.tied,
        "missed": scored.missed,
        "false": list(scored.false),
        "inside": scored.inside,
        "sizes": scored.sizes,
        "found": [title(effect) for effect in diagnosis["effects"]],
        "odds": [[effect["log10_odds"], title(effect) not in scored.false] for effect in diagnosis["effects"]],
        "unexplained": (diagnosis.get("unexplained") or {}).get("variables"),
        "accepted": bool(diagnosis.get("accepted", True)),
        "written": calibration is not None,
        "reason": diagnosis.get("reason", ""),
        "rms_um": [diagnosis[when]["rms_um"] for when in ("before", "after")],
        "heldout_um": heldout,
        "noise_um": diagnosis["noise_um"],
        "unseen_um": [before, after.error_um],
        "unseen_nameable_um": nameable.error_um,
        "covered": after.within(u, STUDENT_95),
        "covered_nameable": nameable.within(u, STUDENT_95),
        "covered_in_datum": after.within(after.u),
        "seconds": ended.seconds,
    }


def _allowed(question: Question) -> list[Answer]:
    """Non-repeatability of the axes, and fine waves of positioning errors, may be named as what they are."""
    answers = [Answer(("repeatability", "non-repeatability"))] if question.run.repeatability_um else []
    for axis, (_, periods, _) in question.motions.ripple.items():
        found = question.run.machine.axis(axis)
        period = (found.high - found.low) / periods
        answers += [
            Answer(("cyclic",), frozenset(axis), sizes={"period_mm": period}),
            Answer(("higher-frequency",), frozenset(axis)),
        ]
    return answers


def _calibrated(key: Key, folder: Path, timeout: float) -> Path:
    """The calibration of the machine before: by `fit` in even draws, by `diagnose` in odd ones."""
    data, given = folder / "earlier.csv", folder / "given.json"
    data.write_text(earlier(key.machine, key.draw, key.seed).sheet(), encoding="utf-8")
    verb = "diagnose" if key.draw % 2 else "fit"
    ended = ncomp(timeout, verb, data, "--machine", key.machine, "-o", given)
    if ended.status != 0:
        raise Failure(f"{verb} of the earlier data: status {ended.status}: {ended.words[-1500:]}")
    return given


class Unseen(NamedTuple):
    """Errors `(n, 3)` of predictions at unseen poses, um, and the standard uncertainties `(n, 3)` of `ncomp predict`."""

    errors: Array
    predicted: Array
    u: Array | None = None

    @property
    def error_um(self) -> float:
        """RMS length of the errors, um."""
        return math.sqrt(float(np.mean(np.sum(self.errors**2, axis=1))))

    def within(self, u: Array | None, k: float = K_95) -> float | None:
        """Share of the errors within k standard uncertainties."""
        return None if u is None else float(np.mean(np.abs(self.errors) <= k * u))


def _unseen(question: Question, calibration: Path | None, folder: Path, timeout: float) -> Unseen:
    """What a calibration, or none, predicts at the unseen poses."""
    run = question.unseen
    if calibration is None:
        nothing = np.zeros((len(run), 3))
        return Unseen(question.unseen_errors(nothing), nothing)
    points, predicted = folder / "unseen.csv", folder / "predicted.csv"
    points.write_text(question.unseen_sheet(), encoding="utf-8")
    ended = ncomp(timeout, "predict", points, "--machine", run.machine.name, "-c", calibration, "-o", predicted)
    if ended.status != 0:
        raise Failure(f"predict: status {ended.status}: {ended.words[-1500:]}")
    deviation, u = _prediction(predicted)
    return Unseen(question.unseen_errors(deviation), deviation, u)


def _sampled_u(question: Question, calibration: Mapping[str, Any], folder: Path, timeout: float) -> Array | None:
    """Standard uncertainties `(n, 3)`, um, of predictions at unseen poses, a rigid motion apart; None without covariance."""
    samples = folder / "samples"
    samples.mkdir()
    if not write_samples(calibration, samples):
        return None
    ended = run_python(timeout, PREDICT, folder / "unseen.csv", question.run.machine.name, samples)
    if ended.status != 0:
        raise Failure(f"predictions of samples: status {ended.status}: {ended.words[-1500:]}")
    deviations = np.load(samples / "deviations.npy")
    shutil.rmtree(samples)
    apart = [question.without_rigid_motion(deviation) for deviation in deviations]
    return np.asarray(np.std(apart, axis=0, ddof=1))


def _prediction(file: Path) -> tuple[Array, Array]:
    """Deviations and standard uncertainties `(n, 3)`, um."""
    lines = [line for line in file.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    columns = lines[0].split(",")
    wanted = [columns.index(f"{part}d{xyz}_um") for part in ("", "u_") for xyz in "xyz"]
    numbers = np.array([[float(line.split(",")[i]) for i in wanted] for line in lines[1:]])
    return numbers[:, :3], numbers[:, 3:]


def ncomp(timeout: float, *arguments: object) -> Ended:
    """Run a command of ncomp."""
    return run_python(timeout, NCOMP, *arguments)


def run_python(timeout: float, program: str, *arguments: object) -> Ended:
    """Run a program in a process of its own, on one thread; Failure if it does not end in time."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    process = subprocess.Popen(
        [sys.executable, "-c", program, *map(str, arguments)],
        cwd=ROOT,
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    late = threading.Event()

    def stop() -> None:
        late.set()
        process.kill()

    timer = threading.Timer(timeout, stop)
    timer.start()
    start = time.perf_counter()
    with process:
        assert process.stdout is not None
        words = process.stdout.read()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    timer.cancel()
    if late.is_set():
        raise Failure(f"{arguments[0]}: not ended after {time.perf_counter() - start:.0f} s")
    return Ended(process.returncode, usage.ru_utime + usage.ru_stime, words)


def _keep(folder: Path, target: Path) -> None:
    """Keep the files of a question."""
    shutil.copytree(folder, target, dirs_exist_ok=True)


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a hidden effect; long ones (a random walk) are left out."""
    return {key: value for key, value in values.items() if not isinstance(value, tuple) or len(value) <= 12}


def read_records(file: Path) -> list[Record]:
    """The records of a file; an interrupted last line is left out."""
    records = []
    for line in file.read_text(encoding="utf-8").splitlines():
        try:
            records.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return records
