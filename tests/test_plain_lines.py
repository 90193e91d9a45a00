"""Plain lines that are read, moved and written as columns give what the reader of single lines gives, to the byte."""

import dataclasses
import functools

import msgspec
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support import every_road
from support.iso_lines import blocks
from support.no_process import Here
from support.plain_programs import (
    arc_programs,
    hole_programs,
    incremental_programs,
    klartext_lines,
    klartext_mixtures,
    mixtures,
    outcome,
    plain_lines,
    siemens_mixtures,
    vector_programs,
)
from support.programs import load, model_of, random_model, source_of
from support.real_programs import LINES_OF_REAL_PROGRAMS, first_lines, machine_for, real_programs
from support.tiers import drawn

from postproc.dialects import find_dialect
from postproc.program_lines import read_blocks
from postproc.text.block import Refusal
from postproc.text.blocks import PlainRun
from postproc.text.plain_lines import PlainLines
from postproc.text.source import ENCODING, open_source
from postproc.write.writer import Writer

DMU50 = load("dmu50")
ISO = find_dialect("iso", "", "")
SIEMENS = find_dialect("siemens", "", "")
KLARTEXT = find_dialect("heidenhain", "", "")
ALL_AXES = "XYZABCUVW"
VECTORS = ("A3", "B3", "C3", "NX", "NY", "NZ", "TX", "TY", "TZ")
FANUC = dataclasses.replace(DMU50, control=dataclasses.replace(DMU50.control, family="fanuc"))
FAMILIES = ("", "fanuc", "linuxcnc")
PIECES = (1, 7, 4096, 1 << 20)


@functools.cache
def model_of_errors(seed, size=100.0):
    """Every fourth of the errors of a random model, so of every axis: an example takes half the time of all."""
    model = random_model(DMU50, seed, size)
    return model_of(DMU50, *model.effects[seed % 4 :: 4])


def check_lines(data: bytes, dialect=ISO, axes=ALL_AXES) -> int:
    """Every plain line of a text is read as by its dialect, word by word; returns their number."""
    lines = PlainLines(data, axes, dialect.plain)
    words = lines.columns
    for row in np.flatnonzero(words.plain).tolist():
        low, high = lines.starts[row : row + 2].tolist()
        text = data[low:high].decode(ENCODING)
        block = dialect.read_block(1, text)
        assert lines.regular[row]
        assert block.kind in ("words", "line", "normal_line")
        assert block.code is None
        assert not dialect.flow.search(text)
        addresses = [word.address for word in block.words]
        assert len(set(addresses)) == len(addresses)
        assert set(addresses) <= {*axes, *dialect.plain.other, *dialect.plain.arcs, *VECTORS, "G", "FMAX", "R0"}
        found = {word.address: word for word in block.words}
        of_tool, of_normal = (
            [found[a.rstrip("=")].value if a.rstrip("=") in found else None for a in of]
            for of in (dialect.plain.tool, dialect.plain.normal)
        )
        if any(value is not None for value in of_tool):
            assert lines.vectors.tool[row].tolist() == [value or 0.0 for value in of_tool]
        else:
            assert lines.vectors is None or np.isnan(lines.vectors.tool[row]).all()
        assert (lines.vectors is not None and lines.vectors.normal[row]) == any(v is not None for v in of_normal)
        assert {*dialect.plain.arcs} & {*addresses} <= {*lines.addresses}
        for column, axis in enumerate(lines.addresses):
            cell = column, row
            assert (words.end[cell] > 0) == (axis in found)
            if axis in found:
                word = found[axis]
                number = text[word.start : word.end]
                assert (words.at[cell], words.start[cell], words.end[cell]) == (
                    low + word.at, low + word.start, low + word.end
                )  # fmt: skip
                assert words.value[cell] == word.value
                assert block.words[lines.order_of(column, np.array([row]))[0]] is word
                assert np.signbit(words.value[cell]) == np.signbit(word.value)
                _, mark, decimals = number.replace(",", ".").partition(".")
                assert words.decimals[cell] == (len(decimals) if mark else -1)
        named = int(found["G"].value) if "G" in found else -1
        assert words.motion[row] == ((0 if "FMAX" in found else 1) if dialect is KLARTEXT else named)
        before_last = text[block.words[-1].at - 1] in " \t" if len(block.words) > 1 else -1
        assert words.blank[row] == before_last
    return int(words.plain.sum())


