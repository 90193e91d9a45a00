"""Programs in the encodings and line ends that controls and old editors write: what is not a coordinate stays."""

import io
import re
from itertools import cycle, product

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.programs import load, random_model, setup_of
from support.tiers import quick

from kinematics.error_model.model import no_errors
from kinematics.user_error import UserError
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.text.source import open_source

GANTRY = load("gantry")
MODEL = random_model(GANTRY, 3)
PROGRAMS = {
    "iso": ("%\nO1 ({})\nG21 G90 G17\nG0 X10. Y20. Z5.\nG1 Z-1.5 F200 ({})\nX30.25\nG2 X40.25 Y30. I0. J10.\nM30\n%", "nc"),
    "siemens": ("; {}\nG71 G90 G17\nG0 X10 Y20 Z5\nR1=30.25\nG1 Z-1.5 F200 ; {}\nX=R1\nG2 X40.25 Y30 I0 J10\nM30", "mpf"),
    "heidenhain": (
        "0 BEGIN PGM T MM\n1 ; {}\n2 L X+10 Y+20 Z+5 FMAX\n3 L Z-1,5 F200 ; {}\n4 L X+30,25\n5 CC X+30,25 Y+30\n"
        "6 C X+40,25 Y+30 DR+\n7 CYCL DEF 200 DRILL ~\n  Q200=+2 ;{} ~\n  Q201=-20 ;DEPTH\n8 L Z+9\n9 END PGM T MM", "h",
    ),
}  # fmt: skip
COMMENTS = {
    "ascii": b"roughing",
    "latin-1": "Vorfräsen µ ÿ".encode("latin-1"),
    "cp1251": "Черновая … обработка".encode("cp1251"),
    "gbk": "粗加工 丂 刀具".encode("gbk"),
    "utf-8": "Vorfräsen 粗加工".encode(),
}
ENDS = {"lf": b"\n", "crlf": b"\r\n", "cr": b"\r", "cr cr lf": b"\r\r\n"}
WRAPPED = {
    "plain": lambda data, end: data + end,
    "no final end": lambda data, _: data,
    "byte order mark": lambda data, end: b"\xef\xbb\xbf" + data + end,
    "nul leader and trailer": lambda data, end: b"\0" * 50 + end + data + end + b"\0" * 50,
    "dos end": lambda data, end: data + end + b"\x1a",
    "dos end in the last line": lambda data, _: data + b"\x1a",
}
MARK = re.compile(rb"(?:(?<![^\r\n])\d+ )?(\(|; )NCOMP [^\r\n]*CALIBRATION[^\r\n]*?(\r\r\n|\r\n|\n|\r)")
FLAT = re.compile(rb"CP IPA[+-][\d,.]+")
NUMBER = re.compile(rb"(?<![^\r\n\x00\xbf])\d+ ")
WORD = re.compile(rb" ?[XYZIJ][+-]?\d+[.,]?\d*|(?<=X=R1)[+-][\d.]+")


def program(dialect, comment="ascii", end="lf", wrapped="plain"):
    text, suffix = PROGRAMS[dialect]
    data = text.encode("ascii").replace(b"{}", COMMENTS[comment]).replace(b"\n", ENDS[end])
    return WRAPPED[wrapped](data, ENDS[end]), suffix


def corrected(path, model):
    out, source = io.BytesIO(), open_source(str(path))
    dialect = find_dialect("auto", source.name, source.text_head)
    # in one piece: no blocks of its own are asked for here
    job = Job(source, dialect, GANTRY, model, setup_of(GANTRY), travel_check=False, tolerance_um=1e4)
    Pipeline(job).run(out, lambda _: None)
    return dialect.name, out.getvalue()


def check(tmp_path, dialect, data, suffix):
    path = tmp_path / f"part.{suffix}"
    path.write_bytes(data)
    assert corrected(path, no_errors(GANTRY)) == (dialect, data)
    name, written = corrected(path, MODEL)
    assert name == dialect
    assert len(MARK.findall(written)) == 1
    left = MARK.sub(b"", written)
    assert left != data
    if dialect == "heidenhain":  # whose blocks are counted, the mark too
        left, data = NUMBER.sub(b"", FLAT.sub(b"C", left)), NUMBER.sub(b"", data)
    assert WORD.sub(b"", left) == WORD.sub(b"", data)


@pytest.mark.parametrize("wrapped", WRAPPED)
@pytest.mark.parametrize("dialect", PROGRAMS)
def test_what_stands_around_a_program(tmp_path, dialect, wrapped):
    check(tmp_path, dialect, *program(dialect, "latin-1", "crlf", wrapped))


@pytest.mark.parametrize(
    ("dialect", "comment", "end"),
    quick(
        product(PROGRAMS, COMMENTS, ENDS),
        [(dialect, comment, end) for dialect in PROGRAMS for comment, end in zip(COMMENTS, cycle(ENDS), strict=False)],
    ),
)
def test_comments_and_line_ends(tmp_path, dialect, comment, end):
    check(tmp_path, dialect, *program(dialect, comment, end))


@settings(max_examples=15)
@given(data=st.data(), dialect=st.sampled_from(sorted(PROGRAMS)))
def test_mixed_line_ends(tmp_path_factory, data, dialect):
    """Line feeds with carriage returns before some of them."""
    text, suffix = program(dialect, data.draw(st.sampled_from(sorted(COMMENTS))))
    lines = [line + data.draw(st.sampled_from([b"\n", b"\r\n"])) for line in text.split(b"\n")]
    check(tmp_path_factory.mktemp("mixed"), dialect, b"".join(lines), suffix)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32"])
@pytest.mark.parametrize("dialect", PROGRAMS)
def test_wide_characters_are_refused(tmp_path, dialect, encoding):
    data, suffix = program(dialect)
    path = tmp_path / f"part.{suffix}"
    path.write_bytes(data.decode().encode(encoding))
    with pytest.raises(UserError, match=r"is UTF-16 text|is a binary file"):
        open_source(str(path))


def test_a_comment_that_goes_on_in_the_next_line_hides_no_block(tmp_path):
    path = tmp_path / "part.h"
    path.write_bytes(b"BEGIN PGM T MM\r; comment ~\rL X+1\rEND PGM T MM\r")
    with pytest.raises(UserError, match="line 2 of this comment"):
        corrected(path, no_errors(GANTRY))


@pytest.mark.statistical
def test_real_programs_in_other_clothes(nc_data, tmp_path):
    """Every real program that is read comes back with its line ends changed, and with a comment in another alphabet."""
    accepted = 0
    for path in sorted(p for p in nc_data.rglob("*") if p.is_file() and p.stat().st_size < 100_000):
        try:
            dialect, data = corrected(path, no_errors(GANTRY))
        except UserError:
            continue
        assert data == path.read_bytes()
        if len(data) > 20_000:
            continue
        accepted += 1
        lines = re.split(rb"\r*\n", data)
        note = b"(" + COMMENTS["gbk"] + b")" if dialect == "iso" else b"; " + COMMENTS["cp1251"]
        lines.insert(len(lines) // 2 if b"~" not in data else 1, note)
        for end in (b"\r\n", b"\r"):
            other = tmp_path / path.name
            other.write_bytes(end.join(lines))
            assert corrected(other, no_errors(GANTRY)) == (dialect, other.read_bytes())
    assert accepted >= 30
