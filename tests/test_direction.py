"""Backlash in NC correction: take-ups and arcs in pieces, against a play that is worked out here by itself."""

import math
import random
import re

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from programs import WHOLE, RandomProgram, correct, load, model_of, random_model, random_setup, read
from test_pipeline import ACCEPTED, machine_for, real_programs, run

from kinematics.effects import Backlash
from kinematics.error_model.model import no_errors
from kinematics.user_error import UserError
from postproc.correct.verify import verify
from postproc.motion.moves import Kind
from postproc.motion.reversals import Directions
from postproc.motion.segments import like
from postproc.text.source import ENCODING

GANTRY, DMU50 = load("gantry"), load("dmu50")
WIDTHS = {"X": 20.0, "Y": 40.0, "Z": -12.0}
seeds = st.integers(0, 2**32 - 1)


def played(machine, **widths):
    """The machine with backlash of so many um."""
    return model_of(machine, *(Backlash(axis, width) for axis, width in widths.items()))


PLAYED = played(GANTRY, **WIDTHS)
HEAD = "G21 G90 G17 F500\nG0 X100 Y100 Z100\nX110 Y110 Z110\n"


def written(text, model=PLAYED, machine=GANTRY, **options):
    """The corrected program behind its mark and head."""
    lines = correct(HEAD + text, machine, model, **options).text.splitlines()
    return lines[4:]


def play(commands, width):
    """Where the axis is `(n,)` that is pushed from either end of a gap of `width`, starting in the middle of it.

    A gap below 0 is one that the commands jump over by themselves: the axis is ahead.
    """
    place, found, low, high = commands[0], [], -abs(width) / 2, abs(width) / 2
    for command in commands:
        place = min(max(place, command + low), command + high)
        found.append(place if width > 0 else 2 * command - place)
    return np.array(found)


def physical(commanded, widths, points=40):
    """Axis positions `(moves, points, axes)`, mm and rad, of the machine with play along the commanded moves."""
    shares = (np.arange(points) + 1) / points
    commands = np.stack([commanded.in_machine(commanded.along(share)) for share in shares], axis=1)
    places = commands.copy()
    for axis, width in widths.items():
        i = commanded.machine.index(axis)
        places[:, :, i] = play(commands[:, :, i].ravel(), width * 1e-3).reshape(commands.shape[:2])
    return shares, places


def largest_error(text, corrected, machine, widths, **setup):
    """Farthest, um, that the machine with play is from the nominal ends, and from the nominal ways of feed moves."""
    nominal, commanded = read(text, machine, **setup), read(corrected, machine, **setup)
    matched = like(nominal, commanded)
    shares, places = physical(commanded, widths)
    # the first two blocks go to a known place, from a known side
    rows = np.arange(len(matched)) >= 2
    ends = np.abs(places[:, -1] - matched.machine_target)[rows & ~matched.inner].max(initial=0.0) * 1e3
    feed = rows & np.isin(matched.kind, (Kind.LINE, Kind.ARC))
    along = [
        np.abs(places[feed, i] - matched.in_machine(matched.along(share))[feed]).max(initial=0.0)
        for i, share in enumerate(shares)
    ]
    return ends, max(along) * 1e3


LETTERS = {"G17": ("X", "Y", "I", "J", "Z"), "G18": ("Z", "X", "K", "I", "Y"), "G19": ("Y", "Z", "J", "K", "X")}


