# `make demo` runs the paper, `make live` the arm in the browser, `make test` the tests.
# Each installs what it needs from PyPI into .venv first, and no more.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
ROS := $(VENV)/.ros
READY := $(VENV)/.ready

# Where Python keeps no compiled modules, each of some hundred processes compiles them.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo live docs test suite compiled test-load slow lint validate benchmark map-benchmark \
	latency real-time live-cost soak dist clean

demo: $(ROS)
	@echo 'Six experiments of 10 s over ROS 2, faster than real time, then figures: about a minute.'
	$(BIN)/ctc reproduce --out results --overwrite

# The paper's arm in real time in the browser, with buttons; Ctrl-C ends.
live: $(VENV)/.live
	$(BIN)/bringup --live --pacing real_time --duration 0

# The pages and the API as a site that asks nothing of the network: open site/index.html.
docs: $(VENV)/.docs
	rm -rf docs/_api site
	$(BIN)/python -m sphinx -W --keep-going --quiet -c docs -d build/doctrees . site

# Processes that run tests: more than two processors have, for some tests mostly wait; each takes
# seconds to import all tests.
WORKERS ?= 4
test: $(READY)
	@begin=$$(date +%s); \
	$(MAKE) --no-print-directory --jobs=2 --output-sync lint suite; status=$$?; \
	$(BIN)/python tools/calibration.py 'make test' $$begin; exit $$status

# All processors have work: BLAS has one thread, as in the commands.
suite slow test-load: export OPENBLAS_NUM_THREADS = 1

# "+" shows what it says at once, whatever else is made meanwhile.
suite: compiled $(VENV)/.collected
	+$(BIN)/python -m pytest --numprocesses=$(WORKERS) --dist=worksteal --durations=10

# The tests with ROS processes beside LOOPS busy loops, ROUNDS times.
LOOPS ?= 2
ROUNDS ?= 1
test-load: $(READY)
	PYTHONPATH=test/support $(BIN)/python tools/load.py --loops $(LOOPS) --rounds $(ROUNDS)

# Tests are compiled for Python once, not by each of the processes.
$(VENV)/.collected: $(READY) $(shell find test -name '*.py')
	$(BIN)/python -m pytest --collect-only --quiet > /dev/null
	touch $@

compiled: $(READY)
	PYTHONPATH=test/support:validation $(BIN)/python tools/compile_code.py

# What takes long: studies, robots identified, kills, pages; then properties with random examples.
slow: $(VENV)/.docs compiled
	@begin=$$(date +%s); \
	$(BIN)/python -m pytest -m slow --numprocesses=2 --dist=worksteal --durations=30 \
		-o faulthandler_timeout=3600 && \
	$(BIN)/python -m pytest -m 'hypothesis and not slow and not ros' --numprocesses=auto \
		--hypothesis-profile=random; status=$$?; \
	$(BIN)/python tools/calibration.py 'make slow' $$begin; exit $$status

# Style and types of the package; `make lint CHECKED=.`: of tests and studies, too, and their style
# by what ament checks a package with, which finds little more than ruff and takes twenty times as long.
CHECKED ?= ctc_chattering
lint: $(READY)
	$(BIN)/ruff check $(CHECKED)
ifeq ($(CHECKED),.)
	$(BIN)/flake8
	$(BIN)/pydocstyle --config=setup.cfg --property-decorators=none .
endif
	$(BIN)/mypy $(if $(filter .,$(CHECKED)),ctc_chattering test tools validation,$(CHECKED))

# The tables of docs/comparison.md, README and docs/study, in minutes. With the name of another
# program of validation/ as STUDY its table is printed (hours); ARGS=--help says what it takes.
STUDY ?= comparison_page imperfections_page
validate: $(READY)
	for study in $(STUDY); do PYTHONPATH=test/support:validation \
		$(BIN)/python validation/$$study.py $(ARGS) || exit; done

# Lockstep over ROS beside a bare ping-pong, a control step, a simulation; compiled runs beside
# plain ones and other simulators; period and answer time in real time, also of an exported law;
# what an open page costs.
benchmark map-benchmark latency real-time live-cost: $(READY)
	PYTHONPATH=test/support $(BIN)/python tools/benchmark/$(subst -,_,$@).py

# Random faults on the whole graph in real time; see validation/README.md. More arguments: ARGS.
MINUTES ?= 20
soak: $(READY)
	PYTHONPATH=tools:test/support $(BIN)/python -m soak --minutes $(MINUTES) $(ARGS)

# sdist and wheel of the last commit, in dist/.
dist: $(READY)
	$(PIP) build
	rm -rf dist build/dist && mkdir -p build/dist
	git archive HEAD | tar -x -C build/dist
	$(BIN)/python -m build --outdir dist build/dist

PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
# pip 26 shows setuptools' warning that a checkout can be imported.
$(ROS) $(VENV)/.live $(READY) $(VENV)/.docs: export PYTHONWARNINGS = ignore:Editable installation

# Editable, so that the configuration files of the checkout are the ones used.
$(ROS): setup.py setup.cfg package.xml
	@echo 'Installing ROS 2, NumPy, SciPy and Matplotlib from PyPI into $(VENV) (550 MB; once, about'
	@echo 'a minute) ...'
	$(PYTHON) -m venv $(VENV)
	$(PIP) -e '.[ros]'
	touch $@

$(VENV)/.live: $(ROS)
	$(PIP) -e '.[ros,live]'
	touch $@

$(READY): $(ROS)
	@echo 'Installing Pinocchio, MuJoCo, numba and tools for tests, too (2 GB; once, some minutes) ...'
	$(PIP) -e '.[ros,live,test,lint]'
	touch $@

$(VENV)/.docs: $(READY)
	$(PIP) -e '.[docs]'
	touch $@

clean:
	rm -rf $(VENV) results soak site docs/_api build dist install log *.egg-info
