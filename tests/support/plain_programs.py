"""Programs of plain lines with others between them, and a run of the whole job with the plain lines read in bulk or not."""

import io
import json
import math
import re

import msgspec
import pytest
from hypothesis import strategies as st

from kinematics.user_error import UserError
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from support.programs import AT_MOST, setup_of, source_of

SLOW = (
    *("(comment)", "M8", "M9", "G4 P1", "G91", "G90", "G20", "G21", "", "T2 M6", "G43.4 H1", "G49", "S100", "M0 (x)"),
    *(
        "G2 X10. Y0. I5. J0.",
        "G1 X5 Y7 F100",
        "G53 G0 Z0.",
        "G55",
        "X[1+2]",
        "N7 (a) X3.5",
        "G17 X1. Y2.",
        "G93",
        "G94",
    ),
    *("/ M8", "G28 Z0.", "x1.5 y2.5", "G1 X1. X2.", "G1 Q5", "#1=5", "M77", "G0 X1. Y1. Z1. B0. C0."),
)
"""Lines that are read one by one: some are refused, or change the meaning of the lines after them."""


@st.composite
def numbers(draw, around):
    """A coordinate near a number, in one of the forms that programs use."""
    value = around + draw(st.floats(-0.3, 0.3))
    form = draw(st.sampled_from(("{:.4f}", "{:.4f}", "{:.3f}", "{:.2f}", "{:.5f}", "{:+.4f}", "bare", "point", "long")))
    if form == "bare":
        return f"{value:.3f}".replace("0.", ".", 1) if abs(value) < 1.0 else f"{value:.3f}"
    if form == "point":
        return f"{round(value)}."
    return f"{value:.4f}".rstrip("0") if form == "long" else form.format(value)


@st.composite
def plain_lines(draw, axes="XYZBC", most=12, near=(0.0, 0.0, 10.0, -10.0, 100.0, 1000.0)):
    """A run of lines in one style, with numbers near one of `near`, which they cross, and with omitted words."""
    blank, gap = draw(st.sampled_from([" ", " ", "", "  ", "\t"])), draw(st.sampled_from(["", "", "", " "]))
    lower = draw(st.booleans())
    around = {axis: draw(st.sampled_from(near)) for axis in axes}
    lines = []
    for number in range(draw(st.integers(1, most))):
        named = draw(st.lists(st.sampled_from(axes), min_size=1, unique=True))
        if draw(st.booleans()):
            named = sorted(named, key=axes.index)
        words = [f"{axis}{gap}{draw(numbers(around[axis]))}" for axis in named]
        code = draw(st.sampled_from(["", "", "G1", "G01", "G0", "G00"]))
        words = [*([f"N{number}"] if draw(st.booleans()) else []), *([code] if code else []), *words]
        words += [f"F{draw(st.sampled_from(['100', '250.5', '99.']))}"] if draw(st.booleans()) else []
        line = blank.join(words)
        lines.append(line.lower() if lower else line)
    return lines


@st.composite
def mixtures(draw, axes="XYZBC"):
    """A program: runs of plain lines with other lines between them, and any line ends."""
    lines = draw(
        st.sampled_from([["G21 G90 G17 G54 G94", "G0 X0. Y0. Z200. B0. C0."], ["G20 G90"], ["%", "O1", "G90"]])
    )
    lines = [*lines, *draw(plain_lines(axes))]
    for _ in range(draw(st.integers(0, 4))):
        lines += draw(st.lists(st.sampled_from(SLOW), max_size=2)) + draw(plain_lines(axes))
    end = draw(st.sampled_from(["\n", "\n", "\r\n"]))
    return end.join(lines) + draw(st.sampled_from([end, end, ""]))


BETWEEN_INCREMENTS = (
    *("G90", "G91", "G90 X1. Y1.", "(comment)", "M8", "G28 Z0.", "G0 X1.", "G3 X1. Y0. I0.5 J0.", "G53 G0 Z0.", "G93"),
    *("G20", "G55", "G52 X1.", "M0", "G1 X0.00005", "G1 Y.12345", "F100"),
)
"""Blocks between increments of ISO and, but for the comment, Siemens: some are refused."""


