"""Mistakes in lengths: units, exchanged positions, and lengths that contradict each other.

A machine with any scales and any angles between its axes maps positions by a matrix F, so that the squares of lengths
are linear in the symmetric matrix F'F: with more lengths than this matrix has parts, they check each other.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, combinations_with_replacement

import numpy as np
from scipy import special

from calibration.instruments import Lengths
from calibration.instruments.lengths.geometry import RULER, pairs_of
from calibration.instruments.lengths.reading import UNNAMED
from calibration.measurement.measurement import Measurement
from calibration.plausibility.finding import Finding
from kinematics.files.number_text import rounded
from kinematics.transforms import Array

IMPOSSIBLE_LENGTH_SHARE = 0.05
"""Difference of a length from its positions, as a share, that no machine in use has."""
EXPLAINED_DIFFERENCE = 0.02
"""Difference, as a share, within which a factor or another pair of positions explains a length."""
UNITS = {25.4: "inches", 10.0: "cm", 1000.0: "m"}
"""Units of lengths, mm, that people mix up."""
BENT_MM, BENT_PER_MM = 0.1, 5e-4
"""Errors of a machine besides scales and angles that are no contradiction: mm, and mm per mm of length."""
CONTRADICTING_LENGTHS_P = 1e-4
"""p of chi2 below which lengths contradict each other."""
BLAMED_CHI2 = 12.0
"""Difference of chi2 from which one length is to blame, and no other."""
SAME_LENGTH_END_MM = 1e-6


@dataclass(frozen=True)
class _Lengths:
    """The lengths of a measurement."""

    names: list[str]
    """As the rows name them, else their lines."""
    labels: list[str]
    """With their lines, for the beginning of a message."""
    chords: Array
    """From the first to the second position `(n, 3)`, mm, of the nominal machine."""
    measured: Array
    """`(n,)`, mm."""
    u: Array
    """Standard uncertainties `(n,)`, mm, with errors of the machine besides scales and angles."""

    @classmethod
    def of(cls, measurement: Measurement) -> _Lengths:
        """Those of which both ends are there."""
        first, second = pairs_of(measurement)
        points = measurement.nominal_points
        variance = measurement.covariances[:, 0, 0]
        measured = measurement.observed[second, 0] - measurement.observed[first, 0]
        bent = BENT_MM + BENT_PER_MM * measured
        names = [_name(measurement, row) or _line(measurement, row) for row in first.tolist()]
        places = [_line(measurement, row) for row in first.tolist()]
        labels = [place if name == place else f"{place}: {name}" for name, place in zip(names, places, strict=True)]
        u = np.sqrt(variance[first] + variance[second] + bent**2)
        return cls(names, labels, points[second] - points[first], measured, u)

    @property
    def nominal(self) -> Array:
        """Distances `(n,)`, mm, of the commanded positions."""
        return np.asarray(np.linalg.norm(self.chords, axis=1))

    @property
    def design(self) -> Array:
        """Derivatives `(n, parts)`, in standard uncertainties, of the lengths by the parts of F'F."""
        parts = [self.chords[:, i] * self.chords[:, j] for i, j in combinations_with_replacement(range(3), 2)]
        return np.asarray(np.stack(parts, axis=1) / (2.0 * self.measured * self.u)[:, None])

    @property
    def off(self) -> Array:
        """Lengths less those of the nominal machine `(n,)`, in standard uncertainties, as their squares show them."""
        return np.asarray((self.measured**2 - self.nominal**2) / (2.0 * self.measured * self.u))


def length_mistakes(measurement: Measurement) -> Iterator[Finding]:
    """Findings on the lengths of a measurement, and on the scale of the ruler."""
    ruler = Lengths.expect(measurement.instrument)
    lengths = _Lengths.of(measurement)
    wrong = list(_wrong_sizes(lengths))
    yield from (Finding("units", text, True) for text in wrong[:3])
    if wrong:
        return
    if contradiction := _contradiction(lengths):
        yield Finding("contradiction", contradiction, True)
        return
    if len(lengths.names) and not _spare(lengths.design):
        yield Finding("unchecked", _unchecked(measurement), False)
    if len(lengths.names) and not ruler.knows_scale:
        yield Finding(
            "ruler",
            f"the {RULER} is not stated (# u_scale_um_per_m: ...): it counts as 1000 um/m, so that the scale of the "
            "machine cannot be told from that of the ruler; squareness, and differences between the axes, do not "
            "depend on it",
            False,
        )


def _line(measurement: Measurement, row: int) -> str:
    """The line of a row, with its file where there are several: messages begin with the name of the only one."""
    if measurement.file is not None or measurement.lines is None:
        return measurement.where(row)
    return f"line {measurement.lines[row]}"


