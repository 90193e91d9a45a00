"""Strategies and plans: inside travel, as many as are said, the same for a seed, visited as asked; files and programs."""

import io
import re
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import strategies as st
from support.programs import FIVE_AXES, THREE_AXES, correct
from support.tiers import all_pairs, drawn, quick

import machines
from calibration.measurement.measurement import Target
from calibration.measurement.plan import Choices, Plan, Timing
from calibration.measurement.plan_file import read_plan, write_plan
from calibration.planning import patterns
from calibration.planning.strategies import STRATEGIES, evaluation_grid, plan
from kinematics.user_error import UserError
from postproc.generate import MeasuringSequence, ProgramSettings, measuring_program

GANTRY, DMU50 = machines.load("gantry"), machines.load("dmu50")
ENDLESS = {"C": (0.0, 360.0)}
TWO = {"t1": Target((0.0, 0.0, -120.0)), "t2": Target((90.0, 40.0, -180.0))}


def in_units(made: Plan) -> np.ndarray:
    return made.positions / made.machine.scale


def ranges_of(machine) -> dict:
    return ENDLESS if machine.names[0] == "C" and not np.all(np.isfinite(machine.travel)) else {}


# ---- where


ROTARY = ("fixed", "swept", "random", "simultaneous")
COUNTED = [strategy for strategy in STRATEGIES if strategy != "rectangles"]
"""Strategies with a number of points."""
EVERY = list(product([*THREE_AXES, *FIVE_AXES], COUNTED, ROTARY))
"""Machine, strategy, and motion of its rotary axes."""


@pytest.mark.parametrize(
    ("name", "strategy", "rotary"),
    quick(
        EVERY,
        [each for each in EVERY if each[0] == "dmu50" or each[1:] == ("space-diagonals", "swept")],
        all_pairs([*THREE_AXES, *FIVE_AXES], COUNTED, ROTARY),
    ),
)
def test_inside_travel_whole_um_and_as_many_as_said(name, strategy, rotary):
    machine = machines.load(name)
    made = plan(machine, strategy, points=80, choices=Choices(rotary=rotary, ranges=ranges_of(machine), margin_mm=2.5))
    positions = in_units(made)
    linear = ~machine.rotary
    margin = np.where(linear, 2.5, 0.0)
    low, high = machine.travel / machine.scale
    assert np.all(positions >= low + margin - 1e-9)
    assert np.all(positions <= high - margin + 1e-9)
    assert np.abs(positions * 1000 - np.round(positions * 1000)).max() < 1e-6
    assert len(made) == made.position_count == len(made.names)
    assert f"{made.position_count} positions" in made.summary
    assert ("80 were requested" in made.summary) == (made.position_count != 80)
    assert made.minutes == pytest.approx(20 + len(made) / 4)
    moves = np.ptp(positions, axis=0) > 0
    assert moves[linear].all()
    assert np.all(moves[machine.rotary] == (rotary != "fixed"))


@pytest.mark.parametrize("strategy", patterns.SPACED)
@drawn(few=4, many=100, points=st.integers(1, 3000), seed=st.integers(0, 5))
def test_a_spacing_is_found_for_a_number(strategy, points, seed):
    span = np.random.default_rng(seed).uniform(100.0, 5000.0, 3)
    found = patterns.spaced(strategy, patterns.Box(np.zeros(3), span), points)
    least = len(patterns.SPACED[strategy](patterns.Box(np.zeros(3), span), 1e9).positions)
    assert abs(len(found.positions) - points) <= max(least - points, 0.35 * points + 12)
    assert len(np.unique(np.round(found.positions, 6), axis=0)) == len(found.positions)


def test_lines_are_the_named_ones():
    span = np.array([400.0, 300.0, 200.0])
    box = patterns.Box(np.zeros(3), span)
    share = patterns.hexahedron(box, 20.0).positions / span
    on_end = (share == 0) | (share == 1)
    assert np.all(on_end.sum(axis=1) >= 2)
    assert len(share) == 4 * (21 + 16 + 11) - 2 * 8  # a corner lies on three edges
    share = patterns.space_diagonals(box, 50.0).positions / span
    mirrored = np.minimum(share, 1 - share)
    assert np.allclose(mirrored, mirrored[:, :1])
    share = patterns.face_diagonals(box, 50.0).positions / span
    mirrored = np.minimum(share, 1 - share)
    assert np.all(mirrored.min(axis=1) < 1e-12)
    assert patterns.face_diagonals(box, 50.0).line.max() == 12
    flat = patterns.planes(box._replace(share=0.5), 50.0).positions / span
    assert np.all((flat == 0.5).any(axis=1))
    assert len(patterns.grid(box, 100.0).positions) == 5 * 4 * 3


