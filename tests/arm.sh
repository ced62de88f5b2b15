#!/usr/bin/env bash
# Compiles the solver, the batch and their tests for 64-bit ARM, and runs these under qemu (Debian 12; root or sudo).
#
#   bash tests/arm.sh [TARGET...]      all tests of the solver by default
#
# Parts and trackers need OpenCV for ARM, which Debian installs beside that of the host only in part.
set -euo pipefail
cd "$(dirname "$0")/.."
bash .ci/install-packages arm
root=$PWD/build/arm/root
# Eigen and JSON have headers alone, which are the same for all processors.
mkdir -p "$root/include" "$root/share/cmake"
cp -ru /usr/include/eigen3 /usr/include/nlohmann "$root/include/"
cp -ru /usr/share/eigen3 "$root/share/"
cp -ru /usr/share/cmake/nlohmann_json "$root/share/cmake/"

configure() { cmake -G Ninja --toolchain "$PWD/tests/aarch64.cmake" -DCMAKE_BUILD_TYPE=Release "$@" >/dev/null; }
configure -S /usr/src/googletest -B build/arm/googletest -DCMAKE_INSTALL_PREFIX="$root"
cmake --build build/arm/googletest --target install >/dev/null
configure -S . -B build/arm/asterism -DCMAKE_UNITY_BUILD=ON -DASTERISM_BUILD_PYTHON=OFF \
  -DASTERISM_BUILD_BENCH=OFF -DASTERISM_BUILD_DOCS=OFF -DASTERISM_BUILD_TOOLS=OFF
targets=("$@")
[[ ${#targets[@]} -gt 0 ]] || targets=(tests/solver/all)
cmake --build build/arm/asterism --target "${targets[@]}"
tests='^solver'
[[ $# -eq 0 ]] || tests="^($(IFS='|' && echo "$*"))\$"
ctest --test-dir build/arm/asterism --output-on-failure --parallel 2 --timeout 7200 -R "$tests"
