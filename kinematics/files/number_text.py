"""Numbers in messages and reports."""

from __future__ import annotations

import math

LEAST_P = 1e-300
"""Probability below which its value is not shown."""
LARGEST_LOG_ODDS = 700.0
"""Largest logarithm of odds whose odds are a number."""
TELLING = 1e6
"""Odds beyond which their size says nothing more."""


def rounded(value: float, digits: int = 2) -> str:
    """A number of so many significant digits, with an exponent only below 0.0001 and from a million on."""
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e" in text and 1.0 <= abs(value) < 1e6 else text


def uncertainty(u: float, decimals: int) -> str:
    """An uncertainty with so many decimals; with one significant digit where these would show it as zero."""
    text = f"{u:.{decimals}f}"
    return text if u == 0.0 or float(text) else f"{u:.1g}"


def plus_minus(value: float, u: float, decimals: int, sign: str = "") -> str:
    """A value and its uncertainty with equal decimals, as `uncertainty` needs; the value alone where u is zero.

    sign: "+" for a sign before positive values too.
    """
    shown = uncertainty(u, decimals)
    places = max(decimals, len(shown.partition(".")[2]))
    return f"{value:{sign}z.{places}f}" + (f" ± {shown}" if u else "")


def odds(value: float) -> str:
    """Odds in words."""
    return f"{value:,.0f} to 1" if value < TELLING else f"over {TELLING:,.0f} to 1"


def odds_by_log(log_odds: float) -> str:
    """Odds in words, by their natural logarithm."""
    return odds(math.exp(min(log_odds, LARGEST_LOG_ODDS)))


def amount(value: float, unit: str) -> str:
    """A size with two decimals; one that they do not show is not shown as zero."""
    return f"{value:.2f} {unit}" if abs(value) >= 0.005 else f"less than 0.01 {unit}"


def probability(p: float, digits: int = 1) -> str:
    """`p = 0.03`, or `p < 1e-300`."""
    return f"p = {p:.{digits}g}" if p >= LEAST_P else f"p {p_value(p)}"


def p_value(p: float) -> str:
    """`0.025`, or `< 1e-300`."""
    return f"{p:.2g}" if p >= LEAST_P else f"< {LEAST_P:g}"
