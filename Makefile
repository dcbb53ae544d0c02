# `make bench` and `make test` set everything up in .venv if necessary.
# A smaller torch for machines without a GPU:  make setup PIP_FLAGS="--extra-index-url https://download.pytorch.org/whl/cpu"
PYTHON ?= python3
PIP_FLAGS ?=
ARGS ?=
PY := .venv/bin/python
READY := .venv/.ready
# Each test file in one process, and one process more than cores: tests of browsers and killed processes mostly wait.
# Linear algebra uses one thread per process, to avoid contention.
PROCESSES := $(shell expr $$(getconf _NPROCESSORS_ONLN) + 1)
TEST := OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(PY) -m pytest -n $(PROCESSES) --dist loadfile

.PHONY: help setup bench test lint check docs format figures speed accuracy identification diagnosis measured lock clean

help:                ## print this list
	@grep -hE '^[a-z]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 12

setup: $(READY)      ## make .venv with the pinned packages and compile the simulator

$(READY): requirements.lock pyproject.toml setup.py
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
		{ echo "Python 3.11 or newer is needed; $(PYTHON) is $$($(PYTHON) --version). Try: make PYTHON=python3.11"; exit 2; }
	@echo "1 of 3: .venv and its packages: one to three minutes, most of them to download and to unpack"
	@$(PYTHON) -m venv .venv
	@$(PY) -m pip install --disable-pip-version-check --progress-bar off $(PIP_FLAGS) -r requirements.lock
	@$(PY) -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@echo "2 of 3: compiling the simulator: half a minute"
	@$(PY) -c 'from inkjet_env.envs.task import warm_up; warm_up()'
	@$(PY) -c 'from inkjet_env.identification.basis import warm_up; warm_up()'
	@echo "3 of 3: compiling the plant: half a minute"
	@$(PY) -m inkjet_env.plant.warm_up
	@touch $@
	@echo "Ready. Run: . .venv/bin/activate"

bench: $(READY)      ## compare the optimisers (ARGS="--repeats 30 …"); resumes; writes results/bench/report.html
	.venv/bin/inkjet bench $(ARGS)

test: $(READY)       ## run the tests
	$(TEST) $(ARGS)

lint: $(READY)       ## check lint, format and types
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	@rm -rf build/typed && mkdir -p build/typed/inkjet_env
	@ln -s $(abspath $(wildcard inkjet_env/*) optimizers experiments) build/typed/inkjet_env/
	@ln -s $(abspath experiments) build/typed/experiments  # the concealed plant imports itself by this name
	cd build/typed && ../../.venv/bin/mypy --config-file ../../pyproject.toml --cache-dir ../../.mypy_cache

check: lint test     ## check lint, format and types, and run the tests

docs: $(READY)       ## run the tutorials and build the documentation: build/docs/index.html; a warning is an error
	$(PY) -m sphinx -W --keep-going -q -E -j 2 -d build/doctrees -b html docs build/docs $(ARGS)

format: $(READY)     ## format the code and apply automatic fixes (ruff)
	.venv/bin/ruff check --fix .
	.venv/bin/ruff format .

figures: $(READY)    ## draw the figures of README and docs
	$(PY) -m inkjet_env.experiments.publish.figures
	$(PY) -m inkjet_env.reporting.waveform_figures docs/figures/waveform.png

speed: $(READY)      ## measure speed as ratios (against SciPy, Gymnasium) into results/speed.json (ARGS="--record FILE")
	$(PY) -m inkjet_env.experiments.validation.speed $(ARGS)

accuracy: $(READY)   ## compare the closed form with an 80-digit reference
	$(PY) -m inkjet_env.experiments.validation.closed_form_accuracy

identification: $(READY)  ## study the identification: errors, coverage, alternatives (ARGS="all FOLDER" with measured data)
	$(PY) -m inkjet_env.experiments.validation.identification_study $(ARGS)

diagnosis: $(READY)  ## study the diagnosis: no effect, each effect, pairs, withheld effects (ARGS="null --seeds 3")
	$(PY) -m inkjet_env.experiments.validation.diagnosis_study $(ARGS)

measured: $(READY)   ## diagnose measured campaigns (DIR=folder of campaigns; ARGS="--hold-out NAME:r1,r2")
	$(PY) -m inkjet_env.experiments.validation.measured $(DIR) $(ARGS)

lock: $(READY)       ## write requirements.lock from the packages in .venv
	{ echo "# The environment in which the tests pass. Written by \`make lock\`; pyproject.toml states the requirements and their reasons."; \
	  $(PY) -m pip freeze --all --exclude-editable --exclude pip --exclude wheel | sed -E 's/^torch( @ .*|==.*)$$/torch==2.13.0/'; \
	} > requirements.lock.new && mv requirements.lock.new requirements.lock

clean:               ## remove .venv, caches and results
	rm -rf .venv results build .pytest_cache .mypy_cache .ruff_cache
	find . -name __pycache__ -prune -exec rm -rf {} +
