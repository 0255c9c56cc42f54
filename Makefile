# Two commands: `make demo` and `make test`. Both set everything up first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
JOBS ?= 2

.PHONY: demo test lint test-tools fuzz setup paper streets published published-streets published-localization \
	published-real-cars published-grasping \
	published-models published-weight published-evidence published-stereo published-recording \
	published-report published-defaults published-street published-real published-prose published-bench \
	published-scale bench docs clean
.DELETE_ON_ERROR:

setup: $(VENV)/.ready

$(VENV)/.ready: pyproject.toml .ci/setup .ci/install
	PYTHON=$(PYTHON) VENV=$(VENV) sh .ci/setup
	@touch $@

demo: setup
	$(BIN)/rescore reproduce --preset demo --out runs/demo --jobs $(JOBS)

paper: setup
	$(BIN)/rescore reproduce --preset paper --out runs/paper --jobs $(JOBS)

streets: setup
	$(BIN)/rescore reproduce --preset streets --out runs/streets --jobs $(JOBS)

test: setup
	$(MAKE) --jobs 2 lint test-tools
	RERUN_STRICT=1 $(BIN)/pytest -n $(JOBS) --dist loadfile --no-loadscope-reorder

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

test-tools: setup
	VENV=$(VENV) sh .ci/setup-tests

# figures in README and docs, from the published JSON; every target that makes such JSON calls it
PROSE = $(BIN)/python -m reports.publishing.prose
published-prose: setup
	$(PROSE)

# damaged files of every kind that is read; `make test` has a slice of it
CASES ?= 5250
fuzz: setup
	$(BIN)/python -m tests.faults.fuzz --cases $(CASES) --seed 0

# the results kept in the repository
published: paper
	$(BIN)/python -m reports.publishing.publish runs/paper reports/published/roc "make published"
	$(PROSE)

published-localization: setup
	$(BIN)/rescore localize --out runs/localization --cars 20 --placements 200 --seed 0 --jobs $(JOBS)
	$(BIN)/python -m reports.studies.localization runs/localization reports/published/localization \
	    "make published-localization"
	$(PROSE)

published-grasping: setup
	$(BIN)/rescore grasp --out runs/grasping --cars 20 --placements 3 --fit-placements 25 --seed 0 --show 0 --jobs $(JOBS)
	$(BIN)/rescore grasp-errors --out runs/grasping --seed 0 --jobs $(JOBS)
	$(BIN)/rescore grasp-basket --out runs/grasping --seed 0 --jobs $(JOBS)
	$(BIN)/python -m reports.publishing.grasp_recording runs/grasping/trial_0.rrd runs/grasping/recording.jpg
	$(BIN)/python -m reports.studies.grasping runs/grasping reports/published/grasping "make published-grasping"
	$(PROSE)

published-models: setup
	$(BIN)/rescore study-models --out reports/published/models --jobs $(JOBS)
	$(BIN)/rescore study-views --out reports/published/view_bins
	$(BIN)/rescore gallery --out reports/published/reconstructions
	$(PROSE)

published-weight: paper
	$(BIN)/rescore synth runs/weight_data --preset weight-study --jobs $(JOBS)
	$(BIN)/rescore study-weight runs/paper --dataset runs/weight_data --keep runs/weight_candidates \
	    --out reports/published/weight --jobs $(JOBS)
	$(PROSE)

published-report: paper
	$(BIN)/python -m reports.publishing.screenshots runs/paper reports/published/report "make published-report"

published-evidence: paper
	$(BIN)/rescore study-evidence runs/paper --out reports/published/evidence --jobs $(JOBS)

# STREETS= names a finished run of preset streets; `make streets` makes the usual one
STREETS ?= runs/streets
published-streets: setup
	$(BIN)/rescore study-class-model $(STREETS) --out reports/published/streets/class_model
	$(BIN)/rescore study-relief $(STREETS) --out reports/published/streets/relief --jobs $(JOBS)
	$(BIN)/python -m reports.publishing.publish $(STREETS) reports/published/streets "make published-streets"
	$(PROSE)

# what `rescore apply` uses where no model is named, from a finished run that has mode instance
published-defaults: setup
	$(BIN)/python -m reports.publishing.defaults $(STREETS)

