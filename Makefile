# rotorid: `make` lists the targets. Each works from any current state and is quick the second time.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
SEED   := $(or $(SEED),$(shell date +%s))
INSTALLED := $(VENV)/.installed
READY  := $(VENV)/.ready
TOOLS  := $(VENV)/.tools
# What to install beside rotorid itself: EXTRA=[dev] spares a second look at everything where tools are wanted anyway.
EXTRA  ?=
# Installs, and says which packages are being fetched.
INSTALL = .ci/install $(BIN)/python
# Two workers more than there are cores: tests of services and schedulers wait a good part of their time.
JOBS    = $(shell $(PYTHON) -c 'import os; print((os.cpu_count() or 1) + 2)')
# One BLAS thread: our matrices are small and threads only hurt them.
export OPENBLAS_NUM_THREADS := 1
# Byte code is kept: the tests start hundreds of processes, each of which would compile all sources again.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help setup tools analyze check test whole lint quick types bench fuzz docs serve lock clean

help:  ## list the targets
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 10

setup: $(READY)  ## make .venv and install rotorid with its pinned dependencies

tools: $(READY) $(TOOLS)  ## install what tests and lint need as well

$(INSTALLED): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit("rotorid needs Python >= 3.11; set PYTHON=python3.11 or newer" if sys.version_info < (3, 11) else 0)'
	@echo "1 of 3: making $(VENV) ..."
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "2 of 3: installing rotorid and what it needs ..."
	@$(INSTALL) '.$(EXTRA)'
	@touch $@

$(READY): $(INSTALLED)
	@echo "3 of 3: compiling the numerical loops (once, half a minute) ..."
	@{ $(BIN)/rotorid analyze sample_logs/octa01_zurich_calm.bin --out $(VENV)/compiled && $(BIN)/rotorid inspect sample_logs/octa02_alain_breeze.tlog; } > $(VENV)/compiled.log 2>&1 || \
		{ echo "That failed; each loop is compiled at its first use instead. Its last words, of $(VENV)/compiled.log:"; tail -n 5 $(VENV)/compiled.log; }
	@touch $@

$(TOOLS): $(INSTALLED)
	@echo "Installing what tests and lint need ..."
	@$(INSTALL) '.[dev]'
	@touch $@

analyze: setup  ## analyse sample_logs/, print a summary, write out/report.html and friends
	@$(BIN)/rotorid analyze sample_logs --out out

check: lint  ## lint and the fast tests: what to run before a commit
	@$(BIN)/python -m pytest -n logical --dist loadscope -m "not slow and not lengthy"

# Tests of a module stay together, so that what its fixtures make is made once; all else is in random order.
ORDER   = -n $(JOBS) --dist loadscope --no-loadscope-reorder --randomly-seed=$(SEED)
WHICH   = -m "not whole"

test: tools  ## run all tests in random order, the longest in a short form; SEED=n repeats an order
	@echo "Running the tests in random order, SEED=$(SEED) ..."
	@$(BIN)/python -m pytest $(ORDER) --durations=20 $(WHICH)

whole: tools  ## run what `make test` runs in a short form as it is: many flights, all real logs, kills, the tutorial
	@$(BIN)/python -m pytest $(ORDER) -m whole $$(git grep -lE 'mark\.whole|tests\.forms import' -- 'tests/*/test_*.py')

lint: quick types  ## ruff, mypy --strict and the import direction

quick: $(TOOLS)  # what of `make lint` takes seconds
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/lint-imports

types: $(TOOLS)
	@$(BIN)/mypy

bench: tools  ## compare speed and accuracy with the peers, print one table and write docs/benchmarks.md
	@$(BIN)/python -m pip install -qq --disable-pip-version-check -c constraints.txt -e ".[dev,peers]"
	@$(BIN)/python -m benchmarks --minutes 20 --write

fuzz: tools  ## read 100,000 damaged logs and tables of every format (COUNT=n for another number)
	@$(BIN)/python -m tests.fuzz $(or $(COUNT),100000)

docs: tools  ## build the documentation into out/docs
	@$(BIN)/python -m sphinx -b html -q -W --keep-going docs out/docs
	@echo out/docs/index.html

serve: setup  ## start the web service on http://127.0.0.1:8000
	@$(BIN)/rotorid serve

lock: setup  ## refresh constraints.txt and deploy/requirements.txt to the newest versions that fit
	@$(BIN)/python -m pip install --quiet uv
	@$(BIN)/uv pip compile pyproject.toml --extra dev --extra peers --universal --python-version 3.11 --upgrade --no-header --quiet -o constraints.txt
	@$(BIN)/uv pip compile pyproject.toml --extra postgresql --extra s3 --extra cluster --extra mcp --universal --python-version 3.11 --generate-hashes --no-header --quiet -c constraints.txt -o deploy/requirements.txt

clean:  ## remove .venv, out/ and caches
	@rm -rf $(VENV) out .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
