.DEFAULT_GOAL := help
PYTHON ?= python3.11
VENV := .venv
BIN := $(VENV)/bin

.PHONY: help
help:  ## Show the targets.
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*## /\t/' | expand -t 14

.PHONY: typecheck
typecheck:
	@mkdir -p build/typecheck && rm -rf build/typecheck/physim_drake && mkdir build/typecheck/physim_drake
	@ln -s $(CURDIR)/physim_drake/* $(CURDIR)/systems $(CURDIR)/models build/typecheck/physim_drake/
	@cd build/typecheck && MYPYPATH=. $(CURDIR)/$(BIN)/mypy --config-file $(CURDIR)/pyproject.toml -p physim_drake
