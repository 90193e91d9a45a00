"""Every message with an option of the command line can be said in the words of Python: with the argument and its value.

A plain word behind an option is its value if the option takes it; the words that options take are read from their
declarations and from the lists that they stand for.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import get_args

import pytest

import ncomp
from calibration.instruments import KINDS
from calibration.planning.strategies import STRATEGIES
from calibration.probing.designs import DESIGNS
from kinematics.running.caller import in_python
from kinematics.running.workers import LOCAL
from postproc.commands.measurements.plan_path import STRATEGY
from postproc.commands.options.declared import Signature
from postproc.commands.table import COMMANDS, command
from postproc.correct.mark import PARTS
from postproc.correct.plausibility import REASONS

ROOT = Path(__file__).parents[1]
PACKAGES = ("kinematics", "machines", "calibration", "postproc")
NOT_OF_THE_LIBRARY = ("command_line.py", "derive.py", "caller.py", "ncomp_post.py")
OPTION = re.compile(r"(?<![\w-])--[a-z]")
PLAIN = re.compile(r"[a-z][a-z0-9_-]*")
FREE = {
    "accept": [*REASONS, *PARTS],
    "dask": [LOCAL],
    "instrument": KINDS,
    "strategy": [*STRATEGIES, *DESIGNS, STRATEGY],
}
"""Values of options that take any text, and read these words in it."""
NUMBERS = {int, float}


def plain_words(each):
    """Plain words that the declaration of an option names as its values."""
    metavar, complete = each.field.metadata["metavar"] or "", each.field.metadata.get("complete")
    shown = () if "=" in metavar else metavar.split("|")
    return {word for word in (*each.choices, *shown, *(complete() if complete else ())) if PLAIN.fullmatch(word)}


def declared():
    """The plain values of every option by its name; the units of options with numbers; the options without a value."""
    words, units, switches, valued = {}, set(), set(), set()
    for each in (one for name in COMMANDS for one in Signature(command(name)[0]).declared):
        for option in (name.removeprefix("--") for name in each.names if name.startswith("--")):
            words.setdefault(option, set()).update(plain_words(each))
            if NUMBERS & {each.kind, each.item, *get_args(each.kind)}:
                units |= {(option, word) for word in plain_words(each)}
            (switches if each.kind is bool else valued).add(option)
    for option, values in FREE.items():
        words[option] |= set(values)
    return words, units, switches - valued


WORDS, UNITS, SWITCHES = declared()
VALUES = sorted((option, word) for option, words in WORDS.items() for word in words)


def argument(option, word):
    """The argument of Python for an option and its value; a unit stands for a number."""
    name = in_python(f"--{option} A=1").partition("=")[0]
    return f"{name}={word}" if (option, word) in UNITS else f'{name}="{word}"'


@pytest.mark.parametrize(("option", "word"), VALUES)
def test_a_plain_value_of_an_option_is_that_of_the_argument(option, word):
    expected = argument(option, word)
    assert in_python(f"give --{option} {word} then") == f"give {expected} then"
    assert in_python(f"the date (--{option} {word}) counts") == f"the date ({expected}) counts"


@pytest.mark.parametrize("option", sorted(WORDS))
def test_a_word_that_an_option_does_not_take_belongs_to_the_sentence(option):
    said = in_python(f"--{option} decides what is written")
    assert said.endswith(" decides what is written")
    assert said.startswith(in_python(f"--{option}"))


@pytest.mark.parametrize("option", sorted(SWITCHES))
def test_a_switch_is_an_argument_with_a_truth_value(option):
    assert re.fullmatch(r"give [a-z_]+=(True|False) then", in_python(f"give --{option} then"))


def texts():
    """Texts of the library with an option of the command line, an inserted value as `VALUE`, by file and line."""
    for path in (each for package in PACKAGES for each in sorted((ROOT / package).rglob("*.py"))):
        if "commands" in path.parts or path.name in NOT_OF_THE_LIBRARY:
            continue
        source = path.read_text(encoding="utf-8")
        if not OPTION.search(source):
            continue
        nodes = list(ast.walk(ast.parse(source)))
        descriptions = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
        parts = {id(each) for node in nodes if isinstance(node, ast.JoinedStr) for each in node.values}
        for node in nodes:
            if isinstance(node, (ast.JoinedStr, ast.Constant)) and id(node) not in descriptions | parts:
                found = text_of(node)
                if OPTION.search(found):
                    yield f"{path.relative_to(ROOT)}:{node.lineno}", found


def text_of(node):
    if isinstance(node, ast.JoinedStr):
        return "".join(text_of(each) for each in node.values)
    return node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else "VALUE"


def test_every_message_is_in_the_words_of_python():
    found = list(texts())
    assert len(found) > 100
    for where, text in found:
        said = in_python(text)
        assert not OPTION.search(said), where
        for option, word in re.findall(r"(?<![\w-])--([a-z][a-z0-9-]*) ([a-z][a-z0-9_-]*)", text):
            if word in WORDS.get(option, ()):
                assert argument(option, word) in said, where


def test_refusals_with_plain_values_name_the_arguments():
    setup = ncomp.set_up("gantry", zero=True)
    program = "G21 G90 G54\nG0 X10 Y10 Z0\n/ X20\nX30\nM30\n"
    with pytest.raises(ncomp.UserError, match=r'state it by block_skip="on" \(it is skipped\)'):
        ncomp.correct(program, "gantry", "none", setup=setup)
