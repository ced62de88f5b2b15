#!/usr/bin/env bash
# Compiles the solver, the batch, the parts, the trackers and their tests for 64-bit ARM, and runs these under qemu (Debian
# 12; root or sudo). Without CLI11 for ARM there are no programs, whose tests would start other processes.
#
#   bash tests/arm.sh [TARGET...]      these tests, by default all of solver, parts and trackers
#
# OpenCV for ARM, with all that it needs, comes from Debian's packages for that processor (230 MB). They are extracted to
# build/arm/debian and not installed, so that those of the host stay as they are.
set -euo pipefail
cd "$(dirname "$0")/.."
bash .ci/install-packages arm
arm=$PWD/build/arm root=$PWD/build/arm/root debian=$PWD/build/arm/debian
# Eigen and JSON have headers alone, which are the same for all processors.
mkdir -p "$root/include" "$root/share/cmake"
cp -ru /usr/include/eigen3 /usr/include/nlohmann "$root/include/"
cp -ru /usr/share/eigen3 "$root/share/"
cp -ru /usr/share/cmake/nlohmann_json "$root/share/cmake/"

fetch_opencv() {
  local packages=$arm/packages
  mkdir -p "$packages"/{state/lists/partial,cache/archives/partial,root}
  touch "$packages/state/status"  # nothing is installed there
  cat >"$packages/apt.conf" <<EOF
APT::Architecture "arm64";
APT::Architectures { "arm64"; };
APT::Sandbox::User "root";
Dir::State "$packages/state";
Dir::State::status "$packages/state/status";
Dir::Cache "$packages/cache";
EOF
  echo "fetching OpenCV for ARM (Debian packages, about 230 MB)"
  APT_CONFIG=$packages/apt.conf apt-get update -qq
  APT_CONFIG=$packages/apt.conf apt-get install -y -qq --download-only --no-install-recommends \
    libopencv-dev libopencv-contrib-dev >/dev/null
  for package in "$packages"/cache/archives/*.deb; do dpkg-deb -x "$package" "$packages/root"; done
  rm -rf "$debian" "$packages/cache"
  mv "$packages/root" "$debian"
}
[[ -d $debian ]] || fetch_opencv

configure() { cmake -G Ninja --toolchain "$PWD/tests/aarch64.cmake" -DCMAKE_BUILD_TYPE=Release "$@" >/dev/null; }
configure -S /usr/src/googletest -B build/arm/googletest -DCMAKE_INSTALL_PREFIX="$root"
cmake --build build/arm/googletest --target install >/dev/null
configure -S . -B build/arm/asterism -DCMAKE_UNITY_BUILD=ON -DASTERISM_BUILD_PYTHON=OFF \
  -DASTERISM_BUILD_BENCH=OFF -DASTERISM_BUILD_DOCS=OFF \
  -DOpenCV_DIR="$debian/usr/lib/aarch64-linux-gnu/cmake/opencv4"
if [[ $# -gt 0 ]]; then
  cmake --build build/arm/asterism --target "$@"
  ctest --test-dir build/arm/asterism --output-on-failure -R "^($(IFS='|' && echo "$*"))\$"
  exit
fi
cmake --build build/arm/asterism --target tests/solver/all tests/parts/all tests/trackers/all
for folder in solver parts trackers; do
  ctest --test-dir build/arm/asterism/tests/$folder --output-on-failure --parallel 2
done
