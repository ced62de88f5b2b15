#!/usr/bin/env bash
# What takes too long for every change (docs/testing.md): hours on two cores. Goes on after a failure, and says at the end
# what failed. Keeps what each step prints in build/nightly/COMMIT; started again, it leaves out the steps that have passed
# on that commit.
set -uo pipefail
trap 'exit 130' INT TERM
cd "$(dirname "$0")/.." || exit
changes=$(git stash create)  # a commit of the changed files, new each time; none where nothing has changed
logs=build/nightly/${changes:-$(git rev-parse HEAD)}
mkdir -p "$logs"
failed=()
step() {
  local name=$1
  shift
  if [[ -e $logs/$name.passed ]]; then
    echo "== $name: has passed"
    return
  fi
  echo "== $name, $(date '+%F %T')"
  if "$@" 2>&1 | tee "$logs/$name.log"; then
    touch "$logs/$name.passed"
  else
    failed+=("$name")
  fi
}

# Every memory access of the solvers, and of the tool on a few frames.
memcheck() {
  ASTERISM_PROPERTY_SYSTEMS=100 valgrind --quiet --error-exitcode=9 build/release/tests/solver/solver_property_test ||
    return
  local frames=build/release/memcheck
  mkdir -p "$frames" && python3 -c '
import pathlib, sys
for t in range(6):
    pixels = bytearray()
    for y in range(120):
        for x in range(160):
            u, v = x - 40 - t, y - 40
            inside = 0 <= u < 40 and 0 <= v < 40
            pixels += bytes([90 + (u * 37 + v * 91) % 160 if inside else (x * 7 + y * 13) % 60, 80, 200 if inside else 40])
    pathlib.Path(sys.argv[1], f"{t}.ppm").write_bytes(b"P6 160 120 255 " + pixels)' "$frames" &&
    valgrind --quiet --error-exitcode=9 build/release/trackers/tools/asterism-track "$frames" --box 40,40,40,40 \
      --out - >/dev/null
}

# The next dialect of C++ warns of nothing in the headers that users include.
newer_dialect() {
  local header
  for header in solver system trackers/tracker/tracker parts/concept/part_registry; do
    echo "#include <asterism/$header.hpp>"
  done | g++ -std=c++23 -fsyntax-only -Wall -Wextra -Wpedantic -Werror -Isolver/include -Iparts/include -Itrackers/include \
    -isystem /usr/include/eigen3 -isystem /usr/include/opencv4 -x c++ -
}

step "packages" bash .ci/install-packages build test docs night petsc
step "tests" bash tests/run.sh release -DASTERISM_LONG_TESTS=ON -DASTERISM_WITH_PETSC=ON
# To be read, as they vary with the machine.
step "bars" build/release/bench/asterism-bench bars --large
step "clang-tidy" bash tests/tidy.sh --analyze
step "fuzzers" bash tests/fuzz.sh 1000000
step "properties" env ASTERISM_PROPERTY_SYSTEMS=100000 build/release/tests/solver/solver_property_test
step "hostile systems" env ASTERISM_HOSTILE_SYSTEMS=10000 build/release/tests/solver/solver_hostile_test
step "intervals" env ASTERISM_INTERVAL_SYSTEMS=1000000 build/release/tests/solver/solver_interval_test
for tracker in dpt dpt_plus; do
  step "soak of $tracker" build/release/tests/trackers/soak 100000 "$tracker"
done
step "AddressSanitizer and UndefinedBehaviorSanitizer" bash tests/run.sh sanitize
step "ThreadSanitizer" bash tests/run.sh thread
step "coverage" bash tests/coverage.sh
step "valgrind" memcheck
step "C++23" newer_dialect
step "site" cmake --build --preset release --target site
step "look of the site" /usr/bin/python3 tests/docs/site_look_test.py build/release/docs/site
step "64-bit ARM" bash tests/arm.sh
step "Debian packages" bash tests/package/debian.sh

if [[ ${#failed[@]} -gt 0 ]]; then
  printf 'failed: %s\n' "${failed[@]}" >&2
  exit 1
fi
