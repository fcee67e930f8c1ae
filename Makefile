# Everything runs in a virtual environment of its own. `make help` lists the targets.
# Overridable: PYTHON (the interpreter that makes the environment), VENV (its folder, relative and
# without spaces), OUT (where the demo writes), PYTEST_ARGS.

PYTHON ?= python3
VENV ?= .venv
OUT ?= out/demo
# Each worker takes one stretch of the files in their order, so that what the tests of a file share
# is made once, and who is done first takes half of what another still has. (By whole files, the end
# of a run is one long file, and a test that ends its worker is run again and again.)
PYTEST_ARGS ?= -n auto --maxprocesses 4 --dist worksteal

# The tests start hundreds of interpreters: byte code is kept, whatever the shell says.
unexport PYTHONDONTWRITEBYTECODE

# All paths are relative to this folder, so that the folder's own name may contain spaces.
BIN := $(VENV)/bin
# Byte code is made at a module's first import: of all that is installed a quarter is ever imported.
PIP := $(BIN)/python -m pip install -q --disable-pip-version-check --no-input --no-compile -c constraints.txt
# The studies take an hour and more, and are run by hand.
STUDIES := $(addprefix benchmarks/bench_,belief.py brute_force.py claim.py layer_figures.py lost.py \
	plan.py real_scans.py reference.py replay.py route_layers.py sensitivity.py sonar.py truth.py)
BENCHMARKS = $(filter-out $(STUDIES),$(sort $(wildcard benchmarks/bench_*.py)))

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help demo test test-slow test-sweep test-all check lint types format docs notebooks bench wheel supply clean

help:  ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1|\2/p' Makefile | column -t -s '|' 2>/dev/null \
		|| sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1: \2/p' Makefile

demo: $(VENV)/.installed-core  ## audit the bundled building, plan through it, drive the routes; all goes to out/demo
	@$(BIN)/ambinav demo -o "$(OUT)"

test: $(VENV)/.installed-dev  ## run the quick tests
	$(BIN)/python -m pytest -m "not slow and not sweep" --durations=15 $(PYTEST_ARGS)

test-slow: $(VENV)/.installed-dev  ## run the tests marked slow
	$(BIN)/python -m pytest -m "slow and not sweep" --durations=15 $(PYTEST_ARGS)

test-sweep: $(VENV)/.installed-dev  ## run the sweeps over maps, presets and logs and the longest tests, before a release
	$(BIN)/python -m pytest -m sweep --durations=15 $(PYTEST_ARGS)

# In one go: tests are collected, and what the tests of a file share is made, once.
test-all: $(VENV)/.installed-dev  ## run the quick tests and those marked slow
	$(BIN)/python -m pytest -m "not sweep" --durations=15 $(PYTEST_ARGS)

check: lint types  ## lint and types

lint: $(VENV)/.installed-dev  ## ruff: layout and rules
	$(BIN)/python -m ruff format --check .
	$(BIN)/python -m ruff check .

types: $(VENV)/.installed-dev  ## mypy --strict
	$(BIN)/python -m mypy

format: $(VENV)/.installed-dev  ## format the sources and fix what ruff can fix
	$(BIN)/python -m ruff check --fix .
	$(BIN)/python -m ruff format .

docs: $(VENV)/.installed-dev  ## build the documentation into out/site, with warnings as errors
	$(BIN)/python -m sphinx -W --keep-going -q -b html docs out/site
	@echo "out/site/index.html"

notebooks: $(VENV)/.installed-dev  ## run the notebooks and store their outputs, which the site shows
	$(BIN)/python docs/site/run_notebooks.py

bench: $(VENV)/.installed-dev  ## run the benchmarks but the long studies, one after the other
	@set -e; for script in $(BENCHMARKS); do \
		printf '\n== %s\n' "$$script"; $(BIN)/python "$$script"; done

wheel: $(VENV)/.made  ## build the wheel and import it from a clean environment of its own
	rm -rf dist build/wheel
	$(BIN)/python -m pip wheel -q --disable-pip-version-check --no-deps -w dist .
	"$(PYTHON)" -m venv build/wheel
	build/wheel/bin/python -m pip install -q --disable-pip-version-check -c constraints.txt \
		"$$(echo dist/ambinav-*.whl)[planners]"
	cd build/wheel && bin/python -c "import ambinav, ambinav_planners; print(ambinav.__file__)"
	build/wheel/bin/ambinav --version

# Of the interpreter and platform it runs on: a hash is that of one file. The hashes are tried at once.
supply: $(VENV)/.made  ## write requirements with hashes, SBOM and licences of the wheel in dist to out/supply
	rm -rf build/supply out/supply && mkdir -p out/supply
	$(VENV)/bin/python -m venv build/supply/wheel && $(VENV)/bin/python -m venv build/supply/tools
	build/supply/tools/bin/python -m pip install -q --disable-pip-version-check cyclonedx-bom==7.5.0 pip-licenses==5.5.5
	$(BIN)/python -m pip install -q --disable-pip-version-check --dry-run --ignore-installed -c constraints.txt \
		--report build/supply/report.json "$$(echo dist/ambinav-*.whl)[planners,serve]"
	$(BIN)/python recipe/hashed_requirements.py build/supply/report.json > out/supply/requirements.txt
	build/supply/wheel/bin/python -m pip install -q --disable-pip-version-check --no-deps --require-hashes \
		-r out/supply/requirements.txt
	build/supply/wheel/bin/python -m pip install -q --disable-pip-version-check --no-deps dist/ambinav-*.whl
	build/supply/tools/bin/cyclonedx-py environment --output-reproducible --of JSON \
		-o out/supply/sbom.cdx.json build/supply/wheel/bin/python
	build/supply/tools/bin/pip-licenses --python=build/supply/wheel/bin/python --format=markdown --with-urls \
		--output-file=out/supply/licences.md

clean:  ## remove the environment and everything that the tools have left
	rm -rf $(VENV) dist build docs/_generated .pytest_cache .mypy_cache .ruff_cache .hypothesis .benchmarks
	find ambinav planners envs tests benchmarks configs -name __pycache__ -prune -exec rm -rf {} +

# Installed again whenever the dependencies change. The demo needs the planners only. An interpreter's
# own pip may be older than dependency groups: the pinned one is installed first.
$(VENV)/.installed-core: pyproject.toml constraints.txt | $(VENV)/.made
	@echo "installing ambinav[planners] into $(VENV)"
	@$(PIP) -e '.[planners]'
	@touch $@

$(VENV)/.installed-dev: pyproject.toml constraints.txt | $(VENV)/.made
	@echo "installing ambinav[all] and the dependency group dev into $(VENV)"
	@$(PIP) pip
	@$(PIP) -e '.[all]' --group dev
	@touch $@ $(VENV)/.installed-core

$(VENV)/.made:
	@command -v "$(PYTHON)" >/dev/null || { \
		echo "make: no interpreter '$(PYTHON)'; give one: make PYTHON=/path/to/python3.11" >&2; exit 1; }
	@"$(PYTHON)" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' || { \
		echo "make: ambinav with OMPL needs Python 3.11 to 3.13, and '$(PYTHON)' is $$("$(PYTHON)" -V 2>&1);" \
			"give another: make PYTHON=/path/to/python3.11" >&2; exit 1; }
	@"$(PYTHON)" -m venv $(VENV)
	@touch $@
