#!/usr/bin/env python3
"""Times Bulbfold beside Mandelbulber and a hand-written GLSL marcher on the same views, and writes a Markdown table.

  scripts/performance.py --scenes DIR [--runs 5] [--threads 2] [--only REGEX] [--results FILE] [--write docs/lab/comparison.md]

DIR holds Mandelbulber's settings (NAME.fract) for the views of benches/scenes/NAME.ron. What is not installed is left
out, and the table says so. The programs alternate, so that a slow moment of the machine hits each of them; the fastest
and the median of the runs are kept. "Without start-up" takes off what the same program needs for a picture of 8 x 6 pixels.
Results are merged into --results, so that long comparisons can be made scene by scene. Pillow and NumPy, where installed,
compare the pictures.
"""
import argparse
import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
SIZE = (640, 480)
TINY = (8, 6)

# Name; what Mandelbulber is told; how many times slower it is to be at least; the GLSL marcher of the same view; and as many
# iterations as the pixels of the view show.
CASES = [
    ("a_bulb8", "as it chooses", "delta_DE_method=0#delta_DE_function=0", 60, "bulb", 6),
    ("b_box2", "as it chooses", "delta_DE_method=0#delta_DE_function=0", 60, "box", 9),
    ("c_menger", "as it chooses", "delta_DE_method=0#delta_DE_function=0", 40, None, 6),
    ("d_boxm15_bulb8", "as it chooses", "delta_DE_method=0#delta_DE_function=0", 60, None, 4),
    ("d_boxm15_bulb8", "delta-DE", "delta_DE_method=1#delta_DE_function=2", 120, None, 4),
]
# Times of the GLSL marcher, and of our own WGSL on lavapipe, that the CPU is to be faster by at least.
GLSL_BAR, WGSL_BAR = 5, 2.5
# Draws of the GLSL marcher in a process, of which the fastest counts, as of the pictures of `bench`.
DRAWS = 16

START, END = "<!-- performance.py: from here -->", "<!-- performance.py: to here -->"


def run(command, environment=None):
    """Wall seconds, and what the program said."""
    start = time.perf_counter()
    done = subprocess.run(command, env=dict(os.environ, **(environment or {})), capture_output=True, text=True)
    seconds = time.perf_counter() - start
    if done.returncode != 0:
        sys.exit(f"{' '.join(command)} failed with {done.returncode}:\n{done.stdout}{done.stderr}")
    return seconds, done.stdout


