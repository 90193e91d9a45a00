"""Options are declared once: values, refusals and help of a declaration, and the declarations of all commands."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import pytest
import typer
from hypothesis import event, given, settings
from hypothesis import strategies as st

from calibration.measurement.readers import FORMATS
from kinematics.user_error import UserError
from postproc.commands.options.declared import REQUIRED, Signature, argument, option, refuse_given
from postproc.commands.table import COMMANDS, command
from postproc.commands.tree import command_tree
from postproc.commands.words import Words

FOLDER = Path(__file__).parents[1] / "postproc" / "commands"
Length = Annotated[float, option("Length, mm.", "mm", "-l", default=2.0, min=0.0)]


@dataclass(frozen=True, kw_only=True)
class Group:
    """Options of every type."""

    PANEL: ClassVar[str] = "Group"

    length: Length
    order: Literal["given", "shuffled"] = option("Order.", default="given")
    sign: Literal["error", "correction"] | None = option("Sign.")
    names: tuple[str, ...] = option("Name.", "NAME", "--name")
    feed: tuple[float, ...] = option("Feed, mm/min.")
    planar: bool = option("Planar.", default=False)
    check: bool = option("Check.", default=True)


def called(*arguments: str) -> dict[str, object]:
    """Values that a command gets by its command line."""
    found: dict[str, object] = {}

    def command(
        *,
        files: tuple[Path, ...] = argument("Files.", "FILES"),
        group: Group,
        size: int = option("Size.", default=REQUIRED),
    ) -> None:
        found.update(files=files, group=group, size=size)

    signature = Signature(command)
    signature.run(Words("command", signature.declared).values(arguments))
    return found


def test_defaults():
    found = called("a", "b", "--size", "3")
    group = Group(length=2.0, order="given", sign=None, names=(), feed=(), planar=False, check=True)
    assert found == {"files": (Path("a"), Path("b")), "group": group, "size": 3}


def test_values():
    given = ("-l", "5", "--order", "shuffled", "--sign", "error", "--name", "x", "--name", "y", "--feed", "9", "--planar", "--no-check")  # fmt: skip
    group = called("a", "--size", "3", *given)["group"]
    assert group == Group(
        length=5.0, order="shuffled", sign="error", names=("x", "y"), feed=(9.0,), planar=True, check=False
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--order", "up"), "--order up: expected given or shuffled"),
        (("--sign", "both"), "--sign both: expected error or correction"),
        (("--length", "inf"), "--length inf: expected a finite number"),
        (("--feed", "nan"), "--feed nan: expected a finite number"),
    ],
)
def test_refused_values(arguments, message):
    with pytest.raises(UserError, match=re.escape(message)):
        called("a", "--size", "3", *arguments)


def test_options_that_do_not_apply():
    group = Group(length=2.0, names=("x",), feed=(), order="given", sign=None, planar=False, check=True)
    refuse_given("does not apply", group, "length", "order", "feed")
    with pytest.raises(UserError, match=re.escape("--name does not apply")):
        refuse_given("does not apply", group, "order", "names")


def test_every_option_has_a_help_text_in_whole_words():
    """Help begins with a capital letter or a name and ends with a full stop; no command declares an option otherwise."""
    for name in COMMANDS:
        for each in Signature(command(name)[0]).declared:
            shown = each.field.metadata["help"]
            assert re.fullmatch(r"[A-Z].*\.", shown), (name, each.name, shown)
    others = [path for path in FOLDER.rglob("*.py") if path.name != "tree.py"]
    assert not [path for path in others if re.search(r"typer\.(Option|Argument)", path.read_text())]


HEADINGS = {
    "--machine": "Machine",
    "--calibration": "Model",
    "--set-up-zero": "Set-up",
    "--tool-length": "Set-up",
    "--header": "Data",
    "--format": "Data",
    "--noise": "Model",
    "--json": "Output",
    "--report": "Output",
    "--output": "Output",
}
"""Heading in the help of options of several commands."""
OTHER_HEADINGS = {("export", "--format"): "Tables", ("import", "--format"): "Tables"} | {
    (name, option): "Program of data taken on the fly"
    for name in ("fit",)
    for option in ("--set-up-zero", "--tool-length")
}


def test_an_option_stands_under_the_same_heading_in_every_command():
    for name in COMMANDS:
        for each in Signature(command(name)[0]).declared:
            if each.label in HEADINGS:
                assert each.panel == OTHER_HEADINGS.get((name, each.label), HEADINGS[each.label]), (name, each.label)


def test_the_help_of_every_command_has_examples():
    assert [name for name in COMMANDS if not re.search(r"Examples?:\n\n`ncomp ", command(name)[1])] == []


WORDS = [
    "in.nc",
    "a b",
    "-",
    "--",
    "-1",
    "0",
    "7",
    "2.5",
    "+3.",
    "1e3",
    "1_0",
    "nan",
    "X=1,2,3",
    "",
    "ä",
    "\udc80",
    "true",
    "none",
    "given",
    "-xy",
]


@st.composite
def lines(draw):
    """A command, and words that are right for it or nearly so."""
    name = draw(st.sampled_from(sorted(COMMANDS)))
    declared = Signature(command(name)[0]).declared
    word = st.sampled_from(WORDS)
    needed = [each for each in declared if each.field.default is REQUIRED]
    words = []
    for each in [*needed, *draw(st.lists(st.sampled_from(declared), max_size=4))]:
        option = draw(st.sampled_from([*each.names, each.names[0].replace("--", "--no-")])) if each.names else ""
        form = (
            draw(st.sampled_from(["apart", "apart", "apart", "joined", "alone"])) if each.kind is not bool else "alone"
        )
        value = draw(word)
        words += {"apart": [option, value] if option else [value], "joined": [f"{option}={value}"], "alone": [option]}[
            form
        ]
    return name, words


def by_typer(name, words):
    """The values that Typer reads; None where it refuses the words."""
    tree = command_tree()
    for part in name.split():
        tree = tree.get_command(None, part)
    try:
        return tree.make_context(name, list(words)).params
    except typer.BadParameter.__mro__[1]:
        return None


@given(lines())
@settings(max_examples=100)
def test_words_have_the_values_that_typer_reads(line):
    """What Typer refuses is refused; where both accept, their values are equal."""
    name, words = line
    read = by_typer(name, words)
    try:
        values = Words(name, Signature(command(name)[0]).declared).values(words)
    except UserError:
        event("refused" if read is None else "refused, and not by Typer")
        return
    event("accepted")
    assert read is not None
    for each in Signature(command(name)[0]).declared:
        own, its = values[each.name], read[each.name]
        assert own == tuple(its or ()) if each.item is not None else (type(own), own) == (type(its), its), each.name


def test_the_help_of_data_names_every_format():
    data = next(each for each in Signature(command("fit")[0]).declared if each.name == "format")
    named = set(re.split(r"[:,. ]+", data.field.metadata["help"]))
    assert set(FORMATS) <= named
