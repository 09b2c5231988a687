from echolearn.acoustics.polygon_room import PolygonRoom as PolygonRoom
from echolearn.acoustics.types import MicArray as MicArray
from echolearn.acoustics.types import Observation as Observation
from echolearn.acoustics.types import Pose as Pose
from echolearn.acoustics.types import Room as Room
from echolearn.cli.by_name import filter_named as filter
from echolearn.comparison.opening import bundle_named as open_bundle
from echolearn.comparison.opening import run_named as open_run
from echolearn.comparison.opening import set_named as open_set
from echolearn.comparison.opening import survey_named as open_survey
from echolearn.comparison.plotting import plot as plot
from echolearn.robot.by_name import localize_named as localize
from echolearn.simulation.by_hand import simulate as simulate

__all__ = [
    "MicArray",
    "Observation",
    "PolygonRoom",
    "Pose",
    "Room",
    "filter",
    "localize",
    "open_bundle",
    "open_run",
    "open_set",
    "open_survey",
    "plot",
    "simulate",
]

__version__: str
PUBLIC: dict[str, str]
