"""The repository's folders that are installed as packages in handbench."""

ROOMS = ("radar", "calibration", "groundtruth", "bench", "reports")
