"""From a machine's errors to the tables of a control: the least remaining volumetric error.

The sum of tables nearest to the required correction, in least squares over the working volume, consists of its means:
of one variable each; of two variables, for the residual, as a surface or as the best product of two functions of one
each, which is its first singular pair (Eckart and Young, 1936). These parts are orthogonal, so a control with few
tables gets those with the largest effect. Each is then written with the best nodes the control allows.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from kinematics.machine import TURN_DEG, Axis
from kinematics.transforms import Array
from kinematics.user_error import UserError
from postproc.control_data.tables.limits import Limits, check_terms
from postproc.control_data.tables.nodes import choose_nodes, fitted
from postproc.control_data.tables.target import Target
from postproc.control_data.tables.terms import Curve, Surface, Term, added, to_steps

FINE, COARSE = {3: 401}, {3: 81}
"""Positions along an axis at which curves, and surfaces, are known, by the number of axes of the machine."""
NODES_OF_MORE_AXES = (201, 25)
"""The same for machines of more axes."""
WORTH = 1e-4
"""mm RMS: a product or surface with a smaller effect is left out."""
BALANCE = 2048
"""Positions in the volume over which the mean of the remaining error is made 0."""
CHORDS = 32
"""Straight parts over the travel that stand for a bow: they leave 1/1000 of it."""
FACTOR = 1e-6
"""Resolution of the dimensionless factor of a product, which is 1 at most."""


@dataclass(frozen=True)
class Capabilities:
    """The variables of the tables of a format."""

    outputs: str = "XYZUVWABC"
    """Letters of the axes that something can be added to."""
    own: bool = True
    """True when a table can add to the axis that it is a function of."""
    cross: bool = False
    """True when it can add to another."""
    pairs: tuple[str, ...] = ()
    """Letters of output and source, `XY`, of the only tables that add to another axis; empty for all."""
    bidirectional: bool = False
    """True when an axis' own table may differ with the direction of travel."""
    products: bool = False
    """True when two tables can be multiplied."""
    surfaces: str = ""
    """Letters of the axes of which tables can be functions of two."""
    surface_outputs: str = "XYZUVWABC"
    """Letters of the axes that these can add to."""

    def adds(self, output: str, source: str) -> bool:
        """True when a table can add to the axis `output` by the position of another, `source`."""
        return self.cross and output[0] in self.outputs and (not self.pairs or output[0] + source[0] in self.pairs)


@dataclass(frozen=True)
class Built:
    """Tables, and the constant that they do not contain."""

    terms: tuple[Term, ...]
    datum: dict[str, float] = field(default_factory=dict)
    """By axis, mm or degrees: the constant that was taken off the tables for them to be 0 at the reference position."""


@dataclass(frozen=True)
class _Part:
    """A part of the required correction: of one output, as a function of one axis or of two."""

    output: int
    sources: tuple[int, ...]
    positions: tuple[Array, ...]
    values: Array
    """`(m, directions)` of one axis, `(m, k)` of two, mm or degrees."""
    tables: int
    improvement: float
    """Mean square of its correction."""


def build(target: Target, capabilities: Capabilities, limits: Limits, control: str) -> Built:
    """The tables of a format for one machine; UserError if its limits admit none."""
    outputs = [i for i, axis in enumerate(target.machine.axes) if axis.name[0] in capabilities.outputs]
    parts = _of_one_axis(target, outputs, capabilities)
    parts += _of_two_axes(target, outputs, capabilities)
    kept = _best(parts, limits)
    writer = _Writer(target, limits)
    for part in kept:
        if len(part.sources) == 2:
            writer.surface(part) if capabilities.surfaces else writer.product(part)
    for group in _sharing([part for part in kept if len(part.sources) == 1], limits):
        writer.curves(group)
    writer.balance()
    check_terms(writer.terms, limits, control, target.machine)
    return Built(tuple(sorted(writer.terms, key=lambda term: (len(term.factors), term.output))), writer.datum)