# KITTI= names a folder of KITTI pairs, with or without truth
KITTI ?=
SCENES := runs/stereo_pairs
published-stereo: setup
	mkdir -p $(SCENES)/download
	cd $(SCENES)/download && apt-get download opencv-doc && dpkg -x opencv-doc_*.deb opencv-doc
	$(BIN)/python -m pip download -q --no-deps --only-binary :all: --python-version 3.8 \
	    -d $(SCENES)/download scikit-image==0.16.2
	$(BIN)/python -m reports.publishing.stereo_pairs $(SCENES)/download/opencv-doc \
	    $(SCENES)/download/scikit_image-0.16.2-*.whl $(SCENES)
	$(BIN)/rescore study-stereo $(SCENES)/aloe $(SCENES)/motorcycle $(KITTI) --out reports/published/stereo

# pictures of the viewer, which draws with Vulkan: apt-get install mesa-vulkan-drivers
published-recording: paper
	$(BIN)/python -m reports.publishing.recording_pictures runs/paper reports/published/recording "make published-recording"

# the committed real frames, rescored as a newcomer does; the first picture of the README
STREET := examples/real_street
published-street: setup
	$(BIN)/rescore apply $(STREET) $(STREET)/detections.json --out runs/real_street/rescored.json \
	    --evidence runs/real_street/evidence
	$(BIN)/rescore evaluate $(STREET) runs/real_street/rescored.json --out runs/real_street
	$(BIN)/python -m reports.publishing.real_street runs/real_street reports/published/real_street \
	    "make published-street"

# pop-ups of the real cars of the committed frames
published-real-cars: setup
	$(BIN)/python -m reports.publishing.real_cars $(STREET) reports/published/reconstructions \
	    "make published-real-cars"

# the README's first table; ROAD= and KITTI= name folders of real pairs with annotated cars and detections.json
ROAD ?=
REAL := runs/real
published-real: setup
	$(BIN)/rescore apply $(ROAD) $(ROAD)/detections.json --out $(REAL)/kitti_road.json
	$(BIN)/rescore evaluate $(ROAD) $(REAL)/kitti_road.json --out $(REAL)/kitti_road --no-report
	$(BIN)/rescore apply $(KITTI) $(KITTI)/detections.json --out $(REAL)/kitti.json
	$(BIN)/rescore evaluate $(KITTI) $(REAL)/kitti.json --out $(REAL)/kitti --no-report
	$(BIN)/python -m reports.publishing.real_figures reports/published/streets/real.json \
	    "make published-real" $(REAL)/kitti_road $(REAL)/kitti
	$(PROSE)

# seven minutes on two quiet cores; GROUPS= names some of the rows
GROUPS ?=
bench: setup
	$(BIN)/python -m tests.bench $(GROUPS)

# a group that fails is named on the page, and the target fails after the page is written
published-bench: setup
	$(BIN)/python -m tests.bench $(GROUPS); measured=$$?; \
	$(BIN)/python -m reports.publishing.bench runs/bench/bench.json reports/published/bench \
	    "make published-bench" && exit $$measured

# a recorded trace replayed through a model of a cluster; RECORD=1 measures the trace again, from runs/paper
SCALE := reports/published/scale
RECORD ?=
published-scale: setup
	$(if $(RECORD),$(BIN)/python -m tests.bench.record_scaling runs/paper hog $(SCALE)/recorded.json)
	$(BIN)/python -m reports.publishing.scaling.page $(SCALE)/recorded.json $(SCALE) "make published-scale"

# the documentation, all warnings as errors; nothing in it asks the network
docs: $(VENV)/.docs-ready
	$(BIN)/properdocs build --strict --clean -f mkdocs.yml
	@! grep -rlE '(src=|<link[^>]* href=)"?https?:' build/docs --include='*.html' || \
	    { echo "docs: expected pages that ask nobody, the pages above load something from the network" >&2; exit 1; }
	@echo "documentation: build/docs/index.html"

$(VENV)/.docs-ready: $(VENV)/.ready
	$(BIN)/python -m pip install -q --disable-pip-version-check -e ".[docs]"
	@touch $@

clean:
	rm -rf runs build dist *.egg-info
