"""Intervals and choices that are typed after `tune` are what it searches."""

import shlex

import pytest

from echolearn.checks import BadValue
from echolearn.cli.main import composed, parse
from echolearn.cli.searches import fitted_to

TYPED = """
lr=interval(0.001,0.1) | {"lr": {"low": 0.001, "high": 0.1}}
lr=tag(log,interval(0.001,0.1)) | {"lr": {"low": 0.001, "high": 0.1, "log": True}}
batch_size=interval(32,64) | {"batch_size": {"low": 32, "high": 64}}
epochs=2,5 | {"epochs": {"choices": [2, 5]}}
epochs=range(1,4) lr=0.5 | {"epochs": {"choices": [1, 2, 3]}}
monitor=choice(loss,auc) | {"monitor": {"choices": ["loss", "auc"]}}
net.widths=choice([8,8],[16]) | {"net.widths": {"choices": [[8, 8], [16]]}}
"""


@pytest.mark.parametrize("row", TYPED.strip().splitlines())
def test_what_is_typed_is_searched_and_told_again(row):
    typed, expected = row.split(" | ")
    words = [f"classifier.{word}" for word in typed.split()]
    line = ["classifier=mlp_pair", *words, "trials=3"]
    [(_, job)] = composed("tune", [line], options=parse([])[0])
    space = fitted_to(job["space"], job["classifier"])
    assert repr(space) == repr(eval(expected))
    again = shlex.split(job["command"])[2:]
    assert sorted(again) == sorted(line)


def test_a_list_is_searched_by_its_one_number():
    space = {"c_grid": {"low": 0.1, "high": 10.0, "log": True}}
    assert fitted_to(space, {"c_grid": [1.0]}) == {"c_grid": {**space["c_grid"], "listed": True}}


@pytest.mark.parametrize("space", [None, 3, {"lr": 3}, {"lr": {"low": 1}}, {"lr": {"low": "a"}}])
def test_what_is_malformed_is_left_to_who_reads_it(space):
    assert fitted_to(space, {"lr": 0.1}) == space


def test_a_whole_number_has_whole_ends():
    with pytest.raises(BadValue, match=r"^classifier.epochs=\[1, 2.5\]: must be whole numbers"):
        fitted_to({"epochs": {"low": 1, "high": 2.5}}, {"epochs": 100})
