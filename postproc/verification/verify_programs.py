"""Verification of a corrected program against its original, by one model or several, from the two texts alone."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine
from kinematics.user_error import UserError
from postproc.compensation.conditions import Conditions
from postproc.compensation.predicted_error import in_a_program, model_notes
from postproc.compensation.used_datums import UsedDatums
from postproc.control.interpreter import Interpreter
from postproc.control.setup import Setup
from postproc.control.without_effect import refuse_without_effect, unused_set_up
from postproc.correct.classes import ClassResiduals, ClassTable
from postproc.correct.mark import PARTS, Mark, check_mark, conversions_in_program, mark_in_program, mark_of
from postproc.correct.plausibility import parse_accepted
from postproc.correct.tcp.read_back import setups_of
from postproc.dialects import Dialect, find_dialect
from postproc.evaluation.trace import DrawnPaths
from postproc.text.notes import Notes
from postproc.text.source import Source
from postproc.verification.in_step import DifferentMoves, Matched, in_step
from postproc.verification.verify import Verdict, Verifier, run_motions
from rendering.shown import Shown


class Models(NamedTuple):
    """The error models of a verification."""

    calibration: ErrorModel
    """Model of the correction."""
    earlier: ErrorModel | None = None
    true: ErrorModel | None = None
    """Model of the true errors; None for `calibration`."""

    @property
    def evaluated(self) -> ErrorModel:
        """The model of the evaluated errors."""
        return self.true or self.calibration

    def by_key(self) -> dict[str, tuple[ErrorModel, str]]:
        """Each model by its key in the results, with the name of its option; the key of the first is empty."""
        found = {"": (self.evaluated, "--align" if self.true else "")}
        if self.true:
            found["by_calibration"] = (self.calibration, "--calibration")
        if self.earlier:
            found["by_old_model"] = (self.earlier, "--old")
        return found


@dataclass(frozen=True, repr=False)
class Verification(Shown):
    """Tool point errors of a program before and after correction."""

    models: Models
    """The calibrations by which errors are computed."""
    setup: Setup
    """Work offsets and tool lengths of the control."""
    verdicts: dict[str, Verdict]
    """Results by key of `Models.by_key`."""
    datums: UsedDatums
    """Datums of the work offsets that the programs used."""
    classes: list[ClassResiduals]
    """Errors that each ISO/TR 16907 class would leave; empty unless requested."""
    assumptions: tuple[str, ...]
    """Assumed parts of the set-up, as sentences."""
    notes: list[str]
    """Notes for the user."""
    paths: DrawnPaths | None = None
    """Feed moves with their errors by the first model, for a figure; None unless `traced` was set."""

    @property
    def headline(self) -> str:
        """The result in a few words."""
        errors = self.verdict
        return f"{self.setup.machine.name}, error at most {errors.before.largest:.3g} -> {errors.after.largest:.3g} um"

    @property
    def verdict(self) -> Verdict:
        """The errors by the model of the correction, or by the model of the true errors if there is one."""
        return self.verdicts[""]

    def json(self) -> dict[str, Any]:
        """The machine-readable form; every length in um."""
        others = {key: verdict.json() for key, verdict in self.verdicts.items() if key}
        rest = {"datum": self.datums.json(self.setup.obtained), "classes": [left.json() for left in self.classes]}
        return self.verdict.json() | others | rest


def verify_programs(
    programs: tuple[Source, Source],
    machine: Machine,
    models: Models,
    setup: Setup,
    *,
    dialect: str,
    conditions: Conditions,
    classes: bool,
    tolerance_um: float,
    accept: str | None,
    traced: bool = False,
    progress: Callable[[int], None] = lambda _: None,
) -> Verification:
    """Verify the second program as a correction of the first, both run with the same set-up.

    accept: parts of the mark that may differ, separated by commas; traced: keep moves for a figure; progress: called
    with the numbers of characters that were evaluated, of both programs. UserError for a program that is not
    understood, for two programs with different moves, and for a mark of another set-up that is not accepted.
    """
    accepted = parse_accepted(accept, PARTS)
    corrected = _mark_of_the_second(programs)
    notes = model_notes(models.evaluated, conditions)
    languages = [find_dialect(dialect, source.name, source.text_head) for source in programs]
    interpreters = _interpreters(languages, setup, programs)
    called: tuple[list[Source], list[Source]] = ([], [])
    nominal, commanded = map(run_motions, programs, languages, interpreters, (progress, progress), called)
    verifiers = {
        key: Verifier(machine, model, conditions, tolerance_um, traced=traced and not key)
        for key, (model, _) in models.by_key().items()
    }
    datums = UsedDatums(setup)
    table = ClassTable(machine, models.evaluated, conditions) if classes else None
    different = _evaluated(in_step(nominal, commanded), [*verifiers.values()], datums, table)
    states = [interpreter.control_state for interpreter in interpreters]
    refuse_without_effect(unused_set_up(states[0]))
    here = mark_of(models.calibration, states[0])
    for source in (programs[1], *(called[1] if corrected else ())):
        notes += _mark_notes(source, here, models.earlier, accepted)
    if different is not None:
        raise different
    datums.predict(machine, models.evaluated.part(in_a_program), conditions)
    return Verification(
        models,
        setup,
        {key: verifier.verdict() for key, verifier in verifiers.items()},
        datums,
        [] if table is None else table.rows,
        tuple(dict.fromkeys(state.assumption() for state in states)),
        [*notes, *datums.notes()],
        verifiers[""].paths,
    )


def _interpreters(languages: Sequence[Dialect], setup: Setup, programs: tuple[Source, Source]) -> list[Interpreter]:
    """The interpreters of both programs, the second of which may be converted between tool point and axes."""
    original, corrected = setups_of(setup, conversions_in_program(programs[1]))
    setups = original, msgspec.structs.replace(corrected, subprograms=tuple(_beside(programs, setup.subprograms)))
    return [language.interpreter(own.machine, own, Notes()) for language, own in zip(languages, setups, strict=True)]


def _beside(programs: tuple[Source, Source], folders: Sequence[str]) -> Iterator[str]:
    """Folders of subprograms for the second program: those inside of the first one's folder are in its own, too."""
    original, corrected = (source.folder for source in programs)
    for folder in folders:
        path = Path(folder).resolve()
        if original is not None and corrected is not None and path.is_relative_to(original.resolve()):
            yield str(corrected / path.relative_to(original.resolve()))
        yield folder


