# Every target works from a fresh clone: the virtual environment is made when it is missing.
PYTHON ?= python3
OUT ?= out
JOBS ?= 1

VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
DOCS_READY := $(VENV)/.docs-ready
PEERS_READY := $(VENV)/.peers-ready
AUTOMARINE := $(BIN)/automarine
BENCHMARK := PYTHONPATH=tests/helpers $(BIN)/python tests/benchmarks
unexport PYTHONDONTWRITEBYTECODE # with it each of many processes compiles the package again
SHARED := -n auto --dist loadfile --no-loadscope-reorder
MAKEFLAGS += --no-print-directory
.DEFAULT_GOAL := help
.SILENT:
.NOTPARALLEL:
.DELETE_ON_ERROR:
.PHONY: help demo test test-all test-slow check fit-thrusters fit-yaw validate diagnose tune run reproduce wheel sample-runs paper pictures bench blind closed-loop tuning real peers docs clean

help: ## Show this list
	echo "make TARGET, where TARGET is one of"
	awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  %-14s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)
	echo "Variables: PYTHON=$(PYTHON) makes the virtual environment, OUT=$(OUT) takes the results, JOBS=$(JOBS) processes work."

$(READY): pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "automarine needs Python 3.11 or newer; found: $$($(PYTHON) --version 2>&1). Say make PYTHON=python3.12 or the like." >&2; exit 1; }
	echo "Making the virtual environment $(VENV) (once) ..."
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV) || \
	  { rm -rf $(VENV); echo "$(PYTHON) cannot make virtual environments; on Debian and Ubuntu install python3-venv." >&2; exit 1; }
	$(BIN)/python -m pip install --quiet --quiet --disable-pip-version-check --upgrade "pip>=25.1"
	$(BIN)/python -m pip install --quiet --quiet --editable . --group dev
	touch $@

$(DOCS_READY): $(READY)
	$(BIN)/python -m pip install --quiet --quiet --disable-pip-version-check --editable . --group docs
	touch $@

demo: $(READY) ## Thrusters, yaw model, validation, a diagnosis of sample_runs and a controller, into OUT/demo
	echo "== 1/5 Bollard tests: the thruster map"
	$(MAKE) fit-thrusters OUT=$(OUT)/demo
	printf '\n%s\n' "== 2/5 Step runs: inertia and drag (truth: I_r 1.018, k_rr 1.257)"
	$(MAKE) fit-yaw OUT=$(OUT)/demo
	printf '\n%s\n' "== 3/5 Four other runs, predicted from their commands alone"
	$(MAKE) validate OUT=$(OUT)/demo
	printf '\n%s\n' "== 4/5 A second campaign with a hidden effect: fit, then diagnose (truth: water-swirl, chi 0.15, T_w 10 s)"
	$(MAKE) diagnose-one OUT=$(OUT)/demo
	printf '\n%s\n' "== 5/5 A heading controller for the vehicle of that campaign"
	$(MAKE) tune OUT=$(OUT)/demo
	printf '\n%s\n' "== All results"
	echo "Tables:  $(OUT)/demo/yaw/table1.md  $(OUT)/demo/yaw/table2.md  $(OUT)/demo/validation/validation.md"
	echo "Plots:   $(OUT)/demo/thrusters/*.png  $(OUT)/demo/yaw/*.png  $(OUT)/demo/validation/*.png"
	echo "Hidden:  $(OUT)/demo/diagnose_one/diagnosis.md  $(OUT)/demo/diagnose_one/*.png"
	echo "Gains:   $(OUT)/demo/tuning/ardusub.param  $(OUT)/demo/tuning/tuning.md  $(OUT)/demo/tuning/tuning.png"

fit-thrusters: $(READY) ## Bollard tests of sample_runs -> thruster map, into OUT/thrusters
	$(AUTOMARINE) fit-thrusters sample_runs/thrusters --thrusters-per-test 2 -o $(OUT)/thrusters --overwrite

fit-yaw: $(READY) ## Step runs of sample_runs -> Table 1, Table 2, yaw model, into OUT/yaw
	$(AUTOMARINE) fit-yaw sample_runs/steps -o $(OUT)/yaw --overwrite --jobs $(JOBS)

validate: $(READY) ## Validation runs of sample_runs against the yaw model, into OUT/validation
	test -e $(OUT)/yaw/yaw_model.json || $(MAKE) fit-yaw
	$(AUTOMARINE) validate sample_runs/validation --model $(OUT)/yaw/yaw_model.json -o $(OUT)/validation --overwrite \
	  --jobs $(JOBS)

diagnose: $(READY) diagnose-one diagnose-two ## What is hidden in two campaigns of sample_runs, into OUT/diagnose_one, OUT/diagnose_two

diagnose-%: $(READY)
	$(AUTOMARINE) fit-yaw sample_runs/hidden_$* --fit-to whole-runs -o $(OUT)/hidden_$* --overwrite -q --jobs $(JOBS)
	$(AUTOMARINE) diagnose sample_runs/hidden_$* --model $(OUT)/hidden_$*/yaw_model.json \
	  -o $(OUT)/diagnose_$* --overwrite --seed 0 --jobs $(JOBS)

tune: $(READY) ## Heading gains for ArduSub from the first of these diagnoses, into OUT/tuning
	test -e $(OUT)/diagnose_one/diagnosis.json || $(MAKE) diagnose-one
	$(AUTOMARINE) tune $(OUT)/diagnose_one/diagnosis.json --for ardusub --full 1.2 -o $(OUT)/tuning --overwrite

