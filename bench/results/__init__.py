"""The result folder of a benchmark: its files, and the functions that write and read them.

result.json   protocol, metric definitions, input hashes, versions, machine, captures, methods,
              facts, failures
*.csv         table, tasks, scores: columns as declared in `bench.evaluation.tables`
config.toml   the resolved configuration
errors/       CAPTURE__METHOD__REFERENCE.npz: x_m, y_m, error_m, reference_z_m
depth/        CAPTURE__METHOD.npz (a depth map), CAPTURE__truth.npz, CAPTURE__photogrammetry.npz
              (x_m, y_m, z_m, sigma_m: standard deviation along z, by mesh and registration
              together; NaN: unknown)
frames/       CAPTURE__METHOD.npz of sequences with velocities: x_m, y_m, times_s [frame], and z_m,
              velocity_m_s [frame, ny, nx], cut to the target
photos/       CAPTURE.jpg, at most 600 pixels wide and high

All other tables of a `Result` are computed from these files (`bench.results.derived`).
"""
