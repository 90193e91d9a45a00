"""The base of all instruments: a kind of observations, and their standard uncertainties.

Standard uncertainties (k = 1) are fields as in a measurement file, um and um per m of range. The constant part and the
part per metre of one quantity are added, as in data sheets.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self, get_args

import msgspec
import numpy as np

from kinematics.effects import Component, Effect
from kinematics.machine import Machine, Vector
from kinematics.state import State, with_moves
from kinematics.transforms import Array
from kinematics.user_error import UserError

if TYPE_CHECKING:
    from calibration.instruments.targets import Distance, Target
    from calibration.measurement.measurement import Measurement
    from calibration.measurement.states import MeasurementStates
    from calibration.measurement.text_table import Table
    from calibration.registration.registration import Registration
    from kinematics.error_model.model import Observation
    from kinematics.transforms import Pose

INDEPENDENT = "positions in which the axes move independently of each other, over their whole travel, would show it"
"""The measurement that shows what one more set-up of an instrument does not."""


class ErrorsShown(NamedTuple):
    """Errors of an axis that observations may show."""

    motions: Sequence[Component]
    backlash: bool = False


class LeastErrors(NamedTuple):
    """Sizes (k = 1) of a machine's errors that a fit expects at least, whatever the sizes that its data suggest."""

    typical_lines: bool = False
    """True where the lines of rotary axes keep their typical location errors."""
    squareness_urad: float = 0.0
    slope_um_per_mm: float = 0.0
    """Slope of each translation along its axis."""
    backlash_um: float = 0.0


class PlannedReadings(NamedTuple):
    """The readings in some rows of a plan."""

    rows: np.ndarray
    """Number `(m,)` among these rows of that of each reading."""
    axis: np.ndarray | None = None
    """Name `(m,)` of the axis that is observed by itself."""
    component: np.ndarray | None = None
    """Error motion `(m,)` of each reading; None where all are those of the axes along themselves."""


