# Every target that needs Python first builds .venv, or finds it current at once (see .ci/venv).
# What the targets write is ignored by git: .venv, results/, caches.

ifeq ($(OS),Windows_NT)
PY = .venv/Scripts/python
else
PY = .venv/bin/python
endif

# Packages of another tool (ROS sets PYTHONPATH) would shadow the pinned ones.
unexport PYTHONPATH PYTHONHOME

.PHONY: help compare lab solutions test test-all bank benchmark check venv clean

help: ## list the targets
	@awk 'BEGIN { FS = ":.*## " } /^[a-z-]+:.*## / { printf "make %-9s %s\n", $$1, $$2 }' Makefile
	@echo
	@echo 'Arguments for the command behind a target:  make compare ARGS="--particles 100 --runs 5"'
	@echo 'Another interpreter than the first found:   make venv PYTHON=python3.13'

compare: venv ## particle filters against the exact Kalman filter; tables and figures in results/compare
	$(PY) -m lab compare --out results/compare $(ARGS)

lab: venv ## open the notebooks in JupyterLab
	$(PY) -m jupyter lab notebooks $(ARGS)

solutions: venv ## run the solutions, store their outputs, derive the students' notebooks
	$(PY) -m lab release --execute $(ARGS)

test: venv ## the test suite, in minutes
	$(PY) -m pytest -m "not long" -n auto --dist loadgroup $(ARGS)

test-all: venv ## the test suite with what takes longer
	$(PY) -m pytest -n auto --dist loadgroup $(ARGS)

bank: venv ## right and wrong answers through the checks, and their false alarms: about an hour on 2 idle cores
	$(PY) tests/bank.py $(ARGS)

benchmark: venv ## every filter against its peers: builds their environments, half an hour on an idle machine
	-$(PY) benchmarks/environments.py
	for script in particle_peers exact_filters accuracy growth particle_limit ekfslam_step; do \
	    $(PY) benchmarks/$$script.py || exit 1; done

check: venv ## lint, formatting and types
	$(PY) -m ruff check .
	$(PY) -m ruff format --check .
	$(PY) -m mypy

venv: ## build .venv, or rebuild it when the pins, pyproject.toml or PYTHON have changed
	@sh .ci/venv

clean: ## remove .venv, caches and build products (results/ stays)
	rm -rf .venv .pytest_cache .hypothesis .mypy_cache .ruff_cache build dist
	find . -name __pycache__ -prune -exec rm -rf {} +
	find . -name .ipynb_checkpoints -prune -exec rm -rf {} +