@settings(max_examples=12)
@st.composite
def written_numbers(draw):
    """Numbers up to the widest and somewhat wider, with the decimal mark anywhere or nowhere, and with leading zeros."""
    digits = draw(st.text("0123456789", min_size=1, max_size=14))
    point = draw(st.integers(0, len(digits)))
    return draw(st.sampled_from(("", "-", "+"))) + draw(st.sampled_from((digits, f"{digits[:point]}.{digits[point:]}")))


@given(st.lists(written_numbers(), min_size=1, max_size=8))
@example(
    [
        "12345678",
        "123456789",
        "1234.5678",
        "123.4567",
        ".12345678",
        ".1234567",
        "5.",
        "0",
        "000000000.1",
        ".1234567890",
        "0" * 40 + "." + "1" * 40,
    ]
)
def test_numbers_of_all_widths_are_the_nearest_floats(numbers):
    words = PlainLines("".join(f"X{number}\n" for number in numbers).encode(), "X", ISO.plain).columns
    expected = np.array([float(number) for number in numbers])
    bare = [number.lstrip("+-") for number in numbers]
    readable = np.array([len(number) <= 12 and len(number.partition(".")[2]) <= 9 for number in bare])
    assert np.array_equal(words.plain, readable & (np.abs(expected) < 1e6))
    assert words.value[0][words.plain].tolist() == expected[words.plain].tolist()


@given(st.lists(st.one_of(blocks(), plain_lines().map("\n".join)), min_size=1, max_size=6))
@example(["X1.2.3", "X.", "X-", "X1 2", "G1 X", "G1.5 X2.", "G02 X1.", "G001 X1.", "X1.Y2.X3.", "F1 F2 X3.", "X1e5"])
@example(["X123456789012.", "X1234567.", "X0.1234567891", "X1." + " " * 120 + "Y2.", "G 1 X2.", "X- 1.", "X+.5", "G1"])
@example(["X1.\rY2.", "X1.\r\r", " X1.", "\tX1. ", "  ", "", "X1.;a", "X1.(a)", "X1.%", "\0X1.", "X1.\x0b", "X\xa01."])
@example(
    ["N1G0X-0.0000Y+0.", "G00X1.Y-.5Z5.F.5", "g01x1.y2.", "X00001.50", "G1 G0 X1.", "N1.5 X1.", "O1 X1.", "$1 X1."]
)
@settings(max_examples=30)
def test_a_plain_line_is_read_as_its_block(lines):
    data = ("\n".join(line.rstrip("\n") for line in lines) + "\n").encode(ENCODING)
    check_lines(data)
    check_lines(data, SIEMENS)


@drawn(8, 200, 3000, text=arc_programs(), seed=st.integers(0, 1), piece=st.sampled_from(PIECES))
def test_arcs_in_bulk_give_the_same_program(text, seed, piece):
    check_lines(text.encode())
    model, options = model_of_errors(seed), {"tolerance_um": 1.0 if seed else 1e3}
    single = outcome(text, DMU50, model, plain=False, **options)
    assert outcome(text, DMU50, model, piece=piece, **options) == single


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(
    "arcs",
    [
        "G2Y0.000Z7.874X0.000J-0.001\nG2Y-0.857Z12.290X0.000J-11.811\nG2Y-0.857Z12.290X0.000J-0.001\n"
        "G1Y-0.857\nG2Y-0.857Z12.290X0.064J-0.001\nG2Y-0.856Z12.290X0.064J0.001\nG1Y-0.856",
        "G2Y-0.003Z7.939X-0.000J-0.787\nG2Y1.310Z8.111X0.000J0.712K-0.336\nG2Y1.280Z8.053X0.037J0.685K-0.388\n"
        "G2Y4.448Z11.246X0.053J-6.646K9.764\nG2Y4.448Z11.246X0.147J-0.001\nG1Y4.333Z11.288\n"
        "G2Y4.333Z11.288X0.211J0.001\nG2Y4.334Z11.288X0.290J0.001\nG1Y4.287",
    ],
)
def test_helices_of_hardly_any_radius_are_corrected(arcs, seed):
    text = f"G19 G20 G90 G54 G94\nG0 X0.0000 Y0.0000 Z7.8740\n{arcs}\n"
    options = {"tolerance_um": 1.0 if seed else 1e3}
    single = outcome(text, DMU50, model_of_errors(seed), plain=False, **options)
    assert outcome(text, DMU50, model_of_errors(seed), piece=1, **options) == single


