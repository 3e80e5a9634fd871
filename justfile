# Tasks for developers: `just` lists them. Each is one plain command, so they work without just too.

_list:
    @just --list --unsorted

# Make the environment: every plugin, every tool
setup:
    uv sync

# Run the tests, or some: `just test tests/core -k expression`
test *arguments:
    uv run pytest {{ arguments }}

# Look for mistakes without running anything
lint:
    uv run ruff check .
    uv run ruff format --check .

# Check the types
types:
    uv run mypy

# Put the code into its form and mend what can be mended
format:
    uv run ruff check --fix .
    uv run ruff format .

# How often right, wrong in silence, flagged: `just accuracy --group ordinary --seeds 400 --out ordinary.csv`
accuracy *arguments:
    uv run python -m benchmarks.accuracy {{ arguments }}

# Whether the failure probability keeps its word: `just calibration ordinary.csv`
calibration +files:
    uv run python -m benchmarks.calibration {{ files }}

# Methods and starts side by side: `just methods icp.csv aco.csv`
methods +files:
    uv run python -m benchmarks.methods {{ files }}

# Every method and start on every family, for docs/methods-compared.md: `just results --out results --seeds 20`
results *arguments:
    uv run python -m benchmarks.results {{ arguments }}

# Rows against the true ones, and pictures of them: `just rows --family noisy --pictures pictures`
rows *arguments:
    uv run python -m benchmarks.rows {{ arguments }}

# Orchards per second on one core, on several and on a Dask cluster: `just batch --orchards 100`
batch *arguments:
    uv run python -m benchmarks.batch {{ arguments }}

# Trees through a series of surveys against the truth: `just series --seeds 20`
series *arguments:
    uv run python -m benchmarks.series {{ arguments }}

# What a memory brings from survey to survey, and what a hostile one costs: `just learning --seeds 50`
learning *arguments:
    uv run python -m benchmarks.learning {{ arguments }}

# How well rasters tell heights of trees: `just elevation --seeds 5`
elevation *arguments:
    uv run python -m benchmarks.elevation {{ arguments }}

# What heights would do for the judge: `just heights --seeds 50`
heights *arguments:
    uv run python -m benchmarks.heights {{ arguments }}

# The page of a run in a browser: how large, how soon, how smooth
report *arguments:
    uv run python -m benchmarks.report {{ arguments }}

# Seconds and memory over sizes of orchards
speed *arguments:
    uv run python -m benchmarks.speed {{ arguments }}

# Moved rasters beside gdalwarp, and the memory of a huge one
rasters *arguments:
    uv run python -m benchmarks.rasters {{ arguments }}

# Seconds until the command line answers
startup *arguments:
    uv run python -m benchmarks.startup {{ arguments }}

# Pictures and tables of the Bayesian networks, for docs/networks.md
networks:
    uv run python -m benchmarks.networks

# The documentation as a site, in site/; warnings are errors
docs:
    uv run sphinx-build -W -n --keep-going docs site

# Tables of settings in docs/methods/, from the methods themselves
settings:
    uv run python -m benchmarks.method_settings

# Wheels of the core and of every plugin, in dist/
build:
    uv build --all-packages

# Whether an advisory is known of what is installed; asks the network
audit:
    uv pip freeze --exclude-editable > audit.txt
    uvx pip-audit --disable-pip --no-deps -r audit.txt

# Everything that must hold before a change is merged
ci:
    .ci/run
