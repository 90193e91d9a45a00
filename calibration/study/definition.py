"""The study as a file (TOML, contract 4.2): machine, draws, instrument, errors, fit, and its cases."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from calibration.design.layout import Weighting
from calibration.measurement.instruments import Instrument
from calibration.measurement.tracker_tests import fit_tests, read_tests
from kinematics.files import read_input
from kinematics.user_error import UserError

Positive = Annotated[float, msgspec.Meta(gt=0)]
Triple = tuple[float, float, float]
Range = tuple[float, float]


class InstrumentEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What measures; standard uncertainties (k=1) by their keys in a measurement file, and what it can reach."""

    kind: Literal["laser-tracker", "interferometer", "part"] = "laser-tracker"
    u_range_um: float | None = None
    u_range_um_per_m: float | None = None
    u_angle_um: float | None = None
    u_angle_um_per_m: float | None = None
    u_um: float | None = None
    u_um_per_m: float | None = None
    tests: str | None = None
    """File of a laser tracker's tests (ASME B89.4.19) that its uncertainties are fitted to."""
    planar: bool = False
    elevation: Range | None = None
    incidence_deg: Positive | None = None
    range_mm: Positive | None = None
    temperature: dict[str, Range] = {}
    """By sensor, degC at the start and at the end."""


class ErrorsEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the virtual machines err by."""

    model: Literal["fourier", "table-1", "none"] = "table-1"
    half_widths: str | dict[str, tuple[float, ...]] | None = None
    """`table-1`, the path of a table, or rows E_XX = [a0, a1, n1, b1, c1, ...] by error motion, um and urad."""
    effects: tuple[str, ...] = ()
    """Amplitudes uniform between plus and minus what stands here."""
    fixed: tuple[str, ...] = ()
    """Effects of every draw alike; also a calibration, `cal.json`."""


class FitEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the measurement is fitted."""

    basis: str = "auto"
    """As in `ncomp fit`: auto, auto:KIND, KIND:SIZE, or X=KIND:SIZE,Y=..."""
    weighting: Weighting = "full"
    prior: Literal["auto", "none"] | Positive = "auto"
    """Standard deviation, um and urad, of the parameters of error motions; auto: by evidence, or 30."""
    effects: tuple[str, ...] = ()
    """Fitted besides the error motions."""


class CaseEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One way to measure."""

    name: str
    strategy: str
    points: int | tuple[int, ...] | None = None
    spacing_mm: Positive | None = None
    tracker: tuple[float | Triple, ...] = ()
    """Where it stands, mm: [x, y, z], or several of these, one for each station."""
    tools: dict[str, Triple] | tuple[Triple, ...] = ()
    planes_at: float = 1.0
    ranges: dict[str, Range] = {}
    margin_mm: float = 0.0
    rotary: str = "fixed"
    rotary_points: int = 13
    order: str = "given"
    approach: str = "any"
    overrun: float = 1.0
    runs: int = 1
    references: int = 0
    target_order: str = "in-turn"
    point_s: Positive = 15.0
    setup_min: float = 20.0
    dwell_s: float | None = None
    feed: Positive | None = None
    elevation: Range | None = None
    incidence_deg: Positive | None = None
    """Above those of the instrument, where they differ from case to case; 180 for an active reflector."""
    minutes: Positive | None = None
    """Of an optimised strategy, instead of points; as all that follow."""
    candidates: Annotated[int, msgspec.Meta(ge=100, le=20_000)] = 2000
    obstacles: tuple[dict[str, Range], ...] = ()
    """Boxes in the workpiece frame, ranges of x, y, z in mm."""
    visible: tuple[str, ...] = ()
    """Effects that the measurement has to show."""
    fit: FitEntry | None = None


class StudyEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The whole file."""

    machine: str
    case: Annotated[tuple[CaseEntry, ...], msgspec.Meta(min_length=1)]
    draws: Annotated[int, msgspec.Meta(ge=2)] | Literal["adaptive"] = 200
    tolerance_um: Positive = 0.1
    """Of an adaptive study: to how much the results shall have settled."""
    most_draws: Annotated[int, msgspec.Meta(ge=2)] = 100_000
    seed: Annotated[int, msgspec.Meta(ge=0)] = 0
    check_draws: Annotated[int, msgspec.Meta(ge=0)] = 2
    """Draws of each case that are also fitted by the exact kinematics."""
    description: str = ""
    instrument: InstrumentEntry = InstrumentEntry(u_range_um_per_m=0.25, u_angle_um=10.0, u_angle_um_per_m=2.5)
    errors: ErrorsEntry = ErrorsEntry()
    fit: FitEntry = FitEntry()
    common: dict[str, Any] = {}
    """Keys of a case that hold for every case that does not say otherwise."""


