"""The forms of the page: each is made from the declared options of the commands that it runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

from kinematics.user_error import UserError
from postproc.commands.options.declared import Declared, signature_of
from postproc.commands.table import command
from postproc.text.calls.called_files import SUFFIXES

DATA_SUFFIXES = (".csv", ".txt", ".md", ".rtl", ".xml", ".log", ".dat", ".json", ".tsv")
TABLE_SUFFIXES = (".tbl", ".t", ".toa", ".tool", ".ini", ".tch", ".d", ".pr", ".txt", ".csv", ".json")
"""Suffixes that the name of a saved file may have; others become the first of their list."""
HEAD = "head.toml"
"""File with the head of a page, which has the names of the uploads: the files on the disk have others."""
READING = ("header", "measured", "format", "columns")
"""Options of measured data."""


class Field(NamedTuple):
    """An option of a form."""

    declared: Declared
    kind: Literal["file", "lines", "switch", "choice", "text"]
    choices: Sequence[str] = ()
    """The values that the page offers and accepts; empty for another kind."""
    required: bool = False
    """True for a choice of the server, which must be made."""

    @property
    def name(self) -> str:
        """Its name in the form."""
        return self.declared.name

    @property
    def label(self) -> str:
        """Its name for people."""
        return self.name.replace("_", " ").capitalize()

    @property
    def help(self) -> str:
        """Its help, as on the command line; empty for a choice of the server."""
        return "" if self.required else str(self.declared.field.metadata["help"]).replace("`", "")

    @property
    def example(self) -> str:
        """The form of its value."""
        return str(self.declared.field.metadata.get("metavar") or "")

    @property
    def optional(self) -> bool:
        """True for a choice without a default."""
        return self.required or self.declared.default is None

    def words(self, values: Sequence[str]) -> list[str]:
        """The words of the command line for the values in a form, or for the names of saved files."""
        option = self.declared.label
        if self.kind == "switch":
            return [option] if values else []
        given = [line.strip() for value in values for line in (value.splitlines() if self.kind == "lines" else [value])]
        given = [each for each in given if each]
        if self.kind == "choice" and not set(given) <= set(self.choices):
            raise UserError(f"{self.label}: choose one of {', '.join(self.choices)}")
        if any("\0" in each for each in given):
            raise UserError(f"{self.label}: a character is no text: write letters, digits and signs")
        return [f"{option}={each}" for each in given if each != str(self.declared.default)]


Offered = Mapping[str, Callable[[], Sequence[str]]]
"""The choices of options that the server knows, by the name of the option."""


@dataclass(frozen=True)
class Task:
    """Work that the page offers: commands on the same input, one after the other until one refuses it."""

    title: str
    text: str
    commands: Sequence[str]
    suffixes: Sequence[str]
    """Of uploaded files; empty for work without an upload."""
    shown: Sequence[str]
    folded: Sequence[str] = ()
    """Options that are shown, and those below "More options"."""
    output: str = ""
    """Suffix of the main result, `.*` for that of the upload; empty for none."""
    files: str = "Measured data"
    last_only: Sequence[str] = ()
    """Options of its last command that mean something else in one before."""

    @cached_property
    def declared(self) -> dict[str, Declared]:
        """The options of its last command by name; the argument is the first."""
        return _declared(self.commands[-1])

    @property
    def argument(self) -> Declared:
        """The input: uploaded files, or the name of a machine."""
        return next(each for each in self.declared.values() if not each.names)

    def fields(self, names: Sequence[str], offered: Offered) -> list[Field]:
        """The fields of options."""
        return [field_of(self.declared[name], offered) for name in names]

    def words(self, command: str, options: Mapping[str, Sequence[str]], inputs: Sequence[str]) -> list[str]:
        """The command line of one of its commands; options: words by the names of options."""
        known = _declared(command)
        if command != self.commands[-1]:
            known = {name: each for name, each in known.items() if name not in self.last_only}
        own = [word for name, words in options.items() if name in known for word in words]
        output = [f"--output={output_name(self, inputs)}"] if self.output and "output" in known else []
        pages = [f"--report-head={HEAD}", f"--report={page_name(command)}", f"--json={page_name(command, '.json')}"]
        return [*command.split(), *own, *output, *pages, "--", *inputs]


def _declared(name: str) -> dict[str, Declared]:
    return {each.name: each for each in signature_of(command(name)[0]).declared}


def output_name(task: Task, inputs: Sequence[str]) -> str:
    """The name of the main result."""
    return "output" + ("." + inputs[0].rpartition(".")[2] if task.output == ".*" else task.output)


def page_name(command: str, suffix: str = ".html") -> str:
    """The name of the page of a command, or of its results for programs."""
    return f"result-{command.replace(' ', '-')}{suffix}"


def field_of(each: Declared, offered: Offered) -> Field:
    """The field of an option. One that names a file takes an upload, and never a text."""
    complete = each.field.metadata.get("complete", list)
    if each.name in offered:
        return Field(each, "choice", offered[each.name](), required=True)
    if each.kind is bool:
        return Field(each, "switch")
    if choices := each.choices or complete():
        return Field(each, "choice", choices)
    if each.field.metadata.get("reads") or each.writes:
        return Field(each, "file")
    return Field(each, "lines" if each.item is not None else "text")


TASKS = {
    "program": Task(
        "Correct a program",
        "Checks every line, then corrects the program for the errors of the machine. A program that is not fully "
        "understood is refused, with the lines and the cure, and nothing is written.",
        ("check", "correct"),
        SUFFIXES,
        ("machine", "work_offset", "tool_length", "set_up_zero"),
        (
            *("calibration", "tool_table", "dialect", "datum", "block_skip", "start", "pass_through"),
            *("no_travel_check", "temperature", "elapsed", "tolerance_um", "max_correction_um", "accept"),
        ),
        ".*",
        "NC program",
        last_only=("calibration",),
    ),
    "diagnose": Task(
        "Diagnose measured data",
        "Finds the causes of the errors that measured data show, and makes a calibration that contains them.",
        ("diagnose",),
        DATA_SUFFIXES,
        ("machine", "calibration"),
        (*READING, "unexplained", "force"),
        ".json",
    ),
    "fit": Task(
        "Fit a calibration",
        "Makes a calibration from measured data, with the uncertainty of every number.",
        ("fit",),
        DATA_SUFFIXES,
        ("machine", "basis"),
        (*READING, "effects", "noise", "valid_days", "force"),
        ".json",
    ),
    "iso230": Task(
        "Evaluate by ISO 230-2",
        "Reversal, repeatability and accuracy of axes, from the runs of an interferometer.",
        ("iso230",),
        DATA_SUFFIXES,
        ("machine",),
        READING,
        ".csv",
    ),
    "ballbar": Task(
        "Evaluate circles of a ballbar",
        "Circles by ISO 230-4, with the share of each cause.",
        ("ballbar",),
        DATA_SUFFIXES,
        ("machine",),
        READING,
    ),
    "etve": Task(
        "Evaluate a standing machine",
        "How far a machine that stands still moves with the temperature of its environment (ISO 230-3), from a log of "
        "up to five displacements.",
        ("etve",),
        DATA_SUFFIXES,
        ("period_h",),
        files="Log of displacements",
    ),
    "history": Task(
        "Trend of a machine",
        "Changes and drift of every quantity, its forecast, when it leaves a limit, and when to measure again.",
        ("history show",),
        (),
        ("limit",),
    ),
}
"""The work that the page offers, by its name in addresses."""
