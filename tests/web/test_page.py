"""The page in a browser: a file, without a network."""

import dataclasses
import json
import re
import shutil

import numpy as np
import pytest

import redundant_envs as rde
from redundant_envs.__main__ import main
from redundant_envs.tasks import ReachTask
from redundant_envs.web import page

pytestmark = pytest.mark.long

MAX_BYTES = 400_000
MIN_HELD = {
    ("RPRP", "Reach"): {"computed torque": 100, "SAC": 98},
    ("FourR", "Reach"): {"computed torque": 100, "PPO": 98},
    ("RPRP", "ReachAround"): {"computed torque": 80},
    ("FourR", "ReachAround"): {"computed torque": 80, "SAC": 88},
    ("RPRP", "Track"): {"computed torque": 78},
    ("FourR", "Track"): {"computed torque": 92},
    ("RPRP", "ReachFault"): {"computed torque": 68},
    ("FourR", "ReachFault"): {"computed torque": 90},
}
"""Of 100 random episodes: less than what 200 gave by three deviations of such counts."""
DISC = "app.seen.order === app.order && app.seen.discs[{}].centre"
"""The centre of a disc in the kernel, once it has what the page asked for last."""
READY = "app.seen && app.seen.steps > 2 && app.seen.costs"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The folder of the page, with the policies of the source tree."""
    folder = tmp_path_factory.mktemp("page")
    assert main(["page", "--out", str(folder)]) == 0
    return folder


@pytest.fixture
def opened(chromium, site):
    """Open the page at an address; at the end nothing was printed, and nothing but its files asked for."""
    contexts, told = [], []

    def open_page(address="", *, folder=site, ready=READY, init=None, **options):
        # Playwright waits by a function of the page, which the page's own policy forbids
        context = chromium.new_context(**{"bypass_csp": True, **options})
        contexts.append(context)
        context.set_offline(True)
        tab = context.new_page()
        tab.on("console", lambda message: told.append(message.text))
        tab.on("pageerror", lambda error: told.append(str(error)))
        tab.on("request", lambda request: told.append(request.url) if not allowed(request.url) else None)
        if init:
            tab.add_init_script(init)
        tab.goto(f"file://{folder}/index.html{address}")
        if ready:
            tab.wait_for_function(ready)
        return tab

    def allowed(url):
        names = {"index.html", "kernel.js", "data.js", "page.js"}
        own = url.startswith("file://") and re.split("[?#]", url)[0].rpartition("/")[2] in names
        return own or url.startswith("blob:null/")

    open_page.told = told
    yield open_page
    for context in contexts:
        context.close()
    assert told == []


def screen(tab, point):
    """Where a point of the plane, m, is in the window."""
    box = tab.locator("#view").bounding_box()
    x, y = tab.evaluate(f"app.place({list(point)})")
    return box["x"] + x, box["y"] + y


def goal(tab):
    return tab.evaluate("app.seen.goal")


def test_the_page_is_small(site):
    assert sum(path.stat().st_size for path in site.iterdir()) <= MAX_BYTES


def test_only_its_own_files_run(opened):
    tab = opened(ready=None, bypass_csp=False)
    while not tab.evaluate(READY):
        tab.wait_for_timeout(100)
    assert opened.told == []
    tab.evaluate("""() => {
      const script = document.createElement("script");
      script.textContent = "window.owned = 1";
      document.body.append(script);
      const inline = "<img src=x onerror='window.owned = 2'><style>p { color: red }</style>";
      document.body.insertAdjacentHTML("beforeend", inline);
    }""")
    assert tab.evaluate("fetch('http://127.0.0.1/').then(() => 'read', () => 'refused')") == "refused"
    tab.wait_for_timeout(200)
    assert tab.evaluate("'owned' in window") is False
    assert tab.evaluate("getComputedStyle(document.querySelector('p')).color") != "rgb(255, 0, 0)"
    assert any("inline script" in text for text in opened.told)
    opened.told.clear()


@pytest.mark.parametrize(("arm", "task"), page.PAIRS, ids=lambda one: getattr(one, "name", one))
def test_its_steps_have_the_bits_of_the_processor(arm, task, opened):
    tab = opened(f"#arm={arm}&task={task.name}")
    tab.click("#check")
    tab.wait_for_function("checked.textContent.includes('digest')")
    expected = page.digest(page.page_scene(arm, task), task)
    assert f"digest {expected}, as on the processor" in tab.inner_text("#checked")


@pytest.mark.parametrize(("arm", "task"), MIN_HELD)
def test_its_movers_hold_random_goals(arm, task, opened):
    least = MIN_HELD[arm, task]
    who = "race" if len(least) > 1 else "torque"
    tab = opened(f"#arm={arm}&task={task}&who={who}&policy={list(least)[-1] if who == 'race' else 'SAC'}")
    assert tab.is_visible("#mover_said") == (who == "torque")
    tab.click("#trial")
    tab.wait_for_function("tried.textContent.includes('goals (')", timeout=120_000)
    held = dict(re.findall(r"(\w[\w ]*) holds (\d+) of 100", tab.inner_text("#tried")))
    assert held.keys() == least.keys()
    assert {name: count for name, count in held.items() if int(count) < least[name]} == {}


def dragged(tab, points):
    """Drag the mouse from the first of some points of the plane along the others."""
    tab.mouse.move(*screen(tab, points[0]))
    tab.mouse.down()
    for point in points[1:]:
        tab.mouse.move(*screen(tab, point), steps=4)


def test_discs_are_dragged_but_not_onto_the_base(opened):
    tab = opened("#arm=FourR&task=ReachAround&who=race&goal=0.6,0.3")
    tab.evaluate("app.put(1, [-0.7, 0])")
    tab.evaluate("app.put(0, [0.7, 0])")
    tab.wait_for_function(f"({DISC.format(0)})")
    centre = tab.evaluate(DISC.format(0))
    dragged(tab, [centre, (0.5, -0.4)])
    tab.mouse.up()
    tab.wait_for_function(f"({DISC.format(0)})?.[1] < -0.39")
    assert tab.evaluate(DISC.format(0)) == pytest.approx([0.5, -0.4], abs=0.01)
    assert not tab.is_checked("#next")
    assert tab.input_value("#moved") == "0"
    assert "stops" not in tab.inner_text("#said")
    dragged(tab, [tab.evaluate(DISC.format(0)), (0.3, -0.2), (0.03, -0.02), (0.0, 0.0)])
    tab.wait_for_function("said.textContent.includes('Disc a stops here: it may not cover the base.')")
    assert "may not cover the base" in tab.inner_text("#news")
    tab.mouse.up()
    tab.wait_for_function(f"({DISC.format(0)})")
    radius = tab.evaluate("app.seen.discs[0].radius")
    assert np.hypot(*tab.evaluate(DISC.format(0))) == pytest.approx(radius + 0.02)
    dragged(tab, [tab.evaluate(DISC.format(0)), (0.6, 0.3)])
    tab.mouse.up()
    tab.wait_for_function("app.seen.discs[0].touched")
    tab.wait_for_function("said.textContent.includes('computed torque touched a disc, which is no success')")
    assert "Disc a covers the goal" in tab.inner_text("#said")
    tab.click("#new")
    tab.wait_for_function("app.seen.episode === app.episode && app.seen.steps > 2")
    assert tab.evaluate("app.seen.discs[0].centre[0]") >= 0.35  # as the scene draws it
    assert "stops" not in tab.inner_text("#said")


def test_discs_are_moved_by_finger_and_by_keys(opened):
    tab = opened("#arm=RPRP&task=ReachAround", has_touch=True, viewport={"width": 390, "height": 844})
    before = tab.evaluate(DISC.format(1))
    tab.select_option("#moved", "1")
    tab.focus("#view")
    for key in ("ArrowUp", "ArrowUp", "ArrowRight"):
        tab.keyboard.press(key)
    tab.wait_for_function(f"({DISC.format(1)})?.[1] > {before[1] + 0.039}")
    assert tab.evaluate(DISC.format(1)) == pytest.approx([before[0] + 0.02, before[1] + 0.04])
    for _ in range(80):
        tab.keyboard.press("ArrowUp")
    tab.wait_for_function("said.textContent.includes('Disc b stops here: its centre stays within reach.')")
    finger = tab.context.new_cdp_session(tab)
    x, y = screen(tab, tab.evaluate("app.seen.discs[0].centre"))
    moves = {"Start": (x, y), "Move": (x - 30, y + 20), "End": None}
    for kind, point in moves.items():
        touches = [{"x": point[0], "y": point[1]}] if point else []
        finger.send("Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": touches})
    tab.wait_for_function(f"({DISC.format(0)}) && app.moved === '0'")
    assert screen(tab, tab.evaluate(DISC.format(0))) == pytest.approx(moves["Move"], abs=1.0)


def test_an_arm_goes_around_a_disc_that_is_put_in_its_way(opened):
    tab = opened("#arm=FourR&task=ReachAround&who=torque&goal=0.6,0")
    tab.evaluate("[[0.45, -0.45], [-0.7, 0], [0, 0.75]].forEach((place, disc) => app.put(disc, place))")
    tab.wait_for_function("said.textContent.includes('holds it after')")
    assert tab.evaluate("Math.abs(app.seen.discs[0].centre[0] - 0.45) < 1e-9")


def test_a_target_moves_on_its_path_and_is_followed(opened):
    tab = opened("#arm=RPRP&task=Track&who=torque")
    tab.wait_for_function("/(follows|has lost) it: .* away, at most .* since 1.1 s/.test(said.textContent)")
    places = [tab.evaluate("[app.seen.goal, app.seen.path]")]
    tab.wait_for_timeout(500)
    places.append(tab.evaluate("[app.seen.goal, app.seen.path]"))
    for target, path in places:
        assert np.hypot(*(np.array(path) - target).T).min() < 0.02
    assert np.hypot(*np.subtract(places[0][0], places[1][0])) > 0.02
    tab.focus("#view")
    tab.keyboard.press("ArrowUp")
    assert tab.evaluate("app.drag === null && app.seen.order === app.order")
    assert not tab.is_visible("#turning")


def test_a_motor_that_fails_is_named_and_fails_in_the_reference_too(opened):
    tab = opened("#arm=FourR&task=ReachFault&who=torque")
    tab.wait_for_function("said.textContent.includes('The motor of joint')")
    while tab.evaluate("app.seen.failed") < 1:  # joint 1 is the one of the scene
        tab.click("#new")
        tab.wait_for_function("app.seen.episode === app.episode && app.seen.failed >= 0")
    joint = tab.evaluate("app.seen.failed + 1")
    said = rf"The motor of joint{joint} failed after 0\.\d\d s, and its brake holds"
    tab.wait_for_function(f"/{said}/.test(said.textContent) && app.seen.costs")
    assert re.search(said, tab.inner_text("#news"))
    assert tab.evaluate("app.seen.costs[0].error") < 1e-5


def test_the_goal_is_dragged_and_stays_within_reach(opened):
    tab = opened("#arm=RPRP&who=torque&goal=0.3,0.4")
    tab.mouse.move(*screen(tab, (0.3, 0.4)))
    tab.mouse.down()
    tab.mouse.move(*screen(tab, (1.05, 0.0)), steps=5)
    tab.wait_for_function("app.seen.goal[0] > 0.9")
    assert goal(tab) == pytest.approx([0.95, 0.0], abs=0.01)
    tab.mouse.up()
    tab.wait_for_function("location.hash.includes('goal=0.95')")


def test_all_can_be_done_from_the_keyboard(opened):
    tab = opened("#arm=RPRP&who=torque&goal=0.3,0.4")
    tab.focus("#view")
    for key in ("ArrowLeft", "ArrowLeft", "ArrowUp"):
        tab.keyboard.press(key)
    tab.wait_for_function("Math.abs(app.seen.goal[1] - 0.42) < 1e-3")
    assert goal(tab) == pytest.approx([0.26, 0.42], abs=1e-3)
    for key in ("Shift", "ArrowRight", "ArrowUp"):
        tab.keyboard.down(key)
    assert tab.evaluate("app.push") == [50, 50]
    tab.keyboard.up("Shift")
    tab.keyboard.up("ArrowUp")
    assert tab.evaluate("app.push") == [50, 0]
    tab.keyboard.up("ArrowRight")
    assert tab.evaluate("app.push") == [0, 0]
    tab.keyboard.press("Space")
    assert tab.inner_text("#pause") == "Go on"
    tab.keyboard.press("n")
    tab.wait_for_function("app.seen.steps === 0")
    reached = set()
    tab.focus("#arm")
    for _ in range(30):
        reached.add(tab.evaluate("document.activeElement.id || document.activeElement.tagName"))
        tab.keyboard.press("Tab")
    assert {"arm", "task", "who", "pause", "new", "next", "accuracy", "switch_gravity", "gravity"} <= reached
    assert {"SUMMARY", "check", "trial"} <= reached


def test_every_control_has_a_label_and_fits_a_narrow_screen(opened):
    tab = opened("#arm=FourR&task=ReachAround", viewport={"width": 360, "height": 640})
    right = "(x) => x.getBoundingClientRect().right"
    heads = tab.evaluate(f"[...document.querySelectorAll('#cost th')].map({right})")
    assert max(heads) <= 360
    unnamed = tab.evaluate("""[...document.querySelectorAll("input, select, button, canvas")].filter(
      (one) => !(one.labels && one.labels.length) && !one.textContent.trim() && !one.ariaLabel).length""")
    assert unnamed == 0
    assert tab.evaluate("document.documentElement.scrollWidth") <= 360


def test_the_address_restores_a_view(opened):
    tab = opened("#arm=FourR&who=race&goal=0.3,0.4&accuracy=9")
    assert tab.evaluate("[app.seen.arm, String(app.seen.kinds)]") == ["FourRReach", "learner,torque"]
    assert goal(tab) == [0.3, 0.4]
    assert tab.inner_text("#accuracy_shown") == "1e-9 m"
    assert tab.inner_text("#trouble") == ""
    tab.evaluate("location.hash = '#arm=RPRP&who=torque&goal=-0.2,0.3'")
    tab.wait_for_function("app.seen.arm === 'RPRPReach' && app.seen.goal[0] === -0.2")
    assert tab.input_value("#who") == "torque"


def test_an_arm_that_was_pushed_away_does_not_hold_its_goal(opened):
    tab = opened("#arm=FourR&who=torque&goal=0.3,0.4")
    tab.wait_for_function("said.textContent.includes('computed torque holds it after')")
    tab.focus("#view")
    for key in ("Shift", "ArrowRight", "ArrowDown"):
        tab.keyboard.down(key)
    tab.wait_for_function("/held it after .* s, and is [1-9]\\d* cm away/.test(said.textContent)")
    assert "holds it" not in tab.inner_text("#said")
    for key in ("Shift", "ArrowRight", "ArrowDown"):
        tab.keyboard.up(key)
    told = set()
    while "computed torque holds it after" not in (text := tab.inner_text("#said")):
        told.add(text)
        tab.wait_for_timeout(5)
    assert not any(re.search(r" [01] cm away", text) for text in told)


@pytest.mark.parametrize(
    ("arm", "place"),
    [("RPRP", (0.3, 0.4)), ("RPRP", (0.0, 0.85)), ("RPRP", (0.25, 0.0)), ("FourR", (0.3, 0.4))],
)
def test_the_null_space_moves_the_arm_there_and_back_while_its_tip_stays(arm, place, opened):
    tab = opened(f"#arm={arm}&who=torque&goal={place[0]},{place[1]}")
    tab.wait_for_function("said.textContent.includes('computed torque holds it after')")
    tab.wait_for_timeout(1000)
    first, most = np.array(tab.evaluate("app.seen.points[0]")), 0.0
    for way in (3, -3, 0):
        tab.fill("#turn", str(way))
        steps = tab.evaluate("app.seen.steps")
        while tab.evaluate("app.seen.steps") < steps + 420:  # 8.4 s, 6.7 rad
            points = np.array(tab.evaluate("app.seen.points[0]"))
            assert np.hypot(*(points[-1] - place)) < 0.01
            most = max(most, abs(points - first).max())
            tab.wait_for_timeout(20)
    assert most > 0.05
    np.testing.assert_allclose(points, first, atol=2e-3)
    tab.fill("#accuracy", "7")
    assert tab.input_value("#turn") == "0"  # the plan begins anew where the arm is
    tab.select_option("#who", "learner")
    assert not tab.is_visible("#turn")


@pytest.mark.parametrize("width", [288, 326, 544])
def test_the_picture_fits_its_frame_and_can_be_started_there(width, opened):
    height = width + 192  # docs/site/site.css: 12rem
    screen_size = {"width": width, "height": height}
    tab = opened("?embedded", ready="app.seen", viewport=screen_size, reduced_motion="reduce")
    assert tab.evaluate("app.seen.steps") == 0
    tab.click("#pause")
    tab.wait_for_function("app.seen.steps > 3")
    tab.evaluate("""() => {
      app.run(false);
      Object.assign(app.seen, {held: [70, 70], holding: [false, false]});
      app.seen.points.forEach((places) => { places[places.length - 1] = [9, 9]; });
      app.say();
    }""")
    assert "cm away" in tab.inner_text("#said")
    assert tab.evaluate("document.documentElement.scrollHeight") <= height


def test_another_goal_comes_after_one_that_is_not_held(opened):
    tab = opened("#arm=FourR&who=nobody")
    tab.select_option("#who", "torque")
    tab.fill("#motor_strength", "0.2")
    tab.set_checked("#next", True)
    episode = tab.evaluate("app.episode")
    tab.evaluate(
        "app.judge({...app.seen, faults: [], ended: false, held: [70], holding: [false], steps: 130})"
    )
    assert tab.evaluate("app.episode") == episode
    tab.evaluate(
        "app.judge({...app.seen, faults: [], ended: false, held: [null], holding: [false], steps: 501})"
    )
    assert tab.evaluate("app.episode") == episode + 1


def test_errors_below_rounding_are_told_so(opened):
    tab = opened("#arm=FourR&who=nobody&accuracy=12")
    tab.evaluate("app.seen.costs[0].error = 0; app.seen.costs[0].estimate = 2e-13; app.costs()")
    shown = [cell.inner_text() for cell in tab.locator("#cost tbody td").all()]
    assert shown[1:] == ["2.0e-13", "below 1e-16"]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_text_is_read_on_its_background(scheme, opened):
    tab = opened("#arm=FourR&task=ReachAround&who=race", color_scheme=scheme)
    colors = tab.evaluate("""() => {
      const texts = [...document.querySelectorAll("h1, h2, p, th, td, label, button, output, #said div")];
      const fill = (one) => getComputedStyle(one).backgroundColor;
      const clear = (one) => one.parentElement && fill(one) === "rgba(0, 0, 0, 0)";
      const under = (one) => clear(one) ? under(one.parentElement) : one;
      return texts.filter((one) => one.offsetParent && one.textContent.trim()).map(
        (one) => [getComputedStyle(one).color, fill(under(one))]);
    }""")
    assert len(colors) > 50
    assert min(contrast(*pair) for pair in colors) >= 4.5
    colors = tab.evaluate("app.colors")
    for name in ("SAC", "PPO", "torque", "goal", "push", "joint", "edge", "alert"):
        assert contrast(colors[name], colors["paper"]) >= 3.0
    assert contrast(colors["joint"], colors["disc"]) >= 4.5  # the letter of a disc


def contrast(*colors):
    """The ratio of two colours' luminances (WCAG 2.2)."""

    def luminance(color):
        numbers = re.findall(r"\d+", color) if "rgb" in color else re.findall("[0-9a-f]{2}", color)
        shares = [int(x, 10 if "rgb" in color else 16) / 255 for x in numbers[:3]]
        linear = [x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in shares]
        return sum(w * x for w, x in zip((0.2126, 0.7152, 0.0722), linear, strict=True)) + 0.05

    low, high = sorted(map(luminance, colors))
    return high / low


