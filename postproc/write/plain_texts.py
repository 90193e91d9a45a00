"""The texts of runs of plain lines with written words, column by column."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from kinematics.machine import NDArrayBool
from kinematics.transforms import Array
from postproc.text.blocks import Blocks, PlainRun
from postproc.text.plain_columns import POWERS
from postproc.text.plain_lines import PlainLines

FEED = ord("F")
"""Letter of an added feed, which takes neither case nor blanks of the word before it."""


class PlainText(NamedTuple):
    """The text of consecutive plain lines."""

    data: bytes
    lines: int
    changed: int
    """Number of lines that were changed."""


def unchanged(blocks: Blocks) -> Iterator[str | PlainText]:
    """The texts of all blocks as they are; consecutive plain lines have one."""
    for part in blocks.parts:
        if isinstance(part, list):
            yield from (block.text for block in part)
        else:
            yield PlainText(part.data(0, len(part)), len(part), 0)


class PlainWords(NamedTuple):
    """Numbers that replace others, or words that are added; columns `(k,)`."""

    line: np.ndarray
    """Index of the line in its piece of the program."""
    axis: np.ndarray
    """Column of the axis, or of the word next to an added one, as of `PlainLines.with_feeds`."""
    counts: Array
    """The number in units of its last decimal."""
    decimals: np.ndarray
    letter: np.ndarray
    """Upper case letter of an added word; 0 for a number that replaces another."""
    behind: NDArrayBool
    """True for a word behind that of `axis`, False for one before it."""
    plus: NDArrayBool
    """True for a sign on a positive number."""
    zero: NDArrayBool
    """True for a zero before the point."""
    blank: NDArrayBool
    """True where blanks separate words."""
    comma: NDArrayBool
    """True for a comma instead of the decimal point."""

    def take(self, chosen: NDArrayBool) -> PlainWords:
        """Some of the words."""
        columns: tuple[Any, ...] = self
        return PlainWords(*(column[chosen] for column in columns))


def joined(words: Iterable[PlainWords]) -> PlainWords:
    """All words, in this order."""
    columns: Iterator[tuple[Any, ...]] = zip(*words, strict=True)
    return PlainWords(*map(np.concatenate, columns))


def texts_of_runs(written: Iterable[tuple[int, PlainRun, PlainWords]]) -> dict[int, PlainText]:
    """The texts of runs of plain lines with these words, by the indices of their first blocks, which are given."""
    texts: dict[int, PlainText] = {}
    for lines, group in itertools.groupby(written, lambda item: item[1].lines):
        in_text = sorted(group, key=lambda item: item[1].first)  # calls run them in another order
        indices, runs, words = zip(*in_text, strict=True)
        texts |= zip(indices, plain_texts(lines, runs, joined(words)), strict=True)
    return texts


def plain_texts(lines: PlainLines, runs: Sequence[PlainRun], words: PlainWords) -> list[PlainText]:
    """The texts of runs of a piece, in their order, with these words."""
    bounds = lines.starts[np.array([(run.first, run.last) for run in runs])].astype(int)
    low, high = int(bounds[0, 0]), int(bounds[-1, 1])
    if not len(words.line):
        return [PlainText(run.data(0, len(run)), len(run), 0) for run in runs]
    changed = np.zeros(len(lines), bool)
    changed[words.line] = True
    further = int(words.axis.max()) >= len(lines.addresses)
    columns, source = (
        lines.with_feeds if further else lines.columns,
        np.frombuffer(lines.data, np.uint8)[low:high].copy(),
    )
    cell = words.axis, words.line
    start, end = (column[cell] - low for column in (columns.start, columns.end))
    longer = ~_put_in_place(source, words, start, end)
    words, start, end = words.take(longer), start[longer], end[longer]
    address = columns.at[words.axis, words.line] - low
    added, like = words.letter > 0, words.letter != FEED
    gap, lower = like & (start > address + 1), like & ((source[address] & 0x20) > 0)
    start = np.where(added, np.where(words.behind, end, address), start)
    end = np.where(added, start, end)
    order = np.argsort(start, kind="stable")
    text, lengths = _written(words, gap, lower, order)
    start, end = start[order], end[order]
    kept, tail = start - np.concatenate([[0], end[:-1]]), len(source) - int(end[-1] if len(end) else 0)
    alternating = np.arange(2 * len(end) + 1) % 2 == 0
    taken = np.repeat(alternating, np.append(np.stack([kept, end - start], axis=1).ravel(), tail))
    placed = np.repeat(alternating, np.append(np.stack([kept, lengths], axis=1).ravel(), tail))
    result = np.empty(len(placed), np.uint8)
    result[placed] = source[taken]
    result[~placed] = text
    data = result.tobytes()
    longer = np.concatenate([[0], np.cumsum(lengths - (end - start))])
    ends = bounds - low + longer[np.searchsorted(start, bounds - low)]
    return [
        PlainText(data[first:last], len(run), int(np.count_nonzero(changed[run.first : run.last])))
        for run, (first, last) in zip(runs, ends.tolist(), strict=True)
    ]


def _put_in_place(text: np.ndarray, words: PlainWords, start: np.ndarray, end: np.ndarray) -> NDArrayBool:
    """Write the numbers as long as those that they replace, from `start` to `end` `(k,)` of a text; True for these."""
    sizes = np.abs(words.counts)
    whole = np.floor(sizes / POWERS[words.decimals])
    digits = np.where(words.zero | (words.decimals == 0), 1, 0)
    for place in range(len(str(int(whole.max(initial=0.0))))):
        digits = np.where(whole >= POWERS[place], place + 1, digits)
    signed = (words.counts < 0.0) | words.plus
    fits = (signed + digits + (words.decimals > 0) + words.decimals == end - start) & (words.letter == 0)
    # groups with digits, decimals and signs at the same positions
    layout = (digits * len(POWERS) + words.decimals) * 2 + signed
    kind = np.uint32 if sizes.max(initial=0.0) < 2.0**32 else np.uint64
    for one in np.flatnonzero(np.bincount(layout[fits])).tolist():
        rows = np.flatnonzero(fits & (layout == one))
        decimals, length = int(words.decimals[rows[0]]), int(end[rows[0]] - start[rows[0]])
        first, rest = start[rows], np.asarray(sizes[rows].astype(kind))
        if signed[rows[0]]:
            text[first] = np.where(words.counts[rows] < 0.0, ord("-"), ord("+"))
        if decimals:
            text[first + (length - decimals - 1)] = np.where(words.comma[rows], ord(","), ord("."))
        places = [place for place in range(int(signed[rows[0]]), length) if not 0 < decimals == length - place - 1]
        for place in reversed(places):
            last, rest = rest, rest // 10
            text[first + place] = ord("0") + (last - rest * 10).astype(np.uint8)
    return np.asarray(fits)


def _written(words: PlainWords, gap: NDArrayBool, low: NDArrayBool, order: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Bytes of words in this order, and their lengths `(k,)`.

    gap, low `(k,)`: the word whose style it takes has blanks behind its address, has a lower case address.
    """
    counts, decimals = np.abs(words.counts), words.decimals
    whole = np.floor(counts / POWERS[decimals])
    most = int(decimals.max(initial=0))
    fraction = ((counts - whole * POWERS[decimals]) * POWERS[most - decimals]).astype(np.uint32)
    whole = whole.astype(np.uint32)
    negative, added = words.counts < 0.0, words.letter > 0
    digits = len(str(int(whole.max(initial=0))))
    width = 5 + digits + 1 + most
    text = np.full((len(counts), width), ord(" "), np.uint8)
    shown = np.zeros((len(counts), width), bool)
    shown[:, 0], shown[:, -1] = added & words.blank & words.behind, added & words.blank & ~words.behind
    text[:, 1], shown[:, 1] = words.letter + 0x20 * low, added
    shown[:, 2] = added & gap
    text[:, 3], shown[:, 3] = np.where(negative, ord("-"), ord("+")), negative | words.plus
    for i in range(digits):
        place = digits - 1 - i
        text[:, 4 + i] = ord("0") + (whole // 10**place) % 10
        shown[:, 4 + i] = (whole >= 10**place) | ((place == 0) & (words.zero | (decimals == 0)))
    text[:, 4 + digits], shown[:, 4 + digits] = np.where(words.comma, ord(","), ord(".")), decimals > 0
    for i in range(most):
        text[:, 5 + digits + i] = ord("0") + (fraction // 10 ** (most - 1 - i)) % 10
        shown[:, 5 + digits + i] = decimals > i
    text, shown = text[order], shown[order]
    return text[shown], shown.sum(axis=1)
