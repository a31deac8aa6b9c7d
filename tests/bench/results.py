#!/usr/bin/env python3
"""Ranks every method between the lights of simulated stages and on photographs, and writes the tables of docs/results.md.

    tests/bench/results.py build/release/lightstage OUT [--mesh FILE ...] [--procedural SEED ...] [--photographs STORE SCAN:EVERY ...]
                           [--model ROW=FILE ...] [--directions 40] [--every 16] [--size 256] > docs/results.md

OUT is a folder that is made once and used again: a store of the simulated subjects, and one file for each scan, protocol and method,
so that an interrupted run goes on, and a method that is new is measured without the others. Delete its files to measure anew.
Networks other than blend are measured where a file is given: ROW is the method's name, or another name for an ablation of it. linear is measured with four values of s besides its own, and its best is
a row of its own.
"""

import argparse
import collections
import datetime
import json
import math
import os
import pathlib
import subprocess
import sys

LIGHTS = 302
YAWS = [-25, 0, 20, 35]
SPACING = math.sqrt(4 * math.pi / LIGHTS / 0.91)  # about, radians
MEASURES = ["rmse", "h1", "dssim", "msssim", "gmsd", "flip"]
HEADINGS = ["RMSE", "H1", "DSSIM", "MS-SSIM", "GMSD", "FLIP"]
OWN_MODEL = ["blend"]  # networks whose weights come with the program


def mean(rows, key):
    """Over the images of several scans: of squares for what is itself a root of a mean."""
    weight = sum(row["images"] for row in rows)
    if key in ("rmse", "h1"):
        return math.sqrt(sum(row["images"] * row[key] ** 2 for row in rows) / weight)
    return sum(row["images"] * row[key] for row in rows) / weight


def by_angle(rows):
    """[(from, to, images, rmse)] over the images of several scans."""
    squares, images, ends = collections.Counter(), collections.Counter(), {}
    for row in rows:
        for bin_ in row["by_angle"]:
            ends[bin_["from_deg"]] = bin_["to_deg"]
            if bin_["images"]:
                images[bin_["from_deg"]] += bin_["images"]
                squares[bin_["from_deg"]] += bin_["images"] * bin_["rmse"] ** 2
    return {start: (end, images[start], math.sqrt(squares[start] / images[start])) for start, end in sorted(ends.items()) if images[start]}


def origin_in_words(model):
    """What a network is and what it was trained on, from what `model show` prints."""
    configuration, origin = model["configuration"], model["provenance"]
    words = f"{configuration['architecture']}, {model['parameters']:,} parameters"
    if configuration["pooling"] != "alias_free":
        words += f", {configuration['pooling']} pooling"
    words += f", {origin['steps']:,} steps of crops of {origin['crop']} pixels"
    data = origin.get("data")
    if isinstance(data, dict):
        return words + ", on simulated views with the truth between the lights"
    return words + f", on captured scans, active set {origin['active_set']}"


class Program:
    def __init__(self, path, out, models):
        self.path, self.out = path, out
        self.models = models  # row -> file
        shown = {row: self.json(None, "model", "show", file) for row, file in models.items()}
        self.origin = {row: origin_in_words(model) for row, model in shown.items()}
        self.method_of = {row: model["configuration"]["architecture"] for row, model in shown.items()}

    def json(self, store, *arguments):
        where = ["--store", str(store)] if store else []
        run = subprocess.run([self.path, *arguments, *where, "--json"], stdout=subprocess.PIPE, check=True)
        return json.loads(run.stdout)

    def judged(self, store, scan, protocol, rows, *options):
        """A result for each row of the table, measured or remembered."""
        kept = {row: self.out / ("-".join([scan, *protocol, row, *options]).replace("--", "") + ".json") for row in rows}
        missing = [row for row in rows if not kept[row].exists()]
        # By one command what goes into one: a method stands there once.
        ablations = [row for row in missing if self.method_of.get(row, row) != row]
        for together in [[row for row in missing if row not in ablations], *([row] for row in ablations)]:
            if not together:
                continue
            print(scan, *protocol, ",".join(together), *options, file=sys.stderr, flush=True)
            models = ",".join(self.models[row] for row in together if row in self.models)
            methods = {self.method_of.get(row, row): row for row in together}
            report = self.json(store, "evaluate", scan, *protocol, "--method", ",".join(methods), *options, *(["--model", models] if models else []))
            for result in report["methods"]:
                file = kept[methods[result["name"]]]
                unfinished = file.with_suffix(".new")
                unfinished.write_text(json.dumps(result))
                unfinished.rename(file)
        return {row: json.loads(file.read_text()) for row, file in kept.items()}


def capture_subjects(program, store, options):
    if not store.exists():
        program.json(store, "init")
    stage = options.out / "stage.toml"
    if not stage.exists():
        program.json(store, "stage", "--layout", "geodesic", "--lights", str(LIGHTS), "--out", str(stage))
    known = {scan["name"] for scan in program.json(store, "store", "ls")["scans"]}
    subjects = [(pathlib.Path(mesh).stem, ["--mesh", mesh]) for mesh in options.mesh]
    subjects += [("procedural_" + seed, ["--procedural", seed]) for seed in options.procedural]
    for index, (name, subject) in enumerate(subjects):
        if name not in known:
            program.json(store, "capture", "--sim", *subject, "--stage", str(stage), "--size", options.size, "--name", name, "--no-motion",
                         "--no-noise", "--tracking-every", "0", "--yaw", str(YAWS[index % len(YAWS)]))
    return [name for name, _ in subjects]


