"""The page of `ncomp serve` in a real browser: by clicks, by keyboard alone, and on a phone."""

import re
import time
from pathlib import Path

import pytest
from clients.chromium import DESKTOP, PATIENCE, PHONE
from selenium.webdriver import ActionChains, Keys
from selenium.webdriver.support.ui import Select
from support.command import succeed
from support.serving import Serving

pytestmark = pytest.mark.statistical
BOX = Path(__file__).parents[1] / "examples" / "box.nc"
PAGES = (
    "/task/program",
    "/task/diagnose",
    "/task/fit",
    "/task/iso230",
    "/task/history",
    "/machines",
    "/jobs",
    "/watch",
    "/nothing",
)
OVERFLOW = """return [...document.querySelectorAll('body *')].filter(e => e.getBoundingClientRect().right > innerWidth + 1)
  .map(e => e.tagName + '.' + e.className)"""
"""Elements that a screen of this width cuts."""
FOCUS = """const e = document.activeElement, style = getComputedStyle(e), box = e.getBoundingClientRect();
const about = (e.getAttribute('aria-describedby') || '').split(' ').filter(Boolean);
return {tag: e.tagName, id: e.id, name: e.labels && e.labels.length ? e.labels[0].textContent : e.ariaLabel || e.title || e.textContent,
  outline: style.outlineStyle !== 'none' && parseFloat(style.outlineWidth) >= 2, seen: box.width > 0 && box.top >= 0 && box.left >= 0,
  help: about.every(id => document.getElementById(id))}"""
"""The element with the focus: its name, and whether it and its outline are seen."""
SMALL = """return [...document.querySelectorAll('a:not(p a), button, input, select, summary')].filter(e => e.offsetParent && e.id !== 'theme')
  .map(e => [e.tagName + ' ' + (e.id || e.textContent), e.getBoundingClientRect().height]).filter(([, high]) => high && high < 24)"""
"""What a finger hits badly: below 24 px (WCAG 2.5.8)."""


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    folder = tmp_path_factory.mktemp("serving")
    succeed(
        "history",
        "add",
        "gantry",
        "--check",
        "backlash X=8 +- 2 um",
        "--at",
        "2026-01-01",
        "--db",
        folder / "life.sqlite",
    )
    (folder / "watch.log").write_text(
        "2026-11-30 10:00:01 corrected: out/part.nc, error 9.10 -> 0.40 um at most, 0.3 s\n"
    )
    made = Serving(folder / "own", "--db", str(folder / "life.sqlite"), "--watch-log", str(folder / "watch.log"))
    yield made
    made.close()


def at(chromium, server, path, width=DESKTOP):
    """Open a page."""
    metrics = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width == PHONE}
    chromium.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    chromium.driver.get(server.address + path)


def find(chromium, selector):
    return chromium.driver.find_element("css selector", selector)


def wait(chromium, selector):
    """Wait for an element."""
    end = time.monotonic() + PATIENCE
    while not (found := chromium.driver.find_elements("css selector", selector)):
        assert time.monotonic() < end, chromium.driver.page_source
        time.sleep(0.1)
    return found[0]


def fill(chromium, server, file, width=DESKTOP):
    """Choose a program and its set-up."""
    at(chromium, server, "/", width)
    find(chromium, "#input").send_keys(str(file))
    Select(find(chromium, "#machine")).select_by_visible_text("dmu50")
    find(chromium, "#work_offset").send_keys("G54=-30,-20,150")
    find(chromium, "#tool_length").send_keys("T1=80")


@pytest.mark.parametrize("width", [DESKTOP, PHONE])
def test_a_program_is_corrected_by_clicks(chromium, server, width):
    fill(chromium, server, BOX, width)
    find(chromium, "form button").click()
    main = wait(chromium, ".over a.main")
    assert main.text.endswith("box_c.nc")
    assert find(chromium, "h1").text == "box.nc: done"
    frame, inside = find(chromium, "iframe.result"), "return document.documentElement"
    before = frame.size["height"]
    chromium.driver.switch_to.frame(frame)
    end = time.monotonic() + PATIENCE
    while chromium.run(f"{inside}.dataset.ready") not in ("drawn", "printable"):
        assert time.monotonic() < end
        time.sleep(0.1)
    assert "Errors on the part" in find(chromium, "main").text
    assert chromium.run("return document.querySelectorAll('.plot .main-svg').length") > 0
    assert chromium.run("return self.origin") == "null"  # the scripts of a result reach nothing of the server
    assert chromium.run(f"{inside}.scrollWidth") <= width
    while chromium.run(f"{inside}.scrollHeight - innerHeight") > 1:  # the frame takes the height of its page
        assert time.monotonic() < end
        time.sleep(0.1)
    chromium.driver.switch_to.default_content()
    assert frame.size["height"] > before or before > 1000
    assert chromium.run(OVERFLOW) == []
    assert chromium.errors() == []


