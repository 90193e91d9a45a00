"""Fixtures shared by all tests, and what needs a program or data that may be absent."""

import gc
import os
from collections.abc import Callable, Generator, Iterator
from contextlib import nullcontext, suppress
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import NoReturn

os.environ["COLUMNS"] = "200"  # consoles take their width once, when they are imported

import hypothesis
import pytest
from clients import chromium as browsers
from clients import freecad as freecad_posts
from clients import klipper as klipper_code
from clients import linuxcnc_sim as simulator
from clients import postgresql, rs274
from support.command import Done, run_command
from support.file_examples import PROGRAM
from support.programs import load, shifted
from support.real_data import NC_DATA, REAL_DATA
from support.table_cases import few_positions

from kinematics.error_model.model import write_model

hypothesis.settings.register_profile("default", deadline=None)
hypothesis.settings.register_profile("ci", deadline=None, derandomize=True)
hypothesis.settings.load_profile("default")  # or --hypothesis-profile=ci


TIERS = {"unit", "integration", "statistical", "exam"}
WHOLE_TIERS = {"statistical", "exam"}
"""Tiers of tests that take their time."""
LINUXCNC = {"linuxcnc", "linuxcnc_sim"}
INTEGRATION = {
    "command", "ncomp", "nc_data", "plates", "slit_log", "ecmc_report", "scope_log", "chromium", "freecad", "klipper",
    "postgres_server",
    *LINUXCNC,
}  # fmt: skip
"""A test with one of these fixtures is an integration test, unless it is marked as statistical or exam."""
INTEGRATION_MODULES = {
    "test_bad_data", "test_blas", "test_chunks", "test_cli", "test_compensate", "test_conditions",
    "test_continuous", "test_control_state", "test_dependence", "test_diagnosis_exam", "test_diagnosis_frame",
    "test_diagnosis_left", "test_diagnosis_page", "test_docs_commands", "test_docs_controls", "test_docs_pages", "test_diagnosis_scans", "test_diagnosis_selection",
    "test_direction", "test_distance_correlation", "test_encodings", "test_error_transform", "test_evidence", "test_file_faults",
    "test_fit", "test_fit_edges", "test_fuzz", "test_generated_programs", "test_golden", "test_held_out_lines", "test_history", "test_history_trends", "test_hooks", "test_in_place",
    "test_iso_coordinates", "test_iterations", "test_jumping_errors", "test_klartext_arcs",
    "test_klartext_generated", "test_klartext_job", "test_klartext_polar", "test_model", "test_mutations",
    "test_never_worse", "test_next_measurement", "test_nothing_shared", "test_on_the_fly", "test_on_the_fly_plan", "test_own_output",
    "test_optimal", "test_pipeline", "test_referees", "test_plain_lines", "test_public_evaluations", "test_public_functions",
    "test_public_interface", "test_python_mistakes", "test_sessions", "test_reported_corrections", "test_sanity", "test_scenarios",
    "test_siemens_mixed", "test_simulate", "test_six_degrees", "test_splitting", "test_standstill",
    "test_stored_programs", "test_strange_ground", "test_strategies", "test_study", "test_suspects",
    "test_swivel_to_zero", "test_tables", "test_tables_golden", "test_tables_nodes", "test_tables_siemens",
    "test_tables_waves", "test_diagnosis_answer", "test_three_dialects", "test_three_points", "test_tool_vectors", "test_tracker_tests",
    "test_turned_frames", "test_turns_of_arcs", "test_unnamed", "test_virtual_machine", "test_whiteness",
}  # fmt: skip
"""So is every test of these modules: whole commands, processes, corrections, fits, diagnoses, plans and tables."""


@pytest.hookimpl(wrapper=True, trylast=True)
def pytest_collection(session: pytest.Session) -> Generator[None, object, object]:
    """Search for no garbage while the tests are collected, nor later among the modules and the collected tests."""
    gc.disable()
    try:
        if session.config.args_source is session.config.ArgsSource.TESTPATHS and _worker() % 2:
            _import_from_the_last()
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def _worker() -> int:
    """Number of this process among those that run the tests."""
    return int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))


def _import_from_the_last() -> None:
    """Import the modules of tests in reverse order: in a fresh clone each of two workers compiles half of them.

    What a module cannot be imported for is told when it is collected.
    """
    for path in sorted(Path(__file__).parent.glob("test_*.py"), reverse=True):
        with suppress(Exception, pytest.skip.Exception):
            import_module(path.stem)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put every test in one tier, and mark those that need LinuxCNC: `-m "not linuxcnc"` leaves them out."""
    for item in items:
        fixtures = set(getattr(item, "fixturenames", ()))
        marked = TIERS & {marker.name for marker in item.iter_markers()}
        if len(marked) > 1:
            raise pytest.UsageError(f"{item.nodeid} is marked as {' and '.join(sorted(marked))}: one tier is expected")
        if not marked:
            whole = fixtures & INTEGRATION or item.path.stem in INTEGRATION_MODULES
            item.add_marker("integration" if whole else "unit")
        if fixtures & LINUXCNC:
            item.add_marker("linuxcnc")


class FailuresAtOnce:
    """Prints the name of each test that fails when it fails: a run that is killed later has named it."""

    def __init__(self, terminal: pytest.TerminalReporter) -> None:
        self.terminal = terminal

    @pytest.hookimpl(trylast=True)
    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """A line for a failed set-up, call or tear-down, with the error in short."""
        if report.failed:
            crash = getattr(report.longrepr, "reprcrash", None)
            error = crash.message.partition("\n")[0] if crash else report.longreprtext.strip().rpartition("\n")[2]
            self.terminal.write(f"\nFAILED {report.nodeid} - {error}\n", flush=True, red=True)


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    """Name failures at once where results are printed, which is not in the workers."""
    terminal = config.pluginmanager.get_plugin("terminalreporter")
    if terminal is not None and not hasattr(config, "workerinput"):
        config.pluginmanager.register(FailuresAtOnce(terminal))


@pytest.fixture(scope="session")
def linuxcnc() -> ModuleType:
    """LinuxCNC's interpreter. Where it is missing the test is skipped, or fails if NCOMP_REQUIRE_CLIENTS is set."""
    if not rs274.available():
        _missing("LinuxCNC's rs274")
    return rs274