LONG = "1." + "1" * 300_000  # a pattern that goes back takes hours
REFUSED = {
    "#arm=Scara": "arm=Scara (known: RPRP, FourR)",
    "#accuracy=99": "accuracy=99 (known: 2, 3, ",
    "#goal=5,0": "goal=5,0 (two numbers, 0.1 to 0.95 m from the base)",
    f"#goal={LONG},{LONG}x": "two numbers",
    "#who=me&accuracy=0": "who=me (known: learner, torque, nobody, race); accuracy=0",
    "#%E0%A4%A&arm=<b>": "arm=<b>",
    "#task=Track&goal=0.3,0.4": "goal=0.3,0.4 (this goal moves by itself)",
    "#task=Swing": "task=Swing (known: Reach, ReachAround, Track, ReachFault)",
}


def test_values_of_an_address_that_cannot_be_are_named(opened):
    tab = opened()
    for address, named in REFUSED.items():
        tab.evaluate("(address) => { location.hash = address; }", address)
        tab.wait_for_function(f"trouble.textContent.includes({json.dumps(named)})")
        assert "the default is used" in tab.inner_text("#trouble")
        assert tab.input_value("#arm") == "RPRP"


def test_a_browser_without_webassembly_is_told(opened):
    tab = opened(ready="trouble.textContent", init="delete globalThis.WebAssembly;")
    assert "no WebAssembly" in tab.inner_text("#trouble")


