"""The mean of several classifiers' logits (Hansen, Salamon, IEEE PAMI 12, 1990).

    d(x) = 1 / E sum_e (a_e d_e(x) + b_e)

Members err in different places: trees where a cut is coarse, networks where data are rare. Each is
fitted as it would be alone, and its decision d_e becomes a logit by Platt's a_e, b_e on the
validation rows, since a margin and a logit cannot be averaged. Each sees its own columns.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np
import torch

from echolearn.acoustics.types import Array
from echolearn.checks import check
from echolearn.classifiers.calibration import platt
from echolearn.classifiers.classifier import Classifier, Examples
from echolearn.classifiers.constants import register_constants
from echolearn.classifiers.inputs import Inputs, as_input, check_inputs, is_tensor, view_of


@dataclass
class Ensemble:
    """Several classifiers as one.

    Attributes:
        members: classifiers by name, all of columns, or all of one tensor.
        inputs: what any of them sees.
        logits: slope and intercept of each member's logit, shape (E, 2), after `fit`.
    """

    members: Mapping[str, Classifier]
    inputs: tuple[str, ...] = field(init=False)
    logits: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        allowed = "must be two classifiers or more, by name"
        several = isinstance(self.members, Mapping) and len(self.members) > 1
        check(several, "classifier.members", self.members, allowed=allowed)
        names = [name for each in self.members.values() for name in each.inputs]
        views = {view_of(each.inputs) for each in self.members.values()}
        allike = len(views) == 1 and (not is_tensor(names) or len({*names}) == 1)
        allowed = "must all see columns, or all the same tensor"
        check(allike, "classifier.members", ", ".join(self.members), allowed=allowed)
        self.inputs = check_inputs(tuple(dict.fromkeys(names)), views=tuple(views))

    def fit(self, examples: Examples) -> Self:
        """Fit every member, and the line that makes a logit of its decision."""
        unseen, labels = examples.validation
        logits = []
        for name, member in self.members.items():
            own = replace(
                examples,
                x=self._seen(examples.x, member),
                validation=(self._seen(unseen, member), labels),
                folder=examples.folder / name,
            )
            _fit(member, own)
            logits.append(platt(member.decision(own.validation[0]), labels))
        self.logits = np.array(logits)
        return self

    def _columns(self, member: Classifier) -> list[int]:
        """Return the places of a member's columns."""
        return [self.inputs.index(name) for name in member.inputs]

    def _seen(self, x: Inputs, member: Classifier) -> Inputs:
        """Return what a member sees of inputs (B, ...)."""
        if is_tensor(self.inputs):
            return x
        return as_input(x, self.inputs)[:, self._columns(member)]

    def decision(self, x: Inputs) -> Array:
        """Return the mean logit, shape (B,)."""
        each = [member.decision(self._seen(x, member)) for member in self.members.values()]
        mean: Array = np.mean(self.logits[:, :1] * each + self.logits[:, 1:], axis=0)
        return mean

    def scorer(self) -> torch.nn.Module:
        """Return all members as one torch module."""
        tensor = is_tensor(self.inputs)
        return Mean(
            Part(member.scorer(), columns=None if tensor else self._columns(member), line=line)
            for member, line in zip(self.members.values(), self.logits.tolist(), strict=True)
        )


def _fit(member: Classifier, examples: Examples) -> None:
    """Fit a member in a folder of its own, which goes if nothing is left there."""
    place = examples.folder
    place.mkdir(parents=True, exist_ok=True)
    member.fit(examples)
    if not any(place.iterdir()):
        place.rmdir()


class Part(torch.nn.Module):
    """The logit of one member."""

    slope: torch.Tensor
    intercept: torch.Tensor

    def __init__(
        self, scorer: torch.nn.Module, *, columns: list[int] | None, line: tuple[float, float]
    ) -> None:
        """Make one.

        Args:
            scorer: the member's.
            columns: places of what it sees; None: all.
            line: slope and intercept of its logit.
        """
        super().__init__()
        self.scorer = scorer
        self.columns = columns
        slope, intercept = line
        register_constants(self, slope=slope, intercept=intercept)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map (B, ...) to logits (B,)."""
        seen = x if self.columns is None else x[:, self.columns]
        logit: torch.Tensor = self.scorer(seen).double() * self.slope + self.intercept
        return logit


class Mean(torch.nn.Module):
    """The mean of several modules' values."""

    def __init__(self, parts: Iterable[torch.nn.Module]) -> None:
        super().__init__()
        self.parts = torch.nn.ModuleList(parts)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map (B, ...) to the mean (B,)."""
        return torch.stack([part(x) for part in self.parts]).mean(dim=0)
