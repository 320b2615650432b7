# Everything runs from a fresh clone; nothing needs activating. `make help` lists the targets.

SHELL := /bin/sh
.DEFAULT_GOAL := help

PYTHON ?= python3
VENV := .venv
RUN := $(VENV)/bin/python
STAMP := $(VENV)/.installed
DEMO := output/quickstart
OLDEST_LLVM := $(RUN) -m scanner_sim.render.libraries --oldest
N ?= 1000
SEED ?= 0

# Said by the interpreter itself, so that a shim without a Python behind it counts as missing.
NEW_ENOUGH := import sys; sys.exit(sys.version_info < (3, 11))

.PHONY: help demo test fuzz soak record mutants seeds matrix calibrate lint format typecheck docs build bench scenes setup llvm clean

help: ## List the targets
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "  make %-10s %s\n", $$1, $$2 }' $(firstword $(MAKEFILE_LIST))

demo: setup ## Set up and run the quickstart with its pictures
	$(VENV)/bin/scanner-sim run configs/quickstart.yaml -o $(DEMO) --overwrite
	@echo "The pictures are in $(CURDIR)/$(DEMO):"
	@cd $(DEMO) && ls *.png

test: setup ## Set up and run all tests, slow ones too
	$(RUN) -m pytest -m ""

soak: setup ## Run 200 simulations in one process, whose memory must stay where it is
	SCANNER_SIM_SOAK=200 $(RUN) -m pytest -m "" tests/faults/test_soak.py

fuzz: setup ## Open mutants of scenarios, states, scenes, results and plans: make fuzz N=10000 SEED=7
	$(RUN) tests/faults/fuzz.py -n $(N) --states $$(($(N) / 20)) --scenes $$(($(N) / 10)) --results $$(($(N) / 10)) --plans $$(($(N) / 10)) --seed $(SEED)

record: setup ## Record anew what the shipped scenarios and studies give, after a change that means to move it
	$(RUN) tests/recorded.py

mutants: setup ## Plant faults one by one and write which test notices each (an hour or two): make mutants TENTH=3
	$(RUN) tests/mutants/plant.py $(if $(TENTH),--tenth $(TENTH))

seeds: setup ## Run the tests with other seeds: make seeds N=20
	$(RUN) tests/seeds.py -n $(if $(filter file,$(origin N)),20,$(N))

matrix: setup ## Test with the oldest and the newest packages, on every Python there is
	$(RUN) tests/matrix.py

lint: $(STAMP) ## Check style and format
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .

format: $(STAMP) ## Put the code into the common format
	$(RUN) -m ruff check --fix .
	$(RUN) -m ruff format .

typecheck: $(STAMP) ## Check the types of the package
	$(RUN) -m mypy

docs: setup ## Build the site of the documents into build/docs; any warning is an error
	NO_MKDOCS_2_WARNING=1 $(RUN) -m mkdocs build --strict
	@echo "Open $(CURDIR)/build/docs/index.html"

build: $(STAMP) ## Build the wheel into dist/
	rm -rf dist
	$(RUN) -m build --wheel --no-isolation

calibrate: setup ## Calibrate drawn instruments by the whole chain, and see where the truth lies: make calibrate N=200
	$(RUN) benchmarks/selfcal.py --draws $(if $(filter file,$(origin N)),200,$(N))

bench: setup ## Measure speed and memory
	$(RUN) benchmarks/imaging.py

scenes: setup ## Generate the shipped scenes anew
	$(RUN) scenes/generate.py

setup: $(STAMP) llvm ## Make the environment and see to LLVM

# The environment follows pyproject.toml. It is updated in place, so that a change of the version
# number, say, does not fetch everything again; `make clean` starts afresh. The stamp is a copy of the
# file: a new date alone installs nothing, so a set-up that is complete stays usable offline.
$(STAMP): pyproject.toml
	@if ! $(RUN) -m pip --version >/dev/null 2>&1; then \
	  found=; \
	  for python in $(PYTHON) python3.13 python3.12 python3.11; do \
	    "$$python" -c '$(NEW_ENOUGH)' >/dev/null 2>&1 || continue; \
	    found="$$python"; \
	    "$$python" -c 'import ensurepip, venv' >/dev/null 2>&1 && break; \
	  done; \
	  if [ -z "$$found" ]; then \
	    echo "Python 3.11 or newer is needed and was not found: install it, or name it with make PYTHON=/path/to/python3." >&2; \
	    exit 1; \
	  fi; \
	  if ! "$$found" -c 'import ensurepip, venv' >/dev/null 2>&1; then \
	    echo "$$found cannot make environments: install its venv module (Debian, Ubuntu: apt-get install python3-venv), or name another Python with make PYTHON=/path/to/python3." >&2; \
	    exit 1; \
	  fi; \
	  echo "Making the environment $(VENV) with $$found"; \
	  "$$found" -m venv --clear $(VENV) || exit 1; \
	fi
	@cmp -s pyproject.toml $@ || { \
	  echo "Installing what pyproject.toml asks for"; \
	  $(RUN) -m pip install --quiet --disable-pip-version-check --editable '.[dev]'; \
	}
	@cp pyproject.toml $@

# Which LLVM will do is said in scanner_sim/render/libraries.py alone. Only Debian and Ubuntu are changed
# without asking; elsewhere, and where the user chose a library himself, the program says what to do.
llvm: $(STAMP)
	@if ! $(RUN) -m scanner_sim.render.libraries >/dev/null 2>&1; then \
	  if [ -z "$$DRJIT_LIBLLVM_PATH" ] && command -v apt-get >/dev/null; then \
	    as_root=; \
	    if [ "$$(id -u)" -ne 0 ]; then \
	      command -v sudo >/dev/null || { echo "LLVM is missing: ask root to run apt-get install libatomic1 libllvm$$($(OLDEST_LLVM)) (or a newer one)." >&2; exit 1; }; \
	      as_root=sudo; \
	    fi; \
	    echo "Installing LLVM through apt-get"; \
	    $$as_root apt-get update -qq; \
	    package=$$(apt-cache search --names-only '^libllvm[0-9]+(t64)?$$' | sed -n 's/^libllvm\([0-9]*\)\(t64\)\{0,1\} .*/\1 libllvm\1\2/p' \
	      | awk -v oldest="$$($(OLDEST_LLVM))" '$$1 >= oldest' | sort -n | tail -n 1 | cut -d ' ' -f 2); \
	    [ -n "$$package" ] || { echo "apt-get offers no LLVM $$($(OLDEST_LLVM)) or newer: install one by hand and name its library in DRJIT_LIBLLVM_PATH." >&2; exit 1; }; \
	    $$as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$$package" libatomic1 || exit 1; \
	  fi; \
	  $(RUN) -m scanner_sim.render.libraries; \
	fi

clean: ## Remove the environment, results and caches
	rm -rf $(VENV) out dist build .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
