"""Virtual calibration: equations against fits by the exact kinematics, the same draws however they are spread, refusals."""

import csv
import json
import os
import re
import signal
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import strategies as st
from support.file_examples import STUDY
from support.pages import figures
from support.tiers import drawn, quick

import machines
from calibration.design.equations import Sample
from calibration.design.random_machines import TrueModels
from calibration.evaluation.volumetric import deviation_on, volumetric_error_um
from calibration.fit.calibrate import calibrate
from calibration.fit.datum import about_own_points
from calibration.fit.fit import fit
from calibration.observation.full_model import parse_basis, with_effects
from calibration.simulation.true_model import TABLE_1
from calibration.study.cases import Case, read_cases
from calibration.study.chunks import DRAWS_OF_CHUNK, Chunk, Prepared
from calibration.study.definition import study_of
from calibration.study.exact import compared, measurement_of
from calibration.study.run import Draws, Result, run
from calibration.study.spread import workers
from calibration.study.stopping import enough, estimates
from calibration.study.store import Store
from kinematics.deviation import exact_deviation
from kinematics.error_model.model import write_model
from kinematics.forward import tool_point
from kinematics.running.workers import Team
from kinematics.state import State
from kinematics.user_error import UserError

EXAMPLES = Path(__file__).parents[1] / "examples" / "studies"
PAPER = {"basis": "legendre:6", "weighting": "cartesian-diagonal", "prior": "none"}
GANTRY = {"name": "case", "strategy": "hexahedron", "points": 120, "tracker": [-1500, 1500, 300]}
TOOLS = [[0, 0, -150], [110, 60, -220], [-90, 100, -120]]
C_FRAME = {
    "machine": "cframe",
    "instrument": {"u_range_um_per_m": 0.5, "u_angle_um": 3.0, "u_angle_um_per_m": 2.0},
    "fit": {"basis": "cubic:5", "prior": 30.0},
    "case": [{"name": "c", "strategy": "grid", "points": 80, "tracker": [-1200, -900, 300], "tools": TOOLS}],
}


def case_of(content: dict) -> Case:
    return read_cases(study_of({"machine": "gantry", "seed": 3, **content}, "test"), Path())[0]


def paper_case(**changes) -> Case:
    return case_of({"fit": PAPER, "case": [{**GANTRY, **changes}]})


def results(cases: list[Case], draws: Draws | int, team=None, store: Store | None = None, **more) -> list[Result]:
    number = Draws(draws) if isinstance(draws, int) else draws
    with nullcontext(team) if team else workers(1, None) as its:
        return run(cases, number, its, store or Store(None), **more)


# ---- the equations


@pytest.mark.parametrize(
    "content",
    [
        {"fit": PAPER, "case": [{**GANTRY, "points": 400}]},
        C_FRAME,
        {
            "machine": "dmu50",
            "fit": {"basis": "X=cubic:4,Y=cubic:4,Z=cubic:4,B=fourier:2,C=fourier:2"},
            "case": [
                {"name": "five axes", "strategy": "random", "points": 150, "rotary": "random", "tools": TOOLS,
                 "ranges": {"C": [0, 360]}, "tracker": [[-1500, -800, 400], [1500, -900, 300]]}
            ],
        },
        {
            "machine": "gantry",
            "instrument": {"kind": "interferometer", "u_um": 0.3, "u_um_per_m": 0.5},
            "fit": {"basis": "cubic:6"},
            "case": [{"name": "laser", "strategy": "axes", "spacing_mm": 250}],
        },
        {
            "machine": "cframe",
            "instrument": {"kind": "part", "u_um": 2.0},
            "fit": {"basis": "cubic:3", "effects": ["backlash:axis=X,width=0"]},
            "errors": {"effects": ["backlash:axis=X,width=12"]},
            "case": [{"name": "part", "strategy": "grid", "points": 90, "order": "shuffled"}],
        },
    ],
    ids=["gantry", "three tools", "five axes", "interferometer", "part"],
)  # fmt: skip
def test_linear_equations_agree_with_exact_kinematics(content):
    found = compared(Prepared.of(case_of(content)), 3)
    assert np.all(found.linear > 0)
    assert found.difference < 1e-3 * found.exact.mean()


