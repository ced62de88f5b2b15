#!/usr/bin/env bash
# Builds the fuzzers (preset "fuzz": clang and its sanitizers) and runs each one:
#
#   bash tests/fuzz.sh [EXECUTIONS [TARGET...]]      20000 of all targets by default
#
# With CI set in the environment, warnings are errors. ASTERISM_FUZZ_SEED chooses the inputs; without it, each run has its own.
# What is found stays in build/fuzz/findings. New inputs that reach new code are kept in build/fuzz/corpus.
set -euo pipefail
cd "$(dirname "$0")/.."
executions=${1:-20000}
shift || true
targets=("$@")
[[ ${#targets[@]} -gt 0 ]] || mapfile -t targets < <(basename -a -s _fuzz.cpp tests/fuzz/*_fuzz.cpp)

bash .ci/install-packages build test
options=()
[ -z "${CI:-}" ] || options+=(-DASTERISM_WERROR=ON)
! command -v ccache >/dev/null || options+=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
cmake --preset fuzz "${options[@]}"
cmake --build --preset fuzz --target "${targets[@]/#/fuzz_}"

failed=0
for target in "${targets[@]}"; do
  grown=build/fuzz/corpus/$target
  mkdir -p "$grown" build/fuzz/findings
  start=$SECONDS
  if "build/fuzz/tests/fuzz/fuzz_$target" -runs="$executions" -seed="${ASTERISM_FUZZ_SEED:-0}" -timeout=20 -rss_limit_mb=4096 -max_len=4096 \
      -artifact_prefix="build/fuzz/findings/$target-" "$grown" "tests/fuzz/corpus/$target" \
      >"build/fuzz/$target.log" 2>&1; then
    echo "$target: $executions executions in $((SECONDS - start)) s, no finding"
  else
    echo "$target: a finding, see build/fuzz/$target.log" >&2
    grep -vE '^#|NEW_FUNC' "build/fuzz/$target.log" | tail -n 40 >&2
    failed=1
  fi
done
exit "$failed"
