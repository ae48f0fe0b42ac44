"""NanoTrack's two ONNX files with a network that finds the template's colour."""

from pathlib import Path

import pytest
import torch
from torch.onnx._internal.torchscript_exporter import onnx_proto_utils


class _Backbone(torch.nn.Module):
    """Mean colour of every square of 16 px."""

    def forward(self, image: torch.Tensor) -> torch.Tensor:
        return torch.nn.functional.avg_pool2d(image, 16, 16, padding=8, count_include_pad=False)[:, :, :16, :16]


class _Head(torch.nn.Module):
    """Classes: how near a colour is to that in the middle of the template; boxes: of one size."""

    def forward(self, template: torch.Tensor, search: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        color = template[:, :, 3:5, 3:5].mean(dim=(2, 3), keepdim=True)
        off = ((search - color) ** 2).sum(dim=1, keepdim=True)
        nearness = -0.0005 * torch.nn.functional.avg_pool2d(off, 3, 1, padding=1, count_include_pad=False)
        sides = torch.tensor([34.0, 29.0, 34.0, 29.0]).reshape(1, 4, 1, 1) + 0 * search[:, :1]
        return torch.cat([-nearness, nearness], dim=1), sides


def write_weights(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Write the two files into a new folder, and return it."""
    monkeypatch.setattr(onnx_proto_utils, "_add_onnxscript_fn", lambda model, *_: model)  # it needs the package onnx
    folder.mkdir()
    options = {"dynamo": False, "opset_version": 11}
    names = {"input_names": ["input"], "output_names": ["output"]}
    torch.onnx.export(_Backbone(), torch.zeros(1, 3, 255, 255), folder / "my_backbone.onnx", **options, **names)
    names = {"input_names": ["input1", "input2"], "output_names": ["output1", "output2"]}
    parts = torch.zeros(1, 3, 8, 8), torch.zeros(1, 3, 16, 16)
    torch.onnx.export(_Head(), parts, folder / "my_head.onnx", **options, **names)
    return folder