@pytest.mark.parametrize("name", ["kernel.js", "data.js"])
def test_a_damaged_file_is_told(name, opened, site, tmp_path):
    shutil.copytree(site, tmp_path / "page")
    file = tmp_path / "page" / name
    text = file.read_text()
    middle = len(text) // 2
    changed = text[:middle] + ("A" if text[middle] != "A" else "B") + text[middle + 1 :]
    file.write_text(changed if name == "data.js" else "")
    tab = opened(folder=tmp_path / "page", ready="trouble.textContent")
    assert f"{name} is damaged or missing" in tab.inner_text("#trouble")
    opened.told.clear()  # the browser itself says that the script is none


def test_a_hopeless_step_is_named_and_a_new_episode_begins(opened):
    tab = opened("#arm=RPRP&who=nobody&accuracy=12")
    tab.evaluate("""app.waiting = performance.now(); app.pictures = 0;
      app.send({do: "advance", steps: 1, push: [["tip_force.step[0]", Infinity]]})""")
    tab.wait_for_function("app.pictures >= 3")  # it goes on drawing meanwhile
    tab.wait_for_function("trouble.textContent.startsWith('numerics: ')", timeout=30_000)
    tab.wait_for_function("app.seen.steps > 2", timeout=30_000)
    assert all(abs(x) < 2.0 for place in tab.evaluate("app.seen.points[0]") for x in place)


