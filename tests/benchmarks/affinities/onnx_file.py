"""A network as an ONNX file (operators of version 13), which OpenCV reads; batch normalisation is folded into weights.

The few messages that are needed are written as they stand in https://github.com/onnx/onnx/blob/main/onnx/onnx.proto.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import nn

from tests.benchmarks.affinities.network import Network

FLOAT = 1
"""Type of tensors."""
WHOLE, TEXT, LIST = 2, 3, 7
"""Types of attributes."""
SCALES = "scales"


class Graph:
    """Nodes and weights of a network."""

    def __init__(self) -> None:
        self._nodes: list[bytes] = []
        self._tensors = {SCALES: np.array([1, 1, 2, 2], np.float32)}

    def conv(self, source: str, layer: nn.Conv2d, norm: nn.BatchNorm2d | None = None) -> str:
        """A convolution; with its normalisation and what is below 0 cut off."""
        weight = layer.weight.detach().double()
        bias = torch.zeros(len(weight), dtype=torch.float64) if layer.bias is None else layer.bias.detach().double()
        if norm is not None:
            assert norm.running_mean is not None
            assert norm.running_var is not None
            scale = norm.weight.detach().double() / torch.sqrt(norm.running_var.double() + norm.eps)
            weight = weight * scale[:, None, None, None]
            bias = (bias - norm.running_mean.double()) * scale + norm.bias.detach().double()
        number = len(self._tensors)
        names = [f"weight_{number}", f"bias_{number}"]
        self._tensors |= dict(zip(names, (weight.float().numpy(), bias.float().numpy()), strict=True))
        side, step, border = int(layer.kernel_size[0]), int(layer.stride[0]), int(layer.kernel_size[0]) // 2
        found = self._node("Conv", source, *names, kernel_shape=[side, side], strides=[step, step], pads=[border] * 4)
        return found if norm is None else self._node("Relu", found)

    def chain(self, source: str, layers: nn.Module) -> str:
        """Convolutions with normalisation, one after the other."""
        parts = list(layers.children())
        if isinstance(parts[0], nn.Conv2d):
            assert isinstance(parts[1], nn.BatchNorm2d)
            return self.conv(source, parts[0], parts[1])
        for part in parts:
            source = self.chain(source, part)
        return source

    def twice(self, source: str) -> str:
        """Every pixel twice along both sides."""
        how = {"mode": "nearest", "coordinate_transformation_mode": "asymmetric", "nearest_mode": "floor"}
        return self._node("Resize", source, "", SCALES, **how)

    def add(self, one: str, other: str) -> str:
        """The sum."""
        return self._node("Add", one, other)

    def _node(self, kind: str, *sources: str, **attributes: int | str | list[int]) -> str:
        name = f"value_{len(self._nodes)}"
        own = [_field(5, _attribute(key, value)) for key, value in attributes.items()]
        inputs = [_field(1, source) for source in sources]
        self._nodes.append(b"".join([*inputs, _field(2, name), _field(3, name), _field(4, kind), *own]))
        return name

    def file(self, source: str, planes: int, target: str, channels: int) -> bytes:
        """The whole file, from the input `source` to the output `target`, of any height and width."""
        graph = [*(_field(1, node) for node in self._nodes), _field(2, "affinities")]
        graph += [_field(5, _tensor(name, values)) for name, values in self._tensors.items()]
        graph += [_field(11, _value(source, planes)), _field(12, _value(target, channels))]
        return _number(1, 7) + _field(7, b"".join(graph)) + _field(8, _number(2, 13))


def exported(network: Network) -> bytes:
    """The network's file."""
    graph = Graph()
    down = ["picture"]
    for stage in network.down:
        down.append(graph.chain(down[-1], stage))
    found = down.pop()
    for narrow, stage in zip(network.narrow, network.up, strict=True):
        assert isinstance(narrow, nn.Conv2d)
        found = graph.chain(graph.add(down.pop(), graph.twice(graph.conv(found, narrow))), stage)
    return graph.file("picture", network.planes, graph.conv(found, network.last), network.last.out_channels)


def _varint(number: int) -> bytes:
    found = bytearray()
    while number > 127:
        found.append(number & 127 | 128)
        number >>= 7
    return bytes([*found, number])


def _number(field: int, value: int) -> bytes:
    return _varint(field << 3) + _varint(value)


def _field(field: int, data: bytes | str) -> bytes:
    data = data.encode() if isinstance(data, str) else data
    return _varint(field << 3 | 2) + _varint(len(data)) + data


def _tensor(name: str, values: np.ndarray) -> bytes:
    sides = b"".join(_number(1, side) for side in values.shape)
    return sides + _number(2, FLOAT) + _field(8, name) + _field(9, values.astype("<f4").tobytes())


def _attribute(name: str, value: int | str | list[int]) -> bytes:
    if isinstance(value, str):
        return _field(1, name) + _field(4, value) + _number(20, TEXT)
    if isinstance(value, int):
        return _field(1, name) + _number(3, value) + _number(20, WHOLE)
    return _field(1, name) + b"".join(_number(8, each) for each in value) + _number(20, LIST)


def _value(name: str, channels: int) -> bytes:
    sides = [_number(1, 1), _number(1, channels), _field(2, "height"), _field(2, "width")]
    shape = b"".join(_field(1, side) for side in sides)
    return _field(1, name) + _field(2, _field(1, _number(1, FLOAT) + _field(2, shape)))
