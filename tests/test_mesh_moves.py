"""Firmware follows a mesh at the ends of moves and of their parts: the departure that an export states."""

import re

import numpy as np
import pytest
from support.programs import load, model_of
from support.tiers import quick

import ncomp
from kinematics.basis import Legendre
from kinematics.effects import ErrorMotion, LocationError
from postproc.control_data.sheet import sheet
from postproc.control_data.tables.mesh_moves import (
    DEFAULT,
    KLIPPER_FINEST,
    Segments,
    Splitting,
    departure,
    largest_departure,
)
from postproc.control_data.tables.terms import Surface


def bowed(size):
    """A machine whose Z bows over the bed by some `size` um along X and Y."""
    machine = load("bzt_pfu")
    errors = [
        ErrorMotion("Z", axis, Legendre(machine.axes[machine.index(axis)].travel, 2), (0.0, 0.0, size), u=(0.0,) * 3)
        for axis in "XY"
    ]
    return machine, model_of(machine, *errors)


def mesh_of(exported):
    return next(term.factors[0] for term in exported.content.terms if isinstance(term.factors[0], Surface))


def test_a_move_that_is_not_split():
    """A bow of 20 um never changes by 25 um: the move is a chord. With 10 um it is split where the mesh says."""
    nodes = np.linspace(0.0, 100.0, 21)
    bow = 0.02 * (1.0 - ((nodes - 50.0) / 50.0) ** 2)
    mesh = Surface(("X", "Y"), (nodes, np.array([0.0, 100.0])), np.stack([bow, bow], axis=1))
    along_x = np.array([0.0, 50.0]), np.array([100.0, 50.0])
    assert departure(mesh, *along_x, DEFAULT) == pytest.approx(0.02, abs=5e-5)
    # looked at every 5 mm, the bow has changed by 10 um at 15 mm, and nowhere again by 10 um from there
    chords = np.interp(nodes, [0.0, 15.0, 100.0], [0.0, bow[3], 0.0])
    assert departure(mesh, *along_x, Splitting(0.01, 5.0)) == pytest.approx(np.abs(bow - chords).max(), abs=5e-5)
    assert departure(mesh, np.array([50.0, 0.0]), np.array([50.0, 100.0]), DEFAULT) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.statistical
def test_the_sheet_states_the_settings_and_the_limit():
    machine, model = bowed(30.0)
    exported = ncomp.export(machine, "klipper", model)
    page = sheet(exported, exported.left, exported.errors_in_the_volume())
    loading = page[page.index("## How to load") : page.index("## How certain")]
    assert "split_delta_z: 0.01" in loading
    assert "move_check_distance: 3" in loading
    stated = [float(um) for um in re.findall(r"up to ([\d.]+) um", loading)]
    assert stated == pytest.approx(
        [1e3 * largest_departure(mesh_of(exported), each) for each in (DEFAULT, KLIPPER_FINEST)], abs=0.06
    )
    assert stated[0] > stated[1] > 3.0
    square = model_of(machine, LocationError("C", "Y", 40.0))
    assert "Between the ends" not in ncomp.export(machine, "klipper", square).loading


def test_the_sheet_of_reprap_states_the_limit():
    machine, model = bowed(30.0)
    reprap = ncomp.export(machine, "reprap", model)
    assert "split_delta_z" not in reprap.loading
    stated = float(re.search(r"up to ([\d.]+) um", reprap.loading)[1])
    assert stated == pytest.approx(1e3 * largest_departure(mesh_of(reprap), Segments()), abs=0.06)
    assert stated > 0.1


def test_equal_parts_of_about_one_mesh():
    """Nodes every 10 mm: a move of 35 mm has 3 parts, one of 36 mm has 4, and one of 4 mm has 1."""
    nodes = np.linspace(0.0, 100.0, 11)
    mesh = Surface(("X", "Y"), (nodes, nodes), np.outer(np.arange(11) % 2, np.ones(11)) * 0.01)
    start = np.array([0.0, 50.0])
    for length, parts in ((35.0, 3), (36.0, 4), (4.0, 1), (5.9, 1), (100.0, 10)):
        ends = Segments().ends(mesh, start, np.array([length, 50.0]))
        assert ends == pytest.approx(np.linspace(0.0, length, parts + 1))
    assert departure(mesh, start, np.array([100.0, 50.0]), Segments()) == pytest.approx(0.0, abs=1e-12)
    assert departure(mesh, start, np.array([14.0, 50.0]), Segments()) > 5e-3


@pytest.mark.parametrize("number", quick([100, 300], [], [100]))
def test_klippers_own_code_departs_as_stated(klipper, number):
    machine, model = bowed(30.0)
    exported = ncomp.export(machine, "klipper", model)
    mesh = mesh_of(exported)
    text = exported.files["ncomp.cfg"]
    rows = [[float(v) for v in row.split(",")] for row in re.findall(r"^  (.*)$", text, re.M)]
    given = {name: float(value) for name, value in re.findall(r"^(\w+) = ([-\d.]+)$", text, re.M)}
    rng = np.random.default_rng(3)
    low, high = (np.array([given[f"{end}_{axis}"] for axis in "xy"]) for end in ("min", "max"))
    moves = rng.uniform(low, high, (number, 2, 2))
    for splitting in (DEFAULT, KLIPPER_FINEST):
        settings = {name: getattr(splitting, name) for name in ("split_delta_z", "move_check_distance")}
        found, own = [], []
        for (start, end), move in zip(moves, klipper.split(given, rows, settings, moves.tolist(), 400), strict=True):
            nodes = np.array(move["nodes"])
            along = np.linalg.norm(nodes[:, :2] - start, axis=1)
            at = np.linspace(0.0, np.linalg.norm(end - start), 400)
            found.append(np.abs(np.interp(at, along, nodes[:, 2]) - move["heights"]).max())
            own.append(departure(mesh, start, end, splitting))
        assert own == pytest.approx(found, abs=1e-4)
        assert max(found) <= 1.05 * largest_departure(mesh, splitting)
