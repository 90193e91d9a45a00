"""Long moves in pieces: what is written, read back and run as the control runs it, stays within the tolerance."""

import io
import itertools
import math
import re

import numpy as np
import pytest
from hypothesis import strategies as st
from support.programs import (
    FIVE_AXES,
    THREE_AXES,
    TOOLS,
    centred,
    load,
    model_of,
    random_model,
    setup_of,
    shifted,
    source_of,
)
from support.tiers import drawn, quick

from kinematics.basis import BSpline, Polynomial
from kinematics.effects import Backlash, Cyclic, ErrorMotion, LocationError
from kinematics.error_model.classes import parse_classes
from postproc.compensation.correction import pose_errors
from postproc.correct.job import Job
from postproc.correct.mark import mark_in
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.motion.motions import merged
from postproc.motion.moves import Kind
from postproc.text.source import ENCODING
from postproc.verification.verify import read_motions, verify

TOLERANCE_UM = 1.0
SAMPLES = 73
"""Along each piece; no multiple of what the splitter looks at."""
EVERY = [(name, tcp) for name in THREE_AXES + FIVE_AXES for tcp in (False, True) if not (tcp and name in THREE_AXES)]
FEW = quick(EVERY, [("gantry", False), ("dmu50", True), ("trunnion_ac", False)])
GANTRY, DMU50 = load("gantry"), load("dmu50")
BOWED = model_of(GANTRY, ErrorMotion("Y", "X", Polynomial((0.0, 5000.0), 2), (0.0, -400.0, 400.0)))
"""X bows by 100 um along y in the middle of its 5 m: a line of 500 mm strays by 1 um."""
LARGE = {"max_correction_um": 5000.0}
"""Random models of large machines pass the default limit."""


class Run:
    """A program corrected, and both texts read."""

    def __init__(self, text, machine, model, dialect="iso", tolerance_um=TOLERANCE_UM, **options):
        self.machine, self.model = machine, model
        self.language = find_dialect(dialect, "", "")
        offsets = [centred(machine, {"iso": "G54", "siemens": "G54", "heidenhain": "0"}[dialect])]
        self.setup = lambda: setup_of(machine, offsets, TOOLS)
        out, source = io.BytesIO(), source_of(text)
        job = Job(
            source, self.language, machine, model, self.setup(), False, tolerance_um=tolerance_um, **LARGE | options
        )
        self.report = Pipeline(job).run(out, lambda _: None)
        self.text = out.getvalue().decode(ENCODING)
        self.nominal, self.commanded = self.read(text), self.read(self.text)

    @property
    def lines(self):
        return [line for line in self.text.splitlines() if mark_in(line) is None]

    def read(self, text):
        return merged(read_motions(source_of(text), self.language, self.machine, self.setup()))

    def pieces(self):
        """By row of the nominal program: rows of the written one, and the shares of the way at which they begin."""
        found, row = {}, -1
        for i in range(len(self.commanded)):
            row += not self.commanded.added[i]
            found.setdefault(row, []).append((i, float(self.commanded.start_fraction[i])))
        return found

    def strays(self):
        """Largest error, um, of the tool point along feed moves that begin and end where the program has said."""
        judged = self.nominal.evaluated_paths & ~self.nominal.rotary_only
        q, wanted, tools = [], [], []
        for row, pieces in self.pieces().items():
            if not judged[row]:
                continue
            ends = [begin for _, begin in pieces[1:]] + [1.0]
            for (i, begin), end in zip(pieces, ends, strict=True):
                shares = np.linspace(0.0, 1.0, SAMPLES)
                q.append(in_machine(self.commanded, i, along(self.commanded, i, shares)))
                wanted.append(in_machine(self.nominal, row, along(self.nominal, row, begin + shares * (end - begin))))
                tools.append(np.tile(self.nominal.tool[row], (SAMPLES, 1)))
        parts = (np.concatenate(part) for part in (q, wanted, tools))
        return float(pose_errors(self.machine, self.model, *parts).point_um.max())


