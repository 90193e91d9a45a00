"""How results move when a prior is halved or doubled; writes docs/develop/priors.md.

    python benchmarks/priors.py --seed 21 --questions 28 --jobs 2 --page docs/develop/priors.md
    python benchmarks/priors.py --seed 21 --questions 14 --only walk,outlier

The questions are those of the third exam (benchmarks/short_measurements), each asked with the priors as they are, and
with each of them halved and doubled (probabilities: odds). A cause or a function is named if it is of the kind and the
place of the hidden effect; every other cause is false.
"""

from __future__ import annotations

import argparse
import ast
import dataclasses
import inspect
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from short_measurements.answers import judged, predicted, without_rigid
from short_measurements.case import UM, Case
from short_measurements_exam import questions

import ncomp
from calibration.diagnosis.diagnose import diagnose
from calibration.reports.diagnosis.document import diagnosis_json
from kinematics.error_model.model import write_model
from kinematics.error_model.priors import KINDS, PRIORS, Priors

PROBABILITIES = ("outlier", "common", "rare", "smooth", "swing", "walk", "fine", "most_left_out")
HEAD = """# Priors

What a [diagnosis](how_causes_are_found.md), and a fit with automatic bases, know before any data. Each number has its
reason, or its data; a machine file states its kind of machine, or single numbers, under `[priors]` ([the machine
file](../machines.md)).

"""
OF_KINDS = """
## Kinds of machines

Where a kind differs from a machining centre:

"""
RESULTS = """
## How results move

Priors halved and doubled (of probabilities the odds), with {questions} questions of the third exam:

    python benchmarks/priors.py {options} --page docs/develop/priors.md

Without `--only` all priors are tried. Named, tied, unexplained: what became of the hidden effects. False: causes that
are not there. Within 95 %: errors at unseen poses within their intervals, all questions and the lowest one. Left: their
RMS, median.

"""


class Said(NamedTuple):
    """What a diagnosis says of a question."""

    verdict: str
    """named, tied, unexplained or missed."""
    false: int
    """Number of causes that are not there."""
    covered: float
    """Share of the errors at unseen poses within their intervals of 95 %."""
    left: float
    """Their RMS, um, that the calibration leaves."""


def changed(name: str, factor: float) -> Priors:
    """The priors with one of them times a factor; of probabilities the odds."""
    value = getattr(PRIORS, name)
    if name in PROBABILITIES:
        odds = factor * value / (1.0 - value)
        return dataclasses.replace(PRIORS, **{name: odds / (1.0 + odds)})
    return dataclasses.replace(PRIORS, **{name: factor * value})


def asked(words: tuple[str, str, str, int], priors: Priors) -> Said:
    """The answer to a question, with some priors."""
    case = Case(*words)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        case.write(folder)
        machine = dataclasses.replace(ncomp.load_machine(case.machine), priors=priors)
        answer = diagnose(ncomp.read_measurement(folder / "data.csv", machine), force=True)
        states = case.unseen()
        nominal = case.nominal(states)
        true = without_rigid(nominal, (case.points(states, unseen=True) - nominal) / UM)
        write_model(answer.calibration, folder / "new.json")
        record = predicted(case, folder / "new.json", folder, nominal, true)
    found = diagnosis_json(answer)
    verdict = judged(case, found["effects"], found["unexplained"], found["estimated_noise"])
    return Said(verdict["verdict"], len(verdict["false"]), record["covered"], record["after_um"])


def row(name: str, said: Sequence[Said]) -> str:
    """The row of one choice of priors."""
    counts = [sum(each.verdict == verdict for each in said) for verdict in ("named", "tied", "unexplained")]
    covered = [each.covered for each in said]
    left = float(np.median([each.left for each in said]))
    cells = [name, *map(str, counts), str(sum(each.false for each in said))]
    cells += [f"{100 * np.mean(covered):.1f} %", f"{100 * min(covered):.0f} %", f"{left:.2f}"]
    return f"| {' | '.join(cells)} |"


def reasons() -> str:
    """The priors with their values and reasons, from their source."""
    (record,) = (node for node in ast.parse(inspect.getsource(Priors)).body if isinstance(node, ast.ClassDef))
    found, fields = ["| prior | value | reason |", "|---|---|---|"], record.body[1:]
    for field, text in zip(fields[::2], fields[1::2], strict=True):
        assert isinstance(field, ast.AnnAssign)
        assert isinstance(text, ast.Expr)
        name, reason = ast.unparse(field.target), " ".join(str(ast.literal_eval(text.value)).split())
        found.append(f"| `{name}` | {getattr(PRIORS, name):g} | {reason} |")
    return "\n".join(found)


def kinds() -> str:
    """The kinds of machines, with what differs from the priors above, and their sources."""
    found = ["| kind | priors | source |", "|---|---|---|"]
    for name, kind in KINDS.items():
        own = [(each.name, getattr(kind.priors, each.name)) for each in dataclasses.fields(Priors)]
        differs = ", ".join(f"`{prior}` {value:g}" for prior, value in own if value != getattr(PRIORS, prior))
        found.append(f"| `{name}` | {differs or '-'} | {kind.source} |")
    return "\n".join(found)


def main() -> None:
    """Ask, and write or print the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=21, help="seed of the draws")
    parser.add_argument("--questions", type=int, default=14, metavar="N", help="number of questions")
    parser.add_argument("--only", default="", help="some priors, by name")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--page", type=Path, help="page to write; by default it is printed")
    given = parser.parse_args()
    words = list(questions(given.seed))[: given.questions]
    names = given.only.split(",") if given.only else [each.name for each in dataclasses.fields(Priors)]
    choices = {"as they are": PRIORS}
    for name in names:
        choices |= {f"`{name}` halved": changed(name, 0.5), f"`{name}` doubled": changed(name, 2.0)}
    head = ("prior", "named", "tied", "unexplained", "false", "within 95 %", "lowest", "left, um")
    rows = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    with ProcessPoolExecutor(given.jobs) as pool:
        for name, priors in choices.items():
            rows.append(row(name, list(pool.map(asked, words, [priors] * len(words)))))
            print(rows[-1], flush=True)
    if given.page:
        table = "\n".join(rows)
        only = f" --only {given.only}" * bool(given.only)
        options = f"--seed {given.seed} --questions {given.questions}{only}"
        text = RESULTS.format(questions=given.questions, options=options)
        given.page.write_text(f"{HEAD}{reasons()}\n{OF_KINDS}{kinds()}\n{text}{table}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
