# shellcheck shell=bash
# Sourced by demo and test. `prepare demo|view|grasp|test` leaves in $python an interpreter that has ROS 2 and hand_tracker:
# that of a sourced ROS 2, else one in .venv made from requirements/ and overlay/.

root=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
venv=$root/.venv
stamps=$venv
log=$stamps/setup.log

prepare() {
  if ros_is_sourced; then
    use_sourced_ros "$1"
  else
    leave_other_environments
    lock
    install_requirements "$1"
    install_overlay "$1"
    install_package
    python=$venv/bin/python
    export PATH=$venv/bin:$PATH AMENT_PREFIX_PATH=$venv
  fi
  [[ $1 != view ]] || warm_up
  unlock
  isolate_discovery
}

say() { printf '%s\n' "$*" >&2; }

fail() {
  printf 'Set-up failed: %s\n' "$@" >&2
  exit 1
}

# --- with ROS 2 ---------------------------------------------------------------------------------------------------

ros_is_sourced() {
  [[ -n ${ROS_DISTRO:-} ]] || return
  python3 -c 'import rclpy' 2>/dev/null && return
  say "ROS $ROS_DISTRO is sourced, but python3 cannot import its rclpy: using .venv instead."
  return 1
}

use_sourced_ros() {
  # Without tf2_msgs and rosbag2_interfaces all works but /tf and the replay's services.
  local modules=(matplotlib numpy PIL rosbags scipy yaml)
  case $1 in
    view) modules+=(skimage trimesh viser) ;;
    grasp) modules+=(mujoco) ;;
    test) modules+=(hypothesis pytest pytest_timeout) ;;
  esac
  python=python3
  # Nothing is set up in the checkout: kernels and skin are kept in the user's cache.
  stamps=${XDG_CACHE_HOME:-${HOME:-~}/.cache}/hand_tracker
  log=$stamps/setup.log
  # The checkout comes before an installed hand_tracker, so that edits take effect.
  export PYTHONPATH=$root${PYTHONPATH:+:$PYTHONPATH}
  local missing name by_pip=
  missing=$("$python" - "${modules[@]}" <<'PYTHON'
import importlib.util
import sys

print(*[name for name in sys.argv[1:] if importlib.util.find_spec(name) is None])
PYTHON
  )
  # These have no rosdep key.
  for name in viser mujoco; do
    [[ $missing != *$name* ]] || by_pip="
  python3 -m pip install $name"
  done
  [[ -z $missing ]] || fail "Python modules are missing: $missing. Get them with
  rosdep install --from-paths '$root' --ignore-src -y$by_pip"
}

# --- without ROS 2 ------------------------------------------------------------------------------------------------

# Settings of another ROS, or of other ROS wheels, make the wheels load the wrong libraries.
leave_other_environments() {
  unset AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH PYTHONHOME PYTHONPATH \
    RMW_IMPLEMENTATION ROS_DISTRO _ROS_WHEELS_BOOTSTRAP_COMPLETE
  export PYTHONNOUSERSITE=1
}

lock() {
  command -v flock >/dev/null || return 0
  exec {lock_file}<"$root/scripts/environment.sh"
  flock --nonblock "$lock_file" && return
  say "Another set-up is at work here; waiting for it."
  flock "$lock_file"
}

unlock() {
  [[ -z ${lock_file:-} ]] || exec {lock_file}<&-
}

# A step that was done leaves a stamp with the fingerprint of all that it was made from.
fingerprint() { { printf '%s\n' "$root" "${PYTHON:-}" && cat -- "$@"; } | sha256sum | cut -c -32; }
contents() { find "$@" | sort | while IFS= read -r file; do cat "$file"; done; }
is_done() { [[ -e $stamps/$1.stamp && $(<"$stamps/$1.stamp") == "$2" ]]; }
mark_done() { printf '%s\n' "$2" > "$stamps/$1.stamp"; }

# Runs a command with its output in the log.
step() {
  local title=$1 start=$SECONDS
  shift
  printf '  %s ... ' "$title" >&2
  if "$@" >>"$log" 2>&1; then
    printf '%d s\n' $((SECONDS - start)) >&2
  else
    printf 'failed\n' >&2
    return 1
  fi
}

install_requirements() {
  local demo wanted
  demo=$(fingerprint "$root/requirements/demo.txt")
  wanted=$(fingerprint "$root/requirements/$1.txt")
  if ! is_done demo "$demo" || [[ -e $venv/unfinished ]] || ! "$venv/bin/python" -c 'import rclpy' 2>/dev/null; then
    say "No ROS 2 is sourced: setting up one of its own in $venv (once, one to three minutes; longer on a busy machine)."
    make_venv
  fi
  is_done "$1" "$wanted" && return
  touch "$venv/unfinished"
  # Python compiles at first import what is used; compiling all here takes longer.
  step "installing requirements/$1.txt" "$venv/bin/python" -m pip --disable-pip-version-check --retries 2 \
    install --no-deps --no-compile -r "$root/requirements/$1.txt" || explain_pip
  mark_done demo "$demo"
  mark_done "$1" "$wanted"
  rm "$venv/unfinished"
}

make_venv() {
  local interpreter
  # The first thing that a set-up leaves is its log.
  [[ ! -e $venv || -e $log ]] || fail "$venv is not of this script's making, and is left as it is.
  Move it away, or delete it, and run this again."
  interpreter=$(find_python)
  rm -rf "$venv"
  mkdir -p "$venv"
  step "making ${venv#"$root/"} with $interpreter" "$interpreter" -m venv "$venv" || fail "see $log"
}

