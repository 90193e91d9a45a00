"""Plain lines that another process reads ahead: the same lines, whenever it begins and ends."""

import itertools

import numpy as np
import pytest
from hypothesis import strategies as st
from msgspec.structs import astuple
from support.no_process import Here
from support.plain_programs import mixtures
from support.tiers import drawn

from kinematics.running.child_process import LostProcess
from postproc.dialects import find_dialect
from postproc.read_ahead import PIECES_AHEAD, read_ahead
from postproc.text.plain_lines import whole_lines

AXES = "XYZBC"
STYLE = find_dialect("iso", "", "").plain


def check_all(pieces, found):
    found = list(found)
    assert [piece for piece, _ in found] == pieces
    for piece, lines in found:
        alone = whole_lines(piece, AXES, STYLE)
        assert lines.data == alone.data
        assert np.array_equal(lines.starts, alone.starts)
        if not len(alone):
            continue
        assert np.array_equal(lines.regular, alone.regular)
        assert lines.usual_numbers == alone.usual_numbers
        for column, other in zip(*map(astuple, (lines.columns, alone.columns)), strict=True):
            assert np.array_equal(column, other)
        for mark, other in zip(lines.marks(lines.columns), alone.marks(alone.columns), strict=True):
            assert np.array_equal(mark, other)


def divided(text, size):
    """The text in pieces that end with a line feed, the last one perhaps without."""
    lines = text.encode("latin-1").splitlines(keepends=True)
    return [b"".join(lines[i : i + size]) for i in range(0, len(lines), size)]


def late_process(begin, lost):
    """A process that has an answer from the question `begin` on, and is lost with the task or answer `lost`."""

    class Late(Here):
        open_tasks = most = 0

        def __init__(self, work):
            super().__init__(work)
            self._asked, self._steps = itertools.count(), itertools.count()

        def _step(self):
            if next(self._steps) == lost:
                raise LostProcess

        def give(self, task):
            self._step()
            super().give(task)
            Late.open_tasks += 1
            Late.most = max(Late.most, Late.open_tasks)

        def answer(self):
            self._step()
            Late.open_tasks -= 1
            return super().answer()

        def answers_within(self, seconds):
            return next(self._asked) >= begin and super().answers_within(seconds)

    return Late


@drawn(15, 200, 600, text=mixtures(), size=st.integers(1, 4), begin=st.integers(0, 8), lost=st.integers(-1, 20))
def test_the_lines_are_those_of_one_process(text, size, begin, lost):
    pieces, process = divided(text, size), late_process(begin, lost)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("postproc.read_ahead.ChildProcess", process)
        check_all(pieces, read_ahead(iter(pieces), AXES, STYLE))
    assert process.most <= PIECES_AHEAD + 1


@pytest.mark.parametrize("begin", [0, 1, PIECES_AHEAD, 3 * PIECES_AHEAD])
def test_a_process_that_begins_late_reads_the_pieces_behind(begin, monkeypatch):
    tasks = []

    class Counted(late_process(begin, -1)):
        def give(self, task):
            tasks.append(task)
            super().give(task)

    monkeypatch.setattr("postproc.read_ahead.ChildProcess", Counted)
    pieces = divided("".join(f"G1 X{i}.\n" for i in range(20)), 1)
    check_all(pieces, read_ahead(iter(pieces), AXES, STYLE))
    assert tasks[-len(pieces) + begin + 1 :] == pieces[begin + 1 :]


@pytest.mark.parametrize("piece", [b"\n", b" \n", b"\r\n", b"\n\n", b"X\n", b"0\n", b"(\n", b"%\n", b"\n0"])
def test_a_piece_of_hardly_any_characters(piece):
    """Words that no line has have no place in the piece, however short it is."""
    check_all([piece], read_ahead(iter([piece]), AXES, STYLE))
    lines = whole_lines(piece, AXES, STYLE)
    assert not lines.columns.plain.any()
    assert not any(mark.any() for mark in lines.marks(lines.columns))


def test_a_process_reads_the_lines():
    text = "".join(
        f"N{i} G1 X{i % 7}.25 Y-{i % 5}. B{i / 100:.4f} F{i}\n(comment)\nG2 X1. I.5 J-1.\n" for i in range(400)
    )
    pieces = divided(text, 30)
    check_all(pieces, read_ahead(iter(pieces), AXES, STYLE))


def test_a_reader_that_is_not_used_to_its_end_leaves_no_process():
    ended = []

    class Noting(Here):
        def end(self):
            ended.append(1)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("postproc.read_ahead.ChildProcess", Noting)
        reading = read_ahead(iter([b"X1.\n", b"X2.\n"]), AXES, STYLE)
        next(reading)
        reading.close()
    assert ended


def test_a_slow_process_is_helped(monkeypatch):
    """While the other process has no answer, this one reads a piece behind those that it has given away."""
    given = []

    class Slow(Here):
        def give(self, task):
            given.append(task)
            super().give(task)

        def answers_within(self, seconds):
            return seconds == 0.0

    monkeypatch.setattr("postproc.read_ahead.ChildProcess", Slow)
    pieces = divided("".join(f"G1 X{i}.\n" for i in range(60)), 1)
    check_all(pieces, read_ahead(iter(pieces), AXES, STYLE))
    assert 20 < len(given) < 50
