# `make demo` runs the paper, `make live` the arm in the browser, `make test` the tests.
# Each installs what it needs from PyPI into .venv first, and no more.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
ROS := $(VENV)/.ros
READY := $(VENV)/.ready

# Where Python keeps no compiled modules, each of some hundred processes compiles them.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo live docs test suite compiled test-load slow lint compare rules held-out reproduced-table benchmark map-benchmark latency real-time live-cost soak identification faults dist clean

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

# Processes that run tests: more than two processors have, for many tests mostly wait.
WORKERS ?= 6
test: $(READY)
	@begin=$$(date +%s); \
	$(MAKE) --no-print-directory --jobs=2 --output-sync lint suite; status=$$?; \
	$(BIN)/python tools/calibration.py 'make test' $$begin; exit $$status

# "+" shows what it says at once, whatever else is made meanwhile.
suite: compiled
	+$(BIN)/python -m pytest --numprocesses=$(WORKERS) --dist=worksteal --durations=10

# The tests with ROS processes beside LOOPS busy loops, ROUNDS times.
LOOPS ?= 2
ROUNDS ?= 1
test-load: $(READY)
	PYTHONPATH=test/support $(BIN)/python tools/load.py --loops $(LOOPS) --rounds $(ROUNDS)

compiled: $(READY)
	PYTHONPATH=test/support:validation $(BIN)/python tools/compile_code.py

# Studies that take a minute or more each, and properties with random examples.
slow: $(VENV)/.docs
	@begin=$$(date +%s); \
	$(BIN)/python -m pytest -m slow -o faulthandler_timeout=3600 && \
	$(BIN)/python -m pytest -m 'not slow and not ros' --numprocesses=auto \
		--hypothesis-profile=random; status=$$?; \
	$(BIN)/python tools/calibration.py 'make slow' $$begin; exit $$status

# Style and types of the package; `make lint CHECKED=.`: of tests and studies, too.
CHECKED ?= ctc_chattering
lint: $(READY)
	$(BIN)/ruff check $(CHECKED)
	$(BIN)/flake8 $(CHECKED)
	$(BIN)/pydocstyle --config=setup.cfg --property-decorators=none $(CHECKED)
	$(BIN)/mypy $(if $(filter .,$(CHECKED)),ctc_chattering test tools validation,$(CHECKED))

# Every law with gains by rule in one condition, and judged in others: the tables of
# docs/comparison.md, in a minute.
compare: $(READY)
	$(BIN)/ctc compare friction --gains recommended --condition real_arm --held-out 24 \
		--overwrite --out docs/comparison/two_link
	$(BIN)/python validation/comparison_page.py

# Switchings, and laws, under one imperfection at a time: the tables of docs/study, in minutes.
imperfections: $(READY)
	PYTHONPATH=validation $(BIN)/python validation/imperfections_page.py docs/study

# Other numbers of the rules, on other draws; LAWS='pid_kalman' for some, minutes each.
rules: $(READY)
	$(BIN)/python validation/rule_study.py $(LAWS)

# Held-out conditions for `observer_feedback` on independent plants, in some ten minutes; ARGS as
# '--first 7000 --count 44 --label mine --rows FILE', rows that are there are not made again.
held-out: $(READY)
	PYTHONPATH=test/support $(BIN)/python validation/held_out_study.py $(ARGS)

# The two-link table of docs/comparison.md by an independent program, in a minute.
reproduced-table: $(READY)
	PYTHONPATH=test/support $(BIN)/python validation/reproduced_table.py

# Lockstep over ROS beside a bare ping-pong; a control step; a simulation.
benchmark: $(READY)
	$(BIN)/python tools/benchmark/benchmark.py

# Compiled runs beside plain ones, MuJoCo, and, where they are installed, JAX
# and Drake: a Markdown table, in some minutes.
map-benchmark: $(READY)
	PYTHONPATH=test/support $(BIN)/python tools/benchmark/compiled_loop.py

# Period and answer time of the loop in real time, with and without priority: a Markdown table.
latency: $(READY)
	$(BIN)/python tools/benchmark/latency.py

# The law in C at 1 kHz beside an empty loop: a Markdown table, in two minutes.
real-time: $(READY)
	$(BIN)/python tools/benchmark/real_time.py

# What an open page of `ctc live` costs the loop: a Markdown table.
live-cost: $(READY)
	PYTHONPATH=test/support $(BIN)/python tools/benchmark/live_cost.py

# Random faults on the whole graph in real time; see validation/README.md. More arguments: ARGS.
MINUTES ?= 20
soak: $(READY)
	PYTHONPATH=tools:test/support $(BIN)/python -m soak --minutes $(MINUTES) $(ARGS)

# The table of validation/identification.md: robots with random friction, identified; hours.
SEEDS ?= 20
identification: $(READY)
	PYTHONPATH=test/support $(BIN)/python validation/identification_study.py --seeds $(SEEDS) $(ARGS)

# The table of robots with the faults of real arms, of an independent plant; hours.
# ARGS='--only panda,tilt' for some, --rows FILE to go on with another file.
faults: $(READY)
	PYTHONPATH=test/support $(BIN)/python validation/fault_study.py --seeds $(SEEDS) $(ARGS)

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
