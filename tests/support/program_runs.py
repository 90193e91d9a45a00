"""Programs of all dialects that set offsets and tools themselves, and everything that a run of one gives."""

import dataclasses
import io
import json
from typing import Any

import numpy as np
from hypothesis import strategies as st

from kinematics.effects import Backlash
from kinematics.machine import Machine
from kinematics.user_error import UserError
from postproc.control.setup import make_setup
from postproc.correct.check import check
from postproc.correct.job import Job
from postproc.correct.pipeline import Pipeline
from postproc.correct.plausibility import REASONS
from postproc.dialects import find_dialect
from postproc.motion.motions import merged
from postproc.text.source import ENCODING
from postproc.verification.verify import read_motions, verify
from support.programs import load, model_of, random_model, source_of
from support.three_dialects import WRITERS, parts, tilted_parts

WRITER = {writer.name: writer for writer in WRITERS}
DIALECTS = tuple(WRITER)
ROTARY = {"gantry": (), "trunnion_bc": ("B", "C"), "head_table": ("B", "C")}
"""Machines of the properties, with their rotary axes."""
OFFSETS = ("G54=10,20,30", "G55=40,50,60", "0=10,20,30", "1=40,50,60")
LENGTHS = ("T1=80", "T2=50")

number = st.integers(-90, 90).map(str)
BEGINS = {"iso": "G21 G90 G17 G94\nG54 G0 X0. Y0. Z0.\n", "siemens": "G54 G0 X0 Y0 Z0\n", "heidenhain": ""}
STATEMENTS = {
    "iso": st.one_of(
        st.builds("G10 L2 P{} X{} Z{}\nG90 G1 X1.5 Y2. Z3. F500".format, st.sampled_from("12"), number, number),
        st.builds("G{} G0 X{}. Y{}. Z1.".format, st.sampled_from(["54", "55"]), number, number),
        st.builds("G52 X{}.\nG1 X3. Y4. Z5. F500\nG52 X0.".format, number),
        st.builds("T{0} M6\nG43 H{0} X1. Y1. Z{1}.".format, st.sampled_from("12"), number),
        st.builds("#101={}\nG1 X#101 Y2. Z3. F500".format, number),
        st.builds("G91 G1 X{}. F500\nG90 X0. Y0. Z0.\nG53 X100.\nG2 X20. Y0. I10. J0. F300".format, number),
    ),
    "siemens": st.one_of(
        st.builds("$P_UIFR[{},{},{}]={}".format, st.sampled_from("12"), st.sampled_from("XYZ"),
                  st.sampled_from(["TR", "FI"]), number),
        st.builds("G{} G0 X{} Y{} Z1".format, st.sampled_from(["54", "55"]), number, number),
        st.builds("TRANS X{}\nG1 X3 Y4 Z5 F500\nTRANS".format, number),
        st.builds("$TC_DP3[{0},1]={1}\nT{0} D1 M6\nG1 X1 Y1 Z2 F500".format, st.sampled_from("12"), number),
        st.builds("R1={}\nG1 X=R1 Y2 Z3 F500\nG3 X=R1 Y22 CR=10".format, number),
    ),
    "heidenhain": st.one_of(
        st.builds("TOOL DEF {} L{}".format, st.sampled_from("12"), number),
        st.builds("TOOL CALL {} Z S2000\nL X+1 Y+2 Z+3 FMAX".format, st.sampled_from("12")),
        st.builds("CYCL DEF 247 DATUM SETTING ~\n Q339={} ;NUMBER\nL X{} Y+2 Z+3 F500".format, st.sampled_from("01"),
                  number),
        st.builds("Q1={}\nL X+Q1 Y+2 Z+3 F500\nCC IX+0 IY+10\nCP IPA+90 DR+".format, number),
    ),
}  # fmt: skip
"""Statements that set what later blocks are read by."""
REFUSED = {"iso": "G1 X1. Y1. Q9 ?\n", "siemens": "G1 X1 SPLINEPATH(1)=2 ?\n", "heidenhain": "L X+1 ?? F1\n"}


@dataclasses.dataclass(frozen=True)
class Program:
    """A program, and the machine that it runs on."""

    machine: str
    dialect: str
    text: str


@st.composite
def programs(draw, dialects: tuple[str, ...] = DIALECTS) -> Program:
    """A part in five or three axes, or statements that set the control."""
    dialect = draw(st.sampled_from(dialects))
    kind = draw(st.sampled_from(["part", "tilted", "statements"]))
    if kind == "statements":
        lines = draw(st.lists(STATEMENTS[dialect], min_size=1, max_size=8))
        return Program("gantry", dialect, BEGINS[dialect] + "\n".join(lines) + "\n")
    if kind == "part":
        return Program("gantry", dialect, WRITER[dialect]().program(draw(parts(drilled=True))))
    name = draw(st.sampled_from([name for name, axes in ROTARY.items() if axes]))
    tcp = draw(st.booleans())
    return Program(name, dialect, WRITER[dialect](tcp).program(draw(tilted_parts(ROTARY[name]))))


def model_for(machine: Machine, seed: int):
    """Errors of all kinds, with backlash."""
    rng = np.random.default_rng(seed)
    plays = [Backlash(axis.name, float(rng.uniform(2, 20))) for axis in machine.axes if not axis.rotary]
    return model_of(machine, *random_model(machine, seed, 60.0).effects, *plays)


def job_of(program: Program, seed: int, **options: Any) -> Job:
    """The job of a program, everything in it its own."""
    machine = load(program.machine)
    return Job(
        source_of(program.text), find_dialect(program.dialect, "", ""), machine, model_for(machine, seed),
        make_setup(machine, OFFSETS, LENGTHS), travel_check=False, accepted=frozenset(REASONS), **options,
    )  # fmt: skip


def corrected(job: Job, processes: int = 1) -> dict[str, Any]:
    """The corrected text, the report and the figures of a job; or the message of its refusal."""
    pipeline, out = Pipeline(job, traced=True, processes=processes), io.BytesIO()
    try:
        report = pipeline.run(out, lambda _: None)
    except UserError as refusal:
        return {"refused": str(refusal)}
    content = report.json()
    content["calibration"].pop("age_days")
    trace = pipeline.trace
    assert trace is not None
    figures = [trace.bins.edges, trace.bins.lines, trace.bins.largest, trace.bins.rms, *trace.bins.corrections,
               trace.paths.points, trace.paths.errors]  # fmt: skip
    return {
        "text": out.getvalue().decode(ENCODING),
        "report": json.dumps(content),
        "notes": report.notes,
        "figures": [np.round(figure, 6).tobytes() for figure in figures],
        "worst": trace.worst,
        "between": trace.between_before.json(),
    }


def everything(job: Job) -> dict[str, Any]:
    """What `correct`, `check` and `verify` give of a job."""
    found = corrected(job)
    findings = check(job.source, job.dialect, job.machine, job.setup, travel_check=False)
    found["check"] = json.dumps(findings.json())
    if "text" in found:
        texts = (job.source, source_of(found["text"]))
        before, after = (merged(read_motions(text, job.dialect, job.machine, job.setup)) for text in texts)
        found["verify"] = json.dumps(verify(before, after, job.model, job.conditions).json())
    return found
