# What can be done here; `make help` lists it. Everything runs in .venv, made from the versions and hashes in requirements/.
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:

PYTHON ?= $(firstword $(foreach p,python3 python3.14 python3.13 python3.12 python3.11,\
	$(shell $(p) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo $(p))))
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.made
DEVELOP := $(VENV)/.develop
PEERS := $(VENV)/.peers
DEMO := build/demo
WORKERS ?= 2

KINDS := scene usda obj
EXAMPLES := $(foreach kind,$(KINDS),$(wildcard examples/*.$(kind)))
NAMES := $(basename $(notdir $(EXAMPLES)))
INPUTS := $(filter-out %.png %.md,$(wildcard examples/*)) $(wildcard examples/assets/*)

CHARTS := $(patsubst %,examples/%.scene,hello refraction room shapes spotlights) bench/scenes/cornell.scene
CHART_BUDGET ?= 5min

.PHONY: help venv lock kernels wheel demo pictures library gallery site reference grammar editor charts test test-all check bench bounds clean accuracy

help:  ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 14

venv: $(DEVELOP)  ## make the environment .venv from pinned versions, for all targets

$(STAMP): pyproject.toml requirements/run.txt
	@test -n "$(PYTHON)" || { echo "maquette needs Python 3.11 or newer (make PYTHON=/path/to/python3)"; exit 1; }
	@echo "making $(VENV) with $(PYTHON)"
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --root-user-action=ignore --no-compile --require-hashes -r requirements/run.txt
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --root-user-action=ignore --no-deps -e .
	@touch $@

$(DEVELOP): $(STAMP) requirements/develop.txt
	@echo "installing what tests, checks and pages need"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --root-user-action=ignore --no-compile --require-hashes -r requirements/develop.txt
	@mkdir -p $(VENV)/typing && ln -sfn ../.. $(VENV)/typing/maquette
	@touch $@

lock: | $(DEVELOP)  ## write requirements/ from constraints.txt and pyproject.toml, with the hashes of all files on the package index
	@$(BIN)/python tools/lock.py

kernels: $(STAMP)  ## compile the general kernels, which render every scene
	@$(BIN)/python -P -m maquette.cli.build_kernels

demo: $(STAMP)  ## render every example, for at most 5 seconds each and the time of compiling kernels; hello.scene comes first
	@echo "rendering examples/hello.scene; its kernels are compiled first, in about half a minute"
	@$(MAKE) --no-print-directory LIMITS='--budget 5s' $(DEMO)/hello.png
	@echo "the first picture is $(CURDIR)/$(DEMO)/hello.png"
	@echo "rendering the other $(words $(filter-out hello,$(NAMES))) examples, two at a time; kernels that they share are compiled on the way, in some minutes"
	@MAQUETTE_KERNELS=general $(MAKE) --no-print-directory --output-sync -j$(WORKERS) LIMITS='--budget 5s' $(NAMES:%=$(DEMO)/%.png)
	@echo "$(words $(NAMES)) pictures are in $(CURDIR)/$(DEMO)"

pictures: $(NAMES:%=examples/%.png)  ## render the pictures beside the examples again, where they are older
	@echo "$(words $(NAMES)) pictures are in $(CURDIR)/examples"

define rule
$(1)/%.png: examples/%.$(2) $$(INPUTS) | $$(STAMP)
	@mkdir -p $(1)
	@MAQUETTE_PROGRESS=off $$(BIN)/maquette render $$< $$(LIMITS) -o $$@
endef
$(foreach folder,$(DEMO) examples,$(foreach kind,$(KINDS),$(eval $(call rule,$(folder),$(kind)))))

wheel: $(DEVELOP)  ## build a wheel with compiled kernels for three instruction sets into dist: about 20 minutes on two cores, fewer after small changes
	@$(BIN)/python tools/wheel.py

reference: $(DEVELOP)  ## write docs/reference.md and docs/reference/ from the schema again, and the pages of file formats from the readers' tables
	@mkdir -p build && $(BIN)/python -m maquette.lang.reference_page docs
	@for name in usd gltf meshes; do \
	  $(BIN)/python -m maquette.compiler.format_pages $$name > build/$$name.md && mv build/$$name.md docs/$$name.md || exit; \
	done
	@$(BIN)/python -m maquette.compiler.format_pages export < docs/export.md > build/export.md && mv build/export.md docs/export.md

gallery: $(DEVELOP)  ## render the pictures of docs/gallery.md again: half an hour on two cores (needs the extra denoise)
	@mkdir -p build
	@for scene in examples/gallery/*.scene; do \
	  MAQUETTE_PROGRESS=off $(BIN)/maquette render $$scene -o build/gallery.png --denoise && \
	  $(BIN)/python -c "import sys; from PIL import Image; Image.open('build/gallery.png').convert('RGB').save(sys.argv[1], quality=92, subsampling=0)" $${scene%.scene}.jpg || exit; \
	done
	@for name in living_room kitchen bedroom; do \
	  MAQUETTE_PROGRESS=off $(BIN)/maquette render examples/$$name.scene --set evening=true --size 480x320 --samples 12 --denoise -o build/gallery.png && \
	  $(BIN)/python -c "import sys; from PIL import Image; Image.open('build/gallery.png').convert('RGB').save(sys.argv[1], quality=92, subsampling=0)" examples/gallery/$${name}_evening.jpg || exit; \
	done

site: $(DEVELOP)  ## build the documentation as a site into build/site/html: python -m http.server -d build/site/html
	@$(BIN)/python tools/site.py build/site
	@echo "the site is in $(CURDIR)/build/site/html"

library: $(DEVELOP)  ## write docs/library.md from the comments in stdlib, and draw its pictures and those of the tutorial
	@mkdir -p build && $(BIN)/python -m maquette.lang.stdlib_page > build/library.md && mv build/library.md docs/library.md
	@MAQUETTE_KERNELS=general $(BIN)/python -P tools/library_pictures.py
	@$(BIN)/python -P tools/page_pictures.py

grammar: $(DEVELOP)  ## write the tables of the parser again, after a change of lang/syntax/grammar.lark
	@mkdir -p build && $(BIN)/python -m maquette.lang.syntax.grammar > build/tables.json && mv build/tables.json lang/syntax/tables.json

editor: | $(DEVELOP)  ## bundle the page's editor, CodeMirror, again from tools/editor into live/page, with npm
	@mkdir -p build/editor && cp tools/editor/* build/editor && cd build/editor && npm ci --no-audit --no-fund
	@cd build/editor && npx esbuild editor.js --bundle --minify --format=esm --target=es2021 --legal-comments=none --outfile=../../live/page/codemirror.js

charts: $(PEERS)  ## measure the charts of docs/charts.md again, peers too: half an hour on a quiet machine
	@mkdir -p docs/charts
	@for scene in $(CHARTS); do \
	  name=$$(basename $$scene .scene); \
	  $(BIN)/maquette chart $$scene -o docs/charts/$$name.svg --budget $(CHART_BUDGET) --peers mitsuba,povray > docs/charts/$$name.txt || exit; \
	done

accuracy: $(DEVELOP)  ## measure the known answers and the failing places again: docs/accuracy.md
	@rm -rf build/answers build/places && mkdir -p build
	@MAQUETTE_ACCURACY=build/answers MAQUETTE_PLACES=build/places $(BIN)/python -m pytest -q -n $(WORKERS) --long tests/accuracy tests/stability
	@$(BIN)/python tests/accuracy/answers.py build/answers build/places > build/accuracy.md && mv build/accuracy.md docs/accuracy.md

FIRST = $(if $(PACKAGE),$(if $(filter lang% compiler%,$(PACKAGE)),,kernels),check kernels)

# The kernels need none of the packages of tests and checks: they are compiled while those are installed.
test: $(STAMP)  ## the whole suite, after ruff and pyright beside `make kernels`; PACKAGE=render/accel: the tests of one package alone
ifdef PACKAGE
	@test -d tests/$(PACKAGE) || { echo "no tests are in tests/$(PACKAGE); packages: $$(cd tests && find . -name 'test_*.py' -printf '%h\n' | sed 's:^\./::' | sort -u | xargs)"; exit 1; }
endif
	@$(MAKE) --no-print-directory -j2 venv $(FIRST)
	@$(BIN)/python -m pytest -q -n $(WORKERS) --dist worksteal $(if $(PACKAGE),tests/$(PACKAGE))

test-all: check kernels  ## also what takes long: statistics, soak, packaging; then parts of it under other conditions
	@$(BIN)/python -m pytest -q -n $(WORKERS) --dist worksteal --long
	@$(BIN)/python tools/matrix.py --all

bounds: $(DEVELOP)  ## a million boxes for each operation of formulas: bounds must hold (half an hour)
	@MAQUETTE_BOXES=1000000 $(BIN)/python -m pytest -q -n $(WORKERS) --long tests/render/formula/test_single_precision.py

bench: $(PEERS)  ## measure against Embree, Mitsuba, llvmpipe and POV-Ray: bench/RESULTS.md (bench-rays and the like: one of them)
	@$(BIN)/python -m maquette.bench

bench-%: $(PEERS)
	@$(BIN)/python -m maquette.bench $*

$(PEERS): $(DEVELOP)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements/bench.txt || echo "not all peers could be installed: those are left out"
	@echo "peers that pip cannot install, in Debian: libllvm19 (Mitsuba), libegl1 libgl1-mesa-dri (llvmpipe), povray; what is missing is left out"
	@touch $@

check: $(DEVELOP)  ## ruff, pyright, and known vulnerabilities of the dependencies
	@$(BIN)/ruff check .
	@$(BIN)/pyright
	@$(BIN)/python tools/audit.py || test $$? = 3  # 3: no list of vulnerabilities could be asked, which the last line says

clean:  ## remove what was made, the environment too
	@rm -rf $(VENV) build .pytest_cache .ruff_cache .hypothesis *.egg-info
