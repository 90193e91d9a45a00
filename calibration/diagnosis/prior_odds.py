"""Odds of terms before the data: those of their kind, shared by its families, and by the members of a family."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import replace

import numpy as np

from calibration.diagnosis.contract import is_rare
from calibration.gaussian_terms.term import Term
from kinematics.error_model.priors import Priors


def odds_of_kind(term: Term, priors: Priors) -> float:
    """Odds of the kind of a term, if all terms of its kind were as common as this one."""
    if term.named:
        rare = any(map(is_rare, term.effects))
        probability = priors.rare if rare else priors.common
    else:
        probability = float(getattr(priors, term.kind))
    return probability / (1.0 - probability)


def with_prior_odds(terms: Sequence[Term], priors: Priors) -> list[Term]:
    """The terms with their prior odds, those of their finer members included.

    The odds of a kind are those of its commonest term. Its families share them, and the members of a family share those
    of the family: rare ones have a smaller part.
    """
    odds = np.array([odds_of_kind(term, priors) for term in terms])
    families: dict[Hashable, list[int]] = {}
    for number, term in enumerate(terms):
        families.setdefault(term.family, []).append(number)
    commonest = {family: max(numbers, key=odds.__getitem__) for family, numbers in families.items()}
    kinds: dict[str, list[float]] = {}
    for number in commonest.values():
        kinds.setdefault(terms[number].kind, []).append(odds[number])
    found: dict[int, Term] = {}
    for family, numbers in families.items():
        best = commonest[family]
        of_kind = kinds[terms[best].kind]
        of_family = odds[best] * max(of_kind) / sum(of_kind)
        own = np.log(of_family * odds[numbers] / odds[numbers].sum()).tolist()
        found.update((number, with_log_prior(terms[number], log)) for number, log in zip(numbers, own, strict=True))
    return [found[number] for number in range(len(terms))]


def with_log_prior(term: Term, log_prior: float) -> Term:
    """The term with a logarithm of its odds, which its finer members have too: they are at its place in the family."""
    finer = term.finer
    if finer is None:
        return replace(term, log_prior=log_prior)
    return replace(term, log_prior=log_prior, finer=lambda: [with_log_prior(each, log_prior) for each in finer()])