@drawn(5, 100, 1500, text=arc_programs(siemens=True), seed=st.integers(0, 1), piece=st.sampled_from(PIECES))
def test_siemens_arcs_in_bulk_give_the_same_program(text, seed, piece):
    check_lines(text.encode(), SIEMENS)
    model = model_of_errors(seed)
    single = outcome(text, DMU50, model, plain=False, dialect="siemens")
    assert outcome(text, DMU50, model, piece=piece, dialect="siemens") == single


@pytest.mark.parametrize(
    "line",
    [
        "X1.",
        "G2 X1. Y2. I1. J0.",
        "X1.R5.",
        "G03 X1. K2 I0 Y5 J2.5 F100",
        "N10 G1 X1. Y-2.5 F100",
        "g00x1.y+2.",
        "X 1.5 Y\t-.5",
        "X1.5\r",
        "Z3",
        "N1 B-0.0000 C5.",
        "G1X.5S100",
    ],
)
def test_the_lines_of_cam_programs_are_plain(line):
    assert check_lines(f"{line}\n".encode()) == 1


@settings(max_examples=12)
@given(st.lists(klartext_lines().map("\n".join), min_size=1, max_size=4))
@example(
    ["5 L X1. FMAX", "5 L X+1 FMAX5", "L FMAXX5", "L X1 R0", "L X1 R0.5", "L X1 RL", "L X1 R 0", "L X1 RR", "X5 L Y1"]
)
@example(
    [
        "1.5 L X1",
        ".5 L X1",
        "-5 L X1",
        "5L X1",
        "5 LX1",
        "L L X1",
        "5 5 L X1",
        "L",
        "007 L X1",
        "L X1 F100 FMAX",
        "LBL 1",
    ]
)
@example(
    [
        "L X1 ~",
        "L X1,5",
        "L X1,5.5",
        "L X,5 Y1, Z-,5 F1,5",
        "L X, Y1",
        "L X1 F\x01\x01\x01",
        "l x1 fmax",
        "L X1 Fmax",
        "L X1 M3",
        "L IX1",
        "LN X1",
        "L X-.5 Y+.5 R0 F.5",
    ]
)
def test_a_plain_line_of_klartext_is_read_as_its_block(lines):
    check_lines(("\n".join(lines) + "\n").encode(ENCODING), KLARTEXT)


@pytest.mark.parametrize(
    "line",
    ["L X1", "5 L X+1,5 Y-,25 Z0,", "996 L X-28.606 Y-15.41", "5 L Z-1. FMAX", "LX+5 R0 F100\r", "l b5.5 r0 fmax"],
)
def test_the_lines_of_klartext_posts_are_plain(line):
    assert check_lines(f"{line}\n".encode(), KLARTEXT) == 1


@drawn(2, 60, 500, text=klartext_mixtures(), seed=st.integers(0, 1), piece=st.sampled_from(PIECES))
def test_klartext_in_bulk_gives_the_same_program(text, seed, piece):
    model = model_of_errors(seed)
    single = outcome(text, DMU50, model, plain=False, dialect="heidenhain")
    assert outcome(text, DMU50, model, piece=piece, dialect="heidenhain") == single


@drawn(2, 60, 500, text=siemens_mixtures(), seed=st.integers(0, 1), piece=st.sampled_from(PIECES))
def test_siemens_programs_in_bulk_give_the_same_program(text, seed, piece):
    model = model_of_errors(seed)
    single = outcome(text, DMU50, model, plain=False, dialect="siemens")
    assert outcome(text, DMU50, model, piece=piece, dialect="siemens") == single


@LINES_OF_REAL_PROGRAMS
def test_real_programs_are_read_alike(nc_data, lines, tmp_path):
    for path in first_lines(real_programs(nc_data), lines, tmp_path):
        check_lines(path.read_bytes() + b"\n")
    for folder, dialect in (("heidenhain", KLARTEXT), ("siemens", SIEMENS)):
        for path in sorted((nc_data / folder).rglob("*.*")):
            check_lines(path.read_bytes() + b"\n", dialect)


def test_nine_of_ten_moves_of_real_programs_are_plain(nc_data):
    """Share of the lines with coordinates in the long ISO programs that are read in bulk."""
    counted = {}
    for name in ("PARALLEL.NC", "BOTTLE.NC", "impeller-7bl-xyzac.ngc"):
        (path,) = (path for path in real_programs(nc_data) if path.name == name)
        names = machine_for(path).names
        axes = "".join(names) if name.startswith("imp") else "XYZBC"
        items = list(read_blocks(open_source(str(path)), ISO, axes))
        runs = sum(len(item) for item in items if isinstance(item, PlainRun))
        moves = sum(
            any(word.address in ALL_AXES for word in item.words) for item in items if not isinstance(item, PlainRun)
        )
        counted[name] = runs / (runs + moves)
    assert min(counted.values()) > 0.95, counted


