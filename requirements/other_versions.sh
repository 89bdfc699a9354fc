#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Runs the tests with other versions than the pinned ones, without [train], whose torch
# takes several GB (EXTRAS=viz,train adds it); tests that need torch are then skipped.
#
#   requirements/other_versions.sh newest [PYTEST_OPTION ...]
#       Debian 13 with Python 3.13 in a folder of its own, and whatever pip finds there.
#       This needs root and debootstrap.
#   requirements/other_versions.sh oldest [PYTEST_OPTION ...]
#       Python 3.11 and the oldest versions that pyproject.toml allows.
set -euo pipefail
cd "$(dirname "$0")/.."

which=${1:-}
shift || true
extras=${EXTRAS:-viz}
tools=(pytest pytest-benchmark pytest-timeout pytest-xdist hypothesis manifold3d pycocotools safetensors)
options=(-q -n auto --maxprocesses 4 --timeout 900 "$@")
folder=$PWD/build/$which
versions='import importlib.metadata as m
for n in "drake numpy scipy numba opencv-python-headless trimesh typer".split(): print(n, m.version(n))'

stop() {
    echo "error: $1" >&2
    exit 1
}

# The tracked files, in a folder of their own, where no other build is in the way.
copy_sources() {
    mkdir -p "$1"
    git ls-files -z | tar --null --files-from - --create | tar --extract --directory "$1"
}

newest() {
    [[ ${EUID} -eq 0 ]] || stop "a root folder of Debian 13 can only be made by root"
    command -v debootstrap >/dev/null || stop "debootstrap is missing: apt-get install debootstrap"
    local root=$folder/root mirror
    mirror=${MIRROR:-$(apt-get indextargets --format '$(REPO_URI)' 'Label: Debian' 'Created-By: Packages' | head -n 1)}
    if [[ ! -x $root/usr/bin/apt-get ]]; then
        echo "making a root folder of Debian 13"
        debootstrap --variant=minbase --include=ca-certificates trixie "$root" "$mirror" >"$folder.log"
    fi
    cp /etc/resolv.conf "$root/etc/"
    cp /etc/ssl/certs/ca-certificates.crt "$root/etc/ssl/certs/"
    copy_sources "$root/src"
    mount --bind /proc "$root/proc"
    mount --bind /dev "$root/dev"
    trap 'umount "$root/proc" "$root/dev"' EXIT
    env -i HOME=/root LANG=C.UTF-8 PATH=/usr/sbin:/usr/bin:/sbin:/bin DEBIAN_FRONTEND=noninteractive \
        PIP_CERT=/etc/ssl/certs/ca-certificates.crt chroot "$root" bash -euc "
        apt-get update -qq
        apt-get install -y -qq --no-install-recommends python3 python3-venv git make >/dev/null
        cd /src
        requirements/system_libraries.sh >/dev/null
        test -d /venv || python3 -m venv /venv
        /venv/bin/pip install --quiet --upgrade '.[$extras]' ${tools[*]}
        /venv/bin/python -c '$versions'
        /venv/bin/python -m pytest ${options[*]}"
}

oldest() {
    local python
    python=$(command -v python3.11) || stop "Python 3.11 is missing"
    copy_sources "$folder/src"
    test -d "$folder/venv" || "$python" -m venv "$folder/venv"
    "$folder/venv/bin/pip" install --quiet --disable-pip-version-check uv
    cd "$folder/src"
    "$folder/venv/bin/uv" pip install --quiet --python "$folder/venv/bin/python" \
        --resolution lowest-direct ".[$extras]" pycocotools==2.0.8 safetensors==0.5.0
    "$folder/venv/bin/uv" pip install --quiet --python "$folder/venv/bin/python" "${tools[@]}"
    "$folder/venv/bin/python" -c "$versions"
    "$folder/venv/bin/python" -m pytest "${options[@]}"
}

case $which in
newest | oldest) "$which" ;;
*) stop "say newest or oldest" ;;
esac
