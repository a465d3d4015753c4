# `make demo` and `make test` set up everything they need. PYTHON picks the interpreter (3.11 or newer).
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet


.PHONY: demo test bench faults check lint types imports help clean

help:
	@echo "make demo   a full simulated rendezvous (options: ARGS='--seed 2 --out DIR')"
	@echo "make test   checks and tests"
	@echo "make bench  benchmarks (options: ARGS='--json F --out DIR')"
	@echo "make faults the fault table's long campaigns, about a quarter of an hour"
	@echo "make .venv  the environment alone"

.venv: $(VENV)/run.stamp

$(VENV)/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or newer is needed: make PYTHON=python3.11 $(MAKECMDGOALS)"; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/run.stamp: requirements.txt pyproject.toml | $(VENV)/bin/python
	$(PIP) install -r requirements.txt
	$(PIP) install --no-deps --no-build-isolation -e .
	@touch $@

$(VENV)/dev.stamp: requirements-dev.txt $(VENV)/run.stamp
	$(PIP) install -r requirements-dev.txt
	@touch $@

demo: .venv
	$(BIN)/companion demo $(ARGS)

test: check
	$(BIN)/python -m pytest

bench: .venv
	$(BIN)/python -m benchmarks $(ARGS)

# The long campaigns of the fault table; figures go to build/faults.json and the table of docs/faults.md.
faults: $(VENV)/dev.stamp
	COMPANION_FAULTS=full $(BIN)/python -m pytest tests/faults $(ARGS)
	$(BIN)/python -m tests.faults.figures

check: $(VENV)/dev.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

clean:
	rm -rf $(VENV) build dist *.egg-info
