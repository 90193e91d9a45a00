"""Rows that the fit of one of several measurements leaves out, and its noise, where this is not the specified one."""

from __future__ import annotations

from collections.abc import Iterator

from calibration.fit.fit import Fit
from calibration.plausibility.finding import Finding

LISTED_OUTLIERS = 5
"""Most outliers of a measurement that are listed one by one."""


def outlier_findings(own: Fit) -> Iterator[Finding]:
    """A finding for each of the first rows that were left out as outliers."""
    rows = own.outliers.tolist()
    for row in rows[:LISTED_OUTLIERS]:
        off = f"{own.measurement.where(row)}: outlier, {own.residual_um[row]:.1f} um from the other rows, left out"
        yield Finding("outliers", off, False)
    if len(rows) > LISTED_OUTLIERS:
        yield Finding(
            "outliers", f"{own.measurement.source}: {len(rows) - LISTED_OUTLIERS} more rows are left out", False
        )


def noise_findings(own: Fit) -> Iterator[Finding]:
    """A finding where the residuals of a measurement alone contradict the specification of its instrument."""
    if own.measurement.noise is not None:
        yield Finding(
            "noise",
            f"chi2/dof {own.chi2_reduced:.3g} by the instrument specification, which the residuals contradict. The "
            f"noise of the fit is that of the residuals: {own.measurement.noise.text.rstrip('.')}",
            False,
        )
