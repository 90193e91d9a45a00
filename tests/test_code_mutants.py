"""The faults that are put into the code on purpose: each changes the code, and a sign that a test sees is noticed."""

import ast

import pytest

from tests.code_mutants.argued import ARGUED
from tests.code_mutants.modules import MODULES, TESTS, files, modules_of_tests
from tests.code_mutants.operators import Mutant, mutants_of, tree_of
from tests.code_mutants.runner import ROOT

CODE = '''"""A - B"""
UNIT = 1000
def f(x, y: int = -1):
    """x - y"""
    if x < 0 and not y:
        raise ValueError(f"{x - 1}")
    return (x - y[0]) / 60, max(x, "X")
'''


@pytest.fixture
def mutants(tmp_path) -> list[Mutant]:
    """The faults of a small module."""
    (tmp_path / "code.py").write_text(CODE)
    return mutants_of(tmp_path, "code.py")


def test_kinds_of_faults(mutants):
    found = {(each.kind, each.before, each.after) for each in mutants}
    assert found == {
        ("unit", "1000", "10000"),
        ("sign", "-1", "+1"),
        ("number", "1", "2"),
        ("logic", "x < 0 and (not y)", "x < 0 or not y"),
        ("order", "x < 0", "x > 0"),
        ("number", "0", "1"),
        ("logic", "not y", "not not y"),
        ("unit", "(x - y[0]) / 60", "(x - y[0]) * 60"),
        ("sign", "x - y[0]", "x + y[0]"),
        ("index", "y[0]", "y[1]"),
        ("unit", "60", "600"),
        ("function", "max(x, 'X')", "min(x, 'X')"),
        ("letter", "'X'", "'Y'"),
    }


def test_each_fault_is_the_one_of_its_number(mutants, tmp_path):
    texts = {ast.unparse(tree_of(tmp_path, each)) for each in mutants}
    assert len(texts) == len(mutants)
    assert ast.unparse(ast.parse(CODE)) not in texts


def test_all_modules_and_tests_are_there():
    assert all(files(area) for area in MODULES)
    assert len(modules_of_tests()) == len(TESTS.split())


def test_an_argued_fault_is_still_in_the_code():
    known = {each.key for file in {key[0] for key in ARGUED} for each in mutants_of(ROOT, file)}
    assert not [key for key in ARGUED if key not in known]