def read_study(path: Path) -> StudyEntry:
    """The study in a TOML file; UserError, naming file and key, for what can't be used."""
    where = f"study {path}"
    try:
        content = tomllib.loads(read_input(path, "study").decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as fault:
        raise UserError(f"{where}: {fault}") from None
    return study_of(content, where)


def study_of(content: dict[str, Any], where: str) -> StudyEntry:
    """The study that a table says; `where` names it in messages."""
    content = _with_rows(content)
    common, cases = content.get("common", {}), content.get("case", [])
    if isinstance(common, dict) and isinstance(cases, list):
        content["case"] = [{**common, **case} if isinstance(case, dict) else case for case in cases]
    try:
        study = msgspec.convert(content, StudyEntry)
    except msgspec.ValidationError as fault:
        raise UserError(f"{where}: {fault}") from None
    names = [case.name for case in study.case]
    for name in names:
        if names.count(name) > 1:
            raise UserError(f"{where}: two cases are named {name!r}")
        if not name.strip() or any(letter in name for letter in ',"\r\n'):
            raise UserError(f"{where}: {name!r} can't stand in a table: no commas, quotes or line breaks")
    return study


def _with_rows(content: dict[str, Any]) -> dict[str, Any]:
    """The content with the rows of error motions that stand in [errors] itself as its half-widths."""
    errors = content.get("errors")
    if isinstance(errors, str):
        return {**content, "errors": {"model": errors}}
    if not isinstance(errors, dict):
        return dict(content)
    known = ErrorsEntry.__struct_fields__
    rows = {key: row for key, row in errors.items() if key not in known and key.upper().startswith("E")}
    if not rows:
        return dict(content)
    rest = {key: value for key, value in errors.items() if key not in rows}
    return {**content, "errors": {"model": "fourier", **rest, "half_widths": rows}}


def instrument_of(entry: InstrumentEntry, where: str, folder: Path) -> Instrument:
    """The instrument, its tests relative to `folder`; UserError for uncertainties that it does not have, or none."""
    from calibration.measurement.file import KINDS, check_uncertainties, uncertainty_keys

    known = uncertainty_keys(KINDS[entry.kind])
    keys = [key for key in entry.__struct_fields__ if key.startswith("u_")]
    given = {key: value for key in keys if (value := getattr(entry, key)) is not None}
    if entry.tests is not None:
        if given or entry.kind != "laser-tracker":
            raise UserError(
                f"{where}: [instrument] tests: only for a laser tracker and without u_range_um and the other "
                "uncertainties: delete either"
            )
        return fit_tests(read_tests(folder / entry.tests)).instrument
    for key, value in given.items():
        if key not in known:
            raise UserError(f"{where}: [instrument] {key}: {entry.kind} has {', '.join(known)}")
        if value < 0:
            raise UserError(f"{where}: [instrument] {key} = {value:g} is negative")
    check_uncertainties(entry.kind, given, f"{where}: [instrument]", "{} = ...")
    components = {"components": 2 if entry.planar else 3} if entry.kind == "part" else {}
    instrument: Instrument = msgspec.convert({"kind": entry.kind, **given, **components}, Instrument)
    return instrument
