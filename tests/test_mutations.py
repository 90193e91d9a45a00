"""Programs that somebody has spoiled: read and given back byte for byte, or refused in words; never anything else."""

import io
from functools import cache
from pathlib import Path

import pytest
from hypothesis import strategies as st
from support.programs import load
from support.real_data import NC_DATA
from support.tiers import drawn

from kinematics.error_model.model import no_errors
from kinematics.user_error import UserError
from postproc.control.setup import make_setup
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.text import flow
from postproc.text.source import ENCODING, HEAD_SIZE, Source

LARGEST = 6_000
"""Bytes of a program: many short ones say more than one long one."""
SPOILT = ["X", "Y-", "G", "G91 ", "G2", "#", "[", "]", "(", ")", "%", "/", ";", ".", "=", "R1", "\r", "\n", "0", "-", "~",
          " ", "M6", "L ", "CC ", "E5", "\t", "\xe9", '"', "IF ", "G43.4 H1 ", "G68 ", "G92 X1.", "K3 ", "G16 ", "TRANS "]  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def soon_endless():
    """A spoilt loop that does not end is refused after so many blocks, and not after two million."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(flow, "MOST_RUN_BLOCKS", 100_000)
        yield


@cache
def programs(folder: str) -> tuple[Path, ...]:
    """Real programs of a dialect."""
    return tuple(sorted(p for p in (NC_DATA / folder).rglob("*") if p.is_file() and p.stat().st_size < LARGEST))


def written(text: str, name: str, dialect: str) -> str:
    """The program as it comes out for a machine without errors."""
    machine, out, data = load("dmu50"), io.BytesIO(), text.encode(ENCODING)
    source = Source(name, data[:HEAD_SIZE].decode(ENCODING), data)
    job = Job(
        source, find_dialect(dialect, name, ""), machine, no_errors(machine), make_setup(machine, zero=True), False
    )
    Pipeline(job).run(out, lambda _: None)
    return out.getvalue().decode(ENCODING)


@st.composite
def spoilt(draw, folder: str):
    """A real program with one to four changes of characters or of the order of its lines."""
    path = draw(st.sampled_from(programs(folder)))
    text = path.read_bytes().decode(ENCODING)
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, len(text)))
        kind = draw(st.sampled_from(["insert", "insert", "drop", "digit", "twice", "swap"]))
        lines = text.splitlines(keepends=True)
        line = draw(st.integers(0, max(len(lines) - 2, 0)))
        match kind:
            case "insert":
                text = text[:at] + draw(st.sampled_from(SPOILT)) + text[at:]
            case "drop":
                text = text[:at] + text[at + draw(st.integers(1, 3)) :]
            case "digit":
                text = text[:at] + draw(st.sampled_from("0123456789")) + text[at + 1 :]
            case "twice":
                text = "".join([*lines[: line + 1], *lines[line:]])
            case _:
                lines[line : line + 2] = lines[line : line + 2][::-1]
                text = "".join(lines)
    return path.name, text


def check(name: str, text: str, dialect: str) -> None:
    try:
        assert written(text, name, dialect) == text
    except UserError as refusal:
        assert str(refusal).startswith(name)
        assert len(str(refusal)) > len(name) + 5


@pytest.mark.usefixtures("nc_data")
@drawn(few=25, many=200, most=1500, data=st.data())
def test_iso(data):
    check(*data.draw(spoilt("iso")), "iso")


@pytest.mark.usefixtures("nc_data")
@drawn(few=10, many=100, most=1500, data=st.data())
def test_siemens(data):
    check(*data.draw(spoilt("siemens")), "siemens")


@pytest.mark.usefixtures("nc_data")
@drawn(few=8, many=20, most=1500, data=st.data())
def test_klartext(data):
    check(*data.draw(spoilt("heidenhain")), "heidenhain")
