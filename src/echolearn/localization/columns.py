"""What a classifier may use: named columns of an echo, and covariance tensors of its recording.

Columns marked (g) change with the gain of the recording; the others are dimensionless.

| column          | unit | meaning |
|---|---|---|
| toa             | s    | estimated time of arrival at microphone 1 |
| score           | 1    | normalised correlation of microphone 1 with the probe at toa |
| peak_to_rms     | 1    | r_1(toa) over the rms of r_1 in the search window |
| second_to_first | 1    | second highest peak of r_1, at least 5 lags away, over r_1(toa) |
| gain            | (g)  | amplitude of the echo (Eq. 11) |
| gain_delay      | m (g)| 4 pi c toa gain: a wall's reflection coefficient if gains are known |
| power           | dB(g)| whole-recording MPDR beam power, the paper's second feature (Eq. 16) |
| power_ratio     | dB   | that power over its mean over azimuth |
| coherence       | 1    | (sum_m a_m)^2 / (M sum_m a_m^2) of a_m = r_m(toa + eta_m(doa)) |
| joint           | 1    | J(toa, doa) over the rms of J in the window |
| joint_max       | 1    | maximum of J over the same rms |
| joint_ratio     | 1    | J(toa, doa) over the maximum of J |
| joint_score     | 1    | J(toa, doa) as a normalised correlation over all microphones |
| joint_lag       | samples | |toa - time of the maximum of J| |
| gated_ratio     | dB   | gated power at the doa over its mean over directions |
| azimuth, elevation | rad | direction the localizer chose |
| azimuth_mpdr    | rad  | direction of the whole-recording MPDR (the paper's) |

Where several echoes are sought, each also has

| rank            | 1    | number of stronger echoes of the recording |
| neighbour_lag   | samples | time to the nearest of the others |
| neighbour_gain  | 1    | gain of that one over its own |

Those of `AGREEMENT` (formulas in `agreement`) are only in sets whose plan asks for one of them
(`further`):

| level            | 1    | sine of the elevation: 1 in the array's plane, 0 on its axis |
| exceeded         | 1    | share of lags at which a microphone has more than at the echo |
| agreement        | 1    | mean correlation of pairs of microphones, aligned at the echo |
| coherence_wide   | 1    | `coherence` over the lags of a smeared echo |
| peak_offset      | samples | mean distance of the microphones' own peaks from the echo |
| peak_share       | 1    | what they have at the echo over these peaks |
| direction_second | 1    | power of the strongest other direction over that of the echo's |
| joint_second     | 1    | largest J at another time over J(toa, doa) |

and so is, for itself,

| cfar             | 1    | J(toa, doa) over the rms of J in a ring around it (`cfar`) |

Tensors are (COVARIANCE_BANDS, M*M) packed Hermitian matrices (`beamforming.pack_hermitian`),
each band scaled to trace M: `covariance` of the whole recording, `covariance_gated` of the
matched-filter outputs around the echo, `covariance_steered` the same after steering to the
estimated direction, so that an echo from there is all ones whatever its direction. Those of
`FURTHER_TENSORS` are only in sets whose plan asks for them (`further`):

| tensor                   | shape                   | meaning |
|---|---|---|
| covariance_steered_ideal | (bands, (M + 1)(M + 1)) | that with an ideal echo as microphone M + 1 |
| correlation_map          | (sectors + 1 + M, lags) | J about the echo over its competitor |

`candidates`, (`CANDIDATES`, K), holds an echo and those estimated beside it. It is made of columns,
so every set gives it, whenever it was made.

`strips`, (poses, `STRIP_ENTRIES`), is no tensor of an echo but of a wall hypothesis: what each pose
of a walk heard around it (`dataset.hypothesis_records`).
"""

COVARIANCE_BANDS = 16
"""Bands of frequencies in a covariance tensor."""

MAP_SECTORS = 36
"""Sectors of azimuth in a correlation map."""

MAP_LAGS = 64
"""Columns of a correlation map."""

CANDIDATES = 8
"""Echoes of a pose that one of them sees, itself among them."""

CANDIDATE_ENTRIES = 14
"""Numbers that tell of each of them."""

STRIPS = "strips"
STRIP_LAGS = 49
STRIP_DIRECTIONS = 7
STRIP_ENTRIES = 1 + STRIP_LAGS * STRIP_DIRECTIONS
"""Numbers of one pose in a strip: a digit of the walk's number, then J by lag and direction."""

UNITS = {
    "toa": "s",
    "score": "1",
    "peak_to_rms": "1",
    "second_to_first": "1",
    "gain": "1",
    "gain_delay": "m",
    "power": "dB",
    "power_ratio": "dB",
    "coherence": "1",
    "joint": "1",
    "joint_max": "1",
    "joint_ratio": "1",
    "joint_score": "1",
    "joint_lag": "samples",
    "gated_ratio": "dB",
    "azimuth": "rad",
    "elevation": "rad",
    "azimuth_mpdr": "rad",
    "rank": "1",
    "neighbour_lag": "samples",
    "neighbour_gain": "1",
    "level": "1",
    "exceeded": "1",
    "agreement": "1",
    "coherence_wide": "1",
    "peak_offset": "samples",
    "peak_share": "1",
    "direction_second": "1",
    "joint_second": "1",
    "cfar": "1",
}
"""Unit of each column."""

SEVERAL = ("rank", "neighbour_lag", "neighbour_gain")
"""Those that only one of several echoes has, or of several that were sought (`echoes=auto`)."""

AGREEMENT = (
    "level",
    "exceeded",
    "agreement",
    "coherence_wide",
    "peak_offset",
    "peak_share",
    "direction_second",
    "joint_second",
)
"""Columns that a plan may ask for besides; they are computed together."""

CFAR = "cfar"
"""Column that a plan may ask for besides, for the threshold of that name."""

COLUMNS = [name for name in UNITS if name not in (*SEVERAL, *AGREEMENT, CFAR)]
"""Columns that every set has."""

EVERY_COLUMN = (*COLUMNS, *AGREEMENT, CFAR)
TENSORS = ("covariance", "covariance_gated", "covariance_steered")
"""Tensors that every set has."""

FURTHER_TENSORS = ("covariance_steered_ideal", "correlation_map")
"""Tensors that a plan may ask for besides."""

EVERY_TENSOR = (*TENSORS, *FURTHER_TENSORS, "candidates")

TENSOR_VIEWS = dict.fromkeys(EVERY_TENSOR, "covariance") | {
    "correlation_map": "map",
    "candidates": "pose",
}
"""What kind of tensor each is, as a bundle says it."""

FURTHER = (*AGREEMENT, CFAR, *FURTHER_TENSORS)
"""What a plan may ask for besides what every set has."""


def tensor_shape(name: str, microphones: int) -> tuple[int, ...]:
    """Return the shape of one echo's tensor, heard by M microphones."""
    if name == "correlation_map":
        return (MAP_SECTORS + 1 + microphones, MAP_LAGS)
    if name == "candidates":
        return (CANDIDATES, CANDIDATE_ENTRIES)
    if name == STRIPS:
        # Networks take any number of poses.
        return (2, STRIP_ENTRIES)
    heard = microphones + name.endswith("_ideal")
    return (COVARIANCE_BANDS, heard**2)
