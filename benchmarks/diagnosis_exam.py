"""The exam of `ncomp diagnose`, on data of the tests' own virtual machine (tests/virtual_machine).

    python benchmarks/diagnosis_exam.py [--kind backlash ...] [--machine gantry ...] [--seeds 20]
    python benchmarks/diagnosis_exam.py --nothing 200
    python benchmarks/diagnosis_exam.py --laser | --pairs | --ties | --range | --unknown | --table1  [--seeds 20]

For every kind of cause and machine: in how many of the draws the cause was named with its axis, in how many of those
another effect was named as well, how many of its parameters lay within k = 2 of the true values, and the held-out RMS
after the diagnosis against that of the same data, noise and all, with nothing wrong. `--verbose` adds a line for each
draw.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from virtual_machine import draws, exam
from virtual_machine.exam import Result

AT_ONCE = 2
HELD_OUT = 1.05
"""Bar of the ratio of held-out RMS to that of the same data with nothing wrong."""
Say = Callable[[str], None]


def attempt(question: Callable[[int], Result], seed: int) -> Result | str:
    """The result, or the reason of a failure."""
    try:
        return question(seed)
    except RuntimeError as fault:
        return str(fault)


def causes(kinds: Sequence[str], machine: str, seed: int, *, with_twin: bool) -> Result:
    """One question with these causes."""
    return exam.ask(draws.draw(kinds, machine, seed), with_twin=with_twin)


def laser_question(kind: str, machine: str, seed: int) -> Result:
    """One question to an interferometer's data."""
    return exam.ask(draws.by_laser(kind, machine, seed), with_twin=True)


def report(title: str, results: Iterable[Result | str], say: Say) -> None:
    """One line of the table."""
    found = list(results)
    done = [result for result in found if isinstance(result, Result)]
    for result in found:
        say(f"    {result if isinstance(result, str) else told(result)}")
    named = sum(all(r.score.named) for r in done)
    tied = sum(r.score.tied for r in done)
    alone = sum(not r.score.blamed for r in done)
    inside, of = sum(r.score.inside for r in done), sum(r.score.of for r in done)
    ratios = np.array([r.heldout for r in done if np.isfinite(r.heldout)])
    held = f"{np.median(ratios):.3f} ({np.mean(ratios <= HELD_OUT):4.0%} <= {HELD_OUT})" if len(ratios) else "-"
    sizes = f"{inside}/{of}" if of else "-"
    seconds = np.mean([r.seconds for r in done]) if done else np.nan
    failed = len(found) - len(done)
    print(
        f"{title:<36}{named:>4}/{len(found):<4}{tied:>4}{alone:>6}{sizes:>10}  {held:<24}{seconds:>6.1f}"
        f"{f'   {failed} failed' if failed else ''}",
        flush=True,
    )


def told(result: Result) -> str:
    """A line on one draw."""
    sizes = ", ".join(f"{times:.1f}" for times in result.times)
    right = "named" if all(result.score.named) else "tied " if result.score.tied else "MISSED"
    blamed = f"; BLAMED {', '.join(result.score.blamed)}" if result.score.blamed else ""
    inside = f"{result.score.inside}/{result.score.of} inside"
    return (
        f"{result.name} (x {sizes}): {right} {inside}, held out {result.heldout:.3f}: {'; '.join(result.found)}{blamed}"
    )


def single(args: argparse.Namespace, pool: ThreadPoolExecutor, say: Say) -> None:
    """Every kind on every machine."""
    head()
    for kind in args.kind or draws.KINDS:
        for machine in args.machine:
            question = partial(causes, [kind], machine, with_twin=True)
            report(f"{kind} {machine}", pool.map(partial(attempt, question), args.seeds), say)


def by_laser(args: argparse.Namespace, pool: ThreadPoolExecutor, say: Say) -> None:
    """Measurement of one axis by an interferometer."""
    head()
    for kind in draws.BY_LASER:
        for machine in args.machine:
            question = partial(laser_question, kind, machine)
            report(f"laser {kind} {machine}", pool.map(partial(attempt, question), args.seeds), say)


def pairs(args: argparse.Namespace, pool: ThreadPoolExecutor, say: Say) -> None:
    """Two causes at once."""
    head()
    for kinds in draws.PAIRS:
        for machine in args.machine:
            question = partial(causes, kinds, machine, with_twin=False)
            report(f"{'+'.join(kinds)} {machine}", pool.map(partial(attempt, question), args.seeds), say)


