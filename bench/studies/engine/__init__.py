"""The engine's benchmark: what imaging and simulation cost, measured in one run (`python -m bench.studies.engine -o
FILE`)."""
