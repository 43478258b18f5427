# shellcheck shell=bash disable=SC2154
# Functions shared by the scripts of this folder, which source this file with `root` set to the top of the sources.

build_dir="$root/build"
devel_dir="$root/devel"
build_options=()  # additional options of CMake
testing=OFF         # ON: install the packages for tests, and configure the tests
packaging=OFF       # ON: install the packages for scripts/package
crossing=OFF        # ON: install the packages for scripts/arm64

# The comment at the head of the script.
usage() { sed -n '2,/^set /s/^# \{0,1\}//p' "$0"; }
for option in "$@"; do
  case "$option" in -h | --help) usage; exit 0 ;; esac
done

say() { printf '%s\n' "$*" >&2; }
fail() { say "$(basename "$0"): $*"; exit 1; }

# A different python3, earlier on PATH or in a virtual environment, does not have the Python modules of ROS.
use_system_python() {
  export PATH=/usr/bin:/bin:/usr/sbin:/sbin
  unset PYTHONPATH PYTHONHOME VIRTUAL_ENV
}

# ROS, ccache and rviz write files to the home folder. If there is none, they write to the build folder.
use_some_home() {
  if [[ -z ${HOME:-} || ! -w ${HOME:-} ]]; then
    export HOME="$build_dir/home" ROS_HOME="$build_dir/ros_home"
    mkdir -p "$HOME" "$ROS_HOME"
  fi
}

# In containers the host name may not resolve, and in minimal ones not even localhost, without which roslaunch does not
# run.
use_localhost() {
  if ! getent hosts localhost >/dev/null && may_be_root; then
    say "localhost does not resolve: adding it to /etc/hosts"
    printf '127.0.0.1 localhost\n' | as_root tee -a /etc/hosts >/dev/null
  fi
  if [[ -z ${ROS_IP:-} ]]; then export ROS_HOSTNAME="${ROS_HOSTNAME:-localhost}"; fi
}

# The setup files of ROS read variables that may be unset.
source_ros() {
  set +u
  # shellcheck disable=SC1090
  source "$1"
  set -u
}

codename() { (. /etc/os-release && printf '%s' "${VERSION_CODENAME:-unnamed}"); }

# Debian includes ROS; Ubuntu 20.04 gets Noetic from packages.ros.org, 22.04 and 24.04 get ROS-O from its own archive.
ros_release() {
  case "$(codename)" in
    focal) printf noetic ;;
    jammy | noble) printf one ;;
    *) printf debian ;;
  esac
}

wanted_packages() {
  local release uses=""
  release="$(ros_release)"
  [[ $testing == OFF ]] || uses+="|-tests"
  [[ $packaging == OFF ]] || uses+="|-package"
  [[ $crossing == OFF ]] || uses+="|-arm64"
  local releases="all|$release|$(codename)"
  [[ $release == debian ]] || releases+="|ubuntu"
  sed -n -E "s/^($releases)($uses): *//p" "$root/scripts/packages.txt" | sed "s/ros-RELEASE-/ros-$release-/g"
}

may_be_root() { ((EUID == 0)) || command -v sudo >/dev/null; }

# as_root COMMAND...
as_root() {
  if ((EUID == 0)); then "$@"; else sudo "$@"; fi
}

missing_packages() {
  local package
  local -A installed=()
  # shellcheck disable=SC2016,SC2046
  while read -r package; do
    installed["$package"]=1
  done < <(dpkg-query -W -f='${db:Status-Status} ${Package}\n' $(wanted_packages) 2>/dev/null |
    sed -n 's/^installed //p')
  for package in $(wanted_packages); do
    [[ -n ${installed["$package"]:-} ]] || printf '%s\n' "$package"
  done
}

apt=(env DEBIAN_FRONTEND=noninteractive apt-get -y -o DPkg::Lock::Timeout=600 -o Dpkg::Options::=--force-unsafe-io)