class Bench:
    """The programs, and a folder for what they write."""

    def __init__(self, options):
        self.options = options
        self.folder = tempfile.mkdtemp(prefix="performance-")
        cpus = sorted(os.sched_getaffinity(0))[: options.threads]
        self.pin = ["taskset", "-c", ",".join(map(str, cpus))] if shutil.which("taskset") else []
        self.glsl = self.compile_glsl()
        self.has_mandelbulber = shutil.which("mandelbulber2") is not None and options.scenes is not None
        self.adapter = self.find_adapter()

    def path(self, name):
        return os.path.join(self.folder, name)

    def compile_glsl(self):
        compiler = shutil.which("cc")
        out = self.path("glsl")
        source = os.path.join(ROOT, "scripts", "glsl", "run.c")
        command = [compiler or "cc", "-O2", "-o", out, source, "-lEGL", "-lGLESv2"]
        return out if compiler and subprocess.run(command, capture_output=True).returncode == 0 else None

    def find_adapter(self):
        """Whether there is an adapter, of any kind."""
        command = [self.options.bulbfold, "render", "mandelbulb", "--size", "8x6", "--backend", "gpu", "-q", "-o",
                   self.path("probe.png")]
        return subprocess.run(command, capture_output=True).returncode == 0

    def mandelbulber(self, scene, settings, size, out):
        command = self.pin + [
            "mandelbulber2", "-n", "-C", "-r", f"{size[0]}x{size[1]}", "-f", "png", "-o", out, "-O",
            f"{settings}#limit_CPU_cores={self.options.threads}", os.path.join(self.options.scenes, scene + ".fract"),
        ]
        return run(command, {"QT_QPA_PLATFORM": "offscreen", "LC_ALL": "C"})[0]

    def bulbfold(self, scene, size, out, more=(), cache=None):
        """Wall seconds, and the program's own numbers. Without a cache the estimate is measured anew."""
        command = self.pin + [
            self.options.bulbfold, "render", os.path.join(ROOT, "benches", "scenes", scene + ".ron"), "--samples", "1",
            "--size", f"{size[0]}x{size[1]}", "--threads", str(self.options.threads), "--json", "-q", "--force", "-o", out, *more,
        ]
        seconds, text = run(command, {"BULBFOLD_CACHE": cache or tempfile.mkdtemp(dir=self.folder)})
        return seconds, json.loads(text)

    def again(self, scene, more=()):
        """Seconds of the fastest of several pictures that one process renders."""
        command = self.pin + [
            self.options.bulbfold, "bench", os.path.join(ROOT, "benches", "scenes", scene + ".ron"), "--backend", "cpu",
            "--precision", "f32", "--size", f"{SIZE[0]}x{SIZE[1]}", "--time", "0.5", "--json", "-q", *more,
        ]
        seconds = json.loads(run(command, {})[1])["fractals"][0]["picture_ns"] * 1e-9
        return seconds, None

    def shader(self, name, out):
        parts = [os.path.join(ROOT, "scripts", "glsl", part + ".frag") for part in (name, "march")]
        command = self.pin + [self.glsl, str(DRAWS), str(SIZE[0]), str(SIZE[1]), out, *parts]
        lines = run(command, {"LP_NUM_THREADS": str(self.options.threads)})[1].split("\n")
        return min(float(line) for line in lines[1:1 + DRAWS])

    def case(self, case):
        """Everything of one scene, program by program in turns."""
        scene, told, settings, bar, shader, fitting = case
        cache = self.path("cache-" + scene)
        cpu = ["--backend", "cpu"]
        fits = cpu + ["--set", f"max_iterations={fitting}"]
        kinds = {
            "bulbfold": lambda: self.bulbfold(scene, SIZE, self.path("bulbfold.png"), cpu, cache),
            "bulbfold first": lambda: self.bulbfold(scene, SIZE, self.path("first.png"), cpu),
            "bulbfold fitting": lambda: self.bulbfold(scene, SIZE, self.path("fitting.png"), fits, cache),
        }
        if self.adapter:
            gpu = ["--backend", "gpu"]
            kinds["bulbfold wgsl"] = lambda: self.bulbfold(scene, SIZE, self.path("wgsl.png"), gpu, cache)
        if self.glsl and shader:
            kinds["glsl"] = lambda: (self.shader(shader, self.path("glsl.ppm")), None)
            kinds["again"] = lambda: self.again(scene)
            kinds["again fitting"] = lambda: self.again(scene, fits[2:])
        if self.has_mandelbulber:
            kinds["mandelbulber"] = lambda: (self.mandelbulber(scene, settings, SIZE, self.path("mandelbulber.png")), None)
        runs = {kind: [] for kind in kinds}
        starts = {"bulbfold": [], "mandelbulber": []}
        # The first of each fills caches and is not counted.
        for kind in ("bulbfold", "bulbfold fitting", "bulbfold wgsl"):
            if kind in kinds:
                kinds[kind]()
        for _ in range(self.options.runs):
            for kind, measure in kinds.items():
                runs[kind].append(measure())
            starts["bulbfold"].append(self.bulbfold(scene, TINY, self.path("tiny.png"), cpu + ["--calibrate", "off"])[0])
            if self.has_mandelbulber:
                starts["mandelbulber"].append(self.mandelbulber(scene, settings, TINY, self.path("tiny.png")))
        result = {"scene": scene, "told": told, "bar": bar, "fitting_iterations": fitting, "threads": self.options.threads,
                  "runs": self.options.runs, "times": {}}
        for kind, all_runs in runs.items():
            of = "bulbfold" if kind.startswith("bulbfold") else kind
            walls = [seconds for seconds, _ in all_runs]
            start = min(starts.get(of) or [0.0])
            entry = {"wall": min(walls), "wall_median": statistics.median(walls), "start_up": start,
                     "net": min(walls) - start}
            said = [said for _, said in all_runs if said]
            if said:
                entry["render"] = min(one["render_seconds"] for one in said)
                entry["render_median"] = statistics.median(one["render_seconds"] for one in said)
                entry["calibration"] = min(one["calibration"]["seconds"] for one in said)
                last = said[-1]
                entry["method"] = " + ".join(orbit["method"] for orbit in last["orbits"])
                entry["estimates_per_pixel"] = last["estimates_per_pixel"]["primary"]
                entry["iterations_per_estimate"] = last["iterations_mean"]
            result["times"][kind] = entry
        result["pictures"] = self.compare(result["times"])
        return result

    def compare(self, times):
        """How far each picture's silhouette is the other program's: shared pixels over all pixels of either."""
        try:
            import numpy
            from PIL import Image
        except ImportError:
            return {}
        if "mandelbulber" not in times:
            return {}

        def silhouette(name):
            pixels = numpy.asarray(Image.open(self.path(name)).convert("RGB")).astype(int)
            return numpy.abs(pixels - pixels[0, 0]).max(axis=2) > 3

        other = silhouette("mandelbulber.png")
        overlaps = {}
        for kind, name in (("bulbfold", "bulbfold.png"), ("bulbfold fitting", "fitting.png"), ("glsl", "glsl.ppm")):
            if kind in times:
                own = silhouette(name)
                overlaps[kind] = float((own & other).sum() / max(1, (own | other).sum()))
        return overlaps


