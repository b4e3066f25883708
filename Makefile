# make compare   set up if needed, measure with the quick profile, print the table, write the page
# make test      set up if needed, check the style, run the tests
# make mutants   flip every sign of every technique and keep the proof that thresholds see it (slow)
# make setup     set up alone
# make lock      renew requirements.lock (needs uv)
#
# More arguments go through ARGS: make compare ARGS="ambient_aperture --profile full"

export PYTHON ?= python3

.PHONY: compare test mutants setup lock

compare: setup
	@.venv/bin/lightproof compare $(ARGS)

test:
	@tools/setup.sh test
	@.venv/bin/ruff check .
	@.venv/bin/ruff format --check .
	@.venv/bin/python -m pytest $(ARGS)

mutants:
	@tools/setup.sh test
	@LIGHTPROOF_PROVE=1 .venv/bin/python -m pytest tests/test_mutants.py $(ARGS)

setup:
	@tools/setup.sh

lock:
	echo 'setuptools>=77' | uv pip compile --universal --generate-hashes --python-version 3.10 --extra test \
		--no-header --no-annotate --no-emit-index-url --quiet --output-file requirements.lock pyproject.toml -
