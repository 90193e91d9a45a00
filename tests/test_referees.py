"""The reference interpreters by examples that are worked out by hand, and what they see in a spoilt correction."""

import re
from dataclasses import replace

import pytest
from clients import nc_gcode

from tests.fuzz import refereed
from tests.fuzz.case import Outcome, Verdict, examiner
from tests.fuzz.ncomp import corrected_set
from tests.fuzz.refereed import calibration, machine_text, options_of
from tests.referees.fanuc import Fanuc
from tests.referees.klartext import Klartext
from tests.referees.moves import Move, Unclear
from tests.referees.siemens import written_out

ORIGIN = dict.fromkeys("XYZ", 0.0)


def places(moves):
    return [tuple(round(move.end[axis], 6) + 0.0 for axis in "XYZ") for move in moves]


def fanuc(text, *files):
    names = [f"O{1000 + i}.nc" for i in range(len(files))]
    offsets = {"G54": ORIGIN, "G55": {"X": 100.0, "Y": 0.0, "Z": 0.0}}
    return Fanuc(
        {"O0001.nc": f"O0001\n{text}\nM30\n"} | dict(zip(names, files, strict=True)), offsets, {1: 50.0}, ""
    ).run()


def klartext(text, **files):
    presets = {0: ORIGIN, 1: {"X": 100.0, "Y": 0.0, "Z": 0.0}}
    main = f"BEGIN PGM A MM\nL X+0 Y+0 Z+50 FMAX\n{text}\nL M30\nEND PGM A MM\n"
    texts = {f"{name}.h": f"BEGIN PGM {name} MM\n{body}\nEND PGM {name} MM\n" for name, body in files.items()}
    return Klartext({"a.h": main} | texts, presets, {1: 50.0}, "").run()[1:]


FANUC = {
    "a cycle with G98 and with G99": (
        "G90 G0 X0. Y0. Z20.\nG99 G81 X1. Y2. Z-5. R3. F100.\nG98 X4.\nG80",
        [(0, 0, 20), (1, 2, 20), (1, 2, 3), (1, 2, -5), (1, 2, 3), (4, 2, 3), (4, 2, 3), (4, 2, -5), (4, 2, 20)],
    ),
    "a cycle with increments and repeats": (
        "G90 G0 X0. Y0. Z20.\nG91 G99 G81 X5. Z-8. R-10. K2 F100.",
        [(0, 0, 20), (5, 0, 20), (5, 0, 10), (5, 0, 2), (5, 0, 10), (10, 0, 10), (10, 0, 10), (10, 0, 2), (10, 0, 10)],
    ),
    "offsets, G10, G52 and G92": (
        "G0 X1. Y1. Z1.\nG55 X1.\nG10 L2 P2 X7.\nX1.\nG54 X0.\nG52 X5.\nX1.\nG52 X0.\nX1.\nG92 X10.\nX12.",
        [(1, 1, 1), (101, 1, 1), (8, 1, 1), (0, 1, 1), (6, 1, 1), (1, 1, 1), (3, 1, 1)],
    ),
    "a rotation about a point": ("G0 X0. Y0. Z0.\nG68 X10. Y0. R90.\nX20. Y0.\nG69\nX0. Y0.", [(0, 0, 0), (10, 10, 0), (0, 0, 0)]),
    "loops, branches and vacant variables": (
        "G0 X0. Y0. Z0.\n#1=1\nWHILE[#1 LE 2]DO1\nX#1\n#1=#1+1\nEND1\nIF[#9 EQ #0]GOTO5\nX99.\nN5 Y#1 Z#8",
        [(0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 3, 0)],
    ),
    "arguments of a macro, and products before sums": ("G0 X0. Y0. Z0.\nG65 P1000 A2. X3.", [(0, 0, 0), (7, 0, 0)]),
}  # fmt: skip


@pytest.mark.parametrize("name", FANUC)
def test_fanuc(name):
    text, expected = FANUC[name]
    assert places(fanuc(text, "O1000\nX[1.+#1*#24]\nM99\n")) == expected


def test_fanuc_repeats_a_subprogram():
    called = "O1000\nG91 X1.\nG90\nM99\n"
    assert places(fanuc("G0 X0. Y0. Z0.\nM98 P1000 L2\nM98 P21000", called))[-1] == (4, 0, 0)