def in_machine(motions, row, program):
    return motions.bare.take(np.full(len(program), row)).in_machine(program)


def along(motions, row, shares):
    """Programmed positions along a move: even, round a circle in the plane of an arc."""
    start, target = motions.start[row], motions.target[row]
    program = start + shares[:, None] * (target - start)
    arc = motions.arcs.get(row)
    if arc is not None:
        i, j, _ = arc.plane
        first, last = (math.atan2(end[j] - arc.centre[1], end[i] - arc.centre[0]) for end in (start, target))
        turned = arc.sense * ((arc.sense * (last - first)) % (2 * math.pi) if not arc.full else 2 * math.pi)
        radii = [math.hypot(end[i] - arc.centre[0], end[j] - arc.centre[1]) for end in (start, target)]
        radius, angle = radii[0] + shares * (radii[1] - radii[0]), first + turned * shares
        program[:, i] = arc.centre[0] + radius * np.cos(angle)
        program[:, j] = arc.centre[1] + radius * np.sin(angle)
    return program


# ---- straight moves

HEADS = {
    "iso": "G21 G90 G17 G54 F600\n{tcp}\n",
    "siemens": "G71 G90 G17 G54 F600\nT2 D1 M6\n{tcp}\n",
    "heidenhain": "0 BEGIN PGM A MM\n1 TOOL DEF 2 L120.25 R3\n2 TOOL CALL 2 Z S1000\n{tcp}\n",
}
TCP = {"iso": "G43.4 H2", "siemens": "TRAORI", "heidenhain": "M128"}
LINES = {"iso": "G1 {}", "siemens": "G1 {}", "heidenhain": "L {} F600"}
ENDS = {"iso": "M30\n", "siemens": "M30\n", "heidenhain": "END PGM A MM\n"}


def long_lines(machine, seed, tcp, dialect, moves=4):
    """Moves all over the travel, some with rotary axes."""
    rng = np.random.default_rng(seed)
    travel = np.array([machine.axes[machine.index(axis)].travel for axis in "XYZ"])
    span = np.minimum(np.diff(travel, axis=1)[:, 0] * 0.35, 150.0 if tcp else np.inf)
    rotary = [axis for axis in machine.axes if axis.rotary]

    def place(turns):
        words = [f"{axis}{value:.3f}" for axis, value in zip("XYZ", rng.uniform(-span, span), strict=True)]
        limits = [(axis.name, max(axis.travel[0], -30.0), min(axis.travel[1], 30.0)) for axis in rotary if turns]
        return " ".join(words + [f"{name}{rng.uniform(low, high):.3f}" for name, low, high in limits])

    body = [LINES[dialect].format(place(i == 0 or rng.random() < 0.6)) for i in range(moves + 1)]
    return HEADS[dialect].format(tcp=TCP[dialect] if tcp else "") + "\n".join(body) + "\n" + ENDS[dialect]


@pytest.mark.parametrize(("name", "tcp"), FEW)
@pytest.mark.parametrize("dialect", ["iso", pytest.param("siemens", marks=pytest.mark.statistical), pytest.param("heidenhain", marks=pytest.mark.statistical)])  # fmt: skip
def test_random_long_lines_on_all_machines(name, tcp, dialect):
    machine = load(name)
    seed = EVERY.index((name, tcp))
    run = Run(long_lines(machine, seed, tcp, dialect), machine, random_model(machine, seed), dialect)
    assert run.strays() < TOLERANCE_UM
    assert run.report.split_moves >= 3
    verdict = verify(run.nominal, run.commanded, run.model)
    assert verdict.path_after.largest < TOLERANCE_UM < verdict.path_before.largest
    assert verdict.moves == len(run.nominal)


@pytest.mark.parametrize("dialect", ["siemens", "heidenhain"])
def test_other_dialects(dialect):
    run = Run(long_lines(DMU50, 5, True, dialect), DMU50, random_model(DMU50, 5), dialect)
    assert run.strays() < TOLERANCE_UM
    assert run.report.split_moves == 4


