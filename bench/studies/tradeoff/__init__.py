"""The price of accuracy in time: knobs swept, errors and times measured side by side in one run."""
