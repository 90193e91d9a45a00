"""Page and JSON of each program of a watched folder, in folders of their own."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from postproc.commands.options.declared import option
from postproc.commands.options.recorded import HistoryOptions, RecordedOptions, program_entry
from postproc.commands.options.shared import whole_results

if TYPE_CHECKING:
    from ncomp import Corrected
    from postproc.folders.programs import Correction, FolderProgram, Outcome
    from postproc.interface.request import Request


@dataclass(frozen=True, kw_only=True)
class EachResults(HistoryOptions):
    """Results of each program in addition to its correction."""

    json: Path | None = option("Folder for the results of each program as JSON, NAME.json.", "FOLDER", writes="folder")
    report: Path | None = option("Folder for the page of each program, NAME.html.", "FOLDER", writes="folder")

    def named(self, program: FolderProgram) -> dict[str, str | Path | None]:
        """The files of a program's results by their options; their folders are made."""
        named: dict[str, str | Path | None] = {}
        for option_name, folder, suffix in (("--json", self.json, ".json"), ("--report", self.report, ".html")):
            if folder is not None:
                path = folder / f"{program.name}{suffix}"
                path.parent.mkdir(parents=True, exist_ok=True)
                named[option_name] = path
        return named

    def correct(self, correction: Correction, program: FolderProgram, request: Request) -> Outcome:
        """Correct a program, and write its results."""
        from machines.given import load_machine
        from postproc.folders.programs import correct_file

        if self.json is None and self.report is None and self.address(load_machine(request.machine)) is None:
            return correct_file(correction, program)
        traced: Correction = partial(correction, traced=self.report is not None)
        return correct_file(traced, program, partial(self._write, program, request))

    def _write(self, program: FolderProgram, request: Request, done: Corrected) -> None:
        """Write page and JSON of a program, and enter it into the history: all of this or nothing."""
        from postproc.correct.report import correction_report

        named = self.named(program)
        files = {name: str(named[f"--{name}"]) if f"--{name}" in named else None for name in ("json", "report")}
        results = RecordedOptions(**files, report_head=None, history=self.history, db=self.db)
        inputs = (*request.inputs, program.path)
        command = f"ncomp watch: {program.path} -> {program.target}"
        shown = correction_report(done.job, done.report, done.trace, command)
        with results.recorded(done.job.machine) as record, whole_results(*results.files) as (json, page):
            results.write(done.report.json(), shown, (json, page), inputs)
            record(program_entry(done.report.json(), None, inputs))
