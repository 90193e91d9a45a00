"""Slow tests in two parts: a quick one in the default tiers, and the whole in the statistical tier."""

import inspect
from collections.abc import Callable, Hashable, Iterable
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis.strategies import SearchStrategy

STATISTICAL = pytest.mark.statistical


def drawn(
    few: int, many: int, also: dict[str, Any] | None = None, **strategies: SearchStrategy[Any]
) -> Callable[[Callable[..., None]], Any]:
    """A property of hypothesis with few examples in the default tiers and with many in the statistical tier.

    `also`: an example beside them in both.
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
        return pytest.mark.parametrize("examples", [few, pytest.param(many, marks=STATISTICAL)])(test)

    return decorate


def one_of_each(values: Iterable[Any], kind: Callable[[Any], Hashable]) -> list[Any]:
    """Parameters of a test: the first value of each kind in the default tiers, the others in the statistical tier."""
    seen: set[Hashable] = set()
    parameters = []
    for value in values:
        parameters.append(pytest.param(value, marks=[STATISTICAL] if kind(value) in seen else []))
        seen.add(kind(value))
    return parameters


def quick(values: Iterable[Any], few: Iterable[Any]) -> list[Any]:
    """Parameters of a test (tuples: several): a few in the default tiers, the others in the statistical tier."""
    values, default = list(values), list(few)
    assert all(value in values for value in default)
    return [
        pytest.param(
            *(value if isinstance(value, tuple) else (value,)), marks=[] if value in default else [STATISTICAL]
        )
        for value in values
    ]
