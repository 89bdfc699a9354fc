#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# Installs what benchmarks/peers compares with into build/peers (make peers). That
# environment sees the project's, .venv, and takes from it what is there; nothing in
# .venv changes.
set -euo pipefail
cd "$(dirname "$0")/.."

[[ -x .venv/bin/python ]] || { echo "error: no .venv yet: make setup" >&2; exit 1; }
.venv/bin/python -m venv --clear build/peers
.venv/bin/python - <<'EOF'
import sysconfig
from pathlib import Path

own = sysconfig.get_path("purelib", vars={"base": "build/peers"})
project = sysconfig.get_path("purelib")
line = f"import site; site.addsitedir({project!r})\n"
(Path(own) / "project.pth").write_text(line)
EOF
build/peers/bin/python -m pip install --quiet --disable-pip-version-check \
    -r requirements/peers.txt -c requirements/dev.txt
echo "now: build/peers/bin/python -m benchmarks.peers"
