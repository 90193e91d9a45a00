"""Siemens programs through ncomp inside a test."""

import io
import re

import numpy as np

from kinematics.error_model.model import no_errors
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.motion.motions import merged
from postproc.text.source import ENCODING
from postproc.verification.verify import read_motions, verify
from support.programs import AT_MOST, load, setup_of, source_of

SIEMENS = find_dialect("siemens", "", "")


def read(text, machine="gantry", offsets=(), tools=()):
    """All moves."""
    machine = load(machine)
    return merged(read_motions(source_of(text, "test.mpf"), SIEMENS, machine, setup_of(machine, offsets, tools)))


def corrected(text, machine="gantry", model=None, **setup):
    """The program corrected, without the mark; and what was noted."""
    machine, out = load(machine), io.BytesIO()
    source, made = source_of(text, "test.mpf"), setup_of(machine, **setup)
    job = Job(source, SIEMENS, machine, model or no_errors(machine), made, travel_check=False, **AT_MOST)
    report = Pipeline(job).run(out, lambda _: None)
    return re.sub("; NCOMP .* PROGRAM .*\n", "", out.getvalue().decode(ENCODING)), report.notes


def correct(text, machine="gantry", model=None, **setup):
    """The program corrected, without the mark."""
    return corrected(text, machine, model, **setup)[0]


def ends(text, axis="X"):
    """Where an axis of the gantry stands after each move, rounded."""
    return [round(float(value), 9) + 0.0 for value in read(text).target[:, load("gantry").index(axis)]]


def judged(text, model, machine="gantry", least=15.0, **setup):
    """The corrected text, which has to take the tool where the program says, to rounding; and where that is."""
    written = correct(text, machine, model, **setup)
    before, after = read(text, machine, **setup), read(written, machine, **setup)
    verdict = verify(before, after, model)
    assert verdict.before.largest > least
    assert verdict.after.largest < 0.2
    return written, before


def places(motions, machine="gantry"):
    """Programmed X Y Z of all moves."""
    return motions.target[:, [load(machine).index(axis) for axis in "XYZ"]]


__all__ = ["SIEMENS", "correct", "corrected", "ends", "judged", "np", "places", "read"]
