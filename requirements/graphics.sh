#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Sees to it that the OpenGL and EGL libraries that Drake renders with are there:
# installs Debian's packages where it may, else says what to run and fails.
set -euo pipefail

packages=(libegl1 libgl1 libopengl0 libgl1-mesa-dri libxrender1)
libraries=(libEGL.so.1 libGL.so.1 libOpenGL.so.0 libXrender.so.1)

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
    echo "error: ${absent} is missing, which rendering needs; run as root: ${command}" >&2
else
    echo "error: ${absent} is missing, which rendering needs; install your system's" \
        "packages of OpenGL, EGL and Mesa (Debian: ${packages[*]})" >&2
fi
exit 1