def test_a_draw_is_what_the_fit_of_its_measurement_is():
    """The same noise through `calibration.fit.fit`, which shares neither factorisation nor elimination with a study."""
    ready = Prepared.of(case_of(C_FRAME))
    drawn = ready.sample(Chunk(0, 2))
    (parts, scales), _ = next(iter(ready.choices(drawn).items()))
    left = ready.fits.errors(parts, ready.fitted(parts, scales, drawn, np.arange(2)), drawn.coefficients)[0]
    nominal, volume = ready.setup.measurement, ready.case.volumes[0]
    for number in range(2):
        truth, measured = (
            ready.case.true_models.machine(drawn.coefficients[:, number]),
            measurement_of(ready, drawn, number),
        )
        model, prior = with_effects(measured, dict.fromkeys("XYZ", parse_basis("cubic:5")), (), 1.0)
        found = fit(measured, model, prior=prior)
        assert found.kept.all()
        wanted, points = deviation_on(nominal.machine, truth, volume.state.positions, TOOLS[0])
        got, _ = deviation_on(nominal.machine, found.model, volume.state.positions, TOOLS[0])
        assert volumetric_error_um(wanted - got, points).rms == pytest.approx(left[number], rel=2e-3)


SPHERES = {
    "machine": "dmu50",
    "instrument": {"kind": "touch-probe", "u_um": 1.0},
    "errors": {"location": 50, "E_XX": [0, 90], "E_YY": [0, 90], "E_ZZ": [0, 90]},
    "fit": {"basis": "X=legendre:1,Y=legendre:1,Z=legendre:1,B=fourier:1,C=fourier:1", "prior": 30.0},
    "volume": {"X": [-150, 150], "Y": [-150, 150], "Z": [100, 350], "B": [0, 110], "C": [0, 360]},
}
GRID_OF_SPHERES = {"strategy": "grid", "points": 16}
DESIGNS = [
    {**GRID_OF_SPHERES, "name": "one", "spheres": {"s1": [130, 20, 60]}},
    {**GRID_OF_SPHERES, "name": "three"},
    {**GRID_OF_SPHERES, "name": "three with distances", "distances": {"s1.s2": 0.5, "s3.s1": 0.5}},
]


@pytest.mark.statistical
def test_spheres_at_calibrated_distances_leave_least_and_one_sphere_most():
    """Without a distance the common scale of the linear axes remains, as the notes state."""
    found = results(read_cases(study_of({**SPHERES, "case": DESIGNS}, "test"), Path()), 30, check_draws=2)
    one, three, with_distances = (each.after[0].mean() for each in found)
    assert with_distances < 0.5 * three
    assert three < 0.9 * one < 0.9 * found[0].before[0].mean()
    scale = "E_XX and E_YY and E_ZZ"
    assert [any(scale in note for note in each.notes) for each in found] == [True, True, False]
    assert all(each.check.difference < 1e-3 * each.check.exact.mean() for each in found)


@pytest.mark.parametrize("design", quick(DESIGNS, DESIGNS[-1:]), ids=[design["name"] for design in DESIGNS])
def test_draws_scatter_as_the_law_of_propagation(design):
    """Mean square of the remaining error over draws against the exact propagation of errors and noise (GUM, 5.1)."""
    ready = Prepared.of(case_of({**SPHERES, "case": [design]}))
    parts, ones = ready.parts, np.eye(len(ready.case.true_models.low))
    fitted = ready.fits.columns.evaluated(ready.fits.columns.model(parts))

    def remaining(true: np.ndarray, observed: np.ndarray) -> np.ndarray:
        right = np.concatenate([ready.fits.right(part, Sample(true, observed, None, None)) for part in parts])
        return ready.fits.true_volume @ true - fitted @ ready.fits.factorised(parts, ready.sizes).solve(right)

    true_models, rows = ready.case.true_models, len(ready.fits.true_observed)
    by_errors = remaining(ones, ready.fits.true_observed) * (true_models.high - true_models.low) / np.sqrt(12.0)
    by_noise = remaining(np.zeros((len(ones), rows)), np.eye(rows))
    expected = (np.sum(by_errors**2) + np.sum(by_noise**2)) / (len(fitted) / 3)
    squares = np.concatenate([ready.outcome(Chunk(k, DRAWS_OF_CHUNK)).after[0] ** 2 for k in range(20)])
    assert abs(squares.mean() - expected) < 4.0 * squares.std() / np.sqrt(len(squares))