class InstrumentBase(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind"):
    """Base of all instruments. The class holds the facts of the kind, an object the uncertainties of one instrument."""

    PARTS: ClassVar[tuple[str, ...]] = ()
    """Names of the parts of an observation; empty where the rows of each axis are told apart instead."""
    STATIONED: ClassVar[bool] = False
    """True where the instrument stands at stations, whose positions are chosen."""
    STATIONS: ClassVar[int] = 1
    """Number of stations of a plan for which none is stated."""
    BY_BEAM: ClassVar[bool] = False
    """True where it reads the range and two angles of a beam, which err by themselves, also with time."""
    READS_RANGES: ClassVar[bool] = False
    """True where it reads ranges in air, with a beam or without its angles."""
    MAY_BE_KNOCKED: ClassVar[bool] = False
    """True where a set-up, or a target, may be knocked between two rows."""
    FOLLOWED_UP: ClassVar[bool] = False
    """True where a diagnosis proposes further rows by the same instrument."""
    COORDINATES: ClassVar[bool] = False
    """True where an observation has the coordinates of a point: their frame may be mirrored, their unit another."""
    FINDS_CENTRES: ClassVar[bool] = False
    """True where the machine goes to where the instrument is at the centre of a sphere, wherever this sphere is.

    Its positions are the finding, and observations are what is left: they may all be zero.
    """
    ON_CIRCLES: ClassVar[bool] = False
    """True where it observes the machine on circles: a lag of all axes alike lies along them, and is not seen."""
    IF_TOO_FEW: ClassVar[str] = ""
    """What to do where its rows are too few for a diagnosis; empty where more positions are needed."""
    ZERO_BY_BEAM: ClassVar[bool] = False
    """True where each break of the beam gives its readings a new zero."""
    CHECKS: ClassVar[tuple[str, ...]] = ()
    """Names of the checks of its recordings (`calibration/plausibility/checks.py`).

    Each is made if those before it find nothing.
    """
    DOUBTS: ClassVar[tuple[str, ...]] = ()
    """Names of those that are made where no mistake was found with which the data cannot be used."""
    NEVER_SEEN: ClassVar[str] = ""
    """Sentence on the errors that its observations never show, for every fit; empty where others say it."""
    GROWS_ALONG_RUN: ClassVar[bool] = False
    """True where the uncertainty of a row depends on the first row of its run."""
    OBSERVED: ClassVar[tuple[str, ...]] = ()
    """Columns of the observations, in addition to those of the state."""
    OPTIONAL: ClassVar[tuple[str, ...]] = ()
    """Further columns that only its files may have."""
    REQUIRED: ClassVar[tuple[str, ...]] = ()
    """Columns that each of its files must have, whatever it observes."""
    HEADER_KEYS: ClassVar[tuple[str, ...]] = ()
    """Header keys besides those of its uncertainties."""
    RECOGNISED_BY: ClassVar[str] = ""
    """Header key by which a file without the key `instrument` is one of its files; empty where none does."""
    NEEDED: ClassVar[tuple[tuple[str, ...], ...]] = (("u_um",),)
    """Groups of uncertainties, at least one above zero in each: an observation without any had infinite weight."""
    SET_UP: ClassVar[str] = "station"
    """Column with the name of the set-up."""
    OWN_TIP: ClassVar[bool] = False
    """True where the one target is the tip of the instrument itself, which the header names by a key of its own."""
    ANY_TARGETS: ClassVar[bool] = False
    """True where targets may be on the table and on the bed, and the fit may determine their positions."""
    CHOOSES_MOTIONS: ClassVar[bool] = False
    """True where the error motions of linear axes that it observes are chosen."""
    IN_ORDER_OF_MOVES: ClassVar[bool] = True
    """False where the order of the rows is not that in which the machine moved."""
    MAY_BE_FEW: ClassVar[bool] = False
    """True where a fit is made even if no observation is left over to check it: the report says so."""
    CLOCK_OF_MACHINE: ClassVar[bool] = True
    """False where the times of the rows are not those at which the machine moved, but of another machine."""

    @classmethod
    def kind(cls) -> str:
        """Kind of the instrument, as in the header of a measurement file: `laser-tracker`."""
        return str(cls.__struct_config__.tag)

    @classmethod
    def a_kind(cls) -> str:
        """Kind of the instrument with its article, for messages: `an interferometer`."""
        return f"{'an' if cls.kind()[0] in 'aeiou' else 'a'} {cls.kind()}"

    @classmethod
    def expect(cls, instrument: InstrumentBase, refusal: str = "") -> Self:
        """An instrument as one of this kind, for what only this kind has; UserError with `refusal` for another."""
        if not isinstance(instrument, cls):
            raise UserError(refusal or f"{instrument.a_kind()} is given, but this needs {cls.a_kind()}")
        return instrument

    @classmethod
    def uncertainty_keys(cls) -> list[str]:
        """Header keys of the standard uncertainties."""
        return [name for name in cls.__struct_fields__ if name.startswith("u_")]

    @classmethod
    def is_header_key(cls, key: str) -> bool:
        """True for a header key that belongs to the instrument."""
        return key in cls.HEADER_KEYS or key in cls.uncertainty_keys()

    @classmethod
    def check_uncertainties(cls, values: Mapping[str, float], where: str, how: str) -> None:
        """UserError unless the standard uncertainties, by header key, give the observations a finite weight.

        The message begins with `where` and ends with `how`, in which a key is inserted.
        """
        for group in cls.NEEDED:
            if not any(values.get(key) for key in group):
                raise UserError(
                    f"{where}: the standard uncertainty (k=1) of the {cls.kind()} is missing: "
                    f"state {' or '.join(group)} above zero ({how.format(group[0])})"
                )

    @classmethod
    def check_stated(cls, table: Table, values: Mapping[str, float]) -> None:
        """UserError unless the header of a table states the standard uncertainties; `values` by header key."""
        cls.check_uncertainties(values, table.source, "header line '# {}: ...'")

    @classmethod
    def in_plane(cls, planar: bool) -> dict[str, int]:
        """The fields by which it observes in x and y only, where it has the choice."""
        return {}

    @classmethod
    def converted(cls, table: Table, machine: Machine) -> Table:
        """The table with one row for each observation."""
        return table

    @classmethod
    def refuse_other_files(cls, table: Table) -> None:
        """UserError for a file that only looks like one of its measurement files."""

    @classmethod
    def read_own(cls, table: Table) -> dict[str, Any]:
        """Its fields besides the uncertainties, from a table."""
        return {}

    @classmethod
    def read_targets(cls, table: Table) -> tuple[dict[str, Target], np.ndarray] | None:
        """The targets by name, and the name of the target of each row `(n,)`; None where the usual keys give them."""
        return None

    @classmethod
    def read_set_ups(cls, table: Table) -> tuple[dict[str, Vector], tuple[Distance, ...]]:
        """Stated centres of the balls on the table, mm, by the set-up, and calibrated distances between them."""
        return {}, ()

    @classmethod
    @abstractmethod
    def read_observed(cls, table: Table, machine: Machine, states: MeasurementStates) -> Array:
        """Observations `(n, components)`, mm; rad for angles."""

    def placed(self, measurement: Measurement, table: Table) -> Measurement:
        """The measurement of a table with what follows from a first registration."""
        return measurement

    @classmethod
    def in_order(cls, state: State) -> State:
        """The state with last moves and directions of approach, by the order of its rows."""
        return with_moves(state)

    @classmethod
    def own_velocities(cls, machine: Machine, state: State, feed: Array) -> Array | None:
        """Velocities `(n, axes)`, mm/s and rad/s, at feeds `(n,)`, mm/min; None where they follow from single moves."""
        return None

    def check_rows(self, table: Table, states: MeasurementStates) -> None:
        """UserError for rows whose quantity has no uncertainty."""

    def groups(self, measurement: Measurement) -> np.ndarray:
        """Name `(n,)` of the part of the registration that a row has: its set-up, `1` where none is named."""
        station = measurement.state.station
        return np.full(len(measurement), "1") if station is None else station.astype(str)

    def zero_names(self, measurement: Measurement) -> np.ndarray:
        """Name `(n,)` of the zero of each row among those of a registration: its set-up, where it has no other."""
        return measurement.groups

    def would_show(self, measurement: Measurement, effects: Sequence[Effect]) -> str:
        """The measurement by this instrument that would show errors which these data do not; empty for no advice."""
        return ""

    def header_lines(self, measurement: Measurement) -> Iterator[str]:
        """Header lines besides those of uncertainties and of usual targets, without `# `."""
        yield from ()

    @property
    def planar(self) -> bool:
        """True where it observes points in x and y only."""
        return False

    @property
    def moves(self) -> tuple[str, ...]:
        """Moves by which the pose of a set-up is unknown; empty where its observations have no pose."""
        return ()

    @property
    def least_errors(self) -> LeastErrors:
        """Least sizes of errors, where its observations leave some to the prior."""
        return LeastErrors()

    @property
    def length_u(self) -> float | None:
        """Standard uncertainty, mm, of the length that its readings contain; None where they contain none."""
        return None

    @property
    def fits_length(self) -> bool:
        """True where that length is not calibrated: only the fit determines it."""
        return False

    def errors_shown(self, measurement: Measurement, axis: str) -> ErrorsShown:
        """Errors of an axis that its observations may show."""
        return ErrorsShown(get_args(Component))

    @abstractmethod
    def first_registration(self, measurement: Measurement, trusted: np.ndarray) -> Registration:
        """A first registration, from the nominal machine and the rows in the mask `trusted` `(n,)`."""

    def last_visit(self, measurement: Measurement) -> np.ndarray:
        """Mask `(n,)` of the rows of the last cycle at the last set-up."""
        groups, cycle = measurement.groups, measurement.state.cycle
        last = groups == groups[-1]
        return np.asarray(last if cycle is None else last & (cycle == cycle[last][-1]))

    @abstractmethod
    def nominally_observed(
        self, measurement: Measurement, registration: Registration
    ) -> tuple[Measurement, Registration]:
        """The measurement with observations of the nominal machine, without zeros, and the registration of its rows.

        Zeros and slopes that the registration lacks are 0.
        """

    @abstractmethod
    def expected(self, measurement: Measurement, registration: Registration, effects: Observation) -> Array:
        """Expected observations `(n, d)`, mm and rad, in the components that count, with these effects; exact."""

    @abstractmethod
    def transform(self, measurement: Measurement, registration: Registration) -> Array:
        """Derivatives `(n, d, (axes + 1) * 6 + 3)`: by the error motions, and by the shift of the observed point.

        This is the transform that `ErrorModel.observation_design` expects.
        """

    @abstractmethod
    def registration_design(self, measurement: Measurement, registration: Registration) -> Array:
        """Derivatives `(n, d, parameters)` by the registration, at the machine's nominal points."""

    @abstractmethod
    def by_axes(self, measurement: Measurement, registration: Registration) -> Array:
        """Derivatives `(n, d, axes)` by the positions of the axes, per mm and rad."""

    def stated_residuals(self, measurement: Measurement, registration: Registration) -> Array:
        """Stated minus present values `(k,)` of the registration, in standard uncertainties; exact. Empty for most."""
        return np.zeros(0)

    def stated_design(self, measurement: Measurement, registration: Registration) -> Array:
        """Derivatives `(k, registration)` of the stated values by the registration, in standard uncertainties."""
        return np.zeros((0, len(registration.names)))

    @classmethod
    @abstractmethod
    def typical(cls) -> Self:
        """The instrument with the uncertainties that a virtual one has by default."""

    @classmethod
    def check_plan(cls, axis: np.ndarray | None, run: np.ndarray | None) -> None:
        """UserError for a plan that it cannot measure; `axis` and `run` `(n,)`: names, where the plan has them."""

    def readings_in(
        self, machine: Machine, axis: np.ndarray | None, rows: np.ndarray, wanted: Sequence[str] = ()
    ) -> PlannedReadings:
        """Its readings in rows `(k,)` of a plan.

        `axis` `(n,)`: names of the axes in a plan of single axes; `wanted`: letters of the error motions of linear
        axes, where these are chosen.
        """
        return PlannedReadings(np.arange(len(rows)))

    def planned(self, state: State) -> tuple[State, np.ndarray | None]:
        """The states of a plan as it observes them, and what the rows are `(n,)` where that differs from their run."""
        return state, None

    @abstractmethod
    def drawn_registration(
        self, blank: Measurement, poses: Mapping[str, Pose] | None, rng: np.random.Generator
    ) -> Registration:
        """The true registration of a virtual measurement, with stated or random poses; UserError if one is missing."""

    def aimed_at(self, blank: Measurement, registration: Registration) -> Array | None:
        """Nominal points `(n, 3)`, mm, in its frame, by which its own effects act; None where it observes no points."""
        return None

    def zeroed(self, blank: Measurement, exact: Array) -> Array:
        """Exact observations `(n, d)` as it displays them: some instruments are set to zero at the start of a run."""
        return exact

    def read_out(self, measurement: Measurement) -> Array:
        """Observations `(n, d)` rounded to its digits, far below its noise: 10 nm for lengths."""
        return np.round(measurement.observed, 5)

    @abstractmethod
    def row_covariances(self, measurement: Measurement) -> Array:
        """Covariances `(n, d, d)`, mm2 or rad2, of the components that count, by its specification."""

    @abstractmethod
    def observed_columns(self, measurement: Measurement) -> dict[str, np.ndarray]:
        """The columns of its observations, in the units of the file."""

    def file_columns(self, measurement: Measurement) -> dict[str, np.ndarray] | None:
        """All columns of its file, where a row of the file is not one observation; None for most."""
        return None

    def shared(self, others: Sequence[InstrumentBase]) -> Self:
        """The instrument of all files where these have others; itself unless uncertainties stand in the rows."""
        return self

    def other_readings(self, measurement: Measurement) -> Iterator[tuple[str, Measurement]]:
        """The measurement with each likely mistake in its readings reversed, after words for it; none for most."""
        yield from ()


def along_itself(effect: Effect) -> bool:
    """True for the positioning error of a linear axis; a path may not determine a function common to all of them."""
    return effect.OF_ISO_230 and effect.part == "own" and not effect.angular


def axes_of(effects: Sequence[Effect]) -> set[str]:
    """Names of the axes of effects."""
    return {axis for effect in effects if (axis := getattr(effect, "axis", None))}
