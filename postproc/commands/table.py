"""All commands by name. The module of a command is imported when the command is used."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module

MAIN_JOB = "correct"
"""The command for arguments that do not begin with the name of a command."""
JOB_FILE = "job"
"""The command for a first argument that is a job file."""
COMMANDS = {
    MAIN_JOB: "programs.correct",
    "batch": "programs.batch",
    JOB_FILE: "workplace.job",
    "watch": "programs.watch",
    "verify": "programs.verify",
    "check": "programs.check",
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
    "plan": "measurements.plan",
    "predict": "measurements.predict",
    "simulate": "measurements.simulate",
    "simulate-continuous": "measurements.simulate_continuous",
    "report": "programs.report",
    "study": "measurements.study",
    "touches": "measurements.touches",
    "three-points": "calibrations.three_points",
}
"""The module of each command, in this package; it has a function of its own name, and EPILOG, the examples."""


def named(words: Sequence[str]) -> tuple[str, list[str]]:
    """The command of a command line, also of one that does not name it, and its own words."""
    first = words[0] if words else ""
    if first in COMMANDS:
        return first, list(words[1:])
    return JOB_FILE if first.lower().endswith(".toml") else MAIN_JOB, list(words)


def command(name: str) -> tuple[Callable[..., None], str]:
    """The function of a command, and the examples below its help."""
    module = import_module(f".{COMMANDS[name]}", __package__)
    return getattr(module, COMMANDS[name].rpartition(".")[2]), module.EPILOG