def _of_one_axis(target: Target, outputs: Sequence[int], capabilities: Capabilities) -> list[_Part]:
    """Mean corrections along each axis; that of an axis' own contains the constant over the volume."""
    found = []
    for j in range(len(target.machine.axes)):
        if not capabilities.cross and (j not in outputs or not capabilities.own):
            continue
        x = target.positions_along(j, FINE.get(len(target.machine.axes), NODES_OF_MORE_AXES[0]))
        directions = (1, -1) if capabilities.bidirectional and j in outputs and target.depends_on_direction(j) else (0,)
        values = np.stack([target.mean((j,), (x,), direction) for direction in directions], axis=1)
        for i in outputs:
            if i == j and capabilities.own:
                curves = values[:, :, i]
                found.append(_Part(i, (j,), (x,), curves, curves.shape[1], float(np.mean(curves**2))))
            elif i != j and capabilities.adds(target.machine.axes[i].name, target.machine.axes[j].name):
                curve = values[:, :, i].mean(axis=1, keepdims=True)
                curve = curve - curve.mean()
                found.append(_Part(i, (j,), (x,), curve, 1, float(np.mean(curve**2))))
    return found


def _of_two_axes(target: Target, outputs: Sequence[int], capabilities: Capabilities) -> list[_Part]:
    if not capabilities.products and not capabilities.surfaces:
        return []
    axes, found = target.machine.axes, []
    for pair in combinations(range(len(axes)), 2):
        if capabilities.surfaces and not all(axes[k].name[0] in capabilities.surfaces for k in pair):
            continue
        n = COARSE.get(len(axes), NODES_OF_MORE_AXES[1])
        positions = tuple(target.evenly(k, n) for k in pair)
        both = target.mean(pair, positions)
        means = {pair[0]: both.mean(axis=1, keepdims=True), pair[1]: both.mean(axis=0, keepdims=True)}
        middle = both.mean(axis=(0, 1))
        for i in (i for i in outputs if axes[i].name[0] in capabilities.surface_outputs):
            interaction = both[:, :, i] - middle[i]
            for k in pair:
                if capabilities.own if k == i else capabilities.adds(axes[i].name, axes[k].name):
                    interaction = interaction - (means[k][:, :, i] - middle[i])
            improvement = float(np.mean(interaction**2))
            if improvement >= WORTH**2:
                found.append(_Part(i, pair, positions, interaction, 1 if capabilities.surfaces else 2, improvement))
    return found


def _best(parts: Iterable[_Part], limits: Limits) -> list[_Part]:
    """The parts with the largest improvement for each table that they need, as many as the control holds."""
    kept: list[_Part] = []
    left = float("inf") if limits.tables is None else limits.tables
    for part in sorted(parts, key=lambda part: -part.improvement / part.tables):
        if part.tables <= left and not _one_too_many(part, kept, limits):
            kept.append(part)
            left -= part.tables
    return kept


def _one_too_many(part: _Part, kept: Sequence[_Part], limits: Limits) -> bool:
    if len(part.sources) == 2:
        most, count = limits.surfaces_per_output, sum(len(k.sources) == 2 and k.output == part.output for k in kept)
    elif part.sources != (part.output,):
        most = limits.cross_per_source
        count = sum(k.sources == part.sources and k.sources != (k.output,) for k in kept)
    else:
        return False
    return most is not None and count >= most


def _sharing(parts: Sequence[_Part], limits: Limits) -> list[list[_Part]]:
    """The parts of one axis together where their tables share nodes, and each for itself where not."""
    if not limits.shared:
        return [[part] for part in parts]
    sources = dict.fromkeys(part.sources for part in parts)
    return [[part for part in parts if part.sources == source] for source in sources]


