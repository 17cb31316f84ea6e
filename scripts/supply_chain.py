#!/usr/bin/env python3
"""Checks all dependencies against deny.toml: licences, doubled versions, banned packages and sources.

    python3 scripts/supply_chain.py

It reads `cargo metadata` and needs neither the network nor cargo-deny, which checks the same file and advisories too.
"""

import collections
import json
import pathlib
import re
import subprocess
import sys
import tomllib

ROOT = pathlib.Path(__file__).resolve().parent.parent


def is_allowed(expression, allowed):
    """Whether a licence expression (SPDX, or with `/` for OR as older packages have it) can be met by what is allowed."""
    words = re.findall(r"\(|\)|[^\s()]+", expression.replace("/", " OR "))

    def either():
        result = both()
        while words and words[0] == "OR":
            words.pop(0)
            result = both() or result
        return result

    def both():
        result = single()
        while words and words[0] == "AND":
            words.pop(0)
            result = single() and result
        return result

    def single():
        word = words.pop(0)
        if word == "(":
            result = either()
            words.pop(0)
            return result
        if words and words[0] == "WITH":
            words.pop(0)
            word = f"{word} WITH {words.pop(0)}"
        return word.removesuffix("+") in allowed

    return either()


def main():
    rules = tomllib.loads((ROOT / "deny.toml").read_text())
    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--all-features"]
    metadata = json.loads(subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout)
    wrong = []
    versions = collections.defaultdict(set)
    registries = {f"registry+{url}" for url in rules["sources"]["allow-registry"]}
    banned = {rule["crate"] for rule in rules["bans"]["deny"]}
    for package in metadata["packages"]:
        name = f"{package['name']} {package['version']}"
        versions[package["name"]].add(package["version"])
        licence = package["license"]
        if not licence or not is_allowed(licence, rules["licenses"]["allow"]):
            wrong.append(f"{name}: the licence {licence} is not allowed")
        if package["source"] is not None and package["source"] not in registries:
            wrong.append(f"{name}: the source {package['source']} is not allowed")
        if package["name"] in banned:
            wrong.append(f"{name} is banned")
        for dependency in package["dependencies"] if package["source"] is None else []:
            if dependency["req"] == "*" and not dependency.get("path"):
                wrong.append(f"{name}: any version of {dependency['name']} is taken")
    skipped = {rule["crate"] for rule in rules["bans"]["skip"]}
    for name, found in sorted(versions.items()):
        if len(found) > 1 and name not in skipped:
            wrong.append(f"{name} is built in versions {', '.join(sorted(found))}")
        if len(found) == 1 and name in skipped:
            wrong.append(f"{name} has one version now: take it out of `skip`")
    print("\n".join(wrong) or f"{len(metadata['packages'])} packages: licences, versions and sources are as deny.toml wants them")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
