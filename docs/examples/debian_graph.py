#!/usr/bin/env python3
"""The dependency graph of Debian's packages as a list of edges: apt-cache dumpavail | debian_graph.py [--section NAME] > debian.edges

A line is `PACKAGE PACKAGE`: the first one depends on the second one, or on one of several of which the second is the first that is
there. bench/laboratory/layouts.py reads such files.
"""

import argparse
import sys
from collections.abc import Iterable, Iterator


def paragraphs(lines: Iterable[str]) -> Iterator[dict[str, str]]:
    """The fields of each package; lines that begin with a space continue the field before."""
    fields: dict[str, str] = {}
    name = ""
    for line in lines:
        line = line.rstrip("\n")
        if not line:
            if fields:
                yield fields
            fields = {}
        elif line[0] in " \t":
            fields[name] = fields.get(name, "") + " " + line.strip()
        else:
            name, _, value = line.partition(":")
            fields[name] = value.strip()
    if fields:
        yield fields


def names(relation: str) -> list[str]:
    """The packages of one relation, `a (>= 1) | b:any [amd64]`."""
    return [part.split("(")[0].split("[")[0].split(":")[0].strip() for part in relation.split("|")]


def edges(packages: list[dict[str, str]]) -> Iterator[tuple[str, str]]:
    known = {package["Package"] for package in packages}
    for package in packages:
        seen = {package["Package"]}
        wanted = ",".join(package[field] for field in ("Pre-Depends", "Depends") if field in package)
        for relation in wanted.split(","):
            found = next((name for name in names(relation) if name in known), None)
            if found and found not in seen:
                seen.add(found)
                yield package["Package"], found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--section", help="only packages of this section, such as games")
    wanted = parser.parse_args().section
    packages = [fields for fields in paragraphs(sys.stdin) if "Package" in fields]
    packages = list({fields["Package"]: fields for fields in packages}.values())  # of several versions the last one
    if wanted:
        packages = [fields for fields in packages if fields.get("Section", "").split("/")[-1] == wanted]
    if not packages:
        sys.exit("debian_graph.py: no packages; give the output of apt-cache dumpavail on standard input")
    for edge in edges(packages):
        print(*edge)


if __name__ == "__main__":
    main()