class Path:
    """A random program of moves from where the program has put the axes."""

    def __init__(self, seed):
        self.rng = random.Random(seed)
        self.at = {"X": 110.0, "Y": 110.0, "Z": 110.0}
        self.lines, self.incremental, self.timed, self.codes = [], False, False, ""

    def text(self, blocks):
        steps = [self.line, self.line, self.arc, self.arc, self.radius, self.circle, self.rapid, self.switch]
        for _ in range(blocks):
            self.rng.choice(steps)()
        return HEAD + "\n".join(self.lines) + "\nM30\n"

    def emit(self, code, targets, more=""):
        words = [f"{a}{v - (self.at[a] if self.incremental else 0.0):.4f}" for a, v in targets.items()]
        feed = " F30" if self.timed and code != "G0" else ""
        if "G94" in self.codes:
            feed = " F500"
        self.lines.append(self.codes + " ".join([code, *words]) + more + feed)
        self.codes = ""
        for axis, value in targets.items():
            self.at[axis] = round(value, 4)

    def near(self, axis):
        return round(self.at[axis] + self.rng.choice((0.0002, 0.003, 0.3, 5)) * self.rng.uniform(-1, 1), 4)

    def line(self):
        axes = self.rng.sample("XYZ", self.rng.randint(1, 3))
        self.emit("G1", {axis: self.near(axis) for axis in axes})

    def rapid(self):
        self.emit("G0", {axis: self.near(axis) for axis in self.rng.sample("XYZ", 2)})

    def switch(self):
        what = self.rng.choice(("distance", "time"))
        if what == "distance":
            self.incremental = not self.incremental
            self.say("G91" if self.incremental else "G90")
        else:
            self.timed = not self.timed
            self.say("G93" if self.timed else "G94")

    def say(self, code):
        if self.codes:  # codes come into force in the order in which they were drawn
            self.lines.append(self.codes.strip())
            self.codes = ""
        if self.rng.random() < 0.5:
            self.lines.append(code + (" F500" if code == "G94" else ""))
        else:
            self.codes = code + " "

    def geometry(self):
        plane = self.rng.choice(list(LETTERS))
        first, second, i, j, normal = LETTERS[plane]
        radius = self.rng.choice((0.02, 1, 10)) * self.rng.uniform(0.5, 1)
        start = self.rng.choice((self.rng.uniform(0, 6.28), self.rng.randrange(4) * math.pi / 2))
        offset = round(-radius * math.cos(start), 4), round(-radius * math.sin(start), 4)
        self.lines.append(plane)
        return first, second, i, j, normal, offset

    def arc(self):
        first, second, i, j, normal, offset = self.geometry()
        sense, turn = self.rng.choice((2, 3)), self.rng.uniform(0.3, 5.9)
        angle = math.atan2(-offset[1], -offset[0]) + turn * (1 if sense == 3 else -1)
        radius = math.hypot(*offset)
        targets = {
            first: self.at[first] + offset[0] + radius * math.cos(angle),
            second: self.at[second] + offset[1] + radius * math.sin(angle),
        }
        if self.rng.random() < 0.3:
            targets[normal] = self.near(normal)
        self.emit(f"G{sense}", targets, f" {i}{offset[0]:.4f} {j}{offset[1]:.4f}")

    def circle(self):
        _, _, i, j, normal, offset = self.geometry()
        more = f" {i}{offset[0]:.4f} {j}{offset[1]:.4f}"
        targets = {normal: self.near(normal)} if self.rng.random() < 0.3 else {}
        self.emit(self.rng.choice(("G2", "G3")), targets, more)

    def radius(self):
        first, second, _, _, _, _ = self.geometry()
        way = [self.rng.uniform(-3, 3), self.rng.uniform(1, 3)]
        radius = math.hypot(*way) * self.rng.uniform(0.6, 2) * self.rng.choice((1, -1))
        targets = {first: self.at[first] + way[0], second: self.at[second] + way[1]}
        self.emit(self.rng.choice(("G2", "G3")), targets, f" R{radius:.4f}")


TOO_SMALL = re.compile("the other way round|rounding makes it the other|rounding leaves it no radius")
"""Why arcs are refused that are smaller than the play: their ends, or one of them and the centre, may fall together."""
ROUNDING = 0.1
BAND = 0.5
ARC_RADIUS_UM = 1.5
"""The test's arcs are no better circles: four decimals on a short radius, a radius to four decimals."""


@settings(max_examples=30)
@given(seed=seeds, blocks=st.integers(1, 25), widths=st.tuples(*[st.sampled_from((0.0, 1.5, 20.0, 45.0))] * 3))
def test_the_machine_with_play_follows_the_nominal_path(seed, blocks, widths):
    text = Path(seed).text(blocks)
    widths = dict(zip("XYZ", widths, strict=True))
    try:
        result = correct(text, GANTRY, played(GANTRY, **widths))
    except UserError as refusal:  # an arc of 10 um with a play of 20 um
        assume(not TOO_SMALL.search(str(refusal)))
        raise
    ends, along = largest_error(text, result.text, GANTRY, widths)
    # back by the band from the last end, and by the band from the farthest point between the two: the tolerance
    assert ends <= ROUNDING + 2 * BAND
    assert along <= ROUNDING + 2 * BAND + ARC_RADIUS_UM


