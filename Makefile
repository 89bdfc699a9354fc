.DEFAULT_GOAL := help
PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

.PHONY: help
help:  ## Show the targets.
	@grep -E '^[a-z -]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 14

.PHONY: demo
demo: setup  ## Let the robot clear a table once; a report with a replay in out/demo.
	@$(BIN)/physim-drake pick examples/scenarios/clutter.yaml --seed 0 --headless --record out/demo

.PHONY: test
test: setup lint typecheck  ## Check style, types and behaviour, as CI does.
	@requirements/browser.sh
	@$(BIN)/pytest -n auto --maxprocesses 4

.PHONY: test-newest test-oldest
test-newest:  ## Test on Debian 13 with Python 3.13 and the newest versions; as root.
	@requirements/other_versions.sh newest

test-oldest:  ## Test with the oldest versions that pyproject.toml allows.
	@requirements/other_versions.sh oldest

# Not with --quiet, which would overlook warnings.
.PHONY: docs
docs: setup  ## Build the documentation site in build/site; a warning is an error.
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict
	@echo "build/site/index.html"

.PHONY: docker
docker:  ## Build the Docker image physim-drake and let it check itself.
	@docker info >/dev/null 2>&1 || { echo "error: no Docker engine answers: see that docker is installed, running, and that you may use it" >&2; exit 1; }
	@docker build --tag physim-drake .
	@docker run --rm physim-drake doctor

.PHONY: lint
lint: setup  ## Check style.
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .

.PHONY: typecheck
typecheck: setup  ## Check types, of the examples, too.
	@$(BIN)/mypy physim_drake examples
	@$(BIN)/basedpyright

.PHONY: peers
peers: setup  ## Install what benchmarks/peers compares with, into build/peers.
	@requirements/peers.sh

# Without atheris, which is large and of no use elsewhere, hypothesis makes the inputs.
.PHONY: soak
soak: setup  ## Kill runs, fuzz readers, estimate 1,000 images; hours; a table in out/soak.
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements/fuzz.txt || true
	@$(BIN)/python -m benchmarks.soak $(SOAK)

.PHONY: setup
setup: $(STAMP)  ## Install what is needed into .venv, and the system libraries.
	@requirements/system_libraries.sh

$(STAMP): requirements/dev.txt pyproject.toml
	@test -n "$(PYTHON)" && $(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "error: needs Python 3.11 or later: apt-get install python3.11 python3.11-venv, or make PYTHON=/path/to/python" >&2; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV) || \
	  { rm -rf $(VENV); echo "error: $(PYTHON) cannot make a virtual environment: apt-get install python3.11-venv" >&2; exit 1; }
	@echo "installing the pinned dependencies into $(VENV)"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -r requirements/dev.txt
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@