def test_switches_change_the_simulation_and_the_bill(opened):
    tab = opened("#arm=RPRP&who=nobody")
    tab.fill("#gravity", "3.7")
    tab.fill("#motor_strength", "0.5")
    assert tab.evaluate("app.values()['gravity.g']") == 3.7
    tab.set_checked("#switch_gravity", False)
    scene = page.page_scene("RPRP", ReachTask())
    rest = tuple(effect for effect in scene.effects if effect.key != "gravity")
    expected = rde.bill(dataclasses.replace(scene, effects=rest), task=ReachTask())
    shown = tab.evaluate(
        "[...bill.tBodies[0].rows].map((row) => [...row.cells].map((one) => one.textContent))"
    )
    assert {name: [*map(int, counts)] for name, *counts in shown[:-1]} == {
        owner.replace("_", " "): [*counts] for owner, counts in expected.items()
    }
    assert tab.evaluate("app.values()['gravity.g']") == 0
    assert tab.evaluate("app.values()['effort_limits.limits[1]']") == 16.0
    assert tab.is_disabled("#gravity")


def test_it_is_paused_for_readers_who_ask_for_less_motion(opened):
    tab = opened(ready="app.seen", reduced_motion="reduce")
    tab.wait_for_timeout(300)
    assert tab.evaluate("app.seen.steps") == 0
    tab.click("#pause")
    tab.wait_for_function("app.seen.steps > 3")
