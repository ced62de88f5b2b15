#!/usr/bin/env bash
# Installs what the tests need (Debian 12; root or sudo), builds, and runs every test.
#
#   bash tests/run.sh [release|clang|sanitize|fuzz|thread] [OPTION...]      one preset of CMakePresets.json, release by
#                                                                           default, and options of CMake
#
# With CI set in the environment, warnings are errors.
set -euo pipefail
cd "$(dirname "$0")/.."
preset=${1:-release}

bash .ci/install-packages build test

options=("${@:2}")
[ -z "${CI:-}" ] || options+=(-DASTERISM_WERROR=ON)
! command -v ccache >/dev/null || options+=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
cmake --preset "$preset" "${options[@]}"
cmake --build --preset "$preset"
ctest --preset "$preset" --parallel 2
