"""The table of the records, by design and cause."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from shop_floor.exam import Record

HEAD = (
    f"{'design':<14}{'cause':<11}{'draws':>6}{'named':>7}{'tied':>6}{'missed':>7}{'false':>7}{'worse':>7}{'harm':>6}{'accept':>8}"
    f"{'unseen um':>15}{'known':>7}{'ratio':>7}{'max':>6}{'95 %':>7}{'datum':>7}{'sizes':>9}{'s':>6}"
)
LEGEND = """\
named, tied, missed: hidden effects. false: diagnoses with an effect that is not there. worse: calibrations that were
written and predict held-out rows worse than before. harm: those that leave larger errors at unseen poses. unseen: RMS
error of unseen poses without and with the new calibration; known: the latter if effects outside every library do not
count as errors. ratio: its median, and max, relative to the same data with nothing hidden. 95 %: share of these
errors, a rigid motion apart, within their 95 % interval; datum: within that of `ncomp predict`, whose datum is
another. sizes: parameters within U (k = 2). s: mean time on the processor.\
"""
WORSE = 1.005
"""Ratio of held-out residuals from which a calibration is worse than the former one."""
Twin = tuple[str, str, int, int]


def table(records: Sequence[Record]) -> Iterator[str]:
    """Lines of the table: a row for each design and cause, each design, and all."""
    twins = {_twin(record): record for record in records if record["cause"] == "none" and "unseen_um" in record}
    yield HEAD
    designs = list(dict.fromkeys(record["design"] for record in records))
    for design in designs:
        of_design = [record for record in records if record["design"] == design]
        for cause in dict.fromkeys(record["cause"] for record in of_design):
            yield row(design, cause, [record for record in of_design if record["cause"] == cause], twins)
        yield row(design, "all", of_design, twins)
    if len(designs) > 1:
        yield row("all", "all", records, twins)


def row(design: str, cause: str, records: Sequence[Record], twins: Mapping[Twin, Record]) -> str:
    """A row of the table."""
    asked = [record for record in records if "not_asked" not in record]
    done = [record for record in asked if "failure" not in record]
    named, tied, missed, inside, sizes = (
        sum(record[key] for record in done) for key in ("named", "tied", "missed", "inside", "sizes")
    )
    cells = f"{design:<14}{cause:<11}{len(done):>6}{named:>7}{tied:>6}{missed:>7}{_count(done, 'false'):>7}"
    cells += f"{sum(map(worse, done)):>7}{sum(map(harms, done)):>6}{sum(record['accepted'] for record in done):>8}"
    before, after = (_rms(record["unseen_um"][i] for record in done) for i in (0, 1))
    ratios = [ratio for record in done if (ratio := relative(record, twins)) is not None]
    nameable = _rms(record.get("unseen_nameable_um", record["unseen_um"][1]) for record in done)
    middle, largest = (f"{np.median(ratios):.2f}", f"{max(ratios):.2f}") if ratios else ("-", "-")
    within = "".join(f"{_percent(record.get(key) for record in done):>7}" for key in ("covered", "covered_in_datum"))
    seconds = f"{np.mean([record['seconds'] for record in done]):.0f}" if done else "-"
    cells += f"{f'{before:.1f} -> {after:.1f}':>15}{nameable:>7.1f}{middle:>7}{largest:>6}{within}{f'{inside}/{sizes}':>9}{seconds:>6}"
    failed, left_out = len(asked) - len(done), len(records) - len(asked)
    return cells + (f"  {failed} failed" if failed else "") + (f"  {left_out} not asked" if left_out else "")


def line(record: Record) -> str:
    """A line on one record."""
    head = f"{record['design']} {record['cause']} {record['machine']} {record['draw']}"
    if "not_asked" in record:
        return f"{head}: not asked: {record['not_asked']}"
    hidden = ", ".join(
        f"{effect['effect']} {effect.get('axis', '')} {effect['size']:.3g} (x {times:g})"
        for effect, times in zip(record["hidden"], record["times_noise"], strict=True)
    )
    if "failure" in record:
        return f"{head} [{hidden}]: FAILED: {record['failure']}"
    marks = [f"{record['named']} named, {record['tied']} tied, {record['missed']} missed"] if hidden else []
    marks += [f"FALSE {'; '.join(record['false'])}"] if record["false"] else []
    marks += ["WORSE"] if worse(record) else []
    marks += ["HARM"] if harms(record) else []
    marks += [] if record["accepted"] else [f"not accepted ({record['reason']})"]
    before, after = record["unseen_um"]
    without = record.get("unseen_nameable_um", after)
    apart = "" if without == after else f" ({without:.1f} if the effect without a name does not count)"
    covered = "" if record["covered"] is None else f", {100 * record['covered']:.0f} % covered"
    found = "; ".join(record["found"]) or "nothing"
    left = f"; unexplained {' '.join(record['unexplained'])}" if record["unexplained"] else ""
    return (
        f"{head} [{hidden or 'nothing hidden'}]: {', '.join(marks) or 'right'} | found {found}{left} | "
        f"unseen {before:.1f} -> {after:.1f} um{apart}{covered} | {record['seconds']:.0f} s"
    )


def false_causes(records: Sequence[Record]) -> Iterator[str]:
    """Which effects were blamed, how often, with which cause hidden."""
    counted: Counter[str] = Counter()
    where: dict[str, Counter[str]] = {}
    for record in records:
        for blamed in record.get("false", ()):
            kind = " ".join(part for part in blamed.split() if len(part) > 1)
            counted[kind] += 1
            where.setdefault(kind, Counter())[f"{record['design']} {record['cause']}"] += 1
    for kind, count in counted.most_common():
        yield f"{count:>4} {kind}: {', '.join(f'{name} {n}' for name, n in where[kind].most_common(6))}"


def worse(record: Record) -> bool:
    """True if a written calibration predicts held-out rows worse than the former one."""
    before, after = record["heldout_um"]
    return bool(record["written"] and before is not None and after is not None and after > WORSE * before)


def harms(record: Record) -> bool:
    """True if a written calibration leaves larger errors at unseen poses than the former one, or none."""
    before, after = record["unseen_um"]
    return bool(record["written"] and after > before)


def relative(record: Record, twins: Mapping[Twin, Record]) -> float | None:
    """The error at unseen poses relative to that of the same data with nothing hidden."""
    twin = twins.get(_twin(record))
    return None if twin is None else float(record["unseen_um"][1] / twin["unseen_um"][1])


def _twin(record: Record) -> Twin:
    return record["design"], record["machine"], record["draw"], record["seed"]


def _count(records: Iterable[Record], key: str) -> int:
    return sum(bool(record[key]) for record in records)


def _percent(shares: Iterable[float | None]) -> str:
    known = [share for share in shares if share is not None]
    return f"{100 * np.mean(known):.1f}" if known else "-"


def _rms(values: Iterable[float]) -> float:
    found = np.array(list(values))
    return float(np.sqrt(np.mean(found**2))) if len(found) else float("nan")