@pytest.mark.parametrize(
    ("code", "middle"),
    [("G17 G2 X10. Y0. I5. J0.", (5, 5, 0)), ("G17 G3 X10. Y0. R-5.001", (5, -5.1, 0)),
     ("G18 G3 X10. Z0. I5. K0.", (5, 0, 5)), ("G19 G2 J5. K0.", (0, 10, 0))],
)  # fmt: skip
def test_fanuc_arcs(code, middle):
    arc = fanuc(f"G0 X0. Y0. Z0.\n{code} F100.")[-1]
    assert [arc.middle[axis] for axis in "XYZ"] == pytest.approx(middle, abs=0.11)


@pytest.mark.parametrize("code", ["G43 H1", "G0 G52 X1.\nG55", "G16", "G0 Z5.\nG81 X1. Y1. Z-1. R9."])
def test_fanuc_says_what_is_unclear(code):
    with pytest.raises((Unclear, KeyError)):
        fanuc(f"G0 X0. Y0. Z0.\n{code}")


KLARTEXT = {
    "increments and parameters": ("Q1 = 2 * ( 1 + 2 )\nL X+Q1 IZ-10\nFN 2: Q2 = +Q1 - +1\nL Y-Q2", [(6, 0, 40), (6, -5, 40)]),
    "a part again, and a subprogram": ("LBL 1\nL IX+1\nCALL LBL 1 REP2\nCALL LBL 2\nL IY+1\nL M30\nLBL 2\nL Z+5\nLBL 0",
                                       [(1, 0, 50), (2, 0, 50), (3, 0, 50), (3, 0, 5), (3, 1, 5)]),
    "a jump": ("FN 0: Q1 = +0\nLBL 1\nL IX+1\nFN 1: Q1 = +Q1 + +1\nFN 12: IF +Q1 LT +2 GOTO LBL 1", [(1, 0, 50), (2, 0, 50)]),
    "a shift, turned": ("CYCL DEF 7.0 DATUM\nCYCL DEF 7.1 X+10\nCYCL DEF 7.2 IY+1\nCYCL DEF 10.0 ROT\nCYCL DEF 10.1 ROT+90\nL X+5 Y+0",
                        [(10, 6, 50)]),
    "a preset ends a shift": ("CYCL DEF 7.0 DATUM\nCYCL DEF 7.1 X+10\nCYCL DEF 247 PRESET ~\n  Q339=1 ;NUMBER\nL X+5", [(105, 0, 50)]),
    "about a pole": ("CC X+0 Y+10\nLP PR+10 PA+0\nCP IPA+450 IZ-5 DR+\nCC\nLP PR+5 IPA+0", [(10, 10, 50), (0, 20, 45), (5, 20, 45)]),
    "a tangent": ("L X+10 F100\nCT X+20 Y+10", [(10, 0, 50), (20, 10, 50)]),
    "a hole": ("CYCL DEF 200 DRILLING ~\n  Q200=2 ;A ~\n  Q201=-15 ;B ~\n  Q203=+5 ;C ~\n  Q204=30 ;D\nL X+5 FMAX M99",
               [(5, 0, 50), (5, 0, 7), (5, 0, -10), (5, 0, 35)]),
    "another file": ("QL1 = 3\nCALL PGM SUB\nL X+QL1", [(9, 0, 50), (3, 0, 50)]),
}  # fmt: skip


@pytest.mark.parametrize("name", KLARTEXT)
def test_klartext(name):
    text, expected = KLARTEXT[name]
    assert places(klartext(text, sub="QL1 = 9\nL X+QL1")) == expected


@pytest.mark.parametrize(
    ("code", "middle"),
    [("CC X+5 Y+0\nC X+10 Y+0 DR-", (5, 5)), ("CR X+10 Y+0 R-5.001 DR+", (5, -5.1)), ("CC X+5 Y+0\nC X+0 Y+0 DR+", (10, 0)),
     ("CC X+5 Y+0\nCP IPA-540 DR-", (5, -5))],
)  # fmt: skip
def test_klartext_arcs(code, middle):
    arc = klartext(code)[-1]
    assert [arc.middle[axis] for axis in "XY"] == pytest.approx(middle, abs=0.11)


