"""The cut between kept and rejected echoes, chosen on rows that nothing was fitted to.

    confidence, labels, aim -> threshold: kept are the rows with confidence >= threshold

| aim | the cut |
|---|---|
| `balanced` | largest mean of recall and specificity |
| `precision 0.9` | keeps most of what is true among those of whose kept rows 90 % are true |
| `retention 0.95` | most precise among those that keep 95 % or more of what is true |

Cuts lie midway between neighbouring confidences, and at 0, which keeps all. A precision may be out
of reach: `choose_cut` says so, with the best there is.
"""

import re
from dataclasses import dataclass

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue, check

BALANCED = "balanced"
SHARED = ("precision", "retention")
"""Aims that name a share."""

ALLOWED = "must be balanced, precision <share> or retention <share>, as in precision 0.9"


@dataclass(frozen=True)
class Aim:
    """What a cut shall do.

    Attributes:
        kind: `balanced`, or one of `SHARED`.
        share: least precision or retention; 0 where balanced.
    """

    kind: str = BALANCED
    share: float = 0.0

    def __str__(self) -> str:
        return f"{self.kind} {self.share:g}" if self.share else self.kind


def read_aim(text: object) -> Aim:
    """Return the aim that a text names, as in `precision 0.9`.

    Raises:
        BadValue: it names none, or no share.
    """
    words = str(text).split()
    if words == [BALANCED]:
        return Aim()
    alone = len(words) == 1 and np.isfinite(_share(words[0]))
    hint = f"precision {words[0]}?" if alone else ""
    apart = re.sub(r"[=:,]", " ", str(text)).split()
    if len(apart) == 2 and apart[0] in SHARED:
        hint = f"did you mean {' '.join(apart)}?"
    check(len(words) == 2 and words[0] in SHARED, "aim", text, allowed=ALLOWED, hint=hint)
    share = _share(words[1])
    hint = f"{share:g} % is {share / 100:g}" if 10 <= share <= 100 else ""
    allowed = "must name a share from 0.01 to 1"
    check(0.01 <= share <= 1.0, "aim", text, allowed=allowed, hint=hint)
    return Aim(words[0], share)


def _share(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return np.nan


class OutOfReach(BadValue):
    """No cut has the precision that is aimed at."""


@dataclass(frozen=True)
class OperatingPoint:
    """A cut, and what it did to the rows that it was chosen on.

    Attributes:
        aim: what it was chosen for.
        threshold: confidence from which a row is kept.
        precision: share of the kept rows that are true; NaN if none is kept.
        retention: share of the true rows that are kept.
    """

    aim: str
    threshold: float
    precision: float
    retention: float


def point_of(point: OperatingPoint) -> dict[str, str | float | None]:
    """Return what a cut did to the rows that it was chosen on, as JSON has it: NaN is None."""
    shares = {key: getattr(point, key) for key in ("precision", "retention")}
    finite = {key: share if np.isfinite(share) else None for key, share in shares.items()}
    return {"aim": point.aim, **finite}


def choose_cut(confidence: Array, y: Array, *, aim: Aim) -> OperatingPoint:
    """Return the cut that an aim calls for.

    Args:
        confidence: 0 to 1, shape (B,).
        y: True for a reflector, shape (B,), both classes among them.
        aim: what the cut shall do.

    Raises:
        OutOfReach: no cut has this precision.
    """
    y = np.asarray(y).astype(bool)
    if aim.kind == BALANCED:
        cuts = np.array([best_threshold(confidence, y)])
    else:
        values = np.unique(confidence)
        cuts = np.append(0.0, (values[:-1] + values[1:]) / 2.0)
    kept_true = y.sum() - np.searchsorted(np.sort(confidence[y]), cuts)
    kept = len(y) - np.searchsorted(np.sort(confidence), cuts)
    precision = np.divide(kept_true, kept, out=np.full(len(cuts), np.nan), where=kept > 0)
    retention = kept_true / max(1, y.sum())
    place = _place(precision, retention, aim=aim)
    return OperatingPoint(str(aim), *(float(each[place]) for each in (cuts, precision, retention)))


def _place(precision: Array, retention: Array, *, aim: Aim) -> int:
    """Return which of the cuts, by rising threshold, an aim calls for.

    Args:
        precision, retention: of each cut, shape (C,).
        aim: what the cut shall do.
    """
    # Rounding must not push a whole count, such as 0.9 * 10, out.
    least = aim.share * (1 - 1e-12)
    if aim.kind == "precision":
        # The lowest such cut keeps most; of equals the highest is the most precise.
        fit = np.flatnonzero(precision >= least)
        if len(fit):
            return int(fit[retention[fit] == retention[fit[0]]][-1])
        best = int(np.nanargmax(precision))
        true = f"{100 * retention[best]:.3g} % of what is true"
        shown = f"best is {precision[best]:.3g}, keeping {true}"
        raise OutOfReach(f"aim={aim}: cannot be reached on validation rows; {shown}")
    if aim.kind == "retention":
        fit = np.flatnonzero(retention >= least)
        return int(fit[np.nanargmax(precision[fit])])
    return 0


def best_threshold(confidence: Array, y: Array) -> float:
    """Return the cut with the largest balanced accuracy when confidence >= cut is kept.

    Among equally good ones the one nearest to 0.5 is taken, so that a plateau does not leave the
    choice to chance.

    Args:
        confidence: 0 to 1, shape (B,).
        y: True for a reflector, shape (B,).
    """
    y = np.asarray(y).astype(bool)
    values = np.unique(confidence)
    if len(values) < 2:
        return 0.5
    cuts = (values[:-1] + values[1:]) / 2.0
    kept_true = y.sum() - np.searchsorted(np.sort(confidence[y]), cuts)
    dropped_false = np.searchsorted(np.sort(confidence[~y]), cuts)
    balanced = kept_true / max(1, y.sum()) + dropped_false / max(1, (~y).sum())

    # Cuts that divide the rows equally well differ by rounding only.
    best = cuts[np.isclose(balanced, balanced.max(), rtol=0.0, atol=1e-12)]
    return float(best[np.argmin(np.abs(best - 0.5))])
