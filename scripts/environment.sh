# Makes .venv with the package in it. Sourced by scripts/demo and scripts/test; needs Python 3.11 or newer, and pip.
# usage: prepare_environment "" | "test"        (the extra to install; everything is kept when nothing has changed)

prepare_environment() {
  local extra="$1" root python="" candidate wanted
  root="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)" || return 1
  cd "$root" || return 1
  for candidate in "${PYTHON:-}" python3.13 python3.12 python3.11 python3 python; do
    [ -n "$candidate" ] && command -v "$candidate" >/dev/null 2>&1 || continue
    if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
      python="$candidate"
      break
    fi
  done
  if [ -z "$python" ]; then
    echo "error: Python 3.11 or newer was not found; install it, or name it: PYTHON=/path/to/python3 $0" >&2
    return 1
  fi
  # a stamp says what the environment was made from, so that a second call is quick; 'test' holds all that '' does
  wanted="$(cat pyproject.toml scripts/environment.sh | cksum) $root"
  if [ -f ".venv/made-$extra" ] && [ "$(cat ".venv/made-$extra")" = "$wanted" ]; then return 0; fi
  if [ -z "$extra" ] && [ -f .venv/made-test ] && [ "$(cat .venv/made-test)" = "$wanted" ]; then return 0; fi
  echo "setting up .venv (a minute or two, once)" >&2
  if ! .venv/bin/python -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
    if ! "$python" -m venv --clear .venv; then
      echo "error: $python -m venv failed; on Debian and Ubuntu: apt-get install python3-venv" >&2
      return 1
    fi
  fi
  if ! .venv/bin/python -m pip install --quiet --disable-pip-version-check --editable ".${extra:+[$extra]}"; then
    echo "error: pip could not install the package; is there a network, and room on the disk?" >&2
    return 1
  fi
  echo "$wanted" >".venv/made-$extra"
}