run: $(READY) ## Every step of the campaign sample_runs/pool_day.toml and its report, into OUT/pool_day
	$(AUTOMARINE) run sample_runs/pool_day.toml -o $(OUT)/pool_day --jobs $(JOBS)

reproduce: $(READY) ## The demo twice, under two locales; fails unless every byte is equal
	rm -rf $(OUT)/reproduce
	$(MAKE) demo OUT=$(OUT)/reproduce/first JOBS=1 > /dev/null & first=$$!; \
	  umask 077; export TZ=Pacific/Kiritimati LC_ALL=C PYTHONHASHSEED=4242; \
	  $(MAKE) demo OUT=$(OUT)/reproduce/second JOBS=2 > /dev/null; second=$$?; wait $$first && exit $$second
	diff -r $(OUT)/reproduce/first $(OUT)/reproduce/second
	$(AUTOMARINE) verify $(OUT)/reproduce/first -q
	count=$$(find $(OUT)/reproduce/first -type f | wc -l | tr -d ' '); test "$$count" -gt 0; \
	  echo "Reproduced: $$count files, every byte equal."

docs: $(DOCS_READY) ## The guide as a site with a search, into OUT/docs; fails at a broken link, a lost word, a page too wide
	rm -rf $(OUT)/docs
	$(BIN)/sphinx-build -q -n -W --keep-going -c .docs -d $(OUT)/docs.doctrees -E . $(OUT)/docs
	SITE=$(OUT)/docs $(BIN)/python -m pytest -q tests/guide/test_site.py
	echo "Site: $(OUT)/docs/index.html"

wheel: $(READY) ## Build the wheel into OUT/wheel, install it into an empty environment and use it there
	.ci/wheel $(OUT)/wheel $(BIN)/python

test: $(READY) ## Run the tests but for the slow ones, on all cores
	$(BIN)/python -m pytest -q $(SHARED) -m "not slow"

test-all: test test-slow ## All tests

test-slow: $(READY) ## Run the slow ones: clusters, same bytes, planted effects, real data, every example
	$(BIN)/python -m pytest -q $(SHARED) -m slow

check: $(READY) ## Lint, format, types and the order of imports
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	MYPYPATH=tests:tests/helpers:tests/benchmarks $(BIN)/mypy --follow-imports=silent tests/benchmarks/*.py
	$(BIN)/python -m pytest -q tests/test_house.py

sample-runs: $(READY) ## Make sample_runs again from its specifications
	$(AUTOMARINE) simulate sample_runs/campaign.toml -o $(OUT)/sample_runs --overwrite
	for made in thrusters steps validation truth.json; do \
	  rm -rf sample_runs/$$made && cp -R $(OUT)/sample_runs/$$made sample_runs/$$made || exit 1; done
	for made in hidden_one hidden_two surge sway heave roll hidden_surge hidden_heave planar; do \
	  $(AUTOMARINE) simulate sample_runs/$$made.toml -o $(OUT)/sample_runs_$$made --overwrite && \
	  cp $(OUT)/sample_runs_$$made/truth.json sample_runs/$$made.truth.json || exit 1; \
	  for logs in $(OUT)/sample_runs_$$made/*/; do rm -rf sample_runs/$$(basename $$logs) && \
	    cp -R $$logs sample_runs/$$(basename $$logs) || exit 1; done; done

paper: $(READY) ## The paper's own tables against 200 simulated campaigns
	$(BENCHMARK)/paper.py --out $(OUT)

pictures: $(READY) ## The figures of README and guide, from sample_runs
	$(BENCHMARK)/pictures.py

bench: $(READY) ## Accuracy against the Cramer-Rao bound, coverage of intervals, speed of commands
	$(BENCHMARK)/bench.py --out $(OUT)/bench.json

blind: $(READY) ## Does diagnose name what is hidden? Campaigns with a known truth made without the library; hours, goes on
	mkdir -p $(OUT)/blind
	test -e $(OUT)/blind/key.json || $(BENCHMARK)/blind_frozen.py write $(OUT)/blind/campaigns --key $(OUT)/blind/key.json
	$(BENCHMARK)/blind_frozen.py answer $(OUT)/blind/campaigns --answers $(OUT)/blind/answers.json --jobs $(JOBS)
	$(BENCHMARK)/blind_frozen.py score $(OUT)/blind/answers.json --key $(OUT)/blind/key.json

closed-loop: $(READY) ## The same where a controller steers and the water disturbs
	$(BENCHMARK)/closed_loop.py --jobs $(JOBS) --out $(OUT)/closed_loop.json

tuning: $(READY) ## Do the promises of tune hold? Five vehicles in twelve corners, 60 blind ones with a known truth; two hours
	$(BENCHMARK)/tuning.py --jobs $(JOBS) --out $(OUT)

real: $(READY) ## Real logs, halves exchanged: predictions against least squares and constants, what is named; AUTOMARINE_DATA
	$(BENCHMARK)/real.py --jobs 2 --out $(OUT)

$(PEERS_READY): $(READY)
	$(BIN)/python -m pip install --quiet --quiet --disable-pip-version-check --group peers
	touch $@

peers: $(PEERS_READY) ## Side by side with a plain script, mujoco.sysid, PySINDy and regression; 40 minutes, goes on
	$(BENCHMARK)/peers.py --jobs 2 --out $(OUT)/peers

clean: ## Remove results, caches and the virtual environment
	rm -rf out $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
