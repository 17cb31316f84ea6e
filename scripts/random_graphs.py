#!/usr/bin/env python3
"""Writes random graphs: one to four steps of the whole library, in random order and with random parameters.

    python3 scripts/random_graphs.py 7 -o graph.ron              # the graph of seed 7
    python3 scripts/random_graphs.py 1..300 -d graphs            # graphs/0001.ron to graphs/0300.ron

A seed gives the same graph on every machine, as long as the steps stay the same. A graph states nothing that the program
can choose by itself: no bounds, no camera, no estimate. At least one step of each graph makes orbits grow.
"""

import argparse
import pathlib
import random
import re
import sys

STEPS = pathlib.Path(__file__).resolve().parent.parent / "formulas" / "steps"
GROWING = ("power", "algebra")
# Steps that need more than an orbit's settings: the state of the time before, or a matrix.
LEFT_OUT = {"phoenix", "manowar", "linear"}


def read_steps():
    """All steps that maps are made of: name, group, components and parameters."""
    steps = []
    for path in sorted(STEPS.glob("*.rhai")):
        text = path.read_text()
        group = re.search(r'group: "([^"]*)"', text).group(1)
        state = re.search(r'state: ("[^"]*"|\d+)', text)
        # What makes four components of three stands before an orbit only.
        lifts = state is not None and "to" in state.group(1)
        if group == "shape" or lifts or path.stem in LEFT_OUT:
            continue
        params = re.findall(r'#\{ name: "(\w+)", type: "(\w+)",(.*?)help:', text)
        steps.append({
            "name": path.stem,
            "group": group,
            "four": state is not None and "4" in state.group(1),
            "params": [read_parameter(*p) for p in params],
        })
    return steps


def number(text):
    """A number of a step file, which may be a quotient."""
    return float(eval(text, {"__builtins__": {}}))  # the project's own files


def read_parameter(name, kind, rest):
    parameter = {"name": name, "kind": kind}
    for key in ("min", "max"):
        found = re.search(rf"\b{key}: ([-\d.eE+ /]+)", rest)
        parameter[key] = number(found.group(1)) if found else None
    if kind == "choice":
        parameter["choices"] = re.findall(r'"([^"]+)"', re.search(r"choices: \[(.*?)\]", rest).group(1))
    elif kind == "bool":
        parameter["default"] = "true" in re.search(r'"default": (\w+)', rest).group(1)
    elif kind in ("vec3", "point", "mat3"):
        inside = re.search(r'"default": \[(.*?)\](?=, (?:min|unit|max))', rest)
        parameter["default"] = [number(x) for x in inside.group(1).replace("[", "").replace("]", "").split(",")]
    else:
        parameter["default"] = number(re.search(r'"default": ([-\d.eE+ /]+)', rest).group(1))
    return parameter


def clamped(value, parameter):
    low = parameter["min"] if parameter["min"] is not None else -1e9
    high = parameter["max"] if parameter["max"] is not None else 1e9
    return min(max(value, low), high)


def random_value(draw, parameter):
    """A value near the default, as a user would try one; None leaves the default."""
    kind, default = parameter["kind"], parameter.get("default")
    if kind == "choice":
        return f'"{draw.choice(parameter["choices"])}"'
    if kind == "bool":
        return "true" if draw.random() < 0.5 else "false"
    if kind == "mat3":
        return None
    if kind == "int":
        return str(int(clamped(default + draw.choice([-1, 0, 0, 1, 2]), parameter)))
    if kind == "angle":
        return f"{clamped(draw.uniform(-60.0, 60.0), parameter):.2f}"
    if kind in ("vec3", "point"):
        parts = [clamped(x * draw.uniform(0.6, 1.5) + draw.uniform(-0.15, 0.15), parameter) for x in default]
        return "(" + ", ".join(f"{x:.4f}" for x in parts) + ")"
    value = default * draw.uniform(0.6, 1.5) + (draw.uniform(-0.3, 0.3) if default == 0.0 else 0.0)
    if float(default).is_integer() and abs(default) >= 2.0 and draw.random() < 0.6:
        value = round(value)
    return f"{clamped(value, parameter):.4f}"


def written(draw, step):
    values = []
    for parameter in step["params"]:
        value = random_value(draw, parameter) if draw.random() < 0.7 else None
        if value is not None:
            values.append(f'{parameter["name"]}: {value}')
    return f'{step["name"]}({", ".join(values)})'


def graph(seed, steps):
    """The text of the graph of a seed."""
    draw = random.Random(seed)
    four = draw.random() < 0.12
    # A 4D orbit takes what works in any dimension and what is made for four components.
    pool = [s for s in steps if not s["four"]] if not four else steps
    chosen = [draw.choice(pool) for _ in range(draw.randint(1, 4))]
    if not any(s["group"] in GROWING or s["name"] in ("scale", "axis_scale") for s in chosen):
        growing = [s for s in pool if s["group"] in GROWING or s["name"] == "scale"]
        chosen[draw.randrange(len(chosen))] = draw.choice(growing)
    nodes = [f'        "s{i}": {written(draw, step)},' for i, step in enumerate(chosen)]
    names = ", ".join(f'"s{i}"' for i in range(len(chosen)))
    nodes.append(f'        "all": Sequence([{names}]),')
    if draw.random() < 0.5:
        constant = "Mandelbrot"
    else:
        constant = "Julia((" + ", ".join(f"{draw.uniform(-0.8, 0.8):.4f}" for _ in range(3)) + "))"
    powers = sum(s["group"] in GROWING for s in chosen)
    radius = draw.choice([10.0, 30.0, 100.0]) if powers else draw.choice([30.0, 100.0, 1000.0])
    iterations = draw.randint(4, 9) if powers else draw.randint(7, 14)
    lines = ["(", "    nodes: {", *nodes, "    },", '    output: "all",', f"    constant: {constant},"]
    lines += [f"    escape_radius: {radius},", f"    max_iterations: {iterations},", ")", ""]
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seeds", help="a seed, or FIRST..LAST")
    parser.add_argument("-o", metavar="FILE", help="the file of one graph [default: to stdout]")
    parser.add_argument("-d", metavar="DIR", help="the folder of many graphs")
    arguments = parser.parse_args()
    first, _, last = arguments.seeds.partition("..")
    seeds = range(int(first), int(last or first) + 1)
    if len(seeds) > 1 and not arguments.d:
        sys.exit("several graphs need a folder: add `-d DIR`")
    steps = read_steps()
    for seed in seeds:
        text = graph(seed, steps)
        if arguments.d:
            folder = pathlib.Path(arguments.d)
            folder.mkdir(parents=True, exist_ok=True)
            (folder / f"{seed:04}.ron").write_text(text)
        elif arguments.o:
            pathlib.Path(arguments.o).write_text(text)
        else:
            print(text, end="")


if __name__ == "__main__":
    main()
