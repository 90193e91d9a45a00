"""The words of a command line: which command they name, and its call."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

from kinematics.files.mistaken import did_you_mean
from kinematics.running.caller import command_line_calls
from kinematics.user_error import UserError
from postproc.commands.options.declared import signature_of
from postproc.commands.table import COMMANDS, GLOBAL, GROUPS, HELP, command, named
from postproc.commands.words import Words

SHORT = {"-q": "--quiet", "-v": "--verbose"}
"""Short names of the levels."""
PLUGIN = "--plugin"
COMPLETION = "_NCOMP_COMPLETE"
"""Environment variable by which a shell requests the completion of a line."""


def command_line() -> None:
    """Run the command of the process' arguments."""
    with command_line_calls():
        _run(_without_levels(_without_plugins(sys.argv[1:])))


def _run(words: list[str]) -> None:
    """Run the command of these words; Typer, whose import takes longer than a short job, shows help and completion."""
    if words in (["--version", "--json"], ["--version", "--json", "-"]):
        _print_versions()
        return
    if words[:1] == ["help"] and not Path("help").exists():
        words = [*words[1:], "--help"]
    asked = [word for word in words if word not in HELP]
    if COMPLETION in os.environ or words[:1] in ([name] for name in GLOBAL):
        _by_typer(words)
    elif not asked or asked in ([name] for name in GROUPS):
        _by_typer([*asked, "--help"])
    else:
        _refuse_misspelled(asked[0])
        name, others = named(asked)
        if asked != words:
            _by_typer([*name.split(), "--help"])
            return
        signature = signature_of(command(name)[0])
        signature.run(Words(name, signature.declared).values(others))


def _by_typer(words: list[str]) -> None:
    """Show help, the version or the completion of a line."""
    from postproc.commands.tree import command_tree

    command_tree()(args=words, prog_name="ncomp")


def _without_plugins(words: list[str]) -> list[str]:
    """The words without --plugin NAME, which every command has, and which acts before the effects are loaded."""
    others, plugins, rest = list[str](), list[str](), iter(words)
    for word in rest:
        name, given, plugin = word.partition("=")
        if name != PLUGIN:
            others.append(word)
        elif plugin or not given:
            plugins.append(plugin or next(rest, ""))
    if len(others) < len(words):
        from kinematics.running.plugins import request

        request(plugins or [""])
        _show_other_plugins()
    return others


def _show_other_plugins() -> None:
    """From here on, a warning that a plug-in is not that of a calibration is a note of the command."""
    import warnings

    from kinematics.running.plugins import OtherPlugin
    from postproc.commands.show.terminal import say

    others = warnings.showwarning

    def shown(message: Warning | str, category: type[Warning], *where: Any) -> None:
        if issubclass(category, OtherPlugin):
            say("note", str(message))
        else:
            others(message, category, *where)

    warnings.showwarning = shown  # type: ignore[assignment]


def _without_levels(words: list[str]) -> list[str]:
    """The words without --quiet and --verbose, which every command has, and which act from here on."""
    words = [SHORT.get(word, word) for word in words]
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
    names = {name.partition(" ")[0] for name in COMMANDS}
    if word in names or word.startswith("-") or "." in word or Path(word).exists():
        return
    if meant := did_you_mean(word, names):
        raise UserError(f"{word!r} is neither a command nor a file{meant}")
