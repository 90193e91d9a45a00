"""The real ISO programs, their machines, and a run of one of them."""

import io

import pytest

from postproc.control.setup import make_setup
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.dialects import find_dialect
from postproc.text.source import open_source
from support.programs import load
from support.real_data import FREECAD

REAL_SETUP = {"five_axis_ac": "trunnion_ac"}


def real_programs(nc_data):
    return sorted((nc_data / "iso").rglob("*.*")) + sorted(FREECAD.glob("*.nc"))


LINES_OF_REAL_PROGRAMS = pytest.mark.parametrize("lines", [150, pytest.param(None, marks=pytest.mark.statistical)])
"""Long programs are read to this line in the default tiers, and all are read whole in the statistical tier."""


def first_lines(programs, lines, folder):
    """The programs, those that are longer than some lines as copies of their first lines; None: all whole."""
    for path in programs:
        text = path.read_bytes().splitlines(keepends=True)
        if lines is None or len(text) <= lines:
            yield path
        else:
            short = folder / path.parent.name / path.name
            short.parent.mkdir(exist_ok=True)
            short.write_bytes(b"".join(text[:lines]))
            yield short


def machine_for(path):
    return load(REAL_SETUP.get(path.parent.name, "dmu50"))


def run(path, machine, model, tolerance_um=1.0):
    source, out = open_source(str(path)), io.BytesIO()
    setup = make_setup(machine, zero=True)
    job = Job(source, find_dialect("iso", "", ""), machine, model, setup, False, tolerance_um=tolerance_um)
    report = Pipeline(job).run(out, lambda _: None)
    return out.getvalue(), report


ACCEPTED = {
    "CONTOUR.NC", "CONTOUR_R.NC", "CONTOUR_R1.NC", "G17_18_19.NC", "G17_18_19_G91.NC", "PARALLEL.NC", "PROGRAM.NC",
    "PROGRAM2.NC", "TEST.NC", "TEST3.NC", "TEST4.NC", "TEST_G90.NC", "VINT_360arc-1.NC", "VINT_360arc.NC",
    "VINT_REV_360arc.NC", "impeller-7bl-xyzac.ngc", "box_grbl.nc", "box_linuxcnc.nc", "box_mach3_mach4.nc",
    "G81.NC", "G82.NC", "G83.NC",
}  # fmt: skip
SHORT = {
    "CONTOUR_R.NC", "G17_18_19_G91.NC", "PROGRAM.NC", "TEST3.NC", "TEST4.NC", "VINT_REV_360arc.NC", "box_grbl.nc",
    "box_linuxcnc.nc",
}  # fmt: skip
"""One of each kind that is not long: contours, planes, drawings, helices, and the posts of a CAM system."""
FEW = {*SHORT, "G83.NC", "impeller-7bl-xyzac.ngc"}
"""One of each kind of all: drilling cycles and five axes too."""
