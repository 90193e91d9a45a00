"""Results of a calibration depend on its data alone: not on what was fitted, diagnosed or studied before."""

import dataclasses
import datetime
from collections.abc import Mapping
from pathlib import Path

import msgspec
import numpy as np
import pytest
from support.diagnosis_cases import data_with

from calibration.diagnosis.diagnose import diagnose
from calibration.fit.calibrate import calibrate
from calibration.study.cases import read_cases
from calibration.study.chunks import Chunk, Prepared
from calibration.study.definition import study_of
from kinematics.effects import Backlash
from kinematics.error_model.model import encode_model
from kinematics.user_error import UserError


def frozen(value):
    """The same measurement with every array read-only: whatever writes into it fails."""
    for entry in vars(value).values() if dataclasses.is_dataclass(value) else value:
        if isinstance(entry, np.ndarray):
            entry.setflags(write=False)
        elif isinstance(entry, Mapping):
            frozen(entry.values())
        elif dataclasses.is_dataclass(entry):
            frozen(entry)
    return value


DATA = [
    frozen(data_with(Backlash("X", 20.0), n=100)),
    frozen(data_with(Backlash("Y", 30.0), Backlash("X", 25.0), n=100, seed=8)),
]
MADE = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)


def content(model):
    """A calibration without the time at which it was made."""
    made = msgspec.structs.replace(model.provenance, made_at=MADE)
    return encode_model(msgspec.structs.replace(model, provenance=made))


def calibrated(data, basis):
    """The calibration, or the message of its refusal."""
    try:
        return content(calibrate(data, basis=basis).model)
    except UserError as refusal:
        return str(refusal)


def diagnosed(data):
    """The new calibration, causes and proposed measurements of a diagnosis, or the message of its refusal."""
    try:
        found = diagnose(data)
    except UserError as refusal:
        return str(refusal)
    return content(found.model), repr(found.causes), repr(found.proposals)


def results(data):
    """Calibrations by a stated basis and by the evidence, and the diagnosis."""
    return calibrated(data, "legendre:3"), calibrated(data, "auto"), diagnosed(data)


@pytest.mark.statistical
def test_a_calibration_is_the_same_after_another():
    first, second = DATA
    alone = results(first)
    assert isinstance(alone[0], bytes)
    assert isinstance(alone[2], tuple)
    results(second)
    with pytest.raises(UserError):
        calibrate(first.rows(np.arange(2)))
    assert results(first) == alone


def test_chunks_of_a_study_are_the_same_in_any_order():
    """Bits too: a worker may get any of them first."""
    entry = {"name": "c", "strategy": "grid", "points": 60, "tracker": [-1200, -900, 300]}
    content = {"machine": "cframe", "seed": 3, "case": [entry]}
    case = read_cases(study_of(content, "test"), Path())[0]
    chunks = [Chunk(k, 4) for k in range(3)]
    together = Prepared.of(case)
    forward = [together.outcome(chunk) for chunk in chunks]
    for chunk, outcome in list(zip(chunks, forward, strict=True))[::-1]:
        alone = Prepared.of(case).outcome(chunk)
        assert np.array_equal(alone.before, outcome.before)
        assert np.array_equal(alone.after, outcome.after)
