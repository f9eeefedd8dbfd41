"""The trade-off of `handbench tradeoff`: accuracy against time, of settings measured side by side
in one run."""
