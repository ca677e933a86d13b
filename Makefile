# `make demo` (`DATA=folder` for your own images) and `make test` install everything by themselves.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUT ?= demo-out
export OMP_WAIT_POLICY = PASSIVE
export GOMP_SPINCOUNT = 0
export NO_MKDOCS_2_WARNING = 1

.PHONY: install demo test test-deep test-changed check docs release-check format lint types contracts bench checkpoints clean

install: $(VENV)/.installed

$(VENV)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/pip install --quiet --constraint constraints.txt torch
	$(BIN)/pip install --quiet --constraint constraints.txt --editable '.[tools,dev]'
	touch $@

demo: install
	$(BIN)/s2r demo --out "$(OUT)" $(if $(DATA),--data "$(DATA)") $(DEMO)

# Three processes on two cores, because some tests wait for other programs. If one of them crashes,
# the run ends: pytest-xdist would wait forever for the rest of its group.
PYTEST := $(BIN)/python -m pytest -n 3 --dist loadgroup --max-worker-restart 0

test: install
	$(PYTEST)

# The slow and exhaustive tests, and property tests with more examples.
test-deep: install
	$(PYTEST) --deep

# The tests that executed changed code at their last run; at first, all of them.
test-changed: install
	$(PYTEST) --testmon

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

# The documentation as a site in build/site; needs no network.
docs: install
	$(BIN)/mkdocs build --strict --quiet

# A release in build/release: wheel, source archive, licences, bill of materials. The wheel is installed into an
# empty environment and runs the demo there.
release-check: install
	$(BIN)/python release/check.py

bench: install
	$(BIN)/python -m bench --json

# The shipped models, trained again: about an hour. Needed after a change of what the world looks like.
checkpoints: install
	rm -rf build/checkpoints.s2r
	$(BIN)/s2r ingest world --survey 6000 --instances 500 --store build/checkpoints.s2r
	$(BIN)/s2r train --recipe vanilla --minutes 13 --store build/checkpoints.s2r
	$(BIN)/s2r train --recipe perlin --minutes 13 --store build/checkpoints.s2r
	$(BIN)/s2r train --recipe dataaug --minutes 18 --store build/checkpoints.s2r
	$(BIN)/s2r train --recipe finetune --from dataaug --minutes 9 --store build/checkpoints.s2r
	$(BIN)/python -m s2rtools.training.pretrained build/checkpoints.s2r

clean:
	rm -rf $(VENV) build dist *.egg-info $(OUT)
