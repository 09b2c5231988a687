"""What is chosen, is chosen on the validation part; the test part is looked at once."""

import pytest

from echolearn.classifiers.calibration import best_threshold
from echolearn.training.predictions import predict
from echolearn.training.runs import load_runs
from echolearn.training.split import LearningProblem


def test_the_threshold_is_the_best_cut_of_the_validation_rows(world):
    for run in load_runs(world.runs):
        dataset = world.sets[run.model.trained_on]
        rows = LearningProblem(dataset, seed=run.seed).parts().validation
        confidence = predict(run, {name: dataset[name][rows] for name in run.inputs})
        cut = best_threshold(confidence, dataset["reflector"][rows])
        assert run.threshold == pytest.approx(cut, abs=1e-4), run.folder.name
