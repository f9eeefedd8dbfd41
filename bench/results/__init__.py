"""The result folder: written by the runner, read by the reports.

result.json   protocol, metric definitions, input hashes, versions, machine, captures, methods, facts, failures
*.csv         table, tasks, repeats, comparisons, equal, curves, captures, causes, reliability: columns as
              in `bench.results.tables`
config.toml   the resolved configuration
errors/       CAPTURE__METHOD__REFERENCE.npz: x_m, y_m, error_m, reference_z_m
depth/        CAPTURE__METHOD.npz (a depth map), CAPTURE__truth.npz, CAPTURE__photogrammetry.npz (x_m, y_m, z_m,
              sigma_m: standard deviation along z, by mesh and registration together; NaN: unknown)
photos/       CAPTURE.jpg, at most 600 pixels wide and high
"""

from handbench.bench.results.about import (
    HEADLINE,
    HEADLINES,
    REFERENCES,
    About,
    CaptureFacts,
    Failure,
    MethodFacts,
    MetricFacts,
)
from handbench.bench.results.error_map import ErrorMap
from handbench.bench.results.maps import Surface, depth_path, errors_path, write_errors, write_photo, write_surface
from handbench.bench.results.result_folder import TABLES, Result, load, write_about, write_config, write_tables
from handbench.bench.results.tradeoff import (
    Claim,
    Section,
    Setting,
    Tradeoff,
    TradeoffFacts,
    load_tradeoff,
    write_tradeoff,
)

__all__ = ["HEADLINE", "HEADLINES", "REFERENCES", "About", "CaptureFacts", "Failure", "MethodFacts", "MetricFacts"]
__all__ += ["ErrorMap", "Surface", "depth_path", "errors_path", "write_errors", "write_photo", "write_surface"]
__all__ += ["TABLES", "Result", "load", "write_about", "write_config", "write_tables"]
__all__ += ["Claim", "Section", "Setting", "Tradeoff", "TradeoffFacts", "load_tradeoff", "write_tradeoff"]
