"""Pages of reports in a real browser: drawn, clicked, turned, on a phone, in the dark, and printed."""

import base64
import re
import shlex
import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from clients.chromium import DESKTOP, PHONE
from pypdf import PdfReader
from support.command import succeed
from support.pages import figures, panels
from support.three_points_cases import SERIES, measured, model, random_effects, station

import machines
from calibration.measurement.written_file import write_measurement
from rendering.page import page as page_of
from rendering.report import Report, Section, Table

BOX = Path(__file__).parents[1] / "examples" / "box.nc"
A4 = (595, 842)
"""Points."""
DRAWN = "return [...document.querySelectorAll('.plot')].map(p => p.querySelectorAll('.main-svg').length)"
OVERFLOW = """return [...document.querySelectorAll('body *')].filter(e => !e.closest('.scroll') && !e.closest('.plot')
  && e.getBoundingClientRect().right > innerWidth + 1).map(e => e.tagName + '.' + e.className)"""
SIDEWAYS = """return [...document.querySelectorAll('.scroll')].filter(e => e.scrollWidth > e.clientWidth)
  .map(e => e.textContent.slice(0, 80))"""
"""Tables that scroll sideways."""
FAINT = """const paint = document.createElement('canvas').getContext('2d', {willReadFrequently: true});
function over(colour, opacity, paper) {
  paint.globalAlpha = 1; paint.fillStyle = paper; paint.fillRect(0, 0, 1, 1);
  paint.globalAlpha = opacity; paint.fillStyle = colour; paint.fillRect(0, 0, 1, 1);
  return paint.getImageData(0, 0, 1, 1).data;
}
function luminance(rgb) {
  const [r, g, b] = [...rgb].slice(0, 3).map(v => v / 255).map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}
const found = [];
for (const plot of document.querySelectorAll('.plot')) for (const trace of plot._fullData || []) {
  const paper = plot._fullLayout.paper_bgcolor, back = luminance(over(paper, 1, paper));
  const lines = trace.mode && trace.mode.includes('lines') && trace.line.width > 0 ? [[trace.line.color, 1, 3]] : [];
  const onMap = plot._fullData.some(other => other.type === 'heatmap' && other.xaxis === trace.xaxis);
  const dots = !onMap && trace.mode && trace.mode.includes('markers') ? [[trace.marker.color, trace.marker.opacity ?? 1, arguments[0]]] : [];
  const bars = trace.type === 'bar' ? [[trace.marker.color, trace.marker.opacity ?? 1, 3]] : [];
  for (const [colour, opacity, least] of [...lines, ...dots, ...bars]) {
    if (typeof colour !== 'string') continue;
    const front = luminance(over(colour, opacity, paper));
    const ratio = (Math.max(front, back) + 0.05) / (Math.min(front, back) + 0.05);
    if (ratio < least) found.push([trace.name, trace.type, colour, opacity, ratio.toFixed(2)]);
  }
}
return found"""
"""Lines and bars with less than 3 to 1 (WCAG 1.4.11) before their paper, and dots with less than the argument; those on a map are not before the paper."""
CUT = """return [...document.querySelectorAll('.plot')].flatMap(plot => { const room = plot.getBoundingClientRect();
  return [...plot.querySelectorAll('text')].map(t => [t.textContent, t.getBoundingClientRect()])
    .filter(([text, box]) => text && box.width && (box.left < room.left - 1 || box.right > room.right + 1
      || box.top < room.top - 1 || box.bottom > room.bottom + 1)).map(([text]) => text) })"""
"""Labels that a figure cuts."""
EMPTY = """return [...document.querySelectorAll('table:not(.facts)')].flatMap(table => {
  const rows = [...table.querySelectorAll('tbody tr')];
  return [...table.querySelectorAll('th')].map((head, i) => [head.textContent, rows.every(row => !row.cells[i].textContent.trim())])
    .filter(([, empty]) => empty).map(([head]) => [head, table.querySelector('th').textContent]) })"""
"""Columns of tables without a text."""
UNNAMED = """return [...document.querySelectorAll('table:not(.facts)')].filter(table =>
  [...table.querySelectorAll('th')].some(head => !head.textContent.trim())).map(table => table.textContent.slice(0, 80))"""