STATIONS = [[-1500, 1500, 300], [1500, -1500, 300], [4000, 1500, 300], [1500, 4500, 300]]


def on_diagonals(**changes) -> Prepared:
    """Eighty points of the four space diagonals."""
    return Prepared.of(
        case_of({"seed": 1, "case": [{**GANTRY, "strategy": "space-diagonals", "points": 80, **changes}]})
    )


BACKLASH = {"fit": {"effects": ["backlash:axis=X,width=0"]}, "errors": {"effects": ["backlash:axis=X,width=12"]}}
LINES = {"strategy": "space-diagonals"}
ALIKE = {
    "hexahedron": {"seed": 4, "case": [{**GANTRY, "points": 90}]},
    "an effect besides, three tools": {**C_FRAME, **BACKLASH, "fit": {**BACKLASH["fit"], "basis": "auto"}},
    "four stations": {"seed": 2, "case": [{**GANTRY, **LINES, "points": 80, "tracker": STATIONS}]},
    "part": {
        "machine": "cframe",
        "instrument": {"kind": "part", "u_um": 2.0},
        **BACKLASH,
        "case": [{"name": "part", "strategy": "grid", "points": 90, "order": "shuffled"}],
    },
    "five axes": {
        "machine": "dmu50",
        "case": [
            {"name": "five axes", "strategy": "random", "points": 120, "rotary": "random", "tools": TOOLS,
             "ranges": {"C": [0, 360]}, "tracker": [[-1500, -800, 400], [1500, -900, 300]]}
        ],
    },
}  # fmt: skip


@pytest.mark.parametrize("name", quick(ALIKE, ["hexahedron", "part"], set(ALIKE) - {"hexahedron", "part"}))
def test_a_draw_with_automatic_bases_is_what_the_calibration_by_its_measurement_is(name):
    """Whose noise and outliers are found too."""
    ready = Prepared.of(case_of(ALIKE[name]))
    drawn = ready.sample(Chunk(0, 2))
    choices = list(ready.choices(drawn).items())
    assert [draws.tolist() for _, draws in choices] == [[0], [1]]
    nominal, volume = ready.setup.measurement, ready.case.volumes[0]
    for (parts, sizes), draws in choices:
        fitted = ready.fitted(parts, sizes, drawn, draws)
        left = ready.fits.errors(parts, fitted, drawn.coefficients[:, draws])[0, 0]
        truth = ready.case.true_models.machine(drawn.coefficients[:, draws[0]])
        measured = measurement_of(ready, drawn, int(draws[0]))
        found = calibrate(measured, effects=ready.case.other_effects, hold_out=False)
        machine, q = nominal.machine, volume.state.positions
        wanted, got = (
            exact_deviation(machine, q, model.errors(machine, volume.state), volume.tool).position
            for model in (truth, found.model)
        )
        points = tool_point(machine, q, volume.tool)
        assert volumetric_error_um(wanted - got, points).rms == pytest.approx(left, rel=0.15)


@pytest.mark.statistical
@pytest.mark.parametrize("changes", [{}, {"tracker": STATIONS}], ids=["one station", "four stations"])
def test_on_diagonals_less_than_half_of_the_errors_is_left(changes):
    outcome = on_diagonals(**changes).outcome(Chunk(0, 20))
    before, after = (np.quantile(x[0], 0.95) for x in (outcome.before, outcome.after))
    assert after < 0.5 * before


def test_auto_is_no_worse_than_a_fixed_basis():
    auto = results([case_of({"case": [{**GANTRY, "points": 150}]})], 10)[0]
    fixed = results([case_of({"fit": {"basis": "cubic:6", "prior": 30.0}, "case": [{**GANTRY, "points": 150}]})], 10)[0]
    assert auto.after.mean() < fixed.after.mean()


