"""The options of virtual instruments, which simulations and optimised plans share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from kinematics.files.mistaken import none_of
from kinematics.running.given_texts import numbers
from kinematics.user_error import UserError
from postproc.commands.options.declared import option
from postproc.text.number_style import given_once

if TYPE_CHECKING:
    from collections.abc import Mapping

    from calibration.instruments import Instrument
    from calibration.observation.reach import Reach
    from calibration.simulation.measure_plan import VirtualInstrument
    from calibration.simulation.simulate import Faults
    from calibration.simulation.touch_probe import Spheres


Distance = Annotated[
    tuple[str, ...],
    option("Calibrated distance between two spheres, with its standard uncertainty (k=1), um.", "s1.s2=u_um"),
]


@dataclass(frozen=True, kw_only=True)
class UncertaintyOptions:
    """Uncertainties of an instrument."""

    uncertainty: tuple[str, ...] = option(
        "Standard uncertainty (k=1) of the instrument, by its key in a measurement file; those not given are zero. "
        "Default: the instrument's specification.",
        "u_angle_um=10",
        "-u",
    )

    def instrument_of(self, kind: str, planar: bool = False) -> Instrument:
        """The instrument with these uncertainties, or those of its specification; UserError for unknown ones."""
        import msgspec

        from calibration.instruments import KINDS

        if kind not in KINDS:
            raise UserError(f"--instrument {none_of(kind, KINDS)}")
        of: Any = KINDS[kind]
        components = of.in_plane(planar)
        if not self.uncertainty:
            typical: Instrument = msgspec.structs.replace(of.typical(), **components)
            return typical
        known = of.uncertainty_keys()
        given: list[tuple[str, float]] = []
        for text in self.uncertainty:
            name, _, value = text.partition("=")
            if name.strip() not in known:
                raise UserError(f"--uncertainty {text}: {kind} has {', '.join(known)}")
            (number,) = numbers(value, 1, f"--uncertainty {text}")
            if number < 0:
                raise UserError(f"--uncertainty {text}: expected a number of zero or above")
            given.append((name.strip(), number))
        values = given_once(given, "--uncertainty ")
        of.check_uncertainties(values, "--uncertainty", "-u {}=...")
        instrument: Instrument = of(**values, **components)
        return instrument


@dataclass(frozen=True, kw_only=True)
class TrackerOptions(UncertaintyOptions):
    """Uncertainties, positions and reach of a laser tracker."""

    tracker: tuple[str, ...] = option(
        "Position of the laser tracker, or of a station that ranges, mm, in the workpiece frame (with --stands-on bed: "
        "machine frame). Several are stations of ncomp simulate, and candidates of ncomp plan optimised. Default: "
        "those of the plan, or selected by ncomp.",
        "x,y,z",
    )
    elevation: str | None = option("Range of the tracker's elevation, degrees: -59:79.", "low:high")
    incidence: float | None = option("Largest angle between beam and axis of the reflector, degrees.", "deg")
    beam_mm: str | None = option(
        "Shortest and longest distance from the instrument to a target, mm: 200:15000.", "low:high"
    )

    @property
    def trackers(self) -> list[tuple[float, float, float]]:
        """Positions of the tracker, mm."""
        found = []
        for text in self.tracker:
            x, y, z = numbers(text, 3, f"--tracker {text}")
            found.append((x, y, z))
        return found

    @property
    def reach(self) -> Reach | None:
        """The reach of the tracker; None without limits."""
        from calibration.observation.reach import Reach

        elevation = nearest = farthest = None
        if self.elevation is not None:
            low, high = numbers(self.elevation, 2, f"--elevation {self.elevation}", ":")
            elevation = low, high
        if self.beam_mm is not None:
            nearest, farthest = numbers(self.beam_mm, 2, f"--beam-mm {self.beam_mm}", ":")
            if not 0.0 <= nearest < farthest:
                raise UserError(f"--beam-mm {self.beam_mm}: it must go from a shorter to a longer distance")
        limits = Reach(elevation, self.incidence, farthest, nearest)
        return None if limits == Reach() else limits


@dataclass(frozen=True, kw_only=True)
class InstrumentOptions(TrackerOptions):
    """A virtual instrument."""

    PANEL: ClassVar[str] = "Instrument"

    instrument: str | None = option(
        "Instrument: laser-tracker, ranging (ranges alone, from stations), interferometer, part (a measured "
        "workpiece), touch-probe, ballbar, level or lengths (a ruler). Default: that of the plan, or laser-tracker.",
        "KIND",
    )
    error_motions: str | None = option(
        "Error motions of linear axes that an interferometer observes at each position, by their letters (X is E_X of "
        "each axis). Default: the positioning deviation.",
        "all|Y,Z,B",
    )
    stands_on: Literal["workpiece", "bed"] = option(
        "Foundation of the laser tracker: the workpiece table, or the bed.", default="workpiece"
    )
    planar: bool = option("Measure a part in x and y only.", default=False)
    sphere: tuple[str, ...] = option(
        "Sphere on the table that a touch probe finds at each rotary position, mm, in the workpiece frame with all "
        "axes at 0; the linear axes follow from it.",
        "s1=x,y,z",
    )
    distance: Distance
    noise_scale: float = option("Multiple of the uncertainties in the data; 0: no noise.", default=1.0, min=0.0)

    def of_plan(self, planned: Instrument | None) -> Self:
        """The options, where they leave the instrument open with that of a plan, or with a laser tracker."""
        if self.instrument is not None:
            return self
        if planned is None:
            return replace(self, instrument="laser-tracker")
        own = tuple(f"{key}={getattr(planned, key)!r}" for key in planned.uncertainty_keys())
        return replace(self, instrument=planned.kind(), uncertainty=self.uncertainty or own)

    def virtual_instrument(self, faults: Faults, temperatures: Mapping[str, tuple[float, float]]) -> VirtualInstrument:
        """The instrument, its stations and the faults of its data."""
        from calibration.simulation.measure_plan import VirtualInstrument

        assert self.instrument is not None
        return VirtualInstrument(
            self.instrument_of(self.instrument, self.planar),
            self.trackers,
            self.stands_on,
            self.reach,
            self._letters(),
            self.noise_scale,
            faults,
            temperatures,
            self._spheres(),
        )

    def _spheres(self) -> Spheres:
        """Spheres of a touch probe and distances between them; none for other instruments."""
        if self.instrument != "touch-probe":
            for name, given in (("sphere", self.sphere), ("distance", self.distance)):
                if given:
                    raise UserError(f"--{name} is no option of --instrument {self.instrument}: leave it out")
        return spheres_of(self.sphere, self.distance)

    def _letters(self) -> Sequence[str]:
        """Letters of the error motions in `all` or in a list; empty for None."""
        from calibration.instruments import KINDS
        from kinematics.effects import COMPONENTS

        if self.error_motions is None or self.instrument is None:
            return ()
        if not KINDS[self.instrument].CHOOSES_MOTIONS:
            raise UserError(f"--error-motions is no option of --instrument {self.instrument}: leave it out")
        text = ",".join(COMPONENTS) if self.error_motions == "all" else self.error_motions
        letters = tuple(letter.strip().upper() for letter in text.split(","))
        for letter in letters:
            if letter not in COMPONENTS or letters.count(letter) > 1:
                raise UserError(f"--error-motions {text}: expected all, or some of {','.join(COMPONENTS)}, each once")
        return letters


def spheres_of(sphere: Sequence[str], distance: Sequence[str]) -> Spheres:
    """Spheres from `s1=x,y,z`, and distances between them from `s1.s2=u_um`."""
    from calibration.instruments.touch_probe import NAME
    from calibration.simulation.touch_probe import Spheres

    centres, distances = [], []
    for text in sphere:
        name, _, vector = text.partition("=")
        if not NAME.fullmatch(name.strip()):
            raise UserError(f"--sphere {text}: expected s1=x,y,z, a name without blanks and dots")
        x, y, z = numbers(vector, 3, f"--sphere {text}")
        centres.append((name.strip(), (x, y, z)))
    for text in distance:
        pair, _, value = text.partition("=")
        one, dot, other = pair.strip().partition(".")
        (u_um,) = numbers(value, 1, f"--distance {text}")
        if not dot or u_um <= 0.0:
            raise UserError(f"--distance {text}: expected s1.s2=u_um, the uncertainty above zero")
        distances.append(((one, other), u_um * 1e-3))
    return Spheres(given_once(centres, "--sphere "), dict(distances))


@dataclass(frozen=True, kw_only=True)
class FaultOptions:
    """Faults of the data, as shares of the observations; names are those of the library's `Faults`."""

    PANEL: ClassVar[str] = "Faults of the data"

    outliers: float = option("Share of outliers, 50 to 500 um.", "share", default=0.0, min=0.0, max=1.0)
    duplicates: float = option("Share of duplicated rows.", "share", default=0.0, min=0.0, max=1.0)
    missing: float = option("Share of missing rows.", "share", default=0.0, min=0.0, max=1.0)
