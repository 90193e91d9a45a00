"""Numbers in messages and reports."""

from __future__ import annotations

LEAST_P = 1e-300
"""Probability below which its value is not shown."""


def rounded(value: float, digits: int = 2) -> str:
    """A number of so many significant digits, with an exponent only below 0.0001 and from a million on."""
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e" in text and 1.0 <= abs(value) < 1e6 else text


def probability(p: float, digits: int = 1) -> str:
    """`p = 0.03`, or `p < 1e-300`."""
    return f"p = {p:.{digits}g}" if p >= LEAST_P else f"p {p_value(p)}"


def p_value(p: float) -> str:
    """`0.025`, or `< 1e-300`."""
    return f"{p:.2g}" if p >= LEAST_P else f"< {LEAST_P:g}"
