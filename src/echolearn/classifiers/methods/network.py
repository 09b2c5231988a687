"""Any torch network as a classifier, trained under Lightning.

The loss is the cross-entropy of the logit, the optimiser AdamW. After each epoch the validation
rows are looked at; training stops when their loss, or with `monitor=auc` their AUC, has not become
better for `patience` epochs, and the best epoch's weights are put back. The loss also falls while
confidences merely grow bolder, which calibration undoes; the AUC asks for the order of rows alone.
The run folder receives the weights (`best.safetensors`), `metrics.csv` and TensorBoard's events.

Batches come from memory or, of large sets, from the shards (`batches`). One thread; two runs side
by side use two cores. `accelerator` says what trains: the CPU, or what Lightning finds ("auto",
"gpu", "mps"). What has been trained computes on the CPU wherever it comes from.

What Lightning calls a step is here a whole epoch, and the loop over batches stands in
`Training.training_step`: with batches of less than a millisecond its hooks around every step would
take most of the time.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from lightning.fabric.plugins.environments.lightning import LightningEnvironment
from lightning.fabric.utilities.rank_zero import rank_zero_only
from lightning.pytorch import LightningModule, Trainer
from lightning.pytorch.callbacks import EarlyStopping
from lightning.pytorch.core.optimizer import LightningOptimizer
from lightning.pytorch.loggers import CSVLogger, TensorBoardLogger
from safetensors.torch import load, save
from sklearn.metrics import roc_auc_score, roc_curve
from torch import nn

from echolearn.acoustics.types import Array
from echolearn.checks import check, check_choice, check_fields
from echolearn.classifiers.batches import BLOCK, Batches, WholeEpoch, source_of
from echolearn.classifiers.classifier import Examples
from echolearn.classifiers.earlier import EarlierFilter
from echolearn.classifiers.going_on import go_on, learned_by
from echolearn.classifiers.inputs import (
    VIEWS,
    Inputs,
    block_rows,
    blocks_of,
    check_inputs,
    is_tensor,
    rows_of,
    view_of,
    walks_of,
)
from echolearn.classifiers.remarks import without_remarks
from echolearn.classifiers.standardise import standardiser
from echolearn.localization.columns import STRIPS, tensor_shape
from echolearn.storage.files import write_atomic

RANGES = {
    "lr": (1e-7, 10.0),
    "epochs": (1, 100_000),
    "patience": (1, 100_000),
    "batch_size": (1, 1_000_000),
    "weight_decay": (0.0, 10.0),
    "noise": (0.0, 10.0),
}
"""Least and largest value of each setting that is a number."""


WORST = {"loss": np.inf, "auc": -np.inf}
"""Figures by which epochs are compared, each with the worst there is."""


@dataclass
class Network:
    """A network on standardised columns or on one standardised tensor.

    Attributes:
        inputs: names of the columns, or of the one tensor.
        net: recipe that makes the network from the shape of one row (see `architectures`).
        lr: learning rate.
        epochs: number of passes, at most.
        patience: number of epochs without a better validation figure before stopping.
        batch_size: rows per step of the optimiser, about.
        weight_decay: weight decay of AdamW.
        noise: deviation of Gaussian noise added to standardised training inputs.
        accelerator: what trains: "cpu", "auto" (the fastest there is), "gpu" or "mps".
        monitor: validation figure that says which epoch is best, "loss" or "auc".
        device: torch's name of what has trained, after `fit`: cpu, cuda, mps.
        epochs_seen: number of epochs after which `fit` has stopped.
        earlier: run that it is trained on from, if there is one.
    """

    inputs: tuple[str, ...]
    net: Callable[[tuple[int, ...]], nn.Module]
    lr: float = 2e-3
    epochs: int = 100
    patience: int = 15
    batch_size: int = 128
    weight_decay: float = 0.01
    noise: float = 0.0
    accelerator: str = "cpu"
    monitor: str = "loss"
    device: str = field(init=False, repr=False)
    epochs_seen: int = field(init=False, repr=False)
    earlier: EarlierFilter | None = field(default=None, init=False, repr=False)
    fitted: nn.Module = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.inputs = check_inputs(self.inputs, views=tuple(VIEWS))
        check_fields("classifier", self, ranges=RANGES)
        there = accelerators()
        allowed = f"must be what this machine has: {', '.join(there)}"
        check(
            self.accelerator in there, "classifier.accelerator", self.accelerator, allowed=allowed
        )
        check_choice("classifier.monitor", self.monitor, *WORST)
        recipe = callable(self.net) and not isinstance(self.net, nn.Module)
        allowed = "must be a recipe from echolearn.classifiers.architectures"
        check(recipe, "classifier.net", self.net, allowed=allowed)

        # Noise would make every strip a walk of its own.
        marked = view_of(self.inputs) == STRIPS and self.noise > 0.0
        allowed = "must be 0 for strips, which name their walk"
        check(not marked, "classifier.noise", self.noise, allowed=allowed)

        # A recipe that does not fit the inputs fails now rather than after an hour of sets.
        tensor = is_tensor(self.inputs)
        shape = tensor_shape(self.inputs[0], 6) if tensor else (len(self.inputs),)
        with seeded(0, accelerator="cpu"):
            self.net(shape)

    def begin(self, earlier: EarlierFilter) -> Self:
        """Train on from a run of the same network."""
        same = earlier.learned is not None and earlier.inputs == self.inputs
        hint = "classifier=adapted adapts any bundle or run"
        allowed = "must be a run of this network with these inputs"
        check(same, "init", earlier.told["name"], allowed=allowed, hint=hint)
        self.earlier = earlier
        return self

    def fit(self, examples: Examples) -> Self:
        """Train until the validation figure gets no better, and keep the best epoch."""
        rows = rows_of(examples.x, self.inputs)
        unseen, labels = examples.validation
        learned = learned_by(self.earlier)
        # A recipe may know better what is alike in a row.
        scale = getattr(self.net, "scale", standardiser)(learned.rows if learned else rows)
        with seeded(examples.seed, accelerator=self.accelerator), without_remarks():
            best = examples.folder / "best.safetensors"
            net = self.net(rows.shape[1:])
            if self.earlier and learned:
                go_on(net, scale=scale, earlier=self.earlier, learned=learned)
            training = Training(net, self, best=best)
            training.watch = examples.watch
            held_rows = rows_of(unseen, self.inputs)
            batches = Batches(
                source_of(rows, scale),
                examples.y,
                size=self.batch_size,
                seed=examples.seed,
                walks=walks_of(rows),
            )
            size = block_rows(rows.shape[1:], BLOCK)
            there = walks_of(held_rows)
            held = Batches(source_of(held_rows, scale), labels, size=size, walks=there)
            trainer = self.trainer(examples)
            trainer.fit(training, WholeEpoch(batches), WholeEpoch(held))
        self.device = trainer.strategy.root_device.type
        self.epochs_seen = trainer.current_epoch

        # The last epochs are those that did no better: the best one's weights are put back.
        training.net.cpu().load_state_dict(load(best.read_bytes()))
        self.fitted = nn.Sequential(scale, training.net).eval()
        return self

    def trainer(self, examples: Examples) -> Trainer:
        """Return a quiet trainer that logs into the run's folder, alone whatever started it."""
        # Launchers say by variables which of several processes this is; Lightning reads them when
        # it is imported, and all but the first of them would write nothing.
        rank_zero_only.rank = 0  # type: ignore[attr-defined]
        place: dict[str, Any] = {"save_dir": str(examples.folder), "name": "", "version": ""}
        board = TensorBoardLogger(**place, default_hp_metric=False, flush_secs=5)
        return Trainer(
            accelerator=self.accelerator,
            devices=1,
            # Sums on a GPU come in any order unless it is told otherwise.
            deterministic=None if self.accelerator == "cpu" else "warn",
            max_epochs=self.epochs,
            callbacks=[self.stopping()],
            logger=[CSVLogger(**place), board, *examples.loggers],
            plugins=[LightningEnvironment()],
            num_sanity_val_steps=0,
            enable_checkpointing=False,
            enable_progress_bar=False,
            enable_model_summary=False,
        )

    def stopping(self) -> EarlyStopping:
        """Return what ends the training once no epoch is better than the best."""
        mode = "min" if self.monitor == "loss" else "max"
        return EarlyStopping(f"val/{self.monitor}", patience=self.patience, mode=mode)

    def decision(self, x: Inputs) -> Array:
        """Return the logit, shape (B,)."""
        with torch.no_grad():
            logits = [self.fitted(torch.from_numpy(block)) for block in blocks_of(x, self.inputs)]
        return torch.cat(logits).double().numpy()

    def scorer(self) -> nn.Module:
        """Return scaler and network as one torch module."""
        return self.fitted


