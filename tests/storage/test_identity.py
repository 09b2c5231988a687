"""Identities: one text, one digest, and names that do not move with the code."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from echolearn.checks import BadValue
from echolearn.localization.methods.gated import Gated
from echolearn.storage.identity import by_short_names, canonical, digest, kind_of, plain

FINITE = st.floats(allow_nan=False, allow_infinity=False)
PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | FINITE | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


def test_a_digest_is_the_sha256_of_the_canonical_text():
    """The golden value was computed with `printf '{"a":1,"b":[0.1,null]}' | sha256sum`."""
    assert canonical({"b": [0.1, None], "a": 1}) == b'{"a":1,"b":[0.1,null]}'
    assert digest({"b": [0.1, None], "a": 1}) == "e4a9ad4b9681"


@given(PLAIN)
def test_a_digest_survives_json_and_the_order_of_keys(value):
    assert digest(json.loads(json.dumps(value))) == digest(value)
    if isinstance(value, dict):
        assert digest(dict(reversed(value.items()))) == digest(value)


@given(FINITE, FINITE)
def test_different_floats_have_different_digests(a, b):
    assert (digest(a) == digest(b)) == (repr(a) == repr(b))


ENDLESS = []
ENDLESS.append(ENDLESS)


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        (float("nan"), "value=nan"),
        ({"a": {"x": [0.0, float("inf")]}, "b": object()}, "a.x.1=inf"),
        (object(), "value=<object object"),
        ({"a": 1, "b": np.zeros(2)}, "b=array"),
        ({"seed": 10**5000}, "seed=a number of thousands of digits"),
        ({1: 2, "a": 3}, "keys=of several kinds"),
        (ENDLESS, "0.0.0.0.0"),
    ],
)
def test_what_json_cannot_hold_has_no_digest_and_is_named(bad, said):
    with pytest.raises(BadValue) as refused:
        digest(bad)
    assert str(refused.value).startswith(said) and len(str(refused.value)) < 200
    assert str(refused.value).endswith("must be a finite number, a text, a list or a mapping")


def test_names_are_short_and_arrays_are_known_by_their_bytes():
    """The golden value was computed with `head -c 8 /dev/zero | sha256sum`."""
    room = {"_target_": "echolearn.acoustics.types.Room", "size": [{"_target_": "torch.nn.ReLU"}]}
    assert by_short_names(room) == {"kind": "room", "size": [{"kind": "torch.nn.ReLU"}]}
    assert kind_of(np.float64(1.0)) == "numpy.float64"
    zero = {
        "shape": [1],
        "sha256": "af5570f5a1810b7af78caf4bc70a660f0df51e42baf91d4de5b2328de0e83dfc",
    }
    assert plain({"a": (np.float64(1.5), np.zeros(1))}) == {"a": [1.5, zero]}


def test_a_field_that_came_later_counts_from_where_it_is_set():
    """Sets made before there was one keep their names."""
    assert "sign" not in plain(Gated())
    assert plain(Gated(sign="either"))["sign"] == "either"
