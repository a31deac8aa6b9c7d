#!/usr/bin/env python3
"""Measures methods between the lights of a 302-light stage, on simulated subjects, against the simulator's truth.

    tests/bench/off_grid_quality.py build/release/lightstage OUT [--mesh FILE ...] [--procedural SEED ...] [--size 256] [--noise]

OUT is a store that is made once and used again. linear is measured with the s that the program chooses and with half, twice and four
times that, and its best is taken. Prints the mean of every method over the subjects; errors are of display-encoded values over the mask.
"""

import argparse
import json
import math
import pathlib
import subprocess

LIGHTS = 302


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--mesh", nargs="*", default=[])
    parser.add_argument("--procedural", nargs="*", default=[])
    parser.add_argument("--size", default="256")
    parser.add_argument("--directions", default="40")
    parser.add_argument("--noise", action="store_true")
    parser.add_argument("--model", default="blend")
    options = parser.parse_args()

    def run(*arguments):
        command = [options.program, *arguments, "--store", str(options.out), "--json"]
        return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)

    stage = options.out.with_suffix(".toml")
    if not options.out.exists():
        run("init")
        run("stage", "--layout", "geodesic", "--lights", str(LIGHTS), "--out", str(stage))
    known = {scan["name"] for scan in run("store", "ls")["scans"]}

    subjects = [(pathlib.Path(mesh).stem, ["--mesh", mesh]) for mesh in options.mesh]
    subjects += [(f"procedural_{seed}", ["--procedural", seed]) for seed in options.procedural]
    totals = {}
    for index, (name, subject) in enumerate(subjects):
        scan = f"{name}-{options.size}{'-noise' if options.noise else ''}"
        if scan not in known:
            run("capture", "--sim", *subject, "--stage", str(stage), "--size", options.size, "--name", scan, "--no-motion",
                "--tracking-every", "0", "--yaw", str([-25, 0, 20, 35][index % 4]), *([] if options.noise else ["--no-noise"]))

        def evaluate(*arguments):
            return run("evaluate", scan, "--off-grid", "--directions", options.directions, *arguments)["methods"]

        spacing = math.sqrt(4 * math.pi / LIGHTS / 0.91)  # about; only the best of several s is taken
        rows = evaluate("--method", "nearest,barycentric,rbf,bspline,blend", "--model", options.model)
        tried = [evaluate("--method", "linear", "--sharpness", str(f * 2 / spacing**2))[0] for f in (0.5, 1, 2, 4)]
        rows.append(min(tried, key=lambda row: row["rmse"]))
        for row in rows:
            print(f"{scan:24} {row['name']:11} RMSE {row['rmse']:.4f}  H1 {row['h1']:.4f}  DSSIM {row['dssim']:.4f}  FLIP {row['flip']:.4f}", flush=True)
            totals.setdefault(row["name"], []).append(row)

    print(f"\nmean of {len(subjects)} subjects")
    means = {name: {key: sum(row[key] for row in rows) / len(rows) for key in ("rmse", "h1", "dssim", "flip", "seconds_per_image")}
             for name, rows in totals.items()}
    for name, mean in means.items():
        ratio = "  ".join(f"{100 * (means['blend'][key] / mean[key] - 1):+.0f} %" for key in ("rmse", "h1", "dssim", "flip"))
        print(f"{name:11} RMSE {mean['rmse']:.4f}  H1 {mean['h1']:.4f}  DSSIM {mean['dssim']:.4f}  FLIP {mean['flip']:.4f}"
              f"  {mean['seconds_per_image']:.3f} s   blend to this: {ratio}")


if __name__ == "__main__":
    main()
