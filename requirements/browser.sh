#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Installs Chromium, in which the tests look at pages, where it may. Without it those
# tests are skipped, so this never fails.
set -euo pipefail

command -v chromium >/dev/null || command -v chromium-browser >/dev/null && exit 0
if command -v apt-get >/dev/null && [[ ${EUID} -eq 0 ]]; then
    echo "installing chromium, in which tests look at pages"
    export DEBIAN_FRONTEND=noninteractive
    apt-get update -qq &&
        apt-get install -y -qq --no-install-recommends chromium >/dev/null && exit 0
fi
echo "chromium is missing; tests that look at pages are skipped" \
    "(Debian: apt-get install chromium)"
