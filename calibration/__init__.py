"""Calibration: transforms between named frames, detection of the calibration target by radar and in
photographs, registration of both sensors, and the errors of the array's antennas."""
