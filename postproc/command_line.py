"""The words of a command line: which command they name, and its call."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from kinematics.files.mistaken import did_you_mean
from kinematics.user_error import UserError
from postproc.commands.options.arguments import plain_values
from postproc.commands.options.declared import Signature
from postproc.commands.table import COMMANDS, command, named

COMPLETION = "_NCOMP_COMPLETE"
"""Environment variable by which a shell requests the completion of a line."""


def command_line() -> None:
    """Run the command of the process' arguments: without Typer where they are plainly right, which takes less time."""
    words = _without_levels(sys.argv[1:])
    if words in (["--version", "--json"], ["--version", "--json", "-"]):
        _print_versions()
        return
    if words[:1] == ["help"] and not Path("help").exists():
        words = [*words[1:2], "--help"]
    if words and words[0] not in COMMANDS:
        _refuse_misspelled(words[0])
    name, others = named(words)
    if words and COMPLETION not in os.environ:
        signature = Signature(command(name)[0])
        given = plain_values(signature.declared, others)
        if given is not None:
            signature.run(given)
            return
    from postproc.commands.tree import run_by_typer

    run_by_typer(words)


def _without_levels(words: list[str]) -> list[str]:
    """The words without --quiet and --verbose, which every command has, and which act from here on."""
    given = {"--quiet", "--verbose"} & set(words)
    if not given:
        return words
    from postproc.commands.show.terminal import LEVEL

    if len(given) == 2:
        raise UserError("--quiet and --verbose exclude each other: give one of them")
    LEVEL.quiet, LEVEL.verbose = "--quiet" in given, "--verbose" in given
    return [word for word in words if word not in given]


def _print_versions() -> None:
    """The versions of ncomp, Python and the libraries as JSON."""
    import json

    from kinematics.running.installed import versions

    print(json.dumps(versions(), indent=2))


def _refuse_misspelled(word: str) -> None:
    """UserError for a first word that is nearly a command, and neither an option nor a file."""
    if word.startswith("-") or "." in word or Path(word).exists():
        return
    if meant := did_you_mean(word, COMMANDS):
        raise UserError(f"{word!r} is neither a command nor a file{meant}")