def test_a_refused_program_shows_its_lines(chromium, server, tmp_path):
    (tmp_path / "<b>part.nc").write_text("G21 G90 G54\nG234\nG0 X1 Y1 Z1\nM30\n")
    fill(chromium, server, tmp_path / "<b>part.nc")
    find(chromium, "form button").click()
    assert "nothing was written" in wait(chromium, ".over .refusal").text
    assert find(chromium, "h1").text == "<b>part.nc: refused"
    chromium.driver.switch_to.frame(find(chromium, "iframe.result"))
    assert "--pass-through G234" in find(chromium, "main").text
    chromium.driver.switch_to.default_content()
    chromium.driver.back()  # the form is as it was, so that what was wrong is changed
    assert find(chromium, "#work_offset").get_attribute("value") == "G54=-30,-20,150"
    assert Select(find(chromium, "#machine")).first_selected_option.text == "dmu50"


def test_a_long_job_shows_its_progress_and_is_stopped(chromium, server, tmp_path):
    moves = "".join(f"G1 X{k % 60} Y{k % 50} Z0 F500\n" for k in range(90_000))
    (tmp_path / "long.nc").write_text(f"G21 G90 G54\nT1 M6\n{moves}M30\n")
    fill(chromium, server, tmp_path / "long.nc")
    find(chromium, "form button").click()
    assert re.match("1 of 2: |waits", wait(chromium, "#step").text)
    assert chromium.run("return document.querySelector('progress').position") <= 1.0
    (stop,) = walk(chromium, "Stop")  # the focus is at the work in hand
    assert stop["outline"]
    keys(chromium, Keys.ENTER)
    assert wait(chromium, ".over .refusal").text == "Stopped: nothing was written."


@pytest.mark.parametrize("width", [DESKTOP, PHONE])
def test_no_page_is_cut_or_asks_for_anything_elsewhere(chromium, server, width):
    chromium.requests()
    for path in PAGES:
        at(chromium, server, path, width)
        chromium.run("document.querySelectorAll('details').forEach(d => d.open = true)")
        assert chromium.run(OVERFLOW) == [], path
        assert chromium.run("return document.documentElement.scrollWidth") <= width, path
        assert chromium.run(SMALL) == [], path
        assert chromium.run(
            "return [document.title.length > 8, document.querySelectorAll('h1').length, document.documentElement.lang]"
        ) == [True, 1, "en"]
    assert {url for url in chromium.requests() if not url.startswith((server.address, "data:", "chrome"))} == set()
    chromium.errors()  # that of the page that is not there


def keys(chromium, *which):
    ActionChains(chromium.driver).send_keys(*which).perform()


def walk(chromium, last):
    """The elements that the tabulator reaches, until the one with this name."""
    found = []
    while not found or last not in found[-1]["name"]:
        keys(chromium, Keys.TAB)
        found.append(chromium.run(FOCUS))
        assert len(found) < 60, found
    return found


def test_a_program_is_corrected_by_the_keyboard_alone(chromium, server):
    at(chromium, server, "/")
    (skip,) = walk(chromium, "Skip to the content")
    assert skip["seen"]
    keys(chromium, Keys.ENTER)
    reached = walk(chromium, "More options")
    assert [each["id"] for each in reached] == ["input", "machine", "work_offset", "tool_length", "set_up_zero", ""]
    assert [
        each for each in reached if not (each["outline"] and each["seen"] and each["help"] and each["name"].strip())
    ] == []
    keys(chromium, Keys.ENTER)
    (calibration,) = walk(chromium, "Calibration")
    assert calibration["seen"]
    find(chromium, "#input").send_keys(
        str(BOX)
    )  # the window of the system, in which a file is chosen, is not of the page
    for name, text in (("machine", "dmu50"), ("work_offset", "G54=-30,-20,150"), ("tool_length", "T1=80")):
        while chromium.run(FOCUS)["id"] != name:
            ActionChains(chromium.driver).key_down(Keys.SHIFT).send_keys(Keys.TAB).key_up(Keys.SHIFT).perform()
        keys(chromium, text)
        for _ in range(9):  # towards the end again, so that each field is reached by going back
            keys(chromium, Keys.TAB)
    while "Correct" not in chromium.run(FOCUS)["name"] or chromium.run(FOCUS)["tag"] != "BUTTON":
        keys(chromium, Keys.TAB)
    keys(chromium, Keys.ENTER)
    wait(chromium, ".over")
    assert find(chromium, "h1").text == "box.nc: done"
    assert "box_c.nc" in walk(chromium, "box_c.nc")[0]["name"]  # the focus is at the result: its file comes first


def test_the_field_that_is_missing_is_named(chromium, server):
    at(chromium, server, "/")
    find(chromium, "form button").click()
    assert chromium.run("return document.querySelector('#input').validationMessage.length") > 0
    assert chromium.run("return document.activeElement.id") == "input"