@pytest.fixture(scope="session")
def linuxcnc_sim() -> ModuleType:
    """LinuxCNC's simulator; skipped or failed where it is missing, like `linuxcnc`."""
    if not simulator.available():
        _missing("LinuxCNC's simulator")
    return simulator


@pytest.fixture(scope="session")
def freecad() -> ModuleType:
    """FreeCAD without a window; skipped or failed where it is missing, like `linuxcnc`."""
    if not freecad_posts.available():
        _missing("FreeCAD", "freecad-python3")
    return freecad_posts


@pytest.fixture(scope="session")
def klipper() -> ModuleType:
    """Klipper's own code; skipped or failed where it is missing, like `linuxcnc`."""
    if not klipper_code.available():
        _missing("Klipper's code", "libusb-dev, then .ci/run makes .klippy")
    return klipper_code


@pytest.fixture(scope="module")
def chromium() -> Iterator[browsers.Chromium]:
    """A browser; skipped or failed where it is missing, like `linuxcnc`."""
    if not browsers.available():
        _missing("Chromium with its driver", "chromium chromium-driver")
    browser = browsers.Chromium()
    yield browser
    browser.close()


@pytest.fixture(scope="session")
def postgres_server() -> Iterator[postgresql.Server]:
    """A server of PostgreSQL with a data folder of its own; skipped or failed where it is missing, like `linuxcnc`."""
    if not postgresql.available():
        _missing("PostgreSQL", "postgresql")
    server = postgresql.Server()
    yield server
    server.close()


def _missing(client: str, package: str = "linuxcnc-uspace") -> NoReturn:
    reason = f"{client} is missing (Debian: apt-get install --no-install-recommends {package})"
    if os.environ.get("NCOMP_REQUIRE_CLIENTS"):
        pytest.fail(f"{reason}, and NCOMP_REQUIRE_CLIENTS is set")
    pytest.skip(reason)


@pytest.fixture(scope="session")
def nc_data() -> Path:
    """Folder of NC programs from real controls and CAM systems, in iso/, siemens/ and heidenhain/."""
    if not NC_DATA.is_dir():
        pytest.skip("the collection of real NC programs (../shared/data/nc) is not beside this repository")
    return NC_DATA.resolve()


@pytest.fixture(scope="session")
def plates() -> Path:
    """Folder of real plug plates, machined and then measured on a coordinate measuring machine."""
    folder = REAL_DATA / "plug_plates"
    if not folder.is_dir():
        pytest.skip("the real plug plates (../shared/data/plug_plates) are not beside this repository")
    return folder.resolve()


@pytest.fixture(scope="session")
def slit_log() -> Path:
    """The real log of a linear axis at constant velocity: its steps, and its resolver."""
    path = REAL_DATA / "slit_axis" / "axis1_resolver_openloop.log"
    if not path.is_file():
        pytest.skip("the real slit axis (../shared/data/slit_axis) is not beside this repository")
    return path.resolve()


@pytest.fixture(scope="session")
def ecmc_report() -> Path:
    """The real report of an ISO 230-2 test: 9 targets, 5 cycles, both directions."""
    return _real_file("iso230/x_iso230_2_report.md")


@pytest.fixture(scope="session")
def scope_log() -> Path:
    """The real log of TwinCAT Scope: a turn out and back, its count and a resolver."""
    return _real_file("resolver/ResolverCiclicError2.csv")


def _real_file(name: str) -> Path:
    path = REAL_DATA / name
    if not path.is_file():
        pytest.skip(f"real data (../shared/data/{name}) are not beside this repository")
    return path.resolve()


@pytest.fixture(name="few_positions")
def _few_positions(request: pytest.FixtureRequest) -> Iterator[None]:
    """Tables of controls from few positions, for tests of anything but their accuracy; not in the statistical tier and in exams."""
    whole = WHOLE_TIERS & {marker.name for marker in request.node.iter_markers()}
    with nullcontext() if whole else few_positions():
        yield


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., Done]:
    """Runs the command line in this process, in a folder of its own; `stdin=` is its standard input."""
    monkeypatch.chdir(tmp_path)
    return run_command


@pytest.fixture
def ncomp(command: Callable[..., Done], tmp_path: Path) -> Callable[..., Done]:
    """The command line, in a folder of its own that holds a program (in.nc) and a calibration (cal.json)."""
    (tmp_path / "in.nc").write_text(PROGRAM)
    write_model(shifted(load("gantry"), X=-10.0), tmp_path / "cal.json")
    return command
