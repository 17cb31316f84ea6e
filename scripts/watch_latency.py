#!/usr/bin/env python3
"""Measures how soon `bulbfold watch` shows a first picture after a save.

    scripts/watch_latency.py [--program target/release/bulbfold] [--saves 9] [NAME ...]

Each fractal is written as a file, watched at 1280x720, and saved several times, each time with another position of its camera. Printed are the least, the median and
the greatest time from the end of the write until the page is told of the first picture, in milliseconds, and the time to the whole picture.
"""

import argparse
import json
import pathlib
import re
import statistics
import subprocess
import tempfile
import time
import urllib.request

README = [
    "mandelbulb", "box_bulb", "hyperbolic_honeycomb", "mandelbox", "amazing_surface", "hollow_icosahedron",
    "pseudo_kleinian", "quaternion_julia", "menger", "kali_box", "sierpinski_tetrahedron", "apollonian",
]  # fmt: skip


def state(address, after):
    with urllib.request.urlopen(f"{address}state?after={after}", timeout=60) as answer:
        return json.load(answer)


def until(address, holds):
    """The first state that holds, and when it came."""
    after = 0
    while True:
        told = state(address, after)
        now = time.perf_counter()
        if holds(told):
            return told, now
        after = told["version"]


def moved(text, share):
    """The file with its camera a bit farther away."""
    def farther(match):
        numbers = [float(x) * share for x in match.group(1).split(",")]
        return f"camera: (position: ({', '.join(map(str, numbers))})"

    return re.sub(r"camera: \(position: \(([^)]*)\)", farther, text, count=1)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("names", nargs="*", default=README)
    parser.add_argument("--program", default="target/release/bulbfold")
    parser.add_argument("--saves", type=int, default=9)
    options = parser.parse_args()
    program = str(pathlib.Path(options.program).resolve())
    medians = []
    print(f"{'fractal':<24}{'least':>8}{'median':>8}{'most':>8}  whole")
    for name in options.names:
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([program, "new", "seen", "--from", name], cwd=folder, check=True, capture_output=True)
            file = pathlib.Path(folder, "seen.ron")
            text = file.read_text()
            arguments = [program, "watch", "seen.ron", "--no-preview", "--quiet"]
            child = subprocess.Popen(arguments, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
            address = child.stdout.readline().strip()
            before, _ = until(address, lambda told: told["part"] == "whole")
            times, wholes = [], []
            for i in range(options.saves):
                file.write_text(moved(text, 1 + 0.01 * (i + 1)))
                start = time.perf_counter()
                seen = before["picture"]
                first, came = until(address, lambda told: told["picture"] > seen)
                times.append(1000 * (came - start))
                before, whole = until(address, lambda told: told["picture"] > seen and told["part"] == "whole")
                wholes.append(whole - start)
            child.kill()
            child.wait()
        medians.append(statistics.median(times))
        print(f"{name:<24}{min(times):>8.0f}{medians[-1]:>8.0f}{max(times):>8.0f}  {statistics.median(wholes):.1f} s", flush=True)
    print(f"median of all: {statistics.median(medians):.0f} ms")


if __name__ == "__main__":
    main()
