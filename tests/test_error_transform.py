"""The first-order error transform: derivation, shipped modules, cache, and agreement with the exact matrix product."""

import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import platformdirs
import pytest
import sympy as sp
from support.random_chains import chains
from support.tiers import drawn, quick

import machines
from kinematics import derive, error_transform
from kinematics.derived import MODULES
from kinematics.deviation import exact_deviation
from kinematics.forward import forward, tool_point
from kinematics.machine import Axis, Machine
from kinematics.transforms import ROWS_OF_BLOCK, Array
from machines import derive as shipped
from tests.support.first_order import first_order_deviation

ROOT = Path(__file__).parents[1]
SLANTED = """
name = "slanted"
chain = "w A X b C Y t"
axes.A = { travel = [-90, 90], direction = [2, 0.5, 0.1], point = [1, 2, 3] }
axes.X = { travel = [0, 100], direction = [1, 0.001, 0] }
axes.C = { travel = [-90, 90], direction = [0, 0, -1], point = [0, 5, 0] }
axes.Y = { travel = [0, 100], point = [7, 8, 9] }
"""

SHORT = """
name = "short"
chain = "w A b Y t"
axes.A = { travel = [-90, 90], direction = [2, 0.5, 0.1], point = [1, 2, 3] }
axes.Y = { travel = [0, 100], point = [7, 8, 9] }
"""

every_machine = pytest.mark.parametrize("name", machines.names())


