# SPDX-License-Identifier: MIT
# `make demo` and `make test` set up everything they need in $(VENV).

PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin
DEMO = runs/demo
PIP = $(BIN)/python -m pip --disable-pip-version-check

.DEFAULT_GOAL := help
.PHONY: help install dev demo test format lint types layers check config clean

help: ## list the targets
	@sed -n 's/^\([a-z]*\):.*## /\1\t/p' $(MAKEFILE_LIST) | expand -t 10

install: $(VENV)/.installed ## the virtual environment with ins-robot in it
	@$(BIN)/python -m compileall -q ins_robot # the service may not write beside the code

dev: $(VENV)/.installed-dev ## the same with the tools for development

demo: $(VENV)/.installed ## explore a simulated building and draw its map
	@rm -rf $(DEMO)
	@$(BIN)/ins-robot simulate --out $(DEMO) --seed 0
	@echo "the map: $(CURDIR)/$(DEMO)/map.png"

test: $(VENV)/.installed-dev ## run the tests
	@$(BIN)/python -m pytest -q -n 2

format: $(VENV)/.installed-dev ## rewrite the code in the one format
	@$(BIN)/ruff format .

lint: $(VENV)/.installed-dev ## check format and code
	@$(BIN)/ruff format --check .
	@$(BIN)/ruff check .

types: $(VENV)/.installed-dev ## check the types
	@$(BIN)/mypy

layers: $(VENV)/.installed-dev ## check who imports whom
	@$(BIN)/lint-imports

check: ## all of it, as the continuous integration does
	@.ci/run

config: $(VENV)/.installed ## write config.toml, the reference, from the code
	@$(BIN)/ins-robot check-config --reference > config.toml.new
	@mv config.toml.new config.toml

clean: ## remove what the other targets made
	rm -rf $(VENV) runs build dist *.egg-info .mypy_cache .ruff_cache .pytest_cache \
		.import_linter_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# A stamp is made last, so an installation that was cut short is done again.
$(VENV)/.installed: pyproject.toml constraints.txt
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); \
		echo "make: no virtual environment: install python3 (3.11 or later) and python3-venv"; \
		exit 1; }
	@echo "installing ins-robot into $(VENV) (once; a minute or two)" >&2
	@$(PIP) install --quiet -c constraints.txt -e .
	@touch $@

$(VENV)/.installed-dev: $(VENV)/.installed
	@echo "installing the development tools into $(VENV) (once)" >&2
	@$(PIP) install --quiet -c constraints.txt -e '.[dev]'
	@touch $@