def test_grids_are_walked_without_jumps():
    steps = np.diff(patterns.grid(patterns.Box(np.zeros(3), np.full(3, 300.0)), 100.0).positions, axis=0)
    assert np.allclose(np.linalg.norm(steps, axis=1), 100.0)


def test_spacing_is_the_largest_distance():
    made = plan(GANTRY, "hexahedron", spacing_mm=333.0)
    assert made.position_count == 4 * (17 + 11 + 6) - 16
    assert made.requested is None


def test_sub_volume_and_fixed_axes():
    choices = Choices(ranges={"X": (100.0, 200.0), "Z": (700.0, 700.0)})
    positions = in_units(plan(GANTRY, "hexahedron", points=40, choices=choices))
    assert np.array_equal(np.unique(positions[:, 2]), [700.0])
    assert positions[:, 0].min() == 100.0
    assert positions[:, 0].max() == 200.0
    assert np.ptp(positions[:, 1]) == 3000.0


def test_each_axis_on_its_own():
    made = plan(DMU50, "axes", choices=Choices(rotary="swept", runs=3, overrun=2.0))
    positions = in_units(made)
    for i, name in enumerate(DMU50.names):
        rows = made.axis == name
        others = np.delete(positions[rows], i, axis=1)
        assert np.ptp(others, axis=0).max() == 0
        assert set(made.run[rows]) == {"1", "2", "3"}
        sign = made.state.approach[rows, i]
        count = rows.sum() // 6
        assert np.array_equal(sign, np.tile(np.repeat([1.0, -1.0], count), 3))
        low, high = DMU50.axes[i].travel
        assert (positions[rows, i].min(), positions[rows, i].max()) == (low + 2, high - 2)
    passed = made.before[~np.isnan(made.before[:, 0])]
    assert len(passed) == 2 * 5 * 3


def test_seeds():
    for strategy in ("random", "space-filling"):
        first, again, other = (plan(DMU50, strategy, 50, choices=Choices(seed=s, rotary="random")) for s in (4, 4, 5))
        assert np.array_equal(first.positions, again.positions)
        assert not np.array_equal(first.positions, other.positions)


def test_space_filling_is_more_even_than_random():
    box = np.array([5000.0, 3000.0, 1500.0])
    empty = {}
    for strategy in ("random", "space-filling"):
        share = in_units(plan(GANTRY, strategy, 600)) / box
        counts = np.histogramdd(share, bins=4, range=[(0, 1)] * 3)[0]
        empty[strategy] = counts.std()
    assert empty["space-filling"] < 0.6 * empty["random"]


def test_joined_strategies_have_their_own_numbers():
    made = plan(GANTRY, "hexahedron+random", (170, 150))
    assert made.requested == 320
    assert sum(name.startswith("R") for name in made.names) == 150
    assert plan(GANTRY, "grid+random+random", 301).position_count >= 290


def test_evaluation_grid():
    grid = evaluation_grid(DMU50, 3)
    assert grid.shape == (27, 5)
    assert len(np.unique(grid, axis=0)) == 27
    assert np.array_equal(grid[:, 2:].max(axis=0), DMU50.travel[1, 2:])
    assert not grid[:, :2].any()


# ---- in which order


def test_orders_are_of_the_same_positions():
    given_order = plan(GANTRY, "planes", 100)
    shuffled = plan(GANTRY, "planes", 100, choices=Choices(order="shuffled", seed=7))
    n = len(given_order)

    def rows(positions):
        return sorted(map(tuple, positions.tolist()))

    assert rows(shuffled.positions) == rows(given_order.positions)
    assert not np.array_equal(shuffled.positions, given_order.positions)
    assert np.array_equal(
        shuffled.positions, plan(GANTRY, "planes", 100, choices=Choices(order="shuffled", seed=7)).positions
    )
    there_and_back = plan(GANTRY, "planes", 100, choices=Choices(order="retraced"))
    assert len(there_and_back) == 2 * n - 1
    assert np.array_equal(there_and_back.positions, there_and_back.positions[::-1])
    assert np.array_equal(there_and_back.positions[:n], given_order.positions)
    assert there_and_back.position_count == n


