"""Rotary axes that turn fully: their errors repeat with the turn, whatever was measured and in whichever basis."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.basis_examples import BASES
from virtual_machine.calibrated import read_calibration
from virtual_machine.chain import load as chain_of

import machines
from kinematics.basis import BSpline, Fourier, Harmonics, Legendre
from kinematics.effects import CrossAxis, ErrorMotion
from kinematics.error_model.model import ErrorModel, no_errors, read_model, write_model
from kinematics.machine import Axis, Machine
from kinematics.state import State
from kinematics.turn import beyond, columns_of, gap_of, measured_arc

TRUNNION = machines.load("trunnion_ac")
C = TRUNNION.axes[TRUNNION.index("C")]
A = TRUNNION.axes[TRUNNION.index("A")]
ROUND = np.linspace(0.0, 360.0, 721)
OVER = {
    "legendre, a turn": Legendre((0.0, 360.0), 4),
    "legendre, part": Legendre((0.0, 340.0), 4),
    "legendre, half": Legendre((-90.0, 90.0), 3),
    "fourier of older calibrations": Fourier((0.0, 360.0), (2.0, 4.0)),
    "fourier, two turns": Fourier((-360.0, 360.0), (4.0, 8.0)),
    "table": BSpline((10.0, 100.0, 200.0, 370.0), 1),
    "spline": BSpline((0.0, 90.0, 180.0, 350.0), 3),
    "harmonics": Harmonics((20.0, 380.0), 3),
}
every_basis = pytest.mark.parametrize("basis", OVER.values(), ids=OVER)


def with_motion(machine: Machine, basis: object, axis: str = "C") -> ErrorModel:
    rng = np.random.default_rng(1)
    values = tuple(rng.uniform(-10, 10, basis.size).tolist())
    effects = tuple(ErrorMotion(c, axis, basis, values, u=(0.1,) * len(values)) for c in "XYZABC")
    return replace_effects(no_errors(machine), effects)


def replace_effects(model: ErrorModel, effects: tuple) -> ErrorModel:
    return msgspec.structs.replace(model, effects=effects)


def at(machine: Machine, axis: str, degrees: np.ndarray) -> State:
    q = np.zeros((len(degrees), len(machine.axes)))
    q[:, machine.index(axis)] = np.deg2rad(degrees)
    return State(q)


@pytest.mark.parametrize(
    ("name", "turning"),
    [
        ("dmu50", "C"),
        ("trunnion_ac", "C"),
        ("trunnion_bc", "C"),
        ("head_table", "C"),
        ("head_head", "C"),
        ("gantry", ""),
    ],
)
def test_axes_that_turn_fully(name, turning):
    assert "".join(axis.name for axis in machines.load(name).axes if axis.turns_fully) == turning


@every_basis
@pytest.mark.parametrize("turns", [-2, -1, 1, 7])
def test_positions_a_turn_apart_have_one_error(basis, turns):
    model = with_motion(TRUNNION, basis)
    once, again = (model.errors(TRUNNION, at(TRUNNION, "C", ROUND + k * 360.0)) for k in (0, turns))
    np.testing.assert_allclose(again, once, atol=1e-11)
    u = [model.design(TRUNNION, at(TRUNNION, "C", ROUND + k * 360.0), np.ones((721, 1, 36))) for k in (0, turns)]
    np.testing.assert_allclose(u[1], u[0], atol=1e-9)


@every_basis
def test_errors_do_not_jump_anywhere_on_the_turn(basis):
    values = columns_of(C, basis, np.linspace(-400.0, 800.0, 240_001))
    assert np.abs(np.diff(values, axis=0)).max() < 0.01


@every_basis
def test_nothing_exceeds_the_measured_values_where_nothing_was_measured(basis):
    low, high = basis.interval
    inside, out = columns_of(C, basis, np.linspace(low, high, 2001)), columns_of(C, basis, ROUND)
    parameters = np.random.default_rng(2).normal(size=(basis.size, 50))
    assert (np.abs(out @ parameters).max(axis=0) <= np.abs(inside @ parameters).max(axis=0) + 1e-3).all()


@pytest.mark.parametrize("basis", [b for b in BASES.values() if not isinstance(b, Harmonics)], ids=lambda b: b.interval)
def test_axes_that_cannot_turn_fully_keep_their_end_values(basis):
    x = np.linspace(-1000.0, 1000.0, 101)
    assert (columns_of(A, basis, x) == basis.columns(x)).all()


def test_a_measured_arc_is_kept_as_it_was_measured():
    basis = Legendre((0.0, 300.0), 4)
    x = np.linspace(0.0, 300.0, 301)
    np.testing.assert_allclose(columns_of(C, basis, x), basis.columns(x), atol=1e-12)


def test_products_with_another_axis_repeat_with_the_turn():
    effect = CrossAxis("Z", "C", "X", (0.0, 360.0), (-250.0, 250.0), 2, 1, (3.0, -2.0, 5.0))
    model = replace_effects(no_errors(TRUNNION), (effect,))
    states = [at(TRUNNION, "C", ROUND + k) for k in (0.0, -720.0)]
    for state in states:
        state.positions[:, TRUNNION.index("X")] = 100.0
    np.testing.assert_allclose(*(model.errors(TRUNNION, state) for state in states), atol=1e-12)


def test_shipped_calibration_repeats_with_the_turn():
    machine = machines.load("dmu50")
    path = machines.default_calibration(machine)
    assert path is not None
    model = read_model(path, machine)
    once, again = (model.errors(machine, at(machine, "C", ROUND + k)) for k in (0.0, 360.0))
    np.testing.assert_allclose(again, once, atol=1e-12)


@every_basis
def test_the_second_implementation_reads_the_same_errors(basis, tmp_path):
    model = with_motion(TRUNNION, basis)
    write_model(model, tmp_path / "cal.json")
    x = np.linspace(-800.0, 800.0, 333)
    q = np.zeros((len(x), len(TRUNNION.axes)))
    q[:, TRUNNION.index("C")] = x
    if basis.interval[1] - basis.interval[0] <= 360.0:
        there = read_calibration(tmp_path / "cal.json").errors(chain_of("trunnion_ac"), q)
        here = model.errors(TRUNNION, at(TRUNNION, "C", x))[:, : len(TRUNNION.axes)]
        np.testing.assert_allclose(there, here, atol=1e-12)


# ---- which arc was measured


@pytest.mark.parametrize(
    ("positions", "arc"),
    [
        (np.arange(0.0, 341.0, 5.0), (0.0, 340.0)),
        (np.arange(0.0, 341.0, 20.0), (0.0, 360.0)),
        (np.arange(0.0, 356.0, 5.0), (0.0, 360.0)),
        (np.arange(0.0, 361.0, 30.0), (0.0, 360.0)),
        (np.arange(-90.0, 91.0, 10.0), (-90.0, 90.0)),
        (np.r_[np.arange(270.0, 360.0, 10.0), np.arange(0.0, 91.0, 10.0)], (270.0, 450.0)),
        (np.arange(-720.0, 721.0, 30.0), (-720.0, -360.0)),
        (np.array([0.0, 90.0]), (0.0, 90.0)),
        (np.array([0.0, 360.0]), (0.0, 0.0)),
    ],
)
def test_measured_arc(positions, arc):
    assert measured_arc(positions) == pytest.approx(arc)


@given(st.floats(-1000.0, 1000.0), st.floats(20.0, 330.0), st.integers(-3, 3))
def test_measured_arc_wherever_it_begins(low, width, turns):
    x = low + width * np.linspace(0.0, 1.0, 60)
    x[::2] += 360.0 * turns
    found = measured_arc(x)
    assert found[1] - found[0] == pytest.approx(width, abs=1e-6)
    assert np.remainder(found[0] - low + 180.0, 360.0) == pytest.approx(180.0, abs=1e-6)


def test_outside_is_counted_along_the_turn():
    assert gap_of((0.0, 340.0)) == 20.0
    assert gap_of((0.0, 351.0)) == 0.0
    x = np.array([0.0, 340.0, 345.0, -5.0, 350.0, 710.0, 359.0, 180.0])
    np.testing.assert_allclose(beyond((0.0, 340.0), x), [0, 0, 5, 5, 10, 10, 1, 0], atol=1e-9)
    model = with_motion(TRUNNION, Legendre((0.0, 340.0), 2))
    (excess,) = {round(v, 6) for v in model.outside(TRUNNION, at(TRUNNION, "C", x)).values()}
    assert excess == 10.0
    whole = with_motion(TRUNNION, Legendre((0.0, 360.0), 2))
    assert not whole.outside(TRUNNION, at(TRUNNION, "C", np.linspace(-720.0, 720.0, 99)))


def test_uncertainty_grows_where_nothing_was_measured():
    model = with_motion(TRUNNION, Legendre((0.0, 340.0), 2))
    unit = np.zeros((721, 1, 36))
    unit[:, 0, 6 * TRUNNION.index("C")] = 1e3
    u = model.standard_uncertainty(TRUNNION, at(TRUNNION, "C", ROUND), unit)[:, 0]
    assert u[ROUND <= 340.0].max() < 0.3
    assert u[ROUND == 350.0] == pytest.approx(30.0 * (1 - np.cos(np.deg2rad(20.0))), rel=0.05)
    half = with_motion(TRUNNION, Legendre((0.0, 180.0), 2))
    assert half.standard_uncertainty(TRUNNION, at(TRUNNION, "C", ROUND), unit)[:, 0][ROUND == 270.0] > 29.0


def test_an_axis_of_less_than_a_turn_counts_as_before():
    short = replace(TRUNNION, axes=tuple(_short(axis) for axis in TRUNNION.axes))
    model = with_motion(short, Legendre((0.0, 340.0), 2))
    assert max(model.outside(short, at(short, "C", np.array([345.0]))).values()) == pytest.approx(5.0)


def _short(axis: Axis) -> Axis:
    return replace(axis, travel=(0.0, 350.0)) if axis.name == "C" else axis


# ---- by the command

SETUP = ("--work-offset", "G54=0,0,0", "--work-offset", "0=0,0,0", "--tool-length", "T1=100")
POSITIONS = ((20.0, 30.0, 100.0, 10.0), (-40.0, 55.5, 80.0, -25.0), (60.0, -70.0, 120.0, 0.0))
OLDER = """{
  "ncomp_calibration": 1,
  "machine": {"name": "dmu50", "chain": "w C B b X Y Z t", "chain_hash": "04ecb243831f99a4"},
  "provenance": {"made_by": "ncomp 0.1.0", "made_at": "2026-11-01T00:00:00Z", "source": "fit", "inputs": {}},
  "demonstration": false,
  "effects": [
    {
      "kind": "error-motion", "component": "Y", "axis": "C",
      "basis": {"kind": "legendre", "interval": [0.0, 360.0], "degree": 2},
      "parameters": [1.0, 30.0, -20.0], "units": {"parameters": "um"}, "u": [0.1, 0.1, 0.1], "note": ""
    }
  ]
}
"""


HEADS = {
    "iso": "G21 G90 G54\nT1 M6\nG0 Z250.",
    "siemens": "G71 G90 G54\nT1 D1\nM6\nG0 Z250.",
    "heidenhain": "BEGIN PGM P MM\nTOOL CALL 1 Z S1000\nL Z+250 R0 FMAX",
}


def program(dialect: str, turns: list[float], tilt: str = "A") -> str:
    """Six moves at each position of C, degrees."""
    rapid, feed, end = ("G0", "G1", "M30") if dialect != "heidenhain" else ("L", "L", "END PGM P MM")
    fast = " R0 FMAX" if dialect == "heidenhain" else ""
    rows = [
        f"{rapid} X{x:+} Y{y:+} Z{z:+} {tilt}{a:+} C{c:+}{fast}\n{feed} X{x + 5:+} F500"
        for c in turns
        for x, y, z, a in POSITIONS
    ]
    return "\n".join([HEADS[dialect], *rows, end, ""])


def words(text: bytes | str, letters: str = "XYZ") -> list[float]:
    """Numbers of some words of a program, less those of its head."""
    text = text.decode() if isinstance(text, bytes) else text
    found = re.findall(rf"[{letters}]([+-]?[\d.]+)", text.partition("250")[2])
    return [float(number) for number in found]


def apart(one: Iterable[float], other: Iterable[float]) -> float:
    return max(abs(a - b) for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize("dialect", HEADS)
def test_turns_of_c_get_one_correction_in_every_dialect(dialect, command, tmp_path):
    write_model(with_motion(TRUNNION, Legendre((0.0, 355.0), 3)), tmp_path / "c.json")

    def corrected(dialect: str, turns: list[float]) -> list[np.ndarray]:
        (tmp_path / "p.nc").write_text(program(dialect, turns))
        run = ("p.nc", "--machine", "trunnion_ac", "-c", "c.json", *SETUP, "--dialect", dialect, "-o", "-")
        done = command(*run)
        assert done.status == 0, done.err
        assert words(done.out, "C") == np.repeat(turns, len(POSITIONS)).tolist()
        return np.split(np.array(words(done.out)), len(turns))

    first, *others, away = corrected(dialect, [-90.0, 270.0, 630.0, 90.0])
    np.testing.assert_array_equal(others, [first, first])
    np.testing.assert_allclose(first, corrected("iso", [-450.0])[0], atol=6e-4)
    assert 0.002 < apart(first, words(program(dialect, [-90.0]))) < 0.1
    assert apart(first, away) > 0.002


def test_an_unmeasured_arc_is_refused_by_the_command(command, tmp_path):
    write_model(with_motion(TRUNNION, Legendre((0.0, 340.0), 3)), tmp_path / "c.json")
    (tmp_path / "p.nc").write_text(program("iso", [-90.0, 710.0, 339.0, 360.0]))
    run = ("p.nc", "--machine", "trunnion_ac", "-c", "c.json", *SETUP, "-o", "o.nc")
    done = command(*run)
    assert done.status == 2
    assert "6 of 24 evaluated moves (25.0%) end outside the range" in done.err
    assert "(lines 10-15)" in done.err
    assert not (tmp_path / "o.nc").exists()
    done = command(*run, "--accept", "outside")
    assert done.status == 0, done.err
    assert "10 deg" in done.err
    assert (tmp_path / "o.nc").exists()


def test_a_calibration_by_older_code_repeats_with_the_turn(command, tmp_path):
    """The curve over 0 to 360 of C does not close: 60 um from one end to the other."""
    text = (Path(machines.__file__).parent / "dmu50.toml").read_text()
    (tmp_path / "long.toml").write_text(text.replace("travel = [0, 360]", "travel = [-720, 720]"))
    (tmp_path / "older.json").write_text(OLDER)
    turn = [0.0, 0.1, 45.0, 359.9]
    every = [c + shift for shift in (0.0, 360.0, -720.0) for c in turn]
    (tmp_path / "p.nc").write_text(program("iso", every, "B").replace("B-25.0", "B+25.0"))
    done = command("p.nc", "--machine", "long.toml", "-c", "older.json", *SETUP, "-o", "-")
    assert done.status == 0, done.err
    first, *others = np.split(np.array(words(done.out)), 3)
    np.testing.assert_array_equal(others, [first, first])
    seam, near, away, end = np.split(first, len(turn))
    assert max(apart(seam, end), apart(near, end)) < 0.001
    assert apart(near, away) > 0.004
