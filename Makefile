# One command from nothing to a result. Everything lives in .venv and $(RUNS).
PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
LOCKED = $(BIN)/pip install --quiet --require-hashes --no-deps
READY := .venv/.ready

RUNS ?= runs
JOBS ?= 2
# Each process loads every library for itself: more than four would load longer than they save.
SIDE_BY_SIDE = -n logical --maxprocesses=4 --dist worksteal
# Tests start hundreds of processes, which read the package's byte code instead of compiling it, whatever the environment says.
TESTED = OMP_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE=
RUN = OMP_NUM_THREADS=1 $(BIN)/echolearn
# The cut that the tables of README and docs/measured.md were made with.
TRAIN = $(RUN) train -m -j $(JOBS) aim=balanced

SETS := paper,paper_planar,scattered,offgrid_10x8x6,offgrid_8x6x5,offgrid_13x11x5
# Classifiers that are cross-validated, too, as in the paper: those that fit in seconds.
CROSSED := s*,t*
# Those for sets of their own (`plan=varied`): they are no rows of the paper's comparison.
LATER := adapted,sklearn,walls_*,*_ideal,*_cfar,*_invariant,ensemble,mapnet,posenet
# The rooms that are mapped.
MAPPED := 8x6x5,13x11x5

.DEFAULT_GOAL := help
.PHONY: help venv paper map tiny measured adapted point large walk walk-bundle readme studies bench architecture docs test test-release coverage lint clean

help: ## show this page
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

venv: $(READY) ## create .venv with the locked dependencies
$(READY): requirements.lock requirements-cuda.lock pyproject.toml
	$(PYTHON) -m venv .venv
	@# torch first, as pip would choose it without hashes: with them it leaves a CPU build in a local folder (PIP_FIND_LINKS)
	@# for the one of PyPI, five times as large. Which it is, its hash is one of those in the lock.
	sed -n '/^torch==/,/[^\\]$$/p' requirements.lock >.venv/torch.lock
	$(BIN)/pip download --quiet --no-deps --dest .venv/torch "$$(grep -o '^torch==[^ ]*' .venv/torch.lock)"
	$(LOCKED) --no-index --find-links .venv/torch --requirement .venv/torch.lock
	rm -r .venv/torch
	$(LOCKED) --requirement requirements.lock
	@# Only PyPI's torch for Linux lacks something now.
	$(BIN)/pip check >/dev/null || $(LOCKED) --requirement requirements-cuda.lock
	$(BIN)/pip install --quiet --no-deps --no-build-isolation --editable .
	@# Loops are compiled once here, by sets that need nearly all of them; else each process does so that finds none.
	-$(RUN) generate -m runs=.venv/first engine=serial -- plan=varied plan.rows=6 plan.t60=[0.3,0.3] -- plan=tiny_scattered plan.rows=4 plan.rooms=[l_shape] >/dev/null 2>&1
	rm -rf .venv/first
	touch $@

paper: $(READY) ## the main job in full size: sets, classifiers, surveys, comparison
	$(RUN) generate -m runs=$(RUNS) plan=$(SETS)
	$(TRAIN) runs=$(RUNS) target=reflector \
	  -- plan=paper seed=0 'classifier=glob([$(CROSSED)],exclude=[$(LATER)])' folds=5 \
	  -- plan=paper seed=0 'classifier=glob(*,exclude=[$(CROSSED),$(LATER)])' \
	  -- plan=paper seed=1,2 'classifier=glob(*,exclude=[$(LATER)])' \
	  -- plan=scattered seed=0,1,2 'classifier=glob(*,exclude=[$(LATER)])' \
	  -- plan=paper_planar seed=0,1,2 classifier=svm_pair,svm_toa,threshold_peak split=position,row
	$(RUN) survey -m -j $(JOBS) runs=$(RUNS) room=$(MAPPED) snr_db=-10,-5,0,10,40
	$(RUN) compare runs=$(RUNS) $(README)

map: $(READY) ## a map of the example walk by the bundle that comes along, nothing trained
	$(RUN) map runs=$(RUNS) survey=examples/survey/short

tiny: $(READY) ## the same path on small sets, for a first look
	$(RUN) generate -m runs=$(RUNS)/tiny plan=tiny,tiny_scattered
	$(TRAIN) runs=$(RUNS)/tiny target=reflector classifier=threshold_peak,svm_pair,svm_features,trees_features,mlp_features plan=tiny_scattered
	$(RUN) survey -m -j $(JOBS) runs=$(RUNS)/tiny room=8x6x5 snr_db=-5,0 poses=60
	$(RUN) compare runs=$(RUNS)/tiny name=tiny 'tested=[tiny,tiny_scattered]' 'surveys=[8x6x5_-5dB,8x6x5_0dB]' resamples=200

