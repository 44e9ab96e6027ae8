# Each target does all its own set-up; a machine with python3 (3.11 or newer, with venv), make and cc is enough.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

# A multiplier for the tests' budgets: how many random cases, vectors and steps they try.
LONG_BUDGET ?= 10

.PHONY: help venv demo test test-long test-baselines coverage mutation check format docs reference clean

help:
	@echo "make demo       evolve, generate C, verify it, make a page of it, in demo/; then the same for a committed champion"
	@echo "make test       the tests; installs cross compilers where apt allows it (not with BITNEAT_NO_APT=1)"
	@echo "make test-long  all tests, the long ones included, with $(LONG_BUDGET) times the budget"
	@echo "make test-baselines  those that train with bitneat[baselines], which it installs: PyTorch is large"
	@echo "make coverage   the tests with branch coverage: all of the core, and most of the rest"
	@echo "make mutation   mutants of the C and of the Python core, judged by the tests: hours; goes on where it stopped"
	@echo "make check      ruff, mypy, clang-format, and the C runtime under CMake"
	@echo "make format     ruff format and clang-format"
	@echo "make docs       the documentation site, in build/site"
	@echo "make reference  the pages of the command line and of configurations, from the code"
	@echo "make venv       the Python environment in $(VENV)"
	@echo "make clean      remove what the other targets made"

venv: $(READY)

$(READY): pyproject.toml
	@echo "setting up $(VENV)"
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

demo: $(READY)
	@PATH="$(CURDIR)/$(BIN):$$PATH" tools/demo.sh

test: $(READY)
	@tools/install-debian-tools.sh
	@$(BIN)/python -m pytest -n auto -m "not long"

test-long: $(READY)
	@tools/install-debian-tools.sh long
	@BITNEAT_TEST_BUDGET=$(LONG_BUDGET) $(BIN)/python -m pytest -n auto

test-baselines: $(READY)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev,baselines]'
	@$(BIN)/python -m pytest -n auto tests/baselines tests/distill tests/cli/test_baseline.py tests/cli/test_distill.py

# The core is what decides the meaning of a controller and judges the code: all of it is executed, every branch both ways.
CORE := bitneat/controller/*,bitneat/codegen/*,bitneat/verify/*

coverage: $(READY)
	@tools/install-debian-tools.sh
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev,baselines]'
	@$(BIN)/python -m pytest -n auto -m "not long" --cov --cov-context=test --cov-report= --junitxml=build/tests.xml
	@$(BIN)/coverage report --fail-under=95
	@$(BIN)/coverage report --include='$(CORE)' --fail-under=100

CORE_FILES = $(shell find bitneat/controller bitneat/codegen bitneat/verify -name '*.py')

mutation: coverage
	@$(BIN)/python -m tests.mutation.run_c -o build/mutants-of-c.jsonl
	@$(BIN)/python -m tests.mutation.run_python $(CORE_FILES) --coverage .coverage --junit build/tests.xml -o build/mutants-of-python.jsonl

# Not those that bitneat.codegen.runtime writes.
C_SOURCES = $(shell grep -rL 'Written by .python -m' --include='*.[ch]' runtime_c bitneat/sim/walker/csrc \
	bitneat/verify/targets/csrc) $(wildcard examples/firmware-*/*.[ch])

check: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/clang-format --dry-run -Werror $(C_SOURCES)
	$(BIN)/cmake -S . -B build/check -DCMAKE_BUILD_TYPE=Release >/dev/null
	$(BIN)/cmake --build build/check --parallel >/dev/null
	cd build/check && "$(CURDIR)/$(BIN)/ctest" --output-on-failure

format: $(READY)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/clang-format -i $(C_SOURCES)

docs: $(READY)
	@NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --strict
	@echo "build/site/index.html; to search in it, too: $(BIN)/python -m http.server -d build/site"

reference: $(READY)
	@$(BIN)/python -m tools.reference

clean:
	rm -rf $(VENV) build dist demo .pytest_cache .hypothesis .mypy_cache .ruff_cache
	find bitneat tests -name __pycache__ -prune -exec rm -rf {} +
