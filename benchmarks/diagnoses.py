"""Diagnoses of the questions of four exams, and the tables of docs/diagnosis.md.

    python benchmarks/diagnoses.py --seed 71 --each 20                      # 20 questions of each exam
    python benchmarks/diagnoses.py --seed 71 --each 20 --exams short,shop   # of two exams
    python benchmarks/diagnoses.py --table --records out/diagnoses.jsonl    # the table alone
    python benchmarks/diagnoses.py --table --page docs/diagnosis.md         # and into the page

Exams: `first` (benchmarks/diagnosis_exam.py, the causes that data show without a calibration), `shop` (the second one,
tests/shop_floor, but for its design with a calibration), `short` (the third one, benchmarks/short_measurements), and
`ordinary` (the files of --ordinary, which have no seed: the seed chooses among them). Each asks also data in which
nothing is hidden; `nothing` asks only these, in all designs of the first three. All questions are asked of a laser
tracker's data, without a calibration.

Each answer is appended to the file of records; a question that has its answer there is not asked again.

hidden: effects that are in the data. named, tied, missed: what became of them; unexplained: only variables are listed;
invisible: missed, and the power of the data to show it is below 0.5 (`short` alone). false: answers with a cause that
is not there. worse: calibrations that were accepted and leave more than no correction does (`shop`, `short`). refused:
calibrations that were not accepted, of `short` those that leave less than none. covered: errors at unseen poses within
their intervals of 95 %, all and the lowest of one question. sizes: within k = 2. left: median error at unseen poses,
um. s: processor time of a diagnosis, median and slowest tenth.

The second table has the causes by the odds that the diagnosis gives them: how many of them are there, or are tied with
one that is, and the share of which their odds say so.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
sys.path.insert(0, str(Path(__file__).parents[1]))

import ordinary_runs
import short_measurements_exam
from shop_floor import exam as shop
from shop_floor.chain import MACHINES
from shop_floor.designs import DESIGNS
from shop_floor.question import CAUSES
from short_measurements.answers import asked
from short_measurements.case import Case
from short_measurements.designs import DESIGNS as SHORT
from short_measurements.tables import VISIBLE, read
from virtual_machine import draws
from virtual_machine.scoring import score, title

Record = dict[str, Any]
TIMEOUT_S = 1800.0
NOTHING = "nothing"
NEEDS_CALIBRATION = ("location", "higher-frequency")
"""Kinds of the first exam that are differences from a calibration."""


class Question(NamedTuple):
    """A question, and how it is asked: `ask()` gives what its exam says of the answer."""

    exam: str
    name: str
    ask: Callable[[], Record]


def first(seed: int, count: int, _: Path) -> Iterator[Question]:
    """Kinds and machines of the first exam, by chance."""
    rng = np.random.default_rng([seed, 1])
    kinds = [kind for kind in (*draws.KINDS, NOTHING) if kind not in NEEDS_CALIBRATION]
    pairs = [(kind, machine) for kind in kinds for machine in draws.MACHINES]
    for number in rng.permutation(len(pairs))[:count].tolist():
        kind, machine = pairs[number]
        yield Question("first", f"{kind} {machine} {seed}", lambda k=kind, m=machine: _first(k, m, seed))  # type: ignore[misc]


def _first(kind: str, machine: str, seed: int) -> Record:
    return _of_first(draws.draw([] if kind == NOTHING else [kind], machine, seed))


def _of_first(draw: draws.Draw) -> Record:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "data.csv").write_text(draw.sheet(), encoding="utf-8")
        said = _diagnosed(folder, draw.setup.session.chain.name)
    if "failure" in said:
        return said
    found = said["diagnosis"]
    judged = score(found, said["calibration"], [cause.answer() for cause in draw.causes])
    named = sum(judged.named)
    tied = judged.tied * (len(judged.named) - named)
    left = len(judged.named) - named - tied
    unexplained = left if found["unexplained"] else 0
    counts = {"hidden": len(judged.named), "named": named, "tied": tied, "unexplained": unexplained}
    sizes = {"inside": judged.inside, "sizes": judged.of, "odds": _odds(found, judged.blamed, title)}
    return {**counts, "missed": left - unexplained, "false": list(judged.blamed), **sizes, "seconds": said["seconds"]}


def _diagnosed(folder: Path, machine: str) -> Record:
    """What the command writes of `data.csv` in a folder, and its processor time; or how it failed."""
    new, out = folder / "new.json", folder / "out.json"
    words = ("--machine", machine, "-o", new, "--json", out, "--force")
    try:
        ended = shop.ncomp(TIMEOUT_S, "diagnose", folder / "data.csv", *words)
    except shop.Failure as fault:
        return {"failure": str(fault)}
    if not out.exists():
        return {"failure": ended.words[-500:]}
    read_json = [json.loads(path.read_text(encoding="utf-8")) for path in (out, new)]
    return {"diagnosis": read_json[0], "calibration": read_json[1], "seconds": ended.seconds}


def second(seed: int, count: int, _: Path) -> Iterator[Question]:
    """Designs, causes and machines of the second exam, by chance; designs as even as can be."""
    rng = np.random.default_rng([seed, 2])
    designs = [design for design in DESIGNS if design != "again"]
    for number in range(count):
        if number % len(designs) == 0:
            rng.shuffle(designs)
        cause, machine = str(rng.choice(CAUSES)), str(rng.choice(list(MACHINES)))
        key = shop.Key(designs[number % len(designs)], cause, machine, int(rng.integers(1000)), seed)
        yield Question("shop", " ".join(map(str, key)), lambda k=key: _second(k))  # type: ignore[misc]


def _second(key: shop.Key) -> Record:
    said = shop.answer(key, timeout=TIMEOUT_S)
    if "failure" in said or "not_asked" in said:
        return {"failure": said.get("failure", said.get("not_asked"))}
    before, after = said["unseen_um"]
    outside = said["named"] if key.cause not in CAUSES[: CAUSES.index("strange")] and said["unexplained"] else 0
    outside = outside if key.cause not in ("two", "three") else 0
    return {
        "hidden": len(said["hidden"]),
        "named": said["named"] - outside,
        "tied": said["tied"],
        "unexplained": outside,
        "missed": said["missed"],
        "false": said["false"],
        "worse": said["written"] and after > before,
        "refused": not said["accepted"],
        "covered": said["covered"],
        "inside": said["inside"],
        "sizes": said["sizes"],
        "odds": said["odds"],
        "left": after if said["written"] else None,
        "seconds": said["seconds"],
    }


def third(seed: int, count: int, _: Path) -> Iterator[Question]:
    """The first questions of the third exam: all effects come early."""
    for words in list(short_measurements_exam.questions(seed))[:count]:
        case = Case(*words)
        yield Question("short", case.name, lambda c=words: _third(Case(*c)))  # type: ignore[misc]


def _third(case: Case) -> Record:
    with tempfile.TemporaryDirectory() as name:
        said = asked(case, Path(name))
    if "failure" in said:
        return {"failure": said["failure"]}
    hidden = case.effect != "none"
    verdict = said["verdict"] if hidden else ""
    verdict = "invisible" if verdict == "missed" and said["power"] < VISIBLE else verdict
    counted = {name: int(verdict == name) for name in ("named", "tied", "unexplained", "missed", "invisible")}
    worse = said["after_um"] > said["none_um"]
    return {
        "hidden": int(hidden),
        **counted,
        "false": said["false"],
        "worse": said["accepted"] and worse,
        "refused": not said["accepted"] and not worse,
        "covered": said.get("covered") if said["accepted"] else None,
        "left": said["after_um"],
        "odds": said["odds"],
        "seconds": said["seconds"],
    }


def ordinary(seed: int, count: int, folder: Path) -> Iterator[Question]:
    """Files of ordinary measurements, by chance."""
    files = sorted(folder.glob("*.truth.json"))
    for number in np.random.default_rng([seed, 3]).permutation(len(files))[:count].tolist():
        file = files[number]
        yield Question("ordinary", file.name.removesuffix(".truth.json"), lambda f=file: _ordinary(f))  # type: ignore[misc]


def _ordinary(file: Path) -> Record:
    truth = json.loads(file.read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "data.csv").write_bytes((file.parent / f"{truth['case']}.csv").read_bytes())
        said = _diagnosed(folder, truth["machine"])
    if "failure" in said:
        return said
    found, hidden = said["diagnosis"], ordinary_runs.hidden(truth)
    counts = dict.fromkeys(("named", "tied", "unexplained", "missed"), 0)
    for kind, axes in hidden:
        counts[_fate(found, kind, axes)] += 1
    right = [each for each in found["effects"] if any(_fits(each, kind, axes) for kind, axes in hidden)]
    ties = [each for each in found["effects"] if any(_fits(o, k, a) for o in each["alternatives"] for k, a in hidden)]
    false = [_named(each) for each in found["effects"] if each not in right and each not in ties]
    odds = _odds(found, false, _named)
    return {"hidden": len(hidden), **counts, "false": false, "odds": odds, "seconds": said["seconds"]}


def _named(cause: Record) -> str:
    return f"{cause['kind']} {cause.get('axis')}"


def _odds(found: Record, false: Sequence[str], words: Callable[[Record], str]) -> list[tuple[float, bool]]:
    """Of each cause the decimal logarithm of its odds, and whether it is there, or tied with one that is."""
    return [(each["log10_odds"], words(each) not in false) for each in found["effects"]]


def nothing(seed: int, count: int, _: Path) -> Iterator[Question]:
    """Data in which nothing is hidden, of all designs of the first three exams in turn, and machines by chance."""
    rng = np.random.default_rng([seed, 4])
    later = [design for design in DESIGNS if design != "again"]
    for number in range(count):
        own = int(rng.integers(10_000))
        if number % 3 == 0:
            yield Question("nothing", f"first {own}", lambda n=own: _of_first(draws.nothing(n)))  # type: ignore[misc]
        elif number % 3 == 1:
            key = shop.Key(later[number // 3 % len(later)], "none", str(rng.choice(list(MACHINES))), own, seed)
            yield Question("nothing", " ".join(map(str, key)), lambda k=key: _second(k))  # type: ignore[misc]
        else:
            designs = list(SHORT)
            machine, design = str(rng.choice(["cframe", "gantry"])), designs[number // 3 % len(designs)]
            case = Case(machine, design, "none", own)
            yield Question("nothing", case.name, lambda c=case: _third(c))  # type: ignore[misc]


def _fits(cause: Record, kind: str, axes: frozenset[str]) -> bool:
    return bool(cause["kind"] == kind and (not axes or cause.get("axis") in axes))


def _fate(found: Record, kind: str, axes: frozenset[str]) -> str:
    """What became of a hidden effect."""
    effects = found["effects"]
    if any(_fits(each, kind, axes) for each in effects):
        return "named"
    if any(_fits(other, kind, axes) for each in effects for other in each["alternatives"]):
        return "tied"
    return "unexplained" if found["unexplained"] else "missed"


EXAMS = {"first": first, "shop": second, "short": third, "ordinary": ordinary, "nothing": nothing}
HEAD = ("asked", "hidden", "named", "tied", "unexplained", "missed", "invisible", "false", "worse", "refused")
BEGIN, END = "<!-- diagnoses -->", "<!-- /diagnoses -->"
"""Marks of the table in a page."""
ODDS = (1.0, 20.0, 150.0, 1e4, 1e6, np.inf)
"""Ranges of odds; 150 is where a cause is called clear."""
OF_ODDS = ("odds", "causes", "there", "share", "expected")
FURTHER = ("covered", "lowest", "sizes", "left", "s", "slowest")


def table(records: Sequence[Record]) -> Iterator[str]:
    """A line for each exam, and for all."""
    yield f"{'exam':10}{''.join(f'{word:>12}' for word in (*HEAD, *FURTHER))}"
    for name, figures in _by_exam(records):
        yield f"{name:10}{''.join(f'{figure:>12}' for figure in figures)}"


def reliability(records: Sequence[Record]) -> Iterator[tuple[str, ...]]:
    """Of the causes in each range of odds: their number, how many are there, and their mean probability."""
    causes = np.array([cause for each in records for cause in each.get("odds", ())]).reshape(-1, 2)
    for low, high in itertools.pairwise(ODDS):
        own = causes[(causes[:, 0] >= np.log10(low)) & (causes[:, 0] < np.log10(high))]
        said = 1.0 / (1.0 + 10.0 ** -own[:, 0])
        if len(own):
            share, expected = f"{100 * own[:, 1].mean():.1f} %", f"{100 * said.mean():.1f} %"
            yield f"{low:g} to {high:g}", str(len(own)), f"{own[:, 1].sum():.0f}", share, expected


def into_page(page: Path, records: Sequence[Record]) -> None:
    """Put the tables of records into a page, between its marks."""
    by_exam = [[name, *figures] for name, figures in _by_exam(records)]
    lines = "\n\n".join((_markdown(("exam", *HEAD, *FURTHER), by_exam), _markdown(OF_ODDS, reliability(records))))
    before, rest = page.read_text(encoding="utf-8").split(BEGIN)
    page.write_text(f"{before}{BEGIN}\n\n{lines}\n\n{END}{rest.split(END)[1]}", encoding="utf-8")


def _markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of a page."""
    ruled = f"|{'---|' * len(head)}"
    first, *rest = (f"| {' | '.join(row)} |" for row in (head, *rows))
    return "\n".join((first, ruled, *rest))


