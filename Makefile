# make demo | test | check | docs | clean: all but the last make their environment (.venv) when it is missing.

PYTHON ?= $(shell command -v python3.11 || command -v python3)
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
CORE := $(VENV)/.core
DOCS := $(VENV)/.docs
PIP := $(BIN)/python -m pip

# PyTorch's own index of CPU builds: on Linux a plain torch brings gigabytes of CUDA packages. Where it cannot be
# reached, or is set to nothing (make TORCH_INDEX=), the default index serves torch.
TORCH_INDEX ?= https://download.pytorch.org/whl/cpu
WORKERS ?= auto

.PHONY: demo test check docs clean

demo: $(CORE)
	$(BIN)/vig demo

# A process per CPU, four at the most, as each holds torch; the tests of a file share what they set up. A process that
# dies ends the run, which could wait for its tests forever. Processes that they start take what Python has compiled.
test: $(INSTALLED)
	env -u PYTHONDONTWRITEBYTECODE $(BIN)/pytest --numprocesses=$(WORKERS) --maxprocesses=4 --dist=loadfile \
		--max-worker-restart=0

check: $(INSTALLED)
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy

# The site, in build/site; its tutorials are run on the way.
docs: $(DOCS)
	PATH="$(CURDIR)/$(BIN):$$PATH" NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	$(BIN)/python tools/check_site.py build/site

NATIVE := $(filter-out %/density_list.h,$(wildcard src/vig_native/*.cc src/vig_native/*.h src/vig_native/*/*.cc src/vig_native/*/*.h)) \
	src/vig_native/cmake/CMakeLists.txt

$(CORE): pyproject.toml constraints.txt $(NATIVE)
	@echo "making the environment in $(VENV): one or two minutes, 0.3 GB"
	$(PYTHON) -m venv $(VENV)
	$(PIP) install --quiet --constraint constraints.txt --editable .
	touch $@

# Torch comes first and pinned, so that no later package can pull another build of it.
$(INSTALLED): $(CORE)
	@echo "adding what tests need: a minute or two, some 2 GB"
	{ test -n "$(TORCH_INDEX)" && $(PIP) install --quiet --index-url "$(TORCH_INDEX)" --retries 0 --timeout 5 \
		--constraint constraints.txt torch; } 2>/dev/null \
		|| $(PIP) install --quiet --constraint constraints.txt torch
	$(BIN)/python tools/requirements.py dev | $(PIP) install --quiet --constraint constraints.txt --requirement /dev/stdin
	touch $@

$(DOCS): $(INSTALLED)
	$(BIN)/python tools/requirements.py docs | $(PIP) install --quiet --constraint constraints.txt --requirement /dev/stdin
	touch $@

clean:
	rm -rf $(VENV) build dist vig-demo vig-gallery .mypy_cache .pytest_cache .ruff_cache
	find src tests -name __pycache__ -type d -prune -exec rm -rf {} +