"""Tables with a column without a name."""
CUT_CONES = """return [...document.querySelectorAll('.plot')].flatMap(plot => (plot._fullData || [])
  .filter(trace => trace.type === 'cone').flatMap(trace => { const scene = plot._fullLayout[trace.scene];
    return [['x', 'u'], ['y', 'v'], ['z', 'w']].flatMap(([name, vector]) => { const [low, high] = scene[`${name}axis`].range;
      return [...trace[name]].map((at, i) => at + trace.sizeref * trace[vector][i]).filter(tip => tip < low || tip > high) }) }))"""
"""Coordinates of the tips of cones outside of their scenes."""
USED = """const done = arguments[arguments.length - 1];
(async () => { const found = [];
for (const plot of document.querySelectorAll('.plot')) {
  const layout = plot._fullLayout, names = Object.keys(layout).filter(name => /^scene\\d*$/.test(name));
  const picture = new Image();
  picture.src = await Plotly.toImage(plot, {format: 'png', width: layout.width, height: layout.height});
  await picture.decode();
  const paint = Object.assign(document.createElement('canvas'), {width: picture.width, height: picture.height})
    .getContext('2d', {willReadFrequently: true});
  paint.drawImage(picture, 0, 0);
  for (const name of names) {
    const {x, y} = layout[name].domain, left = Math.round(x[0] * picture.width), top = Math.round((1 - y[1]) * picture.height);
    const width = Math.round(x[1] * picture.width) - left, height = Math.round((1 - y[0]) * picture.height) - top;
    const {data} = paint.getImageData(left, top, width, height), columns = new Set(), rows = new Set();
    for (let k = 0; k < width * height; k++)
      if ([0, 1, 2].reduce((sum, c) => sum + Math.abs(data[4 * k + c] - data[c]), 0) > 6) { columns.add(k % width); rows.add(Math.floor(k / width)); }
    const extent = set => set.size ? Math.max(...set) - Math.min(...set) + 1 : 0;
    found.push([width, height, extent(columns) * extent(rows) / (width * height)]);
  }
}
done(found); })();"""
"""Width and height of the boxes of 3-D scenes, px, and the share of each that its drawing covers."""
CAMERA = "return document.querySelector('.plot')._fullLayout.scene._scene.getCamera().eye"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder for the pages, each of which is written once."""
    return tmp_path_factory.mktemp("pages")


@pytest.fixture(scope="module")
def correction(folder):
    """The page of the demonstration, with a head."""
    page, head = folder / "correction.html", folder / "head.toml"
    head.write_text('[report]\noperator = "A. Müller"\nserial_number = "4711"\n')
    set_up = ("--machine", "dmu50", "--work-offset", "G54=-30,-20,150", "--tool-length", "T1=80")
    succeed(BOX, *set_up, "-o", folder / "out.nc", "--report", page, "--report-head", head)
    return page


def check_screens(chromium, page, screens=((PHONE, False), (DESKTOP, True))):
    """All figures drawn without an error, nothing loaded, nothing wider than a phone, light and dark."""
    count = len(figures(page))
    chromium.requests()  # those of pages of other tests
    for width, night in screens:
        chromium.open(page, width, dark=night)
        shown = chromium.run("document.querySelectorAll('details').forEach(d => d.open = true);" + DRAWN)
        assert len(shown) == count
        assert all(shown)
        assert chromium.run("return document.documentElement.scrollWidth") <= width
        assert chromium.run(OVERFLOW) == []
        assert chromium.run(SIDEWAYS) == []
        assert chromium.run(FAINT, 2.0 if night else 1.4) == []
        assert chromium.run(CUT) == []
        assert chromium.run(EMPTY) == []
        assert chromium.run(UNNAMED) == []
        assert chromium.run(CUT_CONES) == []
        colour = chromium.run("return getComputedStyle(document.documentElement).backgroundColor")
        assert (sum(map(int, re.findall(r"\d+", colour))) < 200) == night
    assert chromium.errors() == []
    asked = [url for url in chromium.requests() if not url.startswith(("data:", "blob:", "about:", "chrome"))]
    assert {url.rpartition("/")[2] for url in asked} == {page.name}


def printed(page):
    """The texts of the A4 pages that `ncomp report` makes of a page; each with its number."""
    pdf = page.with_suffix(".pdf")
    succeed("report", page, "--pdf", pdf)
    reader = PdfReader(pdf)
    texts = [sheet.extract_text() for sheet in reader.pages]
    for number, (sheet, text) in enumerate(zip(reader.pages, texts, strict=True), start=1):
        assert tuple(map(float, sheet.mediabox[2:])) == pytest.approx(A4, abs=1)
        assert f"page {number} of {len(texts)}" in text
    return texts


@pytest.mark.statistical
def test_page_of_a_correction(chromium, correction):
    check_screens(chromium, correction)


@pytest.mark.statistical
def test_a_path_turns_and_answers_the_pointer(chromium, correction):
    from selenium.webdriver import ActionChains

    chromium.open(correction)
    plot = chromium.driver.find_element("css selector", ".plot")
    chromium.run("arguments[0].scrollIntoView({block: 'center'})", plot)
    before = chromium.run(CAMERA)
    quarter = -plot.size["width"] // 4
    ActionChains(chromium.driver).move_to_element_with_offset(plot, quarter, 0).click_and_hold().move_by_offset(
        90, 40
    ).release().perform()
    after = chromium.run(CAMERA)
    assert sum(abs(after[k] - before[k]) for k in "xyz") > 0.05
    line = chromium.driver.find_elements("css selector", ".plot")[1]
    chromium.run("arguments[0].scrollIntoView({block: 'center'})", line)
    texts = []
    for step in range(-4, 5):
        ActionChains(chromium.driver).move_to_element_with_offset(line, step * 60, -120 + 12 * step).perform()
        chromium.run("Plotly.Fx.hover(arguments[0], [{curveNumber: 0, pointNumber: 40}])", line)
        texts += chromium.run("return [...arguments[0].querySelectorAll('.hovertext')].map(t => t.textContent)", line)
    assert any(re.search(r"\d", text) for text in texts)


@pytest.mark.statistical
def test_lists_open_and_the_theme_changes_by_clicks(chromium, folder, monkeypatch):
    monkeypatch.chdir(folder)
    simulated, evaluated = KINDS["ballbar"]
    succeed(*shlex.split(simulated))
    succeed(*shlex.split(evaluated), "--report", "ballbar.html")
    chromium.open(folder / "ballbar.html")
    summary = chromium.driver.find_element("xpath", "//summary[contains(., 'Detection limits')]")
    text = chromium.driver.find_element("xpath", "//details[contains(., 'Detection limits')]/p")
    assert not text.is_displayed()
    summary.click()
    assert text.is_displayed()
    colour = "return getComputedStyle(document.documentElement).backgroundColor"
    figure = "return document.querySelectorAll('.plot')[0]._fullLayout.paper_bgcolor"
    light = chromium.run(colour), chromium.run(figure)
    chromium.driver.find_element("id", "theme").click()
    assert all(a != b for a, b in zip(light, (chromium.run(colour), chromium.run(figure)), strict=True))
    assert chromium.errors() == []


@pytest.mark.statistical
def test_the_printed_page(chromium, correction):  # noqa: ARG001  the browser must be there
    texts = printed(correction)
    assert "A. Müller" in texts[0]
    assert "4711" in texts[0]
    assert "4.84 → 0.05 µm RMS" in texts[0]
    (sheet,) = [text for text in texts if "Largest errors after" in text]
    rows = sheet.split("Largest errors after")[1]
    assert len(re.findall(r"^\d+ \d+\.\d{2} \d+\.\d{2}(?: -?\d+\.\d{3}){5}$", rows, re.MULTILINE)) == 10
    assert "Errors are actual minus nominal" in " ".join(texts)  # folded on the screen


@pytest.mark.statistical
def test_a_picture_of_the_path_is_not_blank(chromium, correction):
    chromium.open(correction, printable=True)
    assert chromium.run("return document.querySelectorAll('.printed').length") == len(figures(correction))
    source = chromium.run("return document.querySelector('.printed img').src")
    assert source.startswith("data:image/png;base64,")
    assert len(base64.b64decode(source.partition(",")[2])) > 30_000
    colours = chromium.run(
        "const i = document.querySelector('.printed img'), c = document.createElement('canvas');"
        "c.width = 400; c.height = 200; const g = c.getContext('2d'); g.drawImage(i, 0, 0, 400, 200);"
        "const d = g.getImageData(0, 0, 200, 200).data; const s = new Set();"
        "for (let k = 0; k < d.length; k += 4) s.add(d[k] >> 4 << 8 | d[k + 1] >> 4 << 4 | d[k + 2] >> 4); return s.size"
    )
    assert colours > 20


KINDS = {
    "iso230": (
        "simulate --machine cframe --strategy axes --runs 2 --instrument interferometer -o laser.csv",
        "iso230 laser.csv --machine cframe",
    ),
    "ballbar": (
        "simulate --machine cframe --instrument ballbar --centre 300,225,150 --target t1=0,0,-120 --bar 150:0.5 "
        "--feed 1000 --errors none --effect backlash:axis=X,width=8 -o circles.csv",
        "ballbar circles.csv --machine cframe",
    ),
    "fit": (
        "simulate --machine cframe --strategy random --points 90 --tracker=-1500,1500,300 --target t1=0,0,-120 "
        "--target t2=90,40,-180 --target t3=-60,80,-100 -u u_range_um=1 -u u_angle_um=3 -o data.csv",
        "fit data.csv --machine cframe --basis b-spline:4 -o cal.json",
    ),
    "compare": ("fit data.csv --machine cframe --basis b-spline:3 -o other.json", "compare cal.json other.json"),
    "predict": ("predict data.csv --machine cframe -c cal.json -o predicted.csv",),
    "export": ("export --machine cframe -c cal.json --format linuxcnc -o tables",),
    "verify": (
        "box.nc --machine dmu50 --work-offset G54=-30,-20,150 --tool-length T1=80 -o corrected.nc",
        "verify box.nc corrected.nc --machine dmu50 --work-offset G54=-30,-20,150 --tool-length T1=80",
    ),
    "continuous": (
        "simulate-continuous --machine cframe --axis X --start-mm 0 --end-mm 450 --feed 5000 --rate 500 --spacing 45 "
        "--both --effect backlash:axis=X,width=8 -o run.csv --quasistatic targets.csv",
        "continuous run.csv targets.csv -o table.csv",
    ),
}
"""Commands up to each kind of page; the last one writes it."""


@pytest.mark.statistical
def test_every_kind_of_page(chromium, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(BOX, tmp_path)
    for kind, commands in KINDS.items():
        *before, last = (shlex.split(each) for each in commands)
        for each in before:
            succeed(*each)
        succeed(*last, "--report", f"{kind}.html")
        page = tmp_path / f"{kind}.html"
        assert figures(page), kind
        scenes = [panel for panel in panels(page) if panel.get("kind") == "scene"]
        if not scenes:
            check_screens(chromium, page)
        elif kind == "fit":  # 3-D figures take long without a graphics card
            check_screens(chromium, page, ((PHONE, False),))


TESTS = """\
test,range_mm,range_2_mm,length_mm,error_um
ranging,2000,10000,,2.4
ranging,2000,20000,,-4.1
ranging,2000,35000,,6.0
length,3000,,2300,-22.5
length,6000,,2300,31.0
length,12000,,2300,-60.0
two-face,3000,,,21.0
two-face,15000,,,85.0
"""


@pytest.mark.statistical
def test_page_of_a_tracker(chromium, tmp_path):
    (tmp_path / "b89.csv").write_text(TESTS)
    page = tmp_path / "tracker.html"
    succeed("tracker", tmp_path / "b89.csv", "--report", page)
    check_screens(chromium, page)
    (text,) = printed(page)
    assert "along the beam" in text
    assert "u_angle_um_per_m" in text


def numbers_without_scale(page):
    """Traces whose colours are numbers that no scale of the figure explains."""
    return [
        trace.get("name", trace["type"])
        for figure in figures(page)
        for panel in figure["panels"]
        for trace in panel.get("traces", ())
        if isinstance(trace.get("marker", {}).get("color"), list)
        and not isinstance(trace["marker"]["color"][0], str)
        and not ("coloraxis" in trace["marker"] and figure["colours"]["title"])
    ]


@pytest.mark.statistical
def test_page_of_a_plan(chromium, tmp_path):
    page = tmp_path / "plan.html"
    succeed(
        "plan",
        "--machine",
        "dmu50",
        "--strategy",
        "random",
        "--points",
        40,
        "-o",
        tmp_path / "plan.csv",
        "--report",
        page,
    )
    assert numbers_without_scale(page) == []
    check_screens(chromium, page, ((PHONE, True),))


@pytest.mark.statistical
def test_page_of_three_points(chromium, tmp_path, monkeypatch):
    for axis, positions in list(SERIES.items()):
        monkeypatch.setitem(SERIES, axis, positions[::2])
    dmu50 = machines.load("dmu50")
    eyes = {"1": (800.0, -850.0, -650.0), "2": (-800.0, 850.0, -650.0), "3": (850.0, 800.0, 950.0)}
    stations = {name: station(eye, float(name)) for name, eye in eyes.items()}
    truth, rng = model(dmu50, random_effects(3, degree=2)), np.random.default_rng(5)
    with (tmp_path / "data.csv").open("wb") as file:
        write_measurement(measured(dmu50, truth, stations, axes="XYZC", rng=rng), file)
    page = tmp_path / "three_points.html"
    succeed("three-points", tmp_path / "data.csv", "-m", "dmu50", "-o", tmp_path / "cal.json", "--report", page)
    check_screens(chromium, page, ((PHONE, True),))
    texts = printed(page)
    text = " ".join(" ".join(texts).split())
    assert "error motion range u (k=1) unit degree" in text
    assert "measure C at 17 positions" in text.rpartition("Notes")[2]


FOLDER = {"box.nc": BOX.read_text(), "sub/probing.nc": "G21 G90 G54\nG0 X1. Y1. Z1.\nG31 X5.\nM30\n"}


@pytest.mark.statistical
def test_page_of_a_folder(chromium, tmp_path, command):
    for name, text in FOLDER.items():
        (tmp_path / "in" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "in" / name).write_text(text)
    set_up = ("--machine", "dmu50", "--work-offset", "G54=-30,-20,150", "--tool-length", "T1=80")
    page = tmp_path / "batch.html"
    assert command("batch", "in", "out", *set_up, "--report", page).status == 2
    check_screens(chromium, page)
    text = " ".join(" ".join(printed(page)).split())
    for words in ("u (k=1), µm", "G31 is a probing move", "An error relative to the datum", "its home 0 is assumed"):
        assert words in text


@pytest.mark.statistical
def test_page_of_a_machine(chromium, tmp_path):
    page = tmp_path / "dmu50.html"
    succeed("machines", "dmu50", "--draw", page)
    check_screens(chromium, page, ((PHONE, False),))
    (text,) = printed(page)  # one sheet
    assert all(row in text for row in ("direction of the tool", "the tool moves along the arrow", "page 1 of 1"))


@pytest.mark.statistical
def test_a_scene_fills_its_box(chromium, tmp_path):
    page = tmp_path / "mill.html"
    succeed("machines", "dmu50", "--draw", page)
    for screen, least, high in ((DESKTOP, 0.55, 500), (PHONE, 0.45, 200)):
        chromium.open(page, screen)
        ((width, height, share),) = chromium.driver.execute_async_script(USED)
        assert share > least
        assert height > high
        assert width <= screen


LABELS = """const boxes = [...document.querySelectorAll('text')].map(t => [t.textContent, t.getBBox()])
  .filter(([name, b]) => b.y > 100 && b.y < 600);
