"""List the networks of the paper's Figs. 1 and 6 as built here: layers, output shapes, numbers of parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.utils.parametrize import is_parametrized

from .._random import generator_at
from ..assignment import Predicted
from ..recipes import find
from ..training import Recipe

STRUCTURES: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "fig1": ("shapes-paper", {"views_per_shape": 1}),
    "fig6": ("wood-paper", {"maps": 2, "renderings": 2}),
}
"""Figure → recipe, and flags that only make its collections small."""


def structure(figure: str) -> str:
    """Return the networks of a figure's recipe as text."""
    name, flags = STRUCTURES[figure]
    recipe = find(name)(**flags)
    parts = [f"{figure.replace('fig', 'Fig. ')}: networks of the recipe {name}, as built, for one item."]
    return "\n\n".join([*parts, *(f"{title}\n{table}" for title, table in tables(recipe).items())]) + "\n"


def tables(recipe: Recipe) -> dict[str, str]:
    """Return network → its layers, one a line."""
    generator = recipe.generator().eval()
    found = {"generator": layers(generator, lambda: generator(generator.draw(2, generator_at(0))))}
    for panel in recipe.panels:
        name = f"discriminator of {', '.join(dict.fromkeys(_kind(o.name) for o in panel.observations))}"
        count = panel.assignment.heads(panel)
        images, head = torch.zeros(2, *panel.shape), torch.zeros(2, dtype=torch.long)
        discriminator = recipe.discriminator(panel.shape, count).eval()
        heads = f", {count} heads" if count > 1 else ""
        found[name + heads] = layers(discriminator, lambda d=discriminator: d(images, head))  # noqa: B023
        if isinstance(panel.assignment, Predicted):
            predictor = panel.assignment.fit.network(panel.shape, len(panel.observations)).eval()
            found["view predictor"] = layers(predictor, lambda: predictor(images))  # noqa: B023
    return found


def _kind(observation: str) -> str:
    """Return the name without its number: azimuth-03 becomes azimuth."""
    return observation.rstrip("0123456789.°-– ") or observation


def _is_layer(name: str, module: nn.Module) -> bool:
    """Return whether the module has no submodules; a parametrization belongs to the layer whose weight it norms."""
    return "parametrizations" not in name and all(part == "parametrizations" for part, _ in module.named_children())


@torch.no_grad()
def layers(network: nn.Module, run: Callable[[], Tensor]) -> str:
    """Return a table of all layers without submodules, in the order of their use."""
    rows: list[tuple[str, str, str, str]] = []

    def note(name: str) -> Callable[[nn.Module, Any, Any], None]:
        def hook(module: nn.Module, _: Any, out: Any) -> None:
            shape = "x".join(map(str, out.shape[1:])) if isinstance(out, Tensor) else ""
            count = sum(p.numel() for p in module.parameters())
            kind = type(module).__name__.removeprefix("Parametrized")
            normed = ", normed" if is_parametrized(module) else ""
            rows.append((name, kind + normed, shape or "1", f"{count:,}" if count else ""))

        return hook

    hooks = [
        module.register_forward_hook(note(name))
        for name, module in network.named_modules()
        if name and _is_layer(name, module)
    ]
    try:
        run()
    finally:
        for hook in hooks:
            hook.remove()
    total = sum(p.numel() for p in network.parameters())
    rows = [("layer", "kind", "output", "learned"), *rows, ("in all", "", "", f"{total:,}")]
    widths = [max(len(row[k]) for row in rows) for k in range(4)]
    return "\n".join("  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows)
