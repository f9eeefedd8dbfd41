"""Everything that `handbench run` does: read the benchmark file, plan and execute the stages, write
the result folder."""
