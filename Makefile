# `make demo` and `make test` each work as the only command on a fresh clone: Python 3.11+ and pip do.

PYTHON ?= python3
JOBS ?= 4
PYTEST_ARGS ?=
RIG_ARGS ?=
SHARE ?= $(HOME)/.local/share

VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check
INSTALL ?= $(PIP) install --quiet
PYTEST := $(BIN)/python -m pytest -n $(JOBS) --dist worksteal
# protoc 26: what it generates runs with protobuf 5, 6 and 7; later ones ask for their own version.
PROTOC := build/protoc
PROTOC_TOOLS := grpcio-tools==1.64.* "setuptools<81"
PROTOC_PYTHON ?= $(PYTHON)
PROTOS := $(sort $(shell find schemas/messages -name '*.proto' 2>/dev/null))

# What decodes, with few processes and ports; and the part of it that is done in a minute.
CORE := tests/plugins $(addprefix tests/test_, $(addsuffix .py, alarms amounts asking batches by_hand \
	capture_edges cli_jsonl cli_known cli_terminal cli_text conformance_kit crcs cut cutting damage_columns \
	declarations detect anomalies echo edges examples_protocols golden joint_answers laws limits lines \
	lss lss_models lss_values malformed matching mixed mixed_wires models models_laws pacing \
	packet_forms parts pipelined plugins rates registers remarks rs30x rs30x_acks rs30x_values \
	selection siblings sources_columns staged_ids state streaming times times_live toml vectors \
	wck wck_controller wck_gaps wck_values))
QUICK := $(addprefix tests/test_, $(addsuffix .py, architecture detect golden lss matching registers \
	rs30x staged_ids times vectors vectors_data wck))

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help demo test test-quick test-ray test-thorough coverage lint format bench bench-diagnosis bench-fleet bench-live bench-other bench-parts bench-signals soak rig fuzz schemas wireshark captures golden shell clean

help: ## list the targets
	@sed -n 's/^\([a-z-]*\):[^#]*## \(.*\)/  make \1|\2/p' $(MAKEFILE_LIST) | awk -F'|' '{ printf "%-18s %s\n", $$1, $$2 }'

demo: $(VENV)/.run ## decode, record and plot a simulated bus; no hardware needed
	$(BIN)/python -m sniffer.cli.demo

# Compiled once here, not by each of the workers and of the hundreds of processes that tests start.
test: $(VENV)/.dev ## run all tests, about a quarter of an hour on two cores (PYTEST_ARGS="-k mightyzap" for some)
	$(BIN)/python -m compileall -q sniffer
	$(PYTEST) $(PYTEST_ARGS)

test-quick: $(VENV)/.dev ## the decoding of all protocols against its vectors, in less than a minute
	$(PYTEST) $(QUICK) $(PYTEST_ARGS)

# What `make test` leaves out: cases that differ little from others, and most of long lists.
test-thorough: $(VENV)/.dev ## all tests with all of their cases, lists walked whole (much longer)
	$(BIN)/python -m compileall -q sniffer
	HYPOTHESIS_PROFILE=thorough $(PYTEST) $(PYTEST_ARGS)

test-ray: $(VENV)/.dev ## fleets on Ray, which is installed for it (0.3 GB)
	$(INSTALL) --editable '.[dev,ray]'
	$(BIN)/python -m pytest tests/test_fleet_ray.py $(PYTEST_ARGS)

coverage: $(VENV)/.dev ## the branches of the core that its tests take; fails below 95 %
	$(PYTEST) $(CORE) --cov --cov-report=term $(PYTEST_ARGS)

lint: $(VENV)/.dev ## formatting, lint and types, changing nothing
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

format: $(VENV)/.dev ## format, and mend what ruff can mend
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: $(VENV)/.dev ## measure the throughput
	$(BIN)/python -m bench

bench-diagnosis: $(VENV)/.dev ## faults that were built in, and what the diagnosis makes of them (4 min)
	$(BIN)/python -m bench.diagnosis

bench-fleet: $(VENV)/.dev ## what a data set of captures costs, a gigabyte of them (15 min; 2 GB of disk)
	$(BIN)/python -m bench.fleet

bench-live: $(VENV)/.dev ## measure recording live: its cost, how late stamps are (6 min)
	$(BIN)/python -m bench.live_results

bench-other: $(VENV)/.dev ## the diagnosis of conversations by another generator (5 min)
	$(BIN)/python -m bench.other

bench-parts: $(VENV)/.dev ## one capture decoded by two processes, beside one (3 min)
	$(BIN)/python -m bench.parts

bench-signals: $(VENV)/.dev ## levels to bytes, beside sigrok-cli (1 min)
	$(BIN)/python -m bench.signals

soak: $(VENV)/.dev ## kill 50 recorders, who waits for one, a minute beside its truth, an hour's memory (5 min)
	$(BIN)/python -m bench.soak

rig: $(VENV)/.dev ## real serial drivers in a virtual machine; Debian, sudo once (rig/README.md)
	$(BIN)/python -m rig $(RIG_ARGS)

fuzz: $(VENV)/.dev ## the laws, with thousands of examples each, and lists of edges walked whole
	HYPOTHESIS_PROFILE=long $(PYTEST) -m "hypothesis or walks_a_list or in_turn" $(PYTEST_ARGS)

# Files in schemas/messages import each other as "sniffer/messages/<name>.proto".
schemas: $(PROTOC)/.done ## regenerate sniffer/messages from schemas/messages (Python 3.11 or 3.12)
	$(PROTOC)/bin/python -m grpc_tools.protoc -Isniffer/messages=schemas/messages \
		--python_out=. --pyi_out=. $(PROTOS)

$(PROTOC)/.done: Makefile
	$(PROTOC_PYTHON) -m venv $(PROTOC)
	$(PROTOC)/bin/python -m pip --disable-pip-version-check install --quiet $(PROTOC_TOOLS)
	@touch $@

wireshark: $(VENV)/.run ## write the dissector of Wireshark to build/servo.lua, to read or copy it
	@mkdir -p build
	$(BIN)/python -m sniffer.wireshark.tables build/servo.lua

captures: $(VENV)/.dev ## regenerate sample_captures; read the diff before committing it
	$(BIN)/python -m sniffer.simulation.captures sample_captures

golden: $(VENV)/.dev ## regenerate the golden files; read the diff before committing it
	$(BIN)/python -m tests.golden
	$(BIN)/python -m tests.transcripts

shell: $(VENV)/.run ## the manual page and the completion of bash and fish, for this user
	mkdir -p $(SHARE)/man/man1 $(SHARE)/bash-completion/completions $(HOME)/.config/fish/completions
	$(BIN)/sniffer manual > $(SHARE)/man/man1/sniffer.1
	$(BIN)/sniffer completion bash > $(SHARE)/bash-completion/completions/sniffer
	$(BIN)/sniffer completion fish > $(HOME)/.config/fish/completions/sniffer.fish

clean: ## remove everything made here but the virtual environment
	rm -rf build dist demo-out .hypothesis .mypy_cache .pytest_cache .ruff_cache
	find . -name __pycache__ -type d -not -path './$(VENV)/*' -prune -exec rm -rf {} +

# The stamps are younger than pyproject.toml while the installation is up to date.
$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and \
		"Python 3.11 or newer is needed, $(PYTHON) is %d.%d: make PYTHON=python3.11 ..." % sys.version_info[:2])'
	$(PYTHON) -m venv $(VENV)

$(VENV)/.run: pyproject.toml | $(BIN)/python
	$(INSTALL) --editable .
	@touch $@

$(VENV)/.dev: pyproject.toml | $(BIN)/python
	$(INSTALL) --editable '.[dev]'
	@touch $(VENV)/.run $@
