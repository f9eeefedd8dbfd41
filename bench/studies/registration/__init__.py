"""How well the calibration target carries photographs into the radar's frame, in placements whose truth is known."""
