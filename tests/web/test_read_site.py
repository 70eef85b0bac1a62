"""The site in a browser, as files: its pages on a desk and on a telephone, light and dark, and its search."""

import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import quote

import pytest
import yaml

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[2]
LOOKS = {"desk": (1366, "light"), "telephone": (390, "dark")}
LOOK_UPS = Path(__file__).with_name("look_ups.yaml")
RENDERED = {"search.html"}  # by a script of Sphinx, after it is loaded
FAULTS = """async () => {
  const found = [];
  const levels = [...document.querySelectorAll("article h1, article h2, article h3, article h4")].map(
    (one) => Number(one.tagName[1]));
  if (levels.filter((level) => level === 1).length !== 1) found.push("not one title");
  const jumps = levels.filter((level, k) => level > (levels[k - 1] ?? 0) + 1);
  if (jumps.length) found.push(`headings leave out a level before ${jumps}`);
  for (const one of document.querySelectorAll("img")) {
    if (!one.alt.trim()) found.push(`no words for ${one.getAttribute("src")}`);
  }
  if (document.documentElement.scrollWidth > innerWidth) found.push("wider than the screen");
  const numbers = (color) => color.match(/[\\d.]+/g).map(Number);
  const light = (color) => numbers(color).slice(0, 3).map((x) => x / 255).map(
    (x) => x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4,
  ).reduce((sum, x, k) => sum + [0.2126, 0.7152, 0.0722][k] * x, 0.05);
  const behind = (one) => {
    const color = getComputedStyle(one).backgroundColor;
    return one.parentElement && (numbers(color)[3] ?? 1) < 1 ? behind(one.parentElement) : light(color);
  };
  const walk = document.createTreeWalker(document.querySelector("article"), NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const one = walk.currentNode.parentElement;
    if (!walk.currentNode.textContent.trim() || !one.offsetParent) continue;
    const [a, b] = [light(getComputedStyle(one).color), behind(one)];
    if (Math.max(a, b) / Math.min(a, b) < 4.45) found.push(`faint: ${walk.currentNode.textContent.trim()}`);
  }
  const shift = await new Promise((done) => {
    let sum = 0;
    new PerformanceObserver((list) => list.getEntries().forEach((one) => { sum += one.value; })).observe(
      { type: "layout-shift", buffered: true });
    setTimeout(() => done(sum), 30);
  });
  if (shift > 0.1) found.push(`the layout shifts by ${shift}`);
  return found;
}"""
"""Titles, headings in order, words for pictures, width, contrast (WCAG 2.2: 4.5, less rounding), and shifts
of the layout (Lighthouse calls 0.1 good)."""


@pytest.fixture(scope="module")
def built(chromium, tmp_path_factory):
    """The folder of the site."""
    pytest.importorskip("sphinx", reason="Sphinx is not installed, which make docs installs")
    out = tmp_path_factory.mktemp("site")
    subprocess.run([sys.executable, ROOT / "docs" / "site" / "make.py", "--out", out], check=True, cwd=ROOT)
    return out / "html"


@pytest.mark.parametrize("look", LOOKS)
def test_every_page_can_be_read_without_a_network(look, built, chromium):
    width, scheme = LOOKS[look]
    found, told = {}, []
    context = chromium.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
    context.set_offline(True)
    tab = context.new_page()
    tab.on("console", lambda message: told.append(message.text))
    tab.on("pageerror", lambda error: told.append(str(error)))
    tab.on("request", lambda one: one.url.startswith("http") and told.append(one.url))
    pages = [path for path in sorted(built.rglob("*.html")) if not {"source", "page"} & {*path.parts}]
    assert len(pages) > 100
    for path in pages:
        name = path.relative_to(built).as_posix()
        tab.goto(f"file://{path}")
        if faults := (tab.evaluate(FAULTS) if name not in RENDERED else []) + told:
            found[name] = faults
        told.clear()
    context.close()
    assert found == {}


def test_the_search_shows_the_right_page_first(built, chromium):
    wrong, tab = {}, chromium.new_page()
    for sought, pages in yaml.safe_load(LOOK_UPS.read_text(encoding="utf-8")).items():
        tab.goto(f"file://{built}/search.html?q={quote(sought)}")
        tab.wait_for_selector("#search-results ul.search li a")
        first = tab.get_attribute("#search-results ul.search li a >> nth=0", "href")
        page = re.split(r"\.html|[?#]", first)[0]
        if page not in ([pages] if isinstance(pages, str) else pages):
            wrong[sought] = first
    tab.close()
    assert wrong == {}
