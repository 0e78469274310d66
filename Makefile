# What can be done here; `make help` lists it. Everything runs in .venv, made from the versions pinned in constraints.txt.
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:

PYTHON ?= $(firstword $(foreach p,python3 python3.14 python3.13 python3.12 python3.11,\
	$(shell $(p) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $(p))))
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.made
DEMO := build/demo
WORKERS ?= 2

EXAMPLES := $(wildcard examples/*.scene examples/*.usda examples/*.obj)
PICTURES := $(EXAMPLES:examples/%=$(DEMO)/%.png)
INPUTS := $(filter-out %.png %.md,$(wildcard examples/*)) $(wildcard examples/assets/*)

.PHONY: help venv demo test test-all check clean

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 14

venv: $(STAMP)  ## make the environment .venv from pinned versions

$(STAMP): pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "maquette needs Python 3.11 or newer (make PYTHON=/path/to/python3)"; exit 1; }
	@echo "making $(VENV) with $(PYTHON)"
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt setuptools
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt --no-build-isolation -e '.[test,check]'
	@mkdir -p $(VENV)/typing && ln -sfn ../.. $(VENV)/typing/maquette
	@touch $@

demo: $(PICTURES)  ## render every example, and say where the pictures are
	@echo "$(words $(PICTURES)) pictures are in $(CURDIR)/$(DEMO)"

$(DEMO)/%.png: examples/% $(INPUTS) $(STAMP)
	@mkdir -p $(DEMO)
	@$(BIN)/maquette render $< -o $@

test: check  ## the whole suite, after ruff and pyright
	@$(BIN)/python -m pytest -q -n $(WORKERS)

test-all: check  ## also what takes long: statistics, soak, packaging
	@$(BIN)/python -m pytest -q -n $(WORKERS) --long

check: $(STAMP)  ## ruff and pyright
	@$(BIN)/ruff check .
	@$(BIN)/pyright

clean:  ## remove what was made, the environment too
	@rm -rf $(VENV) build .pytest_cache .ruff_cache .hypothesis *.egg-info
