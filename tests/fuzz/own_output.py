"""Examination of a run by its own output: no block is refused, the output is read, and `verify` finds what the run claims."""

from __future__ import annotations

import json

from msgspec.structs import replace

from kinematics.machine import Machine
from kinematics.user_error import UserError
from postproc.correct.job import Job
from postproc.dialects import find_dialect
from postproc.motion.motions import merged
from postproc.verification.verify import read_motions, verify
from tests.fuzz.case import Case, Outcome, Verdict
from tests.fuzz.ncomp import reason_of
from tests.fuzz.verified import ACCEPTED, CLAIM_UM, ENDINGS, _machine, _model, _run, _setup, _source

machine_named = _machine
__all__ = ["ENDINGS", "examine", "machine_named"]


def examine(case: Case, machine: Machine) -> Outcome:
    """Correct the program of a case, whose first option is its plan, and verify the output.

    The work offset is touched off, so that the error is 0 at the origin of the program.
    """
    plan = json.loads(case.options[0])
    dialect, source = find_dialect(plan["dialect"], case.name, ""), _source(case.program, case.name)
    setup = replace(_setup(case.machine, plan["dialect"]), probed=True)
    model, tolerance = _model(case.machine, case.calibration), plan["tolerance"]
    try:
        text, report = _run(Job(source, dialect, machine, model, setup, tolerance_um=tolerance, accepted=ACCEPTED))
    except UserError as refusal:
        reason = reason_of(str(refusal)).replace(":", "")
        return Outcome(Verdict.DIFFERS, f"refused {plan['dialect']} {reason}: {refusal}")
    try:
        texts = [merged(read_motions(each, dialect, machine, setup)) for each in (source, _source(text, case.name))]
        verdict = verify(texts[0], texts[1], model, tolerance_um=tolerance)
    except UserError as refusal:
        return Outcome(Verdict.DIFFERS, f"not verified: {refusal}")
    claims = (
        ("before", report.before.largest, verdict.before.largest),
        ("after", report.after.largest, verdict.after.largest),
    )
    for name, claim, found in claims:
        if abs(claim - found) > CLAIM_UM:
            return Outcome(Verdict.DIFFERS, f"claim {name}: {claim:.3f} um, and verify finds {found:.3f}")
    # beside a reversal a run takes the direction of the end of the move, and may claim more than `verify` finds
    if report.anywhere.after < verdict.anywhere.after - tolerance:
        anywhere = f"{report.anywhere.after:.3f} um, and verify finds {verdict.anywhere.after:.3f}"
        return Outcome(Verdict.DIFFERS, f"claim anywhere: {anywhere}")
    return Outcome(Verdict.COMPARED)
