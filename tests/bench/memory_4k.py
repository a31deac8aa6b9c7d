#!/usr/bin/env python3
"""Measures the memory that `superres` takes on a scan of 4096 x 4096 pixels with the published network (preset paper, k = 8).

    tests/bench/memory_4k.py build/release/lightstage OUT [--size 4096] [--queries 2] [-- OPTION ...]

OUT is a folder for the store and the pictures (1 GB), made once and used again; weights are at random. Options after -- go to `superres`.
Prints the largest resident size and the time a picture, and fails where the size is above 2.5 GiB.
"""

import argparse
import json
import math
import os
import pathlib
import random
import subprocess
import sys

LIGHTS = 12
LIMIT_MIB = 2560


def picture_rows(size, direction, dice):
    """A lit ball before a backdrop, with grain: rows of RGB bytes."""
    grain = [dice.randbytes(size * 3) for _ in range(16)]
    quieter = bytes(b >> 5 for b in range(256))
    for y in range(size):
        v = 1 - 2 * (y + 0.5) / size
        half = math.sqrt(max(0, 1 - v * v)) * size / 2
        left, right = int(size / 2 - half), int(size / 2 + half)
        shade = max(0, v * direction[1] + 0.5 * direction[2] + 0.3)
        colour = [int(30 + 180 * min(1, shade) * c) for c in (1, 0.8, 0.7)]
        row = bytearray(bytes((20, 22, 25)) * left + bytes(colour) * (right - left) + bytes((20, 22, 25)) * (size - right))
        noise = grain[y % 16].translate(quieter)
        yield (int.from_bytes(row, "little") + int.from_bytes(noise, "little")).to_bytes(3 * size, "little")


def make_pictures(folder, size):
    folder.mkdir(parents=True)
    dice = random.Random(1)
    lines = []
    for light in range(LIGHTS):
        z = (light + 0.5) / LIGHTS
        turn = light * math.pi * (3 - math.sqrt(5))
        direction = (math.sqrt(1 - z * z) * math.cos(turn), math.sqrt(1 - z * z) * math.sin(turn), z)
        with open(folder / f"{light}.ppm", "wb") as file:
            file.write(b"P6 %d %d 255\n" % (size, size))
            for row in picture_rows(size, direction, dice):
                file.write(row)
        lines.append(f"{light}.ppm {direction[0]:.6f} {direction[1]:.6f} {direction[2]:.6f}\n")
    (folder / "large.lp").write_text(f"{LIGHTS}\n" + "".join(lines))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--size", type=int, default=4096)
    parser.add_argument("--queries", type=int, default=2)
    parser.add_argument("options", nargs="*")
    options = parser.parse_args()
    store, model = options.out / "store", options.out / "random.safetensors"

    def command(*arguments):
        return [options.program, *map(str, arguments), "--store", str(store), "--json"]

    def run(*arguments):
        return json.loads(subprocess.run(command(*arguments), check=True, stdout=subprocess.PIPE).stdout)

    options.out.mkdir(parents=True, exist_ok=True)
    if not store.exists():
        run("init")
        stage = options.out / "stage.toml"
        run("stage", "--layout", "geodesic", "--lights", 42, "--out", stage)
        run("capture", "--sim", "--procedural", 1, "--stage", stage, "--size", 128, "--name", "small", "--no-motion")
    if not model.exists():
        run("train", "small", "--preset", "paper", "--steps", 1, "--crop", 128, "--out", model)
    scan = f"large-{options.size}"
    known = {entry["name"] for entry in run("store", "ls")["scans"]}
    if scan not in known:
        make_pictures(options.out / scan, options.size)
        run("import", "lp", options.out / scan / "large.lp", "--name", scan)

    number = sum(name.startswith(scan) for name in known)
    superres = command("superres", scan, "--method", "superres", "--model", model, "--lights", options.queries, "--out",
                       f"{scan}-dense-{number}", *options.options)
    process = subprocess.Popen(superres, stdout=subprocess.PIPE)
    result = json.loads(process.stdout.read())
    _, status, usage = os.wait4(process.pid, 0)
    if status != 0:
        sys.exit(f"superres failed: {status}")
    peak_mib = usage.ru_maxrss / 1024
    print(f"{options.size} x {options.size}: {peak_mib:.0f} MiB of {LIMIT_MIB} at most, {result['seconds_per_image']:.1f} s a picture")
    if peak_mib > LIMIT_MIB:
        sys.exit(1)


if __name__ == "__main__":
    main()
