# Every target sets up what it needs: only Python 3.11+, pip and make are expected.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
DEV_STAMP := $(VENV)/.installed-dev
BENCH_STAMP := $(VENV)/.installed-bench

.PHONY: help demo demo-real demo-compose test test-compose lint bench lock real-data clean

help:
	@echo "make demo          the whole job in this terminal: router, sensors, fusion, consumer"
	@echo "make demo-real     the same with recorded ADS-B traffic"
	@echo "make demo-compose  the same with Docker: every sensor a container; checks it and leaves it running"
	@echo "make test          all tests"
	@echo "make test-compose  the Docker demo, brought up, broken and attacked: ten minutes"
	@echo "make lint          ruff and mypy --strict"
	@echo "make bench         accuracy and speed against other libraries"
	@echo "make real-data     the recorded traffic, for demo-real and its test (56 MB)"
	@echo "make lock          new locks after a change of dependencies"
	@echo "make clean         remove everything that make has made"

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(STAMP): requirements.lock pyproject.toml | $(VENV)/bin/python
	$(BIN)/pip install --quiet --require-hashes -r requirements.lock
	$(BIN)/pip install --quiet --require-hashes -r requirements-build.lock
	$(BIN)/pip install --quiet --no-deps --no-build-isolation -e .
	@touch $@

$(DEV_STAMP): requirements-dev.lock $(STAMP)
	$(BIN)/pip install --quiet --require-hashes -r requirements-dev.lock
	@touch $@

$(BENCH_STAMP): requirements-bench.lock $(DEV_STAMP)
	$(BIN)/pip install --quiet --require-hashes -r requirements-bench.lock
	@touch $@

demo: $(STAMP)
	$(BIN)/aeroskein demo

demo-real: $(STAMP) real-data
	$(BIN)/aeroskein demo --real

# Builds the image (from Debian's packages where none can be pulled), brings the stack up and checks it.
demo-compose:
	deploy/demo.sh

# Recorded traffic (56 MB). Without its dependencies: only its data files are read, it is never imported. The copy in
# build/ is for containers.
SAMPLE := data/samples/collections/quickstart.json.gz
real-data: $(STAMP)
	$(BIN)/pip install --quiet --no-deps traffic==2.13
	install -D -m 0644 $(VENV)/lib/python3*/site-packages/traffic/$(SAMPLE) build/real-data/$(SAMPLE)

# A browser that did not come round within a minute beside everything else gets a second chance.
# TESTS=tests/unit/test_ahp.py runs those only; it may also be any option of pytest.
test: $(DEV_STAMP)
	$(BIN)/python -m pytest -n 2 --dist loadfile --reruns 1 --only-rerun TimeoutError $(TESTS)

# Skipped with a reason where there is no Docker engine.
test-compose: $(DEV_STAMP)
	AEROSKEIN_COMPOSE_TESTS=1 $(BIN)/python -m pytest tests/deploy $(TESTS)

lint: $(DEV_STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

bench: $(BENCH_STAMP)
	$(BIN)/python -m benchmarks

# Locks carry hashes and no index address; run this after a change of dependencies.
UV_LOCK := $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-header
lock: | $(VENV)/bin/python
	$(BIN)/pip install --quiet uv
	$(UV_LOCK) pyproject.toml -o requirements.lock
	printf 'hatchling\neditables\n' | $(UV_LOCK) - -c requirements.lock -o requirements-build.lock
	$(UV_LOCK) --group dev -c requirements.lock -o requirements-dev.lock
	$(UV_LOCK) --group bench -c requirements-dev.lock -o requirements-bench.lock

clean:
	rm -rf $(VENV) build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis
