"""R3VIVAL: responses of a room with panels that absorb or not, by an octahedron of microphones.

Amengual Gari and others, R3VIVAL, Repository of Room Responses and 360 Videos of a Variable
Acoustics Lab, github.com/facebookresearch/R3VIVAL, CC-BY-4.0. Its folder `RIRs/FRL_array` holds

    RLRVarAcLab_Absorptive_<condition>_S<azimuth>-<cm>_R1_FRL10cm.wav

of seven channels: front, back, right top, left top, right bottom, left bottom, centre. The azimuth
of the loudspeaker is in degrees, clockwise from the front; places beside the corners (`SBG...`)
have no position and are not read. The files are aligned: the direct sound reaches the centre at
10 ms whatever the distance, so it left the loudspeaker 10 ms - |l| / c into the file.

The array's positions are those of create_MicGeometry.m (FRL_10cm) of
github.com/facebookresearch/BinauralSDM. True echoes are those of the image sources of the
loudspeaker l in six walls at distances d_i from the array: a wall across axis k on the side `sign`
mirrors l_k to 2 sign d_i - l_k. The distances were measured from the responses themselves, means
over the 30 places, since the plan in the set (6.2, 3.5, 2.76 and 2.74 m) contradicts them in front
and behind; that of the front is uncertain. Panels stand before the walls, so there are two of most:
their faces, and what lies behind.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from echolearn.acoustics.types import Array, MicArray, Pose, Truth
from echolearn.checks import check, check_list
from echolearn.survey.measured import (
    Measurements,
    Response,
    checked_folder,
    read_response,
)

REPOSITORY = "facebookresearch/R3VIVAL"

INSIDE = "RIRs/FRL_array"

PLACES = tuple(
    f"S{azimuth:03d}-{centimetres}"
    for centimetres, azimuths in (
        (150, range(0, 360, 30)),
        (200, range(0, 360, 30)),
        (300, (0, 30, 150, 180, 210, 330)),
    )
    for azimuth in azimuths
)
"""Places of the loudspeaker: three circles, of which the largest does not fit the room's sides."""

DIRECT = 0.010
"""s into each file at which the direct sound reaches the centre."""

ALIGNED = 0.0005
"""s by which the loudest sample may be elsewhere; the array is 0.28 ms wide."""

SPEED_OF_SOUND = 343.0

POSITIONS = (
    (0.048, 0.0, 0.0),
    (-0.048, 0.0, 0.0),
    (0.0, -0.0339408, 0.0339408),
    (0.0, 0.0339408, 0.0339408),
    (0.0, -0.0339408, -0.0339408),
    (0.0, 0.0339408, -0.0339408),
)
"""m, of the six microphones around the centre, in the order of the channels; x ahead, y left."""

SIDES = ((0, 1), (0, -1), (1, 1), (1, -1), (2, -1), (2, 1))
"""Axis and sign of front, back, left, right, floor and ceiling."""

FACES = (5.08, 4.04, 2.56, 2.5, 1.36, 1.36)
"""m from the array to the faces of the panels."""

BEHIND = (5.26, 4.22, 2.74, 2.66, None, 1.42)
"""m from the array to what lies behind them; nothing behind the floor."""

CREDITS = {
    "title": "R3VIVAL, Repository of Room Responses and 360 Videos of a Variable Acoustics Lab",
    "licence": "CC-BY-4.0, https://creativecommons.org/licenses/by/4.0/",
    "attribution": "S. V. Amengual Gari and others, Meta; github.com/facebookresearch/R3VIVAL",
}