@st.composite
def incremental_programs(draw, siemens=False):
    """A program in G91: runs of increments, also of axes that have no position yet, with other blocks between them."""
    head = "G71 G90 G17 G54 G94" if siemens else draw(st.sampled_from(["G21 G90 G17 G54 G94", "G20 G90 G17 G94"]))
    lines = [head, draw(st.sampled_from(["G0 X0. Y0. Z200. B0. C0.", "G0 X0. Y0. Z200."])), "G91 G1 X0. F500"]
    between = [line for line in BETWEEN_INCREMENTS if not siemens or line[0] != "("]
    for _ in range(draw(st.integers(1, 4))):
        lines += draw(plain_lines(near=(0.0, 0.0, 1.0))) + draw(st.lists(st.sampled_from(between), max_size=1))
    return "\n".join(lines) + "\n"


BETWEEN_HOLES = (
    *(
        "G80",
        "G80 G0 X1. Y1.",
        "G99",
        "G98",
        "G91",
        "G90",
        "G17",
        "G19",
        "(comment)",
        "M8",
        "G0 Z150.",
        "G1 X3.",
        "G4 P1",
    ),
    *(
        "R212.",
        "Z190. R205.",
        "X1. Z195.",
        "F0",
        "X1. F0",
        "X2. F99",
        "X1. K2",
        "X1. L0",
        "X1. R3.",
        "B1.",
        "I1.",
        "G20",
    ),
    *(
        "G81 X0. Z180. R210.",
        "G83 X0. Z170. R260. Q2.",
        "G52 X1.",
        "G28 Z0.",
        "G51.1 Z0.",
        "G16",
        "M77",
        "X1. Q1.",
        "G55",
    ),
)
"""Blocks between holes: some are refused, or change the meaning of the holes after them."""


@st.composite
def hole_programs(draw):
    """A program of a drilling cycle: runs of positions with other blocks between them."""
    scale = draw(st.sampled_from([1.0, 1.0, 1.0, 25.4]))
    lines = [
        f"G{21 if scale == 1.0 else 20} G90 G17 G54 G94",
        *draw(st.sampled_from([[], [], ["G43 H1"], ["G43.4 H1"]])),
    ]
    axes = draw(st.sampled_from(["XYZBC", "XYZ"]))
    at = {"X": 0.0, "Y": 0.0, "Z": 220.0 / scale, "B": 0.0, "C": 0.0}
    lines.append("G0 " + " ".join(f"{axis}{at[axis]:.4f}" for axis in axes))
    code, back = draw(st.sampled_from([81, 83, 73])), draw(st.sampled_from(["G98", "G99", "G99", ""]))
    clear = draw(st.sampled_from([210.0, 210.0, 220.0, 230.0])) / scale
    peck = " Q2." if code != 81 else ""
    lines.append(f"{back} G{code} X1. Y1. Z{180 / scale:.3f} R{clear:.3f}{peck} F300.")
    near = draw(st.sampled_from([(0.0, 10.0), (300.0 / scale, -200.0 / scale)]))
    for _ in range(draw(st.integers(1, 4))):
        lines += draw(
            plain_lines(axes="XY", near=near).map(lambda some: [re.sub(r"[gG]\d+[ \t]*", "", s) for s in some])
        )
        lines += draw(st.lists(st.sampled_from(BETWEEN_HOLES), max_size=1))
    return "\n".join(lines) + "\nG80\nM30\n"


ODD_ARCS = (
    *("G2 X1. Y2.", "G1 X1. I5.", "X5. Y5. I1. R9.", "G3 X1. Y1. I1. J1. K2.", "G2 X900. Y0. R1.", "G3 X9. I0. J0."),
    *("M8", "(comment)", "G91.1", "G90.1 X0. Y0.", "G3 I5.", "G2 X1. Y1. R0.", "G18", "G1 X5. K0.", "G40", "G3 R5."),
)
"""Lines between arcs: some are refused, or change the meaning of the arcs after them."""
PLANES = {"G17": "XYZIJK", "G18": "ZXYKIJ", "G19": "YZXJKI"}


