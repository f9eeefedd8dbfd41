"""What the paper reports, as golden values beside ours."""

# J. Bräunig, V. Wirth, M. Stamminger, I. Ullmann, M. Vossiek: the 3-FSK paper. Table I (poses B, F and U of the ASL
# alphabet against photogrammetry; three printed hands × 10 repeats) and the relative values of its text.
# The relative accuracy follows from the MAE: 100·(1 − 1.7 mm / 0.3 m) = 99.4 %. The relative precisions follow
# from no one distance: at 0.3 m, 3.6 mm would be 98.8 % and 0.3 mm 99.9 %. They are kept as printed.

TITLES = {"2fsk": "2-FSK", "3fsk": "3-FSK", "broadband": "broadband", "narrowband": "narrowband"}

PAPER: dict[tuple[str, str], float] = {
    ("mae_mm", "2fsk"): 6.6,
    ("mae_mm", "3fsk"): 1.7,
    ("mae_mm", "broadband"): 1.0,
    ("mae_mm", "narrowband"): 13.4,
    ("max_mm", "2fsk"): 39.2,
    ("max_mm", "3fsk"): 28.8,
    ("max_mm", "broadband"): 32.0,
    ("max_mm", "narrowband"): 64.9,
    ("precision_mm", "2fsk"): 3.6,
    ("precision_mm", "3fsk"): 0.3,
    ("relative_accuracy_percent", "3fsk"): 99.4,
    ("relative_precision_percent", "2fsk"): 98.3,
    ("relative_precision_percent", "3fsk"): 99.99,
}
