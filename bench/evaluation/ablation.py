#!/usr/bin/env python3
"""What each choice in a tracker is worth: variants of one option each, by asterism-eval, against the tracker itself.

    bench/evaluation/ablation.py dpt|dpt_plus EVAL DATASET OUT [OPTION...]

EVAL is the program asterism-eval; what OUT has is not run again; further options go to `asterism-eval run`, such as
--starts 5 --workers 2. Prints a table in Markdown: EAO, accuracy A, failures F (mean over the starts), average overlap AO of one
pass, and the difference of AO to the first row with its 95 % interval of a paired bootstrap over sequences and starts.
"""

import csv
import json
import subprocess
import sys
from pathlib import Path


def filters(**options):
    """DPT with a Kcf of these options as root and parts."""
    model = {"model": "kcf", **options}
    return {"coarse": {"root": model}, "part": model}


def plus(**changes):
    return ("dpt_plus", changes)


def prior(foreground):
    """DPT with this prior of the foreground."""
    return {"coarse": {"color": {"foreground_prior": foreground}}}


# A random field that comes to its end, and an even prior with it.
CONVERGED = {"mrf": {"max_iterations": 50}}
EVEN_CONVERGED = {"foreground_prior": 0.5, **CONVERGED}

# What makes dpt_plus of dpt.
SCALE = {"scale_share": 0.25, "scale": {"scales": 17, "step": 1.04, "label_sigma": 0.17}}
MOTION = {"motion_share": 0.45}


def grown(coarse=None, **changes):
    """DPT with the root of dpt_plus and the prior that goes with it, and more."""
    return {"coarse": {"root": {"model": "spatial_reliability", "color_channels": True},
                       "color": {"foreground_prior": 0.375}, **(coarse or {})}, **changes}


# Of each tracker: the name of a row, a tracker's name, and its options.
VARIANTS = {
    "dpt": {
        "dpt": ("dpt", {}),
        "local links": ("dpt_loc", {}),
        "star of links": ("dpt_str", {}),
        "3 x 3 overlapping parts": ("dpt_3x3_ov", {}),
        "3 x 3 small parts": ("dpt_3x3_nov", {}),
        "coarse layer alone": ("dpt_crs", {}),
        "coarse layer alone, prior 1/2, MRF until it converges":
            ("dpt_crs", {"color": EVEN_CONVERGED}),
        "root filter alone": ("dpt_crs_nos", {}),
        "KCF": ("kcf", {}),
        "no color": ("dpt", {"coarse": {"use_color": False}}),
        "no MRF": ("dpt", {"coarse": {"color": {"mrf": {"enabled": False}}}}),
        "MRF until it converges": ("dpt", {"coarse": {"color": CONVERGED}}),
        "foreground prior 0.15": ("dpt", prior(0.15)),
        "foreground prior 0.25": ("dpt", prior(0.25)),
        "foreground prior 3/8": ("dpt", prior(0.375)),
        "foreground prior 1/2": ("dpt", prior(0.5)),
        "foreground prior 1/2, MRF until it converges":
            ("dpt", {"coarse": {"color": EVEN_CONVERGED}}),
        "no response gate": ("dpt", {"response_gate": 0}),
        "no mask gate": ("dpt", {"mask_gate": 0}),
        "Euclidean transform": ("dpt", {"transform": "euclidean"}),
        "proportional windows": ("dpt", filters(proportional_window=True)),
        "root's window padded by 2": ("dpt", {"coarse": {"root": {"model": "kcf", "padding": 2}}}),
        "parts' windows padded by 1": ("dpt", {"part": {"model": "kcf", "padding": 1}}),
        "parts' windows padded by 2": ("dpt", {"part": {"model": "kcf", "padding": 2}}),
        "A updated as a whole": ("dpt", filters(separate_update=False)),
        "no sub-pixel peak": ("dpt", {
            "coarse": {"root": {"model": "kcf", "sub_pixel": False}, "sub_pixel": False},
            "part": {"model": "kcf", "sub_pixel": False}}),
        "linear kernel": ("dpt", filters(kernel={"type": "linear"})),
        "smaller templates": ("dpt", {
            "coarse": {"root": {"model": "kcf", "min_template_side": 32, "max_template_side": 48}},
            "part": {"model": "kcf", "min_template_side": 25, "max_template_side": 40}}),
        "larger templates": ("dpt", filters(max_template_side=80)),
        "5 iterations of IDA": ("dpt", {"solver": {"max_iterations": 5}}),
        "anchors by covariance": ("dpt", {"anchor_law": "covariance"}),
        "Newton": ("dpt", {"solver": "newton"}),
    },
    # First what is added to dpt, one after the other, then what dpt_plus loses without each, then what it could have.
    "dpt_plus": {
        "dpt_plus": plus(),
        "dpt, foreground prior 3/8": ("dpt", prior(0.375)),
        "+ root SpatialReliability": ("dpt", grown()),
        "+ scale filter": ("dpt", grown(**SCALE)),
        "+ motion": ("dpt", grown(coarse=MOTION, **SCALE)),
        "without the root's filter": plus(coarse={"root": "kcf"}),
        "without color": plus(coarse={"use_color": False}),
        "without motion": plus(coarse={"motion_share": 0}),
        "motion 0.6": plus(coarse={"motion_share": 0.6}),
        "resized parts": plus(resize_parts=True),
    },
}


def main():
    if len(sys.argv) < 5 or sys.argv[1] not in VARIANTS:
        sys.exit(__doc__)
    kind, program, dataset, out = sys.argv[1:5]
    variants = VARIANTS[kind]
    identifiers = {name: "".join(c if c.isalnum() else "-" for c in name) for name in variants}
    command = [program, "run", dataset, "--out", out, "--boxes", "--overlap", "exact", *sys.argv[5:]]
    for name, (tracker, options) in variants.items():
        command += ["--tracker", f"{identifiers[name]}={tracker}{json.dumps(options) if options else ''}"]
    for step in (command, [program, "report", out]):
        try:
            result = subprocess.run(step, stdout=subprocess.DEVNULL, check=False)
        except OSError as error:
            sys.exit(f"{program}: {error.strerror}")
        if result.returncode != 0:
            sys.exit(result.returncode)

    def rows(name):
        with open(Path(out) / "report" / name, newline="", encoding="utf-8") as file:
            return list(csv.DictReader(file))

    summary = {row["tracker"]: row for row in rows("summary.csv")}
    first = identifiers[next(iter(variants))]
    change = {}
    for row in rows("differences.csv"):
        if row["measure"] == "AO" and first in (row["a"], row["b"]):
            value, low, high = float(row["value"]), float(row["low"]), float(row["high"])
            # Differences are a - b.
            change[row["b"] if row["a"] == first else row["a"]] = \
                (-value, -high, -low) if row["a"] == first else (value, low, high)
    print("| variant | EAO | A | F | AO | AO against the first |")
    print("|---|---|---|---|---|---|")
    for title, identifier in identifiers.items():
        row = summary[identifier]
        # Of other protocols (--protocol) there are not all of them.
        figures = [f"{float(row[name]):.{digits}f}" if row.get(name) else "-"
                   for name, digits in (("EAO", 3), ("A", 3), ("F", 1), ("AO", 3))]
        against = "{:+.3f} ({:+.3f} to {:+.3f})".format(*change[identifier]) if identifier in change else ""
        print(f"| {title} | {' | '.join(figures)} | {against} |")


if __name__ == "__main__":
    main()
