# Two commands: `make repro` and `make test`. Both make their own environment in .venv from the hashed lock files.
SHELL := /bin/sh
PYTHON ?= $(shell for p in python3.12 python3.11 python3 python; do \
	$$p -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 12))' 2>/dev/null && { echo $$p; break; }; done)
VENV := .venv
BIN := $(CURDIR)/$(VENV)/bin
READY := $(VENV)/.ready
export PATH := $(BIN):$(PATH)
export DVC_NO_ANALYTICS := 1
export HOME ?= $(CURDIR)/$(VENV)

.PHONY: repro test smoke real lint lock clean-env

repro: $(READY)
	dvc repro

test: $(READY)
	python -m pytest -q -n auto --dist loadgroup

smoke: $(READY)
	python tests/smoke.py .smoke

# The same analysis on the recordings of real robots, for the verdicts side by side.
real: $(READY)
	python tests/real.py .real

lint: $(READY)
	ruff check . && ruff format --check .

# A new environment whenever a lock changes. uv only installs: every file is checked against its hash.
$(READY): requirements.lock uv.requirements build-constraints.txt
	@test -n "$(PYTHON)" || { echo "error: no Python 3.11 or 3.12 found (looked for python3.12, python3.11, python3, python); install one, or name it: make PYTHON=/path/to/python3.12" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 12))' || { echo "error: $(PYTHON) is no Python 3.11 or 3.12" >&2; exit 1; }
	@$(PYTHON) -c 'import venv, ensurepip' 2>/dev/null || { echo "error: $(PYTHON) lacks the venv module; on Debian and Ubuntu install python3-venv" >&2; exit 1; }
	@command -v git >/dev/null || { echo "error: git is missing; DVC needs it" >&2; exit 1; }
	rm -rf $(VENV)
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r uv.requirements
	$(BIN)/uv pip sync --quiet --system-certs --python $(BIN)/python --require-hashes --build-constraint build-constraints.txt requirements.lock
	touch $@

# Renew the locks after a change of pyproject.toml; needs an environment.
lock: $(READY)
	uv pip compile --system-certs pyproject.toml --group test --universal --fork-strategy fewest --generate-hashes --no-emit-index-url --no-header \
		--python-version 3.11 --build-constraint build-constraints.txt -o requirements.lock

clean-env:
	rm -rf $(VENV)
