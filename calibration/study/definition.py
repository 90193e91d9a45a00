"""The study as a file (TOML, contract 4.2): machine, draws, instrument, errors, fit, and its cases."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from calibration.design.layout import Weighting
from calibration.instruments import Instrument
from calibration.measurement.tracker_tests import fit_tests, read_tests
from kinematics.files import read_input
from kinematics.files.toml_entries import at_line, entry, read_table, utf8_text
from kinematics.user_error import UserError

Positive = Annotated[float, msgspec.Meta(gt=0)]
Triple = tuple[float, float, float]
Range = tuple[float, float]
SPHERES_BY_DEFAULT = 3
"""Number of spheres of a touch probe, where the case states none."""


class InstrumentEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The instrument: standard uncertainties (k=1) by their keys in a measurement file, and its reach."""

    kind: Literal["laser-tracker", "ranging", "interferometer", "part", "touch-probe"] = "laser-tracker"
    u_range_um: float | None = None
    u_range_um_per_m: float | None = None
    u_angle_um: float | None = None
    u_angle_um_per_m: float | None = None
    u_um: float | None = None
    u_um_per_m: float | None = None
    tests: str | None = None
    """File of a laser tracker's tests (ASME B89.4.19), from which its uncertainties are fitted."""
    planar: bool = False
    elevation: Range | None = None
    incidence_deg: Positive | None = None
    range_mm: Positive | None = None
    temperature: dict[str, Range] = {}
    """Temperatures, degC, at the start and at the end, by sensor."""


class ErrorsEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The errors of the virtual machines."""

    model: Literal["fourier", "table-1", "none"] = "table-1"
    half_widths: str | dict[str, tuple[float, ...]] | None = None
    """`table-1`, the path of a table, or rows E_XX = [a0, a1, n1, b1, c1, ...] by error motion, um and urad."""
    location: Annotated[float, msgspec.Meta(ge=0)] = 0.0
    """Half-width of the location errors of rotary axes and of squareness, um and urad."""
    effects: tuple[str, ...] = ()
    """Effects whose amplitudes are uniform between plus and minus the given ones."""
    fixed: tuple[str, ...] = ()
    """Effects that are the same in every draw; also a calibration, `cal.json`."""


class FitEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The fit of the measurement."""

    basis: str = "auto"
    """Basis, as in `ncomp fit`: auto, KIND:SIZE, or X=KIND:SIZE,Y=..."""
    weighting: Weighting = "full"
    prior: Literal["auto", "none"] | Positive = "auto"
    """Standard deviation, um and urad, of the parameters of error motions; auto: by the data, or 30."""
    effects: tuple[str, ...] = ()
    """Effects that are fitted in addition to the error motions."""


class CaseEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One method to measure."""

    name: str
    strategy: str
    points: int | tuple[int, ...] | None = None
    spacing_mm: Positive | None = None
    tracker: tuple[float | Triple, ...] = ()
    """Position of the tracker, mm: [x, y, z], or several of these, one for each station."""
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
    """Largest incidence, degrees, instead of the instrument's; 180 for an active reflector."""
    stations: Annotated[int, msgspec.Meta(ge=1)] | None = None
    """Number of stations of an optimised plan, chosen among `tracker`; without it that of the instrument."""
    targets: Annotated[int, msgspec.Meta(ge=1)] | None = None
    """Number of tools of an optimised plan, chosen among `tools`; without it all."""
    minutes: Positive | None = None
    """Duration, min, of an optimised plan, instead of points; candidates, obstacles and visible are for it too."""
    candidates: Annotated[int, msgspec.Meta(ge=100, le=20_000)] = 2000
    obstacles: tuple[dict[str, Range], ...] = ()
    """Boxes in the workpiece frame, ranges of x, y, z in mm."""
    visible: tuple[str, ...] = ()
    """Required effects: the measurement has to show them."""
    fit: FitEntry | None = None
    instrument: InstrumentEntry | None = None
    """Another instrument than that of the study."""
    spheres: dict[str, Triple] | Annotated[int, msgspec.Meta(ge=1)] = SPHERES_BY_DEFAULT
    """Spheres of a touch probe: centres by name, mm, workpiece frame with all axes at 0; or their number."""
    distances: dict[str, Positive] = {}
    """Standard uncertainties, um, of calibrated distances between two spheres, s1.s2."""


class StudyEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The content of the file."""

    machine: str
    case: Annotated[tuple[CaseEntry, ...], msgspec.Meta(min_length=1)]
    draws: Annotated[int, msgspec.Meta(ge=2)] | Literal["adaptive"] = 200
    tolerance_um: Positive = 0.1
    """Tolerance, um, to which the results of an adaptive study converge."""
    most_draws: Annotated[int, msgspec.Meta(ge=2)] = 100_000
    seed: Annotated[int, msgspec.Meta(ge=0)] = 0
    check_draws: Annotated[int, msgspec.Meta(ge=0)] = 2
    """Draws of each case that are also fitted by the exact kinematics."""
    description: str = ""
    instrument: InstrumentEntry = InstrumentEntry(u_range_um_per_m=0.25, u_angle_um=10.0, u_angle_um_per_m=2.5)
    errors: ErrorsEntry = ErrorsEntry()
    fit: FitEntry = FitEntry()
    volume: dict[str, Range] = {}
    """Ranges of axes, mm and degrees, in which machines are evaluated, instead of the travel and the plan's ranges."""
    common: dict[str, Any] = {}
    """Keys of a case that hold for every case that does not contain them."""


def read_study(path: Path) -> StudyEntry:
    """The study in a TOML file; UserError, with file and key, for an entry that cannot be used."""
    where = f"study {path}"
    text = utf8_text(read_input(path, "study"), where)
    content = read_table(text, where)
    if "case" not in content:
        raise UserError(f"{where}: case is missing: write [[case]] with name, strategy and points")
    try:
        return _study(content)
    except UserError as fault:
        raise at_line(text, where, fault) from None


def study_of(content: dict[str, Any], where: str) -> StudyEntry:
    """The study in a table; `where` names it in messages."""
    try:
        return _study(content)
    except UserError as fault:
        raise UserError(f"{where}: {fault}") from None


def _study(content: dict[str, Any]) -> StudyEntry:
    """The study in a table; messages begin with the path of the wrong entry."""
    content = _with_rows(content)
    common, cases = content.get("common", {}), content.get("case", [])
    if isinstance(common, dict) and isinstance(cases, list):
        content["case"] = [{**common, **case} if isinstance(case, dict) else case for case in cases]
    study = entry(content, StudyEntry)
    names = [case.name for case in study.case]
    for name in names:
        if names.count(name) > 1:
            raise UserError(f"case: two cases have the name {name!r}")
        if not name.strip() or any(letter in name for letter in ',"\r\n'):
            raise UserError(f"case: the name {name!r} of a case must not contain commas, quotes or line breaks")
    return study


def _with_rows(content: dict[str, Any]) -> dict[str, Any]:
    """The content, with the rows of error motions directly in [errors] moved to its half-widths."""
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
    """The instrument, its tests relative to `folder`; UserError for unknown or missing uncertainties."""
    from calibration.instruments import KINDS

    kind = KINDS[entry.kind]
    known = kind.uncertainty_keys()
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
    kind.check_uncertainties(given, f"{where}: [instrument]", "{} = ...")
    instrument: Instrument = msgspec.convert({"kind": entry.kind, **given, **kind.in_plane(entry.planar)}, Instrument)
    return instrument
