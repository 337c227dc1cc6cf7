# Each target first sets up what it needs: a private .venv with the pinned packages of constraints.txt.
#   make demo     torques of the OmniLeg by two routes, cross-check, plot and preview, into demo/
#   make test     style, types, walls between the rooms, tests
#   make lint     only style, types and walls
#   make bench    the benchmarks
#   make render   regenerate urdf/ from xacro/
#   make clean    remove the environment and everything generated that is not committed
# `make PYTHON=python3.12 ...` chooses the interpreter of a new environment; any of 3.10 to 3.13 will do.

VENV := .venv
BIN := $(VENV)/bin
# An environment knows its own path, so a moved checkout gets a new one.
STAMP := $(VENV)/installed-$(shell pwd | cksum | cut -d' ' -f1)
PYTEST_ARGS ?=
BENCH_ARGS ?=
PYTHON ?=

.PHONY: demo test lint bench render clean setup
.DELETE_ON_ERROR:

demo: setup
	$(BIN)/leg-dynamics demo --output demo

test: lint
	$(BIN)/python -m pytest -m "not slow" $(PYTEST_ARGS)

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: setup
	$(BIN)/python -m benchmarks $(BENCH_ARGS)

render: setup
	@mkdir -p urdf
	@for source in xacro/*.urdf.xacro xacro/assemblies/*.yaml; do \
	  name=$$(basename "$$source" .urdf.xacro); name=$${name%.yaml}; \
	  $(BIN)/leg-dynamics render "$$source" --output "urdf/$$name.urdf" || exit; \
	done

setup: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	@if [ ! -e "$(STAMP)" ] || ! $(BIN)/python -c "" 2>/dev/null; then \
	  for python in $(or $(PYTHON),python3 python3.13 python3.12 python3.11 python3.10); do \
	    if "$$python" -c "import ensurepip, sys, venv; sys.exit(not (3, 10) <= sys.version_info < (3, 14))" 2>/dev/null; \
	    then found=$$python; break; fi; \
	  done; \
	  if [ -z "$$found" ]; then \
	    echo "No Python 3.10 to 3.13 with its venv module was found; install one or name it: make PYTHON=..." >&2; exit 1; \
	  fi; \
	  echo "Setting up $(VENV) with $$("$$found" --version)"; \
	  rm -rf $(VENV) && "$$found" -m venv $(VENV) || exit; \
	fi
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable ".[dev]"
	@touch $(STAMP)

clean:
	rm -rf $(VENV) demo dist build .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find leg_dynamics tests benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +
