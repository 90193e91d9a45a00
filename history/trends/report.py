"""The trends of a machine for people."""

from __future__ import annotations

import datetime
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from history.causes import cause_of_change
from history.trends.changes import Found
from history.trends.limits import HAS_LEFT, MAY_HAVE_LEFT, Leaving
from history.trends.series import YEAR_S, Series, day_of, years_of
from history.trends.trend import A_YEAR, FEWEST_RESULTS, Trend
from kinematics.files.number_text import odds_by_log, plus_minus, uncertainty
from kinematics.transforms import Array
from rendering.figures import COLOURS, RED, Figure, Panel, area, bars_of_error, extent, grid, level, line
from rendering.report import Section, Table

if TYPE_CHECKING:
    from history.schema import Entry

CHANGES = ("quantity", "what", "size and U (k=2)", "between", "odds", "verdict")
NOW = ("quantity", "now, U (k=2)", "unit", "in a year, 95 %", "scatter", "results", "last")
TRENDS_ACROSS = 2
WORDS = {"change": "change", "drift": "slow change, a year", "method": "offset of the method"}


def verdict_of(trends: Sequence[Trend]) -> str:
    """The announced changes, and the limits that are left, in sentences."""
    lines = [_announced(trend, found) for trend in trends for found in trend.changes if found.verdict == "announced"]
    lines += [sentence for trend in trends if trend.leaves for sentence in leaving_sentences(trend, trend.leaves)]
    none = f"No change of {len(trends)} quantities is announced." if trends else "No quantity has a trend yet."
    return "\n".join(lines) or none


def _announced(trend: Trend, found: Found) -> str:
    """An announced change in a sentence."""
    name, unit = trend.series.name, trend.series.unit
    size = plus_minus(found.size, 2.0 * found.u, 1, "+")
    if found.kind == "method":
        return f"{name}: results of {found.name} differ from the others by {size} {unit} (U, k=2): none of the machine."
    if found.kind == "drift" and abs(found.size) < 2.0 * found.u and found.tied_with:
        return f"{name} wanders, by {size} {unit} a year in the mean (U, k=2), odds {odds_by_log(found.log_odds)}."
    if found.kind == "drift":
        how = f"moves (a drift, or a {' or a '.join(found.tied_with)})" if found.tied_with else "drifts"
        return f"{name} {how} by {size} {unit} a year (U, k=2), odds {odds_by_log(found.log_odds)}."
    event = f", the dates of the {found.name}" if found.name else ""
    or_slow = " It may be slow as well." if found.tied_with else ""
    dates = " and ".join(str(day_of(time)) for time in found.between)
    return (
        f"{name} changed by {size} {unit} (U, k=2) between {dates}{event}, odds {odds_by_log(found.log_odds)}.{or_slow}"
    )


def leaving_sentences(trend: Trend, leaves: Leaving) -> Iterator[str]:
    """When a quantity leaves its limit, and the measurement that decides it."""
    limit, end = f"{leaves.limit:g} {trend.series.unit}", _month(float(trend.ahead.times[-1]))
    begin, name = float(trend.ahead.times[0]), trend.series.name
    if leaves.first is None:
        stays = f"with a probability of {1.0 - MAY_HAVE_LEFT:.0%}, if nothing happens."
        yield f"{name} stays within {limit} until {end} {stays}"
        return
    if leaves.last is None:
        until = f"from {_month(leaves.first)} on, and that is not certain before {end}"
    elif leaves.last == begin:
        yield f"{name} is outside of {limit}."
        return
    else:
        until = f"between {_month(leaves.first)} and {_month(leaves.last)}"
    yield f"{name} leaves {limit} {until} (probability {MAY_HAVE_LEFT:.0%} and {HAS_LEFT:.0%}), if nothing happens."
    when = "now" if leaves.first == begin else f"by {day_of(leaves.first)}"
    chosen = leaves.chosen
    if chosen is not None:
        yield (
            f"Measure {name} again {when}: {chosen.method} with U {uncertainty(chosen.U, 1)} {trend.series.unit} "
            f"decides it with a probability of {chosen.probability:.0%}."
        )


def _month(time: float) -> str:
    return f"{day_of(time):%B %Y}"