def test_lines_by_hand():
    """X behind by 10 um, Y by 20, Z ahead by 6, whichever way they came."""
    assert written("G1 Z120\nX120 F300\nX105 F200 (back)\nX100\nY100 Z100\n") == [
        "G1 Z119.9940",
        "X120.0100 F300",
        "G1 X119.9900 F200 (NCOMP TAKE-UP)",
        "X104.9900 F200 (back)",
        "X99.9900",
        "G1 Y109.9800 Z120.0060 (NCOMP TAKE-UP)",
        "Y99.9800 Z100.0060",
    ]


def test_rapids_take_play_up_on_their_way():
    assert written("G0 X105\nX106\nG1 X107\nX106\n") == [
        "G0 X104.9900",
        "X106.0100",
        "G1 X107.0100",
        "G1 X106.9900 (NCOMP TAKE-UP)",
        "X105.9900",
    ]


def test_modes_said_in_the_block_are_said_before_it_too():
    assert written("G1 X120\nG91 G1 X-5\nX5\nN9 G90 X10 F1\n") == [
        "G1 X120.0100",
        "G91 G1 X-0.0200 (NCOMP TAKE-UP)",
        "G91 G1 X-5",
        "G1 X0.0200 (NCOMP TAKE-UP)",
        "X5",
        "G90 G1 X119.9900 F1 (NCOMP TAKE-UP)",
        "N9 G90 X9.9900 F1",
    ]


def test_inches():
    assert written("G20\nG1 X5\nX4\n")[1:] == ["G1 X5.000394", "G1 X4.999606 (NCOMP TAKE-UP)", "X3.999606"]


def test_an_arc_says_again_that_it_is_one():
    assert written("G1 X120\nG2 X130 I5\nX120 I-5 F9\n") == [
        "G1 X120.0100",
        "G2 X125.0100 Y115.0200 I5",
        "G1 Y114.9800 (NCOMP TAKE-UP)",
        "G2 X130.0100 Y109.9800 I0.0000 J-5.0000 (NCOMP ARC)",
        "G1 X129.9900 F9 (NCOMP TAKE-UP)",
        "G2 X124.9900 Y104.9800 I-5 F9",
        "G1 Y105.0200 (NCOMP TAKE-UP)",
        "G2 X119.9900 Y110.0200 I0.0000 J5.0000 (NCOMP ARC)",
    ]


def test_each_arc_piece_keeps_its_time():
    """G93: the pieces together take as long as the arc did."""
    lines = written("G1 X120\nG93 G2 X130 I5 F4\n")
    feeds = [float(re.search(r"F([\d.]+)", line)[1]) for line in lines[1:] if "TAKE-UP" not in line]
    assert len(feeds) == 2
    assert sum(1 / feed for feed in feeds) == pytest.approx(1 / 4, rel=1e-4)
    take_up = next(line for line in lines if "TAKE-UP" in line)
    assert float(re.search(r"F([\d.]+)", take_up)[1]) == pytest.approx(4 * math.pi * 5 / 0.040, rel=1e-3)


def test_idle_axes_do_not_chatter():
    steps = "".join(f"G1 X{120 + i} Y{110 + 0.0004 * (i % 2):.4f}\n" for i in range(8))
    assert not [line for line in written(steps) if "NCOMP" in line]
    assert [line for line in written(steps, tolerance_um=0.2) if "TAKE-UP" in line]


def test_a_reversal_in_small_steps_counts_when_it_is_more_than_the_dead_band():
    steps = "G1 X120\n" + "".join(f"X{120 - 0.0003 * i:.4f}\n" for i in range(1, 5))
    assert written(steps) == [
        "G1 X120.0100", "X120.0097", "G1 X119.9897 (NCOMP TAKE-UP)", "X119.9894", "X119.9891", "X119.9888",
    ]  # fmt: skip


