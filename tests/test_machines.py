"""Shipped machines, machine files and what is refused in them."""

import dataclasses
import itertools
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from support import robot

import machines
from kinematics.forward import forward
from kinematics.machine import Control, Machine
from kinematics.user_error import UserError

INF = math.inf
# chain, then travels in chain order
SHIPPED = {
    "bzt_pfu": ("w b Y X Z t", [(0, 1500), (0, 1800), (0, 400)]),
    "cframe": ("w X Y b Z t", [(0, 600), (0, 450), (0, 500)]),
    "dmu50": ("w C B b X Y Z t", [(0, 360), (0, 180), (-250, 250), (-225, 225), (0, 400)]),
    "gantry": ("w b X Y Z t", [(0, 5000), (0, 3000), (0, 1500)]),
    "head_head": ("w b X Y Z C B t", [(0, 4000), (0, 2500), (0, 1000), (-360, 360), (-110, 110)]),
    "head_table": ("w C b X Y Z B t", [(-INF, INF), (-500, 500), (-400, 400), (0, 700), (-110, 110)]),
    "trunnion_ac": ("w C A b X Y Z t", [(-INF, INF), (-120, 30), (-250, 250), (-225, 225), (0, 400)]),
    "trunnion_bc": ("w C B b X Y Z t", [(-INF, INF), (-110, 110), (-250, 250), (-225, 225), (0, 400)]),
}
ROTARY_ORDER = {"head_head": "LLLRR", "head_table": "RLLLR", "trunnion_ac": "RRLLL", "trunnion_bc": "RRLLL"}
LETTERS = {"X": (1, 0, 0), "Y": (0, 1, 0), "Z": (0, 0, 1), "A": (1, 0, 0), "B": (0, 1, 0), "C": (0, 0, 1)}


def test_all_are_listed():
    assert machines.names() == sorted(SHIPPED)


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_machine(name):
    machine, (chain, travels) = machines.load(name), SHIPPED[name]
    assert (machine.name, machine.chain) == (name, chain)
    assert [axis.travel for axis in machine.axes] == travels
    assert machine.travel == pytest.approx(np.array(travels).T * machine.scale)
    assert machine.description
    assert "".join("R" if axis.rotary else "L" for axis in machine.axes) == ROTARY_ORDER.get(
        name, "RRLLL" if name == "dmu50" else "LLL"
    )
    for axis in machine.axes:
        assert axis.travel[0] <= axis.home <= axis.travel[1]
        assert math.isfinite(axis.home)
        assert axis.unit == ("deg" if axis.name in "ABC" else "mm")
        if (name, axis.name) != ("dmu50", "B"):
            assert tuple(axis.direction) == LETTERS[axis.name]
            assert (axis.error_frame == np.eye(3)).all()
    assert [machine.names[i] for i in machine.translators] == [n for n in machine.names if n in "XYZ"]
    assert forward(machine, np.zeros(len(machine.axes))).translation == pytest.approx(np.zeros((1, 3)), abs=1e-13)


def test_dmu50_as_the_issue_gives_it():
    """B through (0, 0, 154.996) about (0, 1, -1)/sqrt 2, C through it about z, tool relative to workpiece."""
    machine = machines.load("dmu50")
    b, c = machine.axes[machine.index("B")], machine.axes[machine.index("C")]
    assert (b.side, c.side) == ("workpiece", "workpiece")
    assert b.point == c.point == (0, 0, 154.996)
    assert b.unit_direction == pytest.approx([0, 0.5**0.5, -(0.5**0.5)])
    assert c.direction == (0, 0, 1)
    frame = b.error_frame
    assert frame == pytest.approx(np.array([[1, 0, 0], [0, 0.5**0.5, 0.5**0.5], [0, -(0.5**0.5), 0.5**0.5]]))
    assert frame @ frame.T == pytest.approx(np.eye(3))
    turned = forward(machine, [0, math.pi, 0, 0, 0])
    assert turned.rotation[0, :, 2] == pytest.approx([0, -1, 0], abs=1e-15)  # B 180 lays the tool into the table plane
    assert turned.apply([0, 0, 154.996])[0] == pytest.approx([0, 0, 154.996])


