"""Renew the pictures of docs/serve.md: its pages in Chromium, on a desktop and on a phone.

python docs/make/serve.py
"""

from __future__ import annotations

import base64
import sys
import tempfile
import time
from pathlib import Path

from tutorial import ROOT

sys.path.append(str(ROOT / "tests"))
from clients.chromium import DESKTOP, PHONE, Chromium
from support.command import succeed
from support.serving import Serving

PAGE = ROOT / "docs" / "serve.md"
PAPER = {DESKTOP: 0.6, PHONE: 0.75}
"""Scale of a picture by the width of its screen."""
FORM, RESULT = 900, 1500
"""Heights of the screens, px."""
MONTHS = range(1, 13)


def main() -> None:
    """Serve, use the pages, and take the pictures."""
    browser = Chromium()
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        life = folder / "life.sqlite"
        for month in MONTHS:
            checks = (
                f"squareness X-Y={12 + 1.1 * month:.1f} +- 3 um/m",
                f"backlash X={6 if month < 8 else 14} +- 2 um",
            )
            words = [word for check in checks for word in ("--check", check)]
            succeed("history", "add", "gantry", *words, "--at", f"2025-{month:02d}-10", "--db", life)
        server = Serving(folder / "own", "--db", str(life))
        try:
            for width, name in ((DESKTOP, "desk"), (PHONE, "phone")):
                photograph(browser, server, width, name)
        finally:
            server.close()
            browser.close()


def photograph(browser: Chromium, server: Serving, width: int, name: str) -> None:
    """Pictures of a form, of its result, and of a trend on a screen of this width."""
    driver, find = browser.driver, lambda selector: browser.driver.find_element("css selector", selector)

    def screen(height: int) -> None:
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width == PHONE}
        driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)

    def taken(what: str, height: int) -> None:
        clip = {"x": 0, "y": 0, "width": width, "height": height, "scale": PAPER[width]}
        seen = driver.execute_cdp_cmd("Page.captureScreenshot", {"clip": clip})
        picture = ROOT / "docs" / "pictures" / f"serve_{what}_{name}.png"
        if picture.name in PAGE.read_text():
            picture.write_bytes(base64.b64decode(seen["data"]))

    def result_taken(what: str) -> None:
        find("form button").click()
        while not driver.find_elements("css selector", ".over"):
            time.sleep(0.2)
        screen(RESULT)
        driver.switch_to.frame(find("iframe.result"))
        while browser.run("return document.documentElement.dataset.ready") != "printable":
            time.sleep(0.2)
        driver.switch_to.default_content()
        time.sleep(2.0)  # the frame takes the height of its page
        taken(what, RESULT)

    screen(FORM)
    driver.get(f"{server.address}/task/program")
    find("#input").send_keys(str(ROOT / "examples" / "box.nc"))
    find("#machine").send_keys("dmu50")
    find("#work_offset").send_keys("G54=-30,-20,150")
    find("#tool_length").send_keys("T1=80")
    taken("form", FORM)
    result_taken("result")
    screen(FORM)
    driver.get(f"{server.address}/task/history?machine=gantry")
    find("#limit").send_keys("squareness X-Y=0.02mm/300mm")
    result_taken("trend")


if __name__ == "__main__":
    main()