def trend_sections(trends: Sequence[Trend], short: Sequence[Series]) -> Iterator[Section]:
    """Tables of changes and of the present state, and the figures."""
    rows = [row for trend in trends for row in map(partial(_change_row, trend), trend.changes)]
    text = (
        "Announced: odds of 150 to 1 against none, and against an offset of the method of measurement. Likely: 20 to "
        "1. Tied: machine or method; a result of the earlier method decides."
    )
    if rows:
        yield Section("Changes", text, Table(CHANGES, rows))
    few = (
        f"Quantities with fewer than {FEWEST_RESULTS} results have no trend: {', '.join(s.name for s in short)}."
        if short
        else ""
    )
    yield Section("Now and in a year", few, Table(NOW, list(map(_now_row, trends))) if trends else None)
    if trends:
        text = "Results with U (k=2), the forecast with its band of 95 %, changes, and limits."
        yield Section("Over time", text, figure=partial(_figure, trends))


def _change_row(trend: Trend, found: Found) -> tuple[str, ...]:
    what = f"{WORDS[found.kind]} {found.name}".strip()
    dates = " to ".join(str(day_of(time)) for time in found.between)
    tied = ", ".join(found.tied_with)
    tie = "" if not tied else f" with {tied}" if found.verdict == "tied" else f", or a {tied}"
    size = f"{plus_minus(found.size, 2.0 * found.u, 2, '+')} {trend.series.unit}"
    return trend.series.name, what, size, dates, odds_by_log(found.log_odds), f"{found.verdict}{tie}"


def _now_row(trend: Trend) -> tuple[str, ...]:
    low, high = (float(end[A_YEAR]) for end in trend.ahead.band)
    now = plus_minus(float(trend.ahead.mean[0]), 2.0 * float(trend.ahead.u[0]), 2)
    series = trend.series
    span, last = f"{low:.1f} to {high:.1f}", str(day_of(float(series.times[-1])))
    return series.name, now, series.unit, span, f"{trend.scatter:.2f}", str(len(series.times)), last


def _figure(trends: Sequence[Trend]) -> Figure:
    return grid(list(map(_panel, trends)), TRENDS_ACROSS)


def _panel(trend: Trend) -> Panel:
    """The results, the forecast, the changes and the limit of a quantity."""
    series = trend.series
    panel = Panel("", f"{series.name}, {series.unit}", series.name)
    for number, method in enumerate(dict.fromkeys(series.methods)):
        own = np.array([each == method for each in series.methods])
        colour = COLOURS[number % len(COLOURS)]
        bars_of_error(panel, _dates(series.times[own]), series.values[own], 2.0 * series.u[own], colour, method, size=4)
    low, high = trend.ahead.band
    dates = _dates(trend.ahead.times)
    area(panel, dates, low, high, COLOURS[0])
    line(panel, dates, trend.ahead.mean, COLOURS[0], "forecast")
    ends = float(series.values.min()), float(series.values.max())
    for found in trend.changes:
        if found.kind == "change":
            middle: Any = str(day_of(sum(found.between) / 2.0))
            extent(panel, middle, *ends, found.name or "change", RED)
    if trend.leaves is not None:
        for side in (-trend.leaves.limit, trend.leaves.limit):
            level(panel, side, "limit", RED, dash="dot")
    return panel


def _dates(times: Array) -> Array:
    """Days, as text, which the figure shows as dates."""
    return np.array([str(day_of(time)) for time in times.tolist()])


def question_of_cause(trends: Sequence[Trend], entries: Sequence[Entry], machine: str) -> str:
    """Which cause changed: the answer of a diagnosis across the last announced change, or the command that finds it.

    That is the first data after the change, with the last calibration before it. Empty where the history has neither.
    """
    moved = [f for trend in trends for f in trend.changes if f.kind == "change" and f.verdict == "announced"]
    if not moved:
        return ""
    first, last = max((each.between for each in moved), key=lambda ends: ends[1])
    if answer := cause_of_change(entries, day_of(first), day_of(last)):
        return answer
    calibrations = [e for e in entries if e.kind in ("calibration", "diagnosis") and _time(e) <= first and e.figures]
    after = [e for e in entries if e.kind in ("measurement", "calibration", "diagnosis") and _time(e) >= last]
    data = next((f.path for e in after for f in e.files if Path(f.path).suffix.lower() != ".json"), None)
    if not calibrations or data is None:
        return ""
    before = calibrations[-1]
    return (
        f"Which cause changed: ncomp diagnose {data} --machine {machine} --calibration {before.id}-{before.kind}.json "
        "-o new.json ('ncomp history export' writes this calibration)."
    )


def _time(entry: Entry) -> float:
    return years_of(entry.at)


def moment_now() -> float:
    """Now, years since 1970."""
    return datetime.datetime.now(datetime.UTC).timestamp() / YEAR_S
