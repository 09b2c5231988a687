"""Any torch network as a classifier, trained under Lightning.

The loss is the cross-entropy of the logit, the optimiser AdamW. After each epoch the validation
loss is taken; training stops when it has not fallen for `patience` epochs, and the best epoch's
weights are put back. The run folder receives `best.ckpt`, `metrics.csv` and TensorBoard events.

Batches come from memory or, of large sets, from the shards (`batches`). One thread; two runs side
by side use two cores.

What Lightning calls a step is here a whole epoch, and the loop over batches stands in
`Training.training_step`: with batches of less than a millisecond its hooks around every step would
take most of the time.
"""

import logging
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import torch
from lightning.fabric.plugins import TorchCheckpointIO
from lightning.pytorch import LightningModule, Trainer
from lightning.pytorch.callbacks import Callback, EarlyStopping, ModelCheckpoint
from lightning.pytorch.core.optimizer import LightningOptimizer
from lightning.pytorch.loggers import CSVLogger, Logger, TensorBoardLogger
from torch import nn

from echolearn.acoustics.types import Array
from echolearn.checks import check, check_number, check_whole
from echolearn.classifiers.batches import BLOCK, Batches, Once, source, tensor
from echolearn.classifiers.inputs import (
    COVARIANCE,
    FEATURES,
    Inputs,
    blocks,
    check_inputs,
    check_labels,
    rows_of,
    view_of,
)
from echolearn.classifiers.standardise import Standardise
from echolearn.storage.files import write_atomic


@dataclass
class Network:
    """A network on standardised columns or on one standardised tensor.

    Attributes:
        inputs: column names, or one tensor's name.
        net: recipe that makes the network from the shape of one row (see `nets`).
        lr: learning rate.
        epochs: at most this many passes.
        patience: epochs without a better validation loss before stopping.
        batch_size: rows per step.
        weight_decay: of AdamW.
        noise: deviation of Gaussian noise added to standardised training inputs.
    """

    inputs: tuple[str, ...]
    net: Callable[[tuple[int, ...]], nn.Module]
    lr: float = 2e-3
    epochs: int = 100
    patience: int = 15
    batch_size: int = 128
    weight_decay: float = 0.01
    noise: float = 0.0
    fitted: nn.Module = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.inputs = check_inputs(self.inputs, views=(FEATURES, COVARIANCE))
        check_number("classifier.lr", self.lr, low=1e-7, high=10.0)
        check_whole("classifier.epochs", self.epochs, low=1, high=100_000)
        check_whole("classifier.patience", self.patience, low=1, high=100_000)
        check_whole("classifier.batch_size", self.batch_size, low=1, high=1_000_000)
        check_number("classifier.weight_decay", self.weight_decay, low=0.0, high=10.0)
        check_number("classifier.noise", self.noise, low=0.0, high=10.0)
        recipe = callable(self.net) and not isinstance(self.net, nn.Module)
        check(
            recipe,
            "classifier.net",
            self.net,
            allowed="a recipe from echolearn.classifiers.architectures",
        )
        with seeded(0):
            self.net(
                (16, 36) if self.view == COVARIANCE else (len(self.inputs),)
            )  # fails now rather than after an hour

    @property
    def view(self) -> str:
        """Return "features" or "covariance", as `inputs` have it."""
        return view_of(self.inputs)

    def fit(
        self,
        x: Inputs,
        y: Array,
        *,
        groups: Array,
        validation: tuple[Inputs, Array],
        folder: Path,
        seed: int,
    ) -> Self:
        """Train, keep the best epoch; see `Classifier.fit`."""
        rows, held = rows_of(x, self.inputs), rows_of(validation[0], self.inputs)
        y = check_labels(y, len(rows))
        standardise = Standardise(rows)
        with seeded(seed), quiet():
            net = self.net(rows.shape[1:])
            training = Training(net, lr=self.lr, weight_decay=self.weight_decay, noise=self.noise)
            best = ModelCheckpoint(
                folder,
                "best",
                monitor="val/loss",
                save_weights_only=True,
                enable_version_counter=False,
            )
            trainer = self.trainer(
                folder, [EarlyStopping("val/loss", patience=self.patience), best]
            )
            batches = Batches(source(standardise, rows), tensor(y), size=self.batch_size, seed=seed)
            unseen = Batches(source(standardise, held), tensor(validation[1]), size=BLOCK)
            trainer.fit(training, Once(batches), Once(unseen))
            state = torch.load(best.best_model_path, weights_only=True)["state_dict"]
        training.load_state_dict(state)
        self.fitted = nn.Sequential(standardise, training.net).eval()
        return self

    def trainer(self, folder: Path, callbacks: list[Callback]) -> Trainer:
        """Return a quiet single-threaded trainer that logs into `folder`."""
        place: dict[str, Any] = {"save_dir": str(folder), "name": "", "version": ""}
        loggers: list[Logger] = [
            CSVLogger(**place),
            TensorBoardLogger(**place, default_hp_metric=False, flush_secs=5),
        ]
        return Trainer(
            accelerator="cpu",
            max_epochs=self.epochs,
            callbacks=callbacks,
            logger=loggers,
            plugins=[StagedCheckpoints()],
            num_sanity_val_steps=0,
            enable_progress_bar=False,
            enable_model_summary=False,
        )

    def decision(self, x: Inputs) -> Array:
        """Return the logit, shape (B,)."""
        with torch.no_grad():
            logits = [self.fitted(torch.from_numpy(block)) for block in blocks(x, self.inputs)]
        return torch.cat(logits).double().numpy()

    def scorer(self) -> nn.Module:
        """Return scaler and network as one torch module."""
        return self.fitted


