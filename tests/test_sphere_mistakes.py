"""Mistakes in a measurement of spheres by every road: they are named, with row, cause and cure, or it is refused.

The files are those of `support.trunnion_spheres`, whose kinematics are its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import pytest
from support.tiers import EXAM, STATISTICAL
from support.trunnion_spheres import Touches, touched, turned

BASIS = "X=legendre:1,Y=legendre:1,Z=legendre:1,A=fourier:2,C=fourier:2"
ROADS = {
    "fit": ["fit", "d.csv", "--basis", BASIS],
    "fit of all": ["fit", "d.csv", "--prior-scale", "0.1"],
    "diagnose": ["diagnose", "d.csv"],
    "two files": ["fit", "d.csv", "other.csv", "--basis", BASIS],
    "two instruments": ["fit", "d.csv", "coarser.csv", "--basis", BASIS],
}
MOVED, OFF = 45, 17
"""Rows from 0: the first one behind a move, and the one that is off."""


class Mistake(NamedTuple):
    """A mistake: the file, exit status, and words; `{}` is the name that joined files put in front."""

    spoilt: Callable[[], Touches]
    status: int
    words: str
    others: Mapping[str, tuple[int, str]] = MappingProxyType({})
    """Status and words of roads where another file shows more."""


def moved_spheres(names: str, shift: tuple[float, float, float]) -> Callable[[], Touches]:
    return lambda: touched(moved=lambda row, name: np.array(shift) if name in names and row >= MOVED else np.zeros(3))


def changed(column: int, value: float, row: int) -> Callable[[], Touches]:
    def of() -> Touches:
        good = touched()
        rows = good.rows.copy()
        rows[row, column] += value
        return good.but(rows=rows)

    return of


def exchanged() -> Touches:
    good = touched()
    return good.but(rows=good.rows[:, [3, 1, 2, 0, 4]])


def another_name() -> Touches:
    good = touched()
    return good.but(names=(*good.names[:10], "s3", *good.names[11:]))


def readings(change: Callable[[Touches, np.ndarray], np.ndarray]) -> Callable[[], Touches]:
    def of() -> Touches:
        good = touched(r_test=True)
        assert good.readings is not None
        return good.but(readings=change(good, good.readings))

    return of


def in_workpiece(good: Touches, own: np.ndarray) -> np.ndarray:
    turns = [turned((0, 0, 1), c) @ turned((1, 0, 0), a) for a, c in good.rows[:, 3:]]
    return np.array([turn @ reading for turn, reading in zip(turns, own, strict=True)])


def in_one_row(_: Touches, own: np.ndarray) -> np.ndarray:
    return np.where(np.arange(len(own))[:, None] == OFF, -own, own)


NOISE = "Residuals are 1"
MISTAKES = {
    "sphere moved 50 um": Mistake(moved_spheres("s2", (0.03, 0.04, 0.0)), 2, "sphere {}s2 moved by "),
    "sphere moved 15 um": Mistake(moved_spheres("s2", (0.0, 0.012, 0.009)), 2, "sphere {}s2 moved by 1"),
    "sphere moved 0.5 mm": Mistake(moved_spheres("s2", (0.3, 0.4, 0.0)), 2, "sphere {}s2 moved by "),
    "spheres moved 0.1 mm": Mistake(
        moved_spheres("s1s2s3", (0.06, 0.08, 0.0)), 2, "spheres {}s1, {}s2, {}s3 moved by 99, "
    ),
    "length 10 mm": Mistake(lambda: touched().but(probe=160.0), 2, "with target {}probe at (0.015609, -0.031224, -149.98)"),
    "length 1 mm": Mistake(lambda: touched().but(probe=151.0), 2, "with target {}probe at (0.015609, -0.031224, -149.98)"),
    "length 0.2 mm": Mistake(
        lambda: touched().but(probe=150.2), 0, "Measure the length of the probe again",
        {
            "two files": (0, "target d.csv:probe: its position on the tool differs by (0.000, 0.000, 0.200) mm"),
            "two instruments": (2, "Measure the length of the probe again"),
        },
    ),
    "degrees and mm": Mistake(exchanged, 2, "with columns A and X exchanged (mm and degrees)"),
    "row 1 mm": Mistake(changed(0, 1.0, OFF), 0, "d.csv:26"),
    "first row 1 mm": Mistake(changed(1, 1.0, 0), 0, "d.csv:9: the tip is 1.016 mm from the centre of sphere {}s1"),
    "row 50 um": Mistake(changed(2, 0.05, 40), 0, "d.csv:49"),
    "zero of A 0.05 deg": Mistake(
        lambda: touched(zeros=(0.05, 0.0)), 0, "the zero of A shifted by +0.048 deg",
        {"two instruments": (2, "the zero of A shifted by +0.048 deg")},
    ),
    "zero of A 0.5 deg": Mistake(lambda: touched(zeros=(-0.5, 0.0)), 2, "the zero of A shifted by -0.502 deg"),
    "zeros 5 deg": Mistake(lambda: touched(zeros=(5.0, -5.0)), 2, "the zero of A shifted by +4.998 deg"),
    "zero of C 0.5 deg": Mistake(lambda: touched(zeros=(0.0, 0.5)), 0, "the zero of C, which alone carries the spheres"),
    "name of a sphere": Mistake(another_name, 0, "it is in sphere {}s2. Correct the name of the sphere"),
    "sign of readings": Mistake(readings(lambda _, own: -own), 2, "with the signs of dx, dy and dz reversed"),
    "sign of dx": Mistake(readings(lambda _, own: own * [-1, 1, 1]), 2, "with the sign of dx reversed"),
    "order of readings": Mistake(readings(lambda _, own: own[:, [0, 2, 1]]), 2, "in the order dx, dz, dy"),
    "frame of readings": Mistake(readings(in_workpiece), 2, "with dx, dy and dz in the directions of the workpiece"),
    "unit of readings": Mistake(readings(lambda _, own: 1e3 * own), 2, "with the points divided by 1000"),
    "sign in one row": Mistake(readings(in_one_row), 0, "d.csv:26"),
    "u_um": Mistake(
        lambda: touched().but(u_um=0.1), 0, NOISE,
        {"fit": (0, "larger than u_um, the shift is chance"), "two files": (0, "The instrument scatters")},
    ),
}  # fmt: skip
QUICK = {
    ("length 1 mm", "two files"),
    ("zero of A 0.05 deg", "fit"), ("zero of A 0.5 deg", "two files"), ("sign of dx", "fit"), ("sign of readings", "diagnose"),
    ("frame of readings", "two files"), ("sphere moved 50 um", "two files"),
    ("zero of C 0.5 deg", "fit"), ("name of a sphere", "fit"), ("row 1 mm", "two files"),
}  # fmt: skip
"""Mistakes and roads of the default tiers."""
ALL_ROADS = {"row 50 um", "sphere moved 50 um"}
"""Mistakes of the statistical tier by all roads: one that is noted, one that is refused."""


def tier(name: str, road: str) -> list[pytest.MarkDecorator]:
    """In the statistical tier is every mistake by one road at least, and by those where another file shows more."""
    if (name, road) in QUICK:
        return []
    often = (
        name in ALL_ROADS
        or road in ("fit", *MISTAKES[name].others)
        or (name, road) == ("spheres moved 0.1 mm", "diagnose")
    )
    return [STATISTICAL if often else EXAM]


@pytest.mark.parametrize(
    ("name", "road"),
    [pytest.param(name, road, marks=tier(name, road)) for name in MISTAKES for road in ROADS],
)
def test_a_mistake_is_named_or_refused(ncomp, name, road):
    mistake = MISTAKES[name]
    spoilt = mistake.spoilt()
    Path("d.csv").write_text(spoilt.text)
    other = touched(3, poses=24)
    Path("other.csv").write_text(other.but(u_um=spoilt.u_um).text)
    Path("coarser.csv").write_text(other.but(u_um=2.0).text)
    done = ncomp(*ROADS[road], "--machine", "trunnion_ac", "-o", "new.json")
    status, words = mistake.others.get(road, (mistake.status, mistake.words))
    words = words.replace("{}", "d.csv:" if road == "two files" else "")
    assert (done.status, Path("new.json").exists()) == (status, not status), done.err
    assert words in " ".join((done.err + done.out.decode()).split())


@pytest.mark.parametrize("r_test", [False, True])
def test_a_file_without_a_mistake_has_none(ncomp, r_test):
    """The location errors are those of the machine that was simulated, and no note but that on the single tip."""
    Path("d.csv").write_text(touched(r_test=r_test).text)
    done = ncomp(*ROADS["fit"], "--machine", "trunnion_ac", "-o", "new.json")
    assert done.status == 0, done.err
    notes = [line for line in done.out.decode().splitlines() if line.startswith("note")]
    assert len(notes) == 1
    assert "one tip" in notes[0]