def test_no_noise_and_a_basis_that_holds_the_truth_leave_nothing():
    content = {
        "errors": {"E_XX": [0, 50], "E_YY": [5, 40], "E_CX": [10, 20]},
        "instrument": {"u_range_um": 1e-6, "u_angle_um": 1e-6},
        "fit": {"basis": "legendre:1", "prior": "none"},
        "case": [{**GANTRY, "tools": TOOLS}],
    }
    assert results([case_of(content)], 5)[0].after.max() < 1e-3


# ---- findings of the paper


def test_planes_are_best_and_diagonals_worst():
    study = read_cases(study_of(_toml("trajectory.toml"), "trajectory"), EXAMPLES)
    planes, hexahedron, diagonals = (each.after[0].mean() for each in results(study, 100))
    assert planes < hexahedron < 0.9 * diagonals


def test_more_points_gain_less_and_less():
    study = read_cases(study_of(_toml("spacing.toml"), "spacing"), EXAMPLES)
    chosen = [case for case in study if case.name in ("200", "600", "1000")]
    few, some, many = (each.after[0].mean() for each in results(chosen, 100))
    assert few - some > 2.5 * (some - many) > 0


def test_the_middle_is_the_best_place_for_the_tracker():
    study = read_cases(study_of(_toml("tracker_position.toml"), "tracker"), EXAMPLES)
    means = [each.after[0].mean() for each in results(study, 100)]
    assert min(means) == means[3]


def _toml(name: str) -> dict:
    import tomllib

    return tomllib.loads((EXAMPLES / name).read_text())


# ---- draws


@drawn(20, 100, number=st.integers(1, 30), more=st.integers(0, 30), seed=st.integers(0, 2**32))
def test_the_first_draws_are_the_same_however_many(number, more, seed):
    true_models = TrueModels.of(machines.load("gantry"), TABLE_1)
    few = true_models.draw(np.random.default_rng(seed), number)
    many = true_models.draw(np.random.default_rng(seed), number + more)
    assert np.array_equal(few, many[:, :number])
    assert np.all(np.abs(many) <= true_models.high[:, None] + 1e-12)


def test_cases_measure_the_same_machines():
    first, second = results([paper_case(), paper_case(name="other", strategy="grid")], 60)
    assert np.array_equal(first.before, second.before)
    assert not np.array_equal(first.after, second.after)


def test_tolerance_decides_how_many_draws():
    coarse, fine = (results([paper_case()], Draws(None, tolerance))[0] for tolerance in (2.0, 0.4))
    assert coarse.converged
    assert fine.converged
    assert coarse.after.shape[1] < fine.after.shape[1]
    assert fine.after.shape[1] % DRAWS_OF_CHUNK == 0
    ended = results([paper_case()], Draws(None, 1e-3, most=150))[0]
    assert not ended.converged
    assert ended.after.shape[1] == 150


@drawn(20, 100, seed=st.integers(0, 1000))
def test_the_stopping_rule_is_that_of_the_supplement(seed):
    batches = list(np.random.default_rng(seed).normal(10.0, 1.0, (12, 50)))
    each = np.array([estimates(batch) for batch in batches])
    limit = 2 * (each.std(axis=0, ddof=1) / np.sqrt(12)).max()
    assert enough(batches, limit * 1.001)
    assert not enough(batches, limit * 0.999)
    assert not enough(batches[:2], 1e9)


# ---- spread, interrupted, resumed


@pytest.mark.statistical
def test_processes_give_the_same_and_go_on_without_a_lost_one():
    cases = [paper_case(), paper_case(name="b", strategy="grid")]
    alone, killed = results(cases, 120), []

    def kill_one(_: int) -> None:
        if not killed:
            killed.append(team.executor.processes[0].pid)
            os.kill(killed[0], signal.SIGKILL)

    with workers(2, None) as team:
        spread = results(cases, 120, team, progress=kill_one)
    assert killed
    for one, other in zip(alone, spread, strict=True):
        assert np.array_equal(one.after, other.after)


class StoppedWhenSent:
    """A result: while it travels to the first process, the worker gets the signal to end."""

    def __reduce__(self):
        os.kill(os.getpid(), signal.SIGTERM)
        return StoppedWhenSent, ()