@pytest.mark.parametrize("target_order", ["in-turn", "alternating"])
def test_targets_and_runs(target_order):
    made = plan(GANTRY, "random", 10, choices=Choices(targets=TWO, target_order=target_order, runs=3))
    assert len(made) == 60
    seen = {tuple(row) for row in zip(made.names, made.run, made.state.target, strict=True)}
    assert len(seen) == 60
    changes = np.count_nonzero(made.state.target[1:] != made.state.target[:-1])
    assert changes == (1 if target_order == "in-turn" else 59)


def test_references():
    made = plan(GANTRY, "random", 20, choices=Choices(references=8))
    at = np.flatnonzero(np.char.startswith(made.names, "REF"))
    assert at.tolist() == [0, 9, 18, 23]
    assert len(np.unique(made.positions[at], axis=0)) == 1


@pytest.mark.parametrize(("approach", "sign"), [("positive", 1.0), ("negative", -1.0)])
def test_from_one_side(approach, sign):
    made = plan(GANTRY, "planes", 60, choices=Choices(approach=approach, order="shuffled", overrun=3.0))
    assert np.all(made.state.approach == sign)
    assert np.allclose(made.positions - made.before, 3.0 * sign)
    assert np.all(made.before >= GANTRY.travel[0])
    assert np.all(made.before <= GANTRY.travel[1])


@pytest.mark.parametrize("rotary", ["fixed", "swept", "random", "simultaneous"])
@pytest.mark.parametrize("approach", ["positive", "negative"])
def test_the_approach_stays_in_travel_too(rotary, approach):
    choices = Choices(rotary=rotary, approach=approach, overrun=2.0, references=7, targets=TWO)
    made = plan(DMU50, "hexahedron", 40, choices=choices)
    passed = made.before[~np.isnan(made.before[:, 0])]
    assert len(passed) == len(made)
    assert np.all(passed >= DMU50.travel[0] - 1e-12)
    assert np.all(passed <= DMU50.travel[1] + 1e-12)


def test_time():
    slow = plan(GANTRY, "random", 20, choices=Choices(timing=Timing(dwell_s=3.0, feed=1000.0, setup_min=5.0)))
    way = sum(np.linalg.norm(b - a) for a, b in pairwise(slow.positions))
    assert slow.minutes == pytest.approx(5 + (way / 1000 * 60 + 60) / 60)
    assert np.all(np.diff(slow.state.time) > 0)


# ---- what cannot be


@pytest.mark.parametrize(
    ("machine", "strategy", "points", "choices", "words"),
    [
        ("gantry", "spiral", 10, Choices(), "strategy 'spiral' is none of planes, .*axes"),
        ("trunnion_ac", "grid", 10, Choices(rotary="simultaneous"), "axis C has no end of travel: .*--range C=0:360"),
        ("gantry", "grid", 0, Choices(), "expected a number from 1"),
        ("gantry", "grid+random", 1, Choices(), "at least one point for each"),
        ("gantry", "grid+random", (1, 2, 3), Choices(), "1.2.3 points for 2 strategies"),
        ("gantry", "grid", 10, Choices(ranges={"X": (-1.0, 5.0)}), "range X=-1:5 is not inside its travel 0..5000"),
        ("gantry", "grid", 10, Choices(ranges={"Q": (0.0, 5.0)}), "no axis Q"),
        ("gantry", "grid", 10, Choices(margin_mm=800.0), "axis Z: nothing is left"),
        ("gantry", "grid", 10, Choices(margin_mm=-1.0), "margin: -1 is not"),
        ("gantry", "grid", 10, Choices(runs=0), "runs: 0 is not"),
        ("gantry", "grid", 10, Choices(planes_at=2.0), "between 0 and 1"),
        ("gantry", "planes", 10, Choices(ranges={"X": (5.0, 5.0), "Y": (5.0, 5.0)}), "needs two linear axes"),
        ("gantry", "axes", 10, Choices(order="shuffled"), "one axis at a time"),
        ("gantry", "axes+grid", 10, Choices(), "one axis at a time"),
        ("gantry", "grid", 10, Choices(order="sorted"), "order 'sorted': expected one of given, shuffled, retraced"),
        ("gantry", "grid", 10, Choices(rotary="wild"), "rotary 'wild'"),
        ("gantry", "grid", 10, Choices(targets={}), "no target"),
    ],
)  # fmt: skip
def test_refused(machine, strategy, points, choices, words):
    with pytest.raises(UserError, match=words):
        plan(machines.load(machine), strategy, points, choices=choices)