@drawn(
    few=1,
    many=20,
    most=60,
    seed=st.integers(0, 2**32 - 1),
    case=st.sampled_from(EVERY),
    dialect=st.sampled_from(list(TCP)),
)
def test_any_long_lines(seed, case, dialect):
    name, tcp = case
    machine = load(name)
    run = Run(long_lines(machine, seed, tcp, dialect), machine, random_model(machine, seed), dialect)
    assert run.strays() < TOLERANCE_UM


@pytest.mark.parametrize("tolerance", [0.5, 1.0, 3.0, 20.0])
def test_the_finer_the_tolerance_the_more_pieces(tolerance):
    run = Run("G0 X0. Y0. Z0.\nG1 X2000. F500\n", GANTRY, BOWED, tolerance_um=tolerance)
    # a parabola of 100 um over 5 m: a piece of length h strays by 400 um (h / 5 m)^2 / 4
    fewest = 2000.0 / math.sqrt(4.0 * tolerance / 400.0) / 5000.0
    assert fewest <= run.report.added_blocks + 1 < 2.5 * fewest + 1
    assert run.strays() < tolerance


def test_a_constant_error_splits_nothing():
    run = Run(long_lines(GANTRY, 1, False, "iso"), GANTRY, shifted(GANTRY, X=40.0, Y=-7.0))
    assert run.report.added_blocks == run.report.split_moves == 0
    out = model_of(GANTRY, LocationError("C", "Y", 80.0))
    assert Run(long_lines(GANTRY, 1, False, "iso"), GANTRY, out).report.added_blocks == 0


def test_kinks_of_a_table_are_found():
    """A table with one peak of 10 um, 40 mm wide, in the middle of a move of 3 m."""
    nodes = tuple(np.arange(0.0, 5001.0, 20.0).tolist())
    values = tuple(10.0 * (node == 2520.0) for node in nodes)
    model = model_of(GANTRY, ErrorMotion("Y", "X", BSpline(nodes, 1), values, u=(1.0,) * len(nodes)))
    run = Run("G0 X-1500. Y0. Z0.\nG1 X1500. F500\n", GANTRY, model)
    assert run.strays() < TOLERANCE_UM
    assert 3 <= run.report.added_blocks < 40


def test_short_waves_are_found():
    model = model_of(GANTRY, Cyclic("X", "X", 10.0, (3.0,), (0.0,)))
    run = Run("G0 X-150. Y0. Z0.\nG1 X150. Y20. F500\n", GANTRY, model)
    assert run.strays() < TOLERANCE_UM
    assert run.report.added_blocks > 60
    assert Run("G0 X-150. Y0. Z0.\nG1 X150. Y20. F500\n", GANTRY, model, tolerance_um=4.0).report.added_blocks == 0


@pytest.mark.parametrize("tcp", [False, True])
def test_orientation(tcp):
    machine = DMU50
    classes = parse_classes("FOR,L-VOL+,R-VOL+")
    text = long_lines(machine, 3, tcp, "iso")
    run = Run(text, machine, random_model(machine, 3, 30.0), classes=classes)
    assert run.strays() < TOLERANCE_UM
    assert run.report.split_moves > 0


# ---- how it is written