def accelerators() -> list[str]:
    """Return what can train on this machine."""
    apple = torch.backends.mps.is_available()
    gpu = apple or torch.cuda.is_available()
    return ["cpu", "auto"] + ["gpu"] * gpu + ["mps"] * apple


class Training(LightningModule):
    """A network with its loss and optimiser; a step is an epoch."""

    def __init__(self, net: nn.Module, settings: Network, *, best: Path) -> None:
        """Make a network ready for training.

        Args:
            net: what is trained.
            settings: how.
            best: file for the weights of the epoch with the best validation figure.
        """
        super().__init__()
        self.net = net
        self.settings = settings
        self.best = best
        self.reached = WORST[settings.monitor]
        self.watch: Callable[[int, float], None] | None = None
        self.loss = nn.BCEWithLogitsLoss()
        self.automatic_optimization = False

    def loss_of(self, x: torch.Tensor, y: torch.Tensor) -> torch.Tensor:
        """Return the mean loss of a batch, computed where the network lies."""
        loss: torch.Tensor = self.loss(self.net(x), y.to(self.device))
        return loss

    def training_step(self, batches: Batches, _index: int) -> None:
        """Pass over all batches and log their mean loss."""
        optimizer = self.optimizers()
        assert isinstance(optimizer, LightningOptimizer)
        noise = self.settings.noise
        total = torch.zeros((), device=self.device)
        for x, y in batches:
            x = x.to(self.device)
            loss = self.loss_of(x + noise * torch.randn_like(x) if noise else x, y)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            total += loss.detach() * len(y)
        self.log("train/loss", total / batches.rows, on_step=False, on_epoch=True, batch_size=1)

    def validation_step(self, batches: Batches, _index: int) -> None:
        """Log how unseen positions fare, and keep the weights if that is the best so far."""
        total = torch.zeros((), device=self.device)
        logits = []
        for x, y in batches:
            logits.append(self.net(x.to(self.device)))
            loss: torch.Tensor = self.loss(logits[-1], y.to(self.device))
            total += loss * len(y)
        # What has diverged orders nothing.
        order = torch.nan_to_num(torch.cat(logits)).cpu().numpy()
        reference = batches.y.numpy()
        spurious, retained, _ = roc_curve(reference, order)
        figures = {
            "loss": float(total / batches.rows),
            "auc": float(roc_auc_score(reference, order)),
            # At the cut that is best at this epoch: the run's own is chosen when all are done.
            "balanced_accuracy": float((retained + 1 - spurious).max() / 2),
            "lr": float(self.trainer.optimizers[0].param_groups[0]["lr"]),
        }
        for name, figure in figures.items():
            self.log("train/lr" if name == "lr" else f"val/{name}", figure, batch_size=1)

        found = figures[self.settings.monitor]
        better = found < self.reached if self.settings.monitor == "loss" else found > self.reached
        if better or self.current_epoch == 0:
            self.reached = found
            # Tensors that share their memory are written twice, which safetensors insists on.
            weights = {name: value.clone() for name, value in self.net.state_dict().items()}
            write_atomic(self.best, save(weights))
        if self.watch is not None:
            self.watch(self.current_epoch, -found if self.settings.monitor == "loss" else found)

    def on_train_epoch_start(self) -> None:
        """Bring the last epoch's figures to disk."""
        for logger in self.loggers:
            logger.save()

    def configure_optimizers(self) -> torch.optim.Optimizer:
        """Return AdamW."""
        decay = self.settings.weight_decay
        return torch.optim.AdamW(self.parameters(), lr=self.settings.lr, weight_decay=decay)


@contextmanager
def seeded(seed: int, *, accelerator: str) -> Iterator[None]:
    """Seed torch within the block, on one thread; put all back afterwards that training sets."""
    threads = torch.get_num_threads()
    # Lightning leaves it switched on, and what is trained next might sum in another way.
    exact = torch.are_deterministic_algorithms_enabled()
    warning = torch.is_deterministic_algorithms_warn_only_enabled()
    # Whoever asks for a GPU's random state starts CUDA, after which no process can be forked.
    devices: list[int] | None = [] if accelerator == "cpu" else None
    with torch.random.fork_rng(devices):
        torch.manual_seed(seed)
        torch.set_num_threads(1)
        try:
            yield
        finally:
            torch.set_num_threads(threads)
            torch.use_deterministic_algorithms(exact, warn_only=warning)
