"""The page of a diagnosis: what is wrong with the machine, the evidence for it, and what to do next."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from calibration.diagnosis.conclusion.result import Diagnosis
from calibration.evaluation.machine_change import directions_seen
from calibration.fit.prediction import usual_states
from calibration.measurement.measurement import Measurement
from calibration.reports.diagnosis.causes import cause_sections
from calibration.reports.diagnosis.commands import Files, use_section
from calibration.reports.diagnosis.registered import registered_rows
from calibration.reports.diagnosis.residual import (
    data_section,
    left_out_section,
    residual_sections,
    unexplained_sections,
)
from calibration.reports.diagnosis.unseen import unseen_sections
from calibration.reports.diagnosis.verdict import sentences
from calibration.reports.fit import acceptance
from calibration.reports.head import foot_of, measured_head
from calibration.reports.machine_change import change_sections
from calibration.reports.run_zeros import zeros_section
from calibration.reports.separability import separability_section
from kinematics.files.number_text import rounded
from rendering.report import Report, Section, Table
from rendering.volume import Field, Place, uncertainty_of, volume_section


def diagnosis_report(answer: Diagnosis, command: str, files: Files | None = None) -> Report:
    """The diagnosis for people; `command`: the command that made it; files: those of the commands in the report."""
    files = files or Files(answer.measurement.machine.name, "NEW.json", "OLD.json")
    title = f"Diagnosis of {answer.measurement.machine.name}"
    lead = f"{answer.measurement.source} · {answer.model.provenance.made_at:%Y-%m-%d %H:%M} UTC"
    written = answer.model if answer.accepted else None
    return Report(
        title,
        lead,
        list(_sections(answer, files)),
        "\n".join(sentences(answer)),
        acceptance(answer),
        measured_head(answer.measurement, written, command),
        foot_of(title, lead, written),
    )


def _sections(answer: Diagnosis, files: Files) -> Iterator[Section]:
    yield from cause_sections(answer)
    yield from unexplained_sections(answer)
    yield from _map(answer)
    yield data_section(answer)
    yield from change_sections(answer.machine_change)
    yield from residual_sections(answer)
    yield from unseen_sections(answer)
    yield separability_section(answer.design)
    yield from zeros_section(registered_rows(answer))
    yield from left_out_section(answer)
    yield Section("Next", answer.next_measurement)
    yield from _proposals(answer)
    yield use_section(files, answer.model)


def _proposals(answer: Diagnosis) -> Iterator[Section]:
    """The table of all designs that answer what the data leave open."""
    rows = [
        (each.name, f"{each.minutes:.0f}", rounded(each.gain_per_minute, 2), each.text)
        for each in answer.proposals
        if each.minutes
    ]
    if rows:
        head = ("measurement", "minutes", "log odds expected per minute", "instruction and expected result")
        yield Section("Proposed measurements", table=Table(head, rows), detail=True)


def _map(answer: Diagnosis) -> Iterator[Section]:
    """The errors of the machine by the new model, those that a correction by the present one leaves, and after."""
    fields = [Field("without a correction", answer.model)]
    if answer.given is not None:
        fields.append(Field("with a correction by the present calibration", answer.model, answer.given))
    measurement = answer.measurement
    fields.append(uncertainty_of(answer.model))
    yield from volume_section(measurement.machine, fields, measured=measurement.moving, place=_place(measurement))


def _place(measurement: Measurement) -> Place:
    """Where the machine was measured: what the instrument does not see there is no error that a map may expect."""
    state, tool = usual_states(measurement)
    x, y, z = tool[0].tolist()
    seen = directions_seen(measurement)
    directions = "" if seen > 2 else ", in the directions x and y alone, which were measured"
    text = f"the tool point at {x:g}, {y:g}, {z:g} mm, axes that did not move where they were{directions}"
    return Place(text, (x, y, z), tuple(np.median(state.positions, axis=0).tolist()), seen)
