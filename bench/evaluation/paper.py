"""The paper's figures, as golden values beside ours (of metrics.toml), and its names of methods."""

from bench.evaluation.metrics import METRICS

TITLES = {"2fsk": "2-FSK", "3fsk": "3-FSK", "broadband": "broadband", "narrowband": "narrowband"}

PAPER: dict[tuple[str, str], float] = {
    (metric.key, method): value for metric in METRICS.values() for method, value in metric.paper.items()
}
