"""The table of runs: a name, the input files, and the command line as a user gives it."""

from __future__ import annotations

from dataclasses import dataclass

from tests.golden.comparison import EXACT, SEARCHED, Rounding

CFRAME = "simulate --machine cframe --errors none --seed 1"
TARGETS = "--target t1=0,0,-120 --target t2=60,0,-150 --target t3=0,70,-90"
PRECISE = "-u u_angle_um=3 -u u_range_um=0.5 --tracker=-900,700,300"
SMOOTH = "legendre:2"
SPHERES = "X=legendre:1,Y=legendre:1,Z=legendre:1,B=fourier:1,C=fourier:1"
SINGLE = "--machine single_axis.toml --header u_um=0.5"
CIRCLES = "--instrument ballbar --centre 300,225,150 --target t1=0,0,-120 --feed 1000"

RECIPES: dict[str, tuple[str, ...]] = {
    "truth": ("simulate --machine cframe --strategy random --points 12 --seed 2 -o points.csv --truth cal.json",),
    "two": (
        "simulate --machine cframe --strategy random --points 6 --seed 2 -o points.csv --truth a.json",
        "simulate --machine cframe --strategy random --points 6 --seed 3 -o points.csv --truth b.json",
    ),
    "five-axis": (
        "simulate --machine dmu50 --strategy random --rotary random --points 12 --seed 2 --location 40 --errors none "
        "-o points.csv --truth cal.json",
    ),
    "trunnion": (
        "simulate --machine trunnion_bc --strategy random --rotary random --range C=0:360 --points 6 --seed 2 --location 40 "
        "--errors none -o points.csv --truth cal.json",
    ),
    "play": (
        f"{CFRAME} --strategy random --points 6 --effect backlash:axis=X,width=12 --effect cyclic:component=X,axis=X,"
        "period=10,sine=[4],cosine=[3] -o points.csv --truth cal.json",
    ),
    "tracker": (
        f"simulate --machine cframe --seed 1 --strategy random --points 50 --order shuffled {TARGETS} {PRECISE} "
        "--target-order alternating -o data.csv",
    ),
    "tracker-backlash": (
        f"{CFRAME} --strategy random --points 60 --order shuffled --target t1=0,0,-120 {PRECISE} "
        "--effect backlash:axis=X,width=20 -o data.csv",
    ),
    "later": (
        "simulate --machine cframe --strategy random --points 6 --seed 2 -o points.csv --truth cal.json",
        f"simulate --machine cframe --calibration cal.json --strategy random --points 60 --order shuffled {PRECISE} "
        "--target t1=0,0,-120 --effect location:component=C,axis=Y,value=60 -o data.csv",
    ),
    "laser": (
        f"{CFRAME} --strategy axes --spacing 50 --range Y=200 --range Z=200 --instrument interferometer --runs 3 "
        "--effect backlash:axis=X,width=20 --effect scale:axis=X,scale=30 -o laser.csv",
    ),
    "laser-cyclic": (
        f"{CFRAME} --strategy axes --spacing 7 --range Y=200 --range Z=200 --instrument interferometer --runs 2 "
        "--effect cyclic:component=X,axis=X,period=40,sine=[4],cosine=[3] -o laser.csv",
    ),
    "circles": (f"{CFRAME} {CIRCLES} --bar 150:0.5 --effect backlash:axis=X,width=12 -o circles.csv",),
    "circles-in-two-planes": (
        f"{CFRAME} {CIRCLES} --plane XY --plane ZX --effect location:component=C,axis=Y,value=30 "
        "--effect servo-mismatch:axis=X,other=Y,lag_ms=1 -o circles.csv",
    ),
    "probe": (
        "simulate --machine dmu50 --strategy random --rotary random --points 24 --seed 2 --location 40 --errors none "
        "--instrument touch-probe --sphere s1=130,20,60 --sphere s2=-110,60,50 --target probe=0,0,-150 -o spheres.csv",
    ),
    "part": (
        "simulate --machine cframe --seed 4 --strategy grid --points 120 --range Z=100 --planar --instrument part "
        "-u u_um=1 -o part.csv",
    ),
    "path": (
        "plan --machine cframe --strategy on-the-fly --target t=0,0,-120 --length-m 4 --feed 5000 -o path.csv --nc path.nc",
        "simulate --machine cframe --path path.nc --target t=0,0,-120 --feed 5000 --rate 20 --seed 3 -o points.csv",
    ),
    "constant-velocity": (
        "simulate-continuous --machine cframe --axis X --start-mm 0 --end-mm 450 --feed 2000 --spacing 90 --both "
        "--runs 2 -o run.csv --quasistatic targets.csv --vibration 35:0.3",
    ),
    "series": (
        "simulate --machine cframe --strategy axes --spacing 50 --stands-on bed --seed 5 "
        f"--target-order alternating {TARGETS} -o data.csv",
    ),
}
"""Commands that make the input files; only these are given to the run."""


