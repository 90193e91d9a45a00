"""Errors along straight moves that follow from those at both ends: the same as those of the exact model."""

import dataclasses
from itertools import product

import numpy as np
import pytest
from hypothesis import strategies as st
from support.backlash_paths import played
from support.program_runs import corrected, job_of, programs
from support.programs import FIVE_AXES, correct, load, random_model, read, source_of
from support.tiers import drawn, quick

import ncomp
from kinematics.columns import ChainColumns, length, minus, vector
from kinematics.error_model.model import no_errors
from kinematics.inverse import linear_positions
from kinematics.second_differences import nominal_bends
from postproc.verification import verify as verification
from postproc.verification.in_step import in_step
from postproc.verification.verify import Verifier, read_motions, verify

TOOL = (10.0, -5.0, -80.0)
ROUNDING = 1e-11
EVEN_UM = verification.EVEN * 1e3


def points(machine, q):
    return ChainColumns(machine, q).point(vector(TOOL))


def bend(first, middle, last):
    return length(tuple(a - 2.0 * b + c for a, b, c in zip(first, middle, last, strict=True)))


@drawn(
    few=20,
    many=400,
    seed=st.integers(0, 2**32 - 1),
    machine=st.sampled_from([load(name) for name in ("gantry", *FIVE_AXES)]),
    rotary_shifts=st.booleans(),
)
def test_nominal_second_differences_are_never_above_their_bounds(seed, machine, rotary_shifts):
    rng = np.random.default_rng(seed)
    low, high = np.clip(machine.travel / machine.scale, -400.0, 400.0) * machine.scale
    n, axes = 200, len(machine.axes)
    start, size = rng.uniform(low, high, (n, axes)), 10.0 ** rng.uniform(-4.0, 0.0, (n, 1))
    end = start + size * (rng.random((n, axes)) < 0.7) * (rng.uniform(low, high, (n, axes)) - start)
    shifts = rng.normal(0.0, 10.0 ** rng.uniform(-3.0, 0.0), (2, n, axes)) * machine.scale
    shifts[:, :, machine.rotary] *= rotary_shifts
    shifts[1] = np.where(rng.random((n, 1)) < 0.3, shifts[0], shifts[1])
    shares = [(1.0 - share) * start + share * end for share in (0.0, 0.5, 1.0)]
    moved = [(1.0 - share) * shifts[0] + share * shifts[1] for share in (0.0, 0.5, 1.0)]
    there = [points(machine, q) for q in shares]
    apart = [minus(points(machine, q + by), p) for q, by, p in zip(shares, moved, there, strict=True)]
    path, between = nominal_bends(machine, start, end, np.tile(TOOL, (n, 1)), np.zeros(n, bool), *shifts)
    assert (bend(*there) <= path + ROUNDING).all()
    assert (bend(*apart) <= between + ROUNDING).all()


@pytest.mark.parametrize(
    ("axis", "way", "shift"),
    [("C", 10.0, {"X": (0.5, 0.5)}), ("C", 10.0, {"X": (0.5, -0.5)}), ("Y", 100.0, {"C": (0.01, -0.01)})],
    ids=["turned", "turned while it changes", "rotary shift"],
)
def test_a_third_of_the_bound_would_be_too_little(axis, way, shift):
    machine = load("dmu50")
    start, first, last = (np.zeros((1, len(machine.axes))) for _ in range(3))
    end = start.copy()
    end[0, machine.index(axis)] = way * machine.scale[machine.index(axis)]
    for name, (begin, finish) in shift.items():
        i = machine.index(name)
        first[0, i], last[0, i] = begin * machine.scale[i], finish * machine.scale[i]
    apart = [
        minus(points(machine, q + by), points(machine, q))
        for q, by in ((start, first), ((start + end) / 2.0, (first + last) / 2.0), (end, last))
    ]
    _, bound = nominal_bends(machine, start, end, np.array([TOOL]), np.zeros(1, bool), first, last)
    assert bend(*apart) > bound / 3.0


def test_under_tcp_the_nominal_paths_are_straight():
    machine, rng = load("dmu50"), np.random.default_rng(1)
    q = rng.uniform(*np.clip(machine.travel / machine.scale, -300.0, 300.0), (2, 50, 5)) * machine.scale
    shifts = rng.normal(0.0, 1e-3, (2, 50, 5))
    path, between = nominal_bends(machine, *q, np.tile(TOOL, (50, 1)), np.ones(50, bool), *shifts)
    assert not path.any()
    assert not between.any()
    middle = (q[0] + q[1]) / 2.0
    ends = [np.array(points(machine, each)).T for each in q]
    placed = linear_positions(machine, middle, (ends[0] + ends[1]) / 2.0, TOOL)
    assert bend(points(machine, q[0]), points(machine, placed), points(machine, q[1])).max() < 1e-9


