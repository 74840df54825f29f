# Two commands are all a new user needs, on a machine with Python 3.11 or newer:
#   make demo    a virtual arm finds out what its model lacks: raw logs, fits, diagnosis, map, report, scenes
#   make test    everything the project checks about itself
PYTHON ?= python3
VENV   ?= .venv
DEMO   := $(VENV)/demo
TEST   := $(VENV)/test
OUT    ?= demo-out
WORKERS ?= 2

# where it is set, each of a thousand processes that tests begin would compile all modules that it imports
unexport PYTHONDONTWRITEBYTECODE

# each worker has one core: threads of linear algebra that wait busily for another made some tests 200 times as long
export OMP_NUM_THREADS ?= 1

# what others wrote, for the tests of live sessions to ask; its licences are on docs/licences.md, and kinid imports none of it
READER := $(VENV)/mcap-cli
CLIENT := tests/live/foxglove_client

.PHONY: demo test counterparts slow gallery notebooks story figure lint types bench docs lock clean

demo: $(DEMO)/.ready
	$(DEMO)/bin/kinid demo -o $(OUT)

test: $(TEST)/.ready lint types
	$(TEST)/bin/pytest -n $(WORKERS) --dist worksteal -m "not slow" $(PYTEST_ARGS)

# Foxglove's client library and readers of MCAP, which tests of live sessions skip by name without; needs npm
counterparts: $(READER)/.ready $(CLIENT)/node_modules/.package-lock.json

# the long studies
slow: $(TEST)/.ready
	$(TEST)/bin/pytest -n $(WORKERS) -m slow

lint: $(TEST)/.ready
	$(TEST)/bin/ruff format --check --quiet .
	$(TEST)/bin/ruff check .
	$(TEST)/bin/lint-imports

types: $(TEST)/.ready
	$(TEST)/bin/mypy

# what the tests of one file measure, long studies included: make figure OF=tests/lab/test_estimates.py
figure: $(TEST)/.ready
	$(TEST)/bin/pytest -s -p no:xdist -m "slow or not slow" $(OF)

# diagnoses of the measured logs as pages, in gallery/; they hold measured samples and stay out of the repository
gallery: $(TEST)/.ready
	KINID_GALLERY=$(CURDIR)/gallery $(TEST)/bin/pytest tests/diagnosis/test_measured.py -p no:xdist

# the notebooks run anew, with what they show kept in them as text and small pictures; Chromium draws those
notebooks: $(TEST)/.ready
	$(TEST)/bin/python notebooks/execute.py

# the picture at the top of README.md, from a demo run now; Chromium draws it
story: $(TEST)/.ready
	$(TEST)/bin/python docs/story.py docs/story.png

# ratios of speed, in one run, on one thread
bench: $(TEST)/.ready
	$(TEST)/bin/pytest tests/benchmarks --benchmark-enable --benchmark-only -s -p no:xdist

# concepts, commands and the reference from the docstrings, in build/site
docs: $(TEST)/.ready
	$(TEST)/bin/python -m sphinx -q -W -b html -d build/doctrees docs build/site

# Packages come from the lock file alone, each checked against its hash; kinid itself is built from this folder.
$(DEMO)/.ready: requirements/demo.lock pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "kinid needs Python 3.11 or newer, found " + sys.version.split()[0])'
	$(PYTHON) -m venv --clear $(DEMO)
	$(DEMO)/bin/python -m pip install --quiet --no-compile --require-hashes -r requirements/demo.lock
	$(DEMO)/bin/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	touch $@

$(TEST)/.ready: requirements/test.lock pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "kinid needs Python 3.11 or newer, found " + sys.version.split()[0])'
	$(PYTHON) -m venv --clear $(TEST)
	$(TEST)/bin/python -m pip install --quiet --no-compile --require-hashes -r requirements/test.lock
	$(TEST)/bin/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	touch $@

$(READER)/.ready: requirements/mcap-cli.lock $(TEST)/.ready
	rm -rf $(READER)
	$(TEST)/bin/python -m pip install --quiet --no-deps --require-hashes --target $(READER) -r requirements/mcap-cli.lock
	touch $@

$(CLIENT)/node_modules/.package-lock.json: $(CLIENT)/package-lock.json
	cd $(CLIENT) && npm ci --silent --ignore-scripts
	touch $@

# Needs uv. Hashes, and no address of where packages come from.
lock:
	uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-header --no-annotate \
		--extra bags pyproject.toml requirements/build.in -o requirements/demo.lock
	uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-header --no-annotate \
		--extra bags --extra batch --extra live --extra vision --extra docs --extra test pyproject.toml requirements/build.in -o requirements/test.lock
	uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-header --no-annotate \
		--no-deps requirements/mcap-cli.in -o requirements/mcap-cli.lock

clean:
	rm -rf $(VENV) build dist *.egg-info $(CLIENT)/node_modules