def test_a_worker_ends_also_between_tasks():
    """Otherwise it lives on, its executor waits for it, and the command does not end."""
    with workers(2, None) as team, pytest.raises(BrokenExecutor):
        team.executor.submit(StoppedWhenSent).result(60.0)


class Stopped(Exception):
    pass


class Counting(Team):
    def __init__(self):
        super().__init__(ThreadPoolExecutor(1))
        self.worked = []

    def results(self, function, tasks, lost):
        for task, outcome in super().results(function, tasks, lost):
            self.worked.append(task[1])
            yield task, outcome


def test_an_interrupted_study_goes_on_where_it_was(tmp_path):
    store, team = Store.beside(str(tmp_path / "results.csv")), Counting()
    whole = results([paper_case()], 180)[0]
    done = []

    def stop(draws: int) -> None:
        done.append(draws)
        if len(done) == 2:
            raise Stopped

    with pytest.raises(Stopped):
        results([paper_case()], 180, team, store, progress=stop)
    assert len(team.worked) == 2
    (store.folder / f"{paper_case().key}-1-50.npz").write_bytes(b"damaged")
    resumed = results([paper_case()], 180, team, store)[0]
    assert [chunk.number for chunk in team.worked[2:]] == [1, 2, 3]
    assert np.array_equal(resumed.after, whole.after)
    store.clear([paper_case().key])
    assert not store.folder.exists()


@pytest.mark.parametrize(
    "changes",
    [
        {"points": 160},
        {"tracker": [-1500, 1500, 301]},
        {"fit": {**PAPER, "basis": "legendre:5"}},
        {"tools": TOOLS},
        {"point_s": 30},
        {"runs": 2},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_another_study_has_another_key(changes):
    assert paper_case().key != paper_case(**changes).key
    assert paper_case().key == paper_case(name="another name", setup_min=120).key


def test_cases_that_differ_in_time_alone_differ_where_errors_drift():
    """The results of a case are those of the case alone, whatever the study contains before it."""
    drift = {"errors": {"effects": ["thermal-drift:component=Z,rate=2000"]}, "fit": {"basis": "cubic:5", "prior": 30.0}}
    fast, slow = (case_of({**drift, "case": [{**GANTRY, "point_s": seconds}]}) for seconds in (5, 120))
    alone, (_, behind) = results([slow], 3)[0], results([fast, slow], 3)
    assert np.array_equal(behind.after, alone.after)
    assert not np.array_equal(results([fast], 3)[0].after, alone.after)


def test_a_result_states_the_time_of_its_own_case():
    cases = [paper_case(setup_min=minutes) for minutes in (20, 50)]
    first, second = results(cases, 2, check_draws=1)
    assert second.minutes == first.minutes + 30


@pytest.mark.statistical
@pytest.mark.filterwarnings("ignore")
def test_a_cluster_gives_the_same_and_loses_nothing_with_a_worker():
    from distributed import Client, LocalCluster

    cases = [paper_case(), paper_case(name="b", strategy="grid")]
    alone, killed = results(cases, 400), []
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local:
        with Client(local.scheduler_address) as client:
            pids = list(client.run(os.getpid).values())

        def kill_one(_: int) -> None:
            if not killed:
                os.kill(pids[0], signal.SIGKILL)
                killed.append(pids[0])

        with workers(0, local.scheduler_address) as team:
            spread = results(cases, 400, team, progress=kill_one)
    assert killed
    for one, other in zip(alone, spread, strict=True):
        assert np.array_equal(one.after, other.after)


# ---- the command


def test_command(command, tmp_path):
    Path("study.toml").write_text(STUDY)
    done = command("study", "study.toml", "-o", "r.csv", "--json", "r.json", "--report", "r.html", "-w", 1)
    assert done.status == 0, done.err
    rows = list(csv.reader(Path("r.csv").read_text().splitlines()))
    assert rows[0] == ["name", "points", "minutes", "ve0_rms_um", "ve0_p95_um", "ve_rms_um", "ve_p95_um"]
    assert [row[:3] for row in rows[1:]] == [["few", "100", "45.0"], ["more", "200", "70.0"]]
    cases = json.loads(Path("r.json").read_text())["cases"]
    for row, case in zip(rows[1:], cases, strict=True):
        assert float(row[5]) == pytest.approx(np.mean(case["ve_um"]), abs=1e-4)
        assert float(row[6]) == pytest.approx(np.quantile(case["ve_um"], 0.95), abs=1e-4)
        assert case["exact_check"]["largest_difference_um"] < 0.01
    assert len(figures(Path("r.html"))) == 2
    assert not list(tmp_path.glob("*.chunks"))
    again = command("study", "study.toml", "-o", "-", "-w", 1)
    assert again.out == Path("r.csv").read_bytes()


@pytest.mark.parametrize("name", quick([path.name for path in sorted(EXAMPLES.glob("*.toml"))], ["trajectory.toml"]))
def test_examples_can_be_laid_out(name):
    content = _toml(name)
    # choosing the rotary positions of spheres takes seconds
    cases = [case for case in content["case"] if name != "spheres.toml" or case["strategy"] in ("grid", "random")]
    assert read_cases(study_of({**content, "case": cases}, name), EXAMPLES)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"distances": {"s1.s9": 1.0}}, "no pair such as s1.s2"),
        ({"distances": {"s1.s1": 1.0}}, "no pair such as s1.s2"),
        ({"distances": {"s1.s2": 0.0}}, "distances: expected a number > 0"),
        ({"spheres": 0}, "spheres"),
        ({"spheres": {"s1": [2000, 0, 60]}}, "reaches the spheres at 0 of"),
        ({"strategy": "hexahedron"}, "for a touch probe expected one of"),
        ({"tracker": [0, 0, 0]}, "tracker: a case with a touch probe does not have this key"),
        ({"tools": TOOLS}, "one target"),
        ({"points": [8, 8]}, "one number of rotary positions"),
        ({"instrument": {"kind": "laser-tracker", "u_range_um": 1, "u_angle_um": 1}, "spheres": 2}, "touch-probe"),
    ],
)
def test_designs_of_spheres_that_cannot_be_used_are_refused(change, said):
    with pytest.raises(UserError, match=re.escape(said)):
        read_cases(study_of({**SPHERES, "case": [{**DESIGNS[1], **change}]}, "test"), Path())


