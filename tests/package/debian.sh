#!/usr/bin/env bash
# Installs and uses the Debian packages in a fresh Debian 12. Root, with debootstrap.
#
#   bash tests/package/debian.sh [FOLDER]      packages that are there; by default they are made, in build/deb/packages
#
# MIRROR in the environment names another mirror of Debian. Not one of ctest's: it builds all libraries once more, and wants
# the network.
set -euo pipefail
cd "$(dirname "$0")/../.."
packages=${1:-build/deb/packages}

if [[ $# == 0 ]]; then
  cmake --preset deb -DASTERISM_WERROR=ON
  cmake --build --preset deb
  rm -rf "$packages"
  cpack --preset deb
fi

root=$(mktemp -d)
trap 'rm -rf "$root"' EXIT
debootstrap --variant=minbase bookworm "$root" "${MIRROR:-http://deb.debian.org/debian}" >/dev/null
inside() { chroot "$root" env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin LC_ALL=C DEBIAN_FRONTEND=noninteractive "$@"; }
install() { inside apt-get install -qq -y --no-install-recommends -o Dpkg::Use-Pty=0 "$@" >/dev/null; }
# absent PACKAGE...: what must not have come along.
absent() { for package in "$@"; do ! inside dpkg -s "$package" >/dev/null 2>&1 || { echo "$package came along"; exit 1; }; done; }
mkdir "$root/packages"
for deb in "$packages"/*.deb; do cp "$deb" "$root/packages/$(dpkg-deb --field "$deb" Package).deb"; done
cp -r tests/package/consumer tests/package/python_consumer.py tests/docs/video.cpp "$root"
version=$(sed -nE 's/^  VERSION (.*)/\1/p' CMakeLists.txt)
runtime=libasterism${version%.*}

# consume COMPONENTS: by CMake, and by pkg-config with the compiler alone.
consume() {
  rm -rf "$root/out"
  inside cmake -S /consumer -B /out -DCMAKE_PREFIX_PATH=/usr -DCOMPONENTS="$1" -DVERSION="$version" -DSOURCE=main.cpp
  inside cmake --build /out --target run
  local defines=() modules=()
  for component in ${1//,/ }; do defines+=("-DHAVE_${component^^}"); modules+=("asterism-$component"); done
  inside sh -c "g++ -std=c++20 -DVERSION='\"$version\"' ${defines[*]} /consumer/main.cpp -o /out/plain \
                \$(pkg-config --cflags --libs ${modules[*]}) && /out/plain"
}

# The programs.
install "/packages/$runtime.deb" /packages/asterism-tools.deb
inside asterism-track --version
inside asterism-trax --version

# The solver, where nothing of OpenCV, Ceres and SuiteSparse can be compiled against.
install /packages/libasterism-dev.deb g++ cmake make pkg-config
absent libopencv-dev libceres-dev libsuitesparse-dev libcholmod3 liblbfgs-dev nlohmann-json3-dev
consume solver,system,solver_compiled,batch

# Everything, and an object followed.
install libopencv-dev libsuitesparse-dev liblbfgs-dev
consume solver,batch,cholmod,lbfgs,json,parts,trackers
inside sh -c 'g++ -std=c++20 /video.cpp -o /out/video $(pkg-config --cflags --libs opencv4) && /out/video /out/video.avi'
inside asterism-track /out/video.avi --box 100,80,48,64 --tracker dpt --out /out/boxes.csv
[[ $(wc -l <"$root/out/boxes.csv") -gt 40 ]]

# The Python module: what it says, and a solve and an object followed.
install /packages/python3-asterism.deb
inside python3 /python_consumer.py
[[ -n $(find "$root/usr/lib/python3/dist-packages/asterism" -name '*.pyc') ]] || { echo "the module was not compiled"; exit 1; }

inside dpkg --verify "$runtime" libasterism-dev asterism-tools python3-asterism
inside apt-get purge -qq -y -o Dpkg::Use-Pty=0 "$runtime" >/dev/null
absent libasterism-dev asterism-tools python3-asterism
[[ -z $(find "$root/usr" "$root/etc" -iname '*asterism*') ]] || { echo "files are left behind"; exit 1; }
echo "the packages are content"