@dataclass(frozen=True)
class R3vival:
    """Responses of the six outer microphones from 30 places of the loudspeaker.

    Attributes:
        conditions: states of the panels as file names have them: shares of 100 that absorb.
        places: of the loudspeaker, as file names have them; None takes all.
    """

    conditions: Sequence[str] = ("000", "100")
    places: Sequence[str] | None = None

    def __post_init__(self) -> None:
        check_list("source.conditions", self.conditions)
        plain = all(re.fullmatch(r"\w+", str(each)) for each in self.conditions)
        allowed = "must be states of the panels, ['000','100']"
        some = len(set(map(str, self.conditions))) == len(self.conditions) > 0
        check(plain and some, "source.conditions", list(self.conditions), allowed=allowed)
        if self.places is not None:
            check_list("source.places", self.places)
            odd = [each for each in self.places if each not in PLACES]
            allowed = f"must be some of {', '.join(PLACES)}"
            check(len(self.places) > 0 and not odd, "source.places", odd, allowed=allowed)

    def read(self, folder: Path | None) -> Measurements:
        """Return the responses of a checkout, or of the slice that comes with echolearn.

        Raises:
            BadValue: a file that is missing, broken, or not aligned as those of the set.
        """
        asked = [str(each) for each in self.conditions]
        root = slice_folder() if folder is None else Path(folder)
        place = checked_folder(root, inside=INSIDE, repository=REPOSITORY)
        held = [each for each in asked if folder is not None or any(place.glob(f"*_{each}_S*"))]
        allowed = "must be among those of the slice that comes with echolearn, ['000']"
        hint = f"for others name a checkout of {REPOSITORY}, folder=..."
        check(len(held) > 0, "source.conditions", asked, allowed=allowed, hint=hint)

        responses = []
        rates = set()
        for condition in held:
            for name in PLACES if self.places is None else self.places:
                path = place / f"RLRVarAcLab_Absorptive_{condition}_{name}_R1_FRL10cm.wav"
                rate, samples = read_response(path)
                rates.add(rate)
                check_aligned(path, samples, rate=rate)
                responses.append(place_response(name, condition, samples=samples[: len(POSITIONS)]))
        check(len(rates) == 1, f"{place} sample_rate", sorted(rates), allowed="must be one for all")
        which = f"condition {' and '.join(held)}"
        said = f"the slice that comes with echolearn, {which}; folder=<checkout of {REPOSITORY}>"
        return Measurements(
            name="r3vival",
            responses=responses,
            array=MicArray(np.array(POSITIONS)),
            sample_rate=rates.pop(),
            speed_of_sound=SPEED_OF_SOUND,
            credits=CREDITS,
            remark=f"{said} has all" if folder is None else f"{folder}, {which}",
        )


def slice_folder() -> Path:
    """Return where the slice lies: in the installed package, or in the repository."""
    here = Path(__file__)
    installed = here.parents[2] / "examples" / "r3vival"
    return installed if installed.is_dir() else here.parents[4] / "examples" / "r3vival"


def check_aligned(path: Path, samples: Array, *, rate: float) -> None:
    """Raise `BadValue` unless a file has the channels of the set, and its direct sound at 10 ms.

    Args:
        path: the file.
        samples: shape (M, K).
        rate: in Hz.
    """
    channels = len(POSITIONS)
    allowed = f"must be {channels} channels, or {channels + 1} with the centre"
    count = len(samples)
    check(count in (channels, channels + 1), str(path), f"{count} channels", allowed=allowed)
    loudest = float(np.median(np.abs(samples[:channels]).argmax(axis=-1))) / rate
    allowed = f"must be at {1e3 * DIRECT:g} ms, as in all files of the set"
    shown = f"direct sound at {1e3 * loudest:.2f} ms"
    aligned = abs(loudest - DIRECT) <= ALIGNED
    check(aligned, str(path), shown, allowed=allowed, hint="was the file cut or shifted?")


def place_response(place: str, condition: str, *, samples: Array) -> Response:
    """Return the response from a place with its true echoes.

    Args:
        place: name of the loudspeaker's place.
        condition: state of the panels.
        samples: shape (6, K).
    """
    loudspeaker = position(place)
    return Response(
        place=place,
        condition=condition,
        samples=samples,
        emitted=DIRECT - float(np.linalg.norm(loudspeaker)) / SPEED_OF_SOUND,
        loudspeaker=loudspeaker,
        truth=panel_echoes(loudspeaker),
        pose=Pose(np.zeros(3)),
    )


def position(place: str) -> Array:
    """Return where the loudspeaker stands, shape (3,), in m, by the name of its place."""
    azimuth, centimetres = map(int, place[1:].split("-"))
    # Clockwise in the names, anticlockwise here.
    turned = np.deg2rad(-azimuth)
    return centimetres / 100 * np.array([np.cos(turned), np.sin(turned), 0.0])


def panel_echoes(loudspeaker: Array) -> Truth:
    """Return the echoes of the panels and of what lies behind them, by image sources."""
    images = []
    for distances in (FACES, BEHIND):
        for (axis, sign), distance in zip(SIDES, distances, strict=True):
            if distance is not None:
                image = loudspeaker.copy()
                image[axis] = 2 * sign * distance - image[axis]
                images.append(image)
    toward = np.array(images)
    return Truth(
        toa=np.linalg.norm(toward - np.array(POSITIONS[0]), axis=1) / SPEED_OF_SOUND,
        azimuth=np.arctan2(toward[:, 1], toward[:, 0]),
        elevation=np.arccos(toward[:, 2] / np.linalg.norm(toward, axis=1)),
    )