@drawn(6, 80, 800, program=vector_programs(), seed=st.integers(0, 1), piece=st.sampled_from(PIECES))
def test_vectors_in_bulk_give_the_same_program(program, seed, piece):
    text, dialect = program
    check_lines(text.encode(), SIEMENS if dialect == "siemens" else KLARTEXT)
    model, options = model_of_errors(seed), {"dialect": dialect, "tolerance_um": 1e4}
    single = outcome(text, DMU50, model, plain=False, **options)
    assert outcome(text, DMU50, model, piece=piece, **options) == single


@drawn(4, 60, 500, program=vector_programs(), piece=st.sampled_from(PIECES))
def test_vectors_in_bulk_become_positions(program, piece):
    text, dialect = program
    options = {"dialect": dialect, "tcp": "to-axes", "tolerance_um": 1e5}
    single = outcome(text, TABLE, model_of(TABLE), plain=False, **options)
    assert outcome(text, TABLE, model_of(TABLE), piece=piece, **options) == single


@pytest.mark.parametrize("dialect", ["siemens", "heidenhain"])
def test_lines_with_vectors_are_read_and_written_together(dialect, monkeypatch):
    head, line, end = VECTOR_FORMS[dialect]
    rows = [(0.1 * i, 0.01 * i, 0.2 - 0.001 * i) for i in range(60)]
    lines = "".join(line.format(x=x, b=b, a=a) + "\n" for x, b, a in rows)
    written, one_row = [], Writer._write_row
    monkeypatch.setattr(Writer, "_write_row", lambda self, *row: (written.append(row), one_row(self, *row))[1])
    options = {"dialect": dialect, "tolerance_um": 1e4}
    together = outcome(head + lines + end, DMU50, model_of_errors(2, 200.0), **options)
    assert not isinstance(together, str)
    assert len(written) < 6
    assert together == outcome(head + lines + end, DMU50, model_of_errors(2, 200.0), plain=False, **options)


@pytest.mark.parametrize(
    "lines",
    [
        ["G1 X1 A3=0 B3=0 C3=1", "X1 A3=-.5 B3=+1. C3= 1", "X1 a3=1", "X1A3=1", "X1 A3=1B3=2", "X1 A3=1 A3=2"],
        ["X1 A3 =1", "X1 A3=1.2.3", "X1 A3==1", "X1 A3=1EX2", "X1 A3=R1", "A3=1", "X1 A4=1", "X\x021", "X1 A3=1 ; a"],
        [
            "LN X1 NX0 NY0 NZ1",
            "5 LN X+1 NX+0 NY+0 NZ+1 TX-,5 TY+0 TZ+1 F100 R0",
            "LNX1 NX0 NY0 NZ1",
            "LN X1",
            "L X1 NX1",
        ],
        [
            "ln x1 tx0 ty0 tz1 fmax",
            "LN X1 NX0 NY0",
            "LN X1 NX0 NX0 NY0 NZ0",
            "LN X1 TX0 TY0 TZ1 M3",
            "L N X1",
            "LN IX1",
        ],
    ],
)
def test_lines_with_vectors_are_read_as_their_blocks(lines):
    data = ("\n".join(lines) + "\n").encode(ENCODING)
    plain = check_lines(data, KLARTEXT if "LN" in lines[0] or "ln" in lines[0] else SIEMENS)
    assert bool(plain) == (lines[0] != "X1 A3 =1")


@drawn(4, 80, 800, text=mixtures(), seed=st.integers(0, 1), piece=st.sampled_from(PIECES))
def test_plain_lines_in_bulk_give_the_same_program(text, seed, piece):
    model = model_of_errors(seed)
    single = outcome(text, DMU50, model, plain=False)
    assert outcome(text, DMU50, model, piece=piece) == single
    assert outcome(text, DMU50, model, piece=piece, shortest=3, tolerance_um=1e3) == outcome(
        text, DMU50, model, plain=False, tolerance_um=1e3
    )


@drawn(3, 60, 600, text=incremental_programs(), seed=st.integers(0, 1), piece=st.sampled_from(PIECES))
def test_increments_in_bulk_give_the_same_program(text, seed, piece):
    model = model_of_errors(seed)
    single = outcome(text, DMU50, model, plain=False, tolerance_um=1e3)
    assert outcome(text, DMU50, model, piece=piece, tolerance_um=1e3) == single


