#!/usr/bin/env python3
"""Pictures of imported settings beside those of Mandelbulber 2 itself: framing and shape, without light and colour.

  scripts/mandelbulber.py [--bulbfold PROGRAM] [--size 256x144] [--out DIR] FILE.fract ...

Each file is imported and rendered as black things in white fog, which shows coverage and depth; Mandelbulber renders the
file with its alpha and depth channels, its effects switched off. Printed for each file: the share of the picture that each
covers; the overlap of both silhouettes (pixels that both cover by those that either covers, and the same for the
background, the smaller of the two; - where one of the programs has less than 0.5 % of either); the share of common pixels
whose depths have the same rank to within 5 % of the picture (nan where fog cannot show them apart); and the seconds of both. DIR gets a picture of both depths for each file. Needs
NumPy, Pillow and mandelbulber2.
"""
import argparse
import os
import subprocess
import sys
import time

import numpy
from PIL import Image

TIME = 120
PLAIN = {
    "alpha_enabled": 1, "zbuffer_enabled": 1, "zbuffer_quality": 1, "append_alpha_png": 0, "shadows_enabled": 0, "ambient_occlusion_enabled": 0,
    "DOF_enabled": 0, "DOF_monte_carlo": 0, "DOF_MC_global_illumination": 0, "MC_soft_shadows_enable": 0,
    "volumetric_fog_enabled": 0, "basic_fog_enabled": 0, "iteration_fog_enable": 0, "raytraced_reflections": 0,
    "main_light_volumetric_enabled": 0, "antialiasing_enabled": 0, "stereo_enabled": 0, "glow_enabled": 0,
    "mat1_transparency_of_surface": 0, "image_proportion": 0, "fake_lights_enabled": 0, "random_lights_group": 0,
    "MC_global_illumination_volumetric": 0, "tiles": 1, "env_mapping_enable": 0, "clouds_enable": 0, "hdr_blur_enabled": 0,
    **{f"aux_light_volumetric_enabled_{i}": 0 for i in range(1, 5)},
}


def render(program, graph, size, picture, fog):
    """Our picture as black things in white fog: 255 is nothing, anything else the nearer the darker."""
    background = (0.9, 0.9, 0.9)
    look = f"look=(sun: (0, 0, 0), sky: (0, 0, 0), shadows: false, occlusion: 0, fog: {fog}, background: [{background}, {background}])"
    command = [program, "render", graph, "-o", picture, "--size", f"{size[0]}x{size[1]}", "--samples", "1", "--backend", "cpu", "--precision", "f64",
               "--set", look, "-q", "--force"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=TIME)
    if done.returncode != 0:
        raise RuntimeError(done.stderr.strip().splitlines()[0])
    return numpy.array(Image.open(picture).convert("RGB"), dtype=float)[:, :, 0]


def ours(program, source, size, folder, stem):
    """Depth codes of our pixels (large is far), infinite where there is nothing; or why not."""
    graph, picture = os.path.join(folder, stem + ".ron"), os.path.join(folder, "b_" + stem + ".png")
    done = subprocess.run([program, "import", source, "-o", graph, "--force"], capture_output=True, text=True)
    if done.returncode != 0:
        return None, "not imported"
    fog = 1.0
    try:
        # The fog that spreads depths over the shades: the half-way shade stands for the middle depth.
        for _ in range(12):
            shades = render(program, graph, size, picture, fog)
            covered = shades < 240.0
            middle = numpy.median(shades[covered]) if covered.any() else 120.0
            if 80.0 <= middle <= 190.0 or not 1e-6 < fog < 100.0:
                break
            fog = min(100.0, fog * (4.0 if middle < 80.0 else 0.4))
    except subprocess.TimeoutExpired:
        return None, f"ours took over {TIME} s"
    except RuntimeError as error:
        return None, f"not rendered: {error}"
    return numpy.where(covered, shades, numpy.inf), ""


def theirs(source, size, folder, stem):
    """Mandelbulber's coverage and depth code of each pixel (large is far)."""
    out = os.path.join(folder, "m_" + stem)
    command = ["mandelbulber2", "--nogui", "-C", "-f", "png", "-o", out, "-r", f"{size[0]}x{size[1]}",
               "-O", "#".join(f"{key}={value}" for key, value in PLAIN.items()), source]
    env = dict(os.environ, QT_QPA_PLATFORM="offscreen")
    try:
        subprocess.run(command, capture_output=True, timeout=TIME, env=env)
    except subprocess.TimeoutExpired:
        return None, None, f"Mandelbulber took over {TIME} s"
    try:
        alpha = numpy.array(Image.open(out + "_alpha.png").convert("L"), dtype=float)
        depth = numpy.array(Image.open(out + "_zbuffer.png").convert("I"), dtype=float)
    except FileNotFoundError as error:
        return None, None, f"Mandelbulber wrote no {error.filename}"
    return alpha > 127, depth, ""


def ranks(values):
    order = numpy.empty(len(values))
    order[numpy.argsort(values, kind="stable")] = numpy.linspace(0.0, 1.0, len(values))
    return order


def grey(depth, mask):
    picture = numpy.zeros(mask.shape)
    picture[mask] = 255.0 * (1.0 - 0.85 * ranks(depth[mask]))
    return Image.fromarray(picture.astype(numpy.uint8))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bulbfold", default="target/release/bulbfold")
    parser.add_argument("--size", default="256x144")
    parser.add_argument("--out", default="mandelbulber")
    parser.add_argument("files", nargs="+")
    arguments = parser.parse_args()
    size = tuple(int(n) for n in arguments.size.split("x"))
    os.makedirs(arguments.out, exist_ok=True)
    print("| file | ours covers | theirs | overlap | depth | seconds |\n|---|---|---|---|---|---|")
    for source in arguments.files:
        stem = os.path.splitext(os.path.basename(source))[0].replace(" ", "_")
        start = time.time()
        depth, error = ours(arguments.bulbfold, source, size, arguments.out, stem)
        middle = time.time()
        if depth is None:
            print(f"| {stem} | {error} |", flush=True)
            continue
        mask, code, error = theirs(source, size, arguments.out, stem)
        if mask is None:
            print(f"| {stem} | {error} |", flush=True)
            continue
        own = numpy.isfinite(depth)
        covered = (own.mean(), mask.mean())
        overlaps = [(a & b).sum() / max(1, (a | b).sum()) for a, b in ((own, mask), (~own, ~mask))
                    if max(a.mean(), b.mean()) >= 0.005]
        both = own & mask
        agree = float("nan")
        # Where all is far nearer than fog can show, ranks say nothing.
        if both.sum() > 100 and numpy.ptp(numpy.percentile(depth[both], [10, 90])) >= 20.0:
            agree = (abs(ranks(depth[both]) - ranks(code[both])) < 0.05).mean()
        Image.fromarray(numpy.hstack([grey(depth, own), grey(code, mask)])).save(os.path.join(arguments.out, stem + ".png"))
        print(f"| {stem} | {covered[0]:.1%} | {covered[1]:.1%} | {min(overlaps):.3f} | {agree:.3f} "
              f"| {middle - start:.0f} + {time.time() - middle:.0f} |", flush=True)


if __name__ == "__main__":
    sys.exit(main())
