"""The main job: benchmark file, jobs, stages, executors, runner."""
