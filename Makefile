# make demo: see it work. make test: prove it. Both make .venv first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --disable-pip-version-check --quiet --constraint constraints.txt
PLUGINS := $(wildcard plugins/*/*)
# One pip command installs core and plugins together: none of them is on an index.
EDITABLE := $(foreach plugin,$(PLUGINS),--editable ./$(plugin))
# Clients by others, against which tests hold ours; where there are none, those tests skip.
WITNESSES := natnet motioncapture
MANIFESTS := pyproject.toml constraints.txt $(wildcard plugins/*/*/pyproject.toml)
RUNS := runs/demo
# One more than there are cores: some tests wait for devices that run in real time.
WORKERS ?= $(shell expr $$(getconf _NPROCESSORS_ONLN) + 1)

.PHONY: demo test lint bench docs dist clean

demo: $(VENV)/demo
	@rm -rf $(RUNS)
	$(BIN)/vrbench run gameplay-replay --rig sim:quest-2 -o $(RUNS)/quest-2
	$(BIN)/vrbench run gameplay-replay --rig sim:quest-pro -o $(RUNS)/quest-pro
	$(BIN)/vrbench leaderboard $(RUNS)/quest-2 $(RUNS)/quest-pro
	@echo "The bundles are $(RUNS)/quest-2 and $(RUNS)/quest-pro: takes, metrics, report.html."

test: $(VENV)/test
	$(BIN)/python -m pytest --numprocesses=$(WORKERS) --dist=loadfile --no-loadscope-reorder

lint: $(VENV)/test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# Peers and vrbench on the same files: tables for docs/performance.md. BENCH="ape mcap --quick" chooses.
bench: $(VENV)/bench
	$(BIN)/python -m benchmarks $(BENCH)

docs: $(VENV)/docs
	$(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet docs build/docs
	@echo "The pages begin at build/docs/index.html."

# Wheels of the core and of every plugin.
dist: $(VENV)/test
	@rm -rf dist
	$(BIN)/python -m pip wheel --disable-pip-version-check --quiet --no-deps --no-build-isolation \
	  --wheel-dir dist . $(addprefix ./,$(PLUGINS))
	@ls dist

clean:
	rm -rf $(VENV) runs build dist .mypy_cache .ruff_cache .pytest_cache

# A virtual environment without ensurepip has no pip, and Debian packs ensurepip apart.
$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "vrbench needs Python 3.11 or newer: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 2; }
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || { \
	  v=$$($(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])'); \
	  echo "This Python can't make virtual environments: install the package python$$v-venv"; \
	  echo "(Debian, Ubuntu: apt install python$$v-venv) and call make again."; exit 2; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/demo: $(MANIFESTS) | $(BIN)/python
	$(PIP) --editable '.[report]' --editable ./plugins/headsets/quest
	@touch $@

$(VENV)/test: $(MANIFESTS) | $(BIN)/python
	$(PIP) --editable '.[c3d,cluster,evo,lint,parquet,report,test]' $(EDITABLE)
	-$(PIP) $(WITNESSES)
	@touch $@ $(VENV)/demo

$(VENV)/bench: $(VENV)/test
	$(PIP) --editable '.[bench]'
	@touch $@

$(VENV)/docs: $(MANIFESTS) | $(BIN)/python
	$(PIP) --editable '.[docs]'
	@touch $@