@pytest.mark.parametrize("name", SHIPPED)
def test_each_axis_moves_the_tool_relative_to_the_workpiece_as_its_letter_says(name):
    machine = machines.load(name)
    for i, axis in enumerate(machine.axes):
        q = np.zeros(len(machine.axes))
        q[i] = 0.1
        pose = forward(machine, q)
        if axis.rotary:
            skew = (pose.rotation[0] - pose.rotation[0].T) / (2 * math.sin(0.1))
            assert [skew[2, 1], skew[0, 2], skew[1, 0]] == pytest.approx(axis.unit_direction)
        else:
            assert pose.translation[0] == pytest.approx(0.1 * np.array(LETTERS[axis.name]))


# --- machine files

GOOD = """
name = "mill"
chain = "w C b X Y Z t"
description = "made up"

[axes.C]
travel = [-180, 180]
point = [1, 2, 3]
[axes.X]
travel = [0, 100]
resolution = 0.001
[axes.Y]
travel = [-100, -50]
[axes.Z]
travel = [0, 200]
home = 200
direction = [0, 0, 2]

[work_offsets.G54]
X = -10
C = 90.5
[tools]
1 = 80
"""


def test_a_machine_file(tmp_path):
    file = tmp_path / "mill.toml"
    file.write_text(GOOD)
    machine = machines.load(str(file))
    c, x, y, z = machine.axes
    assert (machine.chain, machine.description) == ("w C b X Y Z t", "made up")
    assert (c.kind, c.side, c.point, c.home) == ("rotary", "workpiece", (1, 2, 3), 0)
    assert (x.kind, x.side, x.point, x.home, x.resolution) == ("linear", "tool", (0, 0, 0), 0, 0.001)
    assert (y.home, z.home, z.direction, y.resolution) == (-50, 200, (0, 0, 2), 1e-4)
    assert z.unit_direction.tolist() == [0, 0, 1]
    assert machine.work_offsets == {"G54": {"X": -10, "C": 90.5}}
    assert machine.tools == {"1": 80}
    assert machine.control == Control()
    assert machine.scale.tolist() == [math.pi / 180, 1, 1, 1]
    assert machines.default_calibration(machine) is None
    upper = file.rename(tmp_path / "MILL.TOML")
    assert machines.load(str(upper)) == machine


def test_control_entries():
    text = '[control]\ninteger_words = "increments"\nincrement = 0.01\narc_centres = "absolute"\n'
    machine = machines.parse(GOOD + text + 'tool_change_moves = ["Z", "X"]\ntcp_at_start = true', "mill.toml")
    assert machine.control == Control("increments", 0.01, "absolute", ("Z", "X"), True)


CONTROL_VALUES = {"integer_words": "increments", "increment": 0.01, "arc_centres": "absolute", "family": "linuxcnc",
                  "tool_change_moves": ["X"], "passive_axes": ["E"], "random_toolchanger": True, "block_skip": "on", "tcp_at_start": True, "calls_leave_state": True,
                  "klartext_arcs": "plane", "rotary_feed": "scaled", "scaled_axes": "XY", "repeats": "round", "pass_through": ["G234"], "unit": "inch", "start": "X0,Y5",
                  "probing": "beside", "kinematics_types": ["axes"], "g53_tool_length": "suppressed"}  # fmt: skip


@pytest.mark.parametrize("field", dataclasses.fields(Control), ids=lambda field: field.name)
def test_every_control_setting_can_be_written_in_the_machine_file(field):
    value = CONTROL_VALUES[field.name]
    control = machines.parse(f"{GOOD}[control]\n{field.name} = {json.dumps(value)}\n", "mill.toml").control
    assert control == Control(**{field.name: tuple(value) if isinstance(value, list) else value})
    assert control != Control()