@pytest.mark.parametrize(
    ("volume", "said"),
    [({"Z": [-50, 100]}, "Z=-50:100"), ({"B": [0, 200]}, "B=0:200"), ({"W": [0, 1]}, "W"), ({"X": [9, 1]}, "X")],
)
def test_a_volume_beyond_the_travel_is_refused(volume, said):
    with pytest.raises(UserError, match=re.escape(said)):
        read_cases(study_of({**SPHERES, "volume": volume, "case": DESIGNS[:1]}, "test"), Path())


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (("gantry", "no_such"), "unknown machine"),
        (("hexahedron", "octahedron"), "study study.toml: case few: strategy 'octahedron' is none of"),
        (('name = "more"', 'name = "few"'), "two cases have the name 'few'"),
        (("tracker = [-1500, 1500, 300]", ""), "the position of the laser tracker is missing"),
        (("tracker = [-1500, 1500, 300]", "tracker = [0, 0, 0]"), "move the tracker"),
        (("tracker = [-1500, 1500, 300]", "tracker = [1, 2]"), "expected [x, y, z]"),
        (("points = 100", "pionts = 100"), "pionts"),
        (("draws = 60", "draws = 1"), "draws"),
        (("draws = 60", "draws = 'some'"), "draws"),
        (("legendre:4", "chebyshev:4"), "chebyshev:4"),
        (('basis = "legendre:4"\nprior = 30', 'prior = "none"'), "needs a prior"),
        (("prior = 30", "prior = -1"), "prior"),
        (("seed = 5", "[instrument]\nu_range_um = 1"), "u_angle_um"),
        (("seed = 5", "[instrument]\nu_um = 1"), "u_um"),
        (("seed = 5", '[errors]\nmodel = "fourier"'), "rows E_XX"),
        (("seed = 5", '[errors]\nmodel = "none"\nE_XX = [0, 50]'), 'model = "none"'),
        (("seed = 5", "[errors]\nE_QX = [1, 2]"), "E_QX"),
        (("seed = 5", '[errors]\neffects = ["backlash:axis=Q,width=1"]'), "no axis Q"),
        (("seed = 5", '[instrument]\nu_range_um=1\nu_angle_um=1\nelevation = [80, 89]'), "observes none of the points"),
        (("[[case]]", "[[case"), "study.toml"),
    ],
)  # fmt: skip
def test_what_cant_be_used_is_refused(command, changed, said):
    Path("study.toml").write_text(STUDY.replace(*changed))
    done = command("study", "study.toml", "-o", "r.csv", "-w", 1)
    assert done.status == 2
    assert said in done.err
    assert "Traceback" not in done.err
    assert [path.name for path in Path().iterdir()] == ["study.toml"]


