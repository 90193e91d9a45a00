"""What a diagnosis (contract 4.3) is worth: causes named, causes blamed, sizes within their uncertainty."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from virtual_machine.cause import Answer

Found = Mapping[str, Any]
"""An effect of the diagnosis, with what the new calibration says of it."""
COVERAGE = 2.0
PLACES = ("component", "circle", "station")
"""What an effect that is of no axis may give as its axis."""


@dataclass(frozen=True)
class Score:
    """Score of one question."""

    named: tuple[bool, ...]
    """Kind, axis and further attributes of each cause: True where they are named."""
    blamed: tuple[str, ...]
    """Effects that are not there."""
    inside: int = 0
    of: int = 0
    """Parameters within k = 2 of the truth, of the causes that are named."""
    tied: bool = False
    """True where a cause is not named itself but stands among the alternatives of what is."""


def findings(diagnosis: Mapping[str, Any], calibration: Mapping[str, Any]) -> list[Found]:
    """The effects of a diagnosis, each with the fields that its like has in the calibration."""
    result: list[Found] = []
    for effect in diagnosis["effects"]:
        alike = [e for e in calibration["effects"] if _same(e, effect)]
        described: dict[str, Any] = next(iter(alike), {})
        numbers = {"parameters": effect.get("parameters", {}), "u": effect.get("u", {})}
        result.append(
            {**described, **{key: v for key, v in effect.items() if v is not None}, **numbers, "model": described}
        )
    return result


def score(diagnosis: Mapping[str, Any], calibration: Mapping[str, Any], answers: Sequence[Answer]) -> Score:
    """A diagnosis and its new calibration against what was put in."""
    found = findings(diagnosis, calibration)
    named, explained, inside, of = [], [], 0, 0
    for answer in answers:
        right = [effect for effect in found if names(effect, answer)]
        named.append(bool(right))
        explained += [id(effect) for effect in right[:1]]
        if right:
            within = sizes_inside(right[0], answer)
            inside, of = inside + sum(within), of + len(within)
    blamed = tuple(title(effect) for effect in found if id(effect) not in explained)
    tied = any(
        other.get("kind") in answer.kinds
        for answer, done in zip(answers, named, strict=True)
        if not done
        for effect in found
        for other in effect.get("alternatives", ())
    )
    return Score(tuple(named), blamed, inside, of, tied)


def names(effect: Found, answer: Answer) -> bool:
    """True when the effect is what the answer asks for."""
    if effect.get("kind") not in answer.kinds or (answer.axes and effect.get("axis") not in answer.axes):
        return False
    return all(_says(effect, key, value) for key, value in answer.fields.items())


def title(effect: Found) -> str:
    """Kind, axis and component, for people."""
    told = [effect.get(key) for key in ("kind", "axis", "component", "circle", "station", "verdict")]
    return " ".join(str(value) for value in told if value)


def sizes_inside(effect: Found, answer: Answer) -> list[bool]:
    """For each parameter, whether it lies within k = 2 of what was put in; a missing one does not."""
    signs = (1.0, -1.0) if answer.either_sign else (1.0,)
    return max(([_within(effect, key, value, sign) for key, value in _each(answer)] for sign in signs), key=sum)


def _each(answer: Answer) -> Iterator[tuple[str, tuple[int, float]]]:
    for key, values in answer.sizes.items():
        yield from ((key, (i, value)) for i, value in enumerate(values))


def _within(effect: Found, key: str, wanted: tuple[int, float], sign: float) -> bool:
    i, value = wanted
    special = {"amplitude": _amplitude, "coefficient of P2 X": _coefficient, "coefficient of P2 Y": _coefficient}
    given = special[key](effect, key) if key in special else _parameter(effect, key, i)
    if given is None:
        return False
    found, u = given
    return bool(u > 0 and abs(found - sign * value) <= COVERAGE * u)


def _parameter(effect: Found, key: str, i: int) -> tuple[float, float] | None:
    """A number of the effect, by its key and place in a row, with its standard uncertainty."""
    values, us = (np.atleast_1d(effect[part].get(key, ())) for part in ("parameters", "u"))
    return (float(values[i]), float(us[i])) if len(values) > i and len(us) > i else None


def _amplitude(effect: Found, _: str) -> tuple[float, float] | None:
    """Amplitude of the first harmonic of a cyclic error."""
    for unit in ("um", "urad"):
        sine, cosine = (_parameter(effect, f"{wave}_{unit}", 0) for wave in ("sine", "cosine"))
        if sine and cosine:
            size = math.hypot(sine[0], cosine[0])
            return size, math.hypot(sine[0] * sine[1], cosine[0] * cosine[1]) / size
    return None


def _coefficient(effect: Found, key: str) -> tuple[float, float] | None:
    """Of P2 in the axis that the key ends with, times P1 in the other one, whichever is the effect's own.

    The coefficients stand in the order of the calibration file: the degree of the own axis runs first, from 0, that of
    the other from 1.
    """
    described = effect["model"]
    if "coefficients" not in described:
        return None
    degrees = (2, 1) if described["axis"] == key[-1] else (1, 2)
    if degrees[0] > described["own_degree"] or degrees[1] > described["other_degree"]:
        return None
    k = (degrees[1] - 1) * (described["own_degree"] + 1) + degrees[0]
    return float(described["coefficients"][k]), float(described["u"][k])


def _says(effect: Found, key: str, value: object) -> bool:
    """True when the effect gives the field this value, in itself or in its parameters."""
    told = effect.get(key, effect.get("axis") if key in PLACES else effect["parameters"].get(key))
    if key == "both axes":
        return bool({effect.get("axis"), effect.get("other")} == value)
    if key == "rows":
        return told is not None and {int(row) for row in told} == set(value)  # type: ignore[call-overload]
    return bool(told == value)


def _same(one: Mapping[str, Any], effect: Mapping[str, Any]) -> bool:
    """True when an effect of the calibration may be that of the diagnosis."""
    kinds = {"thermal-scale": "thermal-scale-sensor", "thermal-drift": "thermal-drift-sensor"}
    kind = effect.get("kind", "")
    if one["kind"] not in (kind, kinds.get(kind)):
        return False
    return all(
        effect.get(key) in (None, one.get(key)) for key in ("axis", "component", "circle", "harmonic", "station")
    )
