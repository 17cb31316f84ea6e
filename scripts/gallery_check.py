#!/usr/bin/env python3
"""Opens a gallery page in a headless Chromium and checks that it works.

    scripts/gallery_check.py gallery/index.html [--search WORD] [--screenshots DIR] [--chromium PATH]

Typing filters the cards, the group filter too, cards open and close by keyboard, the copy button copies, all pictures
are there, text is readable in dark and light, nothing is asked of a network, and the console stays empty. Prints a line
for each check; exit code 0 when all hold, 1 when one fails, 3 where there is no Chromium. Python's standard library is
enough: the browser is driven over a pipe (--remote-debugging-pipe).
"""

import argparse
import base64
import json
import pathlib
import sys

from browser import run

VISIBLE = "[...document.querySelectorAll('.card')].filter((c) => c.getBoundingClientRect().height > 0)"
# Contrast after the Web Content Accessibility Guidelines; text is read against the nearest background that is opaque.
CONTRAST = """(() => {
  const parse = (c) => c.match(/[\\d.]+/g).map(Number);
  const light = (c) => { const [r, g, b] = c.map((x) => (x /= 255) <= 0.03928 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4); return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
  let worst = [21, ""];
  for (const e of document.querySelectorAll("h1, h2, h3, p, dt, dd, td, th, code, pre, summary, label, input, select, button, footer, span")) {
    if (!e.textContent.trim() && !e.matches("input")) continue;
    let at = e, back;
    do { back = parse(getComputedStyle(at).backgroundColor); at = at.parentElement; } while (at && back[3] === 0);
    const [a, b] = [light(parse(getComputedStyle(e).color).slice(0, 3)), light(back.slice(0, 3))];
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (ratio < worst[0]) worst = [ratio, e.tagName + " " + e.textContent.slice(0, 30)];
  }
  return worst;
})()"""