def test_spacings_refused():
    with pytest.raises(UserError, match="not both"):
        plan(GANTRY, "grid", 10, 100.0)
    for spacing in (0.0, -5.0, float("nan")):
        with pytest.raises(UserError, match="must be positive"):
            plan(GANTRY, "grid", spacing_mm=spacing)
    for strategy in ("grid", "hexahedron"):
        with pytest.raises(UserError, match="more than the limit of 5000000"):
            plan(GANTRY, strategy, spacing_mm=1e-3)


# ---- files and programs


@pytest.mark.parametrize(
    "choices",
    [
        Choices(),
        Choices(targets=TWO, target_order="alternating", order="retraced", runs=2),
        Choices(approach="positive", rotary="simultaneous", references=5),
    ],
)
@pytest.mark.parametrize("strategy", ["hexahedron", "random", "axes"])
def test_plans_are_read_as_they_were_written(tmp_path, strategy, choices):
    if strategy == "axes":
        choices = Choices(targets=choices.targets, runs=choices.runs, rotary=choices.rotary)
    made = plan(DMU50, strategy, 30, choices=choices)
    file = io.BytesIO()
    write_plan(made, file)
    path = tmp_path / "plan.csv"
    path.write_bytes(file.getvalue())
    read = read_plan(path, DMU50)
    assert read.positions == pytest.approx(made.positions, abs=1e-12)
    assert np.array_equal(read.state.approach, made.state.approach)
    assert read.targets == made.targets
    for column in ("names", "run", "axis"):
        assert np.array_equal(getattr(read, column), getattr(made, column)), column
    assert np.array_equal(read.state.target, made.state.target)
    assert read.state.time == pytest.approx(made.state.time, abs=0.05)


def program_of(made: Plan, manner: ProgramSettings, dialect: str) -> str:
    before = None if made.before is None else made.before / made.machine.scale
    visits = MeasuringSequence(made.machine, in_units(made), before, made.names.tolist(), made.state.target.tolist())
    return "\n".join(measuring_program(visits, manner, dialect, "test")) + "\n"


CHOICES = Choices(targets=TWO, approach="positive", rotary="swept")
OFFSET = ("G54", {"X": 10.0, "Z": -5.0})


@pytest.mark.parametrize("name", ["gantry", "cframe", "dmu50", "head_table"])
@pytest.mark.parametrize(
    ("manner", "dialect"),
    [
        (ProgramSettings(), "iso"),
        (ProgramSettings(rapid=True), "iso"),
        (ProgramSettings(offset=OFFSET), "iso"),
        (ProgramSettings(offset=OFFSET), "fanuc"),
    ],
)
def test_ncomp_reads_its_own_programs(name, manner, dialect):
    machine = machines.load(name)
    choices = Choices(targets=TWO, approach="positive", rotary="swept", ranges=ranges_of(machine))
    text = program_of(plan(machine, "hexahedron", 40, choices=choices), manner, dialect)
    offsets = ["G54=10,0,-5"] if manner.offset else []
    result = correct(text, machine, offsets=offsets)
    assert result.text == text
    # the direction of a large turn is not that of the program, but of the control
    assert [note for note in result.report.notes if "its direction depends on the control" not in note] == []
    assert result.report.moves == len(re.findall(r"^(?:G53 )?G[01] ", text, re.MULTILINE))
    assert ("G0 " in text) == manner.rapid
    assert text.count("\nM0\n") == 2
    assert text.endswith("M30\n%\n")


def test_a_move_and_a_dwell_for_each_point():
    made = plan(GANTRY, "random", 5, choices=Choices(targets=TWO, target_order="alternating"))
    text = program_of(made, ProgramSettings(target_change="M1", dwell_s=2.5, feed=750.0), "iso")
    assert text.count("G4 P2.5\n") == 10
    assert text.count("G53 G1 ") == 5  # the second target is at the same place
    assert text.count("\nM1\n") == 9
    x, y, z = in_units(made)[0]
    assert f"G53 G1 X{x:.4f} Y{y:.4f} Z{z:.4f} F750.0 (R1)\n" in text
    assert "POSITIONS ARE MACHINE COORDINATES" in text