@st.composite
def arc_programs(draw, siemens=False):
    """A program of straight lines and arcs by their centres or radii, with odd lines between them."""
    plane = draw(st.sampled_from([*PLANES, "G17", "G17"]))
    first, second, normal, i, j, _ = PLANES[plane]
    unit, around = draw(st.sampled_from([1.0, 1.0, 25.4])), draw(st.sampled_from([0.0, 10.0, 100.0, 10.0]))
    scale, height = 1.0 / unit, 200.0 / unit
    blank, decimals = draw(st.sampled_from([" ", " ", ""])), draw(st.sampled_from([3, 4, 4, 5]))
    metric = ("G71", "G70") if siemens else ("G21", "G20")
    lines = [f"{plane} {metric[unit > 1.0]} G90 G54 G94"] if draw(st.integers(0, 9)) else ["G90"]
    at = dict.fromkeys("XYZ", around * scale) | {"Z": height}
    lines.append("G0" + "".join(f" {axis}{value:.4f}" for axis, value in at.items()))
    odd = [line for line in ODD_ARCS if not siemens or not {"R", "("} & {*line}]
    forms = ["line", "line", "arc", "arc", "arc", "radius", "radius", "full", *draw(st.sampled_from([[], [], ["odd"]]))]
    for _ in range(draw(st.integers(1, 14))):
        what = draw(st.sampled_from(forms))
        if what == "odd":
            lines.append(draw(st.sampled_from(odd)))
            continue
        x, y, z = (round(at[axis] + scale * draw(st.floats(-3.0, 3.0)), decimals) for axis in (first, second, normal))
        code = ""
        words = {first: x, second: y}
        if what == "line":
            code, words = draw(st.sampled_from(["G1", "G1", "G0", "G01"])), {**words, normal: z}
            words = {axis: words[axis] for axis in draw(st.lists(st.sampled_from([*words]), min_size=1, unique=True))}
        else:
            code = draw(st.sampled_from(["G2", "G3", "G02", "G3"]))
            radius = round(scale * draw(st.sampled_from([0.02, 0.5, 2.0, 2.0, 20.0, 300.0])), decimals)
            begun, turned = draw(st.floats(0.0, 6.28)), draw(st.sampled_from([0.001, 0.3, 1.0, 2.0, 3.14159, 5.9, 6.2]))
            centre = at[first] - radius * math.cos(begun), at[second] - radius * math.sin(begun)
            last = begun + turned * (1.0 if code.endswith("3") else -1.0)
            if what != "full":
                words = {first: centre[0] + radius * math.cos(last), second: centre[1] + radius * math.sin(last)}
            else:
                words = {first: at[first], second: at[second]}
            if draw(st.integers(0, 4)) == 0:
                words[normal] = z
            if what == "radius" and not siemens:
                words["R"] = radius * (-1.0 if turned > math.pi else 1.0)
            else:
                words |= {i: centre[0] - at[first], j: centre[1] - at[second]}
        at |= {axis: round(value, decimals) for axis, value in words.items() if axis in at}
        texts = [f"{axis}{value:.{decimals}f}" for axis, value in words.items() if axis in at or round(value, decimals)]
        if code in lines[-1].split() and draw(st.booleans()):
            code = ""
        lines.append(blank.join([*([code] if code else []), *texts]))
    return "\n".join(lines) + "\n"


