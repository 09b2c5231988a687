"""How often the domain check calls simulated walks of the training kind another kind.

    python tests/domain_level.py SET WALKS ASIDE [columns]

SET is a training set, WALKS a set of its plan with `plan.poses=8` that becomes the reference, ASIDE
another of another seed, whose walks are judged one by one; all are folders. The columns are those
of conf/classifier/columns/invariant.yaml unless others are given.
"""

import sys
from collections import Counter
from pathlib import Path

import numpy as np
import yaml

from echolearn.dataset.labelled_set import Dataset
from echolearn.evaluation.stats import wilson
from echolearn.robot.domain import placed_among
from echolearn.training.walks import reference_of

ROOT = Path(__file__).parents[1]


def main(folder: str, walks: str, aside: str, *names: str) -> None:
    """Print how many walks are called another kind, and of which columns."""
    usual = ROOT / "conf" / "classifier" / "columns" / "invariant.yaml"
    columns = names or yaml.safe_load(usual.read_text())["inputs"]
    training, others = Dataset(Path(folder)), Dataset(Path(aside))
    reference = reference_of(columns, training, walks=Dataset(Path(walks)))
    poses = others.manifest["plan"]["poses"]
    rows = np.stack([others[name] for name in columns], axis=-1)
    judged = [placed_among(reference, each) for each in np.split(rows, len(rows) // poses)]
    alarms = [each for each in judged if each.alarm]
    share, low, high = (100 * part for part in wilson(len(alarms), len(judged)))
    print(
        f"{len(alarms)} alarms in {len(judged)} walks of {poses} poses: {share:.1f} % "
        f"[{low:.1f}, {high:.1f}], {len(columns)} columns, {len(reference.rows)} reference walks"
    )
    for name, count in Counter(each.columns[each.worst] for each in alarms).most_common():
        print(f"  {name} {count}")


if __name__ == "__main__":
    main(*sys.argv[1:])