def test_work_offset_is_taken_off():
    made = plan(GANTRY, "random", 3)
    text = program_of(made, ProgramSettings(offset=("G55", {"Y": 100.0})), "iso")
    x, y, z = in_units(made)[0]
    assert f"\nG1 X{x:.4f} Y{y - 100:.4f} Z{z:.4f} F2000.0 (R1)\n" in text
    assert "\nG55\n" in text
    assert "COUNT FROM G55, WHICH MUST BE Y100" in text


def test_programs_that_can_not_be():
    made = plan(GANTRY, "random", 3)
    with pytest.raises(UserError, match="G53 of this control always moves in rapid"):
        program_of(made, ProgramSettings(), "fanuc")
    with pytest.raises(UserError, match="presets by number"):
        program_of(made, ProgramSettings(offset=OFFSET), "heidenhain")
    with pytest.raises(UserError, match="G54 to G57 and G505 to G599"):
        program_of(made, ProgramSettings(offset=("G58", {})), "siemens")
    with pytest.raises(UserError, match="work offsets by G code"):
        program_of(made, ProgramSettings(offset=("1", {})), "iso")
    with pytest.raises(UserError, match="expected one of iso"):
        program_of(made, ProgramSettings(), "okuma")
    toml = Path(machines.__file__).with_name("gantry.toml").read_text()
    twin = machines.parse(
        toml.replace("X Y Z", "X2 Y Z").replace("axes.X", "axes.X2").replace("{ X =", "{ X2 ="), "twin"
    )
    with pytest.raises(UserError, match="the machine has the axis X2"):
        program_of(plan(twin, "random", 3), ProgramSettings(), "iso")


@pytest.mark.parametrize("name", ["gantry", "cframe"])
def test_linuxcnc_goes_where_the_plan_says(linuxcnc, name):
    made = plan(machines.load(name), "hexahedron", 60, choices=Choices(targets=TWO, order="shuffled"))
    for manner in (ProgramSettings(), ProgramSettings(offset=OFFSET)):
        result = linuxcnc.run(program_of(made, manner, "iso"), work_offsets={"G54": (10.0, 0.0, -5.0)})
        assert (result.exit_status, result.message) == (0, "")
        position_count = np.array([move.machine[:3] for move in result.moves])
        order = [made.machine.index(axis) for axis in "XYZ"]
        assert position_count == pytest.approx(in_units(made)[:, order], abs=1e-4)
        assert {move.kind for move in result.moves} == {"line"}
        assert {move.feed for move in result.moves} == {2000.0}


# ---- command line


def test_command(ncomp):
    arguments = ["plan", "--machine", "bzt_pfu", "--strategy", "hexahedron+random", "--points", "170+150"]
    result = ncomp(*arguments, "-o", "plan.csv", "--nc", "plan.nc", "--dwell", "3", "--feed", "3000")
    assert (result.status, result.out) == (0, b"")
    assert re.search(r"hexahedron\+random: 3\d\d positions \(320 were requested\), \d+ min", result.err)
    assert ncomp("plan.nc", "--machine", "bzt_pfu", "--calibration", "none", "-o", "same.nc").status == 0
    assert Path("same.nc").read_bytes() == Path("plan.nc").read_bytes()
    assert ncomp(*arguments, "-o", "-").out == ncomp(*arguments, "-o", "-", "--seed", "0").out


@pytest.mark.parametrize("strategy", ["axes", "grid"])
def test_rotary_axes_that_stand_still_are_noted(ncomp, strategy):
    arguments = ("plan", "--machine", "dmu50", "--strategy", strategy, "-o", "p.csv")
    assert "the rotary axes do not move: C 0, B 0 deg" in ncomp(*arguments).err
    swept = ncomp(*arguments, "--rotary", "swept", "--range", "C=0:90").err
    assert "do not move" not in swept


def test_klartext_command(ncomp):
    options = ("--rotary", "simultaneous", "--approach", "negative", "--target", "t1=0,0,-120", "--target", "t2=9,4,-8")
    for offset in ((), ("--work-offset", "1=10,20,30")):
        result = ncomp("plan", "--machine", "dmu50", "--strategy", "space-filling", "--points", "40", *options,
                       "-o", "p.csv", "--nc", "plan.h", "--dialect", "heidenhain", *offset)  # fmt: skip
        assert result.status == 0
        again = ncomp("plan.h", "--machine", "dmu50", "--calibration", "none", "-o", "same.h", *offset)
        assert again.status == 0, again.err
        assert Path("same.h").read_bytes() == Path("plan.h").read_bytes()
        assert "160 read" in again.err
        assert (" M91" in Path("plan.h").read_text()) == (not offset)