def _by_exam(records: Sequence[Record]) -> Iterator[tuple[str, list[str]]]:
    """The figures of each exam that was asked, and of all."""
    for name in (*EXAMS, "all"):
        some = [each for each in records if name in (each["exam"], "all")]
        if some:
            yield name, _figures(some)


def _figures(records: Sequence[Record]) -> list[str]:
    done = [each for each in records if "failure" not in each]
    counts = [sum(int(each.get(name, 0)) for each in done) for name in HEAD[1:7]]
    false = sum(bool(each["false"]) for each in done)
    others = [sum(bool(each.get(name)) for each in done) for name in HEAD[8:]]
    failed = f" ({len(records) - len(done)} failed)" if len(done) < len(records) else ""
    inside, sizes = (sum(each.get(name, 0) for each in done) for name in ("inside", "sizes"))
    covered, left, seconds = (
        np.array([each[name] for each in done if each.get(name) is not None]) for name in ("covered", "left", "seconds")
    )
    further = ["-"] * 2 if not len(covered) else [f"{100 * covered.mean():.1f} %", f"{100 * covered.min():.0f} %"]
    further += [f"{inside}/{sizes}", f"{np.median(left):.2f}" if len(left) else "-"]
    further += [f"{np.median(seconds):.2f}", f"{np.quantile(seconds, 0.9):.1f}"] if len(seconds) else ["-"] * 2
    return [f"{len(done)}{failed}", *map(str, (*counts, false, *others)), *further]


