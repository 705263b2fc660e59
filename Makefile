# SPDX-License-Identifier: Apache-2.0
# Copyright 2026 valve_twin maintainers
# make demo and make test do all their own set-up on a machine with Python 3.10-3.13, make and a C++ compiler.
# Another interpreter: make PYTHON=python3.12 test

PYTHON ?= python3
RUN := tools/run
ROS := $(VALVE_TWIN_ROS)
export VALVE_TWIN_ROS = $(ROS)

.PHONY: help setup demo test test-long test-slowest lock clean

help:
	@echo "make demo       run a simulated aging press valve with its twin, aging monitor and recorder; ends with a report"
	@echo "                another valve: make demo VALVE=NAME; tools/run python -m valve_twin.demo --help lists the names"
	@echo "                a valve of yours: make demo VALVE=NAME CONFIG=FILE, such as a file of valve-twin design export"
	@echo "make test       lint, types, tests, short benchmark"
	@echo "                with the wheels of ROS 2 Kilted, in an environment beside the other: make test ROS=kilted"
	@echo "make test-long  the statistical campaigns that make test leaves out"
	@echo "make test-slowest  make test, which tells of each step the 30 tests and fixtures that took the most CPU"
	@echo "make setup      environment, messages, package, all compiled kernels; make test calls it, make demo does what it needs of it"
	@echo "make lock       resolve the dependencies anew into requirements*.lock"
	@echo "make clean      remove everything that was built, the environment included"

setup:
	@$(PYTHON) tools/bootstrap.py

demo:
	@$(PYTHON) tools/bootstrap.py --demo $(VALVE)
	@$(RUN) python -m valve_twin.demo $(if $(VALVE),--valve $(VALVE)) $(if $(CONFIG),--config '$(CONFIG)')

test: setup
	@$(RUN) tools/check

test-long: setup
	@$(RUN) tools/check --long

test-slowest: setup
	@$(RUN) tools/check --slowest 30

lock:
	@$(PYTHON) tools/lock.py $(if $(UPGRADE),--upgrade)

clean:
	rm -rf .venv build install .venv-kilted build-kilted install-kilted log .mypy_cache .pytest_cache .ruff_cache .coverage
	find valve_twin test launch tools -name __pycache__ -type d -prune -exec rm -rf {} +