def bowed(body, dialect="iso", **options):
    """Lines of the program behind a head that goes to 0, on the bowed gantry."""
    head = {
        "iso": "G21 G90 G17 G54 F600\nG0 X0. Y0. Z0.\n",
        "siemens": "G71 G90 G17 G54 F600\nG0 X0. Y0. Z0.\n",
        "heidenhain": "0 BEGIN PGM A MM\n1 L X+0 Y+0 Z+0 FMAX\n",
    }[dialect]
    return Run(head + body, GANTRY, BOWED, dialect, **options)


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        (
            "N10 G1 X800. F300. M8\nN20 X0.",
            ["N10 G1 X400.0000 Y0.0974 F300. M8", "G1 X800.0000 Y0.0898 (NCOMP FROM 1/2)"],
        ),
        ("G1 X800. M30", ["G1 X400.0000 Y0.0974", "G1 X800.0000 Y0.0898 M30 (NCOMP FROM 1/2)"]),
        ("n10g1x800.m0", ["n10g1x400.0000y0.0974", "g1x800.0000y0.0898m0(NCOMP FROM 1/2)"]),
        ("G9 G1 X800.", ["G1 X400.0000 Y0.0974", "G1 X800.0000 Y0.0898 G9 (NCOMP FROM 1/2)"]),
        ("G91 G1 X800.", ["G91 G1 X400.0000 Y-0.0026", "G1 X400.0000 Y-0.0076 (NCOMP FROM 1/2)"]),
        ("#1=800.\nG1 X#1 (A)", ["G1 X[#1-400.0000] Y0.0974 (A)", "G1 X800.0000 Y0.0898 (NCOMP FROM 1/2)"]),
        ("G20 G1 X40. Y0.", ["G20 G1 X10.000000 Y0.003896", "G1 X40.000000 Y0.003287 (NCOMP FROM 3/4)"]),
    ],
)
def test_by_hand(body, expected):
    run = bowed(body + "\n")
    for line in expected:
        assert any(line in written for written in run.lines), run.text
    assert run.strays() < TOLERANCE_UM


def test_klartext_by_hand():
    run = bowed("2 L X+800 Y+0 F600 M3\n3 L IX-800 M9\n4 L X+800,0 R0 M30\n5 END PGM A MM\n", "heidenhain")
    body = [line for line in run.lines if line.startswith(("3", "4", "5", "6", "7"))]  # 1 is the mark
    assert body == [
        "3 L X+400.0000 Y+0.0974 F600 M3",
        "4 L X+800.0000 Y+0.0898 ; NCOMP FROM 1/2",
        "5 L IX-800 Y+0.1000 M9",
        "6 L X+400,0000 Y+0,0974 R0",
        "7 L X+800,0000 Y+0,0898 M30 ; NCOMP FROM 1/2",
    ]
    assert any(
        "M function in its block may run before or after the move (lines 4)" in note for note in run.report.notes
    )


def test_siemens_by_hand():
    body = "N1 G1 X=800 Y=AC(0) F600\nR1=1\nN2 X=IC(-800*R1) G9\nG3 X=800 Y=0 I=AC(400) J=AC(0)\nM30\n"
    run = bowed(body, "siemens")
    found = [line for line in run.lines if "G1 X" in line or "N2" in line or "G3" in line]
    assert found[0:4] == [
        "N1 G1 X=400.0000 Y=AC(0.0974) F600",
        "G1 X800.0000 Y0.0898 ; NCOMP FROM 1/2",
        "N2 X=IC(-800*R1+400.0000) Y0.0974",
        "G1 X0.0000 Y0.1000 G9 ; NCOMP FROM 1/2",
    ]
    assert len(found) > 6  # the half circle of 400 mm
    assert run.strays() < TOLERANCE_UM


# ---- arcs

PLANES = {"G17": "XYIJZ", "G18": "ZXKIY", "G19": "YZJKX"}


