"""Results of the tests of a laser tracker by ASME B89.4.19."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from calibration.measurement.tracker_tests import KINDS, PARAMETERS, Fitted
from kinematics.files.number_text import uncertainty
from rendering.report import Report, Section, Table, facts

MEANINGS = {
    "u_range_um": "range, um",
    "u_range_um_per_m": "range, um per m of range",
    "u_angle_um": "across the beam, um",
    "u_angle_um_per_m": "across the beam, um per m of range",
}
"""Quantity of each parameter, with its unit."""


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
        (MEANINGS[name], name, f"{value:.3f}", uncertainty(u, 3))
        for name, value, u in zip(PARAMETERS, found.parameters.tolist(), found.u.tolist(), strict=True)
    ]
    table = Table(("standard uncertainty (k=1)", "name in files", "value", "u (k=1)"), rows)
    sections = [Section("Parameters", table=table), facts("Tests", list(_facts(found)))]
    return Report("Uncertainties of a laser tracker, ASME B89.4.19", name, sections, verdict=_verdict(found))


def _verdict(found: Fitted) -> str:
    """The uncertainties in a sentence, and a second one if a kind of tests contradicts them."""
    range_um, range_per_m, angle_um, angle_per_m = found.parameters.tolist()
    doubtful = [kind for kind in KINDS if found.doubtful(kind)]
    more = "The tests do not contradict them."
    if doubtful:
        more = f"The {' and '.join(doubtful)} tests scatter more than they explain: look for systematic errors."
    return (
        f"Standard uncertainties (k=1): {range_um:.2f} um + {range_per_m:.2f} um/m along the beam, "
        f"{angle_um:.1f} um + {angle_per_m:.1f} um/m across it.\n{more}"
    )


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
