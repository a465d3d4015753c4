# `make demo` and `make test` set up everything they need. PYTHON picks the interpreter (3.11 or newer).
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet


.PHONY: install rollback uninstall deb demo pictures test test-long faults mutants t265 bench ablation golden replay-seeds check lint types imports help clean

help:
	@echo "make demo   a full simulated rendezvous (options: ARGS='--seed 2 --out DIR')"
	@echo "make pictures  flies the demo and draws the README's pictures from it"
	@echo "make test   checks and tests, side by side"
	@echo "make test-long  tests that take longer than make test allows: every recording, not a few"
	@echo "make faults long fault campaigns (an hour or more); figures in build/faults.json and docs/results/faults.md"
	@echo "make mutants  mutation test of what may command the vehicle (MUTANTS='gate table' for some, ARGS=--survivors for the last ones again)"
	@echo "make t265   the camera reader's own environment, where python3.10 is found"
	@echo "make bench  benchmarks (options: ARGS='--json F --out DIR')"
	@echo "make ablation  what each step of the estimator is worth, measured anew into docs/results/ (DATA=DIR...)"
	@echo "make golden renews the golden decisions and prints what moved (ARGS='--cut demo-out/log.mcap' cuts a log anew)"
	@echo "make replay-seeds  flies the demo with ten seeds and replays each log (SEEDS, MAX_TIME)"
	@echo "make .venv  the environment alone"
	@echo "make install  as root: onto this robot, below /opt/companion (ROLE=uav or beacon the first time)"
	@echo "make rollback  as root: the version before runs again"
	@echo "make uninstall  as root: away with it; configuration, keys and logs stay but for PURGE=1"
	@echo "make deb    the same as a Debian package in build/"

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

# The README's pictures, from a flight of the default world.
pictures: .venv
	$(BIN)/companion demo --out build/pictures
	cp build/pictures/flight.png build/pictures/profile.png docs/pictures/

# tests/lanes.py runs checks and tests side by side; docs/testing.md says what stands where.
test: $(VENV)/dev.stamp t265
	$(BIN)/python -m tests.lanes

# By file: what a document prints is run in the order in which a reader would.
test-long: $(VENV)/dev.stamp t265
	$(BIN)/python -m pytest -n 2 --dist loadfile -m long tests $(ARGS)

faults: $(VENV)/dev.stamp t265
	COMPANION_FAULTS=full $(BIN)/python -m pytest tests/faults tests/sitl tests/unit -k fault_ -m 'long or not long' -s $(ARGS)
	$(BIN)/python -m tests.faults.missions --count 5000 --jobs 2
	$(BIN)/python -m tests.faults.missions --first 1000000 --count 5000 --jobs 2
	$(BIN)/python -m tests.faults.missions --real --count 200 --jobs 2
	$(BIN)/python -m tests.faults.figures

# cosmic-ray has an environment of its own, since it pulls in a database. All of tests/mutants/*.toml without MUTANTS.
mutants: $(VENV)/dev.stamp
	test -e .venv-mutants/bin/cosmic-ray || { $(PYTHON) -m venv .venv-mutants && .venv-mutants/bin/python -m pip --disable-pip-version-check --quiet install cosmic-ray==8.7.0; }
	nice -n 19 $(BIN)/python -m tests.mutants $(MUTANTS) $(ARGS)

# Soft: without a CPython 3.10 the tests say so and use the newest pyrealsense2 instead.
PYTHON310 := $(shell for p in python3.10 $$HOME/.pyenv/versions/3.10.*/bin/python3.10; do $$p -c '' 2>/dev/null && echo $$p && break; done)
t265:
	@test -e .venv-t265/t265.stamp -o -z "$(PYTHON310)" || { \
		$(PYTHON310) -m venv .venv-t265 && \
		.venv-t265/bin/python -m pip --disable-pip-version-check --quiet install -r requirements-t265.txt && \
		touch .venv-t265/t265.stamp; } || echo "the camera reader's own environment could not be made; tests do without"

bench: .venv
	$(BIN)/python -m benchmarks $(ARGS)