# Levels and draws of the noise that measured sound is judged at.
LEVELS := -10,-5,0,10,40
HEARD = $(foreach draw,0 1,$(foreach level,-10 -5 0 10 40,r3vival_$(level)dB_$(draw)))
comma := ,
empty :=

measured: $(READY) ## classifiers for the array of R3VIVAL on its measured sound; writes docs/measured.md; CHECKOUT=folder takes the whole set
	$(RUN) generate -m runs=$(RUNS)/measured scene=octahedron plan=scattered plan.rows=3000 realism=clean,measured
	$(TRAIN) runs=$(RUNS)/measured scene=octahedron plan=scattered plan.rows=3000 realism=clean,measured \
	  -- classifier=trees_features,svm_features,threshold_peak,svm_pair target=reflector \
	  -- classifier=trees_features,svm_features target=time_and_direction
	$(RUN) import -m -j $(JOBS) runs=$(RUNS)/measured snr_db=$(LEVELS) draw=0,1 $(if $(CHECKOUT),folder=$(CHECKOUT))
	$(RUN) compare runs=$(RUNS)/measured name=measured 'tested=[scattered,scattered_measured]' \
	  'surveys=[$(subst $(empty) ,$(comma),$(strip $(HEARD)))]' \
	  localizer@localizers.snls=null localizer@localizers.joint=null readme=docs/measured.md