@pytest.mark.parametrize("chunk", [1, 3])
@settings(max_examples=10)
@given(seed=seeds)
def test_directions_go_on_from_chunk_to_chunk(chunk, seed):
    band = np.full(2, 0.01)
    rng = np.random.default_rng(seed)
    q, certain = rng.normal(0.0, 0.02, (30, 2)), rng.random((30, 2)) < 0.9
    parts = Directions((1,), band)
    found = np.concatenate([parts.follow(q[i : i + chunk], certain[i : i + chunk]) for i in range(0, 30, chunk)])
    assert (found == Directions((1,), band).follow(q, certain)).all()
    assert not found[:, 0].any()


NOTED = {
    "a new frame": ("G1 X120\nG43 H1 G1 X100", "X .*its block changes the frame"),
    "another frame": ("G1 X120\nG55 G1 X100", "X .*the program has not given its position"),
    "after an unknown M function": ("G1 X120\nM77\nX100", "X .*the program has not given its position"),
    "an M function in an arc": ("G2 X130 I10 M5", "one piece .*an M function in its block may run before or after it"),
    "first moves": ("G1 X120", "X taken in the middle of its play until it moves"),
    "no F under G93": ("G1 X120\nG93 X100", "X .*has no F under G93"),
}


@pytest.mark.parametrize("name", NOTED)
def test_what_is_not_taken_up_is_noted(name):
    text, pattern = NOTED[name]
    result = correct(HEAD + text + "\n", GANTRY, played(GANTRY, X=20.0, Y=40.0), tools=["T1=50"])
    assert [note for note in result.report.notes if re.search(pattern, note)], result.report.notes
    nothing = [line for line in result.text.splitlines() if line.startswith("G1 X1") and "TAKE-UP" in line]
    assert not nothing or name == "first moves"


def test_a_tool_change_leaves_only_z_unknown():
    lines = written("G1 X120 Y120 Z120\nM6 T1\nG0 X100\nZ50\nG1 X130\nZ40\n")
    assert lines[2:] == [
        "G0 X99.9900", "Z50", "G1 X100.0100 (NCOMP TAKE-UP)", "G1 X130.0100", "G1 Z50.0060 (NCOMP TAKE-UP)", "Z40.0060",
    ]  # fmt: skip


def test_without_play_nothing_is_added():
    model = random_model(GANTRY, 5)
    text = Path(7).text(20)
    result = correct(text, GANTRY, model, **WHOLE)
    assert result.report.added_blocks == 0
    assert "TAKE-UP" not in result.text
    assert result.text.count("\n") == text.count("\n") + 1
    assert correct(text, GANTRY, no_errors(GANTRY)).text == text


def with_play(machine, seed):
    model, rng = random_model(machine, seed), np.random.default_rng(seed)
    plays = [Backlash(axis.name, float(rng.uniform(2, 40)), float(rng.uniform(-9, 9))) for axis in machine.axes]
    return model_of(machine, *model.effects, *plays)


@pytest.mark.parametrize(
    "name", ["gantry", *(pytest.param(name, marks=pytest.mark.slow) for name in ("dmu50", "head_table"))]
)
@settings(max_examples=4)
@given(seed=seeds, tcp=st.booleans())
def test_random_programs_are_verified_and_do_not_depend_on_chunks(name, seed, tcp):
    machine = load(name)
    tcp &= name != "gantry"
    text = RandomProgram(machine, seed, tcp=tcp).text(30)
    setup, model = random_setup(machine), with_play(machine, seed)
    try:
        whole = correct(text, machine, model, **setup, travel_check=False)
    except UserError as refusal:  # an arc smaller than the play
        assume(not TOO_SMALL.search(str(refusal)))
        raise
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("postproc.execution.CHUNK", 4)
        part = correct(text, machine, model, **setup, travel_check=False)
    assert part.text == whole.text
    assert part.report.notes == whole.report.notes
    verdict = verify(read(text, machine, **setup), read(whole.text, machine, **setup), model)
    assert verdict.moves == whole.report.moves
    assert verdict.before.count == verdict.after.count
    if not tcp:
        assert whole.report.after.largest == pytest.approx(verdict.after.largest, abs=2e-3)
        assert whole.report.before.largest == pytest.approx(verdict.before.largest, abs=2e-3)
    rotary = machine.rotary
    nominal, commanded = read(text, machine, **setup), read(whole.text, machine, **setup)
    own = like(nominal, commanded)
    assert np.abs(own.machine_target - commanded.machine_target)[:, rotary].max(initial=0.0) < 1e-12
    assert np.abs(own.machine_target - commanded.machine_target).max() < 1.0


