# Shared by the commands in this folder: where the repository is, and its virtual environment .venv.
# Source it; it changes to the repository root and sets VENV_PYTHON once `ensure_venv` has run.
# shellcheck shell=bash

set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
ROOT=$PWD
VENV_PYTHON=$ROOT/.venv/bin/python
STAMP=$ROOT/.venv/.wrt-installed

# An environment that happens to be active must decide neither which Python is used nor where pip installs.
unset VIRTUAL_ENV PYTHONHOME PYTHONPATH PIP_TARGET PIP_PREFIX PIP_USER PIP_REQUIRE_VIRTUALENV

step() { printf '== %s\n' "$*"; }

fail() {
    printf '%s: error: %s\n' "$0" "$*" >&2
    exit 1
}

is_supported() { # PYTHON: whether it runs and is new enough
    "$1" -c 'import sys; sys.exit(sys.version_info < (3, 10))' >/dev/null 2>&1
}

can_make_venv() { # PYTHON: Debian packs the parts of venv apart
    "$1" -c 'import ensurepip, venv' >/dev/null 2>&1
}

find_python() { # prints the Python that .venv is made with
    local candidate found=
    if [[ -n ${PYTHON:-} ]]; then
        can_make_venv "$PYTHON" || fail "$PYTHON cannot make virtual environments:" \
            "on Debian and Ubuntu 'sudo apt-get install python3-venv' adds what is missing"
        printf '%s\n' "$PYTHON"
        return
    fi
    for candidate in python3 python3.13 python3.12 python3.11 python3.10 python; do
        is_supported "$candidate" || continue
        if can_make_venv "$candidate"; then
            printf '%s\n' "$candidate"
            return
        fi
        found=${found:-$candidate}
    done
    [[ -z $found ]] || fail "$found cannot make virtual environments:" \
        "on Debian and Ubuntu 'sudo apt-get install python3-venv' adds what is missing"
    fail "no Python 3.10 or newer found; install one, or name it: PYTHON=/path/to/python $0"
}

version_of() { "$1" -c 'import sys; print("%d.%d" % sys.version_info[:2])'; }

venv_is_usable() {
    is_supported "$VENV_PYTHON" && "$VENV_PYTHON" -m pip --version >/dev/null 2>&1 || return 1
    # One made by another Python than the one asked for is not what was asked for.
    [[ -z ${PYTHON:-} || $(version_of "$PYTHON") == "$(version_of "$VENV_PYTHON")" ]]
}

fingerprint() { # changes when what is installed, or where from, no longer fits
    "$VENV_PYTHON" - pyproject.toml wrt/_version.py <<'PY'
import hashlib, os, sys

digest = hashlib.sha256(f"{os.getcwd()}\n{sys.version}".encode())
for path in sys.argv[1:]:
    digest.update(open(path, "rb").read())
print(digest.hexdigest())
PY
}

ensure_venv() { # [test]: makes .venv and installs wrt into it, with the test tools if asked, where needed
    local extra=${1:-plain} python now
    if [[ -n ${PYTHON:-} ]]; then
        is_supported "$PYTHON" || fail "PYTHON=$PYTHON does not run, or is older than Python 3.10"
    fi
    if ! venv_is_usable; then
        python=$(find_python)
        # Only what is plainly a virtual environment is ever deleted.
        if [[ -e .venv || -L .venv ]]; then
            [[ -f .venv/pyvenv.cfg ]] || fail ".venv is not a virtual environment; move it away and run this again"
            step "removing .venv, which is broken or of another Python"
            rm -rf .venv
        fi
        step "making .venv with $python (Python $(version_of "$python"))"
        "$python" -m venv .venv || {
            rm -rf .venv
            fail "$python -m venv failed: on Debian and Ubuntu try 'sudo apt-get install python3-venv'"
        }
    fi
    now=$(fingerprint)
    if [[ -f $STAMP && $(<"$STAMP") == "$now test" ]]; then return; fi
    if [[ -f $STAMP && $(<"$STAMP") == "$now $extra" ]]; then return; fi
    # A later `scripts/demo` must not forget that the test tools are there.
    if [[ -f $STAMP && $(<"$STAMP") == *" test" ]]; then extra="test"; fi
    rm -f "$STAMP"
    local target=.
    if [[ $extra == test ]]; then target=".[test]"; fi
    step "installing wrt into .venv: pip install -e '$target' (a minute or two the first time)"
    # Python compiles what it imports; compiling all that the test tools bring takes a third of the time.
    "$VENV_PYTHON" -m pip install --quiet --disable-pip-version-check --no-compile -e "$target" ||
        fail "pip could not install wrt; it needs the network once"
    printf '%s %s\n' "$now" "$extra" >"$STAMP"
}