@drawn(2, 40, 400, text=incremental_programs(siemens=True), seed=st.integers(0, 1), piece=st.sampled_from(PIECES))
def test_siemens_increments_in_bulk_give_the_same_program(text, seed, piece):
    model = model_of_errors(seed)
    single = outcome(text, DMU50, model, plain=False, dialect="siemens", tolerance_um=1e3)
    assert outcome(text, DMU50, model, piece=piece, dialect="siemens", tolerance_um=1e3) == single


@drawn(
    4,
    80,
    800,
    text=hole_programs(),
    seed=st.integers(0, 3),
    piece=st.sampled_from(PIECES),
    family=st.sampled_from(FAMILIES),
)
def test_holes_in_bulk_give_the_same_program(text, seed, piece, family):
    machine = dataclasses.replace(DMU50, control=dataclasses.replace(DMU50.control, family=family))
    model = model_of_errors(seed, 200.0)
    single = outcome(text, machine, model, plain=False, tolerance_um=1e3)
    assert outcome(text, machine, model, piece=piece, tolerance_um=1e3) == single


@pytest.mark.parametrize(("back", "clear"), [("G98", 210), ("G99", 210), ("G99", 240)])
def test_holes_are_written_together(monkeypatch, back, clear):
    holes = "".join(f"X{5.0 * i:.4f}{' Y-' + str(i) + '.5' * (i % 2)}\n" for i in range(60))
    text, written, one_row = f"{HEAD}{back} G81 X1. Z150. R{clear}.\n{holes}G80\nM30", [], Writer._write_row
    monkeypatch.setattr(Writer, "_write_row", lambda self, *row: (written.append(row), one_row(self, *row))[1])
    model = model_of_errors(2, 200.0)
    together = outcome(text, FANUC, model)
    assert isinstance(together, tuple)
    assert len(written) < 8
    assert any(b"R" in line and b"Z" in line for line in together[0][10:])
    assert together == outcome(text, FANUC, model, plain=False)


def test_increments_are_written_together(monkeypatch):
    steps = "".join(f"X{0.01 * (i % 7):.4f} Y-{0.02 * (i % 3):.3f}{' Z0.01' * (i % 2)}\n" for i in range(60))
    text, written, one_row = f"{HEAD}G91\n{steps}M30", [], Writer._write_row
    monkeypatch.setattr(Writer, "_write_row", lambda self, *row: (written.append(row), one_row(self, *row))[1])
    model = model_of_errors(2, 200.0)
    together = outcome(text, DMU50, model)
    assert len(written) < 8
    assert together == outcome(text, DMU50, model, plain=False)


TABLE = dataclasses.replace(
    DMU50,
    axes=tuple(dataclasses.replace(axis, rollover="as-written" if axis.rotary else "") for axis in DMU50.axes),
    control=dataclasses.replace(DMU50.control, family="fanuc"),
)
VECTOR_FORMS = {
    "siemens": ("G17 G90 G71 G54 G94\nT1 D1\nM6\nG0 X0 Y0 Z200 B0 C0\nTRAORI\nG1 F500\n", "X{x:.4f} Y1.0000 Z200.0000 A3={a:.6f} B3={b:.6f} C3=0.9", "M30\n"),
    "heidenhain": ("BEGIN PGM A MM\nTOOL CALL 1 Z S100\nL X+0 Y+0 Z+200 B+0 C+0 R0 FMAX\nM128\n", "LN X{x:+.4f} Y+1.0000 Z+200.0000 NX{a:+.6f} NY{b:+.6f} NZ+0.9 TX{a:+.6f} TY{b:+.6f} TZ+0.9 F500", "M30\nEND PGM A MM\n"),
}  # fmt: skip
"""Head, a line, and end of programs with vectors."""
CONVERTED = {
    "iso": ("G21 G90 G17 G54 G94\nT1 M6\nG0 X1. Y1. Z200. B0. C0.\n{tcp} H1 X1. Y1. Z200. B0. C0.\nG1 X2. F200\n", ("G43", "G43.4"), "G49\nM30\n"),
    "siemens": ("G17 G90 G71 G94 G54\nG0 X1 Y1 Z200 B0 C0\n{tcp}G0 X1 Y1 Z200 B0 C0\nG1 X2 F200\n", ("", "TRAORI\n"), "M30\n"),
    "heidenhain": ("BEGIN PGM A MM\nL X+1 Y+1 Z+200 B+0 C+0 R0 FMAX\n{tcp}L X+1 Y+1 Z+200 B+0 C+0 FMAX\nL X+2 F200\n", ("", "M128\n"), "END PGM A MM\n"),
}  # fmt: skip
"""Head without and with TCP, and end, of programs that are converted."""
BETWEEN = {
    "iso": ["(comment)", "M8", "G4 P1", "G1 X3. F99.", "S100", "G0 C5."],
    "siemens": ["; comment", "M8", "G4 F1", "G1 X3 F99", "G0 C5"],
    "heidenhain": ["; comment", "M8", "L X+3 F99", "L C+5 FMAX"],
}


