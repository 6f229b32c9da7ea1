"""Projections give on a GPU what they give on the processor: values, and gradients by x and by latents."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from test_laws import RENDERINGS, SILHOUETTES, Materials
from unproject._random import generator_at
from unproject.projections.line_integral import LineIntegral
from unproject.projections.observation import Observation
from unproject.projections.priors import Uniform
from unproject.projections.rendering import rendering_prior

pytestmark = pytest.mark.gpu

LINES = {
    f"lines-{options}": Observation("around", LineIntegral(**options), Uniform("angle", 0, 7))
    for options in ({}, {"bins": 5}, {"bins": 13}, {"fast": False})
}
LOOKS = {name: Observation(name, look, rendering_prior(look, 0.7, spread=0.6)) for name, look in RENDERINGS.items()}
CASES = SILHOUETTES | LINES | LOOKS


def example_of(name: str) -> Tensor:
    if name in LOOKS:
        return Materials.example()
    shape = CASES[name].projection.example_shape if name in LINES else (6, 5, 7)
    return torch.rand(3, *shape, generator=generator_at(1)) ** 3


def results(name: str, x: Tensor, theta: dict[str, Tensor], device: str) -> list[Tensor]:
    """Return values and gradients by x and by each latent that has one, on the processor."""
    at = {key: value.detach().to(device).requires_grad_() for key, value in {"x": x, **theta}.items()}
    y = CASES[name].projection(at["x"], **{key: at[key] for key in theta})
    weight = torch.rand(y.shape, generator=generator_at(2), dtype=y.dtype)
    found = torch.autograd.grad((y * weight.to(device)).sum(), list(at.values()), allow_unused=True)
    assert y.device.type == device
    return [y.detach().cpu(), *(value.cpu() for value in found if value is not None)]


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32], ids=str)
@pytest.mark.parametrize("name", CASES)
def test_values_and_gradients_are_those_of_the_processor(name: str, dtype: torch.dtype) -> None:
    x = example_of(name).to(dtype)
    theta = {key: value.to(dtype) for key, value in CASES[name].prior.sample(len(x), generator_at(3)).items()}
    near = 1e-8 if dtype == torch.float64 else 2e-3
    for here, there in zip(*(results(name, x, theta, device) for device in ("cpu", "cuda")), strict=True):
        far = (here - there).abs() > near * here.abs().max().clamp_min(1.0)
        # Samples of light, and rules that jump, fall to the other side of an edge where rounding decides.
        assert far.double().mean() <= (0.0 if dtype == torch.float64 else 0.02), f"{far.sum()} of {far.numel()}"
