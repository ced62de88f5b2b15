"""exports_test.py NM HEADERS... -- LIBRARY...: what the libraries define and the public headers in the folders HEADERS declare
is marked ASTERISM_API, so that shared libraries, which the other tests do without, have it, too."""

import pathlib
import re
import subprocess
import sys

nm, *arguments = sys.argv[1:]
folders, libraries = arguments[: arguments.index("--")], arguments[arguments.index("--") + 1 :]
headers = ""
for folder in folders:
    for header in pathlib.Path(folder).rglob("*.hpp"):
        headers += re.sub(r"//.*", "", header.read_text())

marked, unmarked = set(), set()
for library in libraries:
    symbols = subprocess.run([nm, "-C", "--defined-only", library], capture_output=True, text=True, check=True).stdout
    names = set(re.findall(r" T asterism::\w+_v?\d\w*::((?:\w+::)*\w+)", symbols))
    for name in {re.sub(r"^(reference::|detail::)*", "", name).split("::")[0] for name in names}:
        # A class, or a function of the namespace, which begins its line.
        for declaration in re.findall(rf"\b(?:class|struct) (?:\w+ )?{name} ?\{{|^\S.*\b{name}\(", headers, re.MULTILINE):
            if not re.search(r"\b(?:constexpr|inline)\b", declaration):  # those are defined in the header
                (marked if "ASTERISM_API" in declaration else unmarked).add(declaration)
if unmarked or len(marked) < len(libraries):
    sys.exit("not marked ASTERISM_API:\n" + "\n".join(sorted(unmarked)) + f"\n({len(marked)} are)")
print(f"{len(marked)} marked")
