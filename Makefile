# `make demo` and `make test` are the whole set-up: each builds its own environment from a committed lock file.
PYTHON ?= python3
RUN = .venv/run
DEV = .venv/dev
ROS = .venv/ros
WHAT_IS_BUILT = pyproject.toml Makefile

SECONDS = 600

.PHONY: demo live-demo test test-ros bench-ros test-quick explore fuzz bench experiment lint types docs check lock clean

demo: $(RUN)/ready  ## the main job on two measured sets; writes ./contactwrench-demo
	$(RUN)/bin/contactwrench demo --out contactwrench-demo --force

live-demo: $(RUN)/ready  ## the virtual lab and a live session on it; the page's address is printed; until Ctrl-C
	$(RUN)/bin/contactwrench lab --live

test: $(DEV)/ready  ## all tests, the same examples at every run
	$(DEV)/bin/python -m pytest -n auto

test-ros: $(ROS)/ready  ## the ROS node on real rclpy
	. $(ROS)/install/local_setup.sh && $(ROS)/bin/python -m pytest -c tests_ros/pytest.ini tests_ros

bench-ros: $(ROS)/ready  ## its latency and load at 1 kHz
	. $(ROS)/install/local_setup.sh && $(ROS)/bin/python -m benchmarks.ros

test-quick: $(DEV)/ready  ## what is not marked slow
	$(DEV)/bin/python -m pytest -n auto -m "not slow"

explore: $(DEV)/ready  ## property tests with new seeds until one fails, for SECONDS
	$(DEV)/bin/python -m tests.explore $(SECONDS)

fuzz: $(DEV)/ready  ## damaged and hostile files through the program, 300 of each kind, at most SECONDS; prints its seed
	$(DEV)/bin/python -m tests.fuzz --seconds $(SECONDS)

bench: $(DEV)/ready  ## accuracy against the Cramer-Rao bound, speed against memcpy
	$(DEV)/bin/python -m benchmarks

experiment: $(RUN)/ready  ## the paper's experiment on the virtual rig; docs/experiment.md is made by it
	$(RUN)/bin/python -m reproduction --out contactwrench-experiment
	cp contactwrench-experiment/experiment.md docs/experiment.md
	cp contactwrench-experiment/images/* docs/images/

lint: $(DEV)/ready
	$(DEV)/bin/ruff check
	$(DEV)/bin/ruff format --check

types: $(DEV)/ready
	$(DEV)/bin/mypy

docs: $(DEV)/ready  ## site/, the guide and the API; every link resolves and every code block of the pages runs
	NO_MKDOCS_2_WARNING=1 $(DEV)/bin/mkdocs build --strict --quiet
	$(DEV)/bin/python -m pytest tests/test_docs.py

check: lint types test-quick  ## one's own loop

$(RUN)/ready: requirements.lock $(WHAT_IS_BUILT)
	$(PYTHON) -m venv --clear $(RUN)
	$(RUN)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --require-hashes -r requirements.lock
	$(RUN)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	touch $@

$(DEV)/ready: requirements-dev.lock $(WHAT_IS_BUILT)
	$(PYTHON) -m venv --clear $(DEV)
	$(DEV)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --require-hashes -r requirements-dev.lock
	$(DEV)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	touch $@

$(ROS)/packages: requirements-ros.lock $(WHAT_IS_BUILT)
	$(PYTHON) -m venv --clear $(ROS)
	$(ROS)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --require-hashes -r requirements-ros.lock
	$(ROS)/bin/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	touch $@

$(ROS)/ready: $(ROS)/packages tests_ros/workspace.py $(shell find ros2 tests_ros/tf2_msgs -type f)
	$(ROS)/bin/python -m tests_ros.workspace
	touch $@

LOCK = $(DEV)/bin/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes \
	--no-emit-index-url --custom-compile-command "make lock" --upgrade pyproject.toml
lock: $(DEV)/ready  ## exact versions with hashes, no addresses
	$(LOCK) --extra all --group build -o requirements.lock
	$(LOCK) --extra all --group dev -o requirements-dev.lock
	$(LOCK) --group ros -o requirements-ros.lock

clean:
	rm -rf .venv site contactwrench-demo contactwrench-experiment
