"""The results of a study: a row for each case, for files and for programs (contract 4.2)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, BinaryIO

import numpy as np

from calibration.study.run import Result
from calibration.study.stopping import LEVEL
from kinematics.transforms import Array

HEAD = ("name", "points", "minutes", "ve0_rms_um", "ve0_p95_um", "ve_rms_um", "ve_p95_um")
ALONG_PROGRAM = ("program0_rms_um", "program0_p95_um", "program_rms_um", "program_p95_um")
"""Further columns of a study with an NC program."""


def write_results(results: Sequence[Result], file: BinaryIO) -> None:
    """Write one row for each case: means and 95 % quantiles over draws of RMS errors, um."""
    with_program = len(results[0].before) > 1
    lines = [",".join((*HEAD, *ALONG_PROGRAM) if with_program else HEAD)]
    for result in results:
        numbers = [text for k in range(len(result.before)) for text in _numbers(result.before[k], result.after[k])]
        lines.append(",".join([result.case.name, str(result.points), f"{result.minutes:.1f}", *numbers]))
    file.write(("\n".join(lines) + "\n").encode())


def summary(results: Sequence[Result]) -> dict[str, Any]:
    """The results for programs, with every draw."""
    return {"cases": [_case(result) for result in results]}


def standard_errors(values: Array) -> tuple[float, float]:
    """Standard uncertainties, um, of mean and 95 % quantile of results `(draws,)`, due to the number of draws.

    That of the quantile comes from the order statistics one standard deviation of its rank (binomial) to either side.
    """
    n = len(values)
    rank = np.sqrt(LEVEL * (1 - LEVEL) / n)
    low, high = np.quantile(values, [max(LEVEL - rank, 0.0), min(LEVEL + rank, 1.0)])
    return float(values.std(ddof=1) / np.sqrt(n)), float((high - low) / 2)


def _numbers(before: Array, after: Array) -> list[str]:
    return [f"{value:.4f}" for column in (before, after) for value in (column.mean(), np.quantile(column, LEVEL))]


def _case(result: Result) -> dict[str, Any]:
    mean, quantile = standard_errors(result.after[0])
    volumes = {"ve": 0, "program": 1} if len(result.before) > 1 else {"ve": 0}
    found: dict[str, Any] = {
        "name": result.case.name,
        "points": result.points,
        "minutes": result.minutes,
        "draws": result.after.shape[1],
        "settled": result.converged,
        "u_ve_rms_um": mean,
        "u_ve_p95_um": quantile,
        "notes": list(result.notes),
    }
    for name, k in volumes.items():
        for when, values in (("0", result.before[k]), ("", result.after[k])):
            found[f"{name}{when}_rms_um"] = float(values.mean())
            found[f"{name}{when}_p95_um"] = float(np.quantile(values, LEVEL))
            found[f"{name}{when}_um"] = values.tolist()
    if result.check is not None:
        found["exact_check"] = {
            "draws": len(result.check.exact),
            "largest_difference_um": result.check.difference,
        }
    return found