def exactly(*arguments, **options):
    """The verdict with all points evaluated by the exact model."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(verification, "EVEN", -1.0)
        return verify(*arguments, **options)


def close(verdict, exact):
    """Errors agree to the stated bound, counts are equal."""
    for name in ("before", "after", "path_before", "path_after"):
        pairs = [(getattr(each, name), getattr(each.absolute, name)) for each in (verdict, exact)]
        for ours, theirs in zip(*pairs, strict=True):
            assert ours.count == theirs.count, name
            assert (ours.largest, ours.rms) == pytest.approx((theirs.largest, theirs.rms), abs=EVEN_UM), name
    for ours, theirs in zip(verdict.best_fit, exact.best_fit, strict=True):
        assert ours.json()["rms"] == pytest.approx(theirs.json()["rms"], abs=EVEN_UM + 1e-3 * theirs.json()["rms"])


@drawn(4, 60, 200, program=programs(), seed=st.integers(0, 99))
def test_programs_are_verified_as_by_the_exact_model(program, seed):
    job = job_of(program, seed, tolerance_um=0.5)
    done = corrected(job).get("text")
    if done is None:
        return
    texts = [read_motions(s, job.dialect, job.machine, job.setup) for s in (job.source, source_of(done))]
    verifiers = [Verifier(job.machine, job.model, job.conditions, 0.5) for _ in range(2)]
    for moves in in_step(*texts):
        verifiers[0].add(moves)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(verification, "EVEN", -1.0)
            verifiers[1].add(moves)
    close(*(verifier.verdict() for verifier in verifiers))


FINE = "".join(
    f"G1 X{60 * np.cos(t):.4f} Y{60 * np.sin(1.1 * t):.4f} Z{200 + 20 * np.sin(t):.4f} B{10 * np.sin(t):.4f} C{c:.4f}\n"
    for t, c in ((i * step, 40.0 * i * step) for step in (0.0001, 0.0002, 0.0004, 0.6) for i in range(60))
)
FRAMES = "G1 X30. Y30. F500\nX30.2\nX30.4\nG55\nX30.6\nX30.8\nG54\nG0 X20. Y30. Z200. B0 C0\nG1 X20.2\nG2 X20.4 I0.1\nG1 X20.6\n"
HEADS = {
    "axes": "",
    "tcp": "G43.4 H1\n",
    "inch": "G20\nG1 X1. Y1. Z8.\nX1.01\nX1.02\nG21\n",
}


CLASSES = {"tool point": None, "orientation": frozenset({"L-VOL+", "R-VOL+"})}
RUNS = list(product(HEADS, CLASSES, ["true", "probed"]))


@pytest.mark.parametrize(
    ("head", "classes", "datum"),
    quick(RUNS, [("axes", "tool point", "true"), ("tcp", "orientation", "probed"), ("inch", "tool point", "probed")]),
)
def test_points_of_fine_moves_follow_from_the_ends(head, classes, datum, monkeypatch):
    machine = load("dmu50")
    model, count = random_model(machine, 4), [0]
    text = f"G21 G90 G17 G54 G94\nT1 M6\nG0 X60 Y0 Z200 B0 C0\n{HEADS[head]}{FINE}{FRAMES}"
    options = {"offsets": ["G55=10,0,0"], "tools": ["T1=80"], "datums": [f"G54={datum}", "G55=true"]}
    done = correct(text, machine, model, **options, travel_check=False, classes=CLASSES[classes]).text
    nominal, commanded = (read(each, machine, options["offsets"], options["tools"]) for each in (text, done))
    evaluate = Verifier._vectors

    def counted(verifier, moves, share, rows):
        count[0] += len(rows)
        return evaluate(verifier, moves, share, rows)

    monkeypatch.setattr(Verifier, "_vectors", counted)
    by_ends = verify(nominal, commanded, model)
    few, count[0] = count[0], 0
    close(by_ends, exactly(nominal, commanded, model))
    assert few < 0.75 * count[0]


def test_with_backlash_every_point_is_evaluated(monkeypatch):
    machine = load("dmu50")
    model = played(machine, X=20.0)
    text = f"G21 G90 G17 G54 G94\nT1 M6\nG0 X60 Y0 Z200 B0 C0\n{FINE}"
    motions = read(text, machine, (), ["T1=80"])
    close(verify(motions, motions, model), exactly(motions, motions, model))
    monkeypatch.setattr(Verifier, "_straight", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        verify(motions, motions, no_errors(machine), ncomp.conditions())


def test_a_row_behind_another_frame_is_evaluated():
    """The same programmed position is another one of the machine."""
    machine, model = load("gantry"), random_model(load("gantry"), 3)
    text = "G21 G90 G17 G54 G94\nG0 X500. Y500. Z200.\nG1 X500.1 F500\nX500.2\nG55\nX500.3\nX500.4\n"
    motions = read(text, machine, ["G54=0,0,0", "G55=80,30,0"])
    other = dataclasses.replace(motions, frames=[motions.frames[0]] * len(motions.frames))
    for commanded in (motions, other):
        close(verify(motions, commanded, model), exactly(motions, commanded, model))
