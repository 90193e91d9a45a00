"""Calibrations drawn from the covariance of one: the uncertainty of what it predicts, a rigid motion apart.

The uncertainties of `ncomp predict` belong to the datum of the calibration. The errors of the exam are those that the
best rigid motion leaves, so their uncertainty is that of samples from which the best rigid motion is taken as well.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from shop_floor.chain import Array

SAMPLES = 60
STUDENT_95 = 2.0003
"""Quantile of Student's distribution of 60 degrees of freedom, for intervals of 95 %."""
PREDICT = """
import sys
from pathlib import Path
import numpy as np
import ncomp
points, machine, folder = sys.argv[1:]
files = sorted(Path(folder).glob("*.json"))
np.save(Path(folder) / "deviations.npy", [ncomp.predict(points, machine, file).deviation_um for file in files])
"""
"""The prediction of every calibration of a folder, through the public interface of ncomp."""


SHORTEST = 0.01
"""Shortest time constant, lag or length of a draw, as a share of the fitted one."""
POSITIVE = ("time_constants_s", "time_constant_s", "lag_s", "length", "period", "pitch")
"""Parameters that no effect has at zero or below; the data may hardly determine them."""


def write_samples(calibration: Mapping[str, Any], folder: Path) -> bool:
    """Write calibrations drawn from the covariance of one to a folder; False if it has none."""
    covariance = calibration.get("covariance")
    if not covariance:
        return False
    values, vectors = np.linalg.eigh(np.array(covariance))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    drawn = np.random.default_rng(0).normal(size=(SAMPLES, len(values))) @ root.T
    for number, shifts in enumerate(drawn):
        sample = {**calibration, "covariance": None, "effects": _moved(calibration["effects"], shifts)}
        (folder / f"{number:03}.json").write_text(json.dumps(sample), encoding="utf-8")
    return True


def _moved(effects: list[dict[str, Any]], shifts: Array) -> list[dict[str, Any]]:
    """Effects with their parameters, those that have a unit, moved one after the other."""
    found, at = [], 0
    for effect in effects:
        moved = dict(effect)
        for key in effect["units"]:
            values = effect[key]
            count = len(values) if isinstance(values, list) else 1
            new = np.ravel(values) + shifts[at : at + count]
            if key in POSITIVE:
                new = np.maximum(new, SHORTEST * np.ravel(values))
            new = new.tolist()
            moved[key], at = (new if isinstance(values, list) else new[0]), at + count
        found.append(moved)
    if at != len(shifts):
        raise ValueError(f"the calibration has {at} parameters, its covariance {len(shifts)} rows")
    return found
