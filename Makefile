# `make demo` and `make test` set up everything they need. PYTHON picks the interpreter (3.11 or newer).
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet


.PHONY: demo test bench golden replay-seeds check lint types imports help clean

help:
	@echo "make demo   a full simulated rendezvous (options: ARGS='--seed 2 --out DIR')"
	@echo "make test   checks and tests"
	@echo "make bench  benchmarks (options: ARGS='--json F --out DIR')"
	@echo "make golden renews the golden decisions and prints what moved (ARGS='--cut demo-out/log.mcap' cuts a log anew)"
	@echo "make replay-seeds  flies the demo with ten seeds and replays each log (SEEDS, MAX_TIME)"
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

golden: $(VENV)/dev.stamp
	$(BIN)/python -m tests.golden $(ARGS)

SEEDS := 1 2 3 4 5 6 7 8 9 10
MAX_TIME := 240
replay-seeds: .venv
	@for seed in $(SEEDS); do \
		$(BIN)/companion demo --seed $$seed --max-time $(MAX_TIME) --out build/seeds/$$seed > /dev/null 2>&1; \
		$(BIN)/companion replay build/seeds/$$seed/log.mcap --check || exit 1; \
	done

check: $(VENV)/dev.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

clean:
	rm -rf $(VENV) build dist *.egg-info
