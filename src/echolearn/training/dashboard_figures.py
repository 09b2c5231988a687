"""Figures of a run on TensorBoard: how reliable, how precise, and what is left of the map."""

from matplotlib.figure import Figure
from sklearn.metrics import precision_recall_curve

from echolearn.acoustics.bistatic import wall_points
from echolearn.acoustics.types import Array
from echolearn.dataset.labelled_set import Dataset
from echolearn.evaluation.metrics import reliability_curve

PLACED = ("toa", "azimuth", "elevation", "position", "heading", "room")
"""Fields that place an echo in its room; sets of walls have none of them."""

SHOWN = 4000
"""Echoes that are drawn, at most: more would hide each other."""


def reliability_diagram(reference: Array, confidence: Array) -> Figure:
    """Draw what share of the echoes of about one confidence are true.

    Args:
        reference: labels, shape (B,).
        confidence: confidences, shape (B,).
    """
    figure = _square()
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color="#bbbbbb", label="as it should be")
    axes.plot(*reliability_curve(reference, confidence), "o-", label="test part")
    axes.set(xlabel="mean confidence", ylabel="share that is true", xlim=(0, 1), ylim=(0, 1))
    axes.legend(frameon=False)
    return figure


def precision_recall(reference: Array, confidence: Array) -> Figure:
    """Draw how much of what is kept is true against how much of what is true is kept.

    Args:
        reference: labels, shape (B,).
        confidence: confidences, shape (B,).
    """
    precision, recall, _ = precision_recall_curve(reference, confidence)
    figure = _square()
    axes = figure.subplots()
    axes.axhline(reference.mean(), color="#bbbbbb", label="keep everything")
    axes.plot(recall, precision, label="test part")
    axes.set(xlabel="share of true that is kept", ylabel="share of kept that is true")
    axes.set(xlim=(0, 1), ylim=(0, 1.02))
    axes.legend(frameon=False)
    return figure


def filtered_map(dataset: Dataset, rows: Array, *, confidence: Array, cut: float) -> Figure | None:
    """Draw the echoes of validation positions on the map: what is kept, what is not.

    Args:
        dataset: set that the rows belong to.
        rows: their numbers, shape (B,).
        confidence: confidences, shape (B,).
        cut: least confidence that is kept.

    Returns:
        The figure; None for a set whose records have no place in a known room, or no known array.
    """
    array = dataset.array
    if array is None or not dataset.holds(PLACED):
        return None
    rows, confidence = rows[:SHOWN], confidence[:SHOWN]
    toa, azimuth, elevation, position, heading, room = (
        dataset.gather(name, rows) for name in PLACED
    )
    if not room[:, :2].all():
        return None
    points = wall_points(toa, azimuth, elevation, position=position, heading=heading, array=array)
    # Rooms of several sizes are laid on each other: each one's walls are at 0 and 1.
    alike = bool((room == room[0]).all())
    unit, size = ("m", room[0]) if alike else ("shares of each room", [1.0, 1.0])
    shown = points if alike else points / room[:, :2]

    kept = confidence >= cut
    figure = _square()
    axes = figure.subplots()
    x, y = size[0], size[1]
    axes.plot([0, x, x, 0, 0], [0, 0, y, y, 0], color="#bbbbbb", label="walls")
    axes.plot(*shown[~kept].T, ".", markersize=2, color="#999999", label="removed")
    axes.plot(*shown[kept].T, ".", markersize=5, color="#1f6fb4", label="kept")
    margin = 0.15
    axes.set(xlim=(-margin * x, (1 + margin) * x), ylim=(-margin * y, (1 + margin) * y))
    axes.set(xlabel=f"x, {unit}", ylabel=f"y, {unit}", aspect="equal")
    axes.set_title("echoes of validation positions", fontsize="medium")
    figure.legend(frameon=False, fontsize="small", loc="outside lower center", ncols=3)
    return figure


def _square() -> Figure:
    return Figure(figsize=(3.6, 3.6), dpi=100, layout="constrained")