def round_arcs(machine, seed, tcp, count=3):
    """Arcs of all sizes that fit, full circles, helices, by centre and by radius, in three planes."""
    rng = np.random.default_rng(seed)
    travel = np.array([machine.axes[machine.index(axis)].travel for axis in "XYZ"])
    most = min(float(np.diff(travel, axis=1).min()) * 0.2, 120.0 if tcp else 500.0)
    lines = []
    for plane, kind in itertools.product(PLANES, ("arc", "circle", "helix", "radius")):
        first, second, i, j, normal = PLANES[plane]
        for _ in range(count):
            radius, start = most * rng.uniform(0.05, 1.0), rng.uniform(0, 2 * math.pi)
            x, y = round(radius * math.cos(start), 4), round(radius * math.sin(start), 4)
            sense, turn = rng.choice((2, 3)), rng.uniform(0.2, 3.0 if kind == "radius" else 6.0)
            end = start + turn * (1 if sense == 3 else -1)
            radius = math.hypot(x, y)
            a, b = round(radius * math.cos(end), 4), round(radius * math.sin(end), 4)
            lines.append(f"G0 X0. Y0. Z0.\n{first}{x} {second}{y}\n{plane}")
            centre, target = f"{i}{-x} {j}{-y}", f"{first}{a} {second}{b}"
            lines.append({
                "arc": f"G{sense} {target} {centre}",
                "circle": f"G{sense} {centre}",
                "helix": f"G{sense} {normal}{0.3 * most:.3f} {centre}",
                "radius": f"G{sense} {target} R{radius:.6f}",
            }[kind])  # fmt: skip
    head = "G21 G90 G54 F600\n" + ("G43.4 H2\n" if tcp else "")
    turned = " ".join(f"{axis.name}{min(axis.travel[1], 20.0):g}" for axis in machine.axes if axis.rotary)
    return head + f"G0 X0. Y0. Z0. {turned}\n" + "\n".join(lines) + "\nM30\n"


@pytest.mark.parametrize(("name", "tcp"), quick(EVERY, [("gantry", False), ("head_head", True)]))
def test_arcs_on_all_machines(name, tcp):
    machine = load(name)
    seed = EVERY.index((name, tcp))
    run = Run(round_arcs(machine, seed, tcp, 1), machine, random_model(machine, seed))
    assert run.strays() < TOLERANCE_UM
    assert run.report.split_moves >= 3
    # arcs stay arcs, and radii at both ends are what the strictest controls let pass
    assert (run.commanded.kind[run.commanded.added] == Kind.ARC).all()
    for row, arc in run.commanded.arcs.items():
        i, j, _ = arc.plane
        ends = (run.commanded.start[row, [i, j]], run.commanded.target[row, [i, j]])
        assert abs(math.dist(ends[0], arc.centre) - math.dist(ends[1], arc.centre)) < 3e-3


@drawn(few=1, many=15, most=60, seed=st.integers(0, 2**32 - 1), case=st.sampled_from(EVERY))
def test_any_arcs(seed, case):
    name, tcp = case
    machine = load(name)
    run = Run(round_arcs(machine, seed, tcp), machine, random_model(machine, seed))
    assert run.strays() < TOLERANCE_UM


def test_klartext_arcs():
    body = (
        "2 L X+300 Y+0 F500\n3 CC X+0 Y+0\n4 C X-300 Y+0 DR+\n5 C X+300 Y+0 DR+\n6 CR X+0 Y+300 R+300 DR+\n7 L Z+10\n"
    )
    model = random_model(GANTRY, 4)
    head = "0 BEGIN PGM A MM\n1 L X+0 Y+0 Z+0 FMAX\n"
    run = Run(head + body + "8 END PGM A MM\n", GANTRY, model, "heidenhain")
    assert run.strays() < TOLERANCE_UM
    assert run.report.split_moves >= 3
    assert [line for line in run.lines if re.match(r"\d+ C[PR] .* DR\+ ; NCOMP FROM", line)]


# ---- time, backlash, what stays whole


def test_inverse_time_is_divided():
    body = "G93 G1 X2000. F2.\nX0. Y50. F5.\nG3 X0. Y250. J100. F0.5\nG94 F100\n"
    run = bowed(body)
    timed = list(itertools.takewhile(lambda line: "G94 " not in line, run.lines[2:]))
    minutes = sum(1.0 / float(re.search(r"F([\d.]+)", line.replace("FROM", ""))[1]) for line in timed)
    assert minutes == pytest.approx(1 / 2.0 + 1 / 5.0 + 1 / 0.5, rel=1e-4)
    assert run.report.added_blocks > 3


