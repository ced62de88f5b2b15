#!/usr/bin/env bash
# The rules of .clang-tidy, on the libraries and the tools' support. Each library is looked at as one source file, which is
# several times faster than many.
#
#   bash tests/tidy.sh [--analyze]     also the paths through the code, which takes long
set -euo pipefail
cd "$(dirname "$0")/.."
checks=-bugprone-suspicious-include  # what the one source file consists of
[[ ${1:-} == --analyze ]] || checks+=',-clang-analyzer-*'

# clang cannot read gcc's precompiled headers.
cmake --preset clang -B build/tidy -DCMAKE_DISABLE_PRECOMPILE_HEADERS=ON -DCMAKE_UNITY_BUILD=ON \
  -DCMAKE_UNITY_BUILD_BATCH_SIZE=0 >/dev/null
run-clang-tidy -quiet -p build/tidy -checks="$checks" -header-filter='/(solver|parts|trackers)/(include|src|tools)/' \
  '/build/tidy/(solver|parts|trackers(/tools)?)/CMakeFiles/|_portable.cpp'
