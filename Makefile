# One command from nothing to a result. Everything lives in .venv and runs/.
PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
READY := .venv/.ready
RUN := OMP_NUM_THREADS=1 $(BIN)/echolearn

CLASSIFIERS := 'classifier=glob(*)'
SEEDS := seed=0,1,2
SETS := paper,paper_planar,scattered,offgrid_10x8x6,offgrid_8x6x5,offgrid_13x11x5

.DEFAULT_GOAL := help
.PHONY: help venv paper tiny test lint clean

help: ## show this page
	@awk -F ':.*## ' '/^[a-z]+:.*## / {printf "make %-7s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

venv: $(READY) ## create .venv with the locked dependencies
$(READY): requirements.lock pyproject.toml
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --requirement requirements.lock
	$(BIN)/pip install --quiet --no-deps --no-build-isolation --editable .
	touch $@

paper: $(READY) ## the main job in full size: sets, classifiers, surveys, comparison
	$(RUN) generate -m plan=$(SETS)
	$(RUN) train -m $(CLASSIFIERS) $(SEEDS) plan=paper,scattered
	$(RUN) train -m classifier=svm_pair,svm_toa,threshold_peak $(SEEDS) plan=paper_planar split=position,row
	$(RUN) survey -m room=8x6x5,13x11x5 snr_db=-10,-5,0,10,40
	$(RUN) compare $(README)

tiny: $(READY) ## the same path on small sets, for a first look
	$(RUN) generate -m runs=runs/tiny plan=tiny,tiny_scattered
	$(RUN) train -m runs=runs/tiny classifier=threshold_peak,svm_pair,svm_features,trees_features,mlp_features seed=0 plan=tiny_scattered
	$(RUN) survey -m runs=runs/tiny room=8x6x5 snr_db=-5,10 poses=60
	$(RUN) compare runs=runs/tiny name=tiny 'tested=[tiny,tiny_scattered]' 'surveys=[8x6x5_-5dB,8x6x5_10dB]' resamples=200

test: $(READY) ## run the tests
	@OMP_NUM_THREADS=1 $(BIN)/pytest -q

lint: $(READY) ## ruff and mypy
	$(BIN)/ruff check src tests
	$(BIN)/ruff format --check src tests
	$(BIN)/mypy

clean: ## remove what tools leave behind; .venv and runs/ stay
	rm -rf build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find src tests -name __pycache__ -type d -prune -exec rm -rf {} +