# Writes docs/results/ablation.md, crossvalidation.md and simulated.md; about ten minutes.
DATA := ../shared/data/wsr_dataset_dev ../shared/data/wsr_3d
ablation: .venv
	$(BIN)/python -m benchmarks.ablation --markdown $(DATA)
	$(BIN)/python -m benchmarks.crossvalidation --markdown $(DATA)
	$(BIN)/python -m benchmarks.simulated --markdown

golden: $(VENV)/dev.stamp
	$(BIN)/python -m tests.golden $(ARGS)

SEEDS := 1 2 3 4 5 6 7 8 9 10
MAX_TIME := 240
replay-seeds: .venv
	@rm -rf build/seeds && mkdir -p build/seeds
	@for seed in $(SEEDS); do \
		$(BIN)/companion demo --seed $$seed --max-time $(MAX_TIME) --out build/seeds/$$seed > build/seeds/$$seed.txt 2>&1; \
		echo "seed $$seed: $$(grep -m 1 'after engaging' build/seeds/$$seed.txt || tail -1 build/seeds/$$seed.txt)"; \
		$(BIN)/companion replay build/seeds/$$seed/log.mcap --check > build/seeds/$$seed.check 2>&1 || { cat build/seeds/$$seed.check; exit 1; }; \
		echo "  replay: $$(tail -1 build/seeds/$$seed.check)"; \
	done

# The service's environment is of the system's own interpreter: one below a home folder its user could not read.
INSTALL_PYTHON = $(shell for p in /usr/bin/python3 /usr/bin/python3.14 /usr/bin/python3.13 /usr/bin/python3.12 /usr/bin/python3.11 $(PYTHON); do \
	$$p -c 'import ensurepip, sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $$p && break; done)
# The T265's reader has its own, of a CPython 3.10 (docs/install.md says where it comes from).
INSTALL_PYTHON310 = $(shell for p in /usr/bin/python3.10 /opt/python3.10/bin/python3.10; do \
	$$p -c 'import ensurepip' 2>/dev/null && echo $$p && break; done)
# Of a commit that is no release, with its number, so that two of them lie side by side.
VERSION = $(shell sed -n 's/^__version__ = "\(.*\)"/\1/p' companion/__init__.py)$(shell \
	git() { command git -c safe.directory='*' "$$@" 2>/dev/null; }; git describe --exact-match --match 'v*' >/dev/null || \
	echo "$$(git rev-list --count HEAD) $$(git rev-parse --short HEAD)" | sed -n 's/^\([0-9][0-9]*\) \(.*\)/+r\1.\2/p')
BUILD_TREE = PYTHON="$(INSTALL_PYTHON)" PYTHON310="$(INSTALL_PYTHON310)" DEPENDENCIES="$(DEPENDENCIES)" systemd/build-tree

install:
	@test "$$(id -u)" = 0 || { echo "only root can: sudo make install ROLE=$(or $(ROLE),uav)"; exit 1; }
	@test -n "$(INSTALL_PYTHON)" || { echo "Python 3.11 or newer with venv is needed: apt install python3-venv"; exit 1; }
	$(BUILD_TREE) "$(VERSION)" /opt/companion ""
	/opt/companion/$(VERSION)/bin/companion-setup activate "$(VERSION)" $(ROLE)
	$(if $(DEPENDENCIES),,/opt/companion/$(VERSION)/bin/companion-setup warm-up)

rollback:
	/opt/companion/current/bin/companion-setup rollback

uninstall:
	sh systemd/companion-setup remove $(if $(PURGE),--purge)

deb:
	@test -n "$(INSTALL_PYTHON)" || { echo "Python 3.11 or newer with venv is needed: apt install python3-venv"; exit 1; }
	rm -rf build/deb && mkdir -p build/deb
	$(BUILD_TREE) "$(VERSION)" /opt/companion "$(CURDIR)/build/deb"
	systemd/build-deb "$(VERSION)" build/deb "$(INSTALL_PYTHON)"

check: $(VENV)/dev.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

clean:
	rm -rf $(VENV) .venv-t265 .venv-mutants build dist *.egg-info
