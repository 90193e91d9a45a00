"""Numbers written in the style of the program they stand in."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

_NUMBER = re.compile(r"(?P<sign>[+-]?)[ \t]*(?P<whole>\d*)(?P<mark>[.,]?)(?P<decimals>\d*)")


def decimals_for(resolution: float) -> int:
    """Decimals that hold a resolution: 4 for 0.0001, 6 for 0.0001 mm in inches (3.9e-6)."""
    return max(0, math.ceil(-math.log10(resolution) - 1e-9))


def decimals_of(text: str) -> int:
    """Decimals that a number is written with."""
    match = _NUMBER.fullmatch(text)
    return len(match["decimals"]) if match else 0


@dataclass(frozen=True)
class NumberStyle:
    """How a program writes numbers: sign on positive ones, decimal mark, zero before the mark."""

    plus: bool = False
    mark: str = "."
    leading_zero: bool = True

    @classmethod
    def of(cls, text: str, otherwise: NumberStyle) -> NumberStyle:
        """The style of one written number; what it does not show is taken from `otherwise`."""
        match = _NUMBER.fullmatch(text)
        if match is None:
            return otherwise
        negative = match["sign"] == "-"
        leading_zero = otherwise.leading_zero
        if match["whole"].strip("0") == "" and match["decimals"]:
            leading_zero = match["whole"] != ""
        return cls(otherwise.plus if negative else match["sign"] == "+", match["mark"] or otherwise.mark, leading_zero)

    def write(self, value: float, decimals: int) -> str:
        """The number with so many decimals; zero has no minus."""
        digits = f"{abs(value):.{decimals}f}"
        if not self.leading_zero and digits.startswith("0."):
            digits = digits[1:]
        nonzero = digits.strip("0.") != ""
        sign = "-" if value < 0 and nonzero else "+" if self.plus else ""
        return sign + digits.replace(".", self.mark)
