#!/usr/bin/env python3
"""Renders the pictures of the README again, each by the command that stands under it.

    python3 scripts/strip.py            # needs target/release/bulbfold and Pillow

A picture `docs/images/strip/NAME.jpg` belongs to the command in the same column of the row below it.
"""
import pathlib
import re
import shlex
import subprocess
import tempfile

from PIL import Image

ROOT = pathlib.Path(__file__).resolve().parent.parent
PROGRAM = ROOT / "target/release/bulbfold"
SETTINGS = ["--size", "480x300", "--samples", "4", "--quiet"]


def pictures(readme):
    """Pairs of a picture's path and its command, in the order of the page."""
    rows = [line for line in readme.splitlines() if line.startswith("|")]
    for above, below in zip(rows, rows[1:]):
        paths = re.findall(r"\((docs/images/strip/\w+\.jpg)\)", above)
        # The first row of a table is its head, with a line of dashes below.
        commands = re.findall(r"`bulbfold (render [^`]*)`", below)
        if paths and commands:
            assert len(paths) == len(commands), above
            yield from zip(paths, commands)


def main():
    for path, command in pictures((ROOT / "README.md").read_text()):
        with tempfile.NamedTemporaryFile(suffix=".png") as png:
            subprocess.run([PROGRAM, *shlex.split(command), *SETTINGS, "-o", png.name], check=True)
            Image.open(png.name).convert("RGB").save(ROOT / path, quality=86, optimize=True)
        print(path)


main()
