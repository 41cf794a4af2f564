# `make` lists the targets. Everything lives in .venv; nothing else of the machine is touched.
SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help setup run test test-all bench soak clean

INSTALLED := .venv/.installed
PYTHON ?=

# Three tests at a time, for they often wait; those of a file one after the other, each in a ROS
# domain of its own.
PYTEST := ROS_PYTHON_CHECK_FIELDS=1 python -m pytest -n 3 --dist loadfile --no-loadscope-reorder

# Every recipe that uses .venv starts with this. A .venv with ROS wheels of its own must not see
# another ROS or other modules; one that was made on a sourced ROS 2 Jazzy needs it sourced again.
# Bytecode is kept whatever the user's habit, because every run starts six processes.
define ENTER
set -euo pipefail; unset PYTHONHOME VIRTUAL_ENV PYTHONDONTWRITEBYTECODE; \
export PATH="$$PWD/.venv/bin:$$PATH"; \
if ! grep -q 'include-system-site-packages = true' .venv/pyvenv.cfg; then \
  unset PYTHONPATH AMENT_PREFIX_PATH COLCON_PREFIX_PATH CMAKE_PREFIX_PATH; \
elif [ -z "$${AMENT_PREFIX_PATH:-}" ]; then \
  echo "make: .venv uses the ROS 2 Jazzy that was sourced at 'make setup': source it again," \
    "or 'make clean' to start without it" >&2; exit 2; \
fi
endef

help: ## list the targets
	@echo "Targets (PYTHON=/path/to/python3 chooses the Python for .venv):"
	@sed -n 's/^\([a-z-]*\):.*## /  make \1	/p' Makefile

setup: $(INSTALLED) ## create .venv and install everything there (about 1 GB)

run: $(INSTALLED) ## run the paper's normal case through the five nodes, print the verdicts
	@$(ENTER); ppc_attitude run --config config/paper.yaml --report "$$PWD/build/paper.html"

test: $(INSTALLED) ## lint, check types, run the tests (ARGS='-k name' goes to pytest)
	@$(ENTER); \
	python test/compile_steps.py & compiling=$$!; \
	ruff check .; \
	ruff check --preview --select CPY001 .; \
	ruff format --check .; \
	vermin --quiet --no-tips --target=3.10- ppc_attitude bench docs launch test setup.py; \
	mypy; \
	wait $$compiling; \
	$(PYTEST) $(ARGS)

test-all: $(INSTALLED) ## the tests of `make test` and the long ones: every variant, process faults
	@$(ENTER); $(PYTEST) -m "long or not long" $(ARGS)

bench: $(INSTALLED) ## measure this stack and its yardsticks side by side
	@$(ENTER); python -m pip install -q -e '.[bench]'; \
	python -m bench $(ARGS)

soak: $(INSTALLED) ## run the nodes in lock-step for 20 minutes: what grows, what is lost (ARGS='--minutes 5')
	@$(ENTER); python -m bench.soak $(ARGS)

clean: ## remove what make created (recorded bags stay)
	rm -rf .venv build install log *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# colcon brings coverage, and Numba would import it in each process of a run.
# A candidate counts only if it runs: a pyenv shim may exist for a version that is switched off.
$(INSTALLED): setup.py Makefile
	@set -euo pipefail; unset PYTHONHOME VIRTUAL_ENV; \
	suits() { "$$1" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info < (3, 14))' 2>/dev/null; }; \
	jazzy() { [ "$${ROS_DISTRO:-}" = jazzy ] && "$$1" -c 'import rclpy, geometry_msgs.msg' 2>/dev/null; }; \
	complete() { "$$1" -c 'import ensurepip, venv' 2>/dev/null; }; \
	candidates=(); \
	if [ -n "$(PYTHON)" ]; then candidates=("$(PYTHON)"); else \
	  for name in python3.12 python3.11 python3.13 python3.10 python3; do \
	    while IFS= read -r path; do candidates+=("$$path"); done < <(type -aP "$$name" || true); \
	  done; \
	fi; \
	chosen=; bare=; extras=ros,test,campaign,guarantee,orbit; options=(); \
	for path in "$${candidates[@]}"; do \
	  suits "$$path" || continue; \
	  if ! complete "$$path"; then bare="$${bare:-$$path}"; continue; fi; \
	  chosen="$${chosen:-$$path}"; \
	  if jazzy "$$path"; then \
	    chosen="$$path"; extras=test,campaign,guarantee,orbit; options=(--system-site-packages); break; \
	  fi; \
	done; \
	if [ -z "$$chosen" ] && [ -n "$$bare" ]; then \
	  echo "make: $$bare has no venv module: install it (Debian, Ubuntu: apt install" \
	    "$$("$$bare" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])'))" >&2; exit 2; \
	elif [ -z "$$chosen" ]; then \
	  echo "make: no Python 3.10 to 3.13 found$(if $(PYTHON), at $(PYTHON)); install one," \
	    "or name it: make PYTHON=/path/to/python3 ..." >&2; exit 2; \
	fi; \
	if [ $${#options[@]} -eq 0 ]; then unset PYTHONPATH AMENT_PREFIX_PATH; fi; \
	if ! .venv/bin/python -m pip --version >/dev/null 2>&1; then \
	  echo "make: creating .venv with $$chosen"; \
	  "$$chosen" -m venv --clear $${options[@]+"$${options[@]}"} .venv; \
	fi; \
	echo "make: installing ppc_attitude[$$extras] (some minutes the first time)"; \
	.venv/bin/python -m pip install -q --disable-pip-version-check --no-compile -e ".[$$extras]"; \
	.venv/bin/python -m pip uninstall -q -y coverage pytest-cov; \
	touch $@
