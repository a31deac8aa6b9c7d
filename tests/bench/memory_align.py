#!/usr/bin/env python3
"""Measures that the memory which `align` takes does not grow with the number of frames.

    tests/bench/memory_align.py build/release/lightstage OUT [--size 128] [--lights 60 240 960]

OUT is a folder for the store, made once and used again. For each number of lights a simulated head is captured with a tracking frame every
tenth, and aligned; prints the largest resident size of each, and fails where the longest pass took a tenth more than the shortest.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--size", type=int, default=128)
    parser.add_argument("--lights", type=int, nargs="+", default=[60, 240, 960])
    options = parser.parse_args()
    store = options.out / "store"

    def command(*arguments):
        return [options.program, *map(str, arguments), "--store", str(store), "--json", "--quiet"]

    def run(*arguments):
        return json.loads(subprocess.run(command(*arguments), check=True, stdout=subprocess.PIPE).stdout)

    options.out.mkdir(parents=True, exist_ok=True)
    if not store.exists():
        run("init")
    known = {entry["name"] for entry in run("store", "ls")["scans"]}
    peaks = []
    for lights in options.lights:
        scan = f"head-{lights}-{options.size}"
        if scan not in known:
            stage = options.out / f"stage-{lights}.toml"
            run("stage", "--layout", "fibonacci", "--lights", lights, "--out", stage)
            run("capture", "--sim", "--procedural", 1, "--stage", stage, "--size", options.size, "--name", scan)
        process = subprocess.Popen(command("align", scan), stdout=subprocess.PIPE)
        report = json.loads(process.stdout.read())
        _, status, usage = os.wait4(process.pid, 0)
        if status != 0:
            sys.exit(f"align failed: {status}")
        peaks.append(usage.ru_maxrss / 1024)
        held = lights * options.size * options.size * 3 * 4 / 2**20
        print(f"{lights} lights, {report['aligned']} frames aligned: {peaks[-1]:.0f} MiB (the frames themselves: {held:.0f} MiB)")
    if peaks[-1] > 1.1 * peaks[0]:
        sys.exit("memory grows with the number of frames")


if __name__ == "__main__":
    main()
