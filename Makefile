PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
OUT ?= out
# Many tests wait for boards that take their time, so there may be more of them at once than processors.
WORKERS := $(shell echo $$(( $$(getconf _NPROCESSORS_ONLN) * 3 / 2 )))
CHROMIUM := apt-get install -qq -y chromium < /dev/null > /dev/null 2>&1

.PHONY: run test suite check kernels pages pages-check pages-test api bench pictures docker-steps clean

$(STAMP): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	TURNSCAN_WITHOUT_PAGES=1 $(BIN)/python -m pip install --quiet --no-compile --disable-pip-version-check --editable '.[fast,mdns,dev]'
	touch $(STAMP)

run: $(STAMP) pages
	$(BIN)/turnscan serve --bench simulated --folder $(OUT)

# The page that the server shows, where it is not up to date; without Node.js it says so and goes on.
pages: $(STAMP)
	$(BIN)/python hatch_build.py

check: $(STAMP) pages-check
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

ifneq ($(shell command -v npm),)
MODULES := web/node_modules/.package-lock.json

pages-check: $(MODULES)
	cd web && npm run --silent check

pages-test: $(MODULES)
	cd web && npm run --silent test
	@test -x /usr/bin/chromium || $(CHROMIUM) || (apt-get update -qq && $(CHROMIUM)) > /dev/null 2>&1 || echo "No chromium: the page is not tested in a browser."
else
pages-check pages-test:
	@echo "The page is not checked: npm is not here."
endif

# Compiled once for all tests, on one core while the other checks.
kernels: $(STAMP)
	$(BIN)/python tests/compile_kernels.py

test:
	$(MAKE) -j2 $(STAMP) $(MODULES)
	$(MAKE) -j2 kernels pages pages-test
	$(MAKE) -j2 suite check

# After kernels, pages and pages-test. Its tests wait often enough for the checks to find room beside them.
suite:
	$(BIN)/pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder

# What the API offers, for programs and for the page's types. Run it after changing a route.
api: $(STAMP) $(MODULES)
	$(BIN)/python -m app.api.document web/openapi.json
	cd web && npm run --silent types

web/node_modules/.package-lock.json: web/package-lock.json web/package.json
	cd web && npm ci --no-audit --no-fund
	touch $@

# What the Dockerfile does, step by step and without Docker: fetches and installs everything.
docker-steps: $(STAMP)
	$(BIN)/python deploy/try_dockerfile.py

bench: $(STAMP)
	$(BIN)/python -m benchmarks

# Those of the page in the README, anew; and every place at both sizes, light and dark, into out/pictures/.
pictures: $(STAMP) pages
	$(BIN)/python -m docs.make_pictures --all

clean:
	rm -rf $(VENV) $(OUT) web/node_modules app/_web .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
