# make test: set up and test.  make test-long: all tests, also those that compile many scenes.
# make train: set up, learn to reach, report.  make coverage: what tests reach.
# make test-page: the tests of WebAssembly and of the page, which need Node.js and Chromium; make test skips
# those whose program it does not find.
# make docs: the site of the documentation, in build/site/html; once Sphinx and Jupyter are there, it needs no
# network. Notebooks are executed again only if they or the package changed.
# make fuzz MINUTES=10 SEED=0: random scenes, states and calls; failures become files in runs/fuzz.
# make mutation COUNT=300 SEED=0: random faults in the equations and the simulator; do the tests see them?
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin

.PHONY: test test-long test-page docs fuzz mutation coverage train check clean
.DEFAULT_GOAL := test

$(VENV)/ready: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed; set PYTHON=...")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --no-compile --constraint constraints.txt torch==2.13.0 \
	  --editable '.[train,plot,human,verify,casadi,onnx,datasets,ray,tune,dev]'
	touch $@

test: $(VENV)/ready check
	$(BIN)/python -m pytest -m "not long" --numprocesses auto --maxprocesses 4 --dist worksteal

DOCS = $(BIN)/python -m pip install --quiet --no-compile --constraint constraints.txt --editable '.[docs]'

test-long: $(VENV)/ready
	$(DOCS)
	$(BIN)/python -m pytest --numprocesses auto --maxprocesses 4 --dist worksteal

test-page: $(VENV)/ready
	$(BIN)/python -m pip install --quiet 'playwright>=1.45'
	REDUNDANT_ENVS_TEST_PAGE=1 $(BIN)/python -m pytest tests/web

docs: $(VENV)/ready
	$(DOCS)
	$(BIN)/python docs/site/make.py --out build/site

coverage: $(VENV)/ready
	$(BIN)/python -m pytest --numprocesses auto --maxprocesses 4 --dist worksteal --cov --cov-report=term

MINUTES ?= 10
fuzz: $(VENV)/ready
	$(BIN)/python -m tests.fuzz --minutes $(MINUTES) --processes 2 $(if $(SEED),--seed $(SEED))

COUNT ?= 300
mutation: $(VENV)/ready
	$(BIN)/python -m pip install --quiet 'cosmic-ray>=8.4'
	$(BIN)/python -m tests.mutation --count $(COUNT) $(if $(SEED),--seed $(SEED))

check: $(VENV)/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy --num-workers 2
	PATH="$(BIN):$$PATH" $(BIN)/lint-imports

train: $(VENV)/ready
	$(BIN)/python -m agents train configs/training/rprp_reach_sac.yaml total_steps=3000000

clean:
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .coverage
