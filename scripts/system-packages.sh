#!/usr/bin/env bash
# Installs the system packages that building and testing need and this machine lacks, where that
# can be done: as root, with apt. Elsewhere it says in one line what is missing.
#   system-packages.sh [browser]   with the browser in which the tests open pages
set -euo pipefail

python=${PYTHON:-python3}
missing=()
command -v make >/dev/null || missing+=(make)
command -v c++ >/dev/null || missing+=(g++)
if ! command -v "$python" >/dev/null; then
    missing+=(python3 python3-venv python3-dev)
else
    "$python" -c 'import ensurepip, venv' 2>/dev/null || missing+=(python3-venv)
    headers=$("$python" -c 'import sysconfig; print(sysconfig.get_path("include"))')
    [ -e "$headers/Python.h" ] || missing+=(python3-dev)
fi
if [ "${1:-}" = browser ]; then
    command -v chromium >/dev/null || missing+=(chromium)
fi
[ ${#missing[@]} -eq 0 ] && exit 0

if [ "$(id -u)" -eq 0 ] && command -v apt-get >/dev/null; then
    echo "Installing ${missing[*]} ..." >&2
    export DEBIAN_FRONTEND=noninteractive
    apt-get update -qq
    apt-get install -qq -y --no-install-recommends "${missing[@]}" >/dev/null
else
    echo "Missing on this machine: ${missing[*]}; try: sudo apt-get install ${missing[*]}" >&2
    exit 1
fi
