# make demo   the comparison of the paper on simulated traffic: no data needed, one to two minutes. MTP-Intersection-v0 and its
#             first 40 scenes were chosen so that both differences in its verdict are significant; with fewer they are not
# make test   lint, types, import rules and tests, which build the site too; DATA=folder or MTP_BENCH_DATA adds those on real recordings.
#             It needs what pip brings: tests that need more are skipped, and the last lines say how to get it
# make quick  lint, types, import rules and the tests that take less than .3 s of a core each; some minutes
# make slow   the list of the other tests, tests/slow.txt, made anew from what the last `make test` took
# make skipped  the tests that the last run skipped, for a machine that has now what they need
# make held   for root: the tests of the gateway as an ordinary user
# make lint   the same without tests, and pyright, which takes a minute alone: what users see in their editors
# make docs   the site in site/: static, no server and no network needed; warnings are errors; DATA=folder or MTP_BENCH_DATA adds pictures of recordings
# make pages  the board, the tables of RESULTS.md and the README, and the curves of robustness, made anew from what is stored in leaderboard/
# All create .venv and install what they need the first time; PYTHON=python3.13 chooses another interpreter for it.

DATA ?= $(MTP_BENCH_DATA)
ifneq ($(DATA),)
export MTP_BENCH_DATA := $(DATA)
endif
BIN := .venv/bin
PYTHON ?= python3.11
# uv installs in a third of the time that pip takes; where it cannot, pip does. It is told of pip's own index and folders of wheels.
OPTIONS := --quiet --constraint constraints.txt --editable
UV := UV_FIND_LINKS="$(PIP_FIND_LINKS)" $(BIN)/uv pip install --python $(BIN)/python \
	$(addprefix --default-index ,$(PIP_INDEX_URL)) $(OPTIONS)
PIP := $(BIN)/python -m pip install $(OPTIONS)
install = { $(BIN)/python -m pip install --quiet uv && $(UV) $(1); } || $(PIP) $(1)
unexport PYTHONDONTWRITEBYTECODE
export PYRIGHT_PYTHON_IGNORE_WARNINGS := 1

# the longest first and several at a time: each of them works on one core
CHECKS := mypy import-linter ruff

SKIPPED := .pytest_cache/skipped
WORKERS := auto
COSTS := .pytest_cache/costs
PYTEST := pytest -q --numprocesses $(WORKERS) --dist loadfile --no-loadscope-reorder
ALL_TESTS := --list-skipped=$(SKIPPED) --list-costs=$(COSTS)
COLLECTED := .pytest_cache/collected

.PHONY: demo test quick slow pytest skipped held lint kernels $(CHECKS) pyright docs pages clean

demo: .venv/installed
	@$(BIN)/mtp-bench compare mtp --env MTP-Intersection-v0 --scenes 40 --seeds 1

# the checks work on a core each while the tests, which often wait, begin
test: .venv/installed-dev
	@$(MAKE) --no-print-directory --jobs 4 kernels $(COLLECTED) $(CHECKS) pytest TESTS='$(ALL_TESTS)'

quick: .venv/installed-dev
	@$(MAKE) --no-print-directory --jobs 4 kernels $(COLLECTED) $(CHECKS) pytest TESTS=--quick

slow: $(COSTS)
	@$(BIN)/python -m tests.support.costs $<

# A folder of its own for temporary files: at its end pytest clears away those of earlier runs, and fails where tests
# that run pytest themselves are doing the same.
pytest: kernels $(COLLECTED)
	@echo '== pytest'
	@folder=$$(mktemp -d) && { $(BIN)/python -m $(PYTEST) --basetemp $$folder/pytest $(TESTS); status=$$?; \
		rm -rf $$folder; exit $$status; }

# An empty list would mean all tests.
skipped: .venv/installed-dev
	@[ ! -s $(SKIPPED) ] || $(MAKE) --no-print-directory pytest TESTS='@$(SKIPPED) --list-skipped=$(SKIPPED)' WORKERS=2

# The sandbox holds agents for an ordinary user too, whom root plays here. All other tests of the gateway are the same
# for every user.
held: .venv/installed-dev kernels
	@echo '== pytest: the gateway, as an ordinary user'
	@$$($(BIN)/python -c 'from mtp_bench.judge.gateway.sandbox import bubblewrap; print(bubblewrap())') \
		--unshare-user --uid 1000 --gid 1000 --cap-drop ALL --dev-bind / / $(BIN)/python -m pytest -q \
		--numprocesses 2 --dist loadfile tests/gateway/test_abuse.py tests/adversarial/test_escapes.py

lint: .venv/installed-dev
	@$(MAKE) --no-print-directory --jobs 2 pyright $(CHECKS)

ruff:
	@echo '== ruff'
	@$(BIN)/ruff check --quiet .
	@$(BIN)/ruff format --quiet --check . || { $(BIN)/ruff format --check .; exit 1; }

# gets what the tests, which sometimes wait, leave of the cores
mypy:
	@echo '== mypy'
	@nice -n 15 $(BIN)/mypy --no-error-summary

pyright:
	@echo '== pyright'
	@$(BIN)/pyright

import-linter:
	@echo '== import-linter'
	@$(BIN)/lint-imports --no-logo --no-cache

# compiled once per machine, in about 50 CPU seconds: else it is the first thing that tests wait for
kernels:
	@$(BIN)/python -c 'from mtp_bench.core import Workers; from mtp_bench.running import compile_kernels; compile_kernels(Workers(2))'

# All test processes read all tests, which pytest compiles: once here, else each of them does it at the same time.
# What fails here fails again in `pytest`, which shows it.
$(COLLECTED): $(shell find tests -name '*.py')
	@mkdir -p $(dir $@)
	@$(BIN)/python -m pytest --collect-only -q > /dev/null && touch $@ || true

docs: .venv/installed-dev
	@echo '== site'
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

pages: .venv/installed
	@$(BIN)/mtp-bench board -o leaderboard/index.html
	@$(BIN)/python -m docs.generate.results
	@$(BIN)/python -m docs.generate.robustness

# pip is the last thing that `python -m venv` writes
.venv/bin/pip:
	@for python in $(PYTHON) python3.11 python3 python3.12 python3.13 python; do \
		if $$python -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then \
			echo "== creating .venv with $$($$python --version)"; \
			$$python -m venv .venv; exit; \
		fi; \
	done; \
	echo 'No Python >= 3.11 with the venv module was found.' >&2; exit 1

.venv/installed: pyproject.toml constraints.txt | .venv/bin/pip
	@echo '== installing into .venv (the first time takes a few minutes)'
	@$(call install,.)
	@touch $@

.venv/installed-dev: pyproject.toml constraints.txt | .venv/bin/pip
	@echo '== installing into .venv (the first time takes a few minutes)'
	@$(call install,'.[dev]')
	@touch $@ .venv/installed

clean:
	rm -rf build dist site .mypy_cache .pytest_cache .ruff_cache .hypothesis .import_linter_cache
