#!/usr/bin/env bash
# The coverage of the libraries and tools by the tests:
#
#   bash tests/coverage.sh              builds, runs every test, and prints lines and branches of each file
#   bash tests/coverage.sh FILE...      also, or afterwards: prints the lines of these files with their counts
set -euo pipefail
cd "$(dirname "$0")/.."
profiles=build/coverage/profiles

bash .ci/install-packages build test night
if [[ $# == 0 || ! -f $profiles/all.profdata ]]; then
  cmake --preset coverage
  cmake --build --preset coverage
  rm -rf "$profiles"
  # The processes of each program share a few files, to which they add their counts. The tests of the package
  # are left out as they build their own programs, and wide_symbols as the counters are symbols that it
  # forbids.
  LLVM_PROFILE_FILE=$PWD/$profiles/%4m.profraw ctest --preset coverage --parallel 2 -LE package -E wide_symbols ||
    echo "coverage: a test that fills the disk, or kills a process, fails here with its counters" >&2
  llvm-profdata merge -sparse -failure-mode=all "$profiles"/*.profraw -o "$profiles/all.profdata"
fi

programs=()
while read -r program; do
  programs+=(-object "$program")
done < <(find build/coverage -type f \( -perm -u+x -o -name '*.so' \) -not -path '*/CMakeFiles/*' -exec \
  sh -c 'LC_ALL=C grep -q __llvm_covmap "$1" && echo "$1"' sh {} \;)
if [[ $# == 0 ]]; then
  llvm-cov report "${programs[@]:1}" -instr-profile "$profiles/all.profdata" -show-region-summary=false \
    solver parts trackers
else
  llvm-cov show "${programs[@]:1}" -instr-profile "$profiles/all.profdata" -show-branches=count "$@"
fi