def outcome(text, machine, model, *, plain=True, shortest=1, piece=1 << 20, dialect="iso", **options):
    """Text and report of the corrected program, or why it is refused; `plain`: plain lines are read in bulk."""
    source, out, read_as = source_of(text), io.BytesIO(), find_dialect(dialect, "", "")
    read_as = read_as if plain else msgspec.structs.replace(read_as, plain=None)
    setup = setup_of(machine)
    job = Job(source, read_as, machine, model, setup, **{**AT_MOST, "travel_check": False, **options})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("postproc.program_lines.SHORTEST_RUN_LINES", shortest)
        patch.setattr("postproc.text.source.PIECE", piece)
        try:
            report = Pipeline(job).run(out, lambda _: None)
        except UserError as refusal:
            return str(refusal)
    content = report.json()
    content["calibration"].pop("age_days")
    return out.getvalue().splitlines(keepends=True), json.dumps(content)


SIEMENS_SLOW = (
    *(
        "; comment",
        "M8",
        "G91",
        "G90",
        "G2 X10 Y0 I5 J0",
        "X=IC(5)",
        "X=AC(5) Y3",
        "TRANS X5",
        "TRANS",
        "ROT Z30",
        "RND=2",
    ),
    *(
        "RNDM=1",
        "RNDM=0",
        "G70",
        "G71",
        "TRAORI",
        "TRAFOOF",
        "G41 X5",
        "G40 X1 Y1",
        "R1=5",
        "X=R1",
        "CHF=1",
        "G53 G0 Z0",
    ),
    *(
        'MSG("A")',
        "AP=30 RP=10",
        "G18",
        "G17",
        "CIP X1 Y2 I1=3 J1=4",
        "G64",
        "G9 X5",
        "E5",
        "X1EX1",
        "N5 X1 X2",
        "G4 F1",
    ),
    *("G55", "T1 M6", "D1", "M77", "G93", "G94", "FB=5 X3"),
)


@st.composite
def siemens_mixtures(draw, axes="XYZBC"):
    """A Siemens program: runs of plain lines with other blocks between them."""
    lines = [draw(st.sampled_from(["G17 G90 G71 G94 G54", "%_N_A_MPF", "; none", "G70"])), "G0 X0 Y0 Z200 B0 C0"]
    for _ in range(draw(st.integers(1, 5))):
        lines += draw(plain_lines(axes)) + draw(st.lists(st.sampled_from(SIEMENS_SLOW), max_size=2))
    end = draw(st.sampled_from(["\n", "\n", "\r\n"]))
    return end.join(lines) + draw(st.sampled_from([end, end, ""]))


KLARTEXT_SLOW = (
    *(
        "; comment",
        "M8",
        "CC X+5 Y+5",
        "C X+5 Y+6 DR+",
        "L M91 Z+0",
        "L IX+5",
        "L X+1,5",
        "L R0 FMAX M3",
        "L Z+100 R0 FMAX M9",
    ),
    *(
        "CYCL DEF 7.0 DATUM SHIFT~",
        "CYCL DEF 7.1 X+5",
        "L X+Q1",
        "* - heading",
        "L X+5 RL F100",
        "L X+6 R0",
        "RND R2",
        "M129",
    ),
    *(
        "L X+1 X+2",
        "L X+1 R+",
        "LN X+1 Y+2 Z+3 NX0 NY0 NZ1",
        "TOOL CALL 1 Z S1000~",
        "; goes on ~",
        "L F MAX X+3",
        "LX+5FMAX",
    ),
)


@st.composite
def klartext_lines(draw, axes="XYZBC", most=10):
    """A run of straight lines of Klartext."""
    numbered, plus, comma = draw(st.booleans()), draw(st.booleans()), draw(st.booleans())
    around = {axis: draw(st.sampled_from((0.0, 0.0, 10.0, -10.0, 100.0))) for axis in axes}
    lines = []
    for number in range(draw(st.integers(1, most))):
        named = draw(st.lists(st.sampled_from(axes), min_size=1, unique=True))
        words = [f"{axis}{draw(numbers(around[axis]))}" for axis in named]
        words = [word if not plus or word[1] in "+-" else f"{word[0]}+{word[1:]}" for word in words]
        words += draw(st.sampled_from([[], [], ["R0"], ["FMAX"], ["R0", "FMAX"], ["F250"], ["R0", "F99.5"]]))
        words = [word.replace(".", ",") if comma and draw(st.integers(0, 9)) else word for word in words]
        lines.append(" ".join([*([str(number + 1)] if numbered else []), "L", *words]))
    return lines