# text replaced in GOOD, its replacement, and how the message goes on after "machine file mill.toml: "
BAD = {
    "no w": ("w C b", "C b", "chain 'C b X Y Z t' is not of the form 'w ... b ... t' (ISO 10791-6)"),
    "no t": ("Z t", "Z", "chain 'w C b X Y Z' is not of the form"),
    "no b": ("C b", "C", "chain 'w C X Y Z t' is not of the form"),
    "two beds": ("C b", "C b b", "chain 'w C b b X Y Z t' is not of the form"),
    "empty chain": ("w C b X Y Z t", "", "chain '' is not of the form"),
    "no axis name": ("w C b", "w Q b", "chain 'w Q b X Y Z t': 'Q' is no axis name (X Y Z U V W A B C, with an"),
    "small letters": ("w C b", "w c b", "chain 'w c b X Y Z t': 'c' is no axis name"),
    "axis twice": ("w C b", "w C C b", "chain 'w C C b X Y Z t': axis C appears twice"),
    "axis on both sides": ("w C b", "w C X b", "chain 'w C X b X Y Z t': axis X appears twice"),
    "axis missing": (
        "w C b",
        "w C B b",
        "chain 'w C B b X Y Z t': its axis B has no table: write [axes.B] with travel",
    ),
    "axis not in the chain": ("w C b", "w b", "axes.C is not in the chain 'w b X Y Z t'"),
    "travel reversed": (
        "[0, 100]",
        "[100, 0]",
        "axis X: travel [100.0, 0.0] must go from a lower to a higher position",
    ),
    "no travel": ("[0, 100]", "[5, 5]", "axis X: travel [5.0, 5.0] must go from a lower to a higher position"),
    "travel not a number": ("[0, 100]", "[nan, 1]", "axis X: travel [nan, 1.0] must go from a lower to a higher"),
    "travel missing": ("travel = [0, 100]", "", "axes.X.travel is missing"),
    "travel too short": ("[0, 100]", "[100]", "axes.X.travel: expected a list of 2 entries, not of 1"),
    "travel a word": ("[0, 100]", '"all"', "axes.X.travel: expected a list in [ ], not a text in quotes"),
    "travel of words": ("[0, 100]", '[0, "end"]', "axes.X.travel[1]: expected a number, not a text in quotes"),
    "axis no table": (
        "[axes.X]\ntravel = [0, 100]\nresolution = 0.001",
        "[axes]\nX = 3",
        "axes.X: expected a table, not a whole number",
    ),
    "unknown axis entry": (
        "home = 200",
        "hone = 200",
        "axes.Z.hone is not known (did you mean 'home'?); known are travel,",
    ),
    "unknown entry": ("description", "remark", "remark is not known; known are name, chain,"),
    "name missing": ('name = "mill"', "", "name is missing"),
    "rotary axis without a point": (
        "point = [1, 2, 3]\n",
        "",
        "axes.C: a rotary axis needs its point = [x, y, z]: a point",
    ),
    "zero direction": ("[0, 0, 2]", "[0, 0, 0]", "axis Z: direction [0.0, 0.0, 0.0] is no direction"),
    "endless direction": ("[0, 0, 2]", "[0, 0, inf]", "axis Z: direction [0.0, 0.0, inf] is no direction"),
    "flat direction": ("[0, 0, 2]", "[0, 1]", "axes.Z.direction: expected a list of 3 entries, not of 2"),
    "endless point": ("[1, 2, 3]", "[1, nan, 3]", "axis C: point [1.0, nan, 3.0] is not finite"),
    "zero resolution": ("0.001", "0", "axis X: resolution 0.0 must be positive"),
    "home outside": ("home = 200", "home = 201", "axis Z: home 201.0 is outside its travel [0.0, 200.0]"),
    "home nowhere": ("[-180, 180]", "[-inf, inf]\nhome = inf", "axis C: home inf is outside its travel [-inf, inf]"),
    "home not a number": ("home = 200", "home = nan", "axis Z: home nan is outside its travel [0.0, 200.0]"),
    "unknown work-offset axis": ("C = 90.5", "B = 90.5", "work_offsets.G54: no axis B in the chain"),
    "work offset a word": ("X = -10", 'X = "-10"', "work_offsets.G54.X: expected a number, not a text in quotes"),
    "endless work offset": ("X = -10", "X = inf", "work_offsets.G54.X: inf is not finite"),
    "tool a word": ("1 = 80", '1 = "long"', "tools.1: expected a number, not a text in quotes"),
    "tool length not a number": ("1 = 80", "1 = nan", "tools.1: nan is not finite"),
    "zero increment": ("[tools]", "[control]\nincrement = 0\n[tools]", "control.increment 0.0 must be positive"),
    "no expected size": ("[tools]", "[priors]\nwalk = 0\n[tools]", "priors.walk 0 must be positive"),
    "unknown kind of machine": (
        "[tools]",
        '[priors]\nkind = "lathe"\n[tools]',
        "priors.kind 'lathe' is not known: write one of machining-centre, gantry, arm, printer, router, mount, stage",
    ),
    "several kinds of machine": (
        "[tools]",
        '[priors]\nkind = ["arm"]\n[tools]',
        "priors.kind: expected a text in quotes, not a list",
    ),
    "unknown prior": (
        "[tools]",
        "[priors]\nrepeatability_um = 5\n[tools]",
        "priors.repeatability_um is not known (did you mean 'non_repeatability_um'?)",
    ),
    "unknown control setting": (
        "[tools]",
        "[control]\ncalls_leave_stat = true\n[tools]",
        "control.calls_leave_stat is not known (did you mean 'calls_leave_state'?); known are integer_words, increment, arc_centres,",
    ),
    "unknown control word": (
        "[tools]",
        '[control]\ninteger_words = "mm"\n[tools]',
        "control.integer_words: expected 'units' or 'increments', not 'mm'",
    ),
    "unknown tool-change axis": (
        "[tools]",
        '[control]\ntool_change_moves = ["Z", "W"]\n[tools]',
        "control.tool_change_moves: no axis W in the chain",
    ),
    "not TOML": (
        "[axes.X]",
        "[axes.X",
        "'[axes.X': column 8: Expected ']' at the end of a table declaration; a table begins",
    ),
    "a program": (GOOD, "%\nO0001\nG1 X10\n", "this is an NC program"),
    "axis table twice": (
        "[axes.Y]",
        "[axes.X]",
        "'[axes.X]': column 8: Cannot declare ('axes', 'X') twice; a table begins",
    ),
}


