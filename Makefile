# make demo   the comparison of the paper on three KITTI scenes; DATA=folder or MTP_BENCH_DATA says where the data is
# make test   lint, types, import rules and tests
# Both create .venv and install what they need the first time.

DATA ?= $(MTP_BENCH_DATA)
ifneq ($(DATA),)
export MTP_BENCH_DATA := $(DATA)
endif
BIN := .venv/bin
export PYRIGHT_PYTHON_IGNORE_WARNINGS := 1

.PHONY: demo test lint clean

demo: .venv/installed
	@if [ -n "$(DATA)" ]; then \
		$(BIN)/mtp-bench compare stp mtp --env MTP-KITTI-noego-v0 --scenes 3; \
	else \
		$(BIN)/mtp-bench envs && \
		printf '\nThe demo needs the KITTI tracking data: run\n\n    make demo DATA=/path/to/data\n\n%s\n%s\n' \
			'with the folder that holds kitti_tracking/.' \
			'`$(BIN)/mtp-bench data` says which files are expected and where to get them.'; \
	fi

test: lint
	@echo '== pytest'
	@$(BIN)/python -m pytest -q

lint: .venv/installed-dev
	@echo '== ruff'
	@$(BIN)/ruff check --quiet .
	@$(BIN)/ruff format --quiet --check . || { $(BIN)/ruff format --check .; exit 1; }
	@echo '== mypy'
	@$(BIN)/mypy --no-error-summary
	@echo '== pyright'
	@$(BIN)/pyright
	@echo '== import-linter'
	@$(BIN)/lint-imports --no-logo --no-cache

# Python 3.11 first: the version that the tests are run with.
# pip is the last thing that `python -m venv` writes
.venv/bin/pip:
	@for python in python3.11 python3 python3.12 python3.13 python; do \
		if $$python -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then \
			echo "== creating .venv with $$($$python --version)"; \
			exec $$python -m venv .venv; \
		fi; \
	done; \
	echo 'No Python >= 3.11 with the venv module was found.' >&2; exit 1

.venv/installed: pyproject.toml constraints.txt | .venv/bin/pip
	@echo '== installing into .venv (the first time takes a few minutes)'
	@$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable .
	@touch $@

.venv/installed-dev: pyproject.toml constraints.txt | .venv/bin/pip
	@echo '== installing into .venv (the first time takes a few minutes)'
	@$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	@touch $@ .venv/installed

clean:
	rm -rf build dist .mypy_cache .pytest_cache .ruff_cache .hypothesis .import_linter_cache
