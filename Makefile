# make test: set up, and test each promise once.  make test-long: all tests and checks, with every library that
# one of them needs.  make train: set up, learn to reach in a minute, report.  make coverage: what tests reach.
# make test-page: the tests of WebAssembly, of the page and of the site, which need Node.js and Chromium; make test-long
# skips those whose program it does not find.
# make docs: the site of the documentation, in build/site/html; once Sphinx and Jupyter are there, it needs no
# network. Notebooks are executed again only if they or the package changed, the hard cases each time.
# make claims: measure again the numbers that README and manual state, in a quarter of an hour; which are off?
# make fuzz MINUTES=10 SEED=0: random scenes, states and calls; failures become files in runs/fuzz.
# make gpu-check: compare a GPU with the CPU, bit by bit, and measure it; installs torch with CUDA, 6 GB.
# make mutation COUNT=300 SEED=0: random faults in the equations and the simulator; do the tests see them?
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
# of a notebook, whose back end for figures is not in this environment
unexport MPLBACKEND

.PHONY: test test-long test-page gpu-check docs claims fuzz mutation coverage train check clean
.DEFAULT_GOAL := test

# PyTorch's own index has it without 6 GB of CUDA; if it cannot be reached, any torch will do.
TORCH = https://download.pytorch.org/whl/cpu
INSTALL = $(BIN)/python -m pip install --quiet --no-compile --constraint constraints.txt torch==2.13.0 --editable

$(VENV)/ready-train: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed; set PYTHON=...")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	-$(BIN)/python -m pip install --quiet --no-compile --no-deps --retries 0 --index-url $(TORCH) torch==2.13.0
	$(INSTALL) '.[train]'
	touch $@

$(VENV)/ready: $(VENV)/ready-train
	$(INSTALL) '.[plot,verify,dev]'
	$(BIN)/python -c 'import stable_baselines3, sb3_contrib, scipy.optimize, matplotlib.pyplot'  # makes their bytecode
	touch $@

$(VENV)/ready-all: $(VENV)/ready
	$(INSTALL) '.[human,casadi,onnx,datasets,ray,tune,docs]'
	touch $@

PYTEST = $(BIN)/python -m pytest --numprocesses auto --maxprocesses 4 --dist worksteal

test: $(VENV)/ready
	$(PYTEST) -m "not long"

# .ci/run leaves out the tests that make test has run: make test-long MARK=long.
test-long: $(VENV)/ready-all check
	$(PYTEST) -m "$(MARK)"

test-page: $(VENV)/ready-all
	$(BIN)/python -m pip install --quiet 'playwright>=1.45'
	REDUNDANT_ENVS_TEST_PAGE=1 $(BIN)/python -m pytest tests/web

docs: $(VENV)/ready
	$(INSTALL) '.[docs]'
	$(BIN)/python docs/site/make.py --out build/site

claims: $(VENV)/ready-all
	$(BIN)/python docs/claims.py

coverage: $(VENV)/ready-all
	$(PYTEST) --cov --cov-report=term

MINUTES ?= 10
fuzz: $(VENV)/ready
	$(BIN)/python -m tests.fuzz --minutes $(MINUTES) $(if $(SEED),--seed $(SEED))

COUNT ?= 300
mutation: $(VENV)/ready
	$(BIN)/python -m pip install --quiet 'cosmic-ray>=8.4'
	$(BIN)/python -m tests.mutation --count $(COUNT) $(if $(SEED),--seed $(SEED))

check: $(VENV)/ready-all
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy --num-workers 2
	PATH="$(BIN):$$PATH" $(BIN)/lint-imports

# torch with CUDA has an environment of its own: the others have the one without.
.venv-gpu/ready: pyproject.toml
	$(PYTHON) -m venv .venv-gpu
	.venv-gpu/bin/python -m pip install --quiet --upgrade pip
	.venv-gpu/bin/python -m pip install --quiet torch --editable '.[train]'
	touch $@

gpu-check: .venv-gpu/ready
	.venv-gpu/bin/python -m tests.gpu.check

train: $(VENV)/ready-train
	$(BIN)/python -m agents train rprp_reach_sac total_steps=2000000

clean:
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .coverage