def _evaluated(
    steps: Iterator[Matched], verifiers: Sequence[Verifier], datums: UsedDatums, table: ClassTable | None
) -> DifferentMoves | None:
    """Evaluate the moves of both programs; returns the first difference of the moves, None without one."""
    try:
        for moves in steps:
            for verifier in verifiers:
                verifier.add(moves)
            datums.add(moves.nominal)
            if table is not None:
                table.add(moves.nominal)
    except DifferentMoves as fault:
        return fault
    return None


def _mark_of_the_second(programs: tuple[Source, Source]) -> Mark | None:
    """The mark of the corrected program; UserError if only the first program has one."""
    original, corrected = (mark_in_program(source) for source in programs)
    if corrected is None and original is not None:
        raise UserError(
            f"{programs[1].name} has no mark of ncomp, and {programs[0].name} has one: give the original first, "
            "then the corrected one"
        )
    return corrected


def _mark_notes(source: Source, here: Mark, earlier: ErrorModel | None, accepted: frozenset[str]) -> list[str]:
    """Notes on the mark of a corrected program; UserError, with its name, if its set-up differs from `here`."""
    mark, name = mark_in_program(source), source.name
    if mark is None:
        return [f"{name} has no mark of ncomp: the calibration and the set-up of its correction are not known"]
    if earlier is not None and mark.calibration == earlier.id.upper():
        here = here._replace(calibration=mark.calibration)
    return check_mark(name, mark, here, accepted)