@st.composite
def converted_programs(draw):
    """A program of the tool point or of the axes, its dialect, and the direction of its conversion."""
    dialect, to_axes = draw(st.sampled_from([*CONVERTED])), draw(st.booleans())
    head, switches, end = CONVERTED[dialect]
    runs = (klartext_lines if dialect == "heidenhain" else plain_lines)("XYZC")
    lines = [
        line for _ in range(draw(st.integers(1, 3))) for line in [*draw(runs), draw(st.sampled_from(BETWEEN[dialect]))]
    ]
    return (
        head.format(tcp=switches[to_axes]) + "\n".join(lines) + f"\n{end}",
        dialect,
        "to-axes" if to_axes else "to-tcp",
    )


@drawn(4, 60, 500, program=converted_programs(), how=st.sampled_from(["", "", "scaled"]), piece=st.sampled_from(PIECES))
def test_conversions_in_bulk_give_the_same_program(program, how, piece):
    text, dialect, to = program
    options = {"dialect": dialect, "tcp": to, "tcp_feed": how, "tolerance_um": 1e5}
    single = outcome(text, TABLE, model_of(TABLE), plain=False, **options)
    assert outcome(text, TABLE, model_of(TABLE), piece=piece, **options) == single


@pytest.mark.parametrize("dialect", CONVERTED)
@pytest.mark.parametrize("to", ["to-axes", "to-tcp"])
def test_the_lines_of_a_conversion_are_written_together(monkeypatch, dialect, to):
    head, switches, end = CONVERTED[dialect]
    line = "L X{:+.3f} C{:+.3f}" if dialect == "heidenhain" else "X{:.3f} C{:.3f}"
    moves = "\n".join(line.format(2.0 + 0.01 * i, 0.01 * i) for i in range(40))
    text, written, one_row = head.format(tcp=switches[to == "to-axes"]) + moves + f"\n{end}", [], Writer._write_row
    monkeypatch.setattr(Writer, "_write_row", lambda self, *row: (written.append(row), one_row(self, *row))[1])
    options = {"dialect": dialect, "tcp": to, "tolerance_um": 10.0}
    together = outcome(text, TABLE, model_of(TABLE), **options)
    assert len(written) < 8
    assert together == outcome(text, TABLE, model_of(TABLE), plain=False, **options)
    assert b"NCOMP FROM" not in b"".join(together[0])
    assert len([each for each in together[0] if b"F" in each]) > 35  # each has its own time


STORED = {
    "iso": (
        "G21 G90 G17 G54 G94\nG0 X1. Y1. Z200. B0. C0.\nG1 X2. F200\n#1=0\n",
        ["N77 M8", "M98 P1000", "M98 P2000"],
        ["#1=#1+1\nIF[#1LT3]GOTO77", "M98 P1000 L2", "M98 P1000", "G65 P2000 A1."],
        "M30\nO1000\n{0}\nM99\nO2000\n{1}\nM98 P1000\n{2}\nM99\n",
    ),
    "siemens": (
        "G17 G90 G71 G94 G54\nG0 X1 Y1 Z200 B0 C0\nG1 X2 F200\nR1=0\n",
        ["MARK1:", "MARK1: M8"],
        ["REPEATB MARK1 P=2", "REPEAT MARK1 P=2", "FOR R2=1 TO 2\nX5\nENDFOR", "R1=R1+1\nIF R1<3 GOTOB MARK1"],
        "{0}\nM30\n",
    ),
    "heidenhain": (
        "BEGIN PGM A MM\nL X+1 Y+1 Z+200 B+0 C+0 R0 FMAX\nL X+2 F200\n",
        ["LBL 11"],
        ["CALL LBL 1", "CALL LBL 2", "CALL LBL 11 REP2"],
        "L Z+100 FMAX M2\nLBL 1\n{0}\nLBL 0\nLBL 2\n{1}\nCALL LBL 1\n{2}\nLBL 0\nEND PGM A MM\n",
    ),
}
"""Head, blocks between plain lines, and end with subprograms, of programs with jumps and calls."""


