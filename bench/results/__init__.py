"""The result folder: written by the runner, read by the reports.

result.json   protocol, metric definitions, input hashes, versions, machine, captures, methods, facts, failures
table.csv     metric, method, value, low, high, unit, paper, reference
tasks.csv     task, capture, method, stage, seconds, cpu_seconds, peak_memory_mb, cached, plan_seconds, host,
              gemm_gflops
repeats.csv   capture, method, repeat, z_m: the strongest scatterer of each repeat of a precision capture
config.toml   the resolved configuration
errors/       CAPTURE__METHOD__REFERENCE.npz: x_m, y_m, error_m, reference_z_m
depth/        CAPTURE__METHOD.npz (a depth map), CAPTURE__truth.npz, CAPTURE__photogrammetry.npz (x_m, y_m, z_m,
              sigma_m: standard deviation along z, by mesh and registration together; NaN: unknown)
photos/       CAPTURE.jpg, at most 600 pixels wide and high
"""

from bench.results.about import SCHEMA_VERSION, About, CaptureFacts, Failure, MethodFacts, MetricFacts, Name
from bench.results.error_map import ErrorMap
from bench.results.folder import (
    Result,
    load,
    write_about,
    write_comparisons,
    write_config,
    write_repeats,
    write_table,
    write_tasks,
)
from bench.results.maps import Surface, depth_path, errors_path, photo_path, write_errors, write_photo, write_surface
from bench.results.records import Repeat, Row, Task
from bench.results.tradeoff import Claim, Section, Setting, Tradeoff, TradeoffFacts, load_tradeoff, write_tradeoff

REFERENCES = ("photogrammetry", "truth")

__all__ = [
    "REFERENCES",
    "SCHEMA_VERSION",
    "About",
    "CaptureFacts",
    "Claim",
    "ErrorMap",
    "Failure",
    "MethodFacts",
    "MetricFacts",
    "Name",
    "Repeat",
    "Result",
    "Row",
    "Section",
    "Setting",
    "Surface",
    "Task",
    "Tradeoff",
    "TradeoffFacts",
    "depth_path",
    "errors_path",
    "load",
    "load_tradeoff",
    "photo_path",
    "write_about",
    "write_comparisons",
    "write_config",
    "write_errors",
    "write_photo",
    "write_repeats",
    "write_surface",
    "write_table",
    "write_tasks",
    "write_tradeoff",
]