BAD = {
    "unknown strategy": (["--strategy", "spiral"], "strategy 'spiral' is none of"),
    "no such file": (["--strategy", "no.csv"], "--strategy no.csv: there is no such file"),
    "dialect of no program": (["--strategy", "grid", "--dialect", "fanuc"], "--dialect is an option of the NC program: give --nc too"),
    "rapid of no program": (["--strategy", "grid", "--rapid"], "--rapid is an option of the NC program: give --nc too"),
    "points": (["--strategy", "grid", "--points", "many"], "--points many: expected a whole number"),
    "range": (["--strategy", "grid", "--range", "X=a:b"], "--range X=a:b: 'a:b' is not 2 numbers"),
    "range of no axis": (["--strategy", "grid", "--range", "B=0:1"], "has no axis B"),
    "target": (["--strategy", "grid", "--target", "t1"], "--target t1: expected t1=x,y,z"),
    "target twice": (["--strategy", "grid", "--target", "t=0,0,0", "--target", "bed.t=1,2,3"], "each name once"),
    "carrier": (["--strategy", "grid", "--target", "wall.t=0,0,0"], "expected t1=x,y,z, table"),
    "fanuc": (["--strategy", "grid", "--nc", "x.nc", "--dialect", "fanuc"], "G53 of this control always moves in rapid"),
    "one file for both": (["--strategy", "grid", "--nc", "plan.csv"], "--output and --nc both name plan.csv"),
    "offset": (["--strategy", "grid", "--nc", "x.nc", "--work-offset", "G54=1,b"], "'b' is no number"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_options(ncomp, name):
    options, words = BAD[name]
    before = sorted(Path().iterdir())
    result = ncomp("plan", "--machine", "gantry", *options, "-o", "plan.csv")
    assert result.status == 2
    assert re.fullmatch(r"ncomp: .*\n", result.err)
    assert words in result.err
    assert sorted(Path().iterdir()) == before


def of_family(family):
    text = (Path(machines.__file__).parent / "gantry.toml").read_text()
    Path("mill.toml").write_text(f'{text}\n[control]\nfamily = "{family}"\n')


@pytest.mark.parametrize(("family", "dialect", "dwell", "frame"), [
    ("fanuc", None, "G4 X3.0", False), ("fanuc", "fanuc", "G4 X3.0", False), ("linuxcnc", None, "G4 P3.0", True),
    ("linuxcnc", "linuxcnc", "G4 P3.0", True), ("linuxcnc", "iso", "G4 P3.0", True), ("any", None, "G4 P3.0", True),
])  # fmt: skip
def test_the_program_is_for_the_control_of_the_machine_file(ncomp, family, dialect, dwell, frame):
    of_family(family)
    options = ["--strategy", "grid", "--points", "8", "-o", "plan.csv", "--nc", "plan.nc"]
    options += [] if dialect is None else ["--dialect", dialect]
    plain = ncomp("plan", "--machine", "mill.toml", *options)
    if family == "fanuc":  # its G53 moves in rapid, and the head of the program promises straight lines
        assert plain.status == 2
        assert "G53 of this control always moves in rapid" in plain.err
        plain = ncomp("plan", "--machine", "mill.toml", *options, "--work-offset", "G54=0,0,0")
    assert plain.status == 0, plain.err
    text = Path("plan.nc").read_text()
    assert dwell in text
    assert ("G53 G1" in text) == frame


@pytest.mark.parametrize(("family", "dialect"), [("fanuc", "iso"), ("fanuc", "linuxcnc"), ("linuxcnc", "fanuc")])
def test_a_dialect_of_another_control_is_refused(ncomp, family, dialect):
    of_family(family)
    options = ["--strategy", "grid", "--points", "8", "-o", "plan.csv", "--nc", "plan.nc", "--work-offset", "G54=0,0,0"]
    result = ncomp("plan", "--machine", "mill.toml", *options, "--dialect", dialect)
    assert result.status == 2
    assert f"--dialect {dialect}: the machine file states family = {family} under [control]" in result.err
    assert not Path("plan.nc").exists()
