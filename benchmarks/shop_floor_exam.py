"""The second exam of `ncomp diagnose`: measurements as shops take them, with effects that no file declares.

    python benchmarks/shop_floor_exam.py --draws 20 --designs lines,serpentine --causes none,backlash,drift --jobs 2
    python benchmarks/shop_floor_exam.py --designs all --causes all --draws 2 --sample 150  # a part, by chance
    python benchmarks/shop_floor_exam.py --designs all --causes all --machines all --each 20  # 20 of each design
    python benchmarks/shop_floor_exam.py --resume          # goes on where an interrupted exam ended
    python benchmarks/shop_floor_exam.py --table           # the table of what is recorded; asks nothing

The data come from tests/shop_floor, which shares nothing with ncomp or with the first exam. Every question with a
hidden effect is compared with the same data with nothing hidden, which are asked as well (cause `none`). Each answer
is appended to a file of records, a JSON line each.
"""

from __future__ import annotations

import argparse
import json
import random
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from shop_floor import summary
from shop_floor.chain import MACHINES
from shop_floor.designs import DESIGNS
from shop_floor.exam import Key, Record, answer, key_of, read_records
from shop_floor.question import CAUSES

FIRST_DESIGNS = ("lines", "serpentine", "random3", "bad-repeat")
FIRST_CAUSES = ("none", "backlash", "drift", "scale", "cross", "shift", "angle", "outliers", "strange", "two")


def arguments() -> argparse.Namespace:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=1, metavar="N", help="draws of each design, cause and machine")
    parser.add_argument("--first", type=int, default=0, metavar="N", help="first draw")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--designs", type=_listed(DESIGNS), default=list(FIRST_DESIGNS), help=",".join(DESIGNS))
    parser.add_argument("--causes", type=_listed(CAUSES), default=list(FIRST_CAUSES), help=",".join(CAUSES))
    parser.add_argument("--machines", type=_listed(MACHINES), default=["gantry", "cframe"], help=",".join(MACHINES))
    part = parser.add_mutually_exclusive_group()
    part.add_argument("--sample", type=int, metavar="N", help="N questions with an effect, chosen at random")
    part.add_argument("--each", type=int, metavar="N", help="N of each design; causes and machines as even as can be")
    parser.add_argument("--jobs", type=int, default=1, metavar="J", help="diagnoses at once")
    parser.add_argument("--timeout", type=float, default=1800.0, metavar="S", help="of a command, s")
    parser.add_argument("--records", type=Path, default=Path("out/shop_floor_exam.jsonl"), help="file of the answers")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="folder for the files of every question")
    parser.add_argument("--option", action="append", default=[], metavar="WORD", help="passed on to ncomp diagnose")
    parser.add_argument("--only-rows", action="store_true", help="the table only, without a line for each question")
    mode = parser.add_mutually_exclusive_group()
    mode.add_argument("--resume", action="store_true", help="questions that are in the file are not asked again")
    mode.add_argument("--table", action="store_true", help="the table of the file, asking nothing")
    return parser.parse_args()


def _listed(names: Iterable[str]) -> Callable[[str], list[str]]:
    """A parser of names separated by commas, each one of those given; `all` is every one."""
    known = list(names)

    def parse(text: str) -> list[str]:
        wanted = known if text == "all" else text.split(",")
        for name in wanted:
            if name not in known:
                raise argparse.ArgumentTypeError(f"{name!r} is none of {', '.join(known)}")
        return wanted

    return parse


def questions(args: argparse.Namespace) -> list[Key]:
    """The keys of all questions, draw by draw, so that an interrupted exam has all designs and causes.

    Those of a sample are in the order in which chance chose them.
    """
    if args.each is not None:
        return _with_nothing_hidden(_even(args))
    causes = list(dict.fromkeys(["none", *args.causes]))
    keys = [
        Key(design, cause, machine, draw, args.seed)
        for draw in range(args.first, args.first + args.draws)
        for design in args.designs
        for machine in args.machines
        for cause in causes
    ]
    if args.sample is None:
        return keys
    hidden = [key for key in keys if key.cause != "none"]
    return _with_nothing_hidden(random.Random(args.seed).sample(hidden, min(args.sample, len(hidden))))


def _even(args: argparse.Namespace) -> Iterator[Key]:
    """`--each` questions of each design, design by design in turn; the data of a machine's draw serve three causes."""
    causes = [cause for cause in args.causes if cause != "none"]
    if not causes:
        sys.exit("--each chooses among effects: --causes must name one besides none")
    chance, machines = random.Random(args.seed), args.machines
    orders = {design: chance.sample(causes, len(causes)) for design in args.designs}
    for turn in range(args.each):
        draw = args.first + turn // (3 * len(machines))
        for place, (design, order) in enumerate(orders.items(), turn):
            yield Key(design, order[turn % len(order)], machines[place % len(machines)], draw, args.seed)


def _with_nothing_hidden(keys: Iterable[Key]) -> list[Key]:
    """Each question once, behind that of the same data with nothing hidden."""
    return list(dict.fromkeys(each for key in keys for each in (key._replace(cause="none"), key)))


def put(args: argparse.Namespace, known: list[Record]) -> list[Record]:
    """Ask what is not known yet; every answer is written down at once."""
    done = {key_of(record) for record in known}
    keys = [key for key in questions(args) if key not in done]
    args.records.parent.mkdir(parents=True, exist_ok=True)
    ask = partial(answer, timeout=args.timeout, options=args.option, keep=args.keep)
    found = list(known)
    with ThreadPoolExecutor(args.jobs) as pool, args.records.open("a", encoding="utf-8") as file:
        futures = [pool.submit(ask, key) for key in keys]
        try:
            for future in as_completed(futures):
                record = future.result()
                found.append(record)
                file.write(json.dumps(record) + "\n")
                file.flush()
                if not args.only_rows:
                    print(summary.line(record), flush=True)
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    return found


def show(records: list[Record], *, only_rows: bool) -> None:
    """The table in the order of designs and causes, and what was blamed or failed."""
    designs, causes = list(DESIGNS), list(CAUSES)

    def order(record: Record) -> tuple[int, int, str, int]:
        return designs.index(record["design"]), causes.index(record["cause"]), record["machine"], record["draw"]

    records = sorted(records, key=order)
    print(*summary.table(records), sep="\n")
    if only_rows:
        return
    print(summary.LEGEND)
    for heading, lines in (
        ("False causes:", list(summary.false_causes(records))),
        ("Failures:", [summary.line(record) for record in records if "failure" in record]),
    ):
        if lines:
            print(heading, *lines, sep="\n")


def main() -> None:
    """The requested part of the exam."""
    args = arguments()
    exists = args.records.exists()
    if exists and not (args.resume or args.table):
        sys.exit(
            f"{args.records} exists: --resume goes on with it, --table shows it, --records NAME begins another one"
        )
    known = read_records(args.records) if exists else []
    show(known if args.table else put(args, known), only_rows=args.only_rows)


if __name__ == "__main__":
    main()
