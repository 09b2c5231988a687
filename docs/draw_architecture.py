"""Draw the rooms of the house and who imports whom, from the imports: `docs/architecture.svg`.

    python docs/draw_architecture.py

A room is a folder of `src/echolearn` (or the module `checks`); its floor is the longest way of
imports down to a room that imports none. An arrow that follows from others is left out.

The drawing is that of Sugiyama, Tagawa and Toda (1981): an arrow over several floors gets a joint
on each of them; rooms and joints are ordered by the mean of their neighbours, so that few arrows
cross, and then moved toward it as far as there is room.
"""

import ast
import textwrap
from collections.abc import Iterable, Mapping
from functools import cache
from html import escape
from itertools import pairwise
from pathlib import Path

HERE = Path(__file__).parent
SOURCE = HERE.parent / "src" / "echolearn"

WIDTH, HEIGHT = 196, 64
"""Size of a room, in pixels."""

GAP, PITCH, MARGIN = 22, 112, 24
"""Space between rooms of a floor, from floor to floor, and around the drawing."""

JOINT = 14
"""Width that an arrow takes of a floor that it passes."""

PORT = 18
"""Space between arrows that begin, or end, at one room."""

Graph = Mapping[str, set[str]]
"""The rooms that each room imports."""


def modules() -> dict[str, Path]:
    """Return every module of the package by its dotted name without the package's own."""
    return {
        ".".join(path.relative_to(SOURCE).with_suffix("").parts): path
        for path in sorted(SOURCE.rglob("*.py"))
        if path.stem not in {"__init__", "__main__"}
    }


@cache
def imports(path: Path) -> set[str]:
    """Return the names that a file imports, at its top and inside its functions."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}.{alias.name}" for alias in node.names} | {str(node.module)}
    return found


def files() -> dict[str, set[str]]:
    """Return the modules of the package that each of its modules imports."""
    known = modules()
    return {
        name: {other.removeprefix("echolearn.") for other in imports(path)} & known.keys()
        for name, path in known.items()
    }


def room(name: str) -> str:
    """Return the room of a module, the first part of its name."""
    return name.partition(".")[0]


def rooms() -> dict[str, set[str]]:
    """Return the rooms that each room imports."""
    found: dict[str, set[str]] = {}
    for name, others in files().items():
        found.setdefault(room(name), set()).update({room(other) for other in others} - {room(name)})
    return found


def below(graph: Graph, start: str) -> set[str]:
    """Return all rooms that one stands on, directly or not."""
    return graph[start].union(*(below(graph, other) for other in graph[start]))


def floor(graph: Graph, name: str) -> int:
    """Return the floor of a room; the ground is 1."""
    return 1 + max((floor(graph, other) for other in graph[name]), default=0)


def arrows(graph: Graph) -> list[tuple[str, str]]:
    """Return the arrows that do not follow from others."""
    return [
        (name, other)
        for name, others in sorted(graph.items())
        for other in sorted(others)
        if not any(other in below(graph, between) for between in others)
    ]


def told(name: str) -> str:
    """Return the first sentence about a room, in its own words."""
    path = SOURCE / name / "__init__.py"
    text = (path if path.exists() else SOURCE / f"{name}.py").read_text()
    first = (ast.get_docstring(ast.parse(text)) or "").splitlines()[0]
    return first.partition(": `")[0].rstrip(".")


Place = tuple[int, str]
"""A floor, and a room or an arrow's joint on it."""


def paths(graph: Graph) -> list[list[Place]]:
    """Return each arrow as the places it passes, from its room down to the one imported."""
    return [
        [(floor(graph, a), a)]
        + [(level, f"{a} {b}") for level in range(floor(graph, a) - 1, floor(graph, b), -1)]
        + [(floor(graph, b), b)]
        for a, b in arrows(graph)
    ]


Near = Mapping[Place, list[Place]]
"""The places to which each place is joined by an arrow."""


def neighbours(lines: Iterable[list[Place]]) -> Near:
    """Return the places that follow each other on an arrow, both ways."""
    near: dict[Place, list[Place]] = {}
    for line in lines:
        for upper, lower in pairwise(line):
            near.setdefault(upper, []).append(lower)
            near.setdefault(lower, []).append(upper)
    return near