def test_feeds_per_minute_are_said_once():
    run = bowed("G1 X2000. F600.\nX0.\n")
    assert sum("F600." in line for line in run.lines) == 1


@pytest.mark.parametrize(
    ("body", "reason", "line"),
    [
        ("G1 X800. M9", "an M function in its block may run before or after the move", 3),
        ("G93 G1 X800.", "its block has no F under G93", 3),
        (
            "#1=1\nWHILE[#1 LE 2]DO1\nG1 X[400.*#1]\n#1=#1+1\nEND1",
            "its block runs several times with different moves",
            5,
        ),
    ],
)
def test_what_stays_whole_is_said(body, reason, line):
    try:
        run = bowed(body + "\n")
    except Exception as refusal:  # a loop whose passes want different corrections
        assert "needs a different correction each time" in str(refusal)
        return
    assert run.report.split_moves == 0
    (note,) = (note for note in run.report.notes if reason in note)
    assert f"(lines {line})" in note
    (entry,) = run.report.json()["not_split"]
    assert entry["reason"] == reason
    assert entry["strays_up_to_um"] == pytest.approx(run.strays(), rel=0.1)


def test_a_block_that_runs_twice_alike_is_split():
    run = bowed("#1=0\nWHILE[#1 LT 2]DO1\nG1 X800. F100\nG0 X0.\n#1=#1+1\nEND1\nM30\n")
    assert run.report.added_blocks == 2  # of two passes, which are one text
    assert sum("FROM" in line for line in run.lines) == 1
    assert run.strays() < TOLERANCE_UM


def test_a_block_that_runs_twice_from_other_places_stays_whole():
    """Both passes end alike; what lies between would not."""
    model = model_of(GANTRY, ErrorMotion("X", "X", Polynomial((0.0, 5000.0), 2), (0.0, -400.0, 400.0)))
    body = "#1=0\nWHILE[#1 LT 2]DO1\nG1 X800. F100\nG0 X[#1*0.]\nX[300.*#1]\n#1=#1+1\nEND1\nM30\n"
    with pytest.raises(Exception, match="needs a different correction each time"):
        Run("G21 G90 G54 G0 X0. Y0. Z0.\n" + body, GANTRY, model)
    start = "G21 G90 G54 G0 X0. Y0. Z0.\nM98 P100\nG0 X300.\nM98 P100\nM30\nO100\nG1 X800. F100\nM99\n"
    run = Run(start, GANTRY, BOWED)
    assert run.report.added_blocks == 0
    assert any("runs several times with different moves (lines 7)" in note for note in run.report.notes)


@pytest.mark.parametrize("name", quick(["gantry", "dmu50"], ["dmu50"]))
def test_with_play(name):
    """Backlash is taken up at reversals, also between and within pieces."""
    machine = load(name)
    smooth = random_model(machine, 2)
    backlash = tuple(Backlash(axis, width) for axis, width in {"X": 20.0, "Y": 15.0}.items())
    model = model_of(machine, *smooth.effects, *backlash)
    run = Run(round_arcs(machine, 2, False, 1), machine, model)
    assert any("NCOMP ARC" in line for line in run.lines)
    assert any("NCOMP FROM" in line for line in run.lines)
    verdict = verify(run.nominal, run.commanded, model)
    assert verdict.path_after.largest < TOLERANCE_UM
    # an axis that goes back by less than half of the tolerance stays where it is
    assert verdict.after.largest < 0.2 + TOLERANCE_UM / 2
    assert verdict.after.rms < 0.2


def test_half_a_turn_of_an_endless_axis_stays_whole():
    model = random_model(DMU50, 6)
    run = Run("G21 G90 G54\nG0 X0. Y0. Z0. B0. C0.\nG1 X100. C200. F500\n", DMU50, model)
    assert run.report.added_blocks == 0
    assert any("half a turn or more" in note for note in run.report.notes)
