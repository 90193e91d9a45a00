"""A diagnosis (contract 4.3) against the truth: effects named, tied, missed and blamed; sizes within U (k = 2).

named: an effect of the right kind, axis and component. tied: none, but an effect of the verdict `tied` has the right
one among its alternatives. An effect without a name is named if it is reported as unexplained, with at least one of its
variables, or added as `unnamed`. Each other effect of the diagnosis is false, whatever its name and verdict: also a
second one of the right kind, a higher frequency of a basis, or an effect that is tied with one that is named itself.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from shop_floor.chain import Machine
from shop_floor.hidden import Answer

Effect = Mapping[str, Any]
COVERAGE = 2.0
SAME_PERIOD = 0.02
ROWS_FOUND, ROWS_TOO_MANY = 0.8, 0.1
"""Least share of the outliers that are found, and largest share (or one row) of others among them."""


class Score(NamedTuple):
    """Score of a diagnosis; `named`, `tied` and `missed` count hidden effects."""

    named: int
    tied: int
    missed: int
    false: tuple[str, ...]
    """Effects that are not there, for people."""
    inside: int
    sizes: int
    """Sizes within U (k = 2), of all that are given for named effects."""


def score(
    diagnosis: Mapping[str, Any],
    answers: Sequence[Answer],
    machine: Machine,
    calibration: Mapping[str, Any] | None = None,
    allowed: Sequence[Answer] = (),
) -> Score:
    """The score of a diagnosis; `calibration` is its new one, if it was accepted.

    allowed: answers that are neither required nor false, also as alternatives of a tie.
    """
    left = list(diagnosis["effects"])
    named = tied = 0
    inside: list[bool] = []
    unnamed: list[Answer] = []
    for answer in answers:
        found = _taken(left, answer)
        if found:
            named += 1
            inside += _sizes(found, answer, machine, calibration)
        elif not answer.kinds and _unexplained(diagnosis, answer):
            named += 1
        else:
            unnamed.append(answer)
    for answer in unnamed:
        partner = next((effect for effect in left if _tied(effect, answer)), None)
        if partner is not None:
            left.remove(partner)
            tied += 1
    for answer in allowed:
        left = [effect for effect in left if not (matches(effect, answer) or _tied(effect, answer))]
    relatives = {kind for answer in answers for kind in answer.relatives}
    false = tuple(title(effect) for effect in left if effect["kind"] not in relatives)
    return Score(named, tied, len(unnamed) - tied, false, sum(inside), len(inside))


def title(effect: Effect) -> str:
    """Kind, place, component and verdict of an effect, for people."""
    parts = [effect["kind"], place(effect), effect.get("component"), effect.get("verdict")]
    return " ".join(dict.fromkeys(str(part) for part in parts if part))


def place(effect: Effect) -> str | None:
    """The axis of an effect; else the direction of the tool, or the circle of the tracker."""
    return next((str(effect[key]) for key in ("axis", "component", "circle") if effect.get(key)), None)


def matches(effect: Effect, answer: Answer) -> bool:
    """True if the effect of a diagnosis is the one of the answer."""
    if effect["kind"] not in answer.kinds or (answer.where and place(effect) not in answer.where):
        return False
    if answer.component and effect.get("component", answer.component) != answer.component:
        return False
    if effect.get("other") and {effect["axis"], effect["other"]} != answer.where:
        return False
    period = effect.get("parameters", {}).get("period_mm")
    if period is not None and "period_mm" in answer.sizes:
        return bool(np.all(np.abs(np.divide(period, answer.sizes["period_mm"]) - 1.0) < SAME_PERIOD))
    return not answer.rows or _same_rows(effect, answer)


def _taken(left: list[Effect], answer: Answer) -> Effect | None:
    """The effect of an answer, taken out of those left, with those in the directions that are small."""
    found = next((effect for effect in left if matches(effect, answer)), None)
    if found is None and not answer.kinds:
        found = next((effect for effect in left if effect["kind"] == "unnamed"), None)
    if found is not None:
        left.remove(found)
        for direction in answer.also - answer.where:
            side = next((e for e in left if e["kind"] in answer.kinds and place(e) == direction), None)
            if side is not None:
                left.remove(side)
    return found


def _tied(effect: Effect, answer: Answer) -> bool:
    """True if the effect is tied and the answer is among its alternatives."""
    if effect.get("verdict") != "tied":
        return False
    places = answer.where | answer.also
    return any(
        other["kind"] in answer.kinds and (not places or other.get("axis") in places)
        for other in effect.get("alternatives", ())
    )


def _unexplained(diagnosis: Mapping[str, Any], answer: Answer) -> bool:
    """True if the unexplained residual depends on a variable of the answer."""
    unexplained = diagnosis.get("unexplained")
    if not unexplained:
        return False
    return not answer.variables or bool(answer.variables & set(unexplained["variables"]))


def _same_rows(effect: Effect, answer: Answer) -> bool:
    """True if most outliers are found, and hardly any others."""
    rows = effect.get("rows", effect.get("parameters", {}).get("rows"))
    if rows is None:
        return True
    found = {int(row) for row in rows}
    others = len(found - answer.rows)
    return len(found & answer.rows) >= ROWS_FOUND * len(answer.rows) and others <= max(1, ROWS_TOO_MANY * len(found))


def _sizes(effect: Effect, answer: Answer, machine: Machine, calibration: Mapping[str, Any] | None) -> Iterator[bool]:
    """For each size of the answer that the diagnosis gives, whether it lies within U (k = 2)."""
    if answer.harmonic is not None and effect.get("harmonic") != answer.harmonic:
        return
    for key, value in answer.sizes.items():
        true, found, u = (
            _coefficient(effect, key[3:], float(np.ravel(value)[0]), machine, calibration)
            if key.startswith("P2 ")
            else (value, effect.get("parameters", {}).get(key), effect.get("u", {}).get(key))
        )
        if found is None or u is None or np.size(found) != np.size(true):
            continue
        signs = (1.0, -1.0) if answer.either_sign else (1.0,)
        within = [
            [bool(inside) for inside in np.abs(np.ravel(found) - sign * np.ravel(true)) <= COVERAGE * np.ravel(u)]
            for sign in signs
        ]
        yield from max(within, key=sum)


def _coefficient(
    effect: Effect, axis: str, value: float, machine: Machine, calibration: Mapping[str, Any] | None
) -> tuple[float, float | None, float | None]:
    """True and found coefficient of P2 of an axis times P1 of the other one, and its u, over the file's intervals."""
    alike = [
        entry
        for entry in (calibration or {"effects": []})["effects"]
        if all(entry.get(key) == effect.get(key) for key in ("kind", "axis", "component", "other"))
    ]
    if not alike:
        return value, None, None
    entry = alike[0]
    own_first = entry["axis"] == axis
    degrees = (2, 1) if own_first else (1, 2)
    if degrees[0] > entry["own_degree"] or degrees[1] > entry["other_degree"]:
        return value, None, None
    intervals = entry["own_interval"], entry["other_interval"]
    names = entry["axis"], entry["other"]
    own, other = (
        (b - a) / (machine.axis(n).high - machine.axis(n).low) for (a, b), n in zip(intervals, names, strict=True)
    )
    curved, straight = (own, other) if own_first else (other, own)
    k = (degrees[1] - 1) * (entry["own_degree"] + 1) + degrees[0]
    return value * curved**2 * straight, entry["coefficients"][k], entry["u"][k]