@pytest.fixture(autouse=True, scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A cache folder of these tests alone."""
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(platformdirs, "user_cache_dir", lambda app: str(folder / app))
        yield folder


@pytest.fixture
def unknown(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[str], Machine]:
    """Reads a machine that this process has not met, with an empty cache in tmp_path."""
    monkeypatch.setattr(platformdirs, "user_cache_dir", lambda _: str(tmp_path))
    monkeypatch.setattr(error_transform, "_loaded", {})
    return lambda toml: machines.parse(toml, "unknown")


@pytest.fixture
def slanted(unknown: Callable[[str], Machine]) -> Machine:
    """One with linear and rotary axes on both sides."""
    return unknown(SLANTED)


@pytest.fixture
def short(unknown: Callable[[str], Machine]) -> Machine:
    """One with few axes, which is derived in a moment."""
    return unknown(SHORT)


def poses(machine: Machine, n: int, seed: int) -> tuple[Array, Array, Array]:
    """Random positions `(n, axes)` inside travel, tool vectors `(n, 3)` and errors `(n, axes, 6)` of size 1."""
    rng = np.random.default_rng(seed)
    travel = np.clip(machine.travel, -6000.0, 6000.0)
    return (
        rng.uniform(*travel, (n, len(machine.axes))),
        rng.normal(0, 80, (n, 3)),
        rng.normal(size=(n, len(machine.axes), 6)),
    )


def stacked(deviation: tuple[Array, Array]) -> Array:
    return np.concatenate(deviation, axis=1)


def assert_agrees_with_exact(machine: Machine, seed: int, n: int = 4) -> None:
    """Derived forward kinematics, J by central differences, and J . errors, at n random poses."""
    q, tool, errors = poses(machine, n, seed)
    size = np.abs(tool_point(machine, q, tool)).max() + 1.0
    nominal = forward(machine, q)
    for i in range(len(q)):
        pose = dict(zip((*machine.names, "tx", "ty", "tz"), (*q[i], *tool[i]), strict=True))
        chain = derive.links(machine, lambda _, values, at=pose: values.evalf(30, subs=at))
        tip, axis = (np.array(found, float).ravel() for found in (chain.tip, sp.prod(chain.rotations)[:, 2]))
        assert np.abs(tip - nominal.apply(tool)[i]).max() < 1e-13 * size
        assert np.abs(axis - nominal.rotation[i, :, 2]).max() < 1e-14

    J = error_transform.error_transform(machine, q, tool)
    h = 1e-4
    assert J.shape == (n, 6, 6 * len(machine.axes))
    for column in range(J.shape[2]):
        step = np.zeros(errors.shape)
        step[:, column // 6, column % 6] = h
        ahead, behind = exact_deviation(machine, q, step, tool), exact_deviation(machine, q, -step, tool)
        slope = (stacked(ahead) - stacked(behind)) / (2 * h)
        assert np.abs(J[:, :, column] - slope).max() < 1e-8 * size

    slopes = error_transform.pose_slopes(machine, q, tool)
    for axis in range(len(machine.axes)):
        ahead, behind = (forward(machine, q + way * h * np.eye(len(machine.axes))[axis]) for way in (1, -1))
        moved = (ahead.apply(tool) - behind.apply(tool)) / (2 * h)
        assert np.abs(slopes[:, :3, axis] - moved).max() < 1e-8 * size
        turned = (ahead.rotation - behind.rotation) @ forward(machine, q).inverse().rotation / (2 * h)
        vector = np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], axis=1)
        assert np.abs(slopes[:, 3:, axis] - vector).max() < 1e-8

    direct = stacked(first_order_deviation(machine, q, errors, tool))
    assert np.abs(direct - np.einsum("nij,nj->ni", J, errors.reshape(n, -1))).max() < 1e-12 * size


@every_machine
def test_shipped_module_is_what_the_deriver_writes(name):
    assert (shipped.FOLDER / f"{name}.py").read_bytes() == derive.source(machines.load(name)).encode()


def test_index_is_what_the_deriver_writes():
    assert (shipped.FOLDER / "__init__.py").read_bytes() == shipped.index_source().encode()
    assert {machines.load(name).chain_hash: name for name in machines.names()} == MODULES


def test_same_bytes_at_each_generation():
    code = "import machines; from kinematics import derive; print(derive.source(machines.load('head_table')), end='')"
    seed = "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"  # another one than of this process
    environment = {**os.environ, "PYTHONHASHSEED": seed}
    other = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, check=True)
    assert other.stdout.decode() == derive.source(machines.load("head_table"))


@every_machine
def test_agrees_with_exact_on_shipped_machines(name):
    assert_agrees_with_exact(machines.load(name), seed=11)


@every_machine
def test_error_of_first_order_is_of_second_order(name):
    machine = machines.load(name)
    q, tool, errors = poses(machine, 200, seed=5)
    gaps = []
    for scale in (2e-4, 1e-4):
        first = first_order_deviation(machine, q, scale * errors, tool)
        exact = exact_deviation(machine, q, scale * errors, tool)
        gaps.append([np.linalg.norm(a - b) for a, b in zip(first, exact, strict=True)])
    assert np.divide(*gaps) == pytest.approx([4.0, 4.0], rel=0.01)


@drawn(few=2, many=12, toml=chains())
def test_agrees_with_exact_on_any_chain(toml):
    assert_agrees_with_exact(machines.parse(toml, "random"), seed=2)


def symbolic_pose(rotation: sp.Matrix, translation: sp.Matrix) -> sp.Matrix:
    return rotation.row_join(translation).col_join(sp.Matrix([[0, 0, 0, 1]]))


def symbolic_dmu50_axis(axis: Axis, errors: sp.Matrix) -> sp.Matrix:
    """M(q) and E(q) of one axis of the DMU 50, as `kinematics.forward` combines them, with errors to first order."""
    q, height, h = sp.Symbol(axis.name), sp.Matrix([0, 0, sp.Rational("154.996")]), sp.sqrt(2) / 2
    to_slant = sp.Matrix([[1, 0, 0], [0, h, h], [0, -h, h]])  # y goes to (0, 1, -1)/sqrt 2
    frame = to_slant if axis.name == "B" else sp.eye(3)
    w = frame * errors[3:, :]
    tilt = sp.eye(3) + sp.Matrix([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    if axis.name in "XYZ":
        step = q * sp.Matrix([int(axis.name == letter) for letter in "XYZ"])
        centre, link = step, symbolic_pose(sp.eye(3), step)
    else:
        turn = {"C": sp.rot_ccw_axis3(q), "B": to_slant * sp.rot_ccw_axis2(q) * to_slant.T}[axis.name]
        centre, link = height, symbolic_pose(turn, height - turn * height)
    error = symbolic_pose(tilt, centre - tilt * centre + frame * errors[:3, :])
    return error * link if axis.side == "tool" else link * error


@pytest.mark.statistical
def test_derivation_equals_differentiating_the_matrix_product_of_the_dmu50():
    machine = machines.load("dmu50")
    J = derive.error_transform(machine, lambda _, values: values.applyfunc(sp.expand))
    symbols, none = sp.Matrix(sp.symbols("e:6")), sp.zeros(6, 1)
    tip = sp.Matrix([*sp.symbols("tx ty tz"), 1])
    unity = {sp.sin(sp.Symbol(name)) ** 2: 1 - sp.cos(sp.Symbol(name)) ** 2 for name in "BC"}
    nominal = [symbolic_dmu50_axis(axis, none) for axis in machine.axes]
    rotation = sp.prod(nominal)[:3, :3]
    for i, axis in enumerate(machine.axes):
        # the other errors are zero: these are the derivatives at zero
        actual = sp.prod([*nominal[:i], symbolic_dmu50_axis(axis, symbols), *nominal[i + 1 :]])
        for k in range(6):
            change, column = actual.diff(symbols[k]), J[:, 6 * i + k]
            assert ((change * tip)[:3, :] - column[:3, :]).applyfunc(sp.expand) == sp.zeros(3, 1)
            turned = (change[:3, :3] * rotation.T).applyfunc(lambda entry: entry.expand().subs(unity).expand())
            vector = sp.Matrix([turned[2, 1], turned[0, 2], turned[1, 0]])
            assert (vector - column[3:, :]).applyfunc(sp.expand) == sp.zeros(3, 1)


def test_closed_form_of_the_dmu50_is_exact():
    tip = derive.links(machines.load("dmu50"), lambda _, values: values.applyfunc(sp.expand)).tip
    assert tip[0].coeff(sp.Symbol("X")).coeff(sp.sin(sp.Symbol("B"))) == sp.sqrt(2) / 2 * sp.sin(sp.Symbol("C"))
    assert not tip.atoms(sp.Float)


def test_error_names_are_those_of_iso_230():
    names = error_transform.error_names(machines.load("dmu50"))
    assert names[:7] == ["E_XC", "E_YC", "E_ZC", "E_AC", "E_BC", "E_CC", "E_XB"]
    assert len(names) == 30


def test_single_rows_serve_for_all():
    machine = machines.load("dmu50")
    q, tool, errors = poses(machine, 4, seed=9)
    one = error_transform.error_transform(machine, q[0], tool[0])
    assert one.shape == (1, 6, 30)
    assert error_transform.error_transform(machine, q[0], tool)[:1] == pytest.approx(one)
    assert error_transform.error_transform(machine, q, tool[0])[:1] == pytest.approx(one)
    same = first_order_deviation(machine, q, np.broadcast_to(errors[0], errors.shape), tool)
    assert stacked(first_order_deviation(machine, q, errors[0], tool)) == pytest.approx(stacked(same))
    assert first_order_deviation(machine, q[0], errors[0]).position.shape == (1, 3)
    assert first_order_deviation(machine, q[:0], errors[:0]).position.shape == (0, 3)


def test_shipped_machines_need_no_sympy():
    code = (
        "import sys, numpy as np, machines\n"
        "from kinematics.error_transform import error_transform, pose_slopes\n"
        "for name in machines.names():\n"
        "    machine = machines.load(name)\n"
        "    error_transform(machine, np.zeros(len(machine.axes)))\n"
        "    pose_slopes(machine, np.zeros(len(machine.axes)))\n"
        "    assert f'kinematics.derived.{name}' in sys.modules\n"
        "assert 'sympy' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


def test_another_chain_is_derived_once_and_then_read_from_the_cache(slanted, tmp_path, monkeypatch):
    assert_agrees_with_exact(slanted, seed=1, n=2)
    (file,) = tmp_path.rglob("*.*")
    assert file.name == f"{slanted.chain_hash}.py"
    monkeypatch.setattr(derive, "source", lambda machine: pytest.fail(f"{machine.name} derived again"))
    assert_agrees_with_exact(slanted, seed=1, n=2)
    monkeypatch.setattr(error_transform, "_loaded", {})
    assert_agrees_with_exact(slanted, seed=1, n=2)


DAMAGES = {
    "empty": lambda data: data[:0],
    "cut": lambda data: data[: len(data) // 2],
    "another number": lambda data: re.sub(rb"(= 0\.\d*)\d", rb"\g<1>", data, count=1),
    "not text": lambda data: b"\xff\xfe" + data,
    "another deriver": lambda data: re.sub(rb"deriver \w+", b"deriver 0", data, count=1),
}


@pytest.mark.parametrize("name", quick(DAMAGES, ["another number", "another deriver"]))
def test_a_damaged_or_outdated_cache_file_is_derived_again(short, tmp_path, monkeypatch, name):
    damage = DAMAGES[name]
    error_transform.derived(short)
    (file,) = tmp_path.rglob("*.py")
    good = file.read_bytes()
    assert damage(good) != good
    file.write_bytes(damage(good))
    monkeypatch.setattr(error_transform, "_loaded", {})
    assert_agrees_with_exact(short, seed=1, n=2)
    assert file.read_bytes() == good


def test_a_cache_file_of_another_chain_is_not_used(short, tmp_path):
    other = machines.parse(SHORT.replace("[7, 8, 9]", "[7, 8, 10]"), "other")
    error_transform.derived(other)
    (file,) = tmp_path.rglob("*.py")
    file.rename(file.with_name(f"{short.chain_hash}.py"))
    assert_agrees_with_exact(short, seed=1, n=2)


@pytest.mark.parametrize("blocked", [".", "derived"])
def test_a_cache_that_cant_be_written_is_done_without(short, tmp_path, monkeypatch, blocked):
    monkeypatch.setattr(platformdirs, "user_cache_dir", lambda _: str(tmp_path / "cache"))
    obstacle = tmp_path / "cache" / blocked
    obstacle.parent.mkdir(exist_ok=True)
    obstacle.write_text("a file where a folder should be")
    assert_agrees_with_exact(short, seed=1, n=2)


def test_main_writes_modules_and_index(monkeypatch, tmp_path):
    monkeypatch.setattr(shipped, "FOLDER", tmp_path)
    assert shipped.main(["gantry", "cframe"]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["__init__.py", "cframe.py", "gantry.py"]


@pytest.mark.parametrize("arguments", [[], ["nosuch"], ["--all", "gantry"]])
def test_main_refuses_what_it_does_not_know(arguments, capsys):
    assert shipped.main(arguments) == 2
    assert "usage: python -m machines.derive" in capsys.readouterr().err


# --- the tool's own displacement, and long tables


@every_machine
def test_the_tools_own_columns_are_the_slopes_of_the_exact_deviation(name):
    machine = machines.load(name)
    q, tool, _ = poses(machine, 5, seed=8)
    axes, h = len(machine.axes), 1e-4
    J = error_transform.error_transform_with_tool(machine, q, tool)
    assert J.shape == (5, 6, 6 * (axes + 1))
    assert (J[:, :, : 6 * axes] == error_transform.error_transform(machine, q, tool)).all()
    assert error_transform.error_names_with_tool(machine)[-2:] == ["tool B", "tool C"]
    for column in range(6):
        step = np.zeros((5, axes + 1, 6))
        step[:, axes, column] = h
        ahead, behind = exact_deviation(machine, q, step, tool), exact_deviation(machine, q, -step, tool)
        assert J[:, :, 6 * axes + column] == pytest.approx((stacked(ahead) - stacked(behind)) / (2 * h), abs=1e-5)
    one = error_transform.error_transform_with_tool(machine, q, tool[0])
    assert one[0] == pytest.approx(J[0], abs=1e-12)


@every_machine
def test_the_tools_own_displacement_to_first_order(name):
    machine = machines.load(name)
    q, tool, errors = poses(machine, 50, seed=6)
    errors = np.concatenate([errors, np.random.default_rng(7).normal(size=(50, 1, 6))], axis=1)
    J = error_transform.error_transform_with_tool(machine, q, tool)
    direct = stacked(first_order_deviation(machine, q, errors, tool))
    assert direct == pytest.approx(np.einsum("nij,nj->ni", J, errors.reshape(50, -1)), rel=1e-9, abs=1e-8)
    gaps = []
    for scale in (2e-4, 1e-4):
        first = first_order_deviation(machine, q, scale * errors, tool)
        exact = exact_deviation(machine, q, scale * errors, tool)
        gaps.append([np.linalg.norm(a - b) for a, b in zip(first, exact, strict=True)])
    assert np.divide(*gaps) == pytest.approx([4.0, 4.0], rel=0.01)


@pytest.mark.parametrize("deviation", [exact_deviation, first_order_deviation])
def test_long_tables_are_worked_through_in_blocks(deviation):
    machine, n = machines.load("dmu50"), 2 * ROWS_OF_BLOCK + 3
    q, tool, errors = poses(machine, n, seed=10)
    errors *= 1e-5
    rows = np.array([0, ROWS_OF_BLOCK - 1, ROWS_OF_BLOCK, 2 * ROWS_OF_BLOCK, n - 1])
    whole = deviation(machine, q, errors, tool)
    assert stacked(whole)[rows] == pytest.approx(stacked(deviation(machine, q[rows], errors[rows], tool[rows])))
    assert whole.position.shape == whole.orientation.shape == (n, 3)


@pytest.mark.parametrize(
    ("n", "deviation"),
    quick(
        [(n, deviation) for n in (3, ROWS_OF_BLOCK + 2) for deviation in (exact_deviation, first_order_deviation)],
        [(3, exact_deviation), (3, first_order_deviation), (ROWS_OF_BLOCK + 2, first_order_deviation)],
    ),
)
def test_one_row_of_positions_errors_or_tool_serves_for_all(deviation, n):
    machine = machines.load("dmu50")
    q, tool, errors = poses(machine, n, seed=12)
    errors *= 1e-5
    same = [np.broadcast_to(column[0], column.shape) for column in (q, errors, tool)]
    for short, spread in (
        ((q[0], errors, tool), (same[0], errors, tool)),
        ((q, errors[0], tool), (q, same[1], tool)),
        ((q, errors, tool[0]), (q, errors, same[2])),
        ((q[:1], errors[:1], tool), (same[0], same[1], tool)),
    ):
        assert stacked(deviation(machine, *short)) == pytest.approx(stacked(deviation(machine, *spread)), abs=1e-15)
    assert deviation(machine, q[0], errors[0], tool[0]).position.shape == (1, 3)
    assert deviation(machine, q[:0], errors[:0], tool[:0]).position.shape == (0, 3)