@st.composite
def klartext_mixtures(draw):
    """A Klartext program: runs of straight lines with other blocks between them, and any line ends."""
    lines = [
        draw(st.sampled_from(["BEGIN PGM A MM", "0 BEGIN PGM A MM", "BEGIN PGM A INCH", "; none"])),
        "L X+0 Y+0 Z+200",
    ]
    lines += ["L B+0 C+0 R0 FMAX", *draw(klartext_lines())]
    for _ in range(draw(st.integers(0, 4))):
        lines += draw(st.lists(st.sampled_from(KLARTEXT_SLOW), max_size=2)) + draw(klartext_lines())
    end = draw(st.sampled_from(["\n", "\n", "\r\n"]))
    return end.join(lines) + draw(st.sampled_from([end, end, ""]))


BETWEEN_VECTORS = {
    "siemens": ("; comment", "M8", "G91", "G90", "ORIMKS", "ORIWKS", "TRAFOOF", "TRAORI", "X5 A3=0 B3=0 C3=0", "X1 C=5 A3=1", "TRANS X1", "G1 A3=1 C3=1", "X1 A3=1 C3=-1"),
    "heidenhain": ("; comment", "M8", "M129", "M128", "L X+1 B+5 F100", "LN X+1 TX+0 TY+0 TZ+0", "LN X+1 C+5 TX+0 TY+0 TZ+1", "LN X+1 NX+0 NY+0", "LN IX+1 NX+0 NY+0 NZ+1", "LN X+1 TX+0 TY+1 TZ-1"),
}  # fmt: skip
"""Blocks between lines with vectors: some are refused."""


@st.composite
def vector_programs(draw):
    """A program with runs of lines with vectors, others between them, and its dialect."""
    dialect = draw(st.sampled_from([*BETWEEN_VECTORS]))
    siemens = dialect == "siemens"
    head = (
        ["G17 G90 G71 G54 G94", "G0 X0 Y0 Z200 B0 C0", "TRAORI", "G1 F500"]
        if siemens
        else ["BEGIN PGM A MM", "L X+0 Y+0 Z+200 B+0 C+0 FMAX", draw(st.sampled_from(["M128", "M128", "M126"]))]
    )
    lines, form = head, draw(st.sampled_from(["{:.4f}", "{:+.6f}", "{:.3f}"]))
    for _ in range(draw(st.integers(1, 4))):
        a, b = draw(st.floats(-0.4, 0.4)), draw(st.floats(-0.4, 0.4))
        steps = draw(st.sampled_from([(0.0, 0.0), (0.02, 0.01), (-a / 4, -b / 4)]))
        vectors = draw(st.sampled_from(["T", "T", "NT", "N", ""]))
        for k in range(draw(st.integers(1, 10))):
            parts = [a + k * steps[0], b + k * steps[1], 0.9]
            words = [f"{axis}{draw(numbers(near))}" for axis, near in zip("XYZ", (0.0, 10.0, 200.0), strict=True)]
            words = draw(st.lists(st.sampled_from(words), min_size=1, unique=True))
            if siemens and vectors:
                words += [f"{axis}3={form.format(part)}" for axis, part in zip("ABC", parts, strict=True)]
            for kind in "" if siemens else vectors:
                words += [f"{kind}{axis}{form.format(part)}" for axis, part in zip("XYZ", parts, strict=True)]
            words += draw(st.sampled_from([[], ["F500"], [] if siemens else ["R0"]]))
            begin = "" if siemens else "LN" if vectors else "L"
            lines.append(" ".join([begin, *words]).strip())
        lines += draw(st.lists(st.sampled_from(BETWEEN_VECTORS[dialect]), max_size=1))
    return "\n".join([*lines, "M30"] + ([] if siemens else ["END PGM A MM"])) + "\n", dialect
