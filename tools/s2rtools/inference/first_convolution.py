"""Split a trunk after its first convolution, which is linear, by its torch.fx graph."""

from __future__ import annotations

from torch import fx, nn


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