def check(browser, page, options, checks):
    for domain in ["Page", "Runtime", "Log", "Network"]:
        browser.call(f"{domain}.enable")
    browser.call("Page.navigate", url=page.resolve().as_uri())
    browser.wait("Page.loadEventFired")

    total = browser.run("document.querySelectorAll('.card').length")
    checks.that(total > 0 and browser.run(f"{VISIBLE}.length") == total, f"all {total} cards are shown")
    broken = browser.run(
        """Promise.all([...document.images].map(async (i) => { i.loading = 'eager'; try { await i.decode(); } catch { return i.src; } return i.naturalWidth > 1 ? '' : i.src; })).then((all) => all.filter(Boolean))"""
    )
    checks.that(not broken, f"all pictures can be read {broken or ''}")
    shot(browser, options, "light")

    # Search by keys alone.
    names = browser.run("[...document.querySelectorAll('.card h2')].map((h) => h.textContent)")
    word = options.search or names[0]
    browser.press("/", 191, "/")
    checks.that(browser.run("document.activeElement.id") == "search", "the key / goes to the search")
    browser.call("Input.insertText", text=word)
    found = browser.run(f"{VISIBLE}.map((c) => [c.querySelector('h2').textContent, c.dataset.text])")
    right = all(word.lower() in text for _, text in found)
    wanted = browser.run(f"[...document.querySelectorAll('.card')].filter((c) => c.dataset.text.includes({json.dumps(word.lower())})).length")
    checks.that(
        right and 0 < len(found) == wanted and (len(found) < total or total == 1), f"typing `{word}` leaves {len(found)} of {total} cards"
    )
    count = browser.run("document.getElementById('count').textContent")
    checks.that(count == f"{len(found)} of {total}", f"the count says `{count}`")
    shot(browser, options, "search")
    browser.call("Input.insertText", text=" nothing-has-this-word")
    checks.that(
        browser.run(f"{VISIBLE}.length") == 0 and not browser.run("document.getElementById('none').hidden"),
        "a search without a result says so",
    )
    browser.run("search.value = ''; search.dispatchEvent(new Event('input'))")
    checks.that(browser.run(f"{VISIBLE}.length") == total, "an empty search shows all again")

    groups = browser.run("[...document.querySelectorAll('#group option')].map((o) => o.value).filter(Boolean)")
    sums = 0
    for group in groups:
        browser.run(f"group.value = {json.dumps(group)}; group.dispatchEvent(new Event('change'))")
        inside = browser.run(f"{VISIBLE}.map((c) => c.dataset.group)")
        sums += len(inside)
        if not inside or any(found != group for found in inside):
            checks.that(False, f"the group {group} shows {inside}")
    checks.that(sums == total, f"the {len(groups)} groups show all cards between them")
    browser.run("group.value = ''; group.dispatchEvent(new Event('change'))")

    # A card opens by Tab and Enter.
    browser.run("document.getElementById('group').focus()")
    for _ in range(40):
        browser.press("Tab", 9)
        if browser.run("document.activeElement.tagName") == "SUMMARY":
            break
    browser.press("Enter", 13, "\r")
    opened = "document.activeElement.closest('details').open"
    checks.that(browser.run("document.activeElement.tagName") == "SUMMARY" and browser.run(opened), "Tab and Enter open a card")
    content = browser.run(
        "(() => { const d = document.activeElement.closest('details'); return [d.querySelector('pre').getBoundingClientRect().height, d.querySelector('button').dataset.copy] })()"
    )
    checks.that(content[0] > 40 and content[1].startswith("bulbfold render "), f"it shows formula and command `{content[1]}`")
    shot(browser, options, "open")
    browser.call("Browser.grantPermissions", permissions=["clipboardReadWrite", "clipboardSanitizedWrite"])
    browser.run("document.querySelector('details[open] button').click()")
    label = browser.run("new Promise((done) => setTimeout(() => done(document.querySelector('details[open] button').textContent), 300))")
    checks.that(label == "Copied", f"the copy button says `{label}`")
    browser.run("document.querySelector('details[open] button').focus()")
    browser.press("Escape", 27)
    checks.that(browser.run("!document.querySelector('details[open]')"), "Escape closes it")

    browser.run("document.querySelectorAll('details').forEach((d, i) => (d.open = i < 3))")
    for scheme in ["light", "dark"]:
        browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
        ratio, where = browser.run(CONTRAST)
        checks.that(ratio >= 4.5, f"the least contrast in {scheme} is {ratio:.1f} ({where})")
    shot(browser, options, "dark")
    browser.call("Emulation.setDeviceMetricsOverride", width=360, height=740, deviceScaleFactor=1, mobile=True)
    wide = browser.run("document.documentElement.scrollWidth")
    checks.that(wide <= 360, f"on a screen of 360 pixels the page is {wide} wide")
    shot(browser, options, "small")

    browser.run("new Promise((done) => setTimeout(done, 200))")
    asked = [e["params"]["request"]["url"] for e in browser.events if e.get("method") == "Network.requestWillBeSent"]
    outside = [url[:80] for url in asked if not url.startswith(("file:", "data:"))]
    checks.that(not outside and len(asked) > 0, f"{len(asked)} files were read, nothing from a network {outside or ''}")
    said = [e["params"] for e in browser.events if e.get("method") in ("Log.entryAdded", "Runtime.exceptionThrown", "Runtime.consoleAPICalled")]
    checks.that(not said, f"the console is empty {json.dumps(said)[:600] if said else ''}")


def shot(browser, options, name):
    if options.screenshots:
        data = browser.call("Page.captureScreenshot", format="png")["data"]
        (options.screenshots / f"{name}.png").write_bytes(base64.b64decode(data))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("page", type=pathlib.Path)
    parser.add_argument("--search", help="a word that some cards have and others have not [default: the first card's name]")
    parser.add_argument("--screenshots", type=pathlib.Path, help="folder for pictures of the page")
    parser.add_argument("--chromium", help="the browser's path [default: CHROMIUM, or a usual name]")
    options = parser.parse_args()
    if options.screenshots:
        options.screenshots.mkdir(parents=True, exist_ok=True)
    return run(lambda browser, checks: check(browser, options.page, options, checks), options.chromium)


if __name__ == "__main__":
    sys.exit(main())
