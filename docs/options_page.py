#!/usr/bin/env python3
"""options_page.py [--check]: writes docs/options.md, the options of every tracker and part model of this build.

Names, defaults and values come from the Python module asterism, that is, from the library itself; meanings are the first sentences of
the members' comments in the headers. --check writes nothing, and ends with 1 if the page is out of date.
"""
import argparse
import json
import pathlib
import re
import sys

import asterism

ROOT = pathlib.Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs/options.md"
# Options of a description that are no members of a struct.
NO_MEMBERS = {
    "of": "Description of the tracker whose box is filtered.",
    "redetect": "Search the whole frame for an object that has been lost (RedetectingTracker).",
}

HEAD = """# Options of trackers and part models

<!-- Written by docs/options_page.py: change the comments in the headers, not this page. -->

This page lists the options of every tracker and part model, with their defaults and values. A dot separates the name of an object
from that of a member: `coarse.use_color` is `{"coarse": {"use_color": true}}` in a [description](tracker.md#descriptions). A part model
is written as its name, or as an object with the name as `"model"` and [its own options](#part-models) beside it.

Both tools and Python print the options of a tracker. The JSON of `--options` is a whole description, which `--config` takes:

```sh
asterism-track --options dpt > tracker.json
asterism-track VIDEO --config tracker.json
```

In Python, `asterism.tracker_options("dpt")` and the method `options()` of a `Tracker` return the same as a dict, and
`asterism.part_options("kcf")` returns the options of a part model.

This page is of a build with all optional libraries. The following command writes it, and the test `python.options_page` fails if it
is out of date:

```sh
PYTHONPATH=build/release/solver/python python3 docs/options_page.py
```
"""


def headers():
    return sorted(path for room in ("solver", "parts", "trackers") for path in (ROOT / room / "include").rglob("*.hpp"))


class Struct:
    """A struct of a header: its members' types and comments."""

    def __init__(self, header, base):
        self.header, self.base, self.members = header, base, {}


def structs_of(header):
    name, comment, group = None, [], ""
    found = {}
    for line in header.read_text(encoding="utf-8").split("\n"):
        begin = re.fullmatch(r"struct (\w+)(?: : (\w+))? {", line)
        if begin:
            name, comment, group = begin[1], [], ""
            found[name] = Struct(header, begin[2])
        elif line == "};":
            name = None
        elif name is None:
            continue
        elif text := re.fullmatch(r"  /// (.*)", line):
            comment.append(text[1])
        elif not line.strip():
            comment, group = [], ""
        elif member := re.fullmatch(r"  (?!using |return |static )([\w:<>]+) (\w+(?:[ =,{;].*)?)", line):
            own = re.search(r"///< (.*)", line)
            # The comment of a member is that of the members right below it, too.
            group = own[1] if own else " ".join(comment) or group
            for each in re.split(r", (?=\w+ ?[=,;])", re.sub(r"; *///<.*", ";", member[2])):
                found[name].members[re.match(r"\w+", each)[0]] = (member[1], group)
            comment = []
    return found


STRUCTS = {name: struct for header in headers() for name, struct in structs_of(header).items()}
ALIASES = dict(alias for header in headers() for alias in re.findall(r"^using (\w+) = (\w+);", header.read_text(encoding="utf-8"), re.MULTILINE))


def members_of(struct):
    """Also those of its base, and those of a window, which stand among the options of a model."""
    members = dict(members_of(STRUCTS[struct.base])) if struct.base in STRUCTS else {}
    members.update(struct.members)
    for type_name, _ in struct.members.values():
        if type_name == "TemplateWindow":
            members.update(STRUCTS[type_name].members)
    return members


def struct_of(options):
    """The struct whose members are these options, with the fewest others."""
    names = set(options) - set(NO_MEMBERS)
    fits = [(len(members_of(struct)), name) for name, struct in STRUCTS.items() if name.endswith("Options") and names <= set(members_of(struct))]
    if not fits:
        raise SystemExit(f"options_page.py: no struct of the headers has the members {', '.join(sorted(names))}")
    return min(fits)[1]


def first_sentence(comment):
    end = re.search(r"(?<!Sec)(?<!Eq)(?<!Eqs)(?<!al)(?<!e\.g)\.(?= [A-Z0-9`\"])", comment)
    text = comment[:end.end()] if end else comment
    text = text[:1].upper() + text[1:].replace("|", "\\|")
    return text if not text or text.endswith(".") else text + "."