find_python() {
  local candidate without_venv=
  for candidate in ${PYTHON:+"$PYTHON"} python3 python3.12 python3.13 python3.11 python3.10 python3.14; do
    "$candidate" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 14))' 2>/dev/null || continue
    if "$candidate" -c 'import ensurepip, venv' 2>/dev/null; then
      command -v "$candidate"
      return
    fi
    without_venv=$candidate
  done
  [[ -z $without_venv ]] || fail "$without_venv has no venv module. On Debian and Ubuntu: sudo apt install python3-venv"
  fail "no Python 3.10 to 3.14 on the PATH. On Debian and Ubuntu: sudo apt install python3 python3-venv;
  or name one: PYTHON=/path/to/python3.12 $0"
}

explain_pip() {
  if grep -q 'No space left' "$log"; then
    fail "the disk is full (.venv takes 1.5 GB). The log: $log"
  elif grep -qE 'NewConnection|NameResolution|ConnectionError|ConnectTimeout|ReadTimeout|ProxyError|SSLError' "$log"; then
    fail "pip cannot reach its package index. Is there a network? Run this again when there is. The log: $log"
  fi
  tail -n 5 "$log" >&2
  fail "pip could not install the requirements. The log: $log"
}

# Without the overlay all works but /tf and the replay's services, so that its lack is printed, not fatal.
# The tests also need the messages of other systems' drivers.
install_overlay() {
  local sources lack stamp=overlay
  [[ $1 != test ]] || stamp=overlay_of_tests
  sources=$(contents "$root/overlay" -type f | fingerprint -)
  is_done "$stamp" "$sources" && return
  if lack=$(overlay_lacks); then
    say "No /tf and no replay services, all else works: $lack."
  elif step "building overlay/ (/tf and the replay services)" "$root/overlay/build" "$venv" "$1"; then
    mark_done overlay "$sources"
    mark_done "$stamp" "$sources"
  else
    say "No /tf and no replay services, all else works: overlay/ did not build. The log: $log"
  fi
}

# Succeeds, and says what, when something is missing to build the overlay.
overlay_lacks() {
  local compiler
  compiler=$(command -v "${CXX:-c++}" || command -v g++ || command -v clang++) || compiler=
  if [[ -z $compiler ]]; then
    echo "there is no C++ compiler. On Debian and Ubuntu: sudo apt install g++"
  elif ! "$venv/bin/python" -c 'import os, sysconfig; os.stat(sysconfig.get_path("include") + "/Python.h")' 2>/dev/null; then
    echo "Python's headers are missing. On Debian and Ubuntu: sudo apt install python3-dev"
  else
    return 1
  fi
}

install_package() {
  local sources
  sources=$(fingerprint "$root/package.xml" "$root"/{pyproject.toml,setup.py,setup.cfg})
  is_done package "$sources" && return
  step "installing hand_tracker (editable)" "$venv/bin/python" -m pip --disable-pip-version-check \
    install --no-deps --no-build-isolation -e "$root" || fail "see $log"
  mark_done package "$sources"
}

# So that the hand moves as soon as the page is there.
warm_up() {
  local sources
  sources=$(contents "$root"/hand_tracker/{core,skin} -name '*.py' | fingerprint -)
  is_done view_ready "$sources" && return
  mkdir -p "$stamps"
  # Not a step: it shows itself how far it is.
  "$python" -c 'from hand_tracker.cli.view import warm_up; warm_up()' >&2 || fail "see above"
  mark_done view_ready "$sources"
}

# --- tools that need neither ROS 2 nor the package -------------------------------------------------------------------

# Leaves in $tools the folder of the programs of requirements/$1.txt, in an environment of their own.
prepare_tools() {
  venv=$root/.tools/$1
  tools=$venv/bin
  stamps=$venv
  log=$venv/setup.log
  local wanted
  wanted=$(fingerprint "$root/requirements/$1.txt")
  is_done "$1" "$wanted" && return
  make_venv
  step "installing requirements/$1.txt" "$tools/python" -m pip --disable-pip-version-check --retries 2 \
    install --no-deps --no-compile -r "$root/requirements/$1.txt" || explain_pip
  mark_done "$1" "$wanted"
}

# --- both ---------------------------------------------------------------------------------------------------------

# Other machines, and other runs on this one, neither hear nor disturb this run.
isolate_discovery() {
  export ROS_DOMAIN_ID=${ROS_DOMAIN_ID:-$(free_domain)}
  if [[ ${ROS_DISTRO:-} == humble ]]; then
    export ROS_LOCALHOST_ONLY=${ROS_LOCALHOST_ONLY:-1}
  else
    export ROS_AUTOMATIC_DISCOVERY_RANGE=${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}
  fi
}

# Prints a DDS domain in which nobody on this machine has a port.
free_domain() {
  "$python" - $$ <<'PYTHON'
import contextlib
import random
import socket
import sys

for domain in random.Random(int(sys.argv[1])).sample(range(1, 101), 100):
    with contextlib.ExitStack() as free, contextlib.suppress(OSError):
        for port in range(7400 + 250 * domain, 7650 + 250 * domain):
            free.enter_context(socket.socket(type=socket.SOCK_DGRAM)).bind(('', port))
        break
print(domain)
PYTHON
}
