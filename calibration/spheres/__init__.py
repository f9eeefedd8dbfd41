"""The calibration target: its description, and its detection by radar and by photographs."""
