#!/usr/bin/env bash
# Everything that Lightproof needs, installed once and never twice.   tools/setup.sh [test]
#
# .venv with the locked packages, an LLVM that Dr.Jit can use and, for tests, a browser. Says nothing
# when nothing is missing. Exit code 2 where something must be installed by hand: the last line names
# the command.
set -euo pipefail
cd "$(dirname "$0")/.."

stop() {
    echo "lightproof: $*" >&2
    exit 2
}

as_root() { # run a command as root, or fail at once where that needs a password
    if [ "$(id -u)" = 0 ]; then "$@"; else sudo -n "$@"; fi
}

apt_install() { # install packages quietly; fails where this user or this system cannot
    command -v apt-get >/dev/null || return 1
    as_root true 2>/dev/null || return 1
    echo "lightproof: installing $* with apt-get" >&2
    as_root apt-get update -qq >/dev/null || return 1
    as_root env DEBIAN_FRONTEND=noninteractive apt-get install -qq -y --no-install-recommends "$@" >/dev/null
}

by_hand() { # the same command for a person to type
    if [ "$(id -u)" = 0 ]; then
        echo "apt-get update && apt-get install -y $*"
    else
        echo "sudo apt-get update && sudo apt-get install -y $*"
    fi
}

find_python() { # the first Python on the path that is new enough
    local name
    for name in "${PYTHON:-python3}" python3 python3.13 python3.12 python3.11 python3.10; do
        if "$name" -c 'import sys; sys.exit(sys.version_info < (3, 10))' 2>/dev/null; then
            command -v "$name"
            return
        fi
    done
    return 1
}

make_venv() {
    local python version
    python=$(find_python) ||
        stop "needs Python 3.10 or newer, found $(python3 --version 2>/dev/null || echo none):" \
            "install one and name it, for example make PYTHON=python3.12"
    version=$("$python" -c 'import sys; print("{}.{}".format(*sys.version_info))')
    "$python" -c 'import ensurepip, venv' 2>/dev/null || apt_install "python$version-venv" ||
        stop "Python $version cannot make virtual environments: run $(by_hand "python$version-venv")"
    rm -rf .venv
    "$python" -m venv .venv || stop "could not make .venv with $python"
}

wanted() { pwd; cat requirements.lock pyproject.toml; } # what an installed .venv was made from

packages() {
    local stamp=.venv/installed
    wanted | cmp -s - $stamp && .venv/bin/python -c '' 2>/dev/null && return
    if [ "$(head -n 1 $stamp 2>/dev/null || pwd)" != "$(pwd)" ] ||
        ! .venv/bin/python -m pip --version >/dev/null 2>&1; then
        make_venv
    fi
    echo "lightproof: installing the locked Python packages into .venv" >&2
    local pip=(.venv/bin/python -m pip install --quiet --disable-pip-version-check --no-input)
    "${pip[@]}" --require-hashes -r requirements.lock ||
        stop "could not install the packages of requirements.lock: check the network and run make setup again"
    "${pip[@]}" --no-deps --no-build-isolation --editable . ||
        stop "could not install Lightproof itself into .venv: run make setup again"
    wanted >$stamp
}

usable_llvm() {
    .venv/bin/python -c 'import sys; from reference.toolchain import find_llvm; sys.exit(find_llvm() is None)'
}

llvm() {
    usable_llvm && return
    local package
    package=$(.venv/bin/python -c 'from reference.toolchain import newest_llvm_package as p; print(p())')
    [ -z "${DRJIT_LIBLLVM_PATH:-}" ] && apt_install "$package" && usable_llvm && return
    stop "$(.venv/bin/python -c 'from reference.toolchain import no_llvm; print(no_llvm())')"
}

browser() {
    .venv/bin/python -c 'import sys; from reference.doctor import chromium; sys.exit(not chromium().good)' && return
    apt_install chromium && return
    echo "lightproof: no Chromium, so that the tests of the report page are skipped; to have them run" \
        "$(by_hand chromium)" >&2
}

packages
llvm
if [ "${1:-}" = test ]; then browser; fi
