#!/usr/bin/env python3
"""Depths by the usual rule and by Bulbfold's march, against brute force, on random rays of the timing scenes.

  scripts/depth.py [--rays 900] [--bulbfold PROGRAM]

The usual rule, Mandelbulber's and that of most shaders, stops where the estimate falls below a pixel's width at that
distance; here it is marched in f64 with whole steps. `bulbfold truth` walks the same rays without any estimate to where
orbits stay in for all iterations. Errors are in footprints (pixel diameters), negative where a march stops in front. Also
counted: estimates and iterations a ray. Needs NumPy.
"""
import argparse
import json
import os
import subprocess
import tempfile

import numpy

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
WIDTH, HEIGHT, ITERATIONS, FAR = 640, 480, 20, 50.0


def bulb(p):
    """Estimates of the power-8 Mandelbulb, bailout 10, and the iterations that all of them took."""
    z, dr, done = p.copy(), numpy.ones(len(p)), 0
    for _ in range(ITERATIONS):
        i = numpy.flatnonzero(numpy.linalg.norm(z, axis=1) <= 10.0)
        if len(i) == 0:
            break
        done += len(i)
        r = numpy.linalg.norm(z[i], axis=1)
        theta, phi = numpy.arcsin(z[i, 2] / r) * 8.0, numpy.arctan2(z[i, 1], z[i, 0]) * 8.0
        turned = numpy.stack([numpy.cos(theta) * numpy.cos(phi), numpy.cos(theta) * numpy.sin(phi), numpy.sin(theta)], 1)
        dr[i] = 8.0 * r**7 * dr[i] + 1.0
        z[i] = (r**8)[:, None] * turned + p[i]
    r = numpy.linalg.norm(z, axis=1)
    return 0.5 * numpy.log(r) * r / dr, done


def box(p):
    """Estimates of the Mandelbox of scale 2, bailout 100, and the iterations that all of them took."""
    z, dr, done = p.copy(), numpy.ones(len(p)), 0
    for _ in range(ITERATIONS):
        i = numpy.flatnonzero(numpy.linalg.norm(z, axis=1) <= 100.0)
        if len(i) == 0:
            break
        done += len(i)
        folded = numpy.clip(z[i], -1.0, 1.0) * 2.0 - z[i]
        r_sq = (folded**2).sum(1)
        scale = 2.0 / numpy.clip(r_sq, 0.25, 1.0)
        z[i] = folded * scale[:, None] + p[i]
        dr[i] = dr[i] * scale + 1.0
    return numpy.linalg.norm(z, axis=1) / dr, done


SCENES = [("a_bulb8", [1.2, -2.4, 1.2], bulb), ("b_box2", [9.6, -18.0, 9.4], box)]


def directions(eye, count):
    """Unit directions of rays evenly over the picture."""
    random = numpy.random.default_rng(1)
    forward = -eye / numpy.linalg.norm(eye)
    right = numpy.cross(forward, [0.0, 0.0, 1.0])
    right /= numpy.linalg.norm(right)
    up = numpy.cross(right, forward)
    x, y = random.uniform(-0.5, 0.5, (2, count, 1))
    d = forward + right * x * WIDTH / HEIGHT + up * y
    return d / numpy.linalg.norm(d, axis=1, keepdims=True)


def usual_rule(eye, d, estimate):
    """Depths (NaN for misses), estimates and iterations."""
    t, depths = numpy.zeros(len(d)), numpy.full(len(d), numpy.nan)
    running, estimates, iterations = numpy.arange(len(d)), 0, 0
    for _ in range(2000):
        if len(running) == 0:
            break
        de, done = estimate(eye + d[running] * t[running, None])
        estimates, iterations = estimates + len(running), iterations + done
        hit = de < t[running] / HEIGHT
        depths[running[hit]] = t[running[hit]]
        running, de = running[~hit], de[~hit]
        t[running] += de
        running = running[t[running] <= FAR]
    return depths, estimates, iterations


def truth(program, scene, eye, d):
    """For each ray: where brute force hits (NaN for misses), and where the march did; estimates and iterations of the march."""
    with tempfile.TemporaryDirectory() as folder:
        listed = os.path.join(folder, "rays.csv")
        with open(listed, "w") as file:
            file.writelines(",".join(f"{x:.17g}" for x in (*eye, *ray)) + "\n" for ray in d)
        command = [program, "truth", os.path.join(ROOT, "benches", "scenes", scene + ".ron"), "--rays-file", listed, "--json",
                   "--size", f"{WIDTH}x{HEIGHT}"]
        lines = subprocess.run(command, capture_output=True, text=True)
        # 1 is an answer, too: the budget is not kept.
        if lines.returncode not in (0, 1):
            raise SystemExit(lines.stderr)
        lines = lines.stdout.splitlines()
    rays = [ray for ray in map(json.loads, lines) if "summary" not in ray]
    depth = lambda ray, key: numpy.nan if ray.get(key) is None else ray[key]
    true = numpy.array([ray["t"] if ray["truth"] == "hit" else numpy.nan for ray in rays])
    marched = numpy.array([depth(ray, "march") for ray in rays])
    return true, marched, sum(ray["estimates"] for ray in rays), sum(ray["iterations"] for ray in rays)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rays", type=int, default=900)
    parser.add_argument("--bulbfold", default=os.path.join(ROOT, "target", "release", "bulbfold"), metavar="PROGRAM")
    options = parser.parse_args()
    print("| scene | march | hits | more than 2 behind or lost | more than 2 in front | median error | estimates a ray | iterations a ray |")
    print("|---|---|---|---|---|---|---|---|")
    for scene, eye, estimate in SCENES:
        eye = numpy.array(eye)
        d = directions(eye, options.rays)
        true, *own = truth(options.bulbfold, scene, eye, d)
        hits = ~numpy.isnan(true)
        for name, (depths, estimates, iterations) in (("usual rule", usual_rule(eye, d, estimate)), ("Bulbfold", own)):
            errors = (depths[hits] - true[hits]) / (true[hits] / HEIGHT)
            errors[numpy.isnan(errors)] = numpy.inf
            shares = [100.0 * numpy.mean(errors > 2.0), 100.0 * numpy.mean(errors < -2.0)]
            print(f"| {scene} | {name} | {hits.sum()} | {shares[0]:.1f} % | {shares[1]:.1f} % | {numpy.median(errors):.2f}"
                  f" | {estimates / len(d):.1f} | {iterations / len(d):.0f} |")


if __name__ == "__main__":
    main()
