"""The speed of sound as a stranger writes it, which is often in another unit.

Air has 306 m/s at -40 degrees Celsius, 386 m/s at 100; water 1400 to 1560 m/s. What lies between
and beyond are other units, each with its range for air of 0 to 40 degrees, 331 to 355 m/s.
"""

from echolearn.checks import check, is_number

AIR = (260.0, 400.0)
WATER = (1400.0, 1600.0)
"""m/s; a little more than nature has."""

ALLOWED = "must be m/s, from 260 to 400 in air or from 1400 to 1600 in water"

MISTAKES = (
    (0.26, 0.4, "is it in km/s? Air has 343 m/s"),
    (-40.0, 60.0, "is it the temperature? Air of T degrees Celsius has 331.3 + 0.606 T"),
    (640.0, 700.0, "is it in knots? Air has 343 m/s"),
    (735.0, 800.0, "is it in mph? Air has 343 m/s"),
    (1080.0, 1180.0, "is it in ft/s? Air has 343 m/s"),
    (1180.0, 1290.0, "is it in km/h? Air has 343 m/s"),
    (13_000.0, 14_200.0, "is it in inches/s? Air has 343 m/s"),
    (26_000.0, 40_000.0, "is it in cm/s? Air has 343 m/s"),
    (260_000.0, 400_000.0, "is it in mm/s? Air has 343 m/s"),
    (2.9e8, 3.1e8, "is it that of light? Air has 343 m/s"),
)
"""Ranges of other units, and what to ask."""


def check_sound_speed(name: str, value: object) -> None:
    """Raise `BadValue` unless a speed of sound in m/s is one of air or water."""
    number = float(value) if is_number(value) else float("nan")
    known = any(low <= number <= high for low, high in (AIR, WATER))
    hints = (hint for low, high, hint in MISTAKES if low <= number <= high)
    hint = next(hints, "was text given?" if isinstance(value, str) else "air has 343 m/s")
    check(known, name, f"{value} m/s", allowed=ALLOWED, hint=hint)
