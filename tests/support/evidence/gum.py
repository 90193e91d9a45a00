"""Uncertainties of ncomp beside the GUM's example H.3, and beside GTC, the calculator of uncertainties of MSL.

GTC propagates through formulas that are written here anew, from the geometry and the standards.
"""

from __future__ import annotations

import GTC
import msgspec
import numpy as np

import ncomp
from calibration.measurement.measurement import Measurement
from kinematics.basis import Legendre
from kinematics.effects import ErrorMotion
from kinematics.error_model.model import no_errors
from support.evidence.digits import Agreement, digits
from support.evidence.strd import measurement_of, thermometer_readings

SLOPE, ITS_U = 2.18, 0.67
"""H.3: 0.00218 and 0.00067, here in mdegC per degC."""
WIDE = 1e3
"""Prior of the slope in units of the typical size."""
FORWARD, BACKWARD = (
    ((0.1, 0.9, 0.4), (3.2, 2.1, 2.9), (-1.4, -0.6, -0.2)),
    ((1.1, 0.5, 1.9), (4.6, 4.1, 5.2), (0.3, 1.2, 0.8)),
)
"""Readings, um, at the targets 0, 100 and 300 mm in three runs each way."""
TARGETS = (0.0, 100.0, 300.0)


def thermometer() -> list[Agreement]:
    """H.3: temperatures as positions of an axis, corrections as its errors; their scatter is estimated."""
    temperature, correction = thermometer_readings()
    measured = measurement_of({"target_mm": temperature, "deviation_um": correction}, 1.0)
    found = ncomp.fit(measured, basis="legendre:1", noise="estimate", prior_scale=WIDE, hold_out=False, force=True)
    half = (max(temperature) - min(temperature)) / 2.0
    slope, u = (
        float(values[1]) / half for values in (found.model.parameters, np.sqrt(np.diag(found.model.covariance)))
    )
    line = GTC.type_a.line_fit(temperature, correction).a_b[1]
    through = '`ncomp.fit`, `noise="estimate"`'
    assert (round(slope, 2), round(u, 2)) == (SLOPE, ITS_U)
    return [
        Agreement("GUM H.3, GTC", through, "slope", digits([slope], [line.x])),
        Agreement("GUM H.3, GTC", through, "its standard uncertainty", digits([u], [line.u])),
    ]


def squareness() -> list[Agreement]:
    """The tangent of a corner from two diagonals and a side."""
    found = ncomp.square(851.0, 846.5, 600.0, u=0.2)
    ac, bd, ad = (GTC.ureal(length, 0.2) for length in (851.0, 846.5, 600.0))
    ab = GTC.sqrt((ac**2 + bd**2) / 2.0 - ad**2)
    corner = GTC.acos((ac**2 - bd**2) / (4.0 * ab * ad))
    tangent = 1.0 / GTC.tan(corner)
    return [Agreement("GTC", "`ncomp.square`", "u of the squareness", digits([found.u_tangent], [tangent.u]))]


def positioning() -> list[Agreement]:
    """All values of ISO 230-2 from readings with independent uncertainties and a common scale."""
    rows = [
        ("X", run + 1, sign, target, readings[run])
        for sign, way in (("+", FORWARD), ("-", BACKWARD))
        for target, readings in zip(TARGETS, way, strict=True)
        for run in range(3)
    ]
    (found,) = ncomp.iso230(_runs(rows))
    scale = GTC.ureal(0.0, 2.0)
    up, down = (
        [
            [GTC.ureal(x, 0.3) + scale * target * 1e-3 for x in readings]
            for target, readings in zip(TARGETS, way, strict=True)
        ]
        for way in (FORWARD, BACKWARD)
    )
    expected = {symbol: 2.0 * value.u for symbol, value in _of_the_standard(up, down).items()}
    own = {value.symbol: value.U for value in found.values}
    assert own.keys() == expected.keys()
    return [
        Agreement("GTC", "`ncomp.iso230`", "U of all 12 values", digits(own.values(), [expected[name] for name in own]))
    ]


