"""The corrected lines of a program in any dialect, and its notes."""

import io

from kinematics.user_error import UserError
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.text.source import ENCODING
from support.programs import AT_MOST, source_of
from support.three_dialects import setup as offset_setup


def written(text, machine, model, dialect="iso", setup=None):
    """The corrected program without its mark, and the notes; or why it is refused."""
    source, out, dialect = source_of(text), io.BytesIO(), find_dialect(dialect, "", "")
    made = setup or offset_setup(machine, dialect.name)
    job = Job(source, dialect, machine, model, made, travel_check=False, **AT_MOST)
    try:
        report = Pipeline(job).run(out, lambda _: None)
    except UserError as refusal:
        return str(refusal), []
    lines = out.getvalue().decode(ENCODING).splitlines()
    return [line for line in lines if "CALIBRATION" not in line], report.notes
