#!/usr/bin/env python3
"""Judges what `render` chooses by itself for random graphs, by rays that are walked by brute force.

    python3 scripts/random_graphs.py 1..300 -d graphs
    python3 scripts/random_table.py graphs --size 160x120 --markdown docs/lab/random.md

Each graph is rendered with defaults; then `truth` walks other rays of the same view and marches them as the picture did. Graphs
whose view hits nothing are counted and left out. With --price every method and several step multipliers are marched too; the
price of a choice is its render time over that of the cheapest that keeps the budget.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

MISSED, EARLY = 0.005, 0.05
LADDER = [(m, f) for m in ("scalar", "gradient", "combined", "frobenius", "jacobian", "delta") for f in (1.0, 0.5, 0.25, 0.1)]
LADDER += [("certified", 1.0), ("certified-ball", 1.0)]


def run(command, limit):
    """Output, messages and seconds of a command; no output where it failed or took too long."""
    start = time.monotonic()
    environment = dict(os.environ, BULBFOLD_CACHE="")
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=limit, env=environment)
    except subprocess.TimeoutExpired:
        return None, "took too long", time.monotonic() - start
    # The exit code 1 of `truth` says that the budget is broken.
    out = done.stdout if done.stdout.strip() else None
    return out, done.stderr, time.monotonic() - start


def judged(program, path, size, rays, settings, limit, precision="f32"):
    """The summary of `truth` for settings of an estimate."""
    command = [program, "truth", str(path), "--rays", str(rays), "--size", size, "--seed", "77", "--precision", precision,
               "--calibrate", "off", "--json", *settings]
    out, _, _ = run(command, limit)
    return json.loads(out.strip().splitlines()[-1])["summary"] if out else None


def flags(method, form, fudge, least_step, most_step=None, late_ends=False):
    given = ["--fudge", repr(fudge)]
    given += ["--de", method] if method else []
    given += ["--form", form] if form else []
    given += ["--least-step", repr(least_step)] if least_step else []
    given += ["--most-step", repr(most_step)] if most_step else []
    given += ["--late-ends"] if late_ends else []
    return given


def is_kept(summary):
    missed = round(summary["missed"] * summary["hits"])
    # One hit of few is more than the budget by itself, and says nothing.
    return missed <= max(MISSED * summary["hits"], 1 if summary["hits"] < 200 else 0) and summary["early"] <= EARLY


def measure(program, path, arguments, folder):
    """A row of the table: what was chosen and how it did."""
    row = {"graph": path.stem}
    picture = folder / "picture.png"
    command = [program, "render", str(path), "--size", arguments.size, "--json", "-q", "--force", "-o", str(picture)]
    out, messages, row["seconds"] = run(command, arguments.limit)
    if out is None:
        row["failed"] = messages.strip().splitlines()[0] if messages.strip() else "nothing was written"
        return row
    made = json.loads(out)
    chosen = [c for c in made["calibration"]["candidates"] if c["why_not"] is None]
    row["warned"] = "warning" in messages
    row["warning"] = messages.strip()
    row["share"] = made["hits"] / made["rays"]
    row["estimates"] = sum(made["estimates_per_pixel"].values())
    if not chosen:
        row["empty"] = True
        return row
    choice = chosen[0]
    late = " late" if choice["late_ends"] else ""
    row["choice"] = f'{choice["method"]}{late} {choice["fudge"]:g}' + (f' in {choice["most_step"]:g}' if choice["most_step"] else "")
    settings = flags(choice["method"], choice["form"], choice["fudge"], choice["least_step"],
                     choice["most_step"], choice["late_ends"])
    precision = "f64" if "f64" in made["backend"] else "f32"
    row["settings"] = [*settings, "--precision", precision]
    summary = judged(program, path, arguments.size, arguments.rays, settings, arguments.limit, precision)
    if summary is None:
        row["failed"] = "truth"
        return row
    row.update({k: summary[k] for k in ("hits", "missed", "early", "ambiguous")})
    row["empty"] = summary["hits"] == 0
    row["kept"] = is_kept(summary)
    if arguments.price and not row["empty"]:
        row["price"] = price(program, path, arguments, picture, made["render_seconds"])
    return row


def price(program, path, arguments, picture, seconds):
    """Render time over that of the cheapest of the ladder that keeps the budget; none where nothing does."""
    best = None
    for method, fudge in LADDER:
        settings = flags(method, None, fudge, None)
        summary = judged(program, path, arguments.size, arguments.rays, settings, arguments.limit)
        if summary is None or not is_kept(summary) or summary["median_error"] is None or summary["median_error"] > 0.5:
            continue
        command = [program, "render", str(path), "--size", arguments.size, "--calibrate", "off", "--json", "-q", "--force",
                   "-o", str(picture), *settings]
        out, _, _ = run(command, arguments.limit)
        if out:
            taken = json.loads(out)["render_seconds"]
            best = taken if best is None else min(best, taken)
    return seconds / best if best else None


def table(rows, arguments):
    shown = [r for r in rows if not r.get("failed") and not r.get("empty")]
    kept = [r for r in shown if r["kept"]]
    silent = [r for r in shown if not r["kept"] and not r["warned"]]
    hits = sum(r["hits"] for r in shown) or 1
    missed = sum(r["missed"] * r["hits"] for r in shown)
    failed = [r for r in rows if r.get("failed")]
    lines = [
        f"{len(rows)} graphs at {arguments.size}, {arguments.rays} rays each: {len(shown)} show something; "
        f"{len(kept)} of these keep the budget ({100 * len(kept) / max(len(shown), 1):.1f} %), "
        f"{len(silent)} break it without a warning.",
        f"Of all {hits} hits {100 * missed / hits:.2f} % are missed. {len(failed)} failed or took over "
        f"{arguments.limit} s. Time of all commands: {sum(r['seconds'] for r in rows):.0f} s.",
    ]
    prices = sorted(r["price"] for r in shown if r.get("price"))
    if prices:
        lines.append(f"Price over the cheapest that keeps the budget: median {prices[len(prices) // 2]:.2f}, "
                     f"90 % under {prices[int(len(prices) * 0.9)]:.2f}, most {prices[-1]:.2f}.")
    lines += ["", "| Graph | Choice | Estimates a pixel | Hits | Missed % | Early % | Budget | Seconds |", "|---|---|---|---|---|---|---|---|"]
    for r in rows:
        if r.get("failed"):
            lines.append(f"| {r['graph']} | {r['failed'][:60]} | | | | | | {r['seconds']:.1f} |")
        elif r.get("empty"):
            lines.append(f"| {r['graph']} | {r.get('choice', '')} | {r['estimates']:.1f} | 0 | | | shows nothing | {r['seconds']:.1f} |")
        else:
            verdict = "kept" if r["kept"] else ("broken, warned" if r["warned"] else "broken")
            lines.append(f"| {r['graph']} | {r['choice']} | {r['estimates']:.1f} | {r['hits']} | {100 * r['missed']:.2f} | "
                         f"{100 * r['early']:.2f} | {verdict} | {r['seconds']:.1f} |")
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path, help="the folder of the graphs")
    parser.add_argument("--program", default="target/release/bulbfold", help="what is judged [default: %(default)s]")
    parser.add_argument("--size", default="160x120")
    parser.add_argument("--rays", type=int, default=300)
    parser.add_argument("--limit", type=float, default=60.0, metavar="SECONDS", help="of each command")
    parser.add_argument("--price", action="store_true", help="also march every method")
    parser.add_argument("--markdown", type=pathlib.Path, metavar="FILE", help="where the table goes")
    arguments = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for path in sorted(arguments.folder.glob("*.ron")):
            rows.append(measure(arguments.program, path, arguments, pathlib.Path(folder)))
            print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
    text = table(rows, arguments)
    print(text.split("\n\n")[0])
    if arguments.markdown:
        arguments.markdown.write_text(text)


if __name__ == "__main__":
    main()