def _runs(rows: list[tuple[str, int, str, float, float]]) -> Measurement:
    """Readings of an interferometer in both directions: axis, run, direction, target, mm, and deviation, um."""
    columns = {"target_mm": [row[3] for row in rows], "deviation_um": [row[4] for row in rows]}
    return measurement_of(columns, 0.3, u_per_m=2.0, runs=[(str(row[1]), row[2]) for row in rows])


def _of_the_standard(up, down):  # type: ignore[no-untyped-def]  # GTC has no types
    """ISO 230-2:2014 with uncertain numbers."""
    means = [[sum(each) / len(each) for each in way] for way in (up, down)]
    spreads = [
        [GTC.sqrt(sum((x - mean) ** 2 for x in each) / (len(each) - 1)) for each, mean in zip(way, own, strict=True)]
        for way, own in zip((up, down), means, strict=True)
    ]
    (a, b), (s, t) = means, spreads
    reversal = [x - y for x, y in zip(a, b, strict=True)]

    def range_of(values):  # type: ignore[no-untyped-def]
        return max(values, key=lambda each: each.x) - min(values, key=lambda each: each.x)

    def largest(values):  # type: ignore[no-untyped-def]
        return max(values, key=lambda each: each.x)

    def accuracy(ways):  # type: ignore[no-untyped-def]
        high = [x + 2 * w for own, spread in ways for x, w in zip(own, spread, strict=True)]
        low = [x - 2 * w for own, spread in ways for x, w in zip(own, spread, strict=True)]
        return largest(high) - min(low, key=lambda each: each.x)

    both = [2 * x + 2 * y + GTC.magnitude(d) for x, y, d in zip(s, t, reversal, strict=True)]
    return {
        "B": largest([GTC.magnitude(each) for each in reversal]), "mean B": sum(reversal) / len(reversal),
        "E forward": range_of(a), "E backward": range_of(b), "E": range_of([*a, *b]),
        "M": range_of([(x + y) / 2 for x, y in zip(a, b, strict=True)]),
        "R forward": largest([4 * x for x in s]), "R backward": largest([4 * x for x in t]),
        "R": largest([*both, *(4 * x for x in s), *(4 * x for x in t)]),
        "A forward": accuracy([(a, s)]), "A backward": accuracy([(b, t)]), "A": accuracy([(a, s), (b, t)]),
    }  # fmt: skip


def prediction() -> list[Agreement]:
    """Deviations of a gantry whose X errs and yaws, with parameters that are correlated."""
    gantry, interval = ncomp.load_machine("gantry"), (0.0, 1000.0)
    effects = (
        ErrorMotion("X", "X", Legendre(interval, 1), (12.0, -7.0)),
        ErrorMotion("C", "X", Legendre(interval, 1), (9.0, 15.0)),
    )
    values, u = (12.0, -7.0, 9.0, 15.0), np.array([1.0, 0.7, 2.0, 1.5])
    correlation = np.array([[1, 0.4, -0.3, 0.1], [0.4, 1, 0.2, -0.5], [-0.3, 0.2, 1, 0.6], [0.1, -0.5, 0.6, 1.0]])
    model = msgspec.structs.replace(no_errors(gantry), effects=effects)
    known = model.with_parameters(np.array(values), correlation * np.outer(u, u))
    x, y = 700.0, 430.0
    found = ncomp.predict(np.array([[x, y, 0.0]]), "gantry", known)
    numbers = GTC.multiple_ureal(values, u.tolist(), np.inf)
    for i, one in enumerate(numbers):
        for j, other in enumerate(numbers[:i]):
            GTC.set_correlation(float(correlation[i, j]), one, other)
    share = 2.0 * x / 1000.0 - 1.0
    shift, angle = (numbers[0] + share * numbers[1]) * 1e-3, (numbers[2] + share * numbers[3]) * 1e-6
    moved = (shift - GTC.sin(angle) * y, GTC.cos(angle) * y - y)
    through = "`ncomp.predict`"
    return [
        Agreement("GTC", through, "deviation", digits(found.deviation_um[0, :2], [each.x * 1e3 for each in moved])),
        Agreement("GTC", through, "its u", digits(found.u_um[0, :1], [moved[0].u * 1e3])),
    ]


def rows() -> list[Agreement]:
    """All comparisons."""
    return [*thermometer(), *squareness(), *positioning(), *prediction()]
