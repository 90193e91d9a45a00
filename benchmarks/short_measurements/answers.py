"""Answers of ncomp to the questions, compared with the truth."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from shop_floor.exam import ncomp
from shop_floor.sampling import PREDICT, write_samples

from short_measurements.case import KINDS, OF_ONE_AXIS, UM, Case
from short_measurements.machines import AXES, Array
from short_measurements.visibility import power

ROOT = Path(__file__).parents[2]
TIMEOUT_S = 1800.0
"""Longest time of a diagnosis."""


def without_rigid(points: Array, off: Array) -> Array:
    """Displacements `(n, 3)` of points without their best rigid motion."""
    arm = points - points.mean(axis=0)
    arm = arm / np.abs(arm).max()
    motion = np.stack([np.tile(np.eye(3)[k], (len(arm), 1)) for k in range(3)] + [np.cross(e, arm) for e in np.eye(3)])
    columns = motion.reshape(6, -1).T
    return (off.reshape(-1) - columns @ np.linalg.lstsq(columns, off.reshape(-1), rcond=None)[0]).reshape(-1, 3)


def rms(off: Array) -> float:
    """RMS length of displacements `(n, 3)`."""
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


Record = dict[str, Any]


def asked(case: Case, folder: Path) -> Record:
    """The answer to a question."""
    case.write(folder)
    new, out = folder / "new.json", folder / "out.json"
    words = ("-m", case.machine, "-o", new, "--force", "--json", out)
    ended = ncomp(TIMEOUT_S, "diagnose", folder / "data.csv", *words)
    record: Record = {"name": case.name, "machine": case.machine, "design": case.design, "effect": case.effect}
    record |= {"axis": AXES[case.axis], "times_noise": round(case.times_noise, 2), "stated": float(case.stated)}
    record["power"] = round(power(case), 3)
    if not out.exists():
        return {**record, "failure": ended.words[-300:]}
    record["seconds"] = ended.seconds
    found = json.loads(out.read_text(encoding="utf-8"))
    record |= judged(case, found["effects"], found["unexplained"], found["estimated_noise"])
    s = case.unseen()
    nominal = case.nominal(s)
    true = without_rigid(nominal, (case.points(s, unseen=True) - nominal) / UM)
    record |= {"accepted": not found["forced"], "reason": found["forced"] or "", "widened": found["widened"]}
    record |= {"none_um": rms(true), **predicted(case, new, folder, nominal, true)}
    return record


def judged(case: Case, effects: list[Record], unexplained: Record | None, noise: Record | None = None) -> Record:
    """Verdict on the causes, and those that are not there; noise: as estimated from the data."""

    def fits(cause: Record) -> bool:
        where = case.effect not in OF_ONE_AXIS or cause.get("axis") in (AXES[case.axis], None)
        return cause["kind"] in KINDS[case.effect] and where

    named = [each for each in effects if fits(each)]
    tied = [each for each in effects if each not in named and any(map(fits, each.get("alternatives", [])))]
    false = [each for each in effects if each not in named and each not in tied]
    stated = case.effect == "stick-slip" and AXES[case.axis] in (noise or {}).get("non_repeatability", {})
    verdict = "named" if named else "tied" if tied else "unexplained" if unexplained or stated else "missed"
    words = [f"{each['kind']} {each.get('axis') or ''} {each['verdict']}" for each in false]
    odds = [[each["log10_odds"], each not in false] for each in effects]
    return {"verdict": verdict, "false": words, "odds": odds, "variables": (unexplained or {}).get("variables")}


def predicted(case: Case, new: Path, folder: Path, nominal: Array, true: Array) -> Record:
    """Error that the calibration leaves, um, the uncertainty of its predictions, and the share within the intervals."""
    if not new.exists():
        return {}
    samples = folder / "samples"
    samples.mkdir()
    calibration = json.loads(new.read_text(encoding="utf-8"))
    drawn = write_samples(calibration, samples)
    (samples / "_.json").write_text(json.dumps({**calibration, "covariance": None}), encoding="utf-8")
    words = [sys.executable, "-c", PREDICT, folder / "unseen.csv", case.machine, samples]
    subprocess.run(list(map(str, words)), capture_output=True, cwd=ROOT, check=True)
    order = sorted(path.stem for path in samples.glob("*.json"))
    tables = [without_rigid(nominal, table) for table in np.load(samples / "deviations.npy")]
    own = tables.pop(order.index("_"))
    record: Record = {"after_um": rms(own - true)}
    if drawn:
        u = np.sqrt(np.mean((np.stack(tables) - own) ** 2, axis=0))
        record |= {"u_um": rms(u), "covered": float(np.mean(np.abs(own - true) <= 2.0 * u))}
    return record
