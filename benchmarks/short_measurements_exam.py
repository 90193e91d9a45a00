"""Third exam of `ncomp diagnose`: short measurements, 62 to 150 rows of a laser tracker, with one hidden effect.

    python benchmarks/short_measurements_exam.py --seed 11             # each design with each effect: 98 questions
    python benchmarks/short_measurements_exam.py --seed 11 --most 20   # the first 20 of them
    python benchmarks/short_measurements_exam.py --table               # the table of the recorded answers alone

A C-frame and a gantry, seven designs, fourteen effects. Geometry, kinematics, instrument and files are written here:
the truth shares nothing with ncomp, nor with the two other exams. Every axis has slopes and humps in all six error
motions. The header of the file gives half, once or twice the true noise. Each answer is appended to the file of records
(--records); a question that has its answer there is not asked again.

An effect is named if a cause has its kind and its axis, tied if an alternative has, and unexplained if only variables
are listed, or the axis of a stick-slip is stated not to repeat. Otherwise it is missed, or invisible where the power of
the data to show it is below 0.5 (the Fisher information of the true effect, `short_measurements/visibility.py`). Every
other cause is false. Errors at 300 unseen poses are those that the best rigid motion leaves, by the calibration that
--force writes. "worse": ncomp accepts a calibration that leaves more than no correction does. "refused": it does not
accept one that leaves less. "covered" is the share of errors within the intervals of 95 %, of accepted calibrations.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from short_measurements.answers import asked
from short_measurements.case import KINDS, Case
from short_measurements.designs import DESIGNS
from short_measurements.tables import read, table


def questions(seed: int) -> Iterator[tuple[str, str, str, int]]:
    """Each design with each effect, in an order in which all of both come early; the machines in turn."""
    for j in range(len(DESIGNS)):
        for k, effect in enumerate(KINDS):
            yield ("cframe", "gantry")[(j + k) % 2], list(DESIGNS)[(3 * k + j) % len(DESIGNS)], effect, seed


def main() -> None:
    """Ask, record and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1, help="seed of the draws")
    parser.add_argument("--most", type=int, default=None, metavar="N", help="the first N questions only")
    parser.add_argument("--only", default="", metavar="TEXT", help="questions whose name contains it: pitch, layers/")
    parser.add_argument("--records", type=Path, default=Path("out/short_measurements_exam.jsonl"), help="the answers")
    parser.add_argument("--table", action="store_true", help="the table of the records, asking nothing")
    given = parser.parse_args()
    given.records.parent.mkdir(parents=True, exist_ok=True)
    known = {record["name"] for record in read(given.records)}
    for words in [] if given.table else list(questions(given.seed))[: given.most]:
        case = Case(*words)
        if case.name in known or given.only not in case.name:
            continue
        with tempfile.TemporaryDirectory() as folder:
            record = asked(case, Path(folder))
        with given.records.open("a", encoding="utf-8") as file:
            file.write(json.dumps(record) + "\n")
        after = f"{record.get('none_um', 0):.1f} -> {record.get('after_um', 0):.1f} um"
        print(record["name"], record.get("verdict", record.get("failure")), record.get("false"), after, flush=True)
    print("\n".join(table(read(given.records))))


if __name__ == "__main__":
    main()