class Training(LightningModule):
    """The network with its loss and optimiser; a step is an epoch."""

    def __init__(self, net: nn.Module, *, lr: float, weight_decay: float, noise: float) -> None:
        super().__init__()
        self.net, self.lr, self.weight_decay, self.noise = net, lr, weight_decay, noise
        self.loss = nn.BCEWithLogitsLoss()
        self.automatic_optimization = False

    def training_step(self, batches: Batches, _index: int) -> None:
        """Pass over all batches and log their mean loss."""
        optimizer = self.optimizers()
        assert isinstance(optimizer, LightningOptimizer)
        total = torch.zeros(())
        for x, y in batches:
            x = x + self.noise * torch.randn_like(x) if self.noise else x
            loss: torch.Tensor = self.loss(self.net(x), y)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            total += loss.detach() * len(y)
        self.log("train/loss", total / batches.rows, on_step=False, on_epoch=True, batch_size=1)

    def validation_step(self, batches: Batches, _index: int) -> None:
        """Log the mean loss on unseen positions."""
        total = sum((self.loss(self.net(x), y) * len(y) for x, y in batches), torch.zeros(()))
        self.log("val/loss", total / batches.rows, batch_size=1)

    def on_train_epoch_start(self) -> None:
        """Bring the last epoch's figures to disk."""
        for logger in self.loggers:
            logger.save()

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """Return AdamW."""
        return torch.optim.AdamW(self.parameters(), lr=self.lr, weight_decay=self.weight_decay)


class StagedCheckpoints(TorchCheckpointIO):
    """Checkpoints written beside their final name and renamed.

    Lightning stages them in TMPDIR; from another file system the last step is a copy, which SIGKILL
    can tear.
    """

    def save_checkpoint(
        self, checkpoint: dict[str, Any], path: str | Path, storage_options: Any = None
    ) -> None:
        """Write `checkpoint` to `path` in one step."""
        write_atomic(Path(path), lambda file: torch.save(checkpoint, file))


@contextmanager
def seeded(seed: int) -> Iterator[None]:
    """Seed torch within the block, on one thread; put both back afterwards."""
    threads = torch.get_num_threads()
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        torch.set_num_threads(1)
        try:
            yield
        finally:
            torch.set_num_threads(threads)


@contextmanager
def quiet() -> Iterator[None]:
    """Silence Lightning's advice within the block."""
    loggers = [logging.getLogger(name) for name in ("lightning.pytorch", "lightning.fabric")]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.ERROR)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            yield
        finally:
            for logger, level in zip(loggers, levels, strict=True):
                logger.setLevel(level)
