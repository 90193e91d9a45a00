"""Results of the tests of a laser tracker by ASME B89.4.19."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from calibration.measurement.tracker_tests import KINDS, PARAMETERS, Fitted
from rendering.report import Report, Section, Table, facts


def tracker_json(found: Fitted) -> dict[str, Any]:
    """The result for programs."""
    return {
        "parameters": dict(zip(PARAMETERS, found.parameters.tolist(), strict=True)),
        "u": dict(zip(PARAMETERS, found.u.tolist(), strict=True)),
        "tests": {
            kind: {"n": int((found.tests.kind == kind).sum()), "doubtful": found.doubtful(kind)} for kind in KINDS
        },
    }


def tracker_report(found: Fitted, name: str) -> Report:
    """The result for people; name: that of the file of the tests."""
    rows = [
        (name, f"{value:.3f}", f"{u:.3f}")
        for name, value, u in zip(PARAMETERS, found.parameters.tolist(), found.u.tolist(), strict=True)
    ]
    table = Table(("standard uncertainty (k=1)", "value", "u (k=1)"), rows)
    sections = [Section("Parameters", table=table), facts("Tests", list(_facts(found)))]
    return Report("Uncertainties of a laser tracker, ASME B89.4.19", name, sections)


def _facts(found: Fitted) -> Iterator[tuple[str, str]]:
    tests = found.tests
    for kind in KINDS:
        rows = tests.kind == kind
        if not rows.any():
            continue
        measured, k = float(np.sqrt(np.mean(tests.value[rows] ** 2))), tests.coverage or 1.0
        model = float(np.sqrt(np.mean(found.predicted[rows] ** 2))) * k
        yield kind, f"{rows.sum()} tests, RMS {measured:.2f} um, by the parameters {model:.2f} um (k={k:g})"
        if found.doubtful(kind):
            yield "DOUBTFUL", f"{kind} tests scatter more than these parameters explain: look for systematic errors"
    for name, value, u in zip(PARAMETERS, found.parameters.tolist(), found.u.tolist(), strict=True):
        if u >= value:
            yield "UNCERTAIN", f"{name}: the tests do not distinguish it from zero; test at more ranges"
