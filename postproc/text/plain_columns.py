"""The words of plain lines as columns, and the values of their numbers, all of a text together."""

from __future__ import annotations

from typing import NamedTuple

import msgspec
import numpy as np

from kinematics.machine import NDArrayBool
from kinematics.transforms import Array, read_only
from postproc.text.number_style import MOST_DECIMALS

NUMBER_CHARACTERS = 12
"""Characters of the number of an axis, at most, without sign: its digits are an integer that a float holds exactly."""
PACKED = 8
"""Characters of a number that are read together, as one integer of 64 bits."""
POWERS = read_only(10.0 ** np.arange(23))
"""Powers of ten that a float holds exactly."""


def values_of(text: bytes, start: np.ndarray, end: np.ndarray, decimals: np.ndarray) -> Array:
    """Values `(k,)` of numbers without signs from `start` to `end`, each the float nearest to its digits.

    decimals `(k,)`: -1 for a number without a point. Of numbers that are wider than `NUMBER_CHARACTERS` or have more
    than MOST_DECIMALS the values are undefined.
    """
    values, short = np.zeros(len(start)), end - start <= PACKED
    present = (np.flatnonzero(np.bincount(np.minimum(decimals, MOST_DECIMALS) + 1)) - 1).tolist()
    for several in present:
        found, unit = decimals == several, POWERS[max(several, 0)]
        for rows, read in ((found & short, _packed), (found & ~short, _spelled)):
            if rows.all():
                return np.asarray(read(text, start, end, several) / unit)
            if rows.any():
                values[rows] = read(text, start[rows], end[rows], several) / unit
    return values


def _packed(text: bytes, start: np.ndarray, end: np.ndarray, decimals: int) -> Array:
    """The digits `(k,)` of numbers of up to PACKED characters with these decimals, as integers."""
    padded = b"0" * PACKED + text
    characters = np.ndarray((len(text) + 1,), "<u8", padded, strides=(1,))[end]
    if decimals >= 0:  # the digits before the point move to its place
        behind = np.uint64((1 << 64) - (1 << 8 * (PACKED - decimals)))
        characters = (characters & behind) | ((characters << np.uint64(8)) & ~behind)
    unused = ((PACKED - (end - start) + (decimals >= 0)) * 8).astype(np.uint64)
    digits = (characters >> unused << unused) & np.uint64(0x0F0F0F0F0F0F0F0F)
    # pairs of digits, and then the four pairs at once
    pairs = digits * np.uint64(10) + (digits >> np.uint64(8))
    alternate = np.uint64(0x000000FF000000FF)
    outer = (pairs & alternate) * np.uint64(100 + (1_000_000 << 32))
    inner = ((pairs >> np.uint64(16)) & alternate) * np.uint64(1 + (10_000 << 32))
    return np.asarray(((outer + inner) >> np.uint64(32)).astype(float))


def _spelled(text: bytes, start: np.ndarray, end: np.ndarray, decimals: int) -> Array:
    """The result of `_packed` for numbers of up to `NUMBER_CHARACTERS` characters."""
    width = np.minimum(end - start, NUMBER_CHARACTERS)
    places = np.arange(int(width.max()), dtype=np.int32)[:, None]
    digits = np.frombuffer(text, np.uint8)[np.maximum(end - 1 - places, 0)] - np.uint8(ord("0"))
    digits *= places < width
    weights = np.concatenate([POWERS[:decimals], [0.0], POWERS[decimals:]]) if decimals >= 0 else POWERS
    return np.asarray(weights[: len(places)] @ digits.astype(float))


class NumberMarks(NamedTuple):
    """How numbers are written; columns of words `(addresses, lines)`."""

    plus: NDArrayBool
    minus: NDArrayBool
    bare: NDArrayBool
    """True for no digit before the point."""
    zero: NDArrayBool
    """True for the digit 0 alone before the point."""
    comma: NDArrayBool
    """True for a comma instead of the point."""


class PlainVectors(NamedTuple):
    """The vectors of plain lines."""

    tool: Array
    """Tool vectors `(lines, 3)`, 0 for a component without a word; nan in lines without one."""
    normal: NDArrayBool
    """True `(lines,)` for a surface normal."""


class ReadWords(msgspec.Struct, frozen=True, eq=False):
    """The words of lines in their order `(words,)`."""

    line: np.ndarray
    letter: np.ndarray
    """Address, upper case."""
    at: np.ndarray
    start: np.ndarray
    end: np.ndarray
    """Address at `at`, number from `start` to `end`."""
    decimals: np.ndarray
    """Decimals; -1 for a number without a point."""
    several_points: np.ndarray


class PlainColumns(msgspec.Struct, frozen=True, eq=False):
    """The words of plain lines: columns `(lines,)`, and `(addresses, lines)` with zeros where a line has no such word.

    Addresses are those of the lines: first the axes, then those of centres and radii of arcs.
    """

    plain: NDArrayBool
    motion: np.ndarray
    """Motion that the line names; -1 for none."""
    at: np.ndarray
    """Position of the address in the piece."""
    start: np.ndarray
    """Position of the number."""
    end: np.ndarray
    """Position behind the number; 0 where the line omits the word."""
    decimals: np.ndarray
    """Decimals; -1 for a number without a point."""
    value: Array
    blank: np.ndarray
    """1 where a blank precedes the last word, 0 where none does; -1 for a single word."""
