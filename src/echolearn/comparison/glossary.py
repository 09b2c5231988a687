"""What the words of a report mean: shown on hover and focus, and listed at its end."""

GLOSSARY = {
    "AUC": (
        "Area under the ROC curve: how often a true echo is believed more than a spurious one. "
        "0.5 is chance, 1 is perfect; no threshold plays a part."
    ),
    "balanced accuracy": (
        "Mean of two shares at the filter's own threshold: true points kept, and spurious points "
        "removed. 50 % is chance."
    ),
    "SNR": "Power of the received probe over that of all noises together, in dB.",
    "yardstick": (
        "A classifier beside which any other must stand: the bare thresholds, the SVMs and the "
        "trees on the usual columns, trained on the same set."
    ),
    "paired difference": (
        "Both filters answer about the same echoes, and the same poses are resampled for both: "
        "what is hard for both cancels. It is narrower than what two separate intervals tell."
    ),
    "precision": "Share of the kept points that are true.",
    "true points kept": "Share of the true points that the filter keeps (recall).",
    "spurious removed": "Share of the spurious points that the filter removes (specificity).",
    "PR area": "Average precision: area under the curve of precision over recall.",
    "walls covered": "Share of the walls' length near which a kept point lies.",
    "calibration error": (
        "Mean difference between confidence and truth in ten bins of equal count; 0 is perfect."
    ),
    "p (Holm)": (
        "Probability of so large a difference if there were none, corrected for the number of "
        "tests of the same kind."
    ),
    "gated": "Localizer: time by S-NLS, direction from the echo's own stretch of the recording.",
    "snls": "Localizer: time by S-NLS, direction from the whole recording.",
    "joint": "Localizer: time and direction together, from all microphones.",
    "threshold_peak": "A bare threshold on how far an echo's correlation peak stands out.",
    "oracle": "Keeps what is true, and nothing else: the best that a filter could do.",
    "chance": "Keeps at random: the worst that a filter should do.",
}
"""Meaning of each word."""

MAP_WORDS = {
    "precision": "precision",
    "true_retention": "true points kept",
    "spurious_removal": "spurious removed",
    "balanced_accuracy": "balanced accuracy",
    "average_precision": "PR area",
    "wall_coverage": "walls covered",
    "expected_calibration_error": "calibration error",
    "auc": "AUC",
    "time_auc": "AUC",
}
"""Words that explain metrics, by the metrics' names."""
