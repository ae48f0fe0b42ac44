# make demo   sets everything up, runs the closed avoidance loop, writes demo/report.html
# make test   sets everything up, runs linters, types and tests
PYTHON ?= python3
BIN := .venv/bin
export PYOPENGL_PLATFORM := egl
export PYGLET_HEADLESS := true

.PHONY: setup egl test demo clean
setup: egl .venv/.installed

.venv/.installed: pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "pps_vision needs Python 3.11 or newer; $(PYTHON) is older (set PYTHON=...)" >&2; exit 1; }
	$(PYTHON) -m venv .venv
	$(BIN)/pip install -q --disable-pip-version-check -c constraints.txt torch==2.13.0
	$(BIN)/pip install -q --disable-pip-version-check -c constraints.txt -e '.[test]'
	@touch $@

# Rendering without a display needs Debian's EGL; everything else comes as wheels.
egl:
	@$(PYTHON) -c 'import ctypes; ctypes.CDLL("libEGL.so.1"); ctypes.CDLL("libGL.so.1")' 2>/dev/null || { \
	  if [ "$$(id -u)" = 0 ]; then SUDO=; elif command -v sudo >/dev/null; then SUDO=sudo; \
	  else echo "libEGL is missing: install Debian's packages libegl1 and libgl1, then run make again" >&2; exit 1; fi; \
	  echo "installing libegl1 libgl1"; \
	  { $$SUDO apt-get update -q && $$SUDO env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends libegl1 libgl1; } >/dev/null \
	  || { echo "libEGL is missing: install Debian's packages libegl1 and libgl1, then run make again" >&2; exit 1; }; }

test: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/pytest

demo: setup
	$(BIN)/pps-vision demo --out demo

clean:
	rm -rf .venv build demo *.egg-info
