"""Statements of conformity: a result with its uncertainty against a limit, by a named decision rule.

| rule | pass | fail | between |
|---|---|---|---|
| simple acceptance (JCGM 106:2012, 8.2) | the size is at most the limit | otherwise | - |
| guard band U, k = 2 (ISO 14253-1, ILAC-G8:09/2019, 4.2.3) | size + U at most the limit | size - U above it | neither
conformity nor nonconformity is proved: *conditional* |
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

from history.certificate.details import Head, Rule
from history.entries import Quantity
from history.trends.limits import limits_of

Outcome = Literal["pass", "conditionalPass", "conditionalFail", "fail"]
"""Words of the schema of certificates."""
NORMS: dict[Rule, tuple[str, ...]] = {
    "simple acceptance": ("JCGM 106:2012, 8.2",),
    "guard band": ("ISO 14253-1", "ILAC-G8:09/2019, 4.2.3"),
}
"""Where each rule stands."""
RULES: dict[Rule, str] = {
    "simple acceptance": "Decision rule: simple acceptance. A result passes if its size is at most the limit; its "
    "uncertainty does not count, so that up to half of the results at the limit are judged wrongly.",
    "guard band": "Decision rule: guard band of U (k=2) on each side of the limit. A result passes if its size and U "
    "together are at most the limit, and fails if its size less U is above it; between, neither conformity nor "
    "nonconformity is proved (conditional).",
}
"""What each rule means."""
SHOWN: dict[Outcome, str] = {
    "pass": "conforms", "fail": "does not conform",
    "conditionalPass": "within the limit, conformity not proved",
    "conditionalFail": "beyond the limit, nonconformity not proved",
}  # fmt: skip
"""The outcomes for people."""


class Statement(NamedTuple):
    """A statement on one result."""

    figure: Quantity
    limit: float
    """In the unit of the result, for its size in either direction."""
    rule: Rule

    @property
    def outcome(self) -> Outcome:
        """The statement, by the size of the result and its expanded uncertainty (k = 2)."""
        size, U = abs(self.figure.value), 2.0 * self.figure.u
        if self.rule == "simple acceptance":
            return "pass" if size <= self.limit else "fail"
        if size <= self.limit:
            return "pass" if size + U <= self.limit else "conditionalPass"
        return "fail" if size - U > self.limit else "conditionalFail"


def statements(head: Head, figures: Sequence[Quantity]) -> list[Statement]:
    """The statements that a certificate asks for; UserError for a limit of no result."""
    if (rule := head.decision_rule) is None:
        return []
    units = {each.name: each.unit for each in figures}
    limits = limits_of(head.limits, units, "certificate.limits", "the certificate")
    return [Statement(each, limits[each.name], rule) for each in figures if each.name in limits]


def answer_of(head: Head, figures: Sequence[Quantity], stated: Sequence[Statement]) -> dict[str, Any]:
    """The results and the statements for programs."""
    return {
        "identifier": head.identifier,
        "figures": [{"name": n, "unit": unit, "value": value, "U": 2.0 * u} for n, unit, value, u in figures],
        "decision_rule": head.decision_rule,
        "conformity": [
            {"name": each.figure.name, "limit": each.limit, "unit": each.figure.unit, "statement": each.outcome}
            for each in stated
        ],
    }
