"""Changes of texts: characters, words, numbers, lines, and parts of other texts."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Sequence

SPOILT = (
    "X", "Y-", "G", "G91 ", "G90", "G2 ", "G3 ", "#", "[", "]", "(", ")", "%", "/", ";", ".", "=", "R1", "\r", "\n", "\t", "0", "-",
    "--", "+", "~", " ", "M6", "L ", "CC ", "E5", "\xe9", '"', "'", "IF ", "G43.4 H1 ", "G68 X0 Y0 R30\n", "G92 X1.", "K3 ", "G16 ",
    "TRANS X1\n", "AROT Z30\n", "X1 X2", "IX+1 ", "FN 0: Q1 = +1", "\0", "\x1a", "\x0c", "NaN", "inf", "1e308", "X1E5", "&", "{", "}",
    "G53 ", "G28 ", "G41 D1 ", "G81 Z-1. R1. F9. ", "M98 P1 ", "O1\n", "GOTO 1\n", "WHILE[1]DO1\n", "END1\n", "o1 call\n", "o1 sub\n",
    "CYCL DEF 7.0\n", "LBL 1\n", "CALL LBL 1 REP 3\n", "M128\n", "PLANE RESET STAY\n", "TRAORI\n", "MCALL CYCLE81(1,2,3)\n",
    "FOR R1=1 TO 3\n", "ENDFOR\n", "GOTOB L1\n", "L1:\n", "RL ", "RND R1\n", "CHF=1 ", "CR=5 ", "TURN=2 ", "AC(", "IC(1)", "**", "MOD",
    "SIN[", "SQRT(", "/0", "N10 ", "G10 L2 P1 X1\n", "G51 X0 Y0 Z0 P2.\n", "G93 ", "G20 ", "G18 ", "$P_UIFR[1,X,TR]=1\n", "<a>", "#<a>=",
)  # fmt: skip
NUMBERS = (
    "0", "-0", "1", "-1", ".5", "5.", ".", "-.", "+.", "1e9", "99999999999", "-99999999.9", "1e-9", "0.00000001", "3.0000000001", "360",
    "361", "-180", "90", "1,5", "007", "1.2.3", "--5", "+-5", "2147483648", "9" * 40, "0." + "3" * 60, "",
)  # fmt: skip
_NUMBER = re.compile(r"[-+]?\d*[.,]?\d+")
_WORD = re.compile(r"[A-Za-z$#_]+[-+]?[\d.]*")
MOST = 5
"""Changes of one text."""

Change = Callable[[str, str, random.Random], str]


def mutated(text: str, other: str, rng: random.Random, changes: Sequence[Change] | None = None) -> str:
    """The text after one change or several; some take parts of another text."""
    for _ in range(rng.choice((1, 1, 1, 1, 1, 2, 3, MOST))):
        text = rng.choice(changes or CHANGES)(text, other, rng)
    return text


def _insert(text: str, _: str, rng: random.Random) -> str:
    at = rng.randint(0, len(text))
    return text[:at] + rng.choice(SPOILT) + text[at:]


def _byte(text: str, _: str, rng: random.Random) -> str:
    at = rng.randint(0, len(text))
    return text[:at] + chr(rng.randrange(256)) + text[at + rng.randint(0, 1) :]


def _drop(text: str, _: str, rng: random.Random) -> str:
    at = rng.randint(0, len(text))
    return text[:at] + text[at + rng.randint(1, 4) :]


def _digit(text: str, _: str, rng: random.Random) -> str:
    found = [match.start() for match in re.finditer(r"\d", text)]
    return _replaced(text, (rng.choice(found),) * 2, rng.choice("0123456789"), 1) if found else text


def _number(text: str, other: str, rng: random.Random) -> str:
    found = list(_NUMBER.finditer(text))
    values = _NUMBER.findall(other) if rng.random() < 0.5 else NUMBERS
    return _replaced(text, rng.choice(found).span(), rng.choice(values or NUMBERS)) if found else text


def _word(text: str, other: str, rng: random.Random) -> str:
    """A word is replaced by another, or one is added."""
    found, others = list(_WORD.finditer(text)), _WORD.findall(rng.choice((text, other)))
    if not found or not others:
        return text
    start, end = rng.choice(found).span()
    return _replaced(text, (start, rng.choice((start, end))), rng.choice(others) + rng.choice(("", " ")))


def _replaced(text: str, span: tuple[int, int], new: str, more: int = 0) -> str:
    return text[: span[0]] + new + text[span[1] + more :]


def _lines(text: str, other: str, rng: random.Random) -> str:
    """A line twice, away, elsewhere, or one of another text."""
    lines = text.splitlines(keepends=True)
    if not lines:
        return text
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(5):
        case 0:
            lines.insert(i, lines[i])
        case 1:
            del lines[i]
        case 2:
            lines[i], lines[j] = lines[j], lines[i]
        case 3:
            lines.insert(i, rng.choice(other.splitlines(keepends=True) or [""]))
        case _:
            lines[i] = lines[i].rstrip("\r\n") + rng.choice((" ", "")) + lines[j]
    return "".join(lines)


def _truncate(text: str, _: str, rng: random.Random) -> str:
    return text[: rng.randint(0, len(text))] if rng.random() < 0.5 else text[rng.randint(0, len(text)) :]


def _splice(text: str, other: str, rng: random.Random) -> str:
    return text[: rng.randint(0, len(text))] + other[rng.randint(0, len(other)) :]


def _repeat(text: str, _: str, rng: random.Random) -> str:
    """Some characters many times: nested brackets, long numbers, long lines."""
    at = rng.randint(0, len(text))
    piece = text[at : at + rng.randint(1, 3)] or "("
    if rng.random() < 0.5:
        piece = rng.choice(
            ("(", "[", "-", "#", "9", "X1", " ", "[1+", "SIN[", "/", "N", "Q1 = ", "\n", "LBL 1\n", "IF ")
        )
    return text[:at] + piece * rng.choice((2, 5, 50, 400)) + text[at:]


def _case(text: str, _: str, rng: random.Random) -> str:
    data = text.encode("latin-1")  # of bytes, letters beyond ASCII stay
    return rng.choice((data.lower, data.upper, data.swapcase))().decode("latin-1")


def _blanks(text: str, _: str, rng: random.Random) -> str:
    return text.replace(" ", rng.choice(("", "  ", "\t")))


CHANGES: tuple[Change, ...] = (
    _insert, _insert, _byte, _drop, _drop, _digit, _digit, _digit, _number, _number, _number, _number, _word, _word, _word,
    _lines, _lines, _lines, _lines, _lines, _lines, _truncate, _splice, _repeat, _case, _blanks,
)  # fmt: skip


FILE_TOKENS = (
    "nan", "NaN", "-inf", "Infinity", "null", "true", "false", "[]", "{}", '""', '"', ",", ";", ",,", "#", "# ", ": ", "=", "[", "]",
    "{", "}", "\\", "\t", "\n", "\n\n", "1e308", "1e-320", "\0", "\xff", "x", "X", "t1", "-", "1_000", "0x10", "'", "[[case]]\n", "[fit]\n",
    "\xb5m", "\xef\xbb\xbf", "99999999999999999999", "..", "../", "2026-13-45T00:00:00Z",
)  # fmt: skip


def _file_token(text: str, _: str, rng: random.Random) -> str:
    at = rng.randint(0, len(text))
    return text[:at] + rng.choice(FILE_TOKENS) + text[at:]


def _file_value(text: str, _: str, rng: random.Random) -> str:
    """A number becomes another value."""
    found = list(_NUMBER.finditer(text))
    return _replaced(text, rng.choice(found).span(), rng.choice(FILE_TOKENS + NUMBERS)) if found else text


def files_changes() -> tuple[Change, ...]:
    """Changes for files that are no programs."""
    return (
        _file_token, _file_value, _file_value, _file_value, _byte, _drop, _digit, _number, _number, _word, _lines, _lines, _lines,
        _truncate, _splice, _repeat, _case, _blanks,
    )  # fmt: skip
