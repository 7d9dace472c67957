#!/usr/bin/env bash
# Makes or completes the project's environment in .venv, in steps that add to each other:
#   run    the package, built, with what the demo needs
#   test   what the checks need
#   peers  the packages that benchmarks compare with
set -euo pipefail
cd "$(dirname "$0")/.."

find_python() {
    local candidate
    for candidate in ${PYTHON:-python3 python3.14 python3.13 python3.12 python3.11}; do
        if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            echo "$candidate"
            return
        fi
    done
    echo "No Python >= 3.11 found; install one, or name it: make demo PYTHON=/path/to/python" >&2
    return 1
}

pip() {
    .venv/bin/python -m pip --disable-pip-version-check --quiet "$@"
}

case "$1" in
run)
    if [ ! -x .venv/bin/pip ]; then
        python=$(find_python)
        PYTHON=$python scripts/system-packages.sh
        echo "Making the environment in .venv ..." >&2
        rm -rf .venv
        "$python" -m venv .venv
    fi
    echo "Building trackfield and installing what it needs ..." >&2
    pip install --editable ".[recorded,plot]"
    ;;
test)
    echo "Installing what the checks need ..." >&2
    pip install --upgrade "pip>=25.1" # the first that reads dependency groups
    pip install "trackfield[data]" --group test --group lint --group docs
    ;;
peers)
    echo "Installing the packages that benchmarks compare with ..." >&2
    pip install --group peers
    ;;
*)
    echo "environment.sh: '$1' is no step; expected run, test or peers" >&2
    exit 2
    ;;
esac
