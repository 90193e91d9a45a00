"""Klartext programs through ncomp inside a test."""

import io
import re

from kinematics.error_model.model import no_errors
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.motion.motions import merged
from postproc.text.source import ENCODING, Source
from postproc.verification.verify import read_motions
from support.programs import AT_MOST, WHOLE, load, setup_of, source_of
from support.tiers import quick

KLARTEXT = find_dialect("heidenhain", "", "")
OFFSET = {"X": 3.0, "Y": -4.2, "Z": 5.5}
SHIFT = [-0.003, 0.0042, -0.0055]
HEAD = "BEGIN PGM T MM\nL X+0 Y+0 Z+0 R0 FMAX\n"
TAIL = "END PGM T MM\n"


def read(text, machine="gantry"):
    machine = load(machine)
    return merged(read_motions(source_of(text, "test.h"), KLARTEXT, machine, setup_of(machine)))


def correct(text, machine="gantry", model=None, tolerance_um=WHOLE["tolerance_um"]):
    machine, out = load(machine), io.BytesIO()
    job = Job(
        source_of(text, "test.h"),
        KLARTEXT,
        machine,
        model or no_errors(machine),
        setup_of(machine),
        False,
        tolerance_um=tolerance_um,
        **AT_MOST,
    )
    Pipeline(job).run(out, lambda _: None)
    return re.sub("; NCOMP .* PROGRAM .*\n", "", out.getvalue().decode(ENCODING))


NUMBERED_HEAD = "0 BEGIN PGM A MM\r\n1 TOOL CALL 1 Z S1000\r\n2 L X+10 Y+20 Z+50 R0 FMAX M3\r\n"


FIVE_AXIS = quick([("xg_model3.h", None), ("YL-01.h", None), ("xg_model3.h", 800)], [("xg_model3.h", 800)])
"""Real five-axis programs: whole, and the first lines of one."""
MOVES = {None: 7854, 800: 785}
"""Moves of each of them, by the number of lines."""


def first_lines_of(path, lines):
    """A program, or its first lines; None: all."""
    data = b"".join(path.read_bytes().splitlines(keepends=True)[:lines])
    return Source(path.name, data.decode(ENCODING), data)


def numbered_program(text):
    """A program with block numbers and the line ends of a control."""
    data = (NUMBERED_HEAD + text).encode("latin-1")
    return Source("a.h", data.decode("latin-1"), data)
