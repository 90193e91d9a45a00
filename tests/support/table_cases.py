"""A case for each format of controller tables: a machine with errors that the format can carry, and what it leaves."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from unittest import mock

import numpy as np

from kinematics.basis import Legendre, Polynomial
from kinematics.effects import Backlash, Cyclic, Effect, ErrorMotion, LocationError
from kinematics.error_model.model import ErrorModel
from kinematics.machine import Machine
from postproc.control_data import remaining_error
from postproc.control_data.format import parse_settings
from postproc.control_data.formats import FORMATS
from postproc.control_data.tables import build
from postproc.control_data.tables.export_tables import Exported, export
from support.programs import load, model_of

TOOL = (0.0, 0.0, -100.0)


@contextmanager
def few_positions() -> Iterator[None]:
    """Tables from a quarter of the positions along each axis and in the volume: as many tables, of the same kind."""
    along = mock.patch.multiple(build, FINE={3: 101}, COARSE={3: 21}, NODES_OF_MORE_AXES=(51, 13), BALANCE=512)
    with along, mock.patch.object(remaining_error, "REMAINING_POSITIONS", 1024):
        yield


def motions(machine: Machine, names: str, size: float = 20.0, degree: int = 3) -> list[Effect]:
    """Smooth error motions, `XX YX AX ...`, each of about that size in um or urad, the same in every run."""
    found: list[Effect] = []
    for name in names.split():
        component, axis = name[0], name[1:]
        low, high = machine.axes[machine.index(axis)].travel
        interval = (0.0, 360.0) if not np.isfinite(high - low) else (low, high)
        rng = np.random.default_rng([ord(c) for c in name])
        values = tuple((rng.uniform(-1, 1, degree + 1) * size / (1 + np.arange(degree + 1))).tolist())
        found.append(ErrorMotion(component, axis, Legendre(interval, degree), values, u=(1.0,) * (degree + 1)))
    return found


POSITIONING = "XX YY ZZ"
STRAIGHTNESS = "YX ZX XY ZY XZ YZ"
ANGULAR = "AX BX CX AY BY CY AZ BZ CZ"
SQUARENESS = [LocationError("C", "Y", 40.0), LocationError("B", "Z", -25.0), LocationError("A", "Z", 30.0)]
SCALES = [
    ErrorMotion(axis, axis, Polynomial((0.0, reach), 1), (5.0, size), u=(1.0, 1.0))
    for axis, reach, size in (("X", 600.0, 30.0), ("Y", 450.0, -60.0), ("Z", 500.0, 90.0))
]
"""Of cframe."""
ROUND = [Cyclic(component, "C", 360.0, (12.0, 3.0), (-7.0, 2.0)) for component in "XYZABC"]
PLAY = [Backlash("X", 15.0), Backlash("Y", 8.0, 10.0)]


@dataclass(frozen=True)
class Case:
    """What a format is tried on."""

    format: str
    errors: str
    """Error motions that it can carry."""
    further: list[Effect] = field(default_factory=list)
    machine: str = "cframe"
    settings: tuple[str, ...] = ()
    sign: str | None = None
    leaves: float = 0.02
    """um RMS at most, of errors of some tens."""
    exact: float = 1e-9
    """mm and rad: the difference of what is read back."""
    degree: int = 3
    """Of the error motions."""
    few: bool = False
    """True for tables from few positions."""

    @property
    def id(self) -> str:
        return " ".join((self.format, self.machine, *self.settings, self.sign or "", *["few"] * self.few))

    @property
    def of_few_positions(self) -> Case:
        return replace(self, few=True)

    def model(self) -> ErrorModel:
        machine = load(self.machine)
        return model_of(machine, *motions(machine, self.errors, degree=self.degree), *self.further)

    def exported(self) -> Exported:
        if self.id not in _EXPORTED:
            _EXPORTED[self.id] = self._export()
        return _EXPORTED[self.id]

    def _export(self) -> Exported:
        form = FORMATS[self.format]
        meaning = form.sign or self.sign
        assert meaning in ("error", "correction")
        settings = parse_settings(form.settings, self.settings)
        with few_positions() if self.few else nullcontext():
            return export(load(self.machine), self.model(), form, settings, meaning, TOOL)


CASES = [
    Case("linuxcnc", POSITIONING, PLAY),
    Case("linuxcnc", POSITIONING, PLAY, settings=("type=0",)),
    Case("linuxcnc", POSITIONING, [ROUND[5], Backlash("C", 40.0)], machine="head_table"),
    Case("siemens-eec", POSITIONING),
    Case("siemens-eec", POSITIONING, [ROUND[5]], machine="head_table", settings=("points=361",), leaves=0.06),
    Case("siemens-cec", f"{POSITIONING} {STRAIGHTNESS}", [*SQUARENESS, *PLAY], sign="error"),
    Case("siemens-cec", f"{POSITIONING} {STRAIGHTNESS} {ANGULAR}", [*SQUARENESS, *PLAY], sign="correction", leaves=0.2),
    Case("siemens-cec", STRAIGHTNESS, sign="error", settings=("own=false", "products=false", "control=828d")),
    Case("siemens-cec", POSITIONING, ROUND, machine="head_table", sign="error", leaves=2.0),
    Case(
        "heidenhain",
        f"{POSITIONING} {STRAIGHTNESS}",
        [*SQUARENESS, *PLAY],
        sign="error",
        settings=("backlash=true",),
        leaves=0.1,
    ),
    Case(
        "heidenhain",
        f"{POSITIONING} {STRAIGHTNESS}",
        SQUARENESS,
        sign="correction",
        settings=("layout=old",),
        leaves=0.1,
    ),
    Case("heidenhain", POSITIONING, [ROUND[5]], machine="head_table", sign="error", leaves=0.5),
    Case("heidenhain-kinematics", f"{POSITIONING} {STRAIGHTNESS} {ANGULAR}", SQUARENESS, sign="error", leaves=0.1),
    Case("heidenhain-kinematics", "XX BX", ROUND, machine="head_table", sign="correction", leaves=0.1),
    Case("fanuc", POSITIONING, PLAY, sign="correction", settings=("bidirectional=true",), leaves=1.0),
    Case(
        "fanuc",
        POSITIONING,
        [ROUND[5]],
        machine="head_table",
        sign="error",
        settings=("unit_um=0.1", "interval=20", "largest=60"),
        leaves=0.5,
    ),
    Case(
        "fanuc",
        POSITIONING,
        SQUARENESS,
        sign="error",
        settings=("interval=25", "straightness=true", "unit_um=0.1", "largest=50"),
        leaves=0.5,
    ),
    Case("isg", POSITIONING, PLAY, leaves=0.1),
    Case("isg", POSITIONING, [ROUND[5], Backlash("C", 40.0)], machine="head_table", leaves=0.5),
    Case("isg-cross", "YX ZX ZY", [SQUARENESS[0]], sign="error", leaves=0.2),
    Case("isg-cross", "ZX XY YZ", [], sign="correction", settings=("planes=false",), leaves=0.1),
    Case("isg-volumetric", f"{POSITIONING} {STRAIGHTNESS} {ANGULAR}", SQUARENESS, sign="error"),
    Case(
        "isg-volumetric", "XX BX", ROUND, machine="head_table", sign="correction", settings=("angle=deg",), leaves=0.1
    ),
    Case("etalon", f"{POSITIONING} {STRAIGHTNESS} {ANGULAR}", SQUARENESS, sign="error"),
    Case("etalon", "XX BX", ROUND, machine="head_table", sign="correction", leaves=0.1),
    Case("mitsubishi", POSITIONING, leaves=0.8),
    Case("klipper", "ZX ZY", SQUARENESS[:2], machine="bzt_pfu", leaves=0.2),
    Case("reprap", "ZX ZY", SQUARENESS[:2], machine="bzt_pfu", leaves=0.5, exact=1e-7),
    Case(
        "marlin",
        "ZX ZY",
        SQUARENESS[:2],
        machine="bzt_pfu",
        settings=("x=0:1800:13", "y=0:1500:11"),
        leaves=0.5,
        exact=1e-6,
    ),
    Case("marlin", "", SQUARENESS, machine="bzt_pfu", settings=("skew=xyz",), exact=1e-7),
    Case("grbl", "", SCALES, settings=("steps=X:250,Y:320,Z:1600",), leaves=0.1, exact=1e-4),
    Case("linuxcnc-matrix", "", [*SQUARENESS, *SCALES], exact=1e-7),
    Case("linuxcnc-calibxyz", f"{POSITIONING} {STRAIGHTNESS}", SQUARENESS, degree=2, leaves=0.1, exact=1e-6),
    Case("csv", f"{POSITIONING} {STRAIGHTNESS} {ANGULAR}", [*SQUARENESS, *PLAY], exact=2e-7),
    Case("csv", "XX BX", [*ROUND, LocationError("X", "C", 30.0)], machine="head_table", exact=2e-7),
]

_EXPORTED: dict[str, Exported] = {}
"""By case: each is worked out once."""