def table(headings, rows):
    lines = ["| " + " | ".join(headings) + " |", "| --- |" + " ---: |" * (len(headings) - 1)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows]) + "\n"


def write_set(title, rows_of):
    """rows_of: method -> rows of its scans."""
    print(f"\n## {title}\n")
    best = {key: (max if key == "msssim" else min)(mean(rows, key) for rows in rows_of.values()) for key in MEASURES}
    cells = []
    for method, rows in rows_of.items():
        values = [mean(rows, key) for key in MEASURES]
        marked = [f"**{value:.4f}**" if value == best[key] else f"{value:.4f}" for key, value in zip(MEASURES, values)]
        peaks = [row["peak_rss_bytes"] for row in rows if row["peak_rss_bytes"]]
        cells.append([method, str(sum(row["images"] for row in rows)), *marked, f"{mean(rows, 'seconds_per_image'):.4f}",
                      f"{max(peaks) / 2**20:.0f}" if peaks else ""])
    print(table(["method", "images", *HEADINGS, "s/image", "peak MiB"], cells))
    angles = {method: by_angle(rows) for method, rows in rows_of.items()}
    bins = sorted({(start, end) for bins in angles.values() for start, (end, _, _) in bins.items()}, key=lambda bin_: bin_[0])
    if len(bins) < 2:
        return
    any_method = next(iter(angles.values()))
    print("RMSE against the angle to the nearest captured light that a method was given:\n")
    heading = [f"{start:g}–{end:g}°" if end else f"from {start:g}°" for start, end in bins]
    print(table(["method", *(f"{text} ({any_method[start][1]})" for text, (start, _) in zip(heading, bins))],
                [[method, *(f"{found[start][2]:.4f}" for start, _ in bins)] for method, found in angles.items()]))


def version(program):
    return subprocess.run([program, "--version"], stdout=subprocess.PIPE, text=True, check=True).stdout.strip()


def machine():
    with open("/proc/cpuinfo", encoding="utf-8") as file:
        names = [line.split(":", 1)[1].strip() for line in file if line.startswith("model name")]
    return f"{names[0] if names else 'unknown processor'}, {len(os.sched_getaffinity(0))} cores"


def command():
    """As it was given, without the folders of files."""
    return " ".join(["tests/bench/results.py", *("=".join(os.path.basename(part) for part in word.split("=")) for word in sys.argv[1:])])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--mesh", nargs="*", default=[])
    parser.add_argument("--procedural", nargs="*", default=[])
    parser.add_argument("--photographs", nargs="*", default=[], metavar="STORE SCAN:EVERY ...")
    parser.add_argument("--model", nargs="*", default=[], metavar="ROW=FILE")
    parser.add_argument("--size", default="256")
    parser.add_argument("--directions", default="40")
    parser.add_argument("--every", default="16")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    models = dict(entry.split("=", 1) for entry in options.model)
    program = Program(options.program, options.out, models)
    store = options.out / "store"
    subjects = capture_subjects(program, store, options)

    methods = []
    for info in program.json(store, "methods")["methods"]:
        needs_model = any(knob["option"] == "--model" for knob in info["knobs"]) and info["name"] not in OWN_MODEL
        if not needs_model or info["name"] in models:
            methods.append(info["name"])
            methods += [row for row in models if row != info["name"] and program.method_of[row] == info["name"]]

    def measure(where, scans, protocol):
        """method -> a row for each scan."""
        judged = [program.judged(where, scan, protocol, methods) for scan in scans]
        tried = [[program.judged(where, scan, protocol, ["linear"], "--sharpness", f"{factor * 2 / SPACING**2:.4g}")["linear"] for scan in scans]
                 for factor in (0.25, 0.5, 2, 4)]
        rows_of = {}
        for method in methods:
            rows_of[method] = [rows[method] for rows in judged]
            if method == "linear":
                rows_of["linear, best s"] = min([rows_of["linear"], *tried], key=lambda rows: mean(rows, "rmse"))
        return rows_of

    off_grid = ["--off-grid", "--directions", options.directions]
    sets = []
    if subjects:
        of_subjects = f"{len(subjects)} simulated subjects, {LIGHTS} lights, {options.size} pixels"
        sets.append((f"Between the lights: {of_subjects}, `--off-grid --directions {options.directions}`", measure(store, subjects, off_grid)))
        sets.append((f"Lights left out: {of_subjects}, `--held-out --every {options.every}`",
                     measure(store, subjects, ["--held-out", "--every", options.every])))
    for entry in options.photographs[1:]:
        scan, every = entry.rsplit(":", 1)
        sets.append((f"Photographs: {scan}, `--held-out --every {every}`",
                     measure(options.photographs[0], [scan], ["--held-out", "--every", every])))

    print("# Methods, ranked\n")
    print(f"Written by `tests/bench/results.py` on {datetime.date.today()}, {version(options.program)}, {machine()}.\n"
          "Errors are of display-encoded values over the mask; lower is better, but for MS-SSIM; the best of each column is bold. Times are of one image\n"
          "after the method was fitted, with all cores; the peak is the process's, with the scan in memory. Subjects and photographs were never trained on.\n")
    print(f"    {command()}")
    if models:
        print("\nNetworks that do not come with the program (`lightstage train`):\n")
        for row in models:
            print(f"- {row}: {program.origin[row]}")
    for title, rows_of in sets:
        write_set(title, rows_of)


if __name__ == "__main__":
    main()
