"""Refusals: how a wrong value is answered."""

import re
from typing import Any

import pytest

from echolearn.checks import BadValue


def refused(message: str) -> Any:
    """Expect a `BadValue` whose text begins so and is one line."""
    return pytest.raises(BadValue, match=rf"^{re.escape(message)}.*\Z")
