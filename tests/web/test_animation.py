"""Animations of a notebook in a browser: each video has keys of its own, and asks for nothing."""

import numpy as np
import pytest
from catalogue import EQUAL

import redundant_envs as rde
from redundant_envs.envs.animation import FRAMES_PER_SECOND

pytestmark = pytest.mark.long

STATE = """() => [...document.querySelectorAll("video")].map(
  (one) => [one.paused, one.playbackRate, Math.floor(one.currentTime * %d)])"""
AT_ONCE = """(one) => {
  for (const key of ["ArrowLeft", " ", " "]) one.dispatchEvent(new KeyboardEvent("keydown", { key }));
}"""
LOADED = '() => [...document.querySelectorAll("video")].every((one) => one.readyState > 3)'


def test_keys_act_on_the_animation_that_was_clicked(chromium):
    motion = rde.simulate(rde.Scene(EQUAL["4R"]), np.full(4, 0.3), np.ones(4), np.linspace(0.0, 2.0, 51))
    context, told = chromium.new_context(), []
    context.set_offline(True)
    tab = context.new_page()
    tab.on("pageerror", lambda error: told.append(str(error)))
    tab.on("request", lambda one: one.url.startswith("data:") or told.append(one.url))
    tab.set_content(2 * rde.animate(motion)._repr_html_())
    tab.wait_for_function(LOADED)
    tab.evaluate('document.addEventListener("keydown", (one) => (document.title += one.key))')  # a notebook

    def after(*keys):
        """Of the second video: whether it is paused, its speed and its frame."""
        for key in keys:
            tab.keyboard.press(key)
        first, second = tab.evaluate(STATE % FRAMES_PER_SECOND)
        assert first[:2] == [False, 1]
        return second

    tab.locator("video").last.click()  # which pauses it, too
    assert after()[:2] == [True, 1]
    assert after(" ")[:2] == [False, 1]
    assert after(" ")[:2] == [True, 1]
    tab.locator("video").last.evaluate(AT_ONCE)
    tab.evaluate('document.querySelectorAll("video")[1].currentTime = 1')
    assert after("ArrowRight", "ArrowRight", "ArrowLeft", "ArrowRight") == [True, 1, 27]
    assert after("ArrowUp", "+", "Control+-", "x") == [True, 4, 27]
    assert after(*["ArrowUp"] * 3) == [True, 8, 27]
    assert after(*["-", "ArrowDown"] * 4) == [True, 0.125, 27]
    assert after(" ")[:2] == [False, 0.125]
    assert after("ArrowLeft")[:2] == [True, 0.125]
    assert tab.title() == "Control-x"
    context.close()
    assert told == []
