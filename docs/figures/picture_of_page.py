"""Make the picture of the page in docs/browser.md again: python docs/figures/picture_of_page.py

It needs Chromium, and Playwright's Python package (make test-page installs it).
"""

import io
import shutil
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

from redundant_envs.web import page

PICTURE = Path(__file__).with_name("page.png")
ADDRESS = "#arm=FourR&task=ReachAround&who=race&goal=-0.55,0.4&accuracy=6"
MOMENT = "app.seen && app.seen.steps >= 24"
"""Both arms are under way, and the learner is nearly there."""
COLOURS = 256


def main() -> None:
    program = shutil.which("chromium") or shutil.which("google-chrome")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        page.write(Path(folder))
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox", "--disable-gpu"])
        # Playwright waits by a function of the page, which the page's own policy forbids
        tab = browser.new_page(viewport={"width": 1100, "height": 700}, bypass_csp=True)
        tab.goto(f"file://{folder}/index.html{ADDRESS}")
        tab.wait_for_function(MOMENT)
        tab.evaluate("app.run(false)")
        seen = Image.open(io.BytesIO(tab.screenshot()))
        browser.close()
    seen.convert("RGB").quantize(COLOURS, Image.Quantize.MAXCOVERAGE).save(PICTURE, optimize=True)
    print(PICTURE)


if __name__ == "__main__":
    main()
