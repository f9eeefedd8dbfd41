# handbench: `make table` runs the main job, `make test` the tests; both set everything up first.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
RUN    ?= runs/table
ROOMS  := radar calibration groundtruth bench reports
LINKS  := .types/handbench

.PHONY: setup table test test-all test-random messages hard-cases gpu fuzz bench lint docs coverage \
  requirements clean

setup: $(VENV)/.ready $(LINKS)

$(VENV)/.ready: requirements.txt pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo \
	    "handbench needs Python 3.11 or newer, but $(PYTHON) is older: try make PYTHON=python3.12"; \
	    exit 2; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes \
	  -r requirements.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps \
	  --no-build-isolation -e .
	@touch $@

# The package as one folder of links, for mypy, the documentation's site and `make gpu`, which do not
# install it.
$(LINKS): $(wildcard handbench/*)
	rm -rf $@ && mkdir -p $@
	ln -s $(ROOMS:%=../../%) \
	  $(patsubst %,../../%,$(filter-out %__pycache__,$(wildcard handbench/*))) $@

table: setup
	$(BIN)/handbench run paper_table -o $(RUN)
	$(BIN)/handbench report $(RUN) -o $(RUN)/report
	@$(BIN)/python -m docs.readme $(RUN)

# The tests that take less than 3 s each; test-all runs all of them.
test: lint
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "not slow"

test-all: lint
	$(BIN)/python -m pytest -n 2 --dist loadfile

# A quarter of the test files, in random order, and property tests on more and fresh examples;
# SEED=N repeats a run.
test-random: SEED := $(or $(SEED),$(shell od -An -N4 -tu4 /dev/urandom | tr -d ' '))
test-random: AGAIN = to repeat them: make test-random SEED=$(SEED)
test-random: QUARTER = $(shell $(PYTHON) -c 'import random, sys; random.seed($(SEED)); \
  print(*random.sample(sys.argv[1:], len(sys.argv) // 4))' \
  $(sort $(shell find tests -name 'test_*.py')))
test-random: setup
	@echo "A quarter of the tests in random order with seed $(SEED); $(AGAIN)"
	timeout 600 $(BIN)/python -m pytest --random-order --random-order-seed=$(SEED) -n 2 \
	  --dist loadfile $(QUARTER) || \
	  { echo "Tests in random order failed, or took 10 minutes, with seed $(SEED); $(AGAIN)"; exit 1; }
	@echo "Property tests on fresh examples with seed $(SEED); $(AGAIN)"
	$(BIN)/python -m pytest -m hypothesis --hypothesis-profile random \
	  --hypothesis-seed $(SEED) -n 2 --dist loadfile || \
	  { echo "Property tests failed with seed $(SEED); $(AGAIN)"; exit 1; }

# What the tests see refused, to be read by people: runs/messages.txt, one message a line.
messages: setup
	mkdir -p runs && rm -f runs/messages.txt
	HANDBENCH_MESSAGES=$(CURDIR)/runs/messages.txt $(BIN)/python -m pytest -n 2 --dist loadfile
	sort -u -o runs/messages.txt runs/messages.txt && cat runs/messages.txt

# The hard cases on this machine, its GPU too where there is one, with their table;
# GROUPS="phase data" runs two groups.
hard-cases: GROUPS ?= *
hard-cases: CASES = $(BIN)/python -m pytest $(GROUPS:%=tests/hard_cases/test_%_cases.py)
hard-cases: setup
	$(CASES)
	if $(BIN)/python -c 'import cupy; cupy.zeros(1)' 2>/dev/null; then \
	  HANDBENCH_DEVICE=cuda $(CASES); fi

# Tests of imaging on a CUDA device, and time and error of a volume there, by the packages of PYTHON,
# CuPy among them, without .venv: runs/gpu/gpu.json and gpu.md. DEVICE=numpy or cpu does the same on
# the processor.
gpu: export PYTHONSAFEPATH := 1
gpu: export PYTHONPATH := $(CURDIR)/.types:$(CURDIR):$(PYTHONPATH)
gpu: $(LINKS)
	$(PYTHON) -c 'import setuptools; setuptools.setup()' --quiet egg_info --egg-base .types
	HANDBENCH_DEVICE=$(or $(DEVICE),cuda) PYTEST_DISABLE_PLUGIN_AUTOLOAD=1 $(PYTHON) -m pytest \
	  -W default tests/radar/imaging tests/radar/methods
	$(PYTHON) -m tests.radar.imaging.measure_gpu --device $(or $(DEVICE),cuda) -o runs/gpu

# Broken files of all readers; SEED=N repeats those of an earlier run.
fuzz: setup
	$(BIN)/python -m pytest tests/fuzz --hypothesis-profile fuzz \
	  --hypothesis-seed $(or $(SEED),random)

bench: setup
	$(BIN)/python -m handbench.bench.studies -o runs/bench.json

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy --no-error-summary

# The documentation as one site, runs/site/index.html; warnings are errors, and nothing is fetched.
docs: setup
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet -f docs/mkdocs.yml

coverage: setup
	$(BIN)/python -m coverage erase
	$(BIN)/python -m coverage run -m pytest -n 2 --dist loadfile
	$(BIN)/python -m coverage combine --quiet
	$(BIN)/python -m coverage html --quiet
	$(BIN)/python -m coverage report

# Re-pins every dependency (needs uv on the PATH); the result names no registry.
requirements:
	uv pip compile --universal --python-version 3.11 --generate-hashes --no-emit-index-url \
	  --no-header --extra dev pyproject.toml -o requirements.txt

clean:
	rm -rf $(VENV) .types .mypy_cache .ruff_cache build dist *.egg-info
