"""Plans of spheres, their moves, probing programs, and logs of the contacts."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.linuxcnc_spheres import config_of
from support.probe_cases import TIP
from support.probing_cases import CONTACT, FIVE_AXES, contacts, log_of, planned, sequence_of, settings_of, spheres_of
from support.programs import source_of
from support.tiers import quick

import machines
from calibration.fit.fit import fit
from calibration.measurement.file import read_measurement
from calibration.measurement.plan_file import plan_id, read_plan, write_plan
from calibration.probing.bodies import Artefact, Bodies, Probe, least_clearance
from calibration.probing.centres import centres_of
from calibration.probing.designs import circles, grid, rotary_ranges
from calibration.probing.log import log_text, read_contacts
from calibration.probing.paths import MOVE, TOUCH
from calibration.probing.plan import ProbeRequest, probe_plan
from calibration.probing.predicted import predicted
from calibration.simulation.true_model import model_of, random_location_errors
from kinematics.effects import LocationError
from kinematics.forward import forward, tool_point
from kinematics.inverse import linear_positions
from kinematics.user_error import UserError
from postproc.control.setup import make_setup
from postproc.dialects import find_dialect
from postproc.probing.program import CONTROLS, probing_program
from postproc.program_path import program_path

DMU50 = machines.load("dmu50")

# ---- moves


def to_segment(points, start, end):
    """Distances of points `(n, 3)` from a segment."""
    along = end - start
    t = np.clip((points - start) @ along / max(along @ along, 1e-12), 0.0, 1.0)
    return np.linalg.norm(points - start - t[:, None] * along, axis=1)


@pytest.mark.parametrize("name", quick(FIVE_AXES, ["dmu50"]))
def test_all_moves_avoid_spheres_and_stems(name):
    """Points all over the probe at steps of 2 mm along every move; only the touched sphere comes nearer, at its touch."""
    found = planned(name, spheres=2, points=7)
    machine, moves, probe = found.plan.machine, found.moves, found.request.probe
    shapes = [
        (0.0, 3.0),
        *((h, 2.0) for h in np.arange(5.0, 41.0, 5.0)),
        *((h, 25.0) for h in np.arange(65.0, 151.0, 8.0)),
    ]
    for k in range(1, len(moves.positions)):
        start, end = moves.positions[k - 1], moves.positions[k]
        reach = (
            np.linalg.norm(np.where(machine.rotary, 0.0, end - start))
            + 250.0 * np.abs((end - start)[machine.rotary]).max()
        )
        share = np.linspace(0.0, 1.0, int(reach / 2.0) + 2)[:, None]
        nose = forward(machine, start + share * (end - start))
        for height, radius in shapes:
            points = nose.apply(np.add(probe.tip, (0.0, 0.0, height)))
            for s, centre in enumerate(np.array(list(found.plan.spheres.values()))):
                gap = to_segment(points, centre, centre - (0.0, 0.0, 60.0)) - radius - 4.0
                ball = np.linalg.norm(points - centre, axis=1) - radius - 12.5
                touched = moves.sphere[k] == s and radius < 25.0
                assert touched or min(gap.min(), ball.min()) > 1.4, (k, height)
                # a touch ends in the ball, never in the stem below it
                below = points[(points - centre)[:, 2] < -12.5]
                assert not len(below) or to_segment(below, centre, centre - (0.0, 0.0, 60.0)).min() > radius + 4.0


@pytest.mark.parametrize("name", FIVE_AXES)
def test_all_positions_are_within_the_travel_and_touches_are_along_normals(name):
    found = planned(name, spheres=2, points=7)
    machine, moves = found.plan.machine, found.moves
    assert np.all(moves.positions >= machine.travel[0] - 1e-9)
    assert np.all(moves.positions <= machine.travel[1] + 1e-9)
    k = np.flatnonzero(moves.kind == TOUCH)
    assert len(k) == 5 * len(found.plan)
    centres = np.array([found.plan.spheres[s] for s in found.plan.state.station])[moves.row[k]]
    start, end = (tool_point(machine, moves.positions[i], TIP) - centres for i in (k - 1, k))
    assert np.abs(np.cross(start, end)).max() < 1e-6
    np.testing.assert_allclose(np.linalg.norm(start, axis=1), CONTACT + 5.0)
    np.testing.assert_allclose(np.linalg.norm(end, axis=1), CONTACT - 3.0)
    turns = np.abs(np.diff(moves.positions[:, machine.rotary], axis=0)).max(axis=1) > 0.0
    park = moves.positions[0][~machine.rotary]
    assert np.allclose(moves.positions[1:][turns][:, ~machine.rotary], park)
    assert np.all(moves.kind[1:][turns] == MOVE)


def test_a_lower_bound_of_the_clearance_is_below_every_sample():
    bodies = Bodies(DMU50, Probe(TIP), Artefact(spheres_of("dmu50", 2)))
    rng = np.random.default_rng(0)
    low, high = DMU50.travel
    start, end = (low + rng.uniform(size=(200, 5)) * (high - low) for _ in range(2))
    nobody = np.full(200, -1)
    bound = least_clearance(bodies, start, end, nobody, 20.0)
    share = np.linspace(0.0, 1.0, 50)
    sampled = np.min([bodies.clearances(start + t * (end - start), nobody) for t in share], axis=0)
    assert np.all(bound <= sampled + 1e-9)
    assert np.all((bound >= 20.0) <= (sampled >= 20.0))
    assert 20 < np.count_nonzero(bound >= 20.0) < 180


# ---- designs


@pytest.mark.parametrize("design", quick(["grid", "bk", "samba", "optimised"], ["grid", "samba"]))
def test_published_designs(design):
    request = ProbeRequest(Probe(TIP), Artefact(spheres_of("dmu50", 3)), design, 16, candidates=40)
    found = probe_plan(DMU50, request)
    degrees = found.plan.positions[:, DMU50.rotary] / DMU50.scale[DMU50.rotary]
    assert np.array_equal(found.plan.positions[0], found.plan.positions[-1])  # the first sphere again
    assert found.plan.state.station[0] == found.plan.state.station[-1]
    assert abs(found.plan.position_count - 16) <= 4
    if design == "bk":  # each rotary axis alone
        assert np.all((np.abs(degrees - degrees.min(axis=0)) < 1e-6).any(axis=1))
    if design == "optimised":
        assert 0.0 < found.expected_um < 30.0


def test_grids_have_no_seam_and_circles_come_back():
    ranges = rotary_ranges(machines.load("head_head"), {})
    assert list(ranges.values()) == [(0.0, 360.0), (-110.0, 110.0)]
    angles = grid(ranges, 30)
    assert angles[:, 0].max() < 360.0
    assert set(angles[:, 1]) >= {-110.0, 110.0}
    assert len(grid({0: (40.0, 50.0), 1: (0.0, 360.0)}, 12)) == 12
    assert len(grid({0: (10.0, 10.0), 1: (0.0, 360.0)}, 12)) == 12
    each = circles(machines.load("head_head"), ranges, 24)
    assert np.array_equal(each[:6], each[6:12][::-1])


def test_one_sphere_hides_more_than_three():
    one, three = (predicted(planned("dmu50", spheres=n, points=16).plan, 1.0, {}) for n in (1, 3))
    assert three.rank < three.parameters
    assert any("a second sphere" in each.remedy for each in one.unidentifiable)
    names = {each.effects for each in three.unidentifiable}
    assert {("E_CZ",), ("E_XX", "E_YY", "E_ZZ")} <= names
    assert three.uncertainty["E_X0C"] < one.uncertainty["E_X0C"]
    assert one.uncertainty_small["E_X0C"] < 0.5 * one.uncertainty["E_X0C"]
    with_distance = predicted(planned("dmu50", spheres=3, points=16).plan, 1.0, {("s1", "s2"): 0.0005})
    assert ("E_XX", "E_YY", "E_ZZ") not in {each.effects for each in with_distance.unidentifiable}


# ---- programs

TOUCHES = {
    "linuxcnc": (r"G38\.2 (.*) F[\d.]+", r"G53 G1 \1 F100"),
    "fanuc": (r"G31 (.*) F[\d.]+", r"G1 \1 F100"),
    "siemens": (r"SUPA MEAS=1 G1", "SUPA G1"),
    "heidenhain": (r"TCH PROBE 4\.2 (.*)", r"L \1 R0 F100"),
}
"""Touches as plain moves to the position that they would reach without contact."""
NO_MOVES = {
    "linuxcnc": r"O1 .*|G4 .*|M2|\(MSG.*|M0",
    "fanuc": r"IF.*|#.*|DPRNT.*|POPEN|PCLOS|N90.*|M0|O\d+",
    "siemens": r"IF.*|WRITE.*|DEF.*|STOPRE|M0|MISSED:|NOLOG:|MSG.*",
    "heidenhain": r"FN .*|TCH .*|Q\d.*|STOP|M129|LBL.*",
}
"""Statements for results, checks and stops, which move nothing."""
BACK = ("G91 G1", "SUPA G1 X=$AA_MM")
"""Beginnings of the way back between both touches."""
DIALECT = {"linuxcnc": "iso", "fanuc": "iso"}


def plain_moves(lines, control):
    """The program with touches as plain moves, and without the statements that move nothing."""
    kept, again = [], False
    for line in lines:
        number, text = re.match(r"(\d+ )?(.*)", line).groups() if control == "heidenhain" else ("", line)
        touch = re.search(TOUCHES[control][0], text)
        if again and (touch or text.startswith(BACK)):
            again = not touch
            continue  # the way back and the second touch end where the first one does
        again = again or bool(touch)
        text = re.sub(*TOUCHES[control], text)
        if not re.fullmatch(NO_MOVES[control], text):
            kept.append(f"{number or ''}{text}")
    return "\n".join(kept) + "\n"


@pytest.mark.parametrize("control", CONTROLS)
@pytest.mark.parametrize("name", ["dmu50", "head_table"])
def test_programs_move_along_the_plan_by_ncomps_own_interpreters(name, control):
    found = planned(name)
    sequence, settings = sequence_of(found), settings_of(control)
    lines = list(probing_program(sequence, settings, control, "test"))
    assert any("NOT TRIED ON A CONTROL" in line for line in lines) == (control != "linuxcnc")
    text = plain_moves(lines, control)
    dialect = find_dialect(DIALECT.get(control, control), "", "")
    setup = make_setup(sequence.machine, ["G54=1,2,3"] if control == "fanuc" else [], [])
    path = program_path(source_of(text), dialect, sequence.machine, setup)
    assert path.positions / sequence.machine.scale == pytest.approx(sequence.positions, abs=2e-4)


@pytest.mark.parametrize("control", CONTROLS)
def test_second_touches_go_back_along_the_normal(control):
    found = planned("dmu50")
    lines = list(probing_program(sequence_of(found), settings_of(control), control, "test"))
    if control == "heidenhain":  # the cycle goes back against its direction; its second touch needs no longer way
        cycles = [re.search(r"DIST\+([\d.]+) F\d+ MB([\d.]+) ", line) for line in lines]
        ways = [(float(found[1]), float(found[2])) for found in cycles if found]
        assert {back for _, back in ways} == {1.0}
        assert {length for length, _ in ways[1::2]} == {2.0}
        assert min(length for length, _ in ways[::2]) > 2.0
        return
    back = [re.findall(r"[XYZ](?:=\S*\])?([-+\d.]+)", line) for line in lines if line.startswith(BACK)]
    k = np.flatnonzero(found.moves.kind == TOUCH)
    path = (found.moves.positions[k] - found.moves.positions[k - 1])[:, ~DMU50.rotary]
    expected = -path / np.linalg.norm(path, axis=1, keepdims=True)
    np.testing.assert_allclose(np.array(back, float), expected, atol=1e-4)


def test_a_siemens_program_stops_where_its_log_is_not_written():
    found = planned("dmu50")
    lines = list(probing_program(sequence_of(found), settings_of("siemens"), "siemens", "test"))
    after = [lines[k + 1] for k, line in enumerate(lines) if line.startswith("WRITE")]
    assert len(after) == 1 + np.count_nonzero(found.moves.touch)
    assert set(after) == {"IF ERR<>0 GOTOF NOLOG"}
    stated = next(int(size[1]) for line in lines if (size := re.search(r"ABOUT (\d+) KB: MD11420", line)))
    log = log_of(found, "siemens", contacts(found, model_of(DMU50, [])))
    assert len(log) / 1024 < stated < 2.5 * len(log) / 1024 + 1


@pytest.mark.parametrize("seed", range(4))
def test_fanuc_programs_have_numbers_of_the_user(seed):
    lines = list(probing_program(sequence_of(planned("dmu50", seed=seed)), settings_of("fanuc"), "fanuc", "test"))
    assert 1 <= int(next(line for line in lines if re.fullmatch(r"O\d{4}", line))[1:]) <= 7999


# ---- logs


def read(found, control, positions, **changed):
    log = log_of(found, control, positions)
    for old, new in changed.items():
        log = log.replace(old, new)
    return read_contacts(log, "log.txt", found.plan, plan_id(found.plan))


@pytest.mark.parametrize("control", CONTROLS)
@pytest.mark.parametrize("name", FIVE_AXES)
def test_contacts_give_the_centres_at_which_the_tip_is_in_the_sphere(name, control):
    """Without noise, to the digits of the logs; through plan, contacts, log and reader."""
    found = planned(name)
    machine = found.plan.machine
    model = model_of(machine, random_location_errors(machine, np.random.default_rng(2), 50.0))
    probed = centres_of(read(found, control, contacts(found, model)), found.plan, "log.txt")
    state = probed.measurement.state
    tips = tool_point(machine, state.positions, TIP, model.errors(machine, state))
    actual = np.add(next(iter(found.plan.spheres.values())), (0.3, -0.2, 0.4))
    assert np.abs(tips - actual).max() < 3e-4
    assert probed.radii["s1"] == pytest.approx(CONTACT, abs=2e-4)
    assert len(state) == len(found.plan)
    assert not probed.repeats[-1].significant


def test_the_scatter_gives_the_uncertainty():
    found = planned("dmu50", points=40)
    model = model_of(DMU50, [])
    probed = centres_of(read(found, "siemens", contacts(found, model, noise_um=3.0)), found.plan, "log.txt")
    assert probed.scatter_um == pytest.approx(3.0, rel=0.2)
    off = tool_point(DMU50, probed.measurement.state.positions, TIP) - np.add(
        found.plan.spheres["s1"], (0.3, -0.2, 0.4)
    )
    assert np.sqrt(np.mean(off**2)) * 1e3 == pytest.approx(probed.u_um, rel=0.25)


def test_the_scatter_contains_the_servo_cycle():
    """A control reads the axes once in a cycle, up to one cycle late: half of it is in the radius, the rest is scatter."""
    found, cycle_um = planned("dmu50", points=40), 4.0
    positions = contacts(found, model_of(DMU50, []), cycle_um=cycle_um)
    probed = centres_of(read(found, "siemens", positions), found.plan, "log.txt")
    assert probed.scatter_um == pytest.approx(cycle_um / 12**0.5, rel=0.15)
    assert probed.radii["s1"] == pytest.approx(CONTACT - cycle_um / 2e3, abs=3e-4)
    actual = np.add(found.plan.spheres["s1"], (0.3, -0.2, 0.4))
    off = tool_point(DMU50, probed.measurement.state.positions, TIP) - actual
    assert np.sqrt(np.mean(off**2)) * 1e3 == pytest.approx(probed.u_um, rel=0.25)


def test_programs_state_the_resolution_of_a_contact():
    lines = list(probing_program(sequence_of(planned("dmu50")), settings_of("linuxcnc"), "linuxcnc", "test"))
    assert any("AT 30 MM/MIN AND 1 MS 0.5 UM - U 0.14 UM" in line for line in lines)


def test_a_drift_shows_at_the_repeated_centre():
    found = planned("dmu50", points=12, references=4)
    n = len(found.plan)
    shift = np.linspace(0.0, 0.02, n)[:, None] * (0.0, 0.0, 1.0)
    probed = centres_of(
        read(found, "fanuc", contacts(found, model_of(DMU50, []), noise_um=1.0, shift=shift)), found.plan, "log.txt"
    )
    assert [each.row for each in probed.repeats] == [4, 9, n - 1]
    assert probed.repeats[-1].significant
    assert probed.repeats[-1].shift_um[2] == pytest.approx(20.0, abs=4.0)
    assert probed.repeats[-1].U_um < 6.0


def test_a_contact_off_the_sphere_costs_its_row():
    found = planned("dmu50", points=12)
    positions = contacts(found, model_of(DMU50, []), noise_um=1.0)
    positions[17, DMU50.index("Z")] += 1.0
    probed = centres_of(read(found, "siemens", positions), found.plan, "log.txt")
    (note,) = probed.notes
    assert note.startswith("log.txt, line 17: a contact is")
    assert note.endswith("row 4 is left out")
    assert len(probed.measurement) == len(found.plan) - 1
    assert probed.u_um < 2.0


BAD_LOGS = {
    "another field": (lambda text: text.replace("NCOMP P2 T3 ", "NCOMP P2 T3 Q5 "), "line 9: ", "field Q is unknown"),
    "another line": (lambda text: text.replace("NCOMP P2 T3", "HELLO P2 T3"), "line 9: ", "expected NCOMP P row"),
    "another plan": (lambda text: text.replace("PLAN ", "PLAN 1"), "line 1: ", "this is the log of plan 1"),
    "a missing touch": (lambda text: re.sub("NCOMP P2 T3.*\n", "", text), "line 9: ", "row 2, touch 4, but row 2, touch 3"),
    "a missing axis": (lambda text: re.sub(r"(NCOMP P2 T3.*?) Y[-\d.]+", r"\1", text), "line 9: ", "Y is missing"),
    "a doubled field": (lambda text: text.replace("NCOMP P2 T3 ", "NCOMP P2 T3 X5 "), "line 9: ", "given twice"),
    "turned elsewhere": (lambda text: re.sub(r"(NCOMP P2 T3.*B)[-\d.]+", r"\g<1>1.0", text), "line 9: ", "B is at 1 deg"),
    "two runs": (lambda text: text + text, "line 28: ", "row 1, touch 1, but row 6, touch 1"),
    "nothing": (lambda _: "\n", "", "the log is empty"),
    "only a head": (lambda text: text.splitlines()[0], "", "the log has no contact"),
    "inch": (lambda text: re.sub(r"([XYZ])([-\d.]+)", lambda m: f"{m[1]}{float(m[2]) / 25.4:.6f}", text), "line 2: ",
             "in inch or exchanged"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD_LOGS)
def test_other_logs_are_refused_with_their_line(name):
    spoil, line, message = BAD_LOGS[name]
    found = planned("dmu50")
    text = spoil(log_of(found, "siemens", contacts(found, model_of(DMU50, []))))
    with pytest.raises(UserError) as caught:
        centres_of(read_contacts(text, "log.txt", found.plan, plan_id(found.plan)), found.plan, "log.txt")
    assert line in str(caught.value)
    assert message in str(caught.value)


def test_bad_logs_of_linuxcnc_are_refused_with_their_line():
    found = planned("dmu50")
    lines = log_of(found, "linuxcnc", contacts(found, model_of(DMU50, []))).splitlines()
    for spoiled, message in (
        ([*lines[:3], "1 2 3"], "line 4: '1 2 3': expected the nine numbers"),
        (lines[::2], "line 1: this contact has one touch, not two: 25 of 25 contacts are like this"),
        ([*lines[:2], lines[1], *lines[2:]], "line 3: a third touch at the same contact"),
        ([*lines[:2], *lines[4:]], "is it the log of another plan?"),
        (lines[:8], "no complete centre"),
    ):
        with pytest.raises(UserError, match=re.escape(message)):
            read_contacts("\n".join(spoiled), "log.txt", found.plan, None)
    once = read_contacts("\n".join([*lines[:3], *lines[4:]]), "log.txt", found.plan, None)
    assert once.notes == ("log.txt, line 3: this contact has one touch, not two",)
    short = read_contacts("\n".join(lines[:24]), "log.txt", found.plan, None)
    assert short.notes == (f"the log ends after 2 of {len(found.plan)} centres",)


def as_captured(text):
    """As a computer on a serial line has it: zeros and DC2 before, DC4 behind, a byte order mark, ends of CR LF."""
    return b"\xef\xbb\xbf\0\0\x12" + text.replace("\n", "\r\n").encode() + b"\x14\0\0"


@pytest.mark.parametrize("control", CONTROLS)
def test_logs_with_marks_around_them_are_read(control):
    found = planned("dmu50")
    text = log_of(found, control, contacts(found, model_of(DMU50, [])))
    plain, marked = (
        read_contacts(log_text(data, "log.txt"), "log.txt", found.plan, plan_id(found.plan))
        for data in (text.encode(), as_captured(text))
    )
    np.testing.assert_array_equal(plain.positions, marked.positions)
    assert plain.notes == marked.notes == ()


@pytest.mark.parametrize("control", CONTROLS)
def test_a_line_that_is_cut_off_is_not_used(control):
    """A contact with fewer decimals would be wrong by some um, without any other sign."""
    found = planned("dmu50")
    whole = log_of(found, control, contacts(found, model_of(DMU50, []))).removesuffix("%\n").rstrip()
    with pytest.raises(UserError, match=f"log.txt, line {len(whole.splitlines())}: "):
        read_contacts(whole[:-25], "log.txt", found.plan, plan_id(found.plan))
    for lost in (0, 2):
        text = whole[: len(whole) - lost]
        read = read_contacts(text, "log.txt", found.plan, plan_id(found.plan))
        # LinuxCNC has written the first touch of this contact in the line before
        assert len(read.row) == len(found.plan) - (lost > 0 and control != "linuxcnc")
        line = len(text.splitlines())
        assert [note for note in read.notes if "cut off" in note] == [
            f"log.txt, line {line}: the line is cut off, and not used"
        ] * (lost > 0)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("NCOMP PLAN 7\nNCOMP P1 T1 X1,5 Y2,5 Z3,5\n".encode("utf-16"), "log.txt is UTF-16 text: save it as plain"),
        (b"\x1f\x8b\x08\0" + bytes(60), "log.txt: this is a packed archive, no log: give the file that"),
        (b"%\nO1234\nG21 G17\n", "log.txt: this is an NC program, no log"),
        (b"NCOMP PLAN 7\nNCOMP P1 T1 X1,5 Y2,5 Z3,5\n", "line 2: 'NCOMP P1 T1 X1,5 Y2,5 Z3,5': expected NCOMP P row T "
         "touch X.. Y.. Z..; write the decimal point as '.'"),
        (b"1,5 2,5 3,5 0 0 0 0 0 0\n", "expected the nine numbers of PROBEOPEN, or NCOMP P row T touch ...; write the"),
    ],
)  # fmt: skip
def test_files_that_are_no_logs_are_refused_with_their_cause(data, message):
    with pytest.raises(UserError, match=re.escape(message)):
        read_contacts(log_text(data, "log.txt"), "log.txt", planned("dmu50").plan, 7)


# ---- files and commands


def test_plans_are_read_as_written_and_are_no_measurements(tmp_path):
    found = planned("dmu50", spheres=2)
    path = tmp_path / "plan.csv"
    with path.open("wb") as file:
        write_plan(found.plan, file)
    again = read_plan(path, DMU50)
    assert again.spheres == found.plan.spheres
    assert plan_id(again) == plan_id(found.plan)
    np.testing.assert_allclose(again.positions, found.plan.positions, atol=1e-4)
    assert again.state.station.tolist() == found.plan.state.station.tolist()
    with pytest.raises(UserError, match="this file is a plan, its positions are not measured"):
        read_measurement(path, DMU50)


PLAN = [
    "plan", "--machine", "dmu50", "--instrument", "touch-probe", "--strategy", "grid", "--points", "8",
    "--sphere", "s1=130,20,60", "--sphere", "s2=-110,60,50",
]  # fmt: skip


def test_plan_simulate_and_touches(ncomp):
    done = ncomp(*PLAN, "-o", "plan.csv", "--nc", "plan.nc", "--json", "plan.json", "--dialect", "heidenhain")
    assert done.status == 0, done.err
    result = json.loads(Path("plan.json").read_text())
    assert result["touches"] == 5 * result["centres"]
    assert ["E_CZ"] in [each["effects"] for each in result["not_visible"]]
    assert result["location_errors_U"]["E_X0C"] > 0.0
    assert "E_CZ" in done.err
    assert Path("ncomp.a").read_text().startswith('"NCOMP P%5.0LF')
    simulate = ["simulate", "--machine", "dmu50", "--strategy", "plan.csv", "--instrument", "touch-probe"]
    done = ncomp(*simulate, "--errors", "none", "--location", "40", "-o", "data.csv")
    assert done.status == 0, done.err
    refused = ncomp(*simulate[:-1], "laser-tracker", "-o", "no.csv")
    assert "a plan of spheres needs --instrument touch-probe" in refused.err
    data, plan = read_measurement(Path("data.csv"), DMU50), read_plan(Path("plan.csv"), DMU50)
    assert data.state.station.tolist() == plan.state.station.tolist()
    log = log_of_file(plan, data)
    Path("log.txt").write_text(log)
    done = ncomp("touches", "log.txt", "--machine", "dmu50", "--plan", "plan.csv", "-o", "again.csv", "--json", "-")
    assert done.status == 0, done.err
    again = read_measurement(Path("again.csv"), DMU50)
    np.testing.assert_allclose(again.state.positions, data.state.positions, atol=2e-4)
    assert json.loads(done.out)["repeats"][-1]["row"] == len(plan)
    Path("log.txt").write_text(log.replace("NCOMP P1 T1 ", "NCOMP P1 T1 Q7 "))
    done = ncomp("touches", "log.txt", "--machine", "dmu50", "--plan", "plan.csv", "-o", "no.csv")
    assert (done.status, Path("no.csv").exists()) == (2, False)
    assert "log.txt, line 2: " in done.err


def log_of_file(plan, data):
    """The log of touches from five sides of the measured centres."""
    lines = [f"NCOMP PLAN {plan_id(plan)}"]
    sides = np.array([(0, 0, 1), (1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0)]) * CONTACT
    for row, (q, rotation) in enumerate(
        zip(data.state.positions, forward(DMU50, data.state.positions).rotation, strict=True)
    ):
        tips = tool_point(DMU50, q[None], TIP) + sides @ rotation.T
        at = linear_positions(DMU50, np.tile(q, (5, 1)), tips, TIP) / DMU50.scale
        for touch, each in enumerate(at.tolist(), start=1):
            cells = " ".join(f"{name}{value:.5f}" for name, value in zip(DMU50.names, each, strict=True))
            lines.append(f"NCOMP P{row + 1} T{touch} {cells}")
    return "\n".join(lines) + "\n"


BAD = {
    "spheres of a tracker": (["plan", "-m", "dmu50", "--strategy", "grid", "--sphere", "s=0,0,60"], "--sphere is an option of ncomp plan spheres"),
    "options of a strategy": ([*PLAN, "--spacing", "5"], "--spacing is an option of ncomp plan points"),
    "design": (["planes" if word == "grid" else word for word in PLAN], "for a touch probe expected one of optimised"),
    "out of reach": ([*PLAN[:-4], "--sphere", "s1=900,0,60"], "the machine reaches the spheres at 0 of"),
    "tip": ([*PLAN, "--target", "p=50,0,-150"], "on its axis"),
    "sizes": ([*PLAN, "--dimensions", "ball=25,bowl=3"], "--dimensions bowl=3: expected each of"),
    "distance": ([*PLAN, "--distance", "s1.s9=1"], "there is no sphere 's9'"),
    "range": ([*PLAN, "--range", "X=0:100"], "the linear axes follow from the spheres"),
    "fanuc": ([*PLAN, "--nc", "x.nc", "--dialect", "fanuc"], "G53 of this control always moves in rapid"),
    "three axes": (["plan", "-m", "cframe", "--instrument", "touch-probe"], "no rotary axis moves"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_bad_options(ncomp, name):
    arguments, message = BAD[name]
    done = ncomp(*arguments, "-o", "plan.csv")
    assert (done.status, Path("plan.csv").exists()) == (2, False)
    assert message in " ".join(done.err.split())


def test_samba_needs_three_spheres():
    request = ProbeRequest(Probe(TIP), Artefact(spheres_of("dmu50", 3)), "samba", 9)
    assert probe_plan(DMU50, request).plan.position_count >= 7
    with pytest.raises(UserError, match="three spheres or more"):
        probe_plan(DMU50, replace(request, artefact=Artefact(spheres_of("dmu50", 2))))


# ---- LinuxCNC

# a cycle of LinuxCNC's servo thread, 1 ms, moves the probe by 1 um at the measuring feed
QUICK = ["--feed", "60000", "--clearance", "2.5", "--probing-feed", "600", "--measuring-feed", "60"]


@pytest.mark.statistical
def test_linuxcnc_measures_the_location_errors_of_a_machine(ncomp, linuxcnc_sim):
    """The program runs in LinuxCNC's simulator on a machine with errors; its log is read, fitted and compared."""
    done = ncomp(*PLAN[:5], "--strategy", "optimised", "--points", "4", *PLAN[9:11], *QUICK, "-o", "plan.csv",
                 "--nc", "plan.ngc", "--json", "plan.json", "--dialect", "linuxcnc")  # fmt: skip
    assert done.status == 0, done.err
    log = f"ncomp{json.loads(Path('plan.json').read_text())['plan_id']}.txt"
    effects = [e for e in random_location_errors(DMU50, np.random.default_rng(5), 60.0) if e.axis in "BC"]
    program = Path("plan.ngc").read_text().replace("\nM0\n", "\n")
    config = config_of(DMU50, effects, [(130.4, 19.7, 60.2)], TIP, log)
    Path("log.txt").write_text(linuxcnc_sim.run(config, program, timeout=200.0).texts[log])
    done = ncomp("touches", "log.txt", "--machine", "dmu50", "--plan", "plan.csv", "-o", "data.csv", "--json", "-")
    assert done.status == 0, done.err
    assert 0.2 < json.loads(done.out)["u_um"] < 4.0
    data = read_measurement(Path("data.csv"), DMU50)
    model = fit(data, model_of(DMU50, [LocationError(e.component, e.axis, 0.0) for e in effects])).model
    for real, found in zip(effects, model.effects, strict=True):
        assert abs(real.value - found.value) < max(4.0 * found.uncertainties[0], 5.0), (real, found)