@dataclass(frozen=True)
class Run:
    """A command line, and its input files: a recipe, `shared:` a file of real data, `file:` one of the repository,
    `few-draws:` a study of the repository with two draws."""

    name: str
    line: str
    data: tuple[str, ...] = ()
    heavy: bool = False
    """In the statistical tier."""
    exam: bool = False
    """An exam: a long diagnosis, of which a shorter one of its kind is in another tier."""

    @property
    def rounding(self) -> Rounding:
        """Differences of numbers that are rounding."""
        return SEARCHED if self.line.startswith("diagnose") else EXACT


FORMATS = (
    ("truth", "cframe", "", "linuxcnc siemens-eec isg mitsubishi klipper reprap csv"),
    (
        "truth",
        "cframe",
        "--sign error",
        "siemens-cec heidenhain heidenhain-kinematics fanuc isg-cross isg-volumetric etalon",
    ),
    ("five-axis", "dmu50", "", "fanuc-kinematics"),
    ("five-axis", "dmu50", "--sign error", "siemens-trafo5 siemens-tcarr heidenhain-transformations"),
    ("trunnion", "trunnion_bc", "--set conventional=true", "linuxcnc-kinematics"),
)
"""Calibration, machine, meaning of the values, and the formats that are written with them."""
FIT = "-o new.json --json fit.json"
DIAGNOSE = "-o new.json --json diagnosis.json"
RUNS = (
    Run("fit-tracker", f"fit data.csv --machine cframe --basis {SMOOTH} {FIT} --report page.html", ("tracker",), heavy=True),
    Run("fit-tracker-basis-by-evidence", f"fit data.csv --machine cframe {FIT}", ("tracker",), heavy=True),
    Run("fit-backlash", f"fit data.csv --machine cframe --basis {SMOOTH} --effect backlash:axis=X,width=1 {FIT}", ("tracker-backlash",)),
    Run("fit-refused", f"fit data.csv --machine cframe --basis legendre:3 {FIT}", ("tracker-backlash",)),
    Run("fit-estimated-noise", f"fit data.csv --machine cframe --basis {SMOOTH} --noise estimate --prior-scale 1 {FIT}", ("tracker",)),
    Run("fit-interferometer", f"fit laser.csv --machine cframe {FIT}", ("laser",)),
    Run("fit-two-instruments", f"fit laser.csv circles.csv --machine cframe --basis {SMOOTH} {FIT}", ("laser", "circles"), heavy=True),
    Run("fit-spheres", f"fit spheres.csv --machine dmu50 --prior-scale 0.1 --basis {SPHERES} {FIT}", ("probe",)),
    Run("fit-part", f"fit part.csv --machine cframe {FIT}", ("part",), heavy=True),
    Run("square", "square --ac 319 --bd 318 --ad 199 --machine cframe -o cal.json --json square.json", ()),
    Run("fit-circles", f"fit circles.csv --machine cframe --basis {SMOOTH} --effect backlash:axis=X,width=1 {FIT}", ("circles",)),
    Run("fit-on-the-fly", f"fit points.csv --machine cframe --path path.nc --basis legendre:2 {FIT}", ("path",), heavy=True),
    Run("fit-runs-of-iso230", f"fit x_iso230_2_report.md {SINGLE} {FIT}", ("shared:iso230/x_iso230_2_report.md", "file:examples/single_axis.toml")),
    Run("fit-plate", f"fit D8131_1 --machine gantry --header u_um=2.3 {FIT}", ("shared:plug_plates/D8131_1",), heavy=True),
    Run("diagnose-runs-of-iso230", f"diagnose x_iso230_2_report.md {SINGLE} {DIAGNOSE} --report page.html", ("shared:iso230/x_iso230_2_report.md", "file:examples/single_axis.toml")),
    Run("diagnose-plate", f"diagnose D8131_1 --machine gantry --header u_um=2.3 {DIAGNOSE}", ("shared:plug_plates/D8131_1",), heavy=True),
    Run("diagnose-large-plate", f"diagnose D1396A1 --machine gantry --header u_um=2.3 {DIAGNOSE}", ("shared:plug_plates/D1396A1",), exam=True),
    Run("diagnose-slit-axis", f"diagnose axis1_resolver_openloop.log --machine single_axis.toml --header command=IOC_TEST:Axis1-PosAct --header observed=IOC_TEST:ec0-s4-EL7211-Enc-PosAct --header axis=X --header u_um=0.3 {DIAGNOSE}", ("shared:slit_axis/axis1_resolver_openloop.log", "file:examples/single_axis.toml"), exam=True),
    Run("diagnose-resolver", f"diagnose ResolverCiclicError2.csv --machine single_axis.toml --header 'command=fActPosition (Internal Counter)' --header 'observed=fActPosition (Resolver)' --header u_um=20 {DIAGNOSE}", ("shared:resolver/ResolverCiclicError2.csv", "file:examples/single_axis.toml"), exam=True),
    Run("diagnose-ordinary-none", f"diagnose cframe-none.csv --machine cframe {DIAGNOSE}", ("shared:ordinary_runs/cframe-none.csv",), heavy=True),
    Run("diagnose-ordinary-backlash", f"diagnose cframe-backlash.csv --machine cframe {DIAGNOSE}", ("shared:ordinary_runs/cframe-backlash.csv",), exam=True),
    Run("diagnose-ordinary-strange", f"diagnose cframe-strange.csv --machine cframe {DIAGNOSE}", ("shared:ordinary_runs/cframe-strange.csv",), exam=True),
    Run("diagnose-ordinary-two", f"diagnose cframe-two.csv --machine cframe {DIAGNOSE}", ("shared:ordinary_runs/cframe-two.csv",), exam=True),
    Run("diagnose-interferometer", f"diagnose laser.csv --machine cframe {DIAGNOSE}", ("laser",)),
    Run("diagnose-interferometer-cyclic", f"diagnose laser.csv --machine cframe {DIAGNOSE} --report page.html", ("laser-cyclic",)),
    Run("diagnose-circles", f"diagnose circles.csv --machine cframe {DIAGNOSE}", ("circles",), heavy=True),
    Run("diagnose-tracker", f"diagnose data.csv --machine cframe {DIAGNOSE}", ("tracker",), heavy=True),
    Run("diagnose-tracker-backlash", f"diagnose data.csv --machine cframe {DIAGNOSE}", ("tracker-backlash",), exam=True),
    Run("diagnose-change-since-calibration", f"diagnose data.csv --machine cframe --calibration cal.json {DIAGNOSE}", ("later",), heavy=True),
    Run("diagnose-spheres", f"diagnose spheres.csv --machine dmu50 {DIAGNOSE}", ("probe",), heavy=True),
    Run("diagnose-part", f"diagnose part.csv --machine cframe {DIAGNOSE}", ("part",), heavy=True),
    *(
        Run(f"plan-{strategy}", f"plan --machine cframe --strategy {strategy} --points 30 -o plan.csv --json plan.json --nc plan.nc")
        for strategy in ("planes", "hexahedron", "diagonals", "face-diagonals", "space-diagonals", "grid", "random", "space-filling", "hexahedron+random")
    ),
    Run("plan-axes", "plan --machine cframe --strategy axes --spacing 100 --runs 2 --feed 3000 -o plan.csv --json plan.json --nc plan.nc"),
    Run("plan-rotary", f"plan --machine dmu50 --strategy space-filling --rotary simultaneous --points 30 --order shuffled --references 10 {TARGETS} --target-order alternating -o plan.csv --json plan.json"),
    Run("plan-swept", "plan --machine head_table --strategy grid --rotary swept --range C=0:360 --points 27 --approach positive -o plan.csv --json plan.json"),
    Run("plan-optimised", "plan --machine cframe --optimise --points 20 --tracker=-900,700,300 --target t1=0,0,-120 -o plan.csv --json plan.json --report page.html", heavy=True),
    Run("plan-touch-probe", "plan --machine dmu50 --instrument touch-probe --points 16 --sphere s1=130,20,60 --target probe=0,0,-150 -o plan.csv --json plan.json --nc plan.ngc --dialect linuxcnc", heavy=True),
    Run("plan-on-the-fly", "plan --machine cframe --strategy on-the-fly --target t=0,0,-120 --length-m 4 --feed 5000 -o path.csv --nc path.nc --json plan.json", heavy=True),
    Run("iso230", "iso230 laser.csv --machine cframe -o table.csv --json iso230.json --report page.html", ("laser",)),
    Run("iso230-report", f"iso230 x_iso230_2_report.md {SINGLE} --json iso230.json", ("shared:iso230/x_iso230_2_report.md", "file:examples/single_axis.toml")),
    Run("ballbar", "ballbar circles.csv --machine cframe --json ballbar.json --report page.html", ("circles",)),
    Run("ballbar-two-planes", "ballbar circles.csv --machine cframe --json ballbar.json", ("circles-in-two-planes",)),
    Run("continuous", "continuous run.csv targets.csv -o table.csv --json continuous.json --report page.html", ("constant-velocity",)),
    Run("continuous-calibration", "continuous run.csv targets.csv -o table.csv --machine cframe --write-calibration cal.json", ("constant-velocity",)),
    Run("three-points", "three-points data.csv --machine cframe -o cal.json --json three_points.json --report page.html", ("series",), heavy=True),
    Run("three-points-table", "three-points data.csv --machine cframe --basis table --tables -o cal.json --json three_points.json", ("series",)),
    Run("predict", "predict points.csv --machine cframe --calibration cal.json -o predicted.csv", ("truth",)),
    Run("predict-five-axis", "predict points.csv --machine dmu50 --calibration cal.json -o predicted.csv", ("five-axis",)),
    Run("compare", "compare a.json b.json --json compare.json --report page.html", ("two",)),
    Run("compare-least-squares", "compare a.json b.json --straightness least-squares --reference X=0 --json compare.json", ("two",)),
    *(
        Run(f"export-{name}", f"export --machine {machine} --calibration cal.json --format {name} {sign} -o tables --rest rest.json --json export.json", (data,))
        for data, machine, sign, names in FORMATS
        for name in names.split()
    ),
    Run("export-of-play", "export --machine cframe --calibration cal.json --format linuxcnc --set type=1 -o tables --rest rest.json --json export.json --report page.html", ("play",)),
    Run("export-probe", "export --machine cframe --calibration cal.json --format siemens-cec --probe X -o tables", ("truth",)),
    Run("study-spacing", "study spacing.toml -o results.csv --workers 1 --json study.json", ("few-draws:examples/studies/spacing.toml",), heavy=True),
    Run("study-tracker-position", "study tracker_position.toml -o results.csv --workers 1 --json study.json", ("few-draws:examples/studies/tracker_position.toml",), heavy=True),
    Run("study-trajectory", "study trajectory.toml -o results.csv --workers 1 --json study.json --report page.html", ("few-draws:examples/studies/trajectory.toml",)),
    Run("study-spheres", "study spheres.toml -o results.csv --workers 1 --json study.json", ("few-draws:examples/studies/spheres.toml",), heavy=True),
    Run("touches", "touches ncomp40661.txt --machine dmu50 --plan spheres.csv -o data.csv --json touches.json", ("file:examples/spheres/ncomp40661.txt", "file:examples/spheres/spheres.csv")),
)  # fmt: skip
