# Needs python3 (3.11 or newer) and make; everything else is installed into .venv.

PYTHON ?= python3
BIN := .venv/bin
VIEW := $(if $(DISPLAY)$(WAYLAND_DISPLAY),native,none)

.PHONY: help setup demo test test-kills test-fuzz test-crowds test-soak lint types bench clean

help:
	@echo "make demo    six robots cross two obstacles in formation; opens Rerun where there is a display"
	@echo "make test    lint, types, tests"
	@echo "make test-kills  the full campaign of random kills"
	@echo "make test-fuzz   a million payloads, 10,000 scenario files, 1,000 damaged recordings"
	@echo "make test-crowds 100,000 crowds that ask for anything, as many pairs of claims (an hour)"
	@echo "make test-soak   a thousand kills and restarts in one run of 20 robots (2 minutes)"
	@echo "make bench   what a swarm costs, as ratios"
	@echo "make setup   only make .venv"
	@echo "make clean   remove .venv and caches (recordings in runs/ stay)"

setup: .venv/installed

.venv/installed: pyproject.toml deploy/constraints.txt
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(v < (3, 11) and "expected python3 3.11 or newer, got %d.%d; try make PYTHON=python3.12" % v[:2])'
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint deploy/constraints.txt --editable '.[test]'
	@$(BIN)/python -c 'from agents.navigator import warm; warm.up()'  # compiles its inner loops, once
	@touch $@

demo: setup
	$(BIN)/swarm run two-obstacles --view $(VIEW)
	@if [ "$(VIEW)" = none ]; then echo "no display here: see it with  $(BIN)/swarm run two-obstacles --view web  or open the run's run.rrd in Rerun"; fi

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: setup
	$(BIN)/mypy

test: lint types
	$(BIN)/python -m pytest

test-kills: setup
	$(BIN)/python -m pytest tests/run/test_kill.py --kills 20

test-fuzz: setup
	$(BIN)/python -m pytest tests/fuzz --fuzz 50

test-crowds: setup
	$(BIN)/python -m pytest tests/agents/navigator/test_pact.py tests/agents/navigator/test_right_of_way.py \
		-k 'keep_apart or opposing' --crowds 50000 --timeout 0

test-soak: setup
	$(BIN)/python -m pytest tests/run/test_soak.py --soak 1000 -s

bench: setup
	$(BIN)/swarm bench

clean:
	rm -rf .venv .mypy_cache .pytest_cache .ruff_cache .hypothesis build *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
