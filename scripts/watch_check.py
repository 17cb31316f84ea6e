#!/usr/bin/env python3
"""Opens the page of `bulbfold watch` in a headless Chromium and checks that it works.

    scripts/watch_check.py ADDRESS FILE [--screenshot OUT.png] [--chromium PATH]

FILE is what is watched; it has a parameter `scale`, a preset `far` and a camera. A save shows another picture, a mistake shows its line and keeps
the picture, sliders, presets, mouse and keys change it, and what was moved goes into the file. Prints a line for each check; exit code 0 when all
hold, 1 when one fails, 3 where there is no Chromium.
"""

import argparse
import base64
import json
import pathlib
import sys
import time

from browser import run

PATIENCE = 60.0


def until(browser, condition):
    """Whether a condition of the page becomes true."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if browser.run(condition):
            return True
        time.sleep(0.02)
    return False


def settled(browser):
    """Waits for the whole picture of the last order."""
    return until(browser, "!busy && !waiting.length && state.part === 'whole' && state.picture === drawn")


def pixels(browser):
    """The sum of all numbers of the picture, and how many pixels are not like the one in the corner."""
    return browser.run(
        "(() => { const d = canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data; let sum = 0, other = 0;"
        "for (let i = 0; i < d.length; i += 4) { sum += d[i] + 3 * d[i + 1] + 7 * d[i + 2]; other += Math.abs(d[i] - d[0]) > 24; } return [sum, other]; })()"
    )


def changes(browser, checks, act, text):
    """Whether what `act` does leads to another picture."""
    settled(browser)
    before, seen = browser.run("state.picture"), pixels(browser)
    act()
    came = until(browser, f"state.picture > {before} && state.part === 'whole' && drawn === state.picture")
    checks.that(came and pixels(browser) != seen, text)


def mouse(browser, kind, x, y, button="left", **more):
    browser.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button=button, clickCount=1, **more)


def check(browser, address, file, options, checks):
    for domain in ["Page", "Runtime", "Log", "Network"]:
        browser.call(f"{domain}.enable")
    browser.call("Page.navigate", url=address)
    browser.wait("Page.loadEventFired")
    checks.that(settled(browser), "the whole picture comes")
    size = browser.run("[canvas.width, canvas.height]")
    checks.that(size == browser.run("state.whole"), f"it has {size[0]}x{size[1]} pixels")
    checks.that(pixels(browser)[1] > 0.05 * size[0] * size[1], "it shows something")

    text = file.read_text()
    changes(browser, checks, lambda: file.write_text(text.replace("fov: 42", "fov: 25")), "a save shows another picture")
    whole = pixels(browser)
    file.write_text(text.replace("fov: 42", "fov: nonsense"))
    checks.that(until(browser, "!document.getElementById('message').hidden"), "a mistake is shown")
    message = browser.run("document.getElementById('message').textContent")
    line = next(i for i, line in enumerate(text.splitlines(), 1) if "fov: 42" in line)
    checks.that(f"{file.name}:{line}:" in message, f"with its line {line}")
    checks.that(pixels(browser) == whole, "the last good picture stays")
    changes(browser, checks, lambda: file.write_text(text), "a mended file shows its picture")
    checks.that(browser.run("document.getElementById('message').hidden"), "and no message")

    slider = "document.querySelector('[data-path=\"scale\"] [type=range]')"
    checks.that(browser.run(f"!!{slider} && +{slider}.min < +{slider}.value && +{slider}.value < +{slider}.max"), "the parameter has a slider within its range")
    move = f"{slider}.value = 2.6; {slider}.dispatchEvent(new Event('input')); {slider}.dispatchEvent(new Event('change'))"
    changes(browser, checks, lambda: browser.run(move), "the slider changes the picture")
    changes(browser, checks, lambda: browser.run("[...document.querySelectorAll('#presets button')].find(b => b.textContent === 'far').click()"), "a preset shows another picture")
    changes(browser, checks, lambda: browser.run("document.getElementById('back').click()"), "and back")

    def drag(button="left"):
        mouse(browser, "mousePressed", 300, 300, button)
        for x in range(300, 421, 20):
            mouse(browser, "mouseMoved", x, 300, button, buttons=1 if button == "left" else 2)
        mouse(browser, "mouseReleased", 420, 300, button)

    flags = browser.run("state.flags")
    changes(browser, checks, drag, "dragging turns it")
    checks.that(browser.run("state.flags") != flags, "and the camera is another one")
    changes(browser, checks, lambda: drag("right"), "the right button moves sideways")
    changes(browser, checks, lambda: browser.call("Input.dispatchMouseEvent", type="mouseWheel", x=300, y=300, deltaX=0, deltaY=-200), "the wheel goes nearer")

    def key(name, code, seconds):
        browser.call("Input.dispatchKeyEvent", type="keyDown", key=name, code=code)
        time.sleep(seconds)
        browser.call("Input.dispatchKeyEvent", type="keyUp", key=name, code=code)

    browser.run("canvas.focus()")
    changes(browser, checks, lambda: key("w", "KeyW", 0.5), "a key flies")
    changes(browser, checks, lambda: key("ArrowLeft", "ArrowLeft", 0.3), "another one turns")

    settled(browser)
    browser.run(move)
    settled(browser)
    camera = browser.run("state.camera")
    browser.run("document.getElementById('write').click()")
    checks.that(until(browser, "!state.is_moved"), "all of it goes into the file")
    written = file.read_text()
    checks.that("default: 2.6" in written, "the number")
    position = camera[camera.index("position: ") : camera.index(", target")]
    checks.that(position in written, "the camera")
    kept = [part for line in text.splitlines() for part in [line.split("//")[-1]] if "//" in line]
    checks.that(all(part in written for part in kept) and len(written.splitlines()) == len(text.splitlines()), "comments and lines stay")
    settled(browser)
    # Limits of iterations and a look's sun go by the file's own view, which is another one by now, so that colours may differ.
    place = camera[camera.index("position: ") : camera.index(")", camera.index("target: "))]
    checks.that(until(browser, f"state.camera.includes({json.dumps(place)}) && state.part === 'whole'"), "and the file shows the same view")

    if options.screenshot:
        data = browser.call("Page.captureScreenshot", format="png")["data"]
        options.screenshot.write_bytes(base64.b64decode(data))
    asked = [e["params"]["request"]["url"] for e in browser.events if e.get("method") == "Network.requestWillBeSent"]
    checks.that(all(url.startswith((address, "data:", "blob:")) for url in asked), "nothing is asked of anybody else")
    said = [e["params"] for e in browser.events if e.get("method") in ("Log.entryAdded", "Runtime.exceptionThrown", "Runtime.consoleAPICalled")]
    checks.that(not said, f"the console is empty {json.dumps(said)[:600] if said else ''}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("address")
    parser.add_argument("file", type=pathlib.Path)
    parser.add_argument("--screenshot", type=pathlib.Path, help="a picture of the page")
    parser.add_argument("--chromium", help="the browser's path [default: CHROMIUM, or a usual name]")
    options = parser.parse_args()
    return run(lambda browser, checks: check(browser, options.address, options.file, options, checks), options.chromium)


if __name__ == "__main__":
    sys.exit(main())
