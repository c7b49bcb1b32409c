# Two commands matter: `make demo` installs and flies three aircraft, `make test` installs and runs the checks.
PYTHON ?= python3
BIN := .venv/bin
OUT ?= runs/three-aircraft-$(shell date +%Y%m%d-%H%M%S)

.PHONY: demo test laws tests test-long copies docs bench verification plan-trials descent-trials autopilot release-check clean

demo: .venv/.installed
	$(BIN)/anser demo --out $(OUT)

test: .venv/.installed-test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(MAKE) --no-print-directory -j 2 laws tests

# Beside the tests, because types and imports have work for one core only.
laws: .venv/.installed-test
	$(BIN)/lint-imports
	$(BIN)/basedpyright

tests: .venv/.installed-test
	$(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder -m "not long"

# What `make test` leaves out: missions, studies, trials of the planner, programs of one test only.
test-long: .venv/.installed-test
	$(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder -m long

# Copies of files and tables of keys in the pages, and the notebooks of the tutorials, anew. A test says when they are old.
copies: .venv/.installed-docs
	$(BIN)/python docs/copies.py
	$(BIN)/python docs/notebooks.py

# The documentation site, every example executed: open build/docs/index.html.
docs: .venv/.installed-docs
	rm -rf docs/reference/generated
	$(BIN)/sphinx-build --fail-on-warning --keep-going --fresh-env --quiet -d build/doctrees docs build/docs

bench: .venv/.installed-test
	$(BIN)/anser cache measure $(addprefix --scenario ,$(sort $(wildcard scenarios/*.toml)))
	$(BIN)/pytest benchmarks/bench_flight.py benchmarks/bench_single_aircraft.py --benchmark-enable --benchmark-only -s -p no:xdist

verification: .venv/.installed-test
	mkdir -p build
	$(BIN)/anser verify --json > build/verification.json
	$(BIN)/python docs/verification_page.py build/verification.json docs

# Two thousand random scenarios, planned and judged: hours. Go on with an interrupted one by `make plan-trials TRIALS=--resume`.
plan-trials: .venv/.installed-test
	mkdir -p build
	$(BIN)/python -m trials --seeds 0:2000 --out build/plan-trials.jsonl $(TRIALS)

# A hundred random descents flown with the published planner: none may reach the ground. A quarter of an hour or more.
descent-trials: .venv/.installed-test
	$(BIN)/pytest trials/test_descents.py -s -p no:xdist

# The pictures of docs/autopilot.md, anew.
autopilot: .venv/.installed
	rm -rf build/autopilot
	$(BIN)/anser gallery --out build/autopilot/gallery
	$(BIN)/anser envelope --out build/autopilot/envelope
	$(BIN)/anser robustness --sweep --out build/autopilot/robustness
	$(BIN)/anser margins --envelope --out build/autopilot/margins
	mkdir -p docs/autopilot
	cp build/autopilot/gallery/overview.png build/autopilot/gallery/climb-and-turn.png build/autopilot/envelope/commands.png \
	  build/autopilot/robustness/spread.png build/autopilot/robustness/alone.png build/autopilot/margins/actuators.png \
	  build/autopilot/margins/loops.png docs/autopilot

.venv/.installed: pyproject.toml constraints.txt
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e .
	@touch $@

.venv/.installed-test: .venv/.installed pyproject.toml constraints.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[test]"
	@touch $@

.venv/.installed-docs: .venv/.installed pyproject.toml constraints.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e ".[docs]"
	@touch $@

# Builds the last commit in a clean clone and tries the wheel in fresh environments of every supported Python.
release-check:
	$(PYTHON) release/check.py $(RELEASE)

clean:
	rm -rf .venv
