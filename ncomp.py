r"""The public interface of ncomp: one function for each job, which the command of that name calls as well.

Machines are shipped names, paths of TOML files or `Machine` objects; calibrations are paths of JSON files, `"none"`
for a machine without errors, or `ErrorModel` objects. A program is a path, its text (any string with a line end), or a
`Source`. Options have the names and the values of the command line. Axis positions are in mm and degrees, errors in um
and urad, tool relative to workpiece.

Every function raises `ncomp.UserError`, with one clear message, for an input that cannot be used.

>>> import ncomp
>>> mill = ncomp.load_machine("dmu50")
>>> setup = ncomp.set_up(mill, work_offset=["G54=-30,-20,150"], tool_length=["T1=80"])
>>> program = "G21 G90 G54\nT1 M6\nG0 X10 Y10 Z5 B0 C0\nG1 X60 F500\nM30\n"
>>> done = ncomp.correct(program, mill, setup=setup)
>>> done.report.changed_blocks
2
>>> checked = ncomp.verify(program, done.text, mill, setup=setup).verdict
>>> checked.after.largest < 1.0 < checked.before.largest
True
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from kinematics.running.below_one_name import BelowOneName
from kinematics.running.caller import public
from kinematics.user_error import UserError
from kinematics.version import VERSION
from postproc.interface.codes import codes
from postproc.interface.folders import batch, job, watched
from postproc.interface.programs import Corrected, check, conditions, correct, open_program, set_up, set_up_of, verify
from postproc.interface.tables import export, export_parameters, import_tables
from postproc.interface.views import REPORTS
from rendering.shown import VIEWS

if TYPE_CHECKING:
    from calibration.fit.calibrate import NotAccepted
    from calibration.fit.together import TogetherNotAccepted
    from calibration.instruments import Ballbar, Interferometer, LaserTracker, Lengths, Level, Part, TouchProbe
    from calibration.interface.calibrations import diagnose, drift, fit, fit_together
    from calibration.interface.evaluations import (
        ballbar,
        compare,
        continuous,
        etve,
        iso230,
        square,
        three_points,
        tracker,
    )
    from calibration.interface.measurements import (
        plan,
        predict,
        read_measurement,
        read_on_the_fly,
        save,
        simulate,
        touches,
        virtual_machine,
    )  # fmt: skip
    from calibration.interface.virtual_laser import simulate_continuous
    from calibration.measurement.measurement import Measurement, Target
    from calibration.measurement.plan import Choices
    from calibration.on_the_fly.nominal_path import NominalPath
    from calibration.simulation.measure_plan import VirtualInstrument
    from calibration.study.studied import Studied, Study
    from history.interface import machine_history
    from kinematics.error_model.model import ErrorModel
    from kinematics.machine import Machine
    from postproc.control.setup import Setup
    from postproc.folders.programs import FolderProgram, Outcome
    from postproc.text.source import Source

__all__ = [
    "Ballbar",
    "Choices",
    "Corrected",
    "Interferometer",
    "LaserTracker",
    "Lengths",
    "Level",
    "NotAccepted",
    "Part",
    "Target",
    "TogetherNotAccepted",
    "TouchProbe",
    "UserError",
    "VirtualInstrument",
    "ballbar",
    "batch",
    "check",
    "codes",
    "compare",
    "conditions",
    "continuous",
    "correct",
    "diagnose",
    "drift",
    "etve",
    "export",
    "export_parameters",
    "fit",
    "fit_together",
    "import_tables",
    "iso230",
    "job",
    "load_calibration",
    "load_machine",
    "load_plugin",
    "machine_history",
    "plan",
    "predict",
    "read_measurement",
    "read_on_the_fly",
    "read_path",
    "report",
    "save",
    "set_up",
    "simulate",
    "simulate_continuous",
    "square",
    "study",
    "three_points",
    "touches",
    "tracker",
    "verify",
    "virtual_machine",
    "watch",
]

__version__ = VERSION
VIEWS.update(REPORTS)
if "__path__" not in globals():  # the repository, where no folder is named ncomp
    __path__: list[str] = []
    sys.meta_path.insert(0, BelowOneName(__name__))

MANY = 3000
"""Largest number of moves of a program at which a study evaluates errors, evenly spread."""


def __getattr__(name: str) -> Any:
    """A function on measurements or histories, whose libraries a correction does not load."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}", name=name)
    found: Any
    if name == "machine_history":
        from history import interface as of_histories

        found = getattr(of_histories, name)
    else:
        from calibration import interface as of_measurements

        found = getattr(of_measurements, name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


@public
def load_machine(machine: str | Path | Machine) -> Machine:
    """The machine of a shipped name or of a TOML file.

    >>> load_machine("dmu50").chain
    'w C B b X Y Z t'
    """
    from machines import given

    return given.load_machine(machine)


@public
def load_calibration(machine: str | Path | Machine, calibration: str | Path | ErrorModel | None = None) -> ErrorModel:
    """The calibration in a JSON file; None is the machine's own, `"none"` a machine without errors.

    UserError for a machine without a calibration of its own, and for a calibration of another machine.

    >>> len(load_calibration("dmu50", "none").effects)
    0
    """
    from machines import given

    return given.load_calibration(machine, calibration)


@public
def load_plugin(file: str | Path) -> None:
    """Add a physical cause of error of one's own: a Python file with the class of an effect (docs/develop/recipes.md).

    `file` is its path, NAME.py, or the name of an installed plug-in, which is an entry point of the group
    `ncomp.effects`. The next function that needs effects loads it, and processes that ncomp starts load it too.
    UserError for one that does not exist, and once the effects have been loaded.
    """
    from kinematics.running.plugins import request

    request([file])


@public
def read_path(
    program: str | Path | Source, machine: str | Path | Machine, *, setup: Setup | None = None, dialect: str = "auto"
) -> NominalPath:
    """The path of a program that a tracker follows, for `read_on_the_fly`: positions `(m, axes)`, mm and rad.

    UserError for a construct that cannot be followed. `notes` of the result are for the user.
    """
    from calibration.on_the_fly.nominal_path import NominalPath
    from postproc.dialects import find_dialect
    from postproc.program_path import program_path

    source, nominal = open_program(program), load_machine(machine)
    language = find_dialect(dialect, source.name, source.text_head)
    found = program_path(source, language, nominal, set_up_of(program, nominal, setup))
    notes = tuple(found.notes)
    return NominalPath(nominal, found.positions, found.length, found.counts, source.name, source.hash, notes)


@public
def report(page: str | Path) -> bytes:
    """A page that a command has written by `--report`, as PDF: A4, page numbers, light colours, all lists open.

    UserError for another file, and where neither Chromium nor Chrome is installed.
    """
    from rendering.printed import printed_page

    return printed_page(Path(page))


@public
def study(
    definition: str | Path,
    *,
    program: str | Path | Source | None = None,
    setup: Setup | None = None,
    dialect: str = "auto",
    workers: Annotated[int, 1, None] = 1,
    dask: str | None = None,
    keep_beside: str | Path | None = None,
    progress: Callable[[int], None] = lambda _: None,
) -> Studied:
    """Virtual calibrations of many virtual machines by the methods of a study (docs/study.md), compared.

    program: NC program, along which the errors after correction are evaluated too, with its set-up and dialect;
    workers: number of processes; a script that sets it must guard its main part by `if __name__ == "__main__"`; dask:
    address of a Dask scheduler, or `local`; keep_beside: file of the results, beside which the draws that are done are
    kept until `save` of the result writes it, so that an interrupted study continues; progress: called with numbers of
    draws done.
    """
    from calibration.study.store import Store
    from calibration.study.studied import Study

    planned = Study.read(Path(definition))
    if program is not None:
        planned, _ = study_along(planned, program, set_up_of(program, planned.machine, setup), dialect)
    store = Store(None) if keep_beside is None else Store.beside(str(keep_beside))
    return planned.run(workers, dask, store, progress)


def study_along(study: Study, program: str | Path | Source, setup: Setup, dialect: str) -> tuple[Study, str]:
    """A study with the ends of the moves of a program, and the part of the set-up that is assumed."""
    import numpy as np

    from calibration.design.volume import Volume, standing
    from postproc.dialects import find_dialect
    from postproc.verification.verify import assumed_motions

    source = open_program(program)
    language = find_dialect(dialect, source.name, source.text_head)
    motions, assumption = assumed_motions(source, language, study.machine, setup)
    rows = np.flatnonzero(motions.evaluated)
    if not len(rows):
        raise UserError(
            f"{source.name}: no move has known positions of all axes, so that no error along the program can be "
            "evaluated: write the positions of all axes into its first move"
        )
    if len(rows) > MANY:
        rows = rows[np.linspace(0, len(rows) - 1, MANY).astype(int)]
    sensors = study.definition.instrument.temperature
    volume = Volume.at(study.machine, standing(motions.machine_target[rows], sensors), motions.tool[rows])
    return study.along(volume), assumption


@public
def watch(
    folder: str | Path,
    output: str | Path | None = None,
    machine: str | Path | None = None,
    calibration: str | Path | None = None,
    *,
    job: str | Path | None = None,
    glob: Sequence[str] = (),
    settle: Annotated[float, 0.1, 600] = 2.0,
    idle: Annotated[float, 0, None] | None = None,
    set_up: Mapping[str, object] | None = None,
    conditions: Mapping[str, object] | None = None,
    drift: str | Path | None = None,
    drift_since: str | None = None,
    drift_tolerance_um: Annotated[float, 0, None] | None = None,
    drift_earlier: Sequence[Measurement] = (),
    progress: Callable[[FolderProgram, Outcome], None] = lambda *_: None,
    say: Callable[[str], None] = lambda _: None,
    **correction: Any,
) -> dict[str, int]:
    """Correct every program that appears or changes in a folder, until Ctrl-C; returns numbers of programs by state.

    Machine, calibration and the files of set-up and conditions are given by name, and read again when they change.
    folder: instead of a folder, a job file may give everything but settle and idle. job: job file with machine,
    calibration, set-up, conditions and correction for the folder. glob: as for `batch`. settle: time, s, for which a
    file must not change before it counts as complete. idle: time, s, without work after which the function returns.
    set_up and conditions: the arguments of the functions of these names. drift: log of touches (docs/drift.md), by
    which programs are corrected for the drift as well; drift_since and drift_tolerance_um: as for the command;
    drift_earlier: as `earlier` of `drift`. progress: called with each program and its end. say: called with each line
    that the command shows. correction: the other arguments of `correct`.

    A program that is refused does not stop the others; an earlier output of it is renamed to NAME.earlier. UserError
    for arguments that cannot be used when the function begins; later it waits until they can.
    """
    from calibration.interface.drifting import Drifting
    from postproc.interface.watching import NoResults, Watch

    given = {"machine": machine, "calibration": calibration, "set_up": set_up, "conditions": conditions, **correction}
    following = Drifting.of(drift, say, drift_since, drift_tolerance_um, lambda _: drift_earlier)
    return Watch(watched(folder, output, job, glob, given, following), settle, say, NoResults(), progress).run(idle)


if __name__ == "__main__":
    from postproc.cli import run

    run()