@pytest.mark.parametrize(("old", "new", "message"), BAD.values(), ids=BAD)
def test_refused_machine_file(old, new, message):
    assert old in GOOD
    with pytest.raises(UserError) as refusal:
        machines.parse(GOOD.replace(old, new), "mill.toml")
    assert re.match(rf"machine file mill\.toml(:\d+)?: {re.escape(message)}", str(refusal.value)), str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_refused_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("latin.toml").write_bytes(b'name = "Fr\xe4se"')
    Path("folder.toml").mkdir()
    for name, message in {
        "latin.toml": "machine file latin.toml: not UTF-8 text",
        "none.toml": "machine file none.toml: No such file or directory",
        "folder.toml": "machine file folder.toml: Is a directory",
        "dmu60": f"unknown machine 'dmu60' (did you mean 'dmu50'?): shipped are {', '.join(sorted(SHIPPED))}; or give the path of a .toml file",
        "DMU50": "unknown machine 'DMU50' (did you mean 'dmu50'?): shipped are bzt_pfu, ",
        "": "unknown machine '': shipped are bzt_pfu, ",
        "../dmu50": "unknown machine '../dmu50' (did you mean 'dmu50'?): shipped are bzt_pfu, ",
    }.items():
        with pytest.raises(UserError) as refusal:
            machines.load(name)
        assert str(refusal.value).startswith(message)


def test_no_such_axis():
    with pytest.raises(UserError) as refusal:
        machines.load("cframe").index("A")
    assert str(refusal.value) == "machine cframe (w X Y b Z t) has no axis A"


# --- what identifies a geometry

