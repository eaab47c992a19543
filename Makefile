# Every target sets up .venv by itself on first use; it needs Python 3.11 or newer, and make.
.DEFAULT_GOAL := help
.PHONY: help demo lab test bench notebooks

PYTHON ?= $(shell for p in python3 python3.14 python3.13 python3.12 python3.11 python; do \
	$$p -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && { echo $$p; break; }; done)
BIN := .venv/bin
READY := .venv/.ready
# Linear algebra on one thread: the arrays are small, and the cores belong to the processes.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1

help:
	@echo "make demo       grade the sample class, print the table, write build/demo/report.html"
	@echo "make test       every test and every notebook"
	@echo "make lab        open the notebooks in JupyterLab"
	@echo "make notebooks  make both notebooks of each lesson from its source in solutions/"
	@echo "make bench      accuracy and speed, as ratios against named baselines"

demo: $(READY)
	# These submissions are ours: they may be graded where nothing shuts them in.
	$(BIN)/grader grade tests/submissions/vacuum --assignment vacuum --output build/demo --allow-unsandboxed

lab: $(READY)
	$(BIN)/jupyter lab notebooks

test: $(READY)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/lint-imports
	$(BIN)/python -m pytest --numprocesses 2 --dist loadscope

bench: $(READY)
	$(BIN)/python -m tests.benchmarks

notebooks: $(READY)
	$(BIN)/grader release

$(READY): pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "Python 3.11 or newer is not on the PATH: install it, or name it with make PYTHON=..."; exit 1; }
	@echo "Setting up .venv (once, about two minutes, 1 GB)"
	@$(PYTHON) -m venv .venv || { echo "no venv module here: on Debian and Ubuntu, apt install python3-venv"; exit 1; }
	@$(BIN)/python -m pip install --disable-pip-version-check $$([ -t 1 ] || echo --quiet) --require-hashes -r constraints.txt
	@$(BIN)/python -m pip install --disable-pip-version-check --quiet --no-deps --no-build-isolation --editable .
	@touch $@
