"""Speeds of sound in other units are asked about by name."""

import pytest

from echolearn.checks import BadValue
from echolearn.survey.sound_speed import check_sound_speed


@pytest.mark.parametrize(
    ("value", "asked"),
    [
        (1235, "km/h?"),
        (1125.3, "ft/s?"),
        (767, "mph?"),
        (667, "knots?"),
        (34300.0, "cm/s?"),
        (343000, "mm/s?"),
        (13504, "inches/s?"),
        (0.343, "km/s?"),
        (20, "temperature?"),
        (299792458.0, "light?"),
        (700.5, "air has 343 m/s"),
        (float("nan"), "air has 343 m/s"),
        ("343 m/s", "was text given?"),
        (None, "air has 343 m/s"),
        (True, "air has 343 m/s"),
    ],
)
def test_another_unit_is_asked_about(value, asked):
    with pytest.raises(BadValue) as refused:
        check_sound_speed("speed_of_sound", value)
    text = str(refused.value)
    assert text.startswith(f"speed_of_sound={value} m/s: must be m/s, from 260") and asked in text


@pytest.mark.parametrize("value", [300, 343.0, 386.0, 1403, 1560.0])
def test_air_and_water_are_taken(value):
    check_sound_speed("speed_of_sound", value)
