# Shared by tools/quickstart, tools/package and tools/check; sourced by bash.
# shellcheck shell=bash

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)

# say WHAT: prints what begins now, and the time since the start.
say() { printf '\n== %s (at %d:%02d min)\n' "$*" $((SECONDS / 60)) $((SECONDS % 60)); }
die() {
  printf '%s: %s\n' "$(basename "$0")" "$*" >&2
  exit 1
}

# usage: prints the script's head comment and exits.
usage() {
  sed -n '2,/^[^#]/s/^# \{0,1\}//p' "$0" >&2
  exit 2
}

# as_root COMMAND...: runs it as root, through sudo if necessary.
as_root() {
  if [ "$(id -u)" -eq 0 ]; then
    "$@"
  elif command -v sudo >/dev/null 2>&1; then
    sudo "$@"
  else
    return 127
  fi
}

# quietly WHAT COMMAND...: runs it; shows its output only if it fails.
quietly() {
  local what=$1 log
  shift
  log=$(mktemp) || die "there is no folder for temporary files: set TMPDIR to one"
  "$@" >"$log" 2>&1 || {
    tail -20 "$log" >&2
    die "$what failed; the whole output is in $log"
  }
  rm -f "$log"
}

# cache_folder: folder for results that take long to make.
cache_folder() { echo "${BOLO_CACHE:-${XDG_CACHE_HOME:-${HOME:-/var/tmp}/.cache}/bolo}"; }

# packages_of GROUP...: Debian packages of these groups in tools/packages.txt.
packages_of() {
  local group package
  while read -r group package _; do
    case " $* " in *" $group "*) echo "$package" ;; esac
  done < <(sed 's/#.*//' "$root/tools/packages.txt")
}

# install_packages GROUP...: installs the missing ones of these.
install_packages() {
  local wanted=() missing=() package
  mapfile -t wanted < <(packages_of "$@")
  for package in "${wanted[@]}"; do
    [ "$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null)" = installed ] || missing+=("$package")
  done
  if [ ${#missing[@]} -eq 0 ]; then
    echo "all ${#wanted[@]} Debian packages are installed"
    return
  fi
  echo "installing ${#missing[@]} of ${#wanted[@]} Debian packages: ${missing[*]}"
  command -v apt-get >/dev/null 2>&1 || die "apt-get is missing: this script is made for Debian 12"
  as_root apt-get update -qq || die "cannot run apt-get update as root: run as root or install sudo"
  quietly "apt-get install" \
    as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}"
}

# build PRESET [TARGET...]. With ccache, objects of the same code are reused from earlier builds, wherever the project
# was located.
build() {
  local preset=$1 cache=() alone sysroot
  shift
  if command -v ccache >/dev/null 2>&1; then
    export CCACHE_BASEDIR=$root CCACHE_NOHASHDIR=1 CCACHE_SLOPPINESS=pch_defines,time_macros
    cache=(-DCMAKE_C_COMPILER_LAUNCHER=ccache -DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
  fi
  if [ "$preset" = arm64 ]; then
    sysroot=$("$root/tools/lib/sysroot")
    cache+=("-DCMAKE_SYSROOT=$sysroot")
  fi
  mkdir -p "$root/build"
  alone=(flock --close "$root/build/$preset.lock") # two builds in one folder would corrupt each other
  quietly "configuring the preset '$preset'" \
    "${alone[@]}" cmake -S "$root" --preset "$preset" -DBOLO_UNITY=ON "${cache[@]}"
  "${alone[@]}" ninja -C "$root/build/$preset" -j "$(nproc)" "$@" || die "building the preset '$preset' failed"
}