install_missing() {
  local -a missing
  mapfile -t missing < <(missing_packages)
  ((${#missing[@]})) || return 0
  command -v apt-get >/dev/null || fail "apt-get is not available; install these packages: ${missing[*]}"
  may_be_root || fail "needs root or sudo to install packages; run as root: apt-get install ${missing[*]}"
  say "installing ${#missing[@]} packages: ${missing[*]}"
  # The existing package lists may suffice if they cannot be updated: the install decides.
  as_root "${apt[@]}" update >&2 || say "apt-get update failed; continuing with the existing package lists"
  as_root "${apt[@]}" install --no-install-recommends "${missing[@]}" >&2 ||
    fail "apt-get could not install the packages; on Ubuntu, check that the packages of ROS are among the apt sources"
}

# Each compiler process takes up to 1.2 GB.
jobs() {
  local cores memory_kb
  cores="$(nproc)"
  memory_kb="$(awk '/^MemAvailable/ {print $2}' /proc/meminfo)"
  local fitting=$((memory_kb / 1200000))
  printf '%d' $((fitting < 1 ? 1 : fitting < cores ? fitting : cores))
}

# in_clean_environment COMMAND...: runs it with the variables listed here and no others, so that the result does not depend
# on the caller's environment.
in_clean_environment() {
  local -a variables=(PATH=/usr/bin:/bin:/usr/sbin:/sbin)
  local name
  for name in HOME ROS_HOME ROS_HOSTNAME ROS_IP TMPDIR TERM ASAN_OPTIONS UBSAN_OPTIONS HELIX_ARM_TEST_SIZE; do
    [[ -z ${!name:-} ]] || variables+=("$name=${!name}")
  done
  env -i "${variables[@]}" "$@"
}

# Value of an entry of CMake's cache; empty if there is none.
cached() { sed -n "s/^$1:[A-Z]*=//p" "$build_dir/CMakeCache.txt" 2>/dev/null || true; }

# build TARGET...
build() {
  [[ $(ros_release) == debian ]] || source_ros "/opt/ros/$(ros_release)/setup.bash"
  [[ -z ${HELIX_ARM_WERROR:-} ]] || build_options+=("-DHELIX_ARM_WERROR=$HELIX_ARM_WERROR")
  # A build folder that was copied together with its sources still refers to the original location.
  local built_for
  built_for="$(cached CMAKE_HOME_DIRECTORY)"
  if [[ -n $built_for && $built_for != "$root" ]]; then
    say "$build_dir was made for $built_for: rebuilding from scratch"
    rm -rf "$build_dir" "$devel_dir"
    use_some_home
  fi
  local -a generator=() launcher=(-DCMAKE_CXX_COMPILER_LAUNCHER=)
  [[ -n $(cached CMAKE_GENERATOR) ]] || generator=(-G Ninja)
  if command -v ccache >/dev/null; then
    launcher=(-DCMAKE_CXX_COMPILER_LAUNCHER=ccache)
    export CCACHE_BASEDIR="$root" CCACHE_NOHASHDIR=1  # checkouts share their cached objects
  fi
  cmake -S "$root" -B "$build_dir" "${generator[@]}" -DCMAKE_BUILD_TYPE=Release \
    -DCATKIN_ENABLE_TESTING="$testing" "${launcher[@]}" "${build_options[@]}" >&2
  cmake --build "$build_dir" -j "$(jobs)" --target "$@" 2>&1 | tell_progress >&2
}

# Prints how far ninja is every ten seconds, with an estimate, and passes on whatever is no progress.
tell_progress() {
  local begun=$SECONDS told=$SECONDS done=0 all=0 partial="" line code
  while true; do
    code=0
    IFS= read -r -t 1 line || code=$?
    line="$partial$line" partial=""
    if ((code > 128)); then  # a second has passed, perhaps within a line
      partial="$line"
    elif [[ $line =~ ^\[([0-9]+)/([0-9]+)\] ]]; then
      done="${BASH_REMATCH[1]}" all="${BASH_REMATCH[2]}"
    elif ((code == 0)); then
      printf '%s\n' "$line"
    fi
    ((code == 0 || code > 128)) || break
    ((SECONDS - told >= 10 && done > 0)) || continue
    told=$SECONDS
    local passed=$((SECONDS - begun))
    printf 'built %d of %d steps in %d s; about %d s left\n' "$done" "$all" "$passed" $((passed * (all - done) / done))
  done
}

# prepare [tests]
prepare() {
  # Once tests are configured, they stay configured: alternating would reconfigure each time.
  [[ ${1:-} != tests && $(cached CATKIN_ENABLE_TESTING) != ON ]] || testing=ON
  use_system_python
  mkdir -p "$build_dir"
  use_some_home
  use_localhost
  install_missing
}
