"""What accuracy costs in time: knobs swept, errors and times measured side by side in one run."""
