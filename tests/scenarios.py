"""The table of scenarios of a diagnosis: how the data are made, and what has to be said of them.

A scenario enters by commands only: `ncomp simulate` makes its data, `ncomp diagnose` answers.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field

TRACKER = "-u u_angle_um=3 -u u_range_um=0.5"
AT_CFRAME = f"{TRACKER} --tracker=-900,700,300"
ROUND_CFRAME = f"{TRACKER} --tracker=-900,700,300 --tracker=1500,-600,200 --tracker=300,1500,250"
AT_DMU50 = f"{TRACKER} --tracker=-1500,-1500,300"
LASER = "--instrument interferometer -u u_um=0.2"
BALLBAR = "--instrument ballbar --centre 300,225,150 --bar 150:0.5 --target t1=0,0,-120"
PART = "--instrument part --planar -u u_um=1"
PROBE = "--instrument touch-probe --sphere s1=130,20,60 --sphere s2=-110,60,50 --target probe=0,0,-150"

SPHERES = "--basis X=legendre:1,Y=legendre:1,Z=legendre:1,B=fourier:1,C=fourier:1 --prior-scale 0.1"
"""Options of `ncomp fit` for spheres on a rotary table."""

ONE = "--target t1=0,0,-120"
THREE = f"{ONE} --target t2=60,0,-150 --target t3=0,70,-90"
SCATTERED = f"--strategy random --points 60 --order shuffled {ONE}"
SCATTERED_TWICE = f"--strategy random --points 40 --runs 2 --order shuffled {ONE}"
WITH_REFERENCE = f"{SCATTERED_TWICE} --target table.r1=-100,-100,50 --target-order alternating"
THREE_TARGETS = f"--strategy random --points 40 --order shuffled {THREE} --target-order alternating"
SWEPT = f"--strategy grid --points 64 {ONE}"
TURNING = f"--strategy random --rotary random --points 70 --order shuffled {ONE} --target t2=60,0,-150 --target-order alternating"
ALONG_X = "--strategy axes --range Y=200 --range Z=200 --spacing 25 --runs 3"
FINE_ALONG_X = "--strategy axes --range Y=200 --range Z=200 --spacing 7.3 --runs 2"
ALL_AXES = "--strategy axes --spacing 50 --runs 3"
TWO_FEEDS = "--plane XY --feed 1000 --feed 3000"
THREE_PLANES = "--plane XY --plane YZ --plane ZX --feed 1000"
HOLES = "--strategy grid --points 49 --range Z=100"
ROTARY = "--strategy random --rotary random --points 24"


@dataclass(frozen=True)
class Scenario:
    """Data with known causes in them, and what a diagnosis has to say."""

    name: str
    machine: str
    instrument: str
    """Options of `ncomp simulate` for the instrument."""
    design: str
    """Its options for positions, sequence and targets."""
    effects: tuple[str, ...] = ()
    """Each as `--effect` takes it, with its size in um and urad."""
    conditions: str = ""
    """Further options of `ncomp simulate`: temperatures, outliers."""
    errors: str = "--errors none"
    """The smooth error motions of the machine."""
    seed: int = 1
    before: str = ""
    """The calibration from which the diagnosis starts: `truth`, of the machine without the effects; `fit OPTIONS`, a
    fit of earlier data of it; `coarse OPTIONS`, one of the same data; empty for none."""
    causes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Each cause that has to be named, and sizes that have to be inside three standard uncertainties."""
    ties: Mapping[str, str] = field(default_factory=dict)
    """A cause that has to be named as tied, and the one that it is tied with."""
    notes: tuple[str, ...] = ()
    """What has to stand in the answer."""
    fails: str = ""
    """What is wrong with the present answer; empty where it is right."""
    heavy: bool = True
    """In the statistical tier."""

    @property
    def commands(self) -> tuple[str, ...]:
        """The command lines, the diagnosis last."""
        simulate = f"simulate --machine {self.machine} --seed {self.seed}"
        how, _, options = self.before.partition(" ")
        machine = "--calibration before.json" if how == "truth" else self.errors
        effects = " ".join(f"--effect {shlex.quote(effect)}" for effect in self.effects)
        run = f"{self.conditions} {self.instrument} {self.design}"
        data = f"{simulate} {machine} {run} {effects} -o data.csv"
        fit = f"--machine {self.machine} {options} -o before.json"
        diagnosis = f"diagnose data.csv --machine {self.machine} -o new.json --json diagnosis.json"
        against = f"{diagnosis} --calibration before.json"
        match how:
            case "truth":
                return (
                    f"{simulate} --errors table-1 --strategy random --points 6 -o points.csv --truth before.json",
                    data,
                    against,
                )
            case "fit":
                return f"{simulate} {machine} {run} -o earlier.csv", f"fit earlier.csv {fit}", data, against
            case "coarse":
                return data, f"fit data.csv {fit}", against
        return data, diagnosis