def main() -> None:
    """Ask what is not known, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1, help="seed of the questions")
    parser.add_argument("--each", type=int, default=10, metavar="N", help="questions of each exam")
    parser.add_argument("--exams", default=",".join(EXAMS), help=", ".join(EXAMS))
    parser.add_argument("--only", default="", metavar="TEXT", help="questions whose name contains it")
    parser.add_argument("--ordinary", type=Path, default=Path("../shared/data/ordinary_runs"), metavar="FOLDER")
    parser.add_argument("--records", type=Path, default=Path("out/diagnoses.jsonl"), help="the answers")
    parser.add_argument("--table", action="store_true", help="the table of the records, asking nothing")
    parser.add_argument("--page", type=Path, metavar="FILE.md", help="page with marks, which gets the table")
    given = parser.parse_args()
    given.records.parent.mkdir(parents=True, exist_ok=True)
    known = {(each["exam"], each["name"]) for each in read(given.records)}
    for name in [] if given.table else given.exams.split(","):
        for question in EXAMS[name](given.seed, given.each, given.ordinary):
            if given.only in question.name and (question.exam, question.name) not in known:
                record = {"exam": question.exam, "name": question.name, **question.ask()}
                with given.records.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(record, default=float) + "\n")
                print(_line(record), flush=True)
    records = read(given.records)
    print("\n".join(table(records)))
    print("\n".join("".join(f"{word:>16}" for word in row) for row in (OF_ODDS, *reliability(records))))
    if given.page is not None:
        into_page(given.page, records)


def _line(record: Record) -> str:
    """A line on one record."""
    head = f"{record['exam']:9} {record['name']}"
    if "failure" in record:
        return f"{head}: FAILED {record['failure']}"
    fate = ", ".join(f"{name} {record[name]}" for name in HEAD[2:7] if record.get(name)) or "nothing"
    false = f"; FALSE {', '.join(record['false'])}" if record["false"] else ""
    covered = "" if record.get("covered") is None else f"; {100 * record['covered']:.0f} %"
    left = "" if record.get("left") is None else f"; {record['left']:.2f} um"
    worse = "; WORSE" * bool(record.get("worse")) + "; REFUSED" * bool(record.get("refused"))
    return f"{head}: {fate}{false}{covered}{left}{worse}; {record['seconds']:.1f} s"


if __name__ == "__main__":
    main()
