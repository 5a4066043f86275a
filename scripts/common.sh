# SPDX-License-Identifier: Apache-2.0
# shellcheck shell=bash disable=SC2034
# What ./test and ./demo share: packages, the Python environment, the compiler cache. Sourced with the root of the tree
# as the working directory.

# Debian packages to build and run what users get …
build_packages=(ccache cmake gcc g++ ninja-build libasio-dev libcli11-dev libeigen3-dev libfmt-dev libgeographiclib-dev
  libgps-dev libprotobuf-dev libspdlog-dev nlohmann-json3-dev pkg-config protobuf-compiler)
# … regista-camera with it …
camera_packages=(libopencv-calib3d-dev libopencv-highgui-dev libopencv-imgcodecs-dev libopencv-imgproc-dev
  libopencv-videoio-dev)
# … the Python package, with the page of `regista teleop`. An npm of another source than Debian comes with its nodejs.
python_packages=(python3 python3-dev python3-venv)
command -v npm >/dev/null || python_packages+=(nodejs npm)
# … and those that only the checks need. libclang-rt-19-dev holds libFuzzer and the sanitizers of clang; user-mode-linux a
# kernel with CAN, for tests/vm/with-vcan.
test_packages=(shellcheck libbenchmark-dev libgtest-dev librapidcheck-dev clang-19 libclang-rt-19-dev user-mode-linux
  busybox-static iproute2 can-utils gpsd chromium nftables)

say() { printf '%s\n' "$*"; }

die() {
  printf '%s: %s\n' "$(basename "$0")" "$*" >&2
  exit 1
}

as_root() {
  if [[ $(id -u) -eq 0 ]]; then
    "$@"
  elif command -v sudo >/dev/null; then
    sudo "$@"
  else
    die "needs root to install packages, and sudo is missing. As root: $*"
  fi
}

# install_packages PACKAGE...: those that are not there yet.
install_packages() {
  command -v dpkg-query >/dev/null || die "this is not Debian; install yourself what these packages hold: $*"
  local package missing=()
  for package in "$@"; do
    [[ $(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null) == installed ]] || missing+=("$package")
  done
  ((${#missing[@]})) || return 0
  say "Installing with apt: ${missing[*]}"
  as_root apt-get update -qq
  as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
}

# The Python tools and libraries of the checks, pinned, in .venv. Made anew when the pins change.
install_venv() {
  local pins=tests/requirements.txt
  if cmp -s "$pins" .venv/requirements.txt; then return; fi
  say "Installing with pip into .venv: $(grep -v '^#' "$pins" | tr '\n' ' ')"
  rm -rf .venv
  /usr/bin/python3 -m venv .venv
  .venv/bin/pip install --quiet --disable-pip-version-check -r "$pins"
  cp "$pins" .venv/requirements.txt
}

# Presets that differ only in what they build share objects. CMake reads the variables when it configures a tree.
export CMAKE_C_COMPILER_LAUNCHER=ccache CMAKE_CXX_COMPILER_LAUNCHER=ccache
