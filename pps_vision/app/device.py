"""The torch device that a command was asked to compute on."""

from typing import TYPE_CHECKING

from pps_vision.errors import InputError

if TYPE_CHECKING:
    import torch


def torch_device(name: str) -> "torch.device":
    """The device of that name: cpu, cuda or cuda:INDEX; InputError where this machine does not have it."""
    import torch  # takes seconds to load, and most commands do without

    n = torch.cuda.device_count()
    devices = {"cpu", *(["cuda"] if n else []), *(f"cuda:{index}" for index in range(n))}
    if name not in devices:
        expected = " or ".join(sorted(devices))
        raise InputError(f"--device {name}", f"torch finds {n} CUDA devices on this machine; expected {expected}")
    return torch.device(name)