@st.composite
def stored_programs(draw):
    """A program with jumps, loops and calls, and its dialect."""
    dialect = draw(st.sampled_from([*STORED]))
    head, *between, end = STORED[dialect]
    lines = (klartext_lines if dialect == "heidenhain" else plain_lines)("XYZC", most=6)
    runs = ["\n".join(draw(lines)) for _ in range(6)]
    blocks = [draw(st.sampled_from(choices)) for choices in between]
    middle = "\n".join((runs[3], blocks[0], runs[4], blocks[1], runs[5]))
    return f"{head}{middle}\n{end.format(*runs)}", dialect


@drawn(6, 60, 500, program=stored_programs(), seed=st.integers(0, 1), tolerance=st.sampled_from([1.0, 1e3]))
def test_programs_with_calls_in_bulk_give_the_same_program(program, seed, tolerance):
    text, dialect = program
    options = {"dialect": dialect, "tolerance_um": tolerance}
    single = outcome(text, TABLE, model_of_errors(seed), plain=False, **options)
    assert outcome(text, TABLE, model_of_errors(seed), **options) == single


def test_the_lines_of_a_subprogram_are_written_together(monkeypatch):
    """Those that run once; of those that run again, only the first and the second run are written by themselves."""
    lines = "\n".join(f"X{2.0 + 0.01 * i:.3f} Y{i / 7:.3f}" for i in range(40))
    head = "G21 G90 G17 G54 G94\nG0 X1. Y1. Z200. B0. C0.\nG1 X2. F200\n"
    written, one_row = [], Writer._write_row
    monkeypatch.setattr(Writer, "_write_row", lambda self, *row: (written.append(row), one_row(self, *row))[1])
    for calls, most in ((1, 4), (50, 2 * 41 + 4)):
        written.clear()
        call = "M98 P1000\n" * calls
        text = f"{head}{call}M30\nO1000\nG1 X0. Y0.\n{lines}\nM99\n"
        together = outcome(text, TABLE, model_of_errors(1), tolerance_um=1e3)
        assert len(written) <= most
        assert together == outcome(text, TABLE, model_of_errors(1), plain=False, tolerance_um=1e3)


def test_arcs_between_lines_are_written_with_them(monkeypatch):
    arcs = "G1 X10. Y0. F100\nG3 X0. Y10. I-10. J0.\nX-10. Y0. I0. J-10.\nG2 X0. Y10. R10.\nX10. Y0. Z199. R10.\n"
    written = []
    one_row = Writer._write_row
    monkeypatch.setattr(Writer, "_write_row", lambda *args: written.append(args[3]) or one_row(*args))
    lines, _ = outcome(HEAD + arcs * 20, DMU50, model_of_errors(0), tolerance_um=1e3)
    assert len(lines) == len((HEAD + arcs * 20).splitlines()) + 1
    assert written == []


HEAD = "G21 G90 G17 G54 G94\nG0 X0.0000 Y0.0000 Z200.0000 B0.0000 C0.0000\n"
CROSSING = [
    f"N{i} G1 X{x:.4f} Y{-x:.4f} Z{z:.4f} B{0.1 * i:.4f} C0.0000 F100\n"
    for i, (x, z) in enumerate((0.02 * k - 0.1 + shift, 0.013 * k - 0.06 + shift) for shift in (0, 10, 100) for k in range(11))
]  # fmt: skip
FORMS = {
    "crossing": "".join(CROSSING),
    "minus zero": "X-0.0000 Y0.0000\nX-0.0000 Y-0.0001\nX0.0000 Y-0.0000\n",
    "bare": "X-.5 Y.5 Z200.\nX.05 Y-.05\nX-.0001 Y.0001\nX.0 Y0. Z5.\n",
    "bare, as long as before": "X-.46000 Y+.3700 Z200.0000\nX.5123 Y-.51230\nX+.4600 Y.3700 Z9.9999\nX9.9999 Y-9.9999\n",
    "point": "X5. Y6.\nX5. Z7.\nX6.\nY5. Z.5\n",
    "five decimals": "X1.23456 Y2.34567 Z200.00001\nX1.23457\nY2.34568\nZ200.00002\nX1.23456\n",
    "plus": "X+1.5 Y-2.5\nX-0.0001 Y0.0001\nX0.0001 Y-0.0001 Z+5.\nX-1.\nY+0.0000\n",
    "integers": "X1 Y2\nX2 Y0\nX3\nX4 Y5\n",
    "rotary": "B5. C10.\nB6.\nC12. B7.\nX1. B8.\nB9. Y0.5\nC20.\n",
    "inch": "G20\nX1.5 Y.25\nX1.6\nX1.7 Y.3 Z2.\nZ2.1\n",
    "order": "Z5. X1.\nC5. Y2.\nB1. Z3. X2.\nY1. X1.\nG1 Y2. F5 X2.\n",
}


