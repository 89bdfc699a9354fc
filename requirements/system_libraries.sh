#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Sees to it that the libraries that Drake loads and renders with are there: installs
# Debian's packages if it may, else says what to run and fails. A minimal Debian 12 or
# 13 lacks all of them; nothing else is missing there.
set -euo pipefail

packages=(libglib2.0-0 libegl1 libgl1 libopengl0 libgl1-mesa-dri libxrender1)
libraries=(libglib-2.0.so.0 libEGL.so.1 libGL.so.1 libOpenGL.so.0 libXrender.so.1)

missing() {
    local known
    known=$(PATH="$PATH:/sbin:/usr/sbin" ldconfig -p)
    for library in "${libraries[@]}"; do
        grep -q "${library}" <<<"${known}" || { echo "${library}"; return; }
    done
    # The software renderer, and what vendors' drivers bring instead.
    compgen -G "/usr/lib*/dri/*_dri.so" || compgen -G "/usr/lib/*/dri/*_dri.so" ||
        grep -q "libEGL_nvidia" <<<"${known}" || echo "Mesa's drivers"
}

absent=$(missing | grep -v "_dri.so" || true)
[[ -z "${absent}" ]] && exit 0
command="apt-get update && apt-get install -y --no-install-recommends ${packages[*]}"
if command -v apt-get >/dev/null && [[ ${EUID} -eq 0 ]]; then
    echo "installing ${packages[*]} (missing: ${absent})"
    export DEBIAN_FRONTEND=noninteractive
    apt-get update -qq
    apt-get install -y -qq --no-install-recommends "${packages[@]}"
    exit 0
fi
if command -v apt-get >/dev/null; then
    echo "error: ${absent} is missing, which Drake needs; run as root: ${command}" >&2
else
    echo "error: ${absent} is missing, which Drake needs; install your system's" \
        "packages of GLib, OpenGL, EGL and Mesa (Debian: ${packages[*]})" >&2
fi
exit 1
