"""Which of torch's devices this machine has."""

from echolearn.checks import check


def cuda_is_there() -> bool:
    """Tell whether this machine has a GPU that torch can use."""
    import torch

    return torch.cuda.is_available()


def check_device(name: str, device: str, *, hint: str) -> None:
    """Raise `BadValue` for a device that is not there.

    To be called where it computes and not before: who asks starts CUDA, after which no process can
    be forked.

    Args:
        name: of the setting.
        device: of torch, cuda or cpu.
        hint: what else there is.
    """
    there = device == "cpu" or cuda_is_there()
    check(there, name, device, allowed="must be on this machine", hint=hint)