def rows_of(struct_name, options, path=()):
    """(path, value, comment) of each option, also in objects."""
    members = members_of(STRUCTS[struct_name])
    for name, value in options.items():
        type_name, comment = members.get(name, ("", NO_MEMBERS.get(name, "")))
        if isinstance(value, dict) and not {"model", "tracker"} & set(value):
            yield from rows_of(ALIASES.get(type_name, type_name), value, (*path, name))
        else:
            yield (*path, name), value, comment


def differences(options, other):
    """What of `options` differs from `other`."""
    found = {}
    for name, value in options.items():
        before = other.get(name)
        if value == before:
            continue
        if isinstance(value, dict) and "model" in value:
            found[name] = part_text(value)
        elif isinstance(value, dict) and isinstance(before, dict):
            found[name] = differences(value, before)
        else:
            found[name] = value
    return found


def part_text(part):
    """A part model by its name, with the options that differ from its defaults."""
    others = differences({name: value for name, value in part.items() if name != "model"}, asterism.part_options(part["model"]))
    return {"model": part["model"], **others} if others else part["model"]


def shown(value):
    if isinstance(value, dict):
        value = part_text(value) if "model" in value else value["tracker"]
    return f"`{json.dumps(value)}`"


def values_of(path, value, ask):
    """What the library says that an option may be, when it is given something else."""
    if isinstance(value, (bool, dict)):
        return ""
    for wrong in [2**31 - 1] if isinstance(value, int) else [1e300] if isinstance(value, float) else ["?"]:
        options = wrong
        for name in reversed(path):
            options = {name: options}
        try:
            ask(options)
        except ValueError as error:
            if names := re.search(r"must be one of (.*), not", str(error)):
                return ", ".join(f"`{name}`" for name in names[1].split(", "))
            if ends := re.search(re.escape(path[-1]) + r" must be in \[(\S+), (\S+)\], is", str(error)):
                least, most = (re.sub(r"e\+?(-?)0*", r"e\1", end).replace("1000000000", "1e9") for end in ends.groups())
                return f"{least} to {most}"
    return ""


def table(options, ask):
    struct = struct_of(options)
    header = STRUCTS[struct].header.relative_to(ROOT).as_posix()
    lines = [f"[`{struct}`](../{header})", "", "| option | default | values | meaning |", "|---|---|---|---|"]
    for path, value, comment in rows_of(struct, options):
        lines.append(f"| `{'.'.join(path)}` | {shown(value)} | {values_of(path, value, ask)} | {first_sentence(comment)} |")
    return [re.sub(r" +\|", " |", line).replace("|  |", "| |") for line in lines]


def page():
    lines = HEAD.split("\n")
    bases = {}
    for name in asterism.tracker_names():
        options = asterism.tracker_options(name)
        bases.setdefault(struct_of(options), []).append((name, options))
    lines += ["## Trackers", ""]
    for (name, options), *variants in bases.values():
        lines += [f"### {name}", ""]
        lines += table(options, lambda given, name=name: asterism.tracker_options(name, given)) + [""]
        if variants:
            lines += [f"Names of `{name}` with other defaults:", "", f"| name | options that differ from those of `{name}` |", "|---|---|"]
            lines += [f"| `{other}` | `{json.dumps(differences(those, options))}` |" if those != options else f"| `{other}` | none |" for other, those in variants]
            lines += [""]
    lines += ["## Part models", ""]
    for name in asterism.part_names():
        described = asterism.part_options(name)
        lines += [f"### Part model {name}", ""]
        lines += table(described, lambda given, name=name: asterism.tracker_options("dpt", {"part": {"model": name, **given}})) + [""]
    return "\n".join(lines)


def main():
    arguments = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    arguments.add_argument("--check", action="store_true", help="write nothing; end with 1 if the page is out of date")
    check = arguments.parse_args().check
    text = page()
    if not check:
        PAGE.write_text(text, encoding="utf-8")
    elif not PAGE.exists() or PAGE.read_text(encoding="utf-8") != text:
        before = PAGE.read_text(encoding="utf-8").split("\n") if PAGE.exists() else []
        after = text.split("\n")
        line = next((i for i, pair in enumerate(zip(before, after)) if pair[0] != pair[1]), min(len(before), len(after)))
        sys.exit(f"docs/options.md:{line + 1} is out of date, docs/options_page.py writes it; it should be: {(after + [''])[line]}")


if __name__ == "__main__":
    main()
