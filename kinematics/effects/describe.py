"""The table of effects in print, from the attributes and docstrings of its classes."""

from __future__ import annotations

import inspect
import math
from typing import NamedTuple

import msgspec

from kinematics.effects import EFFECTS
from kinematics.effects.base import EffectBase
from kinematics.effects.records import Parameter

HEAD = """# Effects: the physical causes of error

Written by `python -m kinematics.effects > docs/effects.md` from the classes in `kinematics/effects/`; do not edit.

An effect of the *machine* (it acts on an axis, on the tool or on the workpiece) is corrected; one of the *instrument*
is removed from the data and never enters the machine. An error is actual minus nominal, tool relative to workpiece
(signs and frames: [conventions](conventions.md)); of the instrument, observed minus true. Parameters are in um and urad
unless another unit is given, positions in mm and degrees. The typical size is the standard deviation of the prior in a
fit. *Needs* lists the variables that must be known besides the axis positions. The remedy is the simplest one that
corrects the effect; a corrected program can do everything that a table can. In a diagnosis a parameter's name carries
its unit: `width_um`.
"""
NEEDS = {"approach": "direction of approach", "last_move": "last move", "observed": "observed point"}
"""Descriptions of the columns of State whose name is not self-explanatory."""


class Description(NamedTuple):
    """One row of the table."""

    kind: str
    title: str
    acts_on: str
    needs: tuple[str, ...]
    identified_by: tuple[str, ...]
    """Names of the fields that are no parameters: component, axis and the like."""
    quantities: tuple[Parameter, ...]
    optional: frozenset[str]
    """Names of the quantities that may be absent."""
    remedy: str
    text: str
    """Meaning of the effect, with its signs."""


def describe() -> list[Description]:
    """All effects, from the facts of their classes, in the order of the table."""
    return [_described(effect) for effect in EFFECTS]


def _described(effect: type[EffectBase]) -> Description:
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
    """The typical size of a parameter as text."""
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
        if row.identified_by:
            lines += [f"Identified by: {', '.join(f'`{name}`' for name in row.identified_by)}.", ""]
        lines += ["| parameter | unit | typical size | |", "|---|---|---|---|"]
        for quantity in row.quantities:
            optional, curved = quantity.name in row.optional, not quantity.linear
            remarks = filter(None, ("optional" * optional, "not linear" * curved, quantity.bound))
            lines.append(f"| `{quantity.name}` | {quantity.unit} | {typical(quantity)} | {', '.join(remarks)} |")
    return "\n".join(lines) + "\n"