const lines = [...document.querySelectorAll('path:not(.leader)')].flatMap(line =>
  [...Array(Math.ceil(line.getTotalLength())).keys()].map(k => line.getPointAtLength(k)));
return boxes.map(([name, b]) => [name, b.x, b.y, b.x + b.width, b.y + b.height,
  lines.filter(p => p.x > b.x && p.x < b.x + b.width && p.y > b.y && p.y < b.y + b.height).length])"""
"""Labels in the scene of a drawing: text, left, upper, right and lower edge, and the length of lines below it, px."""


@pytest.mark.parametrize("machine", ["dmu50", "head_head", "head_table", "trunnion_ac", "cframe"])
def test_labels_on_the_drawing_of_a_machine_can_be_read(chromium, tmp_path, machine):
    drawing = tmp_path / f"{machine}.svg"
    succeed("machines", machine, "--draw", drawing)
    (tmp_path / "a.html").write_text(f'<html data-ready="drawn"><body>{drawing.read_text()}')
    chromium.open(tmp_path / "a.html")
    labels = chromium.run(LABELS)
    assert len(labels) >= 5
    for i, (name, left, top, right, bottom, crossed) in enumerate(labels):
        assert left >= 0, name
        assert right <= 900, name
        assert crossed <= 20, name
        for other, *edges, _ in labels[:i]:
            assert right <= edges[0] or left >= edges[2] or bottom <= edges[1] or top >= edges[3], (name, other)


def test_a_short_table_is_not_cut_and_a_long_one_leaves_three_rows(chromium, tmp_path):  # noqa: ARG001
    rows = [(f"row {number}", "1.0") for number in range(1, 200)]
    tables = [Table(("name", "value"), rows[:count]) for count in (51, 8, 12, 7, 60, 8)]
    page = tmp_path / "tables.html"
    page.write_bytes(page_of(Report("Tables", "", [Section(f"T{i}", table=each) for i, each in enumerate(tables)])))
    left = Counter()
    for text in printed(page):
        for part in re.split(r"^T(?=\d)", text, flags=re.MULTILINE):
            left[len(re.findall(r"^row \d+", part, re.MULTILINE))] += 1
    assert sum(count * times for count, times in left.items()) == 146
    assert not {1, 2} & set(left)
    assert left[8] >= 2
    assert left[7] >= 1


def test_a_page_without_figures_prints_too(chromium, tmp_path):  # noqa: ARG001
    program = tmp_path / "a.nc"
    program.write_text("G21 G90\nG0 X100.0 Y100.0 Z100.0\n")
    page = tmp_path / "a.html"
    succeed(program, "--machine", "gantry", "-c", "none", "-o", tmp_path / "b.nc", "--report", page)
    assert "written back as it was" in printed(page)[0]


def test_what_is_no_page_is_not_printed(command, tmp_path):
    (tmp_path / "a.html").write_text("<!doctype html><title>another</title>")
    (tmp_path / "a.csv").write_text("# machine: gantry\n# instrument: laser-tracker\n")
    for name, words in (("a.html", "found a web page"), ("a.csv", "found a measurement file"), ("b", "No such file")):
        done = command("report", name, "--pdf", "a.pdf")
        assert done.status == 2
        assert words in done.err
    assert not (tmp_path / "a.pdf").exists()


def test_a_missing_browser_is_named_with_its_cure(command, tmp_path, monkeypatch):
    (tmp_path / "a.html").write_text('<meta name="generator" content="ncomp">')
    monkeypatch.setenv("PATH", str(tmp_path))
    done = command("report", "a.html", "--pdf", "a.pdf")
    assert done.status == 2
    assert "apt-get install chromium" in done.err
    assert not (tmp_path / "a.pdf").exists()


def test_a_browser_that_fails_leaves_no_file(command, tmp_path, monkeypatch):
    (tmp_path / "a.html").write_text('<meta name="generator" content="ncomp">')
    (tmp_path / "chromium").write_text("#!/bin/sh\nexit 3\n")
    (tmp_path / "chromium").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    done = command("report", "a.html", "--pdf", "a.pdf")
    assert done.status == 2
    assert "has ended" in done.err
    assert not (tmp_path / "a.pdf").exists()
