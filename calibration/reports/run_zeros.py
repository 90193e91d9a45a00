"""Zeros of the runs of an interferometer in a report."""

from __future__ import annotations

from collections.abc import Iterator

from calibration.fit.set_up.run_zeros import Registered, run_zeros
from kinematics.files.number_text import uncertainty
from rendering.report import Section, Table

TEXT = (
    "A zero is the reading of a run for an axis without error. The fit estimates the zeros with the errors and removes "
    "them: a difference between runs is in no error motion. The standard uncertainty u (k=1) is relative to the other "
    "runs of the axis."
)


def zeros_section(found: Registered) -> Iterator[Section]:
    """The table of the zeros; none where there are no runs with zeros."""
    rows = [(zero.run, f"{zero.value:.3f}", uncertainty(zero.u, 3), zero.unit) for zero in run_zeros(found)]
    if rows:
        yield Section("Zeros of the runs", TEXT, Table(("axis and run", "zero", "u (k=1)", "unit"), rows), detail=True)
