# SPDX-License-Identifier: MIT
"""Makes docs/screenshots again: the page of the smallest committed champion, light, dark and on a phone.

    python tools/report-screenshots.py [FOLDER]

It needs Debian's chromium, and the packages of bitneat[test].
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

ROOT = Path(__file__).resolve().parents[1]
CHAMPION = ROOT / "examples" / "champions" / "tiny.pkl"
STEP = 412
ARGUMENTS = (
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync"),
)
SHOTS = (
    ("light", "light", 1440, 1000),
    ("dark", "dark", 1440, 1000),
    ("phone", "light", 390, 1500),
)
"""Name, colour scheme, width and height."""


def main() -> None:
    """Write the page into a temporary folder, and pictures of it into the one that is named."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "screenshots"
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="bitneat-") as temporary:
        page_file = Path(temporary, "report.html")
        command = [sys.executable, "-m", "bitneat", "report", str(CHAMPION), "-o", str(page_file)]
        subprocess.run(command, check=True, cwd=ROOT)
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path="/usr/bin/chromium", args=list(ARGUMENTS))
            for name, scheme, width, height in SHOTS:
                page = browser.new_page(
                    viewport={"width": width, "height": height},
                    color_scheme=scheme,  # type: ignore[arg-type]
                    reduced_motion="reduce",
                )
                page.goto(page_file.as_uri())
                page.wait_for_selector("html[data-ready]")
                page.locator("#scrub").fill(str(STEP))
                page.locator("#scrub").blur()
                page.screenshot(path=folder / f"report-{name}.png")
            browser.close()


if __name__ == "__main__":
    main()
