"""The readings of an ISO 230-2 test by older standards, beside the present one.

ISO 230-2:1988 has A and R as ISO 230-2:2014, with 3 s in place of 2 s to each side of a mean: R of a direction is 6 s.

VDI/DGQ 3441:1977, at each target j with both directions: x_j, the mean of both means; reversal error (Umkehrspanne)
U_j, the size of their difference; s_j, the mean of s forward and s backward; positional scatter
(Positionsstreubreite) Ps_j = 6 s_j. Of the axis: the largest and the mean U_j and Ps_j; the positional deviation
(Positionsabweichung) Pa, which is the range of the x_j; the positional uncertainty (Positionsunsicherheit)

    P = max(x_j + (U_j + Ps_j) / 2) - min(x_j - (U_j + Ps_j) / 2)
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from calibration.single_axis.iso230 import AxisTest, Value, last_least, signed_size
from kinematics.transforms import Array

OF_1988 = ("A", "R", "B")
"""Values of ISO 230-2:1988; E and M came with the edition of 1997."""


def with_others(test: AxisTest) -> AxisTest:
    """The test with its values by older standards, as far as its readings allow them."""
    of_1988 = tuple(value for value in test.values_with(3.0) if value.symbol.split()[0] in OF_1988)
    return replace(test, others={"ISO 230-2:1988": of_1988, "VDI/DGQ 3441:1977": tuple(_vdi(test))})


def _vdi(test: AxisTest) -> Iterator[Value]:
    """The values of VDI/DGQ 3441."""
    used = np.flatnonzero((test.count > 1).all(axis=0))
    if not len(used):
        return
    signs = np.stack([signed_size(test.reversal[i]) for i in used], axis=1)
    size, scatter = np.abs(test.reversal[used]), 3.0 * test.spread[:, used].sum(axis=0)
    middle, half = test.mean[:, used].mean(axis=0), (size + scatter) / 2.0

    def value(symbol: str, title: str, mean: Array, spread: Array) -> Value:
        """A value by the factors `(2, used)` of the means and the s."""
        factors = np.zeros((2, 2, len(test.positions)))
        factors[:, :, used] = mean, spread
        return test.combined(symbol, title, *factors)

    def at(row: int, factor: float) -> Array:
        """Factors that are zero but at one target."""
        chosen = np.zeros(size.shape)
        chosen[row] = factor
        return chosen

    every, none = np.full(len(used), 1.0 / len(used)), np.zeros_like(signs)
    widest, largest = at(int(np.argmax(scatter)), 1.0), at(int(np.argmax(size)), 1.0)
    yield value("U max", "reversal error, largest", signs * largest, none)
    yield value("U mean", "reversal error, mean", signs * every, none)
    yield value("Ps max", "positional scatter, largest", none, none + 3.0 * widest)
    yield value("Ps mean", "positional scatter, mean", none, none + 3.0 * every)
    ends = at(int(np.argmax(middle)), 0.5) - at(last_least(middle), 0.5)
    yield value("Pa", "positional deviation", none + ends, none)
    top, bottom = int(np.argmax(middle + half)), last_least(middle - half)
    between, both = at(top, 0.5) - at(bottom, 0.5), at(top, 0.5) + at(bottom, 0.5)
    yield value("P", "positional uncertainty", between + signs * both, none + 3.0 * both)
