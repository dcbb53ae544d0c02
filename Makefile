# `make bench` and `make test` do all set-up by themselves; everything lives in .venv.
# A smaller torch where there is no GPU:  make setup PIP_FLAGS="--extra-index-url https://download.pytorch.org/whl/cpu"
PYTHON ?= python3
PIP_FLAGS ?=
ARGS ?=
PY := .venv/bin/python
READY := .venv/.ready
# A process a core, a file in one process; linear algebra on one thread each, or they wait for one another.
TEST := OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(PY) -m pytest -n auto --dist loadfile

.PHONY: help setup bench test lint check docs format figures speed accuracy identification diagnosis lock clean

help:                ## this list
	@grep -hE '^[a-z]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 12

setup: $(READY)      ## make .venv with the pinned packages and compile the simulator

$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "Python 3.11 or newer is needed; $(PYTHON) is $$($(PYTHON) --version). Try: make PYTHON=python3.11"; exit 2; }
	$(PYTHON) -m venv .venv
	$(PY) -m pip install --quiet --disable-pip-version-check $(PIP_FLAGS) -r requirements.lock
	$(PY) -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	$(PY) -c 'from inkjet_env.envs.task import warm_up; warm_up()'
	$(PY) -c 'from inkjet_env.identification.basis import warm_up; warm_up()'
	$(PY) -m inkjet_env.plant.warm_up
	@touch $@

bench: $(READY)      ## compare the optimisers (ARGS="--repeats 30 …"); resumes; writes results/bench/report.html
	.venv/bin/inkjet bench $(ARGS)

test: $(READY)       ## run the tests
	$(TEST) $(ARGS)

lint: $(READY)       ## lint, format, types
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy

check: lint test     ## lint, format, types, tests

docs: $(READY)       ## build the documentation, running its tutorials: build/docs/index.html; a warning is an error
	$(PY) -m sphinx -W --keep-going -q -E -j 2 -d build/doctrees -b html docs build/docs $(ARGS)

format: $(READY)     ## let ruff format and mend what it can
	.venv/bin/ruff check --fix .
	.venv/bin/ruff format .

figures: $(READY)    ## draw the pictures of README and docs again
	$(PY) -m experiments.publish.figures

speed: $(READY)      ## evaluations per second against SciPy, environment steps against Gymnasium's, one run
	$(PY) -m experiments.validation.simulator_speed
	$(PY) -m experiments.validation.plant_speed

accuracy: $(READY)   ## the closed form against an 80-digit reference
	$(PY) -m experiments.validation.closed_form_accuracy

identification: $(READY)  ## errors, coverage, peers: how well identification does (ARGS="all FOLDER" with measured data)
	$(PY) -m experiments.validation.identification_study $(ARGS)

diagnosis: $(READY)  ## nothing, each effect, pairs, effects withheld: how well the diagnosis does (ARGS="null --seeds 3")
	$(PY) -m experiments.validation.diagnosis_study $(ARGS)

lock: $(READY)       ## write requirements.lock from what .venv holds
	{ echo "# The environment the tests pass in. Made by \`make lock\`; pyproject.toml says what is asked for and why."; \
	  $(PY) -m pip freeze --all --exclude-editable --exclude pip --exclude wheel | sed -E 's/^torch( @ .*|==.*)$$/torch==2.13.0/'; \
	} > requirements.lock.new && mv requirements.lock.new requirements.lock

clean:               ## remove .venv, caches and results
	rm -rf .venv results build .pytest_cache .mypy_cache .ruff_cache
	find . -name __pycache__ -prune -exec rm -rf {} +
