# `make demo DATA=folder` and `make test` install everything by themselves.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT ?= demo-out
export OMP_WAIT_POLICY = PASSIVE
export GOMP_SPINCOUNT = 0

.PHONY: install demo test check format lint types contracts bench clean

install: $(VENV)/.installed

$(VENV)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/pip install --quiet --constraint constraints.txt torch==2.13.0
	$(BIN)/pip install --quiet --constraint constraints.txt --editable '.[tools,dev]'
	touch $@

demo: install
	@test -n "$(DATA)" || { echo "make demo: DATA= names a folder in the Sim2RealViz layout"; exit 2; }
	$(BIN)/s2r demo --data "$(DATA)" --out "$(OUT)"

test: install
	$(BIN)/python -m pytest -n 2 --dist loadgroup

check: install format-check lint types contracts test

format: install
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

.PHONY: format-check
format-check: install
	$(BIN)/ruff format --check .

lint: install
	$(BIN)/ruff check .

types: install
	$(BIN)/mypy

contracts: install
	$(BIN)/lint-imports

bench: install
	$(BIN)/python -m bench --json

clean:
	rm -rf $(VENV) build dist *.egg-info $(OUT)
