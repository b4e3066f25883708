# make compare   set up if needed, measure with the quick profile, print the table, write the page
# make test      set up if needed, check the style, run the tests
# make setup     set up alone
# make lock      renew requirements.lock (needs uv)
#
# More arguments go through ARGS: make compare ARGS="ambient_aperture --profile full"

export PYTHON ?= python3

.PHONY: compare test setup lock

compare: setup
	@.venv/bin/lightproof compare $(ARGS)

test:
	@tools/setup.sh test
	@.venv/bin/ruff check .
	@.venv/bin/ruff format --check .
	@.venv/bin/python -m pytest $(ARGS)

setup:
	@tools/setup.sh

lock:
	echo 'setuptools>=77' | uv pip compile --universal --generate-hashes --python-version 3.10 --extra test \
		--no-header --no-annotate --no-emit-index-url --quiet --output-file requirements.lock pyproject.toml -
