"""A fact of an effect or of an instrument stands on its class: other rooms ask for the fact, not for the class.

Each test of the class in another room is a place that a new effect or instrument may have to touch. The tables have
those of today; they can only shrink.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

from calibration.instruments import InstrumentBase
from kinematics.effects import EffectBase

ROOT = Path(__file__).parents[1]
ROOMS = ("calibration", "history", "kinematics", "postproc", "rendering")
TESTS_OF_CLASSES = {
    # the lists of a model by class, which other rooms use
    "kinematics/error_model/model.py": 2,
    "calibration/fit/written/merged.py": 4,
    # products of error motions, and their turn about another point
    "calibration/fit/datum.py": 1,
    "calibration/observation/mean_lines.py": 2,
    "calibration/observation/products.py": 1,
    # facts that are not on the classes yet
    "calibration/gaussian_terms/given/larger_range.py": 1,
}
"""Number of tests by file. Add none: put a fact on the class, as those of `kinematics/effects/base.py`."""


TESTS_OF_INSTRUMENTS: dict[str, int] = {}
"""Number of tests of the class of an instrument by file. Add none: put a fact on `calibration/instruments/base.py`."""


def below(base: type) -> Iterator[type]:
    """All classes below a base."""
    for each in base.__subclasses__():
        yield each
        yield from below(each)


def classes_of(base: type, room: str) -> set[str]:
    """The names of a base and of the classes below it in a room."""
    return {each.__name__ for each in (base, *below(base)) if each.__module__.startswith(room)}


EFFECTS = classes_of(EffectBase, "kinematics.effects")
INSTRUMENTS = classes_of(InstrumentBase, "calibration.instruments") | {"Instrument"}


def names_in(node: ast.AST) -> set[str]:
    """The names, and the last names of attributes, in a piece of code."""
    inner = list(ast.walk(node))
    return {each.id for each in inner if isinstance(each, ast.Name)} | {
        each.attr for each in inner if isinstance(each, ast.Attribute)
    }


def asked_classes(code: str, classes: set[str]) -> int:
    """Number of `isinstance` and of class patterns for these classes in code, also by a constant that names classes."""
    if not any(name in code for name in classes):
        return 0
    nodes = list(ast.walk(ast.parse(code)))
    constants = {
        target.id
        for node in nodes
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.BinOp | ast.Tuple)
        for target in node.targets
        if isinstance(target, ast.Name) and names_in(node.value) <= classes and names_in(node.value)
    }
    asked = [
        node.args[1]
        for node in nodes
        if isinstance(node, ast.Call) and names_in(node.func) & {"isinstance", "issubclass"} and len(node.args) == 2
    ] + [node.cls for node in nodes if isinstance(node, ast.MatchClass)]
    return sum(bool(names_in(each) & (classes | constants)) for each in asked)


def changed_counts(classes: set[str], own_room: str, table: dict[str, int]) -> dict[str, str]:
    """The files outside the classes' own room whose number of tests of them is not that in the table."""
    found = {}
    for path in sorted(path for room in ROOMS for path in (ROOT / room).rglob("*.py")):
        own = path.is_relative_to(ROOT / own_room)
        number = 0 if own else asked_classes(path.read_text(encoding="utf-8"), classes)
        if number:
            found[path.relative_to(ROOT).as_posix()] = number
    return {
        file: f"{table.get(file, 0)} in the table, now {found.get(file, 0)}"
        for file in sorted({*found, *table})
        if found.get(file, 0) != table.get(file, 0)
    }


def test_the_asked_classes_are_counted():
    code = "isinstance(a, Backlash) and isinstance(b, effects.Cyclic | Scale) and isinstance(c, str)"
    assert asked_classes(code, EFFECTS) == 2
    assert asked_classes("PERIODIC = (Cyclic, Scale)\nfound = isinstance(a, PERIODIC)", EFFECTS) == 1
    assert (
        asked_classes("match a:\n    case Backlash(width=1):\n        pass\n    case str():\n        pass", EFFECTS)
        == 1
    )
    assert asked_classes("isinstance(a, Ballbar | Part) or isinstance(a, Backlash)", INSTRUMENTS) == 1


def test_a_fact_of_an_effect_stands_on_its_class():
    changed = changed_counts(EFFECTS, "kinematics/effects", TESTS_OF_CLASSES)
    assert changed == {}, "put a fact on the class of the effect; lower the number in the table where there are fewer"


def test_a_fact_of_an_instrument_stands_on_its_class():
    changed = changed_counts(INSTRUMENTS, "calibration/instruments", TESTS_OF_INSTRUMENTS)
    assert changed == {}, "put a fact on the class of the instrument; lower the number where there are fewer"


def kinds_asked(code: str) -> int:
    """Number of questions in code after the kind of an instrument: whether its rows have an axis, or a component."""
    return sum(
        isinstance(node, ast.Compare)
        and isinstance(node.left, ast.Attribute)
        and node.left.attr in ("axis", "component")
        and bool(names_in(node.left.value) & {"measurement", "m"})
        for node in ast.walk(ast.parse(code))
    )


def test_rooms_ask_an_instrument_for_facts():
    assert kinds_asked("if measurement.axis is None or m.component is not None or effect.axis is None: ...") == 2
    own = ROOT / "calibration/instruments"
    found = {}
    for path in sorted(path for room in ROOMS for path in (ROOT / room).rglob("*.py")):
        if not path.is_relative_to(own):
            found[path.relative_to(ROOT).as_posix()] = kinds_asked(path.read_text(encoding="utf-8"))
    asking = {file: number for file, number in found.items() if number}
    # the files of one measurement have the error motions of its rows, or none
    assert asking == {"calibration/measurement/joining.py": 1}
