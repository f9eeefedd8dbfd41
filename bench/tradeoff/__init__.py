"""The trade-off of `handbench tradeoff`: accuracy and time of many settings, measured in one
run."""
