"""dEchorate: responses of a cuboid room with annotated times of its six first-order echoes.

Di Carlo, Tandeitnik, Foy, Bertin, Deleforge, Gannot, EURASIP Journal on Audio, Speech, and Music
Processing 2021; github.com/Chutlhu/dEchorate, MIT. What is read is a file of MATLAB 5,
`recipes/room_geometry_estimation/data_rooge.mat`:

    rirs (K, 12, 1)   fs (1, 1)   c (1, 1)   mics (3, 12)   src (3, 1)   T_direct (1, 12)
    T_reflct (6, 12)  of west, east, south, north, floor, ceiling, in s from the emission

Microphones i and i + 6 are a pair, 4 cm apart, in the plane of the floor: an array of two, which
stands at six places. The directions of echoes are not annotated, so times alone can be judged.
"""

import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.types import Array, MicArray, Pose, Truth
from echolearn.checks import BadValue, check
from echolearn.storage.files import one_line
from echolearn.survey.audio import LARGEST, check_size
from echolearn.survey.measured import Measurements, Response, checked_folder

REPOSITORY = "Chutlhu/dEchorate"

INSIDE = "recipes/room_geometry_estimation/data_rooge.mat"

PAIRS = 6

APART = 0.04
"""m between the microphones of a pair."""

SHAPES = {
    "rirs": (-1, 2 * PAIRS, 1),
    "fs": (1, 1),
    "c": (1, 1),
    "mics": (3, 2 * PAIRS),
    "src": (3, 1),
    "T_direct": (1, 2 * PAIRS),
    "T_reflct": (6, 2 * PAIRS),
}
"""Arrays of the file; -1 is any number."""

AGREES = 0.001
"""s by which the annotated direct sound may miss the way from loudspeaker to microphone."""

WITHIN = (2.0, 4.0)
"""m of path in which a recording needs an echo: walls at 1 to 2 m."""

CREDITS = {
    "title": "dEchorate, a calibrated room impulse response dataset, room 011111, loudspeaker 1",
    "licence": "MIT, https://opensource.org/license/mit",
    "attribution": "D. Di Carlo, P. Tandeitnik, S. Gannot and others; github.com/Chutlhu/dEchorate",
}


@dataclass(frozen=True)
class Dechorate:
    """Responses of six pairs of microphones from one loudspeaker."""

    def read(self, folder: Path | None) -> Measurements:
        """Return the responses of a checkout.

        Raises:
            BadValue: no checkout, or a file that is missing or broken.
        """
        hint = f"name a checkout of {REPOSITORY}: folder=..."
        allowed = "nothing of this source comes with echolearn"
        check(folder is not None, "folder", None, allowed=allowed, hint=hint)
        path = checked_folder(Path(str(folder)), inside=INSIDE, repository=REPOSITORY)
        found = read_matlab(path)
        pairs = [pair_response(pair, found) for pair in range(PAIRS)]
        half = APART / 2
        return Measurements(
            name="dechorate",
            responses=pairs,
            array=MicArray(np.array([[half, 0.0, 0.0], [-half, 0.0, 0.0]])),
            sample_rate=float(found["fs"][0, 0]),
            speed_of_sound=float(found["c"][0, 0]),
            credits=CREDITS,
            within=WITHIN,
            remark=f"{folder}, {len(pairs)} pairs of microphones; times alone",
        )


def read_matlab(path: Path) -> dict[str, Array]:
    """Return the arrays of the file by name.

    Raises:
        BadValue: it cannot be read, lacks an array, or its times contradict its positions.
    """
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    check_size(path, LARGEST)
    try:
        content: dict[str, Any] = loadmat(path, variable_names=list(SHAPES))
    # A damaged file can break its reader anywhere.
    except (OSError, ValueError, TypeError, KeyError, IndexError, MatReadError) as error:
        raise BadValue(f"{path}: cannot be read ({one_line(error)}); a cut copy?") from None
    except (zlib.error, MemoryError, OverflowError, AttributeError) as error:
        raise BadValue(f"{path}: cannot be read ({one_line(error)}); a cut copy?") from None

    for name, shape in SHAPES.items():
        value = np.asarray(content.get(name, np.array(None)))
        fits = value.dtype.kind in "iuf" and value.ndim == len(shape)
        pairs = zip(shape, value.shape, strict=False)
        fits = fits and all(wanted in (-1, size) for wanted, size in pairs)
        allowed = f"must be numbers of shape {shape}"
        check(fits, f"{path} {name}", f"shape {value.shape}", allowed=allowed, hint="another file?")
        content[name] = value.astype(float)
        finite = bool(np.isfinite(content[name]).all())
        check(finite, f"{path} {name}", "NaN or infinity", allowed="must be finite")
    _check_times(path, content)
    return content


def _check_times(path: Path, found: dict[str, Array]) -> None:
    """Raise `BadValue` unless the direct sound comes when the positions say so."""
    way = np.linalg.norm(found["mics"] - found["src"], axis=0) / found["c"][0, 0]
    off = float(np.abs(way - found["T_direct"][0]).max())
    allowed = f"must fit the positions within {1e3 * AGREES:g} ms"
    check(off <= AGREES, f"{path} T_direct", f"{1e3 * off:.2f} ms off", allowed=allowed)


def pair_response(pair: int, found: dict[str, Array]) -> Response:
    """Return the response at one pair, in the frame of its array.

    Args:
        pair: number from 0.
        found: arrays of the file by name.
    """
    first, second = found["mics"][:, [pair, pair + PAIRS]].T
    middle = (first + second) / 2
    heading = float(np.arctan2(*(first - second)[1::-1]))
    cos, sin = np.cos(heading), np.sin(heading)
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    times = found["T_reflct"][:, pair]
    unknown = np.full(len(times), np.nan)
    return Response(
        place=f"pair {pair + 1}",
        condition="011111",
        samples=found["rirs"][:, [pair, pair + PAIRS], 0].T,
        emitted=0.0,
        loudspeaker=turn @ (found["src"][:, 0] - middle),
        truth=Truth(toa=times, azimuth=unknown, elevation=unknown),
        pose=Pose(middle, heading),
    )
