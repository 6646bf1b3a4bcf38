# Every target makes what it needs: a bare clone and Python 3.11 are enough.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
FUZZ_SECONDS ?= 3600
FUZZ_RECORDS ?= inf
FUZZ_INPUTS ?= inf
FUZZ_TARGET ?= json

.PHONY: help venv demo test check check-deploy docs bench peers placement soak faults fleet fuzz fuzz-coverage sbom performance browser image unit alerts tutorial wheels wheel format clean

help:  ## this list
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 12

venv: .venv/made  ## .venv with everything

.venv/made: pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(0 if sys.version_info >= (3, 11) else "headway needs Python 3.11 or newer: make venv PYTHON=/path/to/python3.11")'
	@echo 'Making .venv with what headway needs to run, to be checked and to be tested (some 100 packages, 1.5 GB; minutes).'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	@touch $@

demo: venv  ## service and replay in one go, no router needed
	$(BIN)/headway demo

test: venv  ## the whole suite
	$(BIN)/python -m pytest -m 'not bench and not browser and not faults'

check: venv  ## lint, format, types, import contracts, prose, deployment files; says what it skips
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python tests/prose/check.py
	$(BIN)/mkdocs build --strict
	$(BIN)/python -m pytest tests/deploy
	@if command -v promtool >/dev/null; then $(MAKE) --no-print-directory check-deploy; \
	else echo 'skipped: make check-deploy, which needs promtool (Debian: apt-get install prometheus)'; fi

check-deploy:  ## Prometheus configuration and rules (Debian: apt-get install prometheus)
	promtool check config deploy/prometheus/prometheus.yml
	promtool test rules deploy/prometheus/headway.rules.test.yml
	@if command -v amtool >/dev/null; then amtool check-config deploy/alertmanager/alertmanager.yml; \
	else echo 'skipped: amtool check-config, which needs amtool (Debian: apt-get install prometheus-alertmanager)'; fi

docs: venv  ## the documentation as a site, in build/site
	$(BIN)/mkdocs build

bench: venv  ## timing, side by side (pytest-benchmark)
	@mkdir -p out
	$(BIN)/python -m pytest tests/bench -m bench --benchmark-only --benchmark-json=out/bench.json
	$(BIN)/python tests/bench/table.py out/bench.json
	$(MAKE) --no-print-directory peers

peers: venv  ## the same job in headway, a naive service, Flink and quixstreams (installs the two below build/)
	PYTHONPATH=tests $(BIN)/python tests/bench/peers/compare.py

placement: venv  ## sites of a million vehicles over nodes that fail, simulated
	$(BIN)/python -m headway_loadtest.placement

soak: venv  ## ten minutes of rotating identifiers: memory must stay flat
	$(BIN)/headway loadtest --vehicles 500 --seconds 600 --rotate-s 30 --json

faults: venv  ## processes killed, stopped and flooded over real zenoh: half an hour
	$(BIN)/python -m pytest tests/faults -m faults

fleet: venv  ## 8 sites on 3 nodes of a Ray cluster on this machine: killed, stopped, drained, replaced; some minutes
	PYTHONPATH=tests $(BIN)/python -m pytest tests/fleet/cluster -m fleet

fuzz: venv  ## mutated messages and adversarial drives through codec and engine, for FUZZ_SECONDS (an hour)
	PYTHONPATH=tests $(BIN)/python tests/fuzz/campaign.py --seconds $(FUZZ_SECONDS) --records $(FUZZ_RECORDS) --inputs $(FUZZ_INPUTS)

fuzz-coverage: venv  ## atheris chooses the inputs of one FUZZ_TARGET (installs atheris, which has wheels for Linux)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[fuzz]'
	PYTHONPATH=tests $(BIN)/python tests/fuzz/coverage.py $(FUZZ_TARGET) --seconds $(FUZZ_SECONDS)

sbom: venv  ## what is installed with headway, as CycloneDX, in out/
	@mkdir -p out
	$(BIN)/cyclonedx-py environment --pyproject pyproject.toml --output-reproducible --output-file out/sbom.json $(BIN)/python

performance: venv  ## load tests from few to many vehicles, and their picture in out/
	$(BIN)/python tests/bench/sweep.py out

browser: venv  ## the dashboard in a real browser (Debian: apt-get install chromium)
	@command -v chromium google-chrome >/dev/null || { echo 'make browser needs Chromium: apt-get install chromium'; exit 1; }
	$(BIN)/python -m pytest tests/browser -m browser

image: venv  ## the image built, started read-only, fed, stopped (Debian: apt-get install podman runc debootstrap)
	$(BIN)/python -m pytest -rs --capture=no tests/engine/test_image.py -m engine

unit: venv  ## the systemd unit in a Debian that boots (as make image, and apt-get install systemd-container)
	$(BIN)/python -m pytest -rs --capture=no tests/engine/test_unit.py -m engine

alerts: venv  ## Prometheus and Alertmanager with these files: one notification for a faulty vehicle (Debian: apt-get install prometheus prometheus-alertmanager)
	$(BIN)/python -m pytest -rs --capture=no tests/engine/test_alerts.py -m engine

tutorial: venv  ## the tutorial word by word, in a clone and an environment of its own
	$(BIN)/python -m pytest -rs --capture=no tests/engine/test_tutorial.py -m engine

wheels: venv  ## a wheel of each package that serving needs, for x86_64 and for aarch64 (needs the package index)
	$(BIN)/python -m pytest -rs tests/engine/test_wheels.py -m engine

wheel: venv  ## the built wheel in an empty environment: the demo and the library from there
	rm -rf dist build/wheel
	$(BIN)/python -m build
	$(PYTHON) -m venv build/wheel
	build/wheel/bin/pip install --quiet --disable-pip-version-check --constraint constraints.txt dist/*.whl
	cd build && wheel/bin/headway demo --seconds 20
	cd build && wheel/bin/python -c 'from headway import Detector, sample_recording; print(*(event.suspect for event in Detector().process(sample_recording()).events))'

format: venv  ## rewrite in the house format
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

clean:  ## remove what the targets made
	rm -rf .venv build dist
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
