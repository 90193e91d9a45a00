"""Numbers for files: in the units of a column, so that reading gives the same values."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from kinematics.transforms import Array


def in_units(column: Array, size: float) -> Array:
    """Numbers in units of `size` that give the same values when read, with few digits if possible."""
    return converted(column, lambda inside: inside / size, lambda outside: outside * size)


def converted(column: Array, out: Callable[[Array], Array], back: Callable[[Array], Array]) -> Array:
    """Numbers by the function `out`, from which `back` gives the same values, with few digits if possible."""
    exact = out(column)
    result = exact
    for candidate in (np.nextafter(exact, np.inf), np.nextafter(exact, -np.inf), exact, np.round(exact, 9)):
        result = np.where(back(candidate) == column, candidate, result)
    return result


def only(rows: np.ndarray, column: Array) -> np.ndarray:
    """The column as texts, empty in other rows."""
    return np.where(rows, texts(column), "")


def texts(column: np.ndarray) -> list[str]:
    """The shortest texts that give the values again."""
    return list(map(str, column.tolist()))


def joined(values: tuple[float, ...]) -> str:
    """The values of a header line, with a blank between them."""
    return " ".join(f"{value!r}" for value in values)
