#!/usr/bin/env bash
# Installs what a Debian 12 or Ubuntu 22.04+ machine with git and rustup still lacks; a second run changes nothing.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"
# shellcheck source=scripts/env.sh
source scripts/env.sh

say() { printf 'setup: %s\n' "$*"; }
fail() {
  printf 'setup: %s\n' "$*" >&2
  exit 1
}

packages=(
  gcc libc6-dev clang mold pkg-config                                            # compile and link
  libvulkan1 mesa-vulkan-drivers                                                 # render, in software too
  libx11-6 libx11-xcb1 libxcursor1 libxi6 libxrandr2 libxkbcommon-x11-0          # the window
  xvfb xauth                                                                     # the window's test
  python3 python3-venv ca-certificates                                           # ONNX Runtime's wheel, the tests' readers
)

install_packages() {
  command -v dpkg-query >/dev/null 2>&1 ||
    fail "this is not Debian or Ubuntu; install the equivalents of: ${packages[*]}"
  local installed missing=() package sudo=()
  # dpkg-query exits 1 when it knows nothing of some package: that is an answer, not a failure.
  installed=$(dpkg-query -W -f='${db:Status-Status} ${Package}\n' "${packages[@]}" 2>/dev/null || true)
  for package in "${packages[@]}"; do
    grep -qxF "installed $package" <<<"$installed" || missing+=("$package")
  done
  if ((${#missing[@]} == 0)); then
    say "system packages: already there"
    return
  fi
  if ((EUID != 0)); then
    command -v sudo >/dev/null 2>&1 ||
      fail "system packages are missing and there is no sudo; as root run: apt-get install ${missing[*]}"
    sudo=(sudo)
  fi
  say "system packages: installing ${missing[*]}"
  "${sudo[@]}" apt-get -qq update ||
    fail "apt-get update failed; mend the package sources or the network, then run ./setup.sh again"
  "${sudo[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends "${missing[@]}" ||
    fail "apt-get install failed; mend what it says above, then run ./setup.sh again"
}

check_rust() {
  command -v cargo >/dev/null 2>&1 || fail "cargo is missing; install Rust with rustup, then run ./setup.sh again"
  say "cargo: already there"
}

make_venv() {
  # A venv outlives the Python that it was made from: ask whether it still runs.
  if "$boresight_venv/bin/python" -c 'import pip' >/dev/null 2>&1; then
    say "Python environment: already there"
    return
  fi
  say "Python environment: making $boresight_venv"
  mkdir -p "$boresight_cache"
  python3 -m venv --clear "$boresight_venv" ||
    fail "python3 -m venv failed; install the venv package of the python3 first on PATH ($(command -v python3))"
}

install_onnxruntime() {
  if [[ -f $ORT_DYLIB_PATH ]]; then
    say "ONNX Runtime: already there ($ORT_DYLIB_PATH)"
    return
  fi
  [[ $ORT_DYLIB_PATH == "$boresight_ort_lib" ]] ||
    fail "ORT_DYLIB_PATH names a file that does not exist ($ORT_DYLIB_PATH); correct it or unset it"

  local machine sha256
  machine=$(uname -m)
  case $machine in
    x86_64) sha256=5752bd508126ae7c49894d3b9d2e83f0c3d487319246d04c444b393308d7ad7f ;;
    aarch64) sha256=da05378364c44d4407e463982d2bf8d5e4cfea873283757e48beeb41df97b7f3 ;;
    *) fail "no ONNX Runtime is pinned for $machine; build libonnxruntime.so $boresight_ort_version and set ORT_DYLIB_PATH to it" ;;
  esac

  local folder wheels
  folder=$(dirname "$boresight_ort_lib")
  mkdir -p "$folder"
  # In the same folder, so that the last move is a rename: the library is whole or absent.
  temporary=$(mktemp -d "$folder/.install.XXXXXX")
  trap 'rm -rf "$temporary"' EXIT
  say "ONNX Runtime: downloading $boresight_ort_version for $machine"
  # The wheel's tags are fixed, whatever Python runs here: only the library in it is used.
  "$boresight_venv/bin/python" -m pip download --quiet --disable-pip-version-check --no-deps --only-binary=:all: \
    --implementation cp --python-version 3.11 --abi cp311 --platform "manylinux_2_28_$machine" \
    --dest "$temporary" "onnxruntime==$boresight_ort_version" ||
    fail "the download failed; check the network and pip's index (pip config list), then run ./setup.sh again"
  wheels=("$temporary"/*.whl)
  sha256sum --check --status <<<"$sha256  ${wheels[0]}" ||
    fail "the wheel's SHA-256 is not the pinned one; check what pip's index serves for onnxruntime $boresight_ort_version"
  python3 - "${wheels[0]}" "onnxruntime/capi/libonnxruntime.so.$boresight_ort_version" "$temporary/library" <<'PYTHON' ||
import shutil, sys, zipfile
wheel, member, target = sys.argv[1:]
with zipfile.ZipFile(wheel) as archive, archive.open(member) as source, open(target, "wb") as out:
    shutil.copyfileobj(source, out)
PYTHON
    fail "the wheel could not be unpacked; free some disk space under $folder, then run ./setup.sh again"
  mv "$temporary/library" "$boresight_ort_lib"
  say "ONNX Runtime: installed as $boresight_ort_lib"
}

install_packages
check_rust
make_venv
install_onnxruntime
