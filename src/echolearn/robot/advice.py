"""Why a map is empty, or shows no wall: causes from what was measured, the most likely first.

A cause is told only if there is evidence of it. What the recordings themselves show (`Health`)
comes after what geometry rules out, and before what nobody can know.
"""

from collections.abc import Iterator

import numpy as np

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.sides import distance_to_outline
from echolearn.mapping.mapped_walk import MappedWalk
from echolearn.survey.health import Health

LAST = (
    "was the bundle trained for such rooms and noise, is speed_of_sound right, is the probe the "
    "one that was played?"
)
"""What is left to ask where nothing else is known."""

PLACES = (
    "do poses and recordings belong together: heading_rad counter-clockwise from x, positions in "
    "m, files and microphones in their order?"
)
"""What is asked first where many points are drawn and agree on no wall."""

SIDES = (
    "the array cannot tell one side of it from the other, and nothing tells which side echoes lie "
    "on: does the walk turn? A wall must be heard at several headings"
)
"""What is asked first where echoes are believed, but lie on either side of the array."""

MANY = 20
"""Points of which some lie on one wall, unless they are in wrong places."""

LOUDER = 0.7
"""Share of echoes from floor or ceiling that chance does not bring about."""

FEW_DB = 0.0
"""dB of SNR below which single recordings hardly tell echoes."""


def causes(mapped: MappedWalk, health: Health, *, window: SearchWindow) -> list[str]:
    """Return why no point of a map is drawn, or no wall goes through many; nothing if one does.

    Args:
        mapped: the walk and its echoes.
        health: what its recordings say about themselves.
        window: where the bundle seeks echoes.
    """
    if not mapped.placed:
        return []
    drawn = int(np.sum(mapped.shown))
    if not drawn:
        shown = [*_of_geometry(mapped, window), *health.noticed, *_of_recordings(health), LAST]
        sides = mapped.undecided is not None and bool(mapped.undecided.any())
        return [SIDES, *shown] if sides else shown
    if drawn >= MANY and not mapped.lines:
        return [*health.noticed, PLACES, *_of_recordings(health)]
    return []


def _of_geometry(mapped: MappedWalk, window: SearchWindow) -> Iterator[str]:
    """Yield what the places of walls, floor and ceiling explain."""
    reach = f"{window.nearest:g} to {window.farthest:g} m"
    kept = int(np.sum(mapped.map.kept))
    upright = int(np.sum(~mapped.sideways))
    if kept or upright > LOUDER * len(mapped.sideways):
        which = f"all {kept} kept echoes" if kept else f"{upright} of {len(mapped.sideways)} echoes"
        yield (
            f"{which} come from floor or ceiling, which are louder than walls here: is a wall "
            f"{reach} away?"
        )
    if mapped.outline is not None:
        # Near a corner the distance to the outline is that of one wall: the nearest.
        away = distance_to_outline(mapped.path[:, :2], mapped.outline)
        if away.min() > window.farthest:
            yield (
                f"no pose is within {window.farthest:g} m of a wall, where the bundle listens "
                f"({reach}); the nearest is {away.min():.1f} m away"
            )


def _of_recordings(health: Health) -> Iterator[str]:
    """Yield what the recordings show."""
    if np.isnan(health.negative_echoes) and np.isnan(health.latency_samples).all():
        yield (
            "no arrival of the burst stands out of the noise in any recording: was the loudspeaker "
            "on, and is probe.wav what was played?"
        )
    known = health.snr_db[np.isfinite(health.snr_db)]
    if len(known) and np.median(known) < FEW_DB:
        yield (
            f"the SNR may be as low as {np.median(known):.0f} dB: unless it is reverberation that "
            "lasts to the end of the recordings, average several pings at each pose"
        )
    if not health.direct:
        yield (
            "time zero is taken on trust, and one sample of latency moves every echo: leave the "
            "direct path in (direct_path: present), and it is measured"
        )
