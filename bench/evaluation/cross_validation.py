#!/usr/bin/env python3
"""Chooses among declared variants of a tracker by nested cross-validation, and scores the choice where it was not made.

    bench/evaluation/cross_validation.py CANDIDATES EVAL DATASET FOLDS OUT [OPTION...]

CANDIDATES is a JSON file, {"candidates": {NAME: DESCRIPTION, ...}}: descriptions of trackers as `asterism-eval run --tracker` takes
them, or as JSON objects {"tracker": "dpt", ...}; the published setting first, then from the simplest to the least simple. A setting
that was fitted to the other folds, such as those of learn_laws.py, has a description for each fold, {"by_fold": {FOLD: DESCRIPTION,
...}}. EVAL is the program asterism-eval. FOLDS has a line FOLD<tab>SEQUENCE... for each sequence; lines that begin with # are
comments. Further options go to `asterism-eval run`, such as --starts 3 --workers 2, but for --interval LOW:HIGH, the lengths that EAO
averages over (166:377 by default, VOT2014's). What OUT has is not run again; interrupt and repeat the command to go on.

All candidates are run on all sequences, supervised and in one pass. Then, for each fold in turn, the choice is made on the other
folds: the published setting stays unless a candidate is better in both the supervised EAO and the one-pass AO beyond the 95 %
interval of a paired bootstrap over sequences and starts; a later candidate replaces an earlier one only by the same rule. The
choice of each fold is scored on that fold alone. Together these results, which nothing was chosen on, are the tracker
`out-of-fold`, whose figures are the ones to print.

A candidate by fold is run on each fold as described for it, and compared with the published setting. Its figures are out of fold as
they are. It takes no part in the choices, because its results on the other folds come from fits that saw the fold in turn.

OUT/tried.json lists every candidate ever declared for this folder. It only grows: candidates that are taken out of the file again
still count as tried, and one whose description changes needs another name.

Prints a table in Markdown, with the number of candidates tried; OUT/cross_validation.json has all of it.
"""

import csv
import json
import shutil
import subprocess
import sys
from pathlib import Path

OUT_OF_FOLD = "out-of-fold"
INTERVAL = "166:377"  # of EAO: VOT2014's by the toolkit's rule. One for all folds, so that their figures compare.
RULE = ("EAO", "AO")  # a choice has to be better in both
SHOWN = (("EAO", 3), ("A", 3), ("F", 1), ("AO", 3))


class BadInput(Exception):
    """What is wrong with the input, in one line."""


def read_candidates(path):
    try:
        candidates = json.loads(Path(path).read_text(encoding="utf-8"))["candidates"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadInput(f"{path}: not a JSON object with \"candidates\": {error}") from error
    if not isinstance(candidates, dict) or len(candidates) < 2:
        raise BadInput(f"{path}: \"candidates\" must have two descriptions or more by name")
    for name, description in candidates.items():
        by_fold = description.get("by_fold", {}) if isinstance(description, dict) else {}
        if not isinstance(description, (str, dict)) or name == OUT_OF_FOLD or not isinstance(by_fold, dict):
            raise BadInput(f"{path}: {name}: not a name with a tracker's description")
        if any(not isinstance(d, (str, dict)) for d in by_fold.values()):
            raise BadInput(f"{path}: {name}: \"by_fold\" must have a tracker's description for each fold")
    if is_by_fold(next(iter(candidates.values()))):
        raise BadInput(f"{path}: the first candidate is the published setting, the same for all folds")
    return candidates


def is_by_fold(description):
    return isinstance(description, dict) and "by_fold" in description


def text_of(description):
    return json.dumps(description) if isinstance(description, dict) else description


def read_folds(path):
    """{fold: [sequence, ...]}"""
    folds = {}
    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise BadInput(f"{path}: not a file of folds: {error}") from error
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.startswith("#"):
            continue
        cells = line.split("\t")
        if len(cells) < 2 or not cells[1].strip():
            raise BadInput(f"{path}:{number}: expected FOLD<tab>SEQUENCE")
        if any(cells[1] in sequences for sequences in folds.values()):
            raise BadInput(f"{path}:{number}: {cells[1]} is there twice")
        folds.setdefault(cells[0], []).append(cells[1])
    if len(folds) < 2:
        raise BadInput(f"{path}: two folds at least are needed")
    return folds


def sequences_of(path, of=None):
    """The sequences of a file of folds, or only those of the folds of `of`, such as "3,4"."""
    folds = read_folds(path)
    chosen = of.split(",") if of else list(folds)
    if unknown := set(chosen) - set(folds):
        raise BadInput(f"{path} has no fold {', '.join(sorted(unknown))}")
    return [name for fold in chosen for name in folds[fold]]


def declare(candidates, out):
    """Adds the candidates to tried.json before they are run; returns all that were ever declared."""
    path = out / "tried.json"
    try:
        tried = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    except ValueError as error:
        raise BadInput(f"{path}: damaged: {error}") from error
    for name, description in candidates.items():
        description = text_of(description)
        if tried.setdefault(name, description) != description:
            raise BadInput(f"{path}: {name} was {tried[name]}: give the changed candidate another name")
    out.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(tried, indent=1) + "\n", encoding="utf-8")
    return tried


def run(command):
    try:
        result = subprocess.run(command, stdout=subprocess.DEVNULL, check=False)
    except OSError as error:
        raise BadInput(f"{command[0]}: {error.strerror}") from error
    if result.returncode != 0:
        sys.exit(result.returncode)


