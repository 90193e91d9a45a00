"""Slow tests in parts: a quick one in the default tiers, more in the statistical tier, repetitions among the exams."""

import inspect
from collections.abc import Callable, Hashable, Iterable
from itertools import combinations, product
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis.strategies import SearchStrategy

STATISTICAL = pytest.mark.statistical
EXAM = pytest.mark.exam
"""Mark of repetitions, which are run before a release."""


def drawn(
    few: int,
    many: int,
    most: int | None = None,
    also: dict[str, Any] | None = None,
    **strategies: SearchStrategy[Any],
) -> Callable[[Callable[..., None]], Any]:
    """A property of hypothesis with few examples in the default tiers and with many in the statistical tier.

    `most`: with so many as an exam. `also`: an example beside them in all.
    """

    def decorate(holds: Callable[..., None]) -> Any:
        def test(examples: int, **fixtures: Any) -> None:
            def of_example(**values: Any) -> None:
                holds(**fixtures, **values)

            of_example.__name__ = holds.__name__
            each = settings(max_examples=examples)(given(**strategies)(of_example))
            (example(**also)(each) if also else each)()

        signature = inspect.signature(holds)
        own = [value for name, value in signature.parameters.items() if name not in strategies]
        counted = inspect.Parameter("examples", inspect.Parameter.POSITIONAL_OR_KEYWORD)
        test.__signature__ = signature.replace(parameters=[counted, *own])  # type: ignore[attr-defined]
        test.__name__, test.__doc__, test.__module__ = holds.__name__, holds.__doc__, holds.__module__
        test.holds = holds  # type: ignore[attr-defined]
        exams = [] if most is None else [pytest.param(most, marks=EXAM)]
        return pytest.mark.parametrize("examples", [few, pytest.param(many, marks=STATISTICAL), *exams])(test)

    return decorate


def first_of_each(values: Iterable[Any], kind: Callable[[Any], Hashable]) -> list[Any]:
    """The first value of each kind."""
    return list({kind(value): value for value in reversed(list(values))}.values())


def one_of_each(values: Iterable[Any], kind: Callable[[Any], Hashable]) -> list[Any]:
    """Parameters of a test: the first value of each kind in the default tiers, the others in the statistical tier."""
    values = list(values)
    return quick(values, first_of_each(values, kind))


def quick(values: Iterable[Any], few: Iterable[Any], some: Iterable[Any] | None = None) -> list[Any]:
    """Parameters of a test (tuples: several): a few in the default tiers, the others in the statistical tier.

    `some`: those of the statistical tier, beside which the others are exams.
    """
    values, default = list(values), list(few)
    statistical = values if some is None else list(some)
    assert all(value in values for value in [*default, *statistical])
    return [
        pytest.param(
            *(value if isinstance(value, tuple) else (value,)),
            marks=[] if value in default else [STATISTICAL if value in statistical else EXAM],
        )
        for value in values
    ]


def all_pairs(*columns: Iterable[Hashable]) -> list[tuple[Any, ...]]:
    """Rows of a crossed table, few, in which every two values of two columns meet.

    Each next row is the one with the most new pairs, the first of them in the order of the table.
    """
    table = list(product(*columns))
    places = list(combinations(range(len(table[0])), 2))
    pairs = {row: {(i, j, row[i], row[j]) for i, j in places} for row in table}
    open_pairs = set[tuple[Any, ...]]().union(*pairs.values())
    rows: list[tuple[Any, ...]] = []
    while open_pairs:
        rows.append(max(table, key=lambda row: len(pairs[row] & open_pairs)))
        open_pairs -= pairs[rows[-1]]
    return rows


def each_once(first: Iterable[Any], second: Iterable[Any]) -> list[tuple[Any, Any]]:
    """Pairs of a crossed table, few, in which every value of both columns stands; in a circle for the shorter one."""
    columns = list(first), list(second)
    count = max(map(len, columns))
    return [(columns[0][i % len(columns[0])], columns[1][i % len(columns[1])]) for i in range(count)]