SAME = {
    "travel": ("[0, 100]", "[0, 120]"),
    "name": ('"mill"', '"mill 2"'),
    "resolution": ("0.001", "0.01"),
    "home": ("home = 200", "home = 100"),
    "default written out": ("travel = [0, 100]", "travel = [0, 100]\ndirection = [1, 0, 0]\npoint = [0, 0, 0]"),
    "work offset": ("X = -10", "X = -11"),
}
OTHER = {
    "point": ("[1, 2, 3]", "[1, 2, 3.0001]"),
    "direction": ("[0, 0, 2]", "[0, 0.0001, 2]"),
    "sense": ("[0, 0, 2]", "[0, 0, -2]"),
    "side": ("w C b X", "w C X b"),
    "order": ("X Y Z t", "Y X Z t"),
}


def parsed(change: tuple[str, str]) -> Machine:
    assert change[0] in GOOD
    return machines.parse(GOOD.replace(*change), "mill.toml")


def test_chain_hash_changes_with_the_geometry_only():
    machine = machines.parse(GOOD, "mill.toml")
    assert {parsed(change).chain_hash for change in SAME.values()} == {machine.chain_hash}
    others = {parsed(change).chain_hash for change in OTHER.values()}
    assert len(others | {machine.chain_hash}) == len(OTHER) + 1
    assert len({machines.load(name).chain_hash for name in SHIPPED}) == len(SHIPPED)


# --- which linear axes place the tool


def linear_machine(chain: str, **directions: str) -> Machine:
    axes = [name for name in chain.split() if name not in "wbt"]
    extra = {name: f"direction = {directions[name]}" if name in directions else "" for name in axes}
    entries = "".join(f"[axes.{name}]\ntravel = [-500, 500]\npoint = [0, 0, 0]\n{extra[name]}\n" for name in axes)
    return machines.parse(f'name = "test"\nchain = "{chain}"\n[axes]\n{entries}', "test")


@pytest.mark.parametrize("order", list(itertools.permutations("XYZW")))
def test_a_redundant_w_does_not_place_the_tool(order):
    machine = linear_machine("w b " + " ".join(order) + " t")
    assert {machine.names[i] for i in machine.translators} == set("XYZ")
    assert list(machine.translators) == sorted(machine.translators)


@pytest.mark.parametrize(
    ("machine", "chosen"),
    [
        (linear_machine("w C b W X Y t"), "WXY"),
        (linear_machine("w b X Y Z U V t", Z="[1, 1, 0]", V="[0, 0.1, 1]"), "XYV"),
        (linear_machine("w Y b X Z t", Y="[0, 1, -1]"), "YXZ"),
        (linear_machine("w C B b X Y Z t"), "XYZ"),
    ],
)
def test_the_first_independent_axes_place_the_tool(machine, chosen):
    assert "".join(machine.names[i] for i in machine.translators) == chosen


@pytest.mark.parametrize(
    "machine",
    [
        linear_machine("w C b X Y t"),
        linear_machine("w b X Y U V t"),
        linear_machine("w b X Y Z t", Z="[1, 1, 0]"),
        linear_machine("w b t"),
    ],
)
def test_linear_axes_that_do_not_span_space_are_refused(machine):
    with pytest.raises(UserError) as refusal:
        _ = machine.translators
    assert str(refusal.value) == "machine test: its linear axes do not span space, so it cannot position a tool point"


def test_an_arm_of_revolute_axes_is_shown_and_its_programs_are_refused(command, tmp_path):
    (tmp_path / "robot.toml").write_text(robot.toml())
    done = command("machines", "robot.toml")
    assert done.status == 0
    assert b"w b A1 A2 A3 A4 A5 A6 t" in done.out
    (tmp_path / "move.nc").write_text("G90 G1 A1=10 F100\n")
    done = command("move.nc", "--machine", "robot.toml", "--calibration", "none", "--set-up-zero", "-o", "out.nc")
    assert done.status == 2
    assert "has rotary axes only: NC programs need linear axes X, Y and Z" in done.err
    assert "Traceback" not in done.err
    assert not (tmp_path / "out.nc").exists()