class _Writer:
    """Collects tables, with the constants and the contributions of products to the means of one axis."""

    def __init__(self, target: Target, limits: Limits) -> None:
        self._target, self._limits = target, limits
        self._no_constant = limits.zero_at_home or limits.through_zero
        self.terms: list[Term] = []
        self.datum: dict[str, float] = {}

    def curves(self, parts: Sequence[_Part]) -> None:
        """Tables of one axis on the same nodes; of each direction where they differ."""
        source = self._target.machine.axes[parts[0].sources[0]]
        cross = parts[0].sources != (parts[0].output,)
        limits = self._limits.cross if cross and self._limits.cross is not None else self._limits
        limits = limits.of(source, self._target.machine.axes[parts[0].output])
        x = parts[0].positions[0]
        required = [part.values - self._means_of_products(part)[:, None] for part in parts]
        together = [(part, curves) for part, curves in zip(parts, required, strict=True) if _visible(curves, limits)]
        if not together:
            return
        closing = source.turns_fully
        if closing and limits.turns:
            turns = len(turns_of(source, x[0], limits.turns))
            if limits.points < 8 * turns + 1:
                few = f"{limits.points} points are too few for {turns} turns"
                raise UserError(f"axis {source.name}: {few}; expected at least {8 * turns + 1}")
            limits = replace(limits, points=(limits.points - 1) // turns + 1)
        if limits.degree is not None:
            for part, own in together:
                self._table(part, *_polynomial(x, own, limits, source.home), limits, closing=False)
            return
        curves = np.concatenate([curves for _, curves in together], axis=1)
        nodes = choose_nodes(x, curves, limits, source.home, closing=closing)
        for part, own in together:
            self._table(part, nodes, fitted(x, own, nodes), limits, closing=closing)

    def _table(self, part: _Part, nodes: Array, values: Array, limits: Limits, *, closing: bool) -> None:
        output, source = (self._target.machine.axes[i] for i in (part.output, part.sources[0]))
        if closing:
            values[[0, -1]] = values[[0, -1]].mean(axis=0)
            if limits.turns:
                nodes, values = written_out(nodes, values, turns_of(source, nodes[0], limits.turns))
        if limits.zero_at_home and limits.degree is None:
            values = values - float(np.interp(source.home, nodes, values[:, 0]))
        rounded = to_steps(values, limits.resolution)
        for direction, column in zip((1, -1) if values.shape[1] == 2 else (0,), rounded.T, strict=True):
            if direction or column.any():
                self.terms.append(Term(output.name, (Curve(source.name, nodes, column),), direction))

    def balance(self) -> None:
        """Move the mean remaining constant over the volume into the axes' own tables, or into the datum."""
        machine = self._target.machine
        q = self._target.volume(BALANCE) * machine.scale
        steps = {axis.name: self._limits.of(axis, axis).resolution for axis in machine.axes}
        required = self._target.correction(q)
        left = (required - added(self.terms, machine, q)).mean(axis=0) / machine.scale
        for k, term in enumerate(self.terms):
            curve = term.factors[0]
            if term.inputs == (term.output,) and isinstance(curve, Curve) and not self._no_constant:
                step = steps[term.output]
                shift = np.round(left[machine.index(term.output)] / step) * step
                values = np.round(curve.values + shift, 12)
                self.terms[k] = replace(term, factors=(replace(curve, values=values),))
        left = (required - added(self.terms, machine, q)).mean(axis=0) / machine.scale
        outputs = {term.output for term in self.terms}
        if self._target.rotary and self._limits.zero_at_home:  # a constant alone leaves no table
            outputs |= {axis.name for axis in machine.axes if axis.rotary}
        seen = [i for i, name in enumerate(machine.names) if name in outputs and abs(left[i]) >= steps[name]]
        self.datum = {machine.names[i]: float(left[i]) for i in seen}

    def product(self, part: _Part) -> None:
        """Two tables that are multiplied; both are 0 at the reference positions."""
        axes = self._target.machine.axes
        left, sizes, right = np.linalg.svd(part.values)
        factors = []
        size = float(np.abs(right[0]).max())
        resolutions = (self._limits.of(axes[part.output], axes[part.output]).resolution, FACTOR)
        for k, values in enumerate((left[:, 0] * sizes[0] * size, right[0] / size)):
            axis, x = axes[part.sources[k]], part.positions[k]
            limits = self._limits.of(axis, axes[part.output])
            limits = limits if k == 0 else replace(limits, resolution=FACTOR, finest=1e-4)
            at_home = values - np.interp(axis.home, x, values)
            nodes = choose_nodes(x, at_home[:, None], limits, axis.home, closing=axis.turns_fully)
            fit = fitted(x, at_home[:, None], nodes)[:, 0]
            if axis.turns_fully:
                fit[[0, -1]] = fit[[0, -1]].mean()
            fit = fit - np.interp(axis.home, nodes, fit)
            factors.append(Curve(axis.name, nodes, to_steps(fit, resolutions[k])))
        self.terms.append(Term(axes[part.output].name, tuple(factors)))

    def surface(self, part: _Part) -> None:
        """A table of two axes."""
        axes = [self._target.machine.axes[k] for k in part.sources]
        output = self._target.machine.axes[part.output]
        mesh = self._limits.mesh
        nodes = [np.array(mesh[axis.name]) for axis in axes] if mesh else self._equidistant_on_both(part)
        x, y = part.positions
        inside = [(p >= n[0] - 1e-9) & (p <= n[-1] + 1e-9) for p, n in zip((x, y), nodes, strict=True)]
        for axis, each in zip(axes, inside, strict=True):
            if each.sum() < 2:
                raise UserError(f"the points of the mesh along {axis.name} are outside its travel")
        values = fitted(x[inside[0]], part.values[np.ix_(*inside)], nodes[0])
        values = fitted(y[inside[1]], values.T, nodes[1]).T
        if axes[0].turns_fully:
            values[[0, -1]] = values[[0, -1]].mean(axis=0)
        if axes[1].turns_fully:
            values[:, [0, -1]] = values[:, [0, -1]].mean(axis=1, keepdims=True)
        rounded = to_steps(values, self._limits.of(output, output).resolution)
        surface = Surface((axes[0].name, axes[1].name), (nodes[0], nodes[1]), rounded)
        self.terms.append(Term(output.name, (surface,)))

    def _equidistant_on_both(self, part: _Part) -> list[Array]:
        """Nodes `(k,)` over each of the two axes of a part, from the first position on."""
        axes = [self._target.machine.axes[k] for k in part.sources]
        output = self._target.machine.axes[part.output]
        bounds = [self._target.bounds[k] for k in part.sources]
        n = min(self._limits.grid or int(np.sqrt(self._limits.points)), len(part.positions[0]) // 2 + 1)
        steps_of = [self._limits.of(axis, output).spacing_step for axis in axes]
        apart = [_whole(float(np.ptp(b)) / (n - 1), step) for b, step in zip(bounds, steps_of, strict=True)]
        apart = [max(apart)] * 2 if self._limits.square else apart
        steps = [int(np.ceil(np.ptp(b) / a - 1e-9)) for b, a in zip(bounds, apart, strict=True)]
        nodes = [b[0] + a * np.arange(k + 1) for b, a, k in zip(bounds, apart, steps, strict=True)]
        return [positions.round(9) for positions in nodes]

    def _means_of_products(self, part: _Part) -> Array:
        """Mean contributions `(m,)` of products to the same output, along the axis of a part of one axis."""
        machine = self._target.machine
        output, source = machine.axes[part.output].name, machine.axes[part.sources[0]].name
        total = np.zeros(len(part.positions[0]))
        for term in self.terms:
            if term.output != output or len(term.factors) != 2:
                continue
            here = np.ones_like(total)
            for factor in term.factors:
                (axis,) = factor.axes
                everywhere = self._target.evenly(machine.index(axis), 401)
                mean = float(np.mean(_along(factor, everywhere)))
                here = here * (_along(factor, part.positions[0]) if axis == source else mean)
            total += here if part.output == part.sources[0] else here - here.mean()
        return total


def _polynomial(x: Array, curves: Array, limits: Limits, home: float) -> tuple[Array, Array]:
    """Nodes over thrice the positions x `(m,)`, since it goes on outside, and values of the polynomial nearest to
    curves `(m, c)` in least squares.
    """
    assert limits.degree is not None
    zero = home if limits.zero_at_home else 0.0
    coefficients = np.polynomial.polynomial.polyfit(x - zero, curves, limits.degree)
    if limits.through_zero:
        coefficients[0] = 0.0
    nodes = np.linspace(2 * x[0] - x[-1], 2 * x[-1] - x[0], 2 if limits.degree == 1 else 3 * CHORDS + 1)
    return nodes, np.asarray(np.polynomial.polynomial.polyval(nodes - zero, coefficients).T, float)


def turns_of(axis: Axis, start: float, turns: int) -> range:
    """The turns from `start`, degrees, of a table that does not repeat: its travel, or `turns` to either side."""
    low, high = axis.travel if np.isfinite(axis.travel).all() else (start - turns * TURN_DEG, start + turns * TURN_DEG)
    return range(int(np.floor((low - start) / TURN_DEG)), int(np.ceil((high - start) / TURN_DEG)))


def written_out(nodes: Array, values: Array, turns: range) -> tuple[Array, Array]:
    """Nodes `(k,)` of a turn, degrees, and values `(k, directions)`, repeated for each of the turns."""
    every = [nodes[:-1] + TURN_DEG * k for k in turns]
    ends = nodes[-1:] + TURN_DEG * turns[-1]
    return np.concatenate([*every, ends]).round(9), np.concatenate([*[values[:-1]] * len(turns), values[-1:]])


def _along(factor: Curve | Surface, x: Array) -> Array:
    """Values of a function of one axis at its positions `(n,)`."""
    return factor.at(lambda _: x)


def _visible(curves: Array, limits: Limits) -> bool:
    return bool(np.abs(curves).max() >= limits.resolution / 2)


def _whole(spacing: float, step: float) -> float:
    """The spacing, or the next wider one of whole steps."""
    return float(np.ceil(spacing / step - 1e-9) * step)