def ratio(slow, fast):
    return slow / fast if slow and fast and fast > 0 else None


def shown(value, digits=3):
    return "-" if value is None else f"{value:.{digits}f}"


def both(entry):
    """The fastest and the median run without start-up."""
    return f"{entry['net']:.3f} / {entry['wall_median'] - entry['start_up']:.3f}" if entry else "-"


def tables(results):
    """The Markdown of all results."""
    lines = [
        "| scene | Mandelbulber | its time | Bulbfold's time | ratio | wanted | first render | fitting iterations | ratio | overlap |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for one in results:
        times = one["times"]
        own, fits, first = (times.get(k, {}) for k in ("bulbfold", "bulbfold fitting", "bulbfold first"))
        other = times.get("mandelbulber", {}).get("net")
        nets = [of.get("net") for of in (own, fits, first)]
        overlap = " / ".join(shown(one["pictures"].get(k), 2) for k in ("bulbfold", "bulbfold fitting"))
        lines.append(
            f"| {one['scene']} | {one['told']} | {both(times.get('mandelbulber'))} | {both(own)} | {shown(ratio(other, nets[0]), 1)}"
            f" | {one['bar']} | {shown(nets[2])} | {both(fits)} ({one['fitting_iterations']})"
            f" | {shown(ratio(other, nets[1]), 1)} | {overlap} |"
        )
    lines += [
        "",
        "| scene | CPU | WGSL on this machine's adapter | ratio | wanted | CPU again | GLSL by hand | ratio | wanted"
        " | with fitting iterations | to the first picture |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for one in results:
        if one["told"] != "as it chooses":
            continue
        times = one["times"]
        own, fits = times["bulbfold"].get("render"), times["bulbfold fitting"].get("render")
        wgsl, glsl = times.get("bulbfold wgsl", {}).get("render"), times.get("glsl", {}).get("wall")
        again, fits_again = (times.get(kind, {}).get("wall") for kind in ("again", "again fitting"))
        lines.append(
            f"| {one['scene']} | {shown(own)} | {shown(wgsl)} | {shown(ratio(wgsl, own), 1)} | {WGSL_BAR} | {shown(again, 4)}"
            f" | {shown(glsl)} | {shown(ratio(glsl, again), 1)} | {GLSL_BAR if glsl else '-'}"
            f" | {shown(ratio(glsl, fits_again), 1)} | {shown(ratio(glsl, own), 1)} / {shown(ratio(glsl, fits), 1)} |"
        )
    lines += ["", "Where Bulbfold's own time goes, in seconds:", ""]
    lines += [
        "| scene | method | start-up | calibration, once | render | picture file and the rest | estimates a pixel | iterations an estimate |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for one in results:
        if one["told"] != "as it chooses":
            continue
        for kind in ("bulbfold", "bulbfold fitting"):
            own = one["times"][kind]
            first = one["times"]["bulbfold first"]
            name = one["scene"] + (f", {one['fitting_iterations']} iterations" if kind != "bulbfold" else "")
            calibration = shown(first.get("calibration")) if kind == "bulbfold" else "-"
            lines.append(
                f"| {name} | {own.get('method', '-')} | {shown(own['start_up'])} | {calibration} | {shown(own.get('render'))}"
                f" | {shown(max(0.0, own['net'] - own['render']))} | {shown(own.get('estimates_per_pixel'), 1)}"
                f" | {shown(own.get('iterations_per_estimate'), 2)} |"
            )
    return "\n".join(lines) + "\n"


def merge(path, new):
    """Results of a file in which the new ones replace older ones of the same scene, in the order of the cases."""
    known = {}
    if path and os.path.exists(path):
        with open(path) as file:
            known = {(one["scene"], one["told"]): one for one in json.load(file)}
    known.update({(one["scene"], one["told"]): one for one in new})
    results = [known[case[:2]] for case in CASES if case[:2] in known]
    if path:
        write(path, json.dumps(results, indent=1) + "\n")
    return results


def write(path, text):
    """Beside its place, then renamed."""
    with open(path + ".tmp", "w") as file:
        file.write(text)
    os.replace(path + ".tmp", path)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", metavar="DIR", help="folder of Mandelbulber's settings; without it Mandelbulber is left out")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--only", default="", metavar="REGEX", help='of "scene, what Mandelbulber is told"')
    parser.add_argument("--bulbfold", default=os.path.join(ROOT, "target", "release", "bulbfold"), metavar="PROGRAM")
    parser.add_argument("--results", metavar="FILE", help="JSON to merge the results into")
    parser.add_argument("--write", metavar="PAGE", help="Markdown page whose marked part is replaced by the tables")
    parser.add_argument("--keep", metavar="DIR", help="copy the pictures of each scene there")
    options = parser.parse_args()
    if options.runs < 1 or options.threads < 1:
        sys.exit("--runs and --threads must be at least 1")
    chosen = [case for case in CASES if re.search(options.only, f"{case[0]}, {case[1]}")]
    new = []
    bench = Bench(options) if chosen else None
    try:
        for case in chosen:
            print(f"{case[0]}, {case[1]}", file=sys.stderr)
            new.append(bench.case(case))
            if options.keep:
                target = os.path.join(options.keep, case[0] + "_" + case[1].replace(" ", "_"))
                shutil.copytree(bench.folder, target, dirs_exist_ok=True, ignore=shutil.ignore_patterns("cache*", "tmp*", "glsl"))
    finally:
        if bench:
            shutil.rmtree(bench.folder)
    text = tables(merge(options.results, new))
    print(text, end="")
    if options.write:
        with open(options.write) as file:
            page = file.read()
        if START not in page or END not in page:
            sys.exit(f"{options.write} has no lines {START} and {END}")
        before, rest = page.split(START, 1)
        write(options.write, before + START + "\n" + text + END + rest.split(END, 1)[1])


if __name__ == "__main__":
    main()
