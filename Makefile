# Two commands: `make repro` (the paper) and `make test`. Each target first makes the environment .venv from the hashed lock files.
# The checkout may lie in a path with blanks: every absolute path in a recipe is quoted.
SHELL := /bin/sh
PYTHON ?= $(shell for p in python3.12 python3.11 python3 python; do \
	$$p -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 12))' 2>/dev/null && { echo $$p; break; }; done)
VENV := .venv
BIN := $(CURDIR)/$(VENV)/bin
READY := $(VENV)/.ready
PEERS := .venv-peers
VIEW := .venv-view
export PATH := $(BIN):$(PATH)
export DVC_NO_ANALYTICS := 1
export HOME ?= $(CURDIR)/$(VENV)
# Python caches bytecode, as numba caches machine code; without the caches every process compiles its sources anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: env view mend repro all test test-all smoke real synthetic audit bench bench-scale lint lock clean-env

# The environment alone.
env: $(READY)

# The viewer Rerun, for `python -m pipeline view TAKE`.
view: $(READY) $(VIEW)/.ready

# The paper alone. A killed DVC may leave files on which it fails.
repro: $(READY) mend
	dvc repro
	@folder=reports/$$(cat data/dataset.txt); echo "Results: report $$folder/report.md, page $$folder/index.html, model card $$folder/model_card.md"

mend: $(READY)
	@python -m pipeline lock > /dev/null

# The paper, the studies and the page of results.
all: $(READY) mend
	dvc repro -P

# Every test of less than about two seconds.
test: $(READY)
	python -m pytest -q -n auto --dist worksteal -m "not slow"

# Every test; the seconds of each module are written to tests/durations.csv. Some tests need the peers' collection of arms, others the viewer Rerun.
test-all: $(READY) $(PEERS)/.ready $(VIEW)/.ready
	python -m pytest -q -n auto --dist worksteal --durations-file=tests/durations.csv

# Every stage at the smallest scale, in one process; `make smoke DATASET=ur5` on other recordings.
DATASET := youbot
smoke: $(READY)
	python tests/whole/copies.py .smoke --smoke $(DATASET)

# The same analysis of recordings of real robots: the report compares the verdicts.
real: $(READY)
	python tests/whole/copies.py .real ur5 ur5_planar ur5_rounds lwr4 youbot_real

# The same analysis of synthetic recordings: another arm, forces without an arm, the youBot with another task and with other causes of its noise.
synthetic: $(READY)
	python tests/whole/copies.py .real lwr4_lab youbot_redundant youbot_sway youbot_poses towing

# All stages in a clean clone of the commit, without any earlier output; fails if a result differs from the commit.
audit: $(READY)
	python -m pipeline audit .audit

# Ratios to other libraries, first use, speed of a step, growth of cost, equal bytes, and times of the commands above: reports/benchmarks.md. Run it on an idle machine.
bench: $(READY) $(PEERS)/.ready
	python tests/benchmarks/contests.py .bench/contests
	python tests/benchmarks/start.py .bench/cache
	python tests/benchmarks/growth.py
	python tests/benchmarks/equal_bytes.py .bench/levels
	python tests/benchmarks/times.py .bench/times
	python tests/benchmarks/summary.py

# A million particles, and ten thousand takes. Run it on an idle machine.
bench-scale: $(READY)
	python tests/benchmarks/growth.py --scale
	python tests/benchmarks/summary.py

lint: $(READY)
	ruff check . && ruff check --quiet --select COM812 . && ruff format --check .

# A new environment whenever a lock changes. uv only installs: every file is checked against its hash. The last file lets Python find the
# project where PYTHONSAFEPATH is set.
$(READY): requirements.lock uv.requirements build-constraints.txt
	@test -n "$(PYTHON)" || { echo "error: no Python 3.11 or 3.12 found (looked for python3.12, python3.11, python3, python); install one, or name it: make PYTHON=/path/to/python3.12" >&2; exit 1; }
	@"$(PYTHON)" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 12))' || { echo "error: $(PYTHON) is no Python 3.11 or 3.12" >&2; exit 1; }
	@"$(PYTHON)" -c 'import venv, ensurepip' 2>/dev/null || { echo "error: $(PYTHON) lacks the venv module; on Debian and Ubuntu install python3-venv" >&2; exit 1; }
	@command -v git >/dev/null || { echo "error: git is missing; DVC needs it" >&2; exit 1; }
	rm -rf $(VENV)
	"$(PYTHON)" -m venv $(VENV)
	"$(BIN)"/python -m pip install --quiet --disable-pip-version-check --require-hashes -r uv.requirements
	"$(BIN)"/uv pip sync --quiet --system-certs --python "$(BIN)/python" --require-hashes --build-constraint build-constraints.txt requirements.lock
	for folder in $(VENV)/lib/python3.*/site-packages; do echo ../../../.. > "$$folder/checkout.pth"; done
	touch $@

# The peers of the benchmarks, in an environment of their own.
$(PEERS)/.ready: tests/benchmarks/peers.lock build-constraints.txt | $(READY)
	rm -rf $(PEERS)
	"$(BIN)"/uv venv --quiet --python "$(BIN)/python" $(PEERS)
	"$(BIN)"/uv pip sync --quiet --system-certs --python $(PEERS)/bin/python --require-hashes --build-constraint build-constraints.txt tests/benchmarks/peers.lock
	touch $@

# The viewer Rerun, in an environment of its own.
$(VIEW)/.ready: requirements-view.lock | $(READY)
	rm -rf $(VIEW)
	"$(BIN)"/uv venv --quiet --python "$(BIN)/python" $(VIEW)
	"$(BIN)"/uv pip sync --quiet --system-certs --python $(VIEW)/bin/python --require-hashes requirements-view.lock
	touch $@

# Renew the locks after a change of pyproject.toml; needs an environment.
lock: $(READY)
	uv pip compile --system-certs pyproject.toml --group test --universal --fork-strategy fewest --generate-hashes --no-emit-index-url --no-header \
		--python-version 3.11 --build-constraint build-constraints.txt -o requirements.lock
	uv pip compile --system-certs tests/benchmarks/peers.in --override tests/benchmarks/peers.overrides --universal --fork-strategy fewest --generate-hashes --no-emit-index-url --no-header \
		--python-version 3.11 --build-constraint build-constraints.txt -o tests/benchmarks/peers.lock
	uv pip compile --system-certs requirements-view.in -c requirements.lock --universal --fork-strategy fewest --generate-hashes --no-emit-index-url --no-header \
		--python-version 3.11 -o requirements-view.lock

clean-env:
	rm -rf $(VENV) $(PEERS) $(VIEW)