def _tracker(name: str, effect: str, design: str = SCATTERED, **more: object) -> Scenario:
    """A C-frame machine, measured with a laser tracker."""
    return Scenario(name, "cframe", AT_CFRAME, design, (effect,) if effect else (), **more)  # type: ignore[arg-type]


def _laser(name: str, effect: str, design: str = ALONG_X, **more: object) -> Scenario:
    """A C-frame machine, measured with an interferometer."""
    return Scenario(name, "cframe", LASER, design, (effect,) if effect else (), heavy=False, **more)  # type: ignore[arg-type]


def _ballbar(name: str, effect: str, design: str = TWO_FEEDS, **more: object) -> Scenario:
    """A C-frame machine, measured with a ballbar."""
    return Scenario(name, "cframe", BALLBAR, design, (effect,) if effect else (), **more)  # type: ignore[arg-type]


SCENARIOS = (
    _laser("nothing wrong, interferometer", ""),
    _laser("backlash", "backlash:axis=X,width=12", causes={"backlash X": {"width_um": 12}}),
    _laser("negative backlash", "backlash:axis=X,width=-12", causes={"backlash X": {"width_um": -12}}, notes=("larger than the real backlash",)),
    _laser("wind-up", "backlash:axis=X,width=10,windup=40", causes={"backlash X": {"width_um": 10, "windup_um_per_m": 40}}),
    _laser("hysteresis", "hysteresis:axis=X,width=20,length=100", causes={"hysteresis X": {"width_um": 20, "length_mm": 100}}),
    _laser("cyclic", "cyclic:component=X,axis=X,period=40,sine=[4],cosine=[3]", FINE_ALONG_X, causes={"cyclic X": {"period_mm": 40, "sine_um": 4, "cosine_um": 3}}),
    _laser("steps", "quantised-compensation:axis=X,step=8,pitch=62,offset=20", FINE_ALONG_X, notes=("quantised-compensation X", "62.04")),
    _laser("growth with time", "thermal-scale:axis=X,rate=60", causes={"thermal-scale X": {"rate_um_per_m_per_h": 60}}),
    _laser("growth with a temperature", "thermal-scale-sensor:axis=X,sensor=scale,coefficient=11", conditions="--temperature scale=20:26", causes={"thermal-scale X": {"coefficient_um_per_m_per_k": 11}}),
    _laser("settling", "settling:axis=X,share_ppm=60", FINE_ALONG_X, ties={"settling X": "backlash X"}),
    _laser("scale since the calibration", "scale:axis=X,scale=40", causes={"scale X": {"scale_um_per_m": 40}}, before="truth"),
    _laser("zero of an axis", "location-jump:component=X,axis=X,value=20,since_s=900", causes={"location-jump X": {"value_um": 20}}),
    Scenario("backlash and cyclic", "cframe", LASER, FINE_ALONG_X, ("backlash:axis=X,width=6", "cyclic:component=X,axis=X,period=40,sine=[4],cosine=[3]"), causes={"backlash X": {"width_um": 6}, "cyclic X": {"period_mm": 40}}),
    _ballbar("nothing wrong, ballbar", ""),
    _ballbar("servo mismatch", "servo-mismatch:axis=X,other=Y,lag_ms=1.0", causes={"servo-mismatch X": {"lag_ms": 1.0}}),
    _ballbar("reversal spike", "reversal-spike:axis=X,height=12,length=5", causes={"reversal-spike X": {}}),
    _ballbar("lateral play", "lateral-play:component=Y,axis=X,play=8", THREE_PLANES, causes={"lateral-play X": {"play_um": 8}}),
    _ballbar("backlash, ballbar", "backlash:axis=X,width=12", THREE_PLANES, causes={"backlash X": {"width_um": 12}}),
    _ballbar("squareness since the calibration", "location:component=C,axis=Y,value=40", THREE_PLANES, causes={"location Y": {"value_urad": 40}}, before="truth"),
    _tracker("nothing wrong, tracker", ""),
    _tracker("backlash, tracker", "backlash:axis=X,width=20", causes={"backlash X": {"width_um": 20}}),
    _tracker("backlash in a sweep", "backlash:axis=Z,width=20", SWEPT, ties={"backlash Z": "settling Z"}),
    _tracker("squareness, tracker", "location:component=C,axis=Y,value=60", causes={"location Y": {"value_urad": 60}}, before="truth", heavy=False),
    _tracker("drift of the tool", "thermal-drift:component=Z,rate=30", WITH_REFERENCE, ties={"thermal-drift Z": "thermal-scale Z about any Z"}),
    _tracker("drift of the tool or of the tracker", "thermal-drift:component=Z,rate=200", SWEPT, ties={"thermal-drift Z": "thermal-scale Z about any Z"}, notes=("tracker-drift",)),
    _tracker("drift with a temperature", "thermal-drift-sensor:component=Z,sensor=spindle,coefficient=6", SCATTERED_TWICE, conditions="--temperature spindle=20:27", ties={"thermal-drift Z": "thermal-scale-sensor Z spindle about any Z"}),
    _tracker("drift of the tracker", "tracker-drift:shift_um_per_h=[20,-15,10],turn_urad_per_h=[0,0,0]", WITH_REFERENCE, causes={"tracker-drift": {}}),
    _tracker("station shift", "station-shift:station=s1,since_s=700,shift_um=[15,-10,12],turn_urad=[25,-30,20]", SCATTERED_TWICE, causes={"station-shift s1": {}}),
    _tracker("target in its nest", "target-offset:target=t2,offset_um=[15,-10,12]", THREE_TARGETS, causes={"target-offset t2": {"offset_um": 15}}),
    _tracker("outliers, tracker", "", SCATTERED_TWICE, conditions="--outliers 0.03", causes={"outliers": {}}),
    _tracker("range of one station", "tracker-range:offset_um=20", notes=("tracker-range",)),
    Scenario("range, three stations", "cframe", ROUND_CFRAME, SCATTERED_TWICE, ("tracker-range:offset_um=20",), causes={"tracker-range": {"offset_um": 20}}, before="truth"),
    Scenario("air", "cframe", ROUND_CFRAME, SCATTERED_TWICE, ("air-scale:scale_um_per_m=12",), causes={"air-scale": {"scale_um_per_m": 12}}, before="truth"),
    Scenario("angle of the tracker", "cframe", ROUND_CFRAME, SCATTERED_TWICE, ("tracker-angle:circle=azimuth,harmonic=2,sine_urad=15,cosine_urad=8",), causes={"tracker-angle azimuth": {"sine_urad": 15, "cosine_urad": 8}}, before="truth"),
    Scenario("nothing wrong, part", "cframe", PART, HOLES, heavy=False),
    Scenario("squareness of a part", "cframe", PART, HOLES, ("location:component=C,axis=Y,value=60",), causes={"location Y": {"value_urad": 60}}, before="truth", heavy=False),
    Scenario("nothing wrong, touch probe", "dmu50", PROBE, ROTARY),
    Scenario("line of a rotary axis", "dmu50", PROBE, ROTARY, ("location:component=X,axis=C,value=30",), causes={"location C": {"value_um": 30}}, before=f"fit {SPHERES} --force", heavy=False),
    Scenario("cyclic of a rotary axis", "dmu50", AT_DMU50, TURNING, ("cyclic:component=C,axis=C,period=10,sine=[30],cosine=[20]",), causes={"cyclic C": {"period_deg": 10}}),
    _tracker("counts lost by the tracker", "tracker-angle-step:circle=azimuth,over=azimuth,above_deg=-35,step_urad=30", SCATTERED_TWICE, causes={"tracker-angle azimuth": {}}),
    _tracker("bow with time", "thermal-distortion:component=Z,axis=X,interval=[0,600],degree=2,rate=40", SCATTERED_TWICE, causes={"thermal-distortion X": {}}, fails="odds of 14 to 1: below the 20 to 1 from which a cause is reported"),
    _laser("reversal along the axis", 'reversal:component=X,axis=X,basis={"kind":"legendre","interval":[0,600],"degree":2},differences=[15,5,10]', causes={"reversal X": {}}),
    _laser("two drifts of a length", "thermal-scale-quadratic:axis=X,sensor=scale,coefficient=5,quadratic=3", conditions="--temperature scale=18:26", causes={"thermal-scale X": {}}),
    _tracker("basis that is too coarse", "cyclic:component=X,axis=X,period=200,sine=[12],cosine=[6]", SCATTERED_TWICE, before="coarse --basis legendre:3 --force", causes={"cyclic X": {}}),
    _ballbar("following error", "following-error:axis=X,lag_ms=1", causes={"servo-mismatch X": {"lag_ms": 1}}),
    _tracker("twist", "cross-axis:component=Z,axis=X,other=Y,own_interval=[0,600],other_interval=[0,450],own_degree=1,other_degree=1,coefficients=[0,25]", causes={"cross-axis Y": {}}),
)  # fmt: skip
