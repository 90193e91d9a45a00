"""`ncomp plan path`: a path along which a tracker that follows sees every error, or evaluation of a given path."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Literal

import ncomp
from kinematics.user_error import UserError
from postproc.commands.measurements.plan import FEED, MeasuringProgramOptions, PlanFile, write
from postproc.commands.options.declared import option, refuse_given
from postproc.commands.options.path import read_path
from postproc.commands.options.program import ToolOptions
from postproc.commands.options.shared import MachineName, ResultOptions
from postproc.commands.options.strategy import POSITIONS, Margin, VolumeOptions
from rendering.report import Report, facts, shortened

if TYPE_CHECKING:
    import numpy as np

    from calibration.measurement.plan import Choices, Plan
    from calibration.on_the_fly.nominal_path import NominalPath
    from calibration.on_the_fly.planning.predicted_fit import PathEvaluation
    from kinematics.machine import Machine

EPILOG = (
    "Examples:\n\n"
    "`ncomp plan path --machine cframe --target t=0,0,-120 --length-m 21 --feed 2500 -o path.csv --nc path.nc`\n\n"
    "`ncomp plan path --machine cframe --target t=0,0,-120 --path mine.nc -o path.csv`  evaluates a program"
)
STRATEGY = "on-the-fly"
"""Name of the strategy in the file of the plan."""
DEFAULT_PATH_TRAVELS = 12.7
"""Default length of a path, as a multiple of the sum of all travels: 21 m for 600 x 600 x 450 mm."""
LISTED_HIDDEN_ERRORS = 6
"""Largest number of listed errors that are not visible."""


@dataclass(frozen=True, kw_only=True)
class PathOptions(VolumeOptions):
    """A path for data taken on the fly."""

    margin_mm: Margin
    rotary: Literal["fixed", "simultaneous"] = option(
        "Rotary axes: fixed at home, or moved together with the linear axes.", default="fixed", panel=POSITIONS
    )
    feed: float = option("Feed along the path, mm/min.", "mm/min", default=FEED, min=0.1, panel=POSITIONS)
    length_m: float | None = option(
        f"Length of the path, m; default: {DEFAULT_PATH_TRAVELS} times the sum of all travels.",
        "m",
        min=0.01,
        panel=POSITIONS,
    )
    minutes: float | None = option("Duration of the path at the feed, min.", "min", min=0.01, panel=POSITIONS)
    path: str | None = option(
        "NC program whose path is evaluated, instead of a planned path.", "PATH.nc", reads=True, panel=POSITIONS
    )

    def length(self, travel: float) -> float:
        """Length of the path, mm; travel: sum of the travels of all linear axes, mm."""
        if self.length_m is not None and self.minutes is not None:
            raise UserError("--length-m and --minutes exclude each other: give one of them")
        if self.minutes is not None:
            return self.minutes * self.feed
        return DEFAULT_PATH_TRAVELS * travel if self.length_m is None else self.length_m * 1e3

    def planned(self, machine: Machine, choices: Choices) -> NominalPath:
        """The best path of this length; the terminal shows the progress of the search."""
        from itertools import pairwise

        import numpy as np

        from calibration.on_the_fly.along_path import CELL_MM, CORNER_MM
        from calibration.on_the_fly.nominal_path import NominalPath
        from calibration.on_the_fly.planning.noise_gain import Volume
        from calibration.on_the_fly.planning.path_search import IMPROVEMENT_TRIES, RANDOM_PATHS, best_path
        from postproc.commands.show.terminal import progress_of

        ends = _ends(machine, choices)
        volume = Volume(machine, ends, choices.targets, CELL_MM, CORNER_MM)
        length = self.length(float(np.ptp(ends[:, ~machine.rotary], axis=0).sum()))
        with progress_of(RANDOM_PATHS + IMPROVEMENT_TRIES, "searching for the best path", 0) as progress:
            corners = best_path(volume, length, np.random.default_rng(choices.seed), progress).corners
        feed_distance = np.concatenate([[0.0], np.cumsum([volume.length(a, b) for a, b in pairwise(corners)])])
        return NominalPath(machine, corners, feed_distance, np.ones(len(corners), bool), "the planned path")


def plan_path(
    *,
    machine: MachineName,
    output: PlanFile,
    path: PathOptions,
    program: MeasuringProgramOptions,
    tools: ToolOptions,
    others: ResultOptions,
) -> None:
    """Plan a path that a laser tracker follows without stops, or evaluate the path of a program."""
    from calibration.on_the_fly.planning.predicted_fit import evaluated_path
    from postproc.generate import path_program

    if path.path is None:
        refuse_given("is for the program of --path: give it too", tools, *(each.name for each in fields(tools)))
        program.refuse_without_effect()
    else:
        program.refuse_without_effect("work_offset")
    found = ncomp.load_machine(machine)
    choices = path.choices(found)
    settings, dialect = program.settings(found, path.feed), program.control(found)
    if path.path is None:
        nominal = path.planned(found, choices)
    else:
        offsets = [program.work_offset] if program.work_offset else []
        nominal = read_path(path.path, found, ncomp.set_up(found, work_offset=offsets, **tools.arguments))
    evaluated = evaluated_path(nominal, choices.targets)
    lines = path_program(nominal.machine, nominal.positions / nominal.machine.scale, settings, dialect)
    report = path_report(nominal, evaluated, path.feed, len(choices.targets))
    write(plan_of_path(nominal, choices, path.feed), lines, report, program, output, others, (path.path,))


def plan_of_path(path: NominalPath, choices: Choices, feed: float) -> Plan:
    """The corners of a path, once for each target."""
    import numpy as np

    from calibration.measurement.measurement import with_moves
    from calibration.measurement.plan import Plan
    from kinematics.state import State

    n, names = len(path.positions), list(choices.targets)
    time = np.concatenate([path.feed_distance + k * path.feed_distance[-1] for k in range(len(names))]) / feed * 60.0
    state = State(np.tile(path.positions, (len(names), 1)), time=time, target=np.repeat(names, n))
    minutes = choices.timing.setup_min + float(path.feed_distance[-1]) * len(names) / feed
    points = np.array([f"C{k}" for k in range(1, n + 1)] * len(names))
    return Plan(
        path.machine, STRATEGY, with_moves(state), points, np.full(len(state), "1"), choices.targets, minutes=minutes,
        position_count=n,
    )  # fmt: skip


def path_report(path: NominalPath, evaluation: PathEvaluation, feed: float, targets: int) -> Report:
    """Evaluation of a path, for people."""
    noise_gain = evaluation.noise_gain
    each = f", once for each of {targets} targets" if targets > 1 else ""
    length = f"{len(path.positions)} corners, {evaluation.feed_mm * 1e-3:.2f} m"
    noise = (
        f"{noise_gain.noise:.3f} um in a coordinate of the volume (worst {noise_gain.worst:.3f}) by 1 um in each 4 mm"
    )
    rows = [
        ("path", f"{path.source}: {length}, {evaluation.feed_mm / feed:.1f} min at {feed:g} mm/min{each}"),
        ("noise gain", noise),
    ]
    if noise_gain.hidden:
        number = "1 direction" if noise_gain.hidden == 1 else f"{noise_gain.hidden} directions"
        rows.append(("HIDDEN", f"{number} of the errors in the volume cannot be determined along this path"))
    if evaluation.unidentifiable_mode is not None:
        rows.append(("HIDDEN MODE", evaluation.unidentifiable_mode))
    hidden = shortened(list(map(str, evaluation.unidentifiable)), LISTED_HIDDEN_ERRORS, "effects")
    rows += [("NOT VISIBLE", text) for text in hidden]
    return Report("Path", "", [facts("Path", rows)])


def _ends(machine: Machine, choices: Choices) -> np.ndarray:
    """Ends `(2, axes)`, mm and rad, of the range of the path; equal for axes that do not move."""
    import numpy as np

    from calibration.planning.strategies import fixed_positions, limits, need_ends

    low, high = limits(machine, choices)
    standing = fixed_positions(machine, choices)
    for i in range(len(machine.axes)):
        if machine.rotary[i] and choices.rotary == "fixed":
            low[i] = high[i] = standing[i]
        else:
            need_ends(machine, i, low, high)
    return np.asarray(np.stack([low, high]) * machine.scale)