def ordered(near: Near) -> dict[int, list[Place]]:
    """Return the places of each floor from left to right, so that few arrows cross."""
    floors: dict[int, list[Place]] = {}
    for place in sorted(near):
        floors.setdefault(place[0], []).append(place)
    best, fewest = floors, crossings(floors, near)
    for sweep in range(24):
        for level in sorted(floors, reverse=bool(sweep % 2)):
            side = level + (1 if sweep % 2 else -1)
            rank = {place: i for i, place in enumerate(floors.get(side, []))}

            def middle(place: Place, rank: Mapping[Place, int] = rank) -> float:
                ranks = [rank[other] for other in near[place] if other in rank]
                return sum(ranks) / len(ranks) if ranks else len(rank) / 2

            floors = {**floors, level: sorted(floors[level], key=middle)}
        if crossings(floors, near) < fewest:
            best, fewest = floors, crossings(floors, near)
    return best


def crossings(floors: Mapping[int, list[Place]], near: Near) -> int:
    """Count the pairs of arrows that cross between neighbouring floors."""
    count = 0
    for level, places in floors.items():
        rank = {place: i for i, place in enumerate(floors.get(level - 1, []))}
        ends = [sorted(rank[o] for o in near[place] if o in rank) for place in places]
        steps = [(i, end) for i, each in enumerate(ends) for end in each]
        count += sum(a < c and b > d for a, b in steps for c, d in steps)
    return count


def is_joint(place: Place) -> bool:
    """Tell whether an arrow only passes here."""
    return " " in place[1]


def positions(floors: Mapping[int, list[Place]], near: Near) -> dict[Place, float]:
    """Return the middle of each place, in pixels, as near to its neighbours as there is space."""
    x = dict.fromkeys(near, 0.0)
    for _ in range(60):
        for level in [*sorted(floors), *sorted(floors, reverse=True)]:
            wanted = [sum(x[other] for other in near[p]) / len(near[p]) for p in floors[level]]
            x |= dict(zip(floors[level], spaced(floors[level], wanted), strict=True))
    left = min(x[place] - half(place) for place in x)
    return {place: middle - left for place, middle in x.items()}


def half(place: Place) -> float:
    """Return half the width of a place."""
    return (JOINT if is_joint(place) else WIDTH) / 2


def spaced(places: list[Place], wanted: list[float]) -> list[float]:
    """Return the positions nearest to those wanted (least squares) in this order and width."""
    offsets = [0.0]
    for before, after in pairwise(places):
        offsets.append(offsets[-1] + half(before) + GAP + half(after))
    # Without the widths' offsets the positions must only not fall: pool those that do.
    pools: list[list[float]] = []
    for want, offset in zip(wanted, offsets, strict=True):
        pools.append([want - offset])
        while len(pools) > 1 and mean(pools[-2]) > mean(pools[-1]):
            pools[-2:] = [pools[-2] + pools[-1]]
    level = [mean(pool) for pool in pools for _ in pool]
    return [each + offset for each, offset in zip(level, offsets, strict=True)]


def mean(values: list[float]) -> float:
    """Return the mean."""
    return sum(values) / len(values)


ROBOT = ("#e6f1e7", "#6f9a78")
LABORATORY = ("#e8edf6", "#7f95b8")
"""Colours of rooms, inside and around: those that run on a robot, and the others."""

LEGEND = [
    (MARGIN, ROBOT, "runs on a robot: no torch, scikit-learn, hydra"),
    (MARGIN + 285, LABORATORY, "the laboratory"),
]


def draw() -> str:
    """Return the drawing."""
    graph = rooms()
    lines = paths(graph)
    near = neighbours(lines)
    floors = ordered(near)
    x = {place: MARGIN + middle for place, middle in positions(floors, near).items()}
    top = max(floors)
    y = {place: MARGIN + HEIGHT / 2 + (top - place[0]) * PITCH for place in x}
    wide = max(x[place] + half(place) for place in x) + MARGIN
    high = MARGIN + (top - 1) * PITCH + HEIGHT + 52
    robot = {"robot"} | below(graph, "robot")
    begin = ports([(line[0], line[1]) for line in lines], x)
    end = ports([(line[-1], line[-2]) for line in lines], x)
    parts = []
    for line in lines:
        across = [begin[line[0], line[1]], *(x[p] for p in line[1:-1]), end[line[-1], line[-2]]]
        parts.append(curve(list(zip(across, [y[place] for place in line], strict=True))))
    for level, name in x:
        if not is_joint((level, name)):
            colours = ROBOT if name in robot else LABORATORY
            here = x[level, name], y[level, name]
            parts.append(box(name, x=here[0], y=here[1], colours=colours))
    parts += legend(high - 26)
    return HEAD.format(wide=round(wide), high=round(high)) + "\n".join(parts) + "\n</svg>\n"


