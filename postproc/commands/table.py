"""All commands by name. The module of a command is imported when the command is used."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from typing import Any

MAIN_JOB = "correct"
"""The command for arguments that do not begin with the name of a command."""
JOB_FILE = "job"
"""The command for a first argument that is a job file."""
COMMANDS = {
    MAIN_JOB: "programs.correct",
    "batch": "programs.batch",
    JOB_FILE: "workplace.job",
    "watch": "programs.watch",
    "serve": "serve.serve",
    "verify": "programs.verify",
    "check": "programs.check",
    "codes": "controls.codes",
    "compare": "calibrations.compare",
    "machines": "workplace.machines",
    "doctor": "workplace.doctor",
    "init": "workplace.init",
    "export": "controls.export",
    "fit": "calibrations.fit",
    "diagnose": "calibrations.diagnose",
    "hook": "programs.hook",
    "tutorial": "programs.tutorial",
    "import": "controls.import_tables",
    "iso230": "calibrations.iso230",
    "ballbar": "calibrations.ballbar",
    "tracker": "measurements.tracker",
    "continuous": "calibrations.continuous",
    "plan points": "measurements.plan_points",
    "plan optimised": "measurements.plan_optimised",
    "plan path": "measurements.plan_path",
    "plan spheres": "measurements.plan_spheres",
    "measure": "measurements.measure",
    "predict": "measurements.predict",
    "simulate": "measurements.simulate",
    "simulate-continuous": "measurements.simulate_continuous",
    "report": "programs.report",
    "study": "measurements.study",
    "touches": "measurements.touches",
    "square": "calibrations.square",
    "three-points": "calibrations.three_points",
    "certificate": "history.certificate",
    "drift": "calibrations.drift",
    "etve": "calibrations.etve",
    "history add": "history.add",
    "history list": "history.list",
    "history show": "history.show",
    "history event": "history.event",
    "history export": "history.export",
    "history verify": "history.verify",
}
"""The module of each command, in this package; it has a function of its own name, and EPILOG, the examples."""
GROUPS = {"plan": "measurements.plan", "history": "history.history"}
"""The module of each command that has commands of its own; it has EPILOG, and `named`, for words without their name."""
HELP = ("-h", "--help")
GLOBAL = ("--version", "--install-completion", "--show-completion")
"""Options of ncomp without a command."""


def named(words: Sequence[str]) -> tuple[str, list[str]]:
    """The command of a command line, also of one that does not name it, and its own words."""
    for count in (2, 1):
        if (name := " ".join(words[:count])) in COMMANDS:
            return name, list(words[count:])
    first = words[0] if words else ""
    if first in GROUPS:
        found: tuple[str, list[str]] = module(first).named(words[1:])
        return found
    return JOB_FILE if first.lower().endswith(".toml") else MAIN_JOB, list(words)


def siblings(name: str) -> list[str]:
    """The other commands of the group of a command."""
    group, _, own = name.rpartition(" ")
    return [each for each in COMMANDS if own and group and each != name and each.startswith(f"{group} ")]


def module(name: str) -> Any:
    """The module of a command or of a group."""
    return import_module(f".{(COMMANDS | GROUPS)[name]}", __package__)


def command(name: str) -> tuple[Callable[..., None], str]:
    """The function of a command, and the examples below its help."""
    found = module(name)
    return getattr(found, COMMANDS[name].rpartition(".")[2]), found.EPILOG
