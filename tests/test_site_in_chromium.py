"""The site of the documentation, opened from the disk in a real browser: its search works without a server."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PATIENCE_S = 30.0
FOUND = "return [...document.querySelectorAll('.md-search-result__link')].map(link => link.href)"
SEARCH = """const field = document.querySelector('.md-search__input');
field.focus(); field.value = arguments[0]; field.dispatchEvent(new InputEvent('input', {bubbles: true}));
field.dispatchEvent(new KeyboardEvent('keyup', {bubbles: true, key: 'h'}));"""


@pytest.fixture(name="site", scope="module")
def _site(tmp_path_factory):
    pytest.importorskip("mkdocs")
    folder = tmp_path_factory.mktemp("site")
    subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "-d", folder],
        check=True,
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
    )
    return folder


@pytest.mark.statistical
@pytest.mark.parametrize("page", ["index.html", "controls/iso.html"])
def test_the_search_works_from_the_disk_without_network(chromium, site, page):
    chromium.requests()
    chromium.driver.get((site / page).as_uri())
    chromium.errors()
    assert chromium.run("return getComputedStyle(document.querySelector('.md-search')).display") != "none"
    end, found = time.monotonic() + PATIENCE_S, []
    while not found and time.monotonic() < end:
        chromium.run(SEARCH, "backlash take-up")
        time.sleep(0.3)
        found = chromium.run(FOUND)
    assert any("safety.html" in link for link in found)
    assert all(link.startswith("file://") for link in found)
    assert [address for address in chromium.requests() if address.startswith("http")] == []
    assert chromium.errors() == []