def nothing(args: argparse.Namespace, pool: ThreadPoolExecutor, say: Say) -> None:
    """Nothing wrong: the share of draws with any effect."""
    results = list(pool.map(partial(attempt, lambda seed: exam.ask(draws.nothing(seed))), range(args.nothing)))
    for result in results:
        say(f"    {result if isinstance(result, str) else told(result)}")
    false = [r for r in results if isinstance(r, str) or r.score.blamed]
    print(f"nothing wrong: {len(false)} of {len(results)} draws with an effect ({len(false) / len(results):.1%})")
    for result in false:
        print(f"    {result if isinstance(result, str) else told(result)}")


def yes_or_no(
    title: str, machines: Sequence[str], args: argparse.Namespace, judge: Callable[[str, int], tuple[bool, str]]
) -> None:
    """A question that is answered right or not."""
    for machine in machines:
        answers = []
        for seed in args.seeds:
            try:
                right, said = judge(machine, seed)
            except RuntimeError as fault:
                right, said = False, str(fault)
            answers.append(right)
            if args.verbose or not right:
                print(f"    {machine} {seed}: {'right' if right else 'WRONG'}: {said}")
        print(f"{title:<44}{machine:<8}{sum(answers):>4}/{len(answers)}", flush=True)


def ties(args: argparse.Namespace) -> None:
    """Causes that the design does not separate; on machines with three axes."""
    for title, draw, kinds in (
        ("growth in Z ~ tracker translation: tied", draws.tied_growth, ("thermal-drift", "tracker-drift")),
        ("backlash ~ settling: tied", draws.tied_backlash, ("backlash", "settling")),
    ):
        machines = [machine for machine in args.machine if machine != "dmu50"]
        yes_or_no(title, machines, args, lambda m, seed, draw=draw, kinds=kinds: exam.tied(draw(m, seed), kinds))  # type: ignore[misc]


def table_1(args: argparse.Namespace, pool: ThreadPoolExecutor) -> None:
    """The gantry of the virtual calibration paper."""

    def question(seed: int) -> tuple[bool, float, float] | str:
        try:
            return exam.volumetric(draws.of_table_1(seed))
        except RuntimeError as fault:
            return str(fault)

    done = []
    for seed, result in zip(args.seeds, pool.map(question, args.seeds), strict=True):
        if isinstance(result, str):
            print(f"    table 1 {seed}: {result}")
            continue
        named, before, after = result
        done.append(result)
        print(
            f"    table 1 {seed}: higher frequency {'named' if named else 'MISSED'}, "
            f"volumetric error {before:.1f} -> {after:.1f} um",
            flush=True,
        )
    if done:
        right, befores, afters = np.array(done, float).T
        print(
            f"table 1: higher frequency named in {right.sum():.0f}/{len(args.seeds)}; volumetric error "
            f"{befores.mean():.1f} -> {afters.mean():.1f} um (95 %: {np.quantile(afters, 0.95):.1f})"
        )


def head() -> None:
    """Kinds of the table."""
    print(f"{'cause':<36}{'named':>7}{'tied':>6}{'alone':>6}{'sizes':>10}  {'held out, ratio':<24}{'s':>6}")


def arguments() -> argparse.Namespace:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kind", nargs="+", choices=list(draws.KINDS))
    parser.add_argument("--machine", nargs="+", choices=draws.MACHINES, default=list(draws.MACHINES))
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--verbose", action="store_true")
    mode = parser.add_mutually_exclusive_group()
    mode.add_argument("--nothing", type=int, metavar="N")
    for name in ("laser", "pairs", "ties", "range", "unknown", "table1"):
        mode.add_argument(f"--{name}", action="store_true")
    args = parser.parse_args()
    args.seeds = range(args.first, args.first + args.seeds)
    return args


def main() -> None:
    """The requested part of the exam."""
    args = arguments()
    say: Say = print if args.verbose else lambda _: None
    with ThreadPoolExecutor(AT_ONCE) as pool:
        if args.nothing:
            nothing(args, pool, say)
        elif args.laser:
            by_laser(args, pool, say)
        elif args.pairs:
            pairs(args, pool, say)
        elif args.ties:
            ties(args)
        elif args.range:
            judge = lambda m, s: exam.not_visible(draws.range_of_one_station(m, s), "tracker-range")  # noqa: E731
            yes_or_no("range offset, one station: not visible", args.machine, args, judge)
        elif args.unknown:
            judge = lambda m, s: exam.unexplained(draws.unknown(m, s), {"X", "Z", "time"})  # noqa: E731
            yes_or_no("outside the table: X, Z and time", args.machine, args, judge)
        elif args.table1:
            table_1(args, pool)
        else:
            single(args, pool, say)


if __name__ == "__main__":
    main()
