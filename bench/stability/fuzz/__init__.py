"""Fuzzing of every reader: valid files, broken by a seeded hand, are read in a process of their own.

`python -m bench.stability.fuzz [--inputs 20000] [--seed 0] [-o DIR]`. An input may be accepted or refused by a
HandbenchError; anything else (another exception, a hang, a crash, too much memory, a file written elsewhere) is a
finding. DIR/found.jsonl holds what found something; what is worth keeping goes to `tests/bench/stability/corpus`.
"""
