PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
# Where to take torch from, if not from pip's own index: pytorch.org ("Get started") names
# one index for small CPU builds and one for each CUDA version.
TORCH_INDEX ?=

PROCESSES := --numprocesses 2 --max-worker-restart 0 --dist loadscope --no-loadscope-reorder

.PHONY: run test verify check page install bench variants docs clean

run: install
	@$(BIN)/python app.py $(ARGS)

install: $(INSTALLED)

$(INSTALLED): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed (make PYTHON=python3.11 ...)")'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --retries 2 --no-deps --constraint constraints.txt $(if $(TORCH_INDEX),--index-url $(TORCH_INDEX)) torch
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	touch $@

check: install
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/pyright --threads 2 --pythonpath $(BIN)/python
	$(BIN)/lint-imports
	$(BIN)/python .ci/ratchet.py
	$(BIN)/python .ci/client.py

# With SLOW=1 slow tests as well, and the shapes of all arrays in unit tests.
test: check
ifdef SLOW
	$(BIN)/pytest $(PROCESSES) --shapes only
	$(BIN)/pytest $(PROCESSES) --shapes none -m ''
else
	$(BIN)/pytest $(PROCESSES) --shapes off
endif

# The scripts in the package, from client/.
page: install
	$(BIN)/python .ci/client.py --write

# All loaders and checkers that are not ours, in environments under build/oracles.
verify: install
	$(BIN)/pytest -m oracle

bench: install
	$(BIN)/python -m benchmarks $(ARGS)

# All systems of the paper, small, and its tables; goes on where it was stopped.
variants: install
	$(BIN)/python -m reproduction.variants $(ARGS)

docs: install
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo 'Open build/docs/index.html'

clean:
	rm -rf $(VENV) build client/node_modules dist *.egg-info .pytest_cache .ruff_cache
