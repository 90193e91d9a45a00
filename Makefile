# ncomp: set-up, demo and checks, all in .venv. `make help` lists the targets.

VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
MACHINE := dmu50
PROGRAM := box.nc
PROGRAMS := 20000
INPUTS := 5000
SECONDS := 600
MUTANTS := 200
SIZE := 1
SEED := 1
SETUP := --work-offset G54=-30,-20,150 --tool-length T1=80

# Tests start many processes: without bytecode files each of them compiles the whole package.
export PYTHONDONTWRITEBYTECODE :=
# Two workers have a core each: threads of the linear algebra would only wait for each other.
test test-unit test-statistical test-exams test-all: export OMP_NUM_THREADS := 1

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help setup demo test test-unit test-statistical test-exams test-all fuzz fuzz-readers mutations exam speed speed-small lint docs pages wheel sbom lock clean

help: ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 25

setup: $(INSTALLED) ## create .venv from requirements.lock (done by the other targets when needed)

demo: $(INSTALLED) ## compensate examples/box.nc for a DMU 50 and show what it gains
	@mkdir -p out
	$(BIN)/ncomp examples/$(PROGRAM) --machine $(MACHINE) $(SETUP) -o out/$(PROGRAM)
	@echo
	@echo "Some changed lines, as programmed and corrected:"
	@diff --side-by-side --suppress-common-lines --width 150 examples/$(PROGRAM) out/$(PROGRAM) | sed -n '1,12p;60,70p'
	@echo
	$(BIN)/ncomp verify examples/$(PROGRAM) out/$(PROGRAM) --machine $(MACHINE) $(SETUP)

test: $(INSTALLED) ## run the unit and the integration tests (ARGS="-k name" is passed on)
	$(BIN)/pytest -n 2 --dist worksteal -m "not statistical and not exam" $(ARGS)

test-unit: $(INSTALLED) ## run the unit tests only
	$(BIN)/pytest -n 2 --dist worksteal -m unit $(ARGS)

# pytest ends with 5 where there is no test to run.
test-statistical: $(INSTALLED) ## run the tests with many draws only
	$(BIN)/pytest -n 2 --dist worksteal --durations=20 -m statistical $(ARGS) || [ $$? -eq 5 ]

test-exams: $(INSTALLED) ## run the repetitions of statistical tests with further draws, before a release
	$(BIN)/pytest -n 2 --dist worksteal --durations=20 -m exam $(ARGS) || [ $$? -eq 5 ]

test-all: $(INSTALLED) ## run every test; those of LinuxCNC and FreeCAD fail, rather than skip, without them
	NCOMP_REQUIRE_CLIENTS=1 $(BIN)/pytest -n 2 --dist worksteal $(ARGS)

fuzz: $(INSTALLED) ## examine random programs with every fuzzer (PROGRAMS=200 SEED=2); what differs goes to tests/fuzz/found
	$(BIN)/python -m tests.fuzz all --programs $(PROGRAMS) --seed $(SEED) --jobs 2

fuzz-readers: $(INSTALLED) ## fuzz every reader of files guided by coverage, with Atheris (INPUTS=5000 SECONDS=600 SEED=2)
	$(BIN)/pip install --quiet --disable-pip-version-check --upgrade --target .cache/atheris atheris==3.0.0
	PYTHONPATH=.cache/atheris $(BIN)/python -m tests.fuzz.guided --inputs $(INPUTS) --seconds $(SECONDS) --seed $(SEED)

mutations: $(INSTALLED) ## put faults into the code that decides signs and positions, and count those that no test notices (MUTANTS=200 SEED=2)
	OMP_NUM_THREADS=1 $(BIN)/python -m tests.code_mutants --mutants $(MUTANTS) --seed $(SEED) --jobs 2

exam: $(INSTALLED) ## ask fresh questions for fit, diagnosis, NC, tables and speed, and add a line to docs/exam_history.csv (SEED=20261201 SIZE=10)
	OMP_NUM_THREADS=1 $(BIN)/python benchmarks/nightly_exam.py --seed $(SEED) --size $(SIZE) --history docs/exam_history.csv

speed: $(INSTALLED) ## measure the speed beside other readers of NC programs, and write docs/speed.md (ARGS="--lines 10000000")
	$(BIN)/python benchmarks/speed.py --page docs/speed.md $(ARGS)

speed-small: $(INSTALLED) ## the same in a minute with short programs, printed only
	$(BIN)/python benchmarks/speed.py --lines 3000 --rounds 1

lint: $(INSTALLED) ## ruff, its formatter, and mypy
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

docs: export NO_MKDOCS_2_WARNING := 1
docs: $(INSTALLED) ## build the documentation into out/site, without network; a warning is an error
	$(BIN)/mkdocs build --strict --quiet

wheel: $(INSTALLED) ## build the wheel, and try it in an empty venv of each Python from 3.11 to 3.13 on this machine
	rm -rf dist
	$(BIN)/python -m hatchling build
	tests/wheel_in_venvs.sh dist/*.whl

sbom: $(INSTALLED) ## write the bill of materials of an installed wheel, with licences (CycloneDX), to out/ncomp.cdx.json, and list it
	rm -rf dist .cache/sbom && mkdir -p out
	$(BIN)/python -m hatchling build -t wheel
	$(BIN)/python -m venv .cache/sbom/installed && $(BIN)/python -m venv .cache/sbom/tool
	.cache/sbom/installed/bin/python -m pip install --quiet --disable-pip-version-check -c requirements.lock dist/*.whl
	.cache/sbom/tool/bin/python -m pip install --quiet --disable-pip-version-check cyclonedx-bom==7.5.0
	.cache/sbom/tool/bin/cyclonedx-py environment --output-reproducible --of JSON -o out/ncomp.cdx.json .cache/sbom/installed/bin/python
	$(BIN)/python docs/make/licences.py out/ncomp.cdx.json

pages: $(INSTALLED) ## renew the pages that docs/make writes: codes, digits of the evidence, refusals, results, outputs of the tutorial and of the notebook
	for page in controls configuration evidence exam refusals results tutorial session router; do $(BIN)/python docs/make/$$page.py || exit 1; done

lock: $(BIN)/python ## renew requirements.lock from pyproject.toml
	$(BIN)/pip install --quiet "pip-tools>=7.5"
	CUSTOM_COMPILE_COMMAND="make lock" $(BIN)/pip-compile --quiet --upgrade --extra dev --all-build-deps \
		--allow-unsafe --strip-extras --no-emit-index-url --no-emit-trusted-host --no-emit-find-links \
		--no-emit-options --output-file requirements.lock pyproject.toml

clean: ## remove .venv, out and the tools' caches
	rm -rf $(VENV) out dist .cache .pytest_cache .mypy_cache .ruff_cache .hypothesis

# The build backend is in the lock too: nothing is installed that is not named there.
$(INSTALLED): $(BIN)/python requirements.lock pyproject.toml
	$(BIN)/pip install --quiet --disable-pip-version-check -r requirements.lock
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

# A python3.11 on the PATH may be a stub that does not run, so ask each candidate for its version.
$(BIN)/python:
	@for python in python3.11 python3; do \
		if $$python -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then \
			echo "$$python -m venv $(VENV)"; \
			$$python -m venv $(VENV) && exit 0; \
			rm -rf $(VENV); \
			echo "Could not make $(VENV); on Debian: apt-get install python3-venv" >&2; exit 1; \
		fi; \
	done; \
	echo "ncomp needs Python 3.11 or later as python3.11 or python3; on Debian: apt-get install python3.11 python3-venv" >&2; \
	exit 1