def test_texts_that_do_not_belong_together():
    good = correct(HEAD + "G1 X120\nX100\nG2 X110 I5\n", GANTRY, PLAYED).text
    other = HEAD + "G1 X120\nX100\nG1 X110\n"
    for nominal, text in ((other, good), (HEAD, good), (good.replace("G2 X", "G3 X"), other)):
        with pytest.raises(UserError, match="do not make the same moves"):
            verify(read(nominal, GANTRY), read(text, GANTRY), PLAYED)


def test_real_programs(nc_data):
    seen = set()
    for path in real_programs(nc_data):
        if path.name not in ACCEPTED:
            continue
        seen.add(path.name)
        machine = machine_for(path)
        widths = {"X": 20.0, "Y": 30.0, "Z": 8.0}
        model = played(machine, **widths)
        data, report = run(path, machine, model)
        text, corrected = path.read_bytes().decode(ENCODING), data.decode(ENCODING)
        assert corrected != text
        nominal, commanded = read(text, machine), read(corrected, machine)
        verdict = verify(nominal, commanded, model)
        assert verdict.moves == report.moves
        if not any(frame.tcp for frame in nominal.frames):
            assert verdict.after.rms < 0.5 * verdict.before.rms
    assert seen == ACCEPTED


def test_the_orientation_too():
    """A program of both: nothing breaks, and the tool axis is no worse."""
    text = "G21 G90 F500\nG0 X10 Y10 Z50 B10 C10\nX11 Y11 Z51 B11 C11\nG1 X20 B20\nX10 B15 C20\nX12 B12 C12\n"
    model = played(DMU50, X=20.0, B=50.0, C=30.0)
    result = correct(text, DMU50, model, classes=frozenset(("L-POS", "R-POS", "FOR")), travel_check=False)
    assert result.report.tilt_after.rms < result.report.tilt_before.rms
    assert any("B is taken up along a feed move" in note for note in result.report.notes)


@pytest.mark.parametrize(
    ("cycle", "to", "expected"),
    [
        ("G99 G81 X120. Z90. R109.", "G0 Z100.", "Z100.0060"),  # down from R
        ("G98 G81 X120. Z90. R105.", "G0 Z107.", "Z107.0060"),  # down from the level before
        ("G99 G81 X120. Z90. R105.", "G0 Z107.", "Z106.9940"),  # up from R
    ],
)
def test_a_drill_returns_before_the_next_move(cycle, to, expected):
    """Its axis comes from where the cycle has left it, not from the bottom of the hole."""
    assert written(f"{cycle}\nG80\n{to}\n")[-1].split()[1] == expected


def test_a_feed_move_that_turns_back_behind_a_cycle_is_noted():
    text = HEAD + "G99 G81 X120. Y100. Z90. R105.\nG1 X150. Z95.\nM2\n"
    notes = correct(text, GANTRY, PLAYED).report.notes
    assert any("the play of Z is taken up along a feed move" in note and "line 5" in note for note in notes), notes


def test_a_rapid_of_the_tool_point_that_turns_an_axis_back_inside():
    """Under TCP an axis may come to the end of a rapid from the other side than its start lies: found by `verify`."""
    machine = load("head_head")
    model = model_of(machine, *(Backlash(axis, 20.0) for axis in "XYZ"))
    text = (
        "G21 G90 G54\nG0 X0.406 Y-10.053 Z18.118 C22.080 B-14.332\nG43.4 H1\nG0 X0.4 Y-10. Z18. C22. B-14.\n"
        "G0 X38.702 Y-5.958 Z35.226 C-9.831 B12.768\nG0 Y-10.564\nG0 Z32.208\nM30\n"
    )
    setup = {"offsets": ["G54=2000,1250,500"], "tools": ["T1=80"]}
    done = correct(text, machine, model, **setup, travel_check=False)
    verdict = verify(read(text, machine, **setup), read(done.text, machine, **setup), model)
    assert verdict.after.largest == pytest.approx(done.report.after.largest, abs=0.05)
    assert verdict.after.largest < 0.2
