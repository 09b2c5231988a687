"""What a survey's `conditions` say, as tables want it: the room's name, and the joint SNR."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from echolearn.acoustics.signals import joint_db
from echolearn.checks import is_number


def room_of(conditions: Mapping[str, Any], name: str) -> str:
    """Return what tables call the room of a survey, such as "8x6x5"; if unknown, the survey."""
    room = conditions.get("room", name)
    if isinstance(room, list) and all(is_number(side) for side in room):
        return "x".join(f"{side:g}" for side in room)
    return str(room)


def joint_snr_db(conditions: Mapping[str, Any]) -> float:
    """Return the received probe over all noises together, to 0.1 dB; NaN where it is unknown."""
    levels = [conditions.get("snr_db"), conditions.get("sdnr_db")]
    known = [float(level) for level in levels if level is not None]
    if not known:
        return np.nan
    # Adding 0.0 turns -0.0 into 0.0, which is written as "0".
    return round(float(joint_db(*known)), 1) + 0.0