def _name(measurement: Measurement, row: int) -> str:
    """Name of a length without that of its file and its line; empty for one without a name."""
    name = str(measurement.groups[row]).rpartition(":")[2].partition(" (line")[0]
    return "" if name == UNNAMED else name


def _wrong_sizes(lengths: _Lengths) -> Iterator[str]:
    """Lengths that are not those of their positions, each with its likely cause."""
    ratios = lengths.measured / lengths.nominal
    off = np.flatnonzero(np.abs(ratios - 1.0) > IMPOSSIBLE_LENGTH_SHARE).tolist()
    for factor, unit in UNITS.items():
        if len(off) == len(ratios) > 0 and np.all(np.abs(ratios * factor - 1.0) < EXPLAINED_DIFFERENCE):
            k = off[0]
            yield (
                f"{lengths.labels[k]}: {lengths.measured[k]:g} between positions {rounded(lengths.nominal[k], 5)} mm "
                f"apart, and the same factor in all rows: the lengths are in {unit}; write them in mm"
            )
            return
    for k in off:
        alike = [
            j for j in range(len(ratios)) if abs(lengths.measured[k] / lengths.nominal[j] - 1.0) < EXPLAINED_DIFFERENCE
        ]
        others = " or ".join(dict.fromkeys(lengths.names[j] for j in alike))
        hint = (
            f"it fits the positions of {others}: are the positions of two rows exchanged?"
            if alike
            else "correct the length or the positions; a machine that errs so much needs other steps per mm first"
        )
        yield (
            f"{lengths.labels[k]}: {lengths.measured[k]:g} mm between positions {rounded(lengths.nominal[k], 5)} mm "
            f"apart: {hint}"
        )


def _spare(design: Array) -> int:
    """Number of lengths that the others check."""
    return len(design) - int(np.linalg.matrix_rank(design)) if len(design) else 0


def _chi2(lengths: _Lengths, rows: np.ndarray) -> tuple[float, int, Array]:
    """chi2 of some rows under their best scales and angles, its degrees of freedom, and F'F - 1 `(parts,)`."""
    design, off = lengths.design[rows], lengths.off[rows]
    found = np.linalg.lstsq(design, off, rcond=None)[0]
    return float(np.sum((off - design @ found) ** 2)), _spare(design), found


def _contradiction(lengths: _Lengths) -> str:
    """Statement that lengths contradict each other, with those that may be wrong; empty where they do not."""
    every = np.arange(len(lengths.names))
    chi2, spare, _ = _chi2(lengths, every)
    if not spare or special.chdtrc(spare, chi2) > CONTRADICTING_LENGTHS_P:
        return ""
    left = np.array([_chi2(lengths, np.delete(every, k))[0] for k in every])
    blamed = np.flatnonzero(left < left.min() + BLAMED_CHI2).tolist()
    worst = int(np.argmin(left))
    if len(blamed) == 1:
        found = _chi2(lengths, np.delete(every, worst))[2]
        miss = (lengths.off[worst] - lengths.design[worst] @ found) * lengths.u[worst]
        return (
            f"{lengths.labels[worst]}: {lengths.measured[worst]:g} mm contradicts the other lengths, which say "
            f"{rounded(lengths.measured[worst] - miss, 5)} mm whatever the scales and angles of the axes are: measure "
            "it again, correct the row, or delete it"
        )
    names = ", ".join(f"{lengths.names[k]} {lengths.measured[k]:g}" for k in blamed)
    most = max(chi2**0.5 * lengths.u[k] for k in blamed)
    return (
        f"the lengths contradict each other by about {rounded(most, 2)} mm whatever the scales and angles of the axes "
        f"are, and one of these is wrong: {names}. Measure them again; one more length would show which"
    )


def _unchecked(measurement: Measurement) -> str:
    """Statement that nothing checks the lengths, with a length between known positions that would."""
    first, second = pairs_of(measurement)
    positions = measurement.state.positions
    known = np.unique(np.round(positions[np.concatenate([first, second])], 6), axis=0)
    ends = [[tuple(end) for end in np.round(positions[rows], 6).tolist()] for rows in (first, second)]
    taken = [{one, two} for one, two in zip(*ends, strict=True)]
    free = [(a, b) for a, b in combinations(known, 2) if {tuple(a.tolist()), tuple(b.tolist())} not in taken]
    advice = "; measure one length more"
    if free:
        advice = f"; the length between {_at(measurement, free[0][0])} and {_at(measurement, free[0][1])} would"
    return f"no length checks another: a wrong one goes unnoticed{advice}"


def _at(measurement: Measurement, position: Array) -> str:
    """A position of the axes that move."""
    machine = measurement.machine
    cells = [
        f"{name} {rounded(value, 6)}"
        for name, value in zip(machine.names, (position / machine.scale).tolist(), strict=True)
        if name in measurement.moving
    ]
    return " ".join(cells)
