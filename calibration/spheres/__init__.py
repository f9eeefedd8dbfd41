"""The calibration target: its description, and the detection of its spheres and balls by radar and
in photographs."""
