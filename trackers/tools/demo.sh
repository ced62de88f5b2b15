#!/usr/bin/env bash
# Builds asterism-track and follows a pedestrian with it; for Debian 12, as root or with sudo.
#
# The video is vtest.avi of Debian's package opencv-doc: people on a campus crossing, seen from above. The object is the
# man in the dark leather jacket with a grey hood lying on its shoulders, a roll of white paper in his hand. From frame
# 244 he walks from the right towards the lamp post; in frames 277 to 283 the post cuts him in two from neck to foot and
# its sign hides his head. At the left he turns around (frames 314 to 322, his face is seen now) and comes back, again
# behind post and sign in frames 354 to 359, and is in full view to the last frame, 376.
set -euo pipefail

start=244 frames=133 box=641,264,42,108

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)
build=$root/build/demo
data=$build/data
out=$build/out

fail() { echo "demo: $*" >&2; exit 1; }
as_root() {
  if [[ $(id -u) == 0 ]]; then "$@"; else sudo "$@"; fi
}

# Downloads the package without installing it: only this file is needed, and some systems skip documentation
# on installation.
fetch_video() {
  command -v apt-get >/dev/null || fail "vtest.avi comes from a Debian package: without apt, put it into $data"
  # As root, apt would switch to a user that may not be allowed to write here, and warn.
  local download=(apt-get -q -o APT::Sandbox::User=root download opencv-doc)
  echo "fetching the video (Debian package opencv-doc, about 95 MB)"
  work=$(mktemp -d -p "$data")
  trap 'rm -rf "$work"' EXIT  # so that an interrupted download leaves nothing behind
  cd "$work"
  if ! "${download[@]}" >/dev/null 2>&1; then
    as_root apt-get update -qq
    "${download[@]}" >/dev/null
  fi
  dpkg-deb --fsys-tarfile opencv-doc_*.deb |
    tar -x --wildcards --transform 's,.*/,,' '*/examples/data/vtest.avi*'
  if [[ -e vtest.avi.gz ]]; then gunzip vtest.avi.gz; fi
  mv vtest.avi "$data/"
  cd "$root"
}

cd "$root"
mkdir -p "$data" "$out"
if command -v dpkg-query >/dev/null; then "$root/.ci/install-packages" tool; fi

cmake -S "$root" -B "$build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DASTERISM_BUILD_TESTS=OFF \
  -DASTERISM_BUILD_BENCH=OFF -DASTERISM_WITH_CHOLMOD=OFF -DASTERISM_WITH_CERES=OFF >"$build/configure.log" 2>&1 ||
  { cat "$build/configure.log" >&2; fail "cmake failed"; }
cmake --build "$build" --target asterism_track
if [[ ! -e $data/vtest.avi ]]; then fetch_video; fi

"$build/trackers/tools/asterism-track" "$data/vtest.avi" --start $start --frames $frames --box $box \
  --out "$out/boxes.csv" --save "$out/overlay.mp4" --sheet "$out/sheet.png" "$@"

cat <<EOF
boxes          $out/boxes.csv
overlay video  $out/overlay.mp4
contact sheet  $out/sheet.png
EOF