# Every second place of the loudspeaker is labelled, the others are tested on, in the room with absorbing panels.
HALVES = $(shell $(BIN)/python -c "from echolearn.survey.sources.r3vival import PLACES as p; print(*('['+','.join(h)+']' for h in (p[::2],p[1::2])))")
LABELLED = $(foreach draw,0 1,$(foreach level,-10 -5 0 10 40,learned_$(level)_$(draw)))
HUNDRED = source.conditions=[\'100\'] folder=$(CHECKOUT) runs=$(RUNS)/adapted

adapted: measured ## what adapting filters to half of R3VIVAL's places adds on the others; CHECKOUT=folder of the whole set; writes docs/measured.md
	@test -n "$(CHECKOUT)" || { echo "CHECKOUT= must name a checkout of facebookresearch/R3VIVAL"; exit 1; }
	$(RUN) import -m -j $(JOBS) $(HUNDRED) snr_db=$(LEVELS) draw=0,1 source.places=$(word 1,$(HALVES)) 'name=learned_$${snr_db}_$${draw}'
	$(RUN) import -m -j $(JOBS) $(HUNDRED) snr_db=$(LEVELS) draw=2,3 source.places=$(word 2,$(HALVES)) 'name=tested_$${snr_db}_$${draw}'
	$(RUN) label runs=$(RUNS)/adapted name=half survey=$(firstword $(LABELLED)) \
	  'beside=[$(subst $(empty) ,$(comma),$(wordlist 2,99,$(LABELLED)))]'
	for run in $(RUNS)/measured/train/trees_features-scattered_measured-* $(RUNS)/measured/train/svm_features-scattered_measured-*; do \
	  $(RUN) train runs=$(RUNS)/adapted init=$$run plan=half target=time_and_direction aim=balanced test_share=0.1 validation_share=0.3 \
	  || exit 1; done
	OMP_NUM_THREADS=1 $(BIN)/python docs/adapting.py $(RUNS)/adapted $(RUNS)/measured docs/measured.md

# What sets for filters of measured sound hold besides, as the plan of that name has it, and the tensors of networks.
FURTHER = $(shell sed -n 's/^further: \[\(.*\)\].*/\1/p' conf/plan/varied.yaml)
TENSORS := covariance_steered_ideal,correlation_map
OCTAHEDRON = $(subst $(empty) ,$(comma),$(strip $(HEARD)))
ONE_LOCALIZER := localizer@localizers.snls=null localizer@localizers.joint=null
LEARN = $(RUN) train -m -j $(JOBS)

# The recipe of the bundle that comes along, and, on fewer rows, of one for the array of R3VIVAL, judged on measured sound.
POINT = $(RUNS)/point
JUDGED = runs=$(POINT)/measured scene=octahedron plan.rows=4000
# The rooms that it learned in are smaller than those of the plan.
SMALLER := plan.size_low=[4.0,4.0,2.6] plan.size_high=[14.0,12.0,7.0] plan.t60=[0.3,1.0]

point: $(READY) ## the bundle `point` that comes along, made anew: sets, filter, comparisons, docs/cards/point.md
	$(RUN) generate -m plan=varied $(SMALLER) -- runs=$(POINT) -- $(JUDGED)
	$(LEARN) plan=varied $(SMALLER) classifier=trees_invariant -- runs=$(POINT) -- $(JUDGED)
	$(RUN) generate runs=$(POINT) plan=varied $(SMALLER) plan.poses=8 plan.rows=4096 plan.name=varied_walks plan.seed=18
	$(RUN) generate -m runs=$(POINT) plan=offgrid_8x6x5,offgrid_13x11x5 'plan.further=[$(FURTHER)]'
	$(RUN) compare runs=$(POINT) name=point 'tested=[offgrid_8x6x5,offgrid_13x11x5]' surveys=[]
	$(RUN) import -m -j $(JOBS) runs=$(POINT)/measured snr_db=$(LEVELS) draw=0,1
	$(RUN) compare runs=$(POINT)/measured name=measured tested=[varied] 'surveys=[$(OCTAHEDRON)]' $(ONE_LOCALIZER)
	$(RUN) export runs=$(POINT) run=$$(ls -d $(POINT)/train/trees_invariant-varied-s0-*) name=point reference=varied_walks \
	  card=docs/cards/point.md 'evidence=[$(POINT)/compare/point,$(POINT)/measured/compare/measured]'
	rm -rf src/echolearn/bundles/point && mkdir -p src/echolearn/bundles
	cp -r $(POINT)/bundles/point src/echolearn/bundles/point

# Filters on large sets: every classifier, label and kind of column, every ingredient of realism left out in turn.
ROWS ?= 50000
SEEDS ?= 0,1,2
MODELS ?= glob(*,exclude=[adapted,sklearn])
FEWER = $(shell echo $$(($(ROWS) / 5)))
WHOLE = plan=varied plan.rows=$(ROWS) 'plan.further=[$(FURTHER),cfar,$(TENSORS)]'
PART = plan=varied plan.rows=$(FEWER)
# Each left out of realism=measured, and what that sets.
LEFT_OUT := \
  -- plan.name=varied_without_nothing \
  -- plan.name=varied_without_spread realism.spread=[0,0] realism.scattering=[0,0] \
  -- plan.name=varied_without_absorption realism.absorption_db=[0,0] \
  -- plan.name=varied_without_clutter realism.scatterers=[0,0] \
  -- plan.name=varied_without_microphones realism.microphone_db=[0,0] realism.microphone_ripple_db=[0,0] realism.microphone_offset=[0,0] \
  -- plan.name=varied_without_loudspeaker realism.loudspeaker_low=[0,0] realism.loudspeaker_high=[0,0] realism.loudspeaker_ripple_db=[0,0] realism.directivity=[0,0] \
  -- plan.name=varied_without_latency realism.latency_samples=[0,0] \
  -- plan.name=varied_without_residual realism.residual=[0,0] \
  -- plan.name=varied_without_colour realism.coloured=[0,0] \
  -- plan.name=varied_without_all realism=clean
# The same positions of the room of 8 x 6 x 5 m heard otherwise: a gain, a sample of latency, microphones 4 mm (2 % of the
# radius) off in the root mean square, rotors as loud as the direct sound, other walls.
CONDITIONS := louder softer late early displaced rotor absorbing dry reverberant
HEARD_louder := plan.gain_db=[12,12]
HEARD_softer := plan.gain_db=[-12,-12]
HEARD_late := realism.latency_samples=[1,1]
HEARD_early := realism.latency_samples=[-1,-1]
HEARD_displaced := realism.microphone_offset=[0.0023,0.0023]
HEARD_rotor := diffuse=rotor plan.sdnr_db=[0,0]
HEARD_absorbing := plan.wall_factor=[0.5,0.5]
HEARD_dry := plan.t60=[0.3,0.3]
HEARD_reverberant := plan.t60=[1,1]
LARGE = $(RUNS)/large
AWAY = 'plan.further=[$(FURTHER),cfar,$(TENSORS)]' plan.rows=$(ROWS)
REPEATED = $(foreach each,$(CONDITIONS),offgrid_8x6x5_$(each))

large: $(READY) ## filters on 50 000 rows, three seeds, all classifiers, measured sound: hours; writes docs/filters.md; try it by ROWS=2000 SEEDS=0
	@mkdir -p $(LARGE) && date +%s >$(LARGE)/began
	$(RUN) generate -m runs=$(LARGE) -- $(WHOLE) -- plan=offgrid_8x6x5,offgrid_13x11x5 $(AWAY)
	$(RUN) generate -m runs=$(LARGE) $(PART) $(LEFT_OUT)
	$(RUN) generate -m runs=$(LARGE) plan=offgrid_8x6x5 $(AWAY) $(foreach each,$(CONDITIONS),-- plan.name=offgrid_8x6x5_$(each) $(HEARD_$(each)))
	$(LEARN) runs=$(LARGE) $(WHOLE) seed=$(SEEDS) -- 'classifier=$(MODELS)' -- classifier=trees_invariant,trees_features target=reflector,time_and_direction
	$(LEARN) runs=$(LARGE) $(PART) seed=$(SEEDS) classifier=trees_invariant,trees_features $(LEFT_OUT)
	$(RUN) compare runs=$(LARGE) name=large workers=$(JOBS) readme=docs/filters.md surveys=[] \
	  'tested=[offgrid_8x6x5,offgrid_13x11x5,$(subst $(empty) ,$(comma),$(strip $(REPEATED)))]'
	$(RUN) generate -m runs=$(LARGE)/measured scene=octahedron -- $(WHOLE) $(subst --,-- $(PART),$(LEFT_OUT))
	$(LEARN) runs=$(LARGE)/measured scene=octahedron seed=$(SEEDS) -- $(WHOLE) 'classifier=$(MODELS)' \
	  -- $(WHOLE) classifier=trees_invariant,trees_features target=reflector,time_and_direction \
	  $(subst --,-- $(PART) classifier=trees_invariant$(comma)trees_features,$(LEFT_OUT))
	$(RUN) import -m -j $(JOBS) runs=$(LARGE)/measured snr_db=$(LEVELS) draw=0,1
	$(RUN) compare runs=$(LARGE)/measured name=measured workers=$(JOBS) tested=[varied] 'surveys=[$(OCTAHEDRON)]' \
	  $(ONE_LOCALIZER) readme=docs/filters_measured.md
	@echo "make large: $$((($$(date +%s) - $$(cat $(LARGE)/began)) / 60)) min for ROWS=$(ROWS) SEEDS=$(SEEDS)"

# Judges of walls. From 200 walks in boxes by default; what it is meant for is WALKS=1500 ROOMS=box,l_shape,five_corners,door,pillars
# TESTED_WALKS=100. Each test set is one SNR (dB) and one odometry error (cm) in a room that nobody trained on; cells of one room
# repeat the same walks.
WALKS ?= 200
ROOMS ?= box
TESTED_WALKS ?= 20
WALKED ?= 8x6x5
WALK_DB ?= -10 -15 -20
WALK_CM ?= 0 1 3
WALK = $(RUNS)/walk
WALKING = plan=walks plan.rows=$(WALKS) 'plan.rooms=[$(ROOMS)]'
WALK_CELLS = $(foreach room,$(WALKED),$(foreach db,$(WALK_DB),$(foreach cm,$(WALK_CM),walks_$(room)_$(db)dB_$(cm)cm)))
# One cell: -- and its words.
CELL = -- +room@plan.room=$(1) plan.name=walks_$(1)_$(2)dB_$(3)cm plan.snr_db=[$(2),$(2)] plan.odometry_error=[0.0$(3),0.0$(3)]

walk: $(READY) ## which walls a whole walk should believe: walks, judges, comparison; writes docs/walls.md; the large one is WALKS=1500
	@mkdir -p $(WALK) && date +%s >$(WALK)/began
	$(RUN) generate runs=$(WALK) $(WALKING)
	$(RUN) generate -m runs=$(WALK) plan=walks plan.seed=21 plan.role=test plan.rows=$(TESTED_WALKS) 'plan.paths=[wandering]' 'plan.odometry=[white]' \
	  $(foreach room,$(WALKED),$(foreach db,$(WALK_DB),$(foreach cm,$(WALK_CM),$(call CELL,$(room),$(db),$(cm)))))
	$(RUN) train -m runs=$(WALK) $(WALKING) target=is_wall aim='precision 0.97' 'classifier=glob(walls_*)'
	$(RUN) compare runs=$(WALK) name=walks 'walks=[$(subst $(empty) ,$(comma),$(strip $(WALK_CELLS)))]' readme=docs/walls.md
	@echo "make walk: $$((($$(date +%s) - $$(cat $(WALK)/began)) / 60)) min for WALKS=$(WALKS) ROOMS=$(ROOMS) TESTED_WALKS=$(TESTED_WALKS)"

walk-bundle: walk ## the bundle `walk` that comes along, made anew of what `make walk` has trained; docs/cards/walk.md
	$(RUN) export runs=$(WALK) run=$$(ls -d $(WALK)/train/walls_trees-walks_hypotheses-s0-*) name=walk \
	  card=docs/cards/walk.md 'evidence=[$(WALK)/compare/walks]'
	rm -rf src/echolearn/bundles/walk && mkdir -p src/echolearn/bundles
	cp -r $(WALK)/bundles/walk src/echolearn/bundles/walk

readme: $(READY) ## run everything from nothing, in runs/fresh, and write the times and results into README.md
	rm -rf runs/fresh
	@for target in $(TIMED); do \
	  began=$$(date +%s); \
	  $(MAKE) $$target RUNS=runs/fresh README=readme=README.md || exit 1; \
	  spent=$$(($$(date +%s) - began)); \
	  text="<!-- $$target -->$$((spent / 60)) min $$((spent % 60)) s<!-- end -->"; \
	  sed "s/<!-- $$target -->[^<]*<!-- end -->/$$text/" README.md > README.md.new && mv README.md.new README.md; \
	done

# What readme times; make readme TIMED=test does no more than that.
TIMED ?= tiny paper test

RECORDED = experiment=rotor,stretches 'name=$${choice.experiment}_recorded' diffuse=recorded diffuse.source.path=$(RECORDING)

studies: $(READY) ## how well localizers find echoes, against SNR, T60, noise, faults, with other arrays; writes docs/studies.md, docs/arrays.md
	$(RUN) study -m runs=$(RUNS) workers=$(JOBS) page=docs/studies.md \
	  -- experiment=paper_snr,paper_t60,rotor,stretches,arms,pings,faults \
	  -- experiment=attainable room=$(MAPPED) \
	  -- experiment=attainable room=$(MAPPED) seed=1 'values=[-20]' pings=10 'name=attainable_$${choice.room}_10_pings' \
	  -- experiment=attainable room=$(MAPPED) seed=2 'values=[-30]' pings=100 'name=attainable_$${choice.room}_100_pings' \
	  $(if $(RECORDING),-- $(RECORDED))
	$(RUN) study -m runs=$(RUNS) workers=$(JOBS) page=docs/arrays.md experiment=arrays,ceiling

bench: $(READY) ## time everything beside its peers, and write docs/benchmarks.md and docs/scaling.md; best on an idle machine
	@test ! -e $(RUNS)/compare/paper/manifest.json || $(RUN) export best=$(RUNS)/compare/paper runs=$(RUNS)
	$(RUN) bench runs=$(RUNS) page=docs/benchmarks.md scaling=docs/scaling.md

architecture: ## draw the rooms and who imports whom; writes docs/architecture.svg
	$(PYTHON) docs/draw_architecture.py

# The tools of the site stand apart from .venv, which they can see.
DOCS := .venv/docs
$(DOCS)/.ready: requirements-docs.lock $(READY)
	$(PYTHON) -m venv $(DOCS)
	$(DOCS)/bin/pip install --quiet --require-hashes --no-deps --requirement requirements-docs.lock
	$(BIN)/python -c "import sysconfig; print(sysconfig.get_path('purelib'))" \
	  >$$($(DOCS)/bin/python -c "import sysconfig; print(sysconfig.get_path('purelib'))")/lab.pth
	touch $@

docs: $(DOCS)/.ready ## these pages as a site that opens offline, runs/docs/index.html; a broken link is an error
	PYTHONPATH=src $(DOCS)/bin/sphinx-build --quiet --fail-on-warning --keep-going docs $(RUNS)/docs
	@echo $(RUNS)/docs/index.html

test: $(READY) ## run the tests but those for a release
	@$(TESTED) $(BIN)/pytest -q $(SIDE_BY_SIDE)

test-release: $(READY) ## run the tests that need fresh environments, a browser or minutes
	@$(TESTED) $(BIN)/pytest -m release --durations=10

coverage: $(READY) ## which lines and branches the tests reach
	@rm -f .coverage .coverage.*
	COVERAGE_FILE=$(CURDIR)/.coverage $(TESTED) $(BIN)/coverage run -m pytest -q $(SIDE_BY_SIDE)
	@$(BIN)/coverage combine --quiet && $(BIN)/coverage report --skip-covered --sort=cover

lint: $(READY) ## ruff and mypy
	$(BIN)/ruff check src tests
	$(BIN)/ruff format --check src tests
	$(BIN)/mypy

clean: ## remove what tools leave behind; .venv and runs/ stay
	rm -rf build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find src tests -name __pycache__ -type d -prune -exec rm -rf {} +