End = tuple[Place, Place]
"""A room, and the place from which an arrow comes to it, or to which one leads."""


def ports(ends: list[End], x: Mapping[Place, float]) -> dict[End, float]:
    """Return where arrows touch a room, side by side in the order of where they go."""
    found: dict[End, float] = {}
    for place in {place for place, _ in ends}:
        others = sorted((other for here, other in ends if here == place), key=x.__getitem__)
        first = x[place] - PORT * (len(others) - 1) / 2
        found |= {(place, other): first + PORT * i for i, other in enumerate(others)}
    return found


HEAD = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {wide} {high}"
 width="{wide}" height="{high}" font-family="Helvetica, Arial, sans-serif" text-anchor="middle">
<title>The rooms of echolearn: an arrow leads from a room to one that it imports</title>
<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7"
 orient="auto"><path d="M0,1 L7,4 L0,7 z" fill="#8b8f98"/></marker></defs>
<rect width="100%" height="100%" fill="#ffffff"/>
"""


def curve(points: list[tuple[float, float]]) -> str:
    """Return an arrow from the bottom of a room through joints to the top of another."""
    (x, y), *joints = points
    path = f"M{x:.0f},{y + HEIGHT / 2:.0f}"
    start = y + HEIGHT / 2
    for number, (next_x, next_y) in enumerate(joints):
        last = number == len(joints) - 1
        end = next_y - HEIGHT / 2 - (2 if last else 0)
        middle = (start + end) / 2
        path += f" C{x:.0f},{middle:.0f} {next_x:.0f},{middle:.0f} {next_x:.0f},{end:.0f}"
        x, start = next_x, next_y + HEIGHT / 2
        path += "" if last else f" V{start:.0f}"
    form = 'fill="none" stroke="#8b8f98" stroke-width="1.1" marker-end="url(#tip)"'
    return f'<path d="{path}" {form}/>'


def box(name: str, *, x: float, y: float, colours: tuple[str, str]) -> str:
    """Return a room with its name and what it says of itself."""
    fill, stroke = colours
    said = textwrap.wrap(told(name), 34)
    first = y + 4 - 6.5 * len(said)
    lines = [
        f'<rect x="{x - WIDTH / 2:.0f}" y="{y - HEIGHT / 2:.0f}" width="{WIDTH}" '
        f'height="{HEIGHT}" rx="5" fill="{fill}" stroke="{stroke}"/>',
        label(name, x=x, y=first, form='font-size="14" font-weight="bold"'),
    ]
    lines += [label(line, x=x, y=first + 3 + 13 * row) for row, line in enumerate(said, 1)]
    return "\n".join(lines)


def label(text: str, *, x: float, y: float, form: str = 'font-size="11"') -> str:
    """Return a line of text."""
    return f'<text x="{x:.0f}" y="{y:.0f}" {form} fill="#2c313a">{escape(text)}</text>'


def legend(y: float) -> list[str]:
    """Return what the colours and the arrows mean."""
    parts = []
    form = 'font-size="11" text-anchor="start"'
    for x, (fill, stroke), text in LEGEND:
        place = f'x="{x}" y="{y - 10:.0f}" width="14" height="14" rx="3"'
        parts.append(f'<rect {place} fill="{fill}" stroke="{stroke}"/>')
        parts.append(label(text, x=x + 20, y=y + 2, form=form))
    said = "an arrow: imports; arrows that follow from others are left out"
    parts.append(label(said, x=460, y=y + 2, form=form))
    return parts


if __name__ == "__main__":
    (HERE / "architecture.svg").write_text(draw())
