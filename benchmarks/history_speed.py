"""Time of `add`, of a trend and of the page of one machine, in a history of many: in SQLite, or PostgreSQL by a URL.

    python benchmarks/history_speed.py --machines 1000 --db /tmp/plant.sqlite

Each machine has ten years: 19 figures of a calibration each quarter, 6 of a ballbar each month, 4 of spheres each week.
"""

from __future__ import annotations

import argparse
import datetime
import resource
import time
from collections.abc import Iterator

import numpy as np
from sqlalchemy import insert, text
from sqlalchemy.orm import Session

from history.database import opened
from history.entries import Quantity, Result, enter, entries_of, lives, machine_named, utc
from history.reports import show_report
from history.schema import Entry, FigureRow, MachineRow
from history.trends.report import moment_now
from history.trends.series import series_of
from history.trends.trend import trends_of
from kinematics.error_model.priors import PRIORS
from machines import load
from rendering.page import page

YEARS = 10
METHODS = {"laser-tracker": (4, 19, "calibration"), "ballbar": (12, 6, "iso230-4"), "touch-probe": (52, 4, "check")}
"""Results a year, figures of each, and kind, by method."""
BEGIN = datetime.datetime(2016, 1, 1, tzinfo=datetime.UTC)


def fill(session: Session, machines: int) -> int:
    """Fill an empty history; returns the number of its figures."""
    rng, mill, count = np.random.default_rng(1), load("dmu50"), 0
    for number in range(1, machines + 1):
        row = {"id": number, "name": f"mill-{number}", "chain": mill.chain, "chain_hash": mill.chain_hash}
        session.execute(insert(MachineRow), [row])
        made = [(at, *METHODS[method], method) for method in METHODS for at in _dates(METHODS[method][0])]
        first = (number - 1) * len(made) + 1
        common = {"machine_id": number, "made_by": "benchmark", "document": None, "fingerprint": ""}
        entries = [
            {"id": first + n, "kind": kind, "at": utc(at), "entered_at": utc(at), "title": f"{n}", "method": method}
            for n, (at, _, _, kind, method) in enumerate(made)
        ]
        session.execute(insert(Entry), [each | common for each in entries])
        figures = [
            {
                "entry_id": first + n,
                "name": f"quantity {k}",
                "unit": "um",
                "value": float(rng.normal(0.0, 2.0)),
                "u": 1.5,
            }
            for n, (_, _, own, _, _) in enumerate(made)
            for k in range(own)
        ]
        session.execute(insert(FigureRow), figures)
        count += len(figures)
    return count


def _dates(a_year: int) -> Iterator[datetime.datetime]:
    return (BEGIN + datetime.timedelta(days=365.25 * n / a_year, hours=a_year) for n in range(YEARS * a_year))


def timed(name: str, start: float) -> None:
    """Print the time since the start, and the largest memory so far."""
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    print(f"{name}: {time.perf_counter() - start:.3f} s, at most {memory:.0f} MB", flush=True)


def main() -> None:
    """Fill the history, and measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--machines", type=int, default=1000)
    parser.add_argument("--db", required=True)
    given = parser.parse_args()
    start = time.perf_counter()
    with opened(given.db, writes=True) as session:
        print(f"{fill(session, given.machines)} figures")
    with opened(given.db, writes=True) as session:
        session.execute(text("ANALYZE"))
        if session.get_bind().dialect.name == "postgresql":
            for table in ("machine", "entry", "figure", "file"):
                row = text(f"SELECT setval(pg_get_serial_sequence('{table}', 'id'), (SELECT max(id) + 1 FROM {table}))")
                session.execute(row)
    timed("fill", start)
    start = time.perf_counter()
    figures = [Quantity(f"quantity {k}", "um", 0.0, 1.0) for k in range(19)]
    result = Result(kind="check", at=BEGIN, title="one more", method="check", figures=figures)
    with opened(given.db, writes=True) as session:
        enter(session, load("dmu50"), result)
    timed("add", start)
    start = time.perf_counter()
    with opened(given.db, writes=False) as session:
        lives(session)
    timed("list of the machines", start)
    start = time.perf_counter()
    with opened(given.db, writes=False) as session:
        entries = entries_of(session, machine_named(session, f"mill-{given.machines}"))
        timed("entries of a machine", start)
        series = series_of(entries)
        start = time.perf_counter()
        trends_of(series[-1:], PRIORS, moment_now(), {})
        timed(f"trend of {len(series[-1].times)} results", start)
        start = time.perf_counter()
        trends_of(series[:1], PRIORS, moment_now(), {})
        timed(f"trend of {len(series[0].times)} results", start)
        start = time.perf_counter()
        trends, short = trends_of(series, PRIORS, moment_now(), {})
        page(show_report(entries, "mill", given.db, trends, short), lambda _: None)
        timed(f"page of {len(trends)} trends", start)


if __name__ == "__main__":
    main()