def test_no_such_cluster(command):
    Path("study.toml").write_text(STUDY)
    done = command("study", "study.toml", "-o", "r.csv", "--dask", "nonsense://x")
    assert done.status == 2
    assert "--dask nonsense://x" in done.err
    with pytest.raises(UserError):
        read_cases(study_of({"machine": "gantry", "case": [{**GANTRY, "tracker": []}]}, "test"), Path())


# ---- along a program


PART = "G21 G90 G94\nG0 X100 Y100 Z100\n" + "".join(
    f"G0 X{x} Y{y} Z{z}\n" for x in (200, 1800, 3300, 4700) for y in (300, 1500, 2700) for z in (150, 1300)
) + "M30\n"  # fmt: skip


def test_what_a_correction_leaves_along_a_program(command):
    """A fitted calibration on disk, a program corrected by it, and the true machine running it."""
    Path("study.toml").write_text(STUDY.replace('name = "more"', 'name = "last"'))
    Path("part.nc").write_text(PART)
    done = command(
        "study", "study.toml", "-o", "r.csv", "--json", "r.json", "--program", "part.nc", "-w", 1, "--set-up-zero"
    )
    assert done.status == 0, done.err
    head = Path("r.csv").read_text().splitlines()[0].split(",")
    assert head[7:] == ["program0_rms_um", "program0_p95_um", "program_rms_um", "program_p95_um"]
    told = json.loads(Path("r.json").read_text())["cases"][1]
    ready = Prepared.of(read_cases(study_of(_tomllib(STUDY), "study"), Path())[1])
    drawn = ready.sample(Chunk(0, 1))
    ((parts, scales), _), *_ = ready.choices(drawn).items()
    parameters = ready.fitted(parts, scales, drawn, np.array([0]))[:, 0]
    fitted = ready.fits.columns.model(parts).with_parameters(parameters)
    effects, matrix = about_own_points(fitted)
    found = msgspec.structs.replace(fitted, effects=effects).with_parameters(matrix @ parameters)
    write_model(found, Path("fitted.json"))
    corrected = command("part.nc", "--machine", "gantry", "--calibration", "fitted.json", "-o", "c.nc", "--set-up-zero")
    assert corrected.status == 0, corrected.err
    truth, machine = ready.case.true_models.machine(drawn.coefficients[:, 0]), machines.load("gantry")
    ends = [_positions(Path(name)) for name in ("part.nc", "c.nc")]
    wanted, got = (
        tool_point(machine, ends[0]),
        tool_point(machine, ends[1], (0, 0, 0), truth.errors(machine, State(ends[1]))),
    )
    assert volumetric_error_um(got - wanted, wanted).rms == pytest.approx(told["program_um"][0], abs=0.15)
    assert told["program_um"][0] < told["program0_um"][0]


def _tomllib(text: str) -> dict:
    import tomllib

    return tomllib.loads(text)


def _positions(path: Path) -> np.ndarray:
    moves = re.findall(r"G[01] X(\S+) Y(\S+) Z(\S+)", path.read_text())
    return np.array(moves, float)


@pytest.mark.parametrize("stations", [1, 2, 4])
def test_every_station_costs_its_time(stations):
    """All points in sight: each position of the tracker takes as long as one alone."""
    places = [[-1500, 1500, 300], [6500, 1500, 300], [2500, -1500, 400], [2500, 4500, 400]]
    alone = paper_case().setup().minutes
    assert paper_case(tracker=places[:stations]).setup().minutes == pytest.approx(stations * alone)