@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("form", FORMS)
def test_numbers_of_any_form_are_written_alike(form, end):
    text = (HEAD + FORMS[form] + "M30").replace("\n", end)
    model = model_of_errors(2, 200.0)
    single = outcome(text, DMU50, model, plain=False)
    assert not isinstance(single, str)
    for piece in PIECES:
        assert outcome(text, DMU50, model, piece=piece) == single


@pytest.mark.parametrize("increments", [False, True])
def test_numbers_without_points_are_noted_or_increments(increments):
    control = dataclasses.replace(DMU50.control, integer_words="increments" if increments else "units")
    machine = dataclasses.replace(DMU50, control=control) if increments else DMU50
    text = HEAD + "G1 X1. Y1. F100\nX1000 Y0\nX2.5 Y2000\nX3 Y2.5\nX4. Y0\n"
    model = random_model(machine, 3)
    assert outcome(text, machine, model) == outcome(text, machine, model, plain=False)


@pytest.mark.statistical
@LINES_OF_REAL_PROGRAMS
def test_real_programs_are_corrected_alike(nc_data, lines, tmp_path):
    for path in first_lines(real_programs(nc_data), lines, tmp_path):
        machine, text = machine_for(path), path.read_bytes().decode(ENCODING)
        model = random_model(machine, 5)
        assert outcome(text, machine, model) == outcome(text, machine, model, plain=False), path.name


@settings(max_examples=6)
@given(text=mixtures(), piece=st.sampled_from(PIECES))
def test_refusals_name_the_same_line(text, piece):
    """Lines of the program are numbered through all pieces."""
    found = []
    for dialect in (ISO, msgspec.structs.replace(ISO, plain=None)):
        lines = []
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("postproc.text.source.PIECE", piece)
            try:
                for item in read_blocks(source_of(text), dialect, "XYZBC"):
                    several = isinstance(item, PlainRun)
                    lines += [(b.line, b.text) for b in (map(item.block, range(len(item))) if several else (item,))]
            except Refusal as refusal:
                lines.append((refusal.line, refusal.reason))
        found.append(lines)
    assert found[0] == found[1]


ONE_MOVE = {"text": "G90\nG0 X10.0000 Y10.0000 Z200.0000\nG1 X11.000\n", "size": 1}
REFUSING = 3  # a seed with whose errors the first of two refused lines is refused by the correction
REFUSED_TWICE = "G90\nG0 X0.0000 Y0.0000 Z200.0000\nG2 X-0.00000 Y-0.00002 Z200.00000 I-0.02000\nG1 X0.\nG2 X1. Y2.\n"


@drawn(5, 80, 800, also=ONE_MOVE, text=arc_programs() | st.just(REFUSED_TWICE), size=st.sampled_from([1, 2, 3, 7]))
def test_chunks_of_any_size_give_the_same_arcs(text, size):
    model = model_of_errors(REFUSING)
    whole = outcome(text, DMU50, model)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("postproc.execution.CHUNK_BLOCKS", size)
        assert outcome(text, DMU50, model) == whole


@pytest.mark.parametrize("before", ["", "F100\n" * 30])
def test_of_two_refusals_the_first_line_is_named(before):
    """One of them is found by the correction, the other one by reading."""
    text = REFUSED_TWICE.replace("G90\n", "G90\n" + before)
    line = 3 + before.count("\n")
    for plain in (True, False):
        found = outcome(text, DMU50, model_of_errors(REFUSING), plain=plain)
        assert isinstance(found, str)
        assert found.startswith(f"test.nc:{line}:")


@pytest.mark.parametrize(("programs", "lines"), [(3, 20), pytest.param(14, 60, marks=pytest.mark.statistical)])
def test_real_programs_are_the_same_on_every_road(nc_data, programs, lines, tmp_path):
    """Line by line, in pieces of 1 line, 7 lines, 4 KiB and 1 MiB, with one and two processes: text, JSON, refusal.

    The longest programs; `benchmarks/same_bytes.py` runs all, and whole.
    """
    longest = sorted((path for path in nc_data.rglob("*") if path.is_file()), key=lambda path: -path.stat().st_size)
    for path in first_lines(longest[:programs], lines, tmp_path):
        machine = machine_for(path)
        _, differences = every_road.differing(path, machine, random_model(machine, 5), Here)
        assert not differences
