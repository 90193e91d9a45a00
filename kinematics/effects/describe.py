"""The table of effects in print: what each class says of itself."""

from __future__ import annotations

import inspect
import math
from typing import NamedTuple

import msgspec

from kinematics.effects import EFFECTS
from kinematics.effects.base import Cause, Parameter

HEAD = """# Effects: the physical causes of error

Written by `python -m kinematics.effects > docs/effects.md` from the classes in `kinematics/effects/`; do not edit.

An effect of the *machine* (it acts on an axis or on the tool) is corrected; one of the *instrument* is taken out of
the data and never enters the machine. An error is actual minus nominal, tool relative to workpiece (signs and frames:
[conventions](conventions.md)); of the instrument, observed minus true. Parameters are in um and urad where no other
unit is given, positions in mm and degrees. The typical size is the standard deviation of the prior in a fit. *Needs*
names what must be known of an instant besides the axis positions. The remedy is the least that puts it right; the
corrected program can whatever a table can. In a diagnosis a parameter's name carries its unit: `width_um`.
"""
NEEDS = {
    "approach": "direction of approach",
    "last_move": "last move",
    "observed": "observed point",
}
"""Columns of State whose name does not say enough."""


class Description(NamedTuple):
    """One row of the table."""

    kind: str
    title: str
    acts_on: str
    needs: tuple[str, ...]
    told_by: tuple[str, ...]
    """Fields that say what it is and where."""
    quantities: tuple[Parameter, ...]
    optional: frozenset[str]
    """Names of the quantities that may be absent."""
    remedy: str
    text: str
    """What it means, with its signs."""


def describe() -> list[Description]:
    """All effects, from the facts of their classes, in the order of the table."""
    return [_described(effect) for effect in EFFECTS]


def _described(effect: type[Cause]) -> Description:
    fields = msgspec.structs.fields(effect)
    quantities = {quantity.name for quantity in effect.QUANTITIES}
    return Description(
        str(effect.__struct_config__.tag),
        effect.TITLE,
        effect.ACTS_ON,
        tuple(NEEDS.get(column, column.replace("_", " ")) for column in effect.NEEDS),
        tuple(field.name for field in fields if field.name not in quantities | {"u", "note"}),
        effect.QUANTITIES,
        frozenset(field.name for field in fields if field.name in quantities and field.default is None),
        effect.REMEDY,
        inspect.getdoc(effect) or "",
    )


def typical(quantity: Parameter) -> str:
    """Its typical size, as people read it."""
    if math.isinf(quantity.typical):
        return "any"
    if quantity.share_of:
        return f"{quantity.typical:.0%} of the {quantity.share_of}"
    return f"{quantity.typical:g}"


def markdown() -> str:
    """The page docs/effects.md."""
    rows = describe()
    lines = [HEAD, "| kind | cause | acts on | needs | parameters | remedy |", "|---|---|---|---|---|---|"]
    for row in rows:
        parameters = ", ".join(quantity.name for quantity in row.quantities)
        needs = ", ".join(row.needs) or "-"
        lines.append(f"| `{row.kind}` | {row.title} | {row.acts_on} | {needs} | {parameters} | {row.remedy} |")
    for row in rows:
        lines += ["", f"## {row.kind}", "", row.text, ""]
        if row.told_by:
            lines += [f"Told by: {', '.join(f'`{name}`' for name in row.told_by)}.", ""]
        lines += ["| parameter | unit | typical size | |", "|---|---|---|---|"]
        for quantity in row.quantities:
            optional, curved = quantity.name in row.optional, not quantity.linear
            remarks = filter(None, ("optional" * optional, "not linear" * curved, quantity.bound))
            lines.append(f"| `{quantity.name}` | {quantity.unit} | {typical(quantity)} | {', '.join(remarks)} |")
    return "\n".join(lines) + "\n"
