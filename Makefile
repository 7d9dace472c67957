# Every task of the project. `make` alone lists them; each one makes the environment it needs.

BIN := .venv/bin
# The environment knows the package's files by name, so it is made again when the list of them changes.
LAYOUT := $(shell find src -name '*.py' | LC_ALL=C sort | cksum | cut -d' ' -f1)
RUN := .venv/run.$(LAYOUT).stamp
TEST := .venv/test.stamp
PEERS := .venv/peers.stamp
KERNELS := $(wildcard src/trackfield/_core/*.cpp src/trackfield/_core/*.hpp)
PYTHON_FILES := src tests docs scripts $(wildcard examples) $(wildcard benchmarks)

# One thread a process: the tests run on all cores already, and the same sums give the same bits.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1

.DEFAULT_GOAL := help
.NOTPARALLEL:
.PHONY: help demo test format lint types contracts docs speed unit bench reference papers clean

help: ## list the tasks
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/  make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 20

demo: $(RUN) ## set up, then track a recorded robot and score the track
	@$(BIN)/trackfield demo -o demo

test: lint types contracts docs speed unit ## set up, then every check that CI runs

format: $(TEST) ## rewrite the code in the house format
	$(BIN)/ruff format $(PYTHON_FILES)
	$(BIN)/ruff check --fix $(PYTHON_FILES)

lint: $(TEST) ## format and lint rules
	$(BIN)/ruff format --check $(PYTHON_FILES)
	$(BIN)/ruff check $(PYTHON_FILES)

types: $(TEST) ## strict types
	$(BIN)/pyright --pythonpath $(BIN)/python

contracts: $(TEST) ## which room may import which
	PYTHONPATH=src $(BIN)/lint-imports

docs: $(TEST) ## build the pages into docs/_build/html; a warning is an error
	$(BIN)/sphinx-build -W --keep-going -q -b html docs docs/_build/html

speed: $(TEST) ## tests that measure time, alone and without coverage
	$(BIN)/pytest -m speed tests

unit: $(TEST) ## all other tests, with branch coverage
	$(BIN)/pytest -m "not speed" -n 2 --dist loadfile --cov --cov-report=term

bench: $(PEERS) ## measure against other packages; CONTRIBUTING says how to read it
	@for file in benchmarks/bench_*.py; do echo "== $$file"; $(BIN)/python $$file || exit 1; done

reference: $(TEST) ## write the generated pages of the reference again
	$(BIN)/python scripts/reference.py

papers: $(TEST) ## run the reproductions in full and write their results into the docs
	$(BIN)/python scripts/papers.py

clean: ## remove everything that can be made again
	rm -rf .venv build demo docs/_build .coverage* htmlcov .pytest_cache .ruff_cache .hypothesis

$(RUN): pyproject.toml CMakeLists.txt $(KERNELS)
	@scripts/environment.sh run
	@touch $@

$(TEST): $(RUN)
	@scripts/environment.sh test
	@touch $@

$(PEERS): $(TEST)
	@scripts/environment.sh peers
	@touch $@
