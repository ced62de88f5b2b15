#!/usr/bin/env bash
# Runs the README's two commands in a fresh Debian 12 that holds only git and a clone of the last commit, and
# reports how long each took. Needs root and debootstrap, and takes an hour or more: downloads, and builds
# without a cache.
#
#   bash tests/newcomer.sh [FOLDER]      keeps the system in FOLDER, or reuses the one there; by default it is removed
#
# MIRROR in the environment names another mirror of Debian.
set -euo pipefail
cd "$(dirname "$0")/.."

root=${1:-$(mktemp -d)}
mounted=()
clean() {
  for each in "${mounted[@]}"; do umount -R "$each"; done
  [[ -n ${kept:-} ]] || rm -rf --one-file-system "$root"
}
[[ $# == 0 ]] || kept=1
trap clean EXIT
[[ -e $root/usr/bin/git ]] ||
  debootstrap --variant=minbase --include=ca-certificates,git bookworm "$root" "${MIRROR:-http://deb.debian.org/debian}" >/dev/null
for each in proc dev; do
  mount --rbind --make-rslave "/$each" "$root/$each"
  mounted+=("$root/$each")
done
inside() { chroot "$root" env -i HOME=/root PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin "$@"; }

git bundle create -q "$root/asterism.bundle" HEAD
rm -rf "$root/root/asterism"
inside git clone -q /asterism.bundle /root/asterism
mapfile -t commands < <(sed -n '/^## Try it/,/^## /{/^bash /p}' README.md)
[[ ${#commands[@]} == 2 ]] || { echo "the README has not two commands" >&2; exit 1; }
for command in "${commands[@]}"; do
  echo "== $command"
  start=$SECONDS
  inside bash -c "cd /root/asterism && $command"
  times+=("$((SECONDS - start)) s: $command")
done
printf '%s\n' "${times[@]}"
