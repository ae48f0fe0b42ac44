# make demo   installs what running needs, runs the closed avoidance loop, writes demo/report.html
# make test   installs what testing needs too, runs linters, types and tests
# make test-all   the long tests too
# make test-browser   opens the reports in a headless Chromium
# make docs   builds the documentation's site into site/
PYTHON ?= python3
BIN := .venv/bin

.PHONY: setup libraries test test-all test-browser docs demo clean
setup: libraries .venv/.installed

PIP := $(BIN)/pip install -q --disable-pip-version-check -c constraints.txt
.venv/.installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' || { echo "pps_vision needs Python 3.11, 3.12 or 3.13; $(PYTHON) is another (set PYTHON=...)" >&2; exit 1; }
	@echo "installing into .venv: about 550 MB to download, 2.3 GB on disk (with torch for processors; its CUDA build is several GB more)"
	$(PYTHON) -m venv .venv
	$(PIP) torch==2.13.0
	$(PIP) -e .
	@touch $@

.venv/.installed-test: .venv/.installed
	@echo "installing what testing needs: about 160 MB to download, 0.6 GB on disk"
	$(PIP) -e '.[test]'
	@touch $@

# What no wheel brings: rendering without a display (EGL), and the OpenMP run time that pinocchio links to.
LIBRARIES := libegl1 libgl1 libgomp1
WHAT_TO_INSTALL := system libraries are missing: install Debian's packages $(LIBRARIES), then run make again
libraries:
	@$(PYTHON) -c 'import ctypes; [ctypes.CDLL(f"lib{n}.so.1") for n in ("EGL", "GL", "gomp")]' 2>/dev/null || { \
	  if [ "$$(id -u)" = 0 ]; then SUDO=; elif command -v sudo >/dev/null; then SUDO=sudo; \
	  else echo "$(WHAT_TO_INSTALL)" >&2; exit 1; fi; \
	  echo "installing $(LIBRARIES)"; \
	  { $$SUDO apt-get update -q && $$SUDO env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends $(LIBRARIES); } >/dev/null 2>&1 \
	  || { echo "$(WHAT_TO_INSTALL)" >&2; exit 1; }; }

# The tracker's tests come first and alone, while types are checked: both workers would compile the same functions.
FIRST := tests/tracking/test_tracker.py
test: export OMP_NUM_THREADS := 1
test: export PYTHONDONTWRITEBYTECODE :=
test: setup .venv/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	@$(BIN)/mypy & types=$$!; $(BIN)/pytest $(FIRST); first=$$?; \
	$(BIN)/pytest -n 2 --dist loadfile --ignore=$(FIRST); rest=$$?; wait $$types && exit $$((first | rest))

# What takes too long for every day (tests marked `long`), and the extra `viewer` (220 MB to download, 0.7 GB on disk).
test-all: test
	$(PIP) -e '.[test,viewer]'
	OMP_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist loadfile -m long
	OMP_NUM_THREADS=1 $(BIN)/pytest tests/app/test_viewer.py

# The reports in a headless browser; installs Debian's chromium where there is none.
test-browser: setup .venv/.installed-test
	@command -v chromium >/dev/null || { apt-get update -q && DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends chromium; } >/dev/null
	PPS_VISION_BROWSER=chromium $(BIN)/pytest tests/browser

docs: setup
	$(PIP) -e '.[docs]'
	$(BIN)/mkdocs build --strict --quiet

demo: setup
	rm -rf demo
	$(BIN)/pps-vision demo --out demo

clean:
	rm -rf .venv build demo site *.egg-info
