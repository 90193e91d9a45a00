"""Corrected moves written into runs of plain lines: as `Writer` writes them one by one, but column by column."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import NamedTuple

import msgspec
import numpy as np
from msgspec.structs import replace

from kinematics.machine import NDArrayBool
from kinematics.transforms import Array
from postproc.motion.arcs import CENTRES
from postproc.motion.motions import BY_ROW, Motions
from postproc.motion.moves import Arc, Kind
from postproc.text.blocks import PlainRun
from postproc.text.editing import Layout, end_of, rank_of
from postproc.text.number_style import NumberStyle
from postproc.text.plain_columns import POWERS, NumberMarks
from postproc.text.plain_lines import LARGEST_PLAIN_NUMBER
from postproc.text.source import ENCODING
from postproc.write.decimals import Present, increments, rounded
from postproc.write.drilling import PlainHoles
from postproc.write.plain_arcs import RADIUS, PlainArcs, WritableArcs
from postproc.write.plain_texts import FEED, PlainWords, joined

SMALLEST_FEED = 1e-3
"""Number of F, at least: that of a smaller one has more decimals than the columns hold."""


class WrittenAxis(NamedTuple):
    """A linear axis whose words are written."""

    column: int
    name: str
    decimals: int
    unit: float
    """mm per unit of its words."""


class WrittenRows(NamedTuple):
    """The first lines of a run of plain lines, written."""

    words: PlainWords
    ends: Array
    """Positions on the control after each line `(lines, axes)`."""
    behind: Array
    """Positions on the control before the next line; those of `ends` but behind holes."""
    arcs: dict[int, Arc]
    """Arcs about the centres that the control uses, by line."""
    layout: Layout
    """Layout after the last line."""


class PlainRows(msgspec.Struct, dict=True):
    """The moves of a run of plain lines, one row per line, with their corrected ends."""

    run: PlainRun
    corrected: Array
    """Corrected ends `(lines, axes)`, programmed coordinates, mm and degrees."""
    target: Array
    """Programmed ends."""
    programmed: NDArrayBool
    """True `(lines, axes)` where the program has given the position at the end."""
    kept: NDArrayBool
    """Lines `(lines,)` whose linear axes keep their positions; they name none."""
    arcs: WritableArcs
    """Arcs by line."""
    starts: Array
    """Programmed starts."""
    turned: tuple[int, ...] = ()
    """Rotary axes that vectors turn, without words."""
    feeds: Callable[[Array, Array], tuple[Array, np.ndarray]] | None = None
    """F of the lines `(lines,)` and its decimals, for their written starts and ends; nan where F stays."""
    holes: PlainHoles | None = None
    """Depths of the lines, which are holes; None for moves."""

    def write(self, axes: Sequence[WrittenAxis], held: list[float], layout: Layout) -> WrittenRows | None:
        """Write the lines before the first arc that has to be written by itself; None if there are none.

        axes: in the order in which words are added. held: positions before the first line, mm and degrees.
        """
        named = self._named
        ends = np.empty_like(self.target)
        for column in range(len(held)):
            ends[:, column] = _held(named[column], self.target[:, column], held[column])
        for column in self.turned:  # by vectors: as far as programmed
            steps = self.target[:, column] - self.starts[:, column]
            ends[:, column] = np.cumsum(np.append(held[column], steps))[1:]
        layouts = _Layouts(self.run, layout)
        found: list[PlainWords] = []
        of_axis = self._increments if self.run.incremental else self._axis
        drilling = -1 if self.holes is None else self.holes.cycle.axis
        for axis in axes:
            if axis.column != drilling:
                found += of_axis(axis, held[axis.column], ends[:, axis.column], layouts)
        behind = ends if self.holes is None else self._drill(self.holes, axes, ends, layouts, found)
        arcs: dict[int, Arc] = {}
        lines = len(ends)
        if len(self.arcs.rows):
            starts = np.concatenate([[held], ends[:-1]])
            circles, lines = PlainArcs.of(self.arcs, self.corrected, starts, ends)
            arcs, last = self._write_arcs(circles, axes, layouts, found)
            lines = lines if last is None else last
        if self.feeds is not None:
            feed_words, last = self._feeds(*self.feeds(np.concatenate([[held], ends[:-1]]), ends), layouts)
            found += feed_words
            lines = min(lines, last)
        if not lines:
            return None
        words = joined(found)
        if lines < len(ends):
            words = words.take(words.line < self.run.first + lines)
        return WrittenRows(words, ends[:lines], behind[:lines], arcs, layouts.after(lines))

    def _drill(
        self,
        holes: PlainHoles,
        axes: Sequence[WrittenAxis],
        ends: Array,
        layouts: _Layouts,
        found: list[PlainWords],
    ) -> Array:
        """Add the words of depths to `found` and the bottoms to `ends` `(lines, axes)`; returns positions behind."""
        behind, drilling = ends.copy(), holes.cycle.axis
        (along,) = (axis for axis in axes if axis.column == drilling)
        for name, numbers in holes.words.items():
            if numbers:
                counts = np.rint(np.array([*numbers.values()]) * POWERS[along.decimals])
                found.append(self._added(along._replace(name=name), np.array([*numbers], int), counts, layouts))
        ends[:, drilling], behind[:, drilling] = holes.bottoms, holes.levels
        return behind

    def _feeds(self, feeds: Array, decimals: np.ndarray, layouts: _Layouts) -> tuple[list[PlainWords], int]:
        """F words with these numbers `(lines,)`, and the first line whose number has to be written by itself."""
        column = len(self.run.lines.addresses)
        set_here = np.isfinite(feeds)
        unusual = set_here & ((feeds < SMALLEST_FEED) | (feeds >= LARGEST_PLAIN_NUMBER))
        named = self.run.with_feeds.end[column] > 0
        found = []
        for added in (False, True):
            rows = np.flatnonzero(set_here & (named != added) & ~unusual)
            counts, _ = rounded(feeds[rows], decimals[rows])
            letter, columns = np.full(len(rows), added * FEED), np.full(len(rows), column + added)
            styles = layouts.of_feeds(rows)
            first = rows + self.run.first
            found.append(PlainWords(first, columns, counts, decimals[rows], letter, np.full(len(rows), added), *styles))
        return found, int(unusual.argmax()) if unusual.any() else len(feeds)

    def _write_arcs(
        self, circles: PlainArcs, axes: Sequence[WrittenAxis], layouts: _Layouts, found: list[PlainWords]
    ) -> tuple[dict[int, Arc], int | None]:
        """Add the words of arcs to `found`; returns what `PlainArcs.written` does."""
        addresses, columns = self.run.lines.addresses, self.run.columns
        radii, centres = np.full(len(circles.lines), np.nan), np.full((len(circles.lines), 2), np.nan)
        if not len(circles.lines):
            return {}, None
        plane, by_radius = circles.nominal.arcs[0].plane, circles.nominal.by_radius
        linear = {axis.column: axis for axis in axes}
        column = addresses.find(RADIUS)
        if column >= 0 and by_radius.any():
            rows, axis = circles.lines, linear[plane[0]]
            wanted = circles.radius_words(columns.value[column, rows], axis.unit)
            radii[by_radius] = self._arc_words(RADIUS, axis, rows[by_radius], wanted[by_radius], layouts, found)
            radii *= axis.unit
        if not by_radius.all():
            for i, axis in enumerate(linear[at] for at in plane[:2]):
                letter = CENTRES["XYZ".index(axis.name)]
                wanted, origins = circles.centre_words(i, axis.unit)
                rows = circles.lines[~by_radius]
                numbers = self._arc_words(letter, axis, rows, wanted[~by_radius], layouts, found)
                centres[~by_radius, i] = origins[~by_radius] + numbers * axis.unit
        return circles.written(centres, radii)

    def _arc_words(
        self,
        letter: str,
        axis: WrittenAxis,
        rows: np.ndarray,
        wanted: Array,
        layouts: _Layouts,
        found: list[PlainWords],
    ) -> Array:
        """Add words of arcs in lines `rows` `(k,)`, with the decimals of an axis, to `found`; returns the numbers."""
        column = self.run.lines.addresses.find(letter)
        named, value, own = np.zeros(len(rows), bool), np.zeros(len(rows)), np.zeros(len(rows), np.int8)
        if column >= 0:
            columns = self.run.columns
            named, value, own = self._named[column, rows], columns.value[column, rows], columns.decimals[column, rows]
        counts, number, decimals = Present(named, value, own, axis.decimals).to_write(wanted)
        changed, added = named & (number != value), ~named & (number != 0.0)
        if changed.any():
            found.append(self._replaced(column, rows[changed], counts[changed], decimals[changed], layouts))
        if added.any():
            found.append(self._added(axis._replace(name=letter), rows[added], counts[added], layouts))
        return number

    @cached_property
    def _named(self) -> NDArrayBool:
        return self.run.columns.end > 0

    def _axis(self, axis: WrittenAxis, held: float, ends: Array, layouts: _Layouts) -> list[PlainWords]:
        """Replaced numbers and added words of an axis; `ends` `(lines,)` becomes its positions on the control."""
        words, column = self.run.columns, axis.column
        named, value = self._named[column], words.value[column]
        wanted = self.corrected[:, column] / axis.unit
        counts, number, decimals = Present(named, value, words.decimals[column], axis.decimals).to_write(wanted)
        after = number * axis.unit
        active = self.programmed[:, column] & ~self.kept
        inserted = np.zeros(len(named), bool)
        free = active & ~named
        if free.any():
            rows = np.flatnonzero(active)
            before = np.concatenate([[held], after[rows[:-1]]])
            _, moved = rounded(wanted[rows] - before / axis.unit, decimals[rows])
            added = ~named[rows] & (moved != 0.0)
            unmoved = ~named[rows] & (~added | (number[rows] == before / axis.unit))
            if (after[rows][unmoved] == before[unmoved]).all():
                inserted[rows] = added
            else:
                self._follow(axis, held, rows, wanted, after, inserted)
        ends[:] = _held(active, after, held)
        changed, added = np.flatnonzero(named & (number != value)), np.flatnonzero(inserted)
        found = [self._replaced(column, changed, counts[changed], decimals[changed], layouts)]
        return [*found, self._added(axis, added, counts[added], layouts)] if len(added) else found

    def _increments(self, axis: WrittenAxis, held: float, ends: Array, layouts: _Layouts) -> list[PlainWords]:
        """The result of `_axis` for increments: each leads from the position on the control to the corrected end."""
        words, column = self.run.columns, axis.column
        present = Present(self._named[column], words.value[column], words.decimals[column], axis.decimals)
        active = self.programmed[:, column] & ~self.kept
        written = increments(present, self.corrected[:, column], active, held, axis.unit)
        ends[:] = written.ends
        changed = np.flatnonzero(active & present.named & (written.number != present.value))
        added = np.flatnonzero(active & ~present.named & (written.number != 0.0))
        found = [self._replaced(column, changed, written.counts[changed], written.decimals[changed], layouts)]
        return [*found, self._added(axis, added, written.counts[added], layouts)] if len(added) else found

    def _replaced(
        self, column: int, rows: np.ndarray, counts: Array, decimals: np.ndarray, layouts: _Layouts
    ) -> PlainWords:
        """Numbers in lines `rows` `(k,)` that replace those of a column; counts, decimals `(k,)`."""
        letter, behind, columns = np.zeros(len(rows), int), np.zeros(len(rows), bool), np.full(len(rows), column)
        return PlainWords(rows + self.run.first, columns, counts, decimals, letter, behind, *layouts.of(columns, rows))

    def _follow(
        self, axis: WrittenAxis, held: float, rows: np.ndarray, wanted: Array, after: Array, inserted: NDArrayBool
    ) -> None:
        """Line by line, where a position on the control is not on the grid of the words that are added."""
        named = self._named[axis.column]
        for row in rows.tolist():
            if not named[row]:
                number, before = float(wanted[row]), held / axis.unit
                inserted[row] = round(number - before, axis.decimals) != 0.0
                written = round(number, axis.decimals)
                after[row] = written * axis.unit if inserted[row] and written != before else held
            held = float(after[row])

    def _added(self, axis: WrittenAxis, rows: np.ndarray, counts: Array, layouts: _Layouts) -> PlainWords:
        """Words that are added in lines `rows` `(k,)`, behind the last word with a lower rank; counts `(k,)`."""
        words, named = self.run.columns, self._named[:, rows]
        ranks = np.array([rank_of(letter) for letter in self.run.lines.addresses])
        at = words.at[:, rows]
        lower = np.where(named & (ranks < rank_of(axis.name))[:, None], at, -1)
        behind = np.asarray((lower >= 0).any(axis=0))
        beside = np.where(behind, lower.argmax(axis=0), np.where(named, at, np.iinfo(at.dtype).max).argmin(axis=0))
        decimals = np.maximum(axis.decimals, words.decimals[beside, rows])
        numbers = counts * POWERS[decimals - axis.decimals]
        letter, styles = np.full(len(rows), ord(axis.name)), layouts.of(beside, rows)
        return PlainWords(rows + self.run.first, beside, numbers, decimals, letter, behind, *styles)


def simple_moves(motions: Motions) -> NDArrayBool:
    """True `(n,)` for straight moves that are alone in their blocks, and that nothing but their positions decides."""
    again = motions.block[1:] == motions.block[:-1]
    single = np.isin(motions.kind, (Kind.RAPID, Kind.LINE)) & ~motions.timed & ~motions.incremental
    single &= ~np.append(False, again) & ~np.append(again, False)
    single[[row for name in BY_ROW for row in getattr(motions, name)]] = False
    return np.asarray(single & ~np.isin(motions.block, list(motions.polar_ends)))


def plain_stretches(motions: Motions, special: Iterable[int], rewritten: Iterable[int] = ()) -> dict[int, PlainRun]:
    """Runs of plain lines that are written together, by their first rows: each line has one row, and no added block.

    special: rows of arcs and holes that can be written together. rewritten: indices of blocks that get further changes.
    """
    again = motions.block[1:] == motions.block[:-1]
    single = np.isin(motions.kind, (Kind.RAPID, Kind.LINE))
    single[list(special)] = True
    single[[row for row, paced in motions.paced.items() if paced.mode or paced.restored]] = False
    single &= ~np.isin(motions.block, list(rewritten))
    single &= ~np.append(False, again) & ~np.append(again, False)
    linear = list(motions.machine.translators)
    found = {}
    for part, first in zip(motions.blocks.parts, motions.blocks.firsts, strict=False):
        if isinstance(part, list):
            continue
        low, high = np.searchsorted(motions.block, [first, first + len(part)]).tolist()
        line = motions.block[low:high] - first
        names = np.any(part.columns.end[linear] > 0, axis=0)[line]
        chosen = single[low:high] & ~(motions.rotary_only[low:high] & names)
        for start, end in np.flatnonzero(np.diff(chosen, prepend=False, append=False)).reshape(-1, 2).tolist():
            found[low + start] = part.part(int(line[start]), int(line[end - 1]) + 1)
    return found


class _Layouts:
    """The layout after each line of a run."""

    def __init__(self, run: PlainRun, before: Layout) -> None:
        self._run, self._before, self._columns = run, before, run.columns
        numbers = before.numbers
        self._usual = run.lines.usual_numbers and numbers == NumberStyle()

    @cached_property
    def _marks(self) -> NumberMarks:
        return self._run.lines.marks(self._columns)

    @cached_property
    def _plus(self) -> NDArrayBool:
        """True `(lines,)` where a positive number gets a sign if its own word does not show it."""
        shown = (self._columns.end > 0) & ~self._marks.minus
        return self._last(shown, self._marks.plus, self._before.numbers.plus)

    @cached_property
    def _leading_zero(self) -> NDArrayBool:
        """True `(lines,)` where a number gets a zero before the point if its own word does not show it."""
        shown, zero = self._marks.bare | self._marks.zero, self._marks.zero
        return self._last(shown, zero, self._before.numbers.leading_zero)

    @cached_property
    def _comma(self) -> NDArrayBool:
        """True `(lines,)` where a number gets a comma if its own word does not show the decimal mark."""
        shown = (self._columns.end > 0) & (self._columns.decimals >= 0)
        return self._last(shown, self._marks.comma, self._before.numbers.mark == ",")

    def _last(self, shows: NDArrayBool, value: NDArrayBool, before: bool) -> NDArrayBool:
        """The value of the last word up to the end of each line that shows one; `before` before the first of them."""
        at = np.where(shows, self._columns.at, -1)
        word = at.argmax(axis=0)
        lines = np.arange(at.shape[1])
        return np.asarray(_held(at[word, lines] >= 0, value[word, lines], before))

    @cached_property
    def _blank(self) -> NDArrayBool:
        """True `(lines,)` where blanks separate words."""
        return _held(self._columns.blank >= 0, self._columns.blank == 1, self._before.blank)

    def after(self, lines: int) -> Layout:
        """The layout after the first lines."""
        last = lines - 1
        end = end_of(self._run.data(last, lines).decode(ENCODING))
        numbers = self._before.numbers
        if not self._usual:
            mark = "," if self._comma[last] else "."
            numbers = NumberStyle(bool(self._plus[last]), mark, bool(self._leading_zero[last]))
        return replace(self._before, blank=bool(self._blank[last]), numbers=numbers, end=end)

    def of_feeds(self, line: np.ndarray) -> tuple[NDArrayBool, NDArrayBool, NDArrayBool, NDArrayBool]:
        """The same for F words in lines `(k,)`, which have no plus."""
        none = np.zeros(len(line), bool)
        zero, comma = (~none, none) if self._usual else (self._leading_zero[line], self._comma[line])
        return none, zero, self._blank[line], comma

    def of(self, axis: np.ndarray, line: np.ndarray) -> tuple[NDArrayBool, NDArrayBool, NDArrayBool, NDArrayBool]:
        """Styles of words like those of axes in lines `(k,)`: plus, zero, blank and comma of `PlainWords`."""
        blank = self._blank[line]
        if self._usual:
            none = np.zeros(len(line), bool)
            return none, ~none, blank, none
        plus, minus, bare, zero, comma = (mark[axis, line] for mark in self._marks)
        leads = ~bare & (zero | self._leading_zero[line])
        comma = np.where(self._columns.decimals[axis, line] >= 0, comma, self._comma[line])
        return np.where(minus, self._plus[line], plus), leads, blank, comma


def _held(sets: NDArrayBool, value: Array, before: float) -> np.ndarray:
    """The value `(lines,)` of the last line that sets one; `before` before the first of them."""
    if sets.all():
        return value
    last = np.maximum.accumulate(np.where(sets, np.arange(len(sets)), -1))
    return np.where(last >= 0, value[last], before)