def test_siemens_writes_out_subprograms_and_cycles():
    main = 'T1 M6\nSUB1 P2\nCALL "SUB1"\nMCALL CYCLE81(20,1,2,-5)\nG0 X3 Y4\nMCALL\nX9\nM30'
    hole = ["G0 Z3.0 ;above", "G1 Z-5.0 ;hole", "G0 Z20.0 ;back"]
    found = written_out({"main.mpf": main, "SUB1.SPF": "G1 X=IC(1)\nM17\n"}, "main.mpf")
    assert found == ["T1 M6", *["G1 X=IC(1)"] * 3, "G0 X3 Y4", *hole, "X9", "M30"]


def test_the_middle_of_an_arc_by_its_radius_moves_the_more_the_nearer_it_is_to_half_a_turn():
    start = Move("line", {"X": 0.0, "Y": 0.0, "Z": 0.0}, 0.0)

    def limit(height):  # over a chord of 20 mm
        middle = {"X": 10.0, "Y": height, "Z": 0.0}
        return refereed._middle_um(start, Move("arc", {"X": 20.0, "Y": 0.0, "Z": 0.0}, 0.0, middle=middle), 0.4)

    assert limit(0.5) == pytest.approx(0.5 + 0.4 + 2 * 0.4 * 0.1, rel=0.01)  # nearly straight
    assert limit(9.0) == pytest.approx(0.5 + 0.4 + 2 * 0.4 * 10 / 1.0556, rel=0.01)  # 10.0556 - 9 over the chord
    assert limit(10.0) > 80


ISO = "G21 G90 G17 G94 G54\nT1 M6\nG0 G43 H1 X1. Y2. Z30.\nG1 X20. F500.\nG2 X30. Y12. I10. J0.\nG1 Y5.\nM30\n"
PROGRAMS = {
    "fanuc": ISO,
    "linuxcnc_files": ISO,
    "klartext": "BEGIN PGM A MM\nTOOL CALL 1 Z\nL X+1 Y+2 Z+30 FMAX\nL X+20 F500\nCC X+30 Y+2\nC X+30 Y+12 DR-\nL Y+5\nEND PGM A MM\n",
    "siemens": "G17 G90 G71 G94 G54\nT1 M6 D1\nG0 X1 Y2 Z30\nG1 X20 F500\nG2 X30 Y12 I10 J0\nG1 Y5\nM30\n",
}


SPOILT = [
    (r"20(?=\.\d*.* F500)", "21", {"end of line", "unclear"}),  # LinuxCNC refuses the arc then
    (r"F500", "F600", {"feed"}),
    (r"\n(G1|L) Y.*", "", {"order of moves"}),
    (r"G2 |DR-", lambda found: {"G2 ": "G3 ", "DR-": "DR+"}[found[0]], {"middle of an arc", "end of arc"}),
]


@pytest.mark.parametrize(
    ("name", "old", "new", "kind"),
    [(name, *each) for name in PROGRAMS for each in SPOILT[: 3 if name == "siemens" else 4]],  # it gives no centres
)
def test_what_is_spoilt_differs(name, old, new, kind, monkeypatch, request):
    if name == "linuxcnc_files":
        request.getfixturevalue("linuxcnc")
    if name == "siemens" and not nc_gcode.available():
        pytest.skip("nc-gcode-interpreter is not here: .ci/run makes .nc_gcode")
    module = examiner(name)
    case = module.draw(0)
    rng = refereed.random.Random(1)
    offset, control = (
        "0" if name == "klartext" else "G54",
        f'family = "{name.partition("_")[0]}"' * (PROGRAMS[name] == ISO),
    )
    case = replace(case, program=PROGRAMS[name], machine=machine_text("gantry", control),
                   calibration=calibration("gantry", rng, slopes=False), options=options_of(rng, "gantry", (offset,), unroll=False), files={})  # fmt: skip
    assert module.judge(case) == Outcome(Verdict.COMPARED)
    run, written = corrected_set(case)
    spoilt = re.sub(old, new, run.text)
    assert spoilt != run.text
    monkeypatch.setattr(refereed, "corrected_set", lambda _: (run._replace(text=spoilt), written | {case.name: spoilt}))
    assert module.judge(case).kind in kind
