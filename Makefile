PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
OUT ?= out

.PHONY: run test check kernels api bench clean

$(STAMP): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[fast,mdns,dev]'
	touch $(STAMP)

run: $(STAMP)
	$(BIN)/turnscan serve --bench simulated --folder $(OUT)

check: $(STAMP)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Compiled once for all tests, on one core while the other checks.
kernels: $(STAMP)
	$(BIN)/python tests/compile_kernels.py

test:
	$(MAKE) -j2 check kernels
	$(BIN)/pytest -n auto --dist worksteal

# What the API offers, for programs and for the page's types. Run it after changing a route.
api: $(STAMP) web/node_modules/.package-lock.json
	$(BIN)/python -m app.api.document web/openapi.json
	cd web && npm run --silent types

web/node_modules/.package-lock.json: web/package-lock.json web/package.json
	cd web && npm ci --no-audit --no-fund
	touch $@

bench: $(STAMP)
	$(BIN)/python -m benchmarks

clean:
	rm -rf $(VENV) $(OUT) web/node_modules .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