def report(program, out, sequences, interval, to):
    """The summary by tracker, and {(measure, a, b): (value, low, high)} of the differences a - b."""
    run([program, "report", str(out), "--out", str(to), "--interval", interval, "--sequences", ",".join(sequences)])

    def rows(name):
        with open(to / name, newline="", encoding="utf-8") as file:
            return list(csv.DictReader(file))

    differences = {}
    for row in rows("differences.csv"):
        # A single sequence has no intervals; with NaN no candidate replaces another.
        value, low, high = (float(row[key] or "nan") for key in ("value", "low", "high"))
        differences[row["measure"], row["a"], row["b"]] = value, low, high
        differences[row["measure"], row["b"], row["a"]] = -value, -high, -low
    return {row["tracker"]: row for row in rows("summary.csv")}, differences


def choose(names, differences):
    """The published setting, which is the first, unless another is significantly better."""
    choice = names[0]
    if len(names) > 1 and any((measure, *names[:2]) not in differences for measure in RULE):
        raise BadInput("there is no " + " or no ".join(RULE) + ": give --interval LOW:HIGH within the sequences' lengths")
    for name in names[1:]:
        if all(differences[measure, name, choice][1] > 0 for measure in RULE):
            choice = name
    return choice


def copy_results(results, sequences, to):
    """Copies the results of a tracker on these sequences to those of another. Both are folders."""
    for experiment in sorted(results.iterdir()):
        for sequence in sequences:
            source = experiment / sequence
            if source.exists():
                shutil.copytree(source, to / experiment.name / sequence)


def table(summary, names):
    yield "| | " + " | ".join(name for name, _ in SHOWN) + " |"
    yield "|---" * (len(SHOWN) + 1) + "|"
    for name in names:
        row = summary[name]
        yield f"| {name} | " + " | ".join(f"{float(row[key]):.{digits}f}" for key, digits in SHOWN) + " |"


def cross_validate(candidates_file, program, dataset, folds_file, out, options):
    candidates, folds, out = read_candidates(candidates_file), read_folds(folds_file), Path(out)
    names = [name for name, description in candidates.items() if not is_by_fold(description)]
    by_fold = [name for name in candidates if name not in names]
    for name in by_fold:
        if missing := folds.keys() - candidates[name]["by_fold"].keys():
            raise BadInput(f"{candidates_file}: {name}: no description for fold {', '.join(sorted(missing))}")
    tried = declare(candidates, out)
    options, interval = list(options), INTERVAL
    if "--interval" in options:
        at = options.index("--interval")
        interval = options[at + 1] if at + 1 < len(options) else ""
        del options[at:at + 2]
    sequences = [sequence for fold in folds.values() for sequence in fold]

    def run_on(those, descriptions, to):
        command = [program, "run", dataset, "--out", str(to), "--protocol", "vot,otb", "--overlap", "exact",
                   "--sequences", ",".join(those)]
        for name, description in descriptions.items():
            command += ["--tracker", f"{name}={text_of(description)}"]
        run(command + options)

    run_on(sequences, {name: candidates[name] for name in names}, out)
    results = out / "results"
    for name in (OUT_OF_FOLD, *by_fold):  # these are copied below
        shutil.rmtree(results / name, ignore_errors=True)
    for fold, held_out in folds.items() if by_fold else ():
        run_on(held_out, {name: candidates[name]["by_fold"][fold] for name in by_fold}, out / "by-fold" / fold)
        for name in by_fold:
            copy_results(out / "by-fold" / fold / "results" / name, held_out, results / name)
    choices = {}
    for fold, held_out in folds.items():
        _, differences = report(program, out, [s for s in sequences if s not in held_out], interval, out / "folds" / fold)
        choices[fold] = choose(names, differences)
    for fold, held_out in folds.items():
        copy_results(results / choices[fold], held_out, results / OUT_OF_FOLD)
    summary, differences = report(program, out, sequences, interval, out / "report")
    # The setting to use in future is chosen on all folds.
    final = choose(names, differences)
    shown = [OUT_OF_FOLD, *names, *by_fold]
    result = {"tried": tried, "choices": choices, "chosen_on_all": final,
              "figures": {name: {key: float(summary[name][key]) for key, _ in SHOWN} for name in shown},
              "out_of_fold_minus_published": {measure: differences[measure, OUT_OF_FOLD, names[0]] for measure in RULE},
              "by_fold_minus_published": {name: {measure: differences[measure, name, names[0]] for measure in RULE} for name in by_fold}}
    (out / "cross_validation.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")

    print(f"{len(tried)} candidates tried on {len(sequences)} sequences in {len(folds)} folds.")
    for fold, choice in choices.items():
        print(f"Fold {fold}: chosen on the others, {choice}")
    print(f"Chosen on all: {final}\n")
    # Without a choice, out-of-fold is the published setting.
    compared = {"out of fold": result["out_of_fold_minus_published"]} if len(names) > 1 else {}
    print("\n".join(table(summary, shown if compared else shown[1:])))
    print()
    for name, differences in (compared | result["by_fold_minus_published"]).items():
        for measure in RULE:
            value, low, high = differences[measure]
            print(f"{measure} {name}, against {names[0]}: {value:+.3f} ({low:+.3f} to {high:+.3f})")


def main():
    if len(sys.argv) < 6:
        sys.exit(__doc__)
    try:
        cross_validate(*sys.argv[1:6], sys.argv[6:])
    except BadInput as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
