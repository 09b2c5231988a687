"""What may stand in the fields of a `LearningProblem`, and so in the metrics of a run."""

from functools import partial

from echolearn.checks import check_number, check_whole
from echolearn.storage.tables import nullable

SHARE = partial(check_number, low=0.01, high=0.9)
FIELDS = {
    "dataset": ...,
    "target": ("reflector", "on_map", "time_and_direction", "is_wall"),
    "seed": partial(check_whole, low=0, high=2**31 - 1),
    "split": ("position", "row"),
    "test_share": SHARE,
    "validation_share": SHARE,
    "train_rows": nullable(partial(check_whole, low=10, high=10**9)),
}
"""Values, or a check of each, by the field's name."""
