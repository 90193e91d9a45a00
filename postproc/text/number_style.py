"""Numbers in the style of their program; numbers given by a user."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from functools import cache
from typing import TypeVar

import msgspec

from kinematics.files.mistaken import number_hint
from kinematics.user_error import UserError

Value = TypeVar("Value")
MOST_DECIMALS = 9
"""Largest number of decimals that are written."""


@cache
def decimals_for(resolution: float) -> int:
    """Decimals that hold a resolution: 4 for 0.0001, 6 for 0.0001 mm in inches (3.9e-6)."""
    return max(0, math.ceil(-math.log10(resolution) - 1e-9))


def decimals_of(text: str) -> int:
    """Decimals that a number is written with."""
    mark = text.find(".")
    if "," in text:
        mark = max(mark, text.find(","))
    return len(text) - mark - 1 if mark >= 0 else 0


def decimals_holding(value: float) -> int:
    """Fewest decimals that write a value without rounding it, MOST_DECIMALS at most."""
    near = 0.5 * 10.0**-MOST_DECIMALS
    return next((n for n in range(MOST_DECIMALS) if abs(round(value, n) - value) < near), MOST_DECIMALS)


class NumberStyle(msgspec.Struct, frozen=True):
    """How a program writes numbers: sign on positive ones, decimal mark, zero before the mark."""

    plus: bool = False
    mark: str = "."
    leading_zero: bool = True

    @classmethod
    def of(cls, text: str, otherwise: NumberStyle) -> NumberStyle:
        """The style of one written number; with missing properties from `otherwise`."""
        if not text:
            return otherwise
        if otherwise == USUAL and _USUAL_NUMBER(text):
            return otherwise
        sign = text[0] if text[0] in "+-" else ""
        digits = text[len(sign) :].lstrip()
        plus = otherwise.plus if sign == "-" else sign == "+"
        mark = "," if "," in digits else "." if "." in digits else otherwise.mark
        leading_zero = digits[0] not in ".," and (digits.startswith(("0.", "0,")) or otherwise.leading_zero)
        if (plus, mark, leading_zero) == (otherwise.plus, otherwise.mark, otherwise.leading_zero):
            return otherwise
        return cls(plus, mark, leading_zero)

    def write(self, value: float, decimals: int) -> str:
        """The number with so many decimals; zero has no minus."""
        digits = f"{abs(value):.{decimals}f}"
        if not self.leading_zero and digits.startswith("0."):
            digits = digits[1:]
        nonzero = digits.strip("0.") != ""
        sign = "-" if value < 0 and nonzero else "+" if self.plus else ""
        return sign + digits.replace(".", self.mark)


USUAL = NumberStyle()
_USUAL_NUMBER = re.compile(r"-?\d[^,]*\.[^,]*\Z").match
"""Shows a number in this style, as nearly all are."""


def given_number(text: str, where: str) -> float:
    """A finite number that a user gave; UserError, beginning with `where`, for anything else."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        hint = number_hint(text) or "; write a finite number, such as 20.5"
        raise UserError(f"{where}: {text.strip()!r} is no number{hint}")
    return number


def given_once(pairs: Iterable[tuple[str, Value]], option: str) -> dict[str, Value]:
    """The values that a user gave by name; UserError, beginning with `option`, for a name that was given twice."""
    found: dict[str, Value] = {}
    for name, value in pairs:
        if name in found:
            raise UserError(f"{option}{name} is given twice: give it once")
        found[name] = value
    return found
