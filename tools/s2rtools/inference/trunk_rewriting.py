"""Rewrite trunks by their torch.fx trace: fold batch norm, split off the first convolution."""

from __future__ import annotations

import copy

import torch
from torch import fx, nn
from torch.fx.proxy import TraceError
from torch.nn.utils.fusion import fuse_conv_bn_eval


def fold_batch_norm(trunk: nn.Module) -> nn.Module:
    """A copy of the trunk in evaluation mode with every foldable batch norm folded.

    If torch.fx cannot trace the trunk, the copy is not folded.
    """
    plain = copy.deepcopy(trunk).eval()
    try:
        traced = fx.symbolic_trace(plain)
    except (TraceError, TypeError, RuntimeError):
        return plain
    modules = dict(traced.named_modules())
    for node in list(traced.graph.nodes):
        if node.op != "call_module" or not isinstance(modules[node.target], nn.BatchNorm2d):
            continue
        before = node.args[0]
        if before.op != "call_module" or len(before.users) > 1:
            continue
        conv = modules[before.target]
        if isinstance(conv, nn.Conv2d) and modules[node.target].running_mean is not None:
            parent, _, name = before.target.rpartition(".")
            fused = fuse_conv_bn_eval(conv, modules[node.target])
            setattr(traced.get_submodule(parent), name, fused)
            modules[before.target] = fused
            node.replace_all_uses_with(before)
            traced.graph.erase_node(node)
    traced.delete_all_unused_submodules()
    traced.recompile()
    for parameter in traced.requires_grad_(False).parameters():
        if parameter.ndim == 4:
            parameter.data = parameter.data.contiguous(memory_format=torch.channels_last)
    return traced


def split_first_convolution(trunk: nn.Module) -> tuple[nn.Module, nn.Module]:
    """A first part that is linear up to a constant, and the rest of the trunk.

    The first part is the convolution that alone reads the input, `nn.Identity` where there is none
    or the trunk is not traced.
    """
    if not isinstance(trunk, fx.GraphModule):
        return nn.Identity(), trunk
    inputs = [node for node in trunk.graph.nodes if node.op == "placeholder"]
    readers = list(inputs[0].users) if len(inputs) == 1 else []
    if len(readers) != 1 or readers[0].op != "call_module" or readers[0].args != (inputs[0],):
        return nn.Identity(), trunk
    first = trunk.get_submodule(str(readers[0].target))
    if not isinstance(first, nn.Conv2d):
        return nn.Identity(), trunk
    graph = fx.Graph()
    copies = {readers[0]: graph.placeholder("features")}
    for node in trunk.graph.nodes:
        if node not in (inputs[0], readers[0]):
            copies[node] = graph.node_copy(node, copies.__getitem__)
    return first, fx.GraphModule(trunk, graph)
