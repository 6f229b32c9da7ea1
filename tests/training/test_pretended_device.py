"""Every recipe trains, samples, is saved and judged on a pretended device, where a tensor left behind is noticed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from pretended_device import DEVICE, DeviceError, pretended_device
from torch import Tensor

import unproject as up
from unproject.recipes import names
from unproject.training.distribution import Distribution
from unproject.training.recorder import Recorder
from unproject.training.trainer import Trainer
from unproject.training.verdict import judge

SMALL = {"size": 16, "channels": 16, "steps": 4, "precision": "float32"}  # torch.autocast looks for a real device
VIEWS = {"bins": 4, "views_per_shape": 2}
MAPS = {"maps": 4, "renderings": 2, "discriminator_channels": 4}
FLAGS: dict[str, dict[str, Any]] = {
    "shapes": {**VIEWS, "rank": 2, "rounds": 2, "tries": 2},
    "shapes-paper": {**VIEWS, "discriminator_channels": 4, "predictor_steps": 1, "predictor_images": 16},
    "digits": {"information": 0.3},
    "digits-paper": {"discriminator_channels": 4},
}
OTHERS: dict[str, tuple[str, dict[str, Any]]] = {
    "tilted": ("shapes", {"bands": 2}),
    "direct": ("shapes", {"views": "direct"}),
    "learned": ("shapes", {"views": "learned", "connected": 1.0}),
    "information": ("shapes", {"information": 0.3, "flips": True}),
    "known lines": ("digits", {"views": "known"}),
}
SAME = {"metal-paper", "plastic", "plastic-paper", "fabric", "correlated", "materials"}
"""What differs from wood or metal in the procedural data alone."""
ARMS = {name: (name, {}) for name in names() if name not in SAME} | OTHERS


@pytest.fixture(autouse=True)
def few_chairs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("unproject.recipes.shape_panels.PROCEDURAL_CHAIRS", 12)
    monkeypatch.setattr("unproject.recipes.held_out.CHAIRS", 8)


def trainer_of(name: str, flags: dict[str, Any], place: Path, recorder: Recorder) -> Trainer:
    recipe = up.recipes.find(name)(**{**SMALL, **FLAGS.get(name, MAPS), **flags})
    distribution = Distribution("cpu")
    distribution.device = DEVICE
    return Trainer(recipe.replace(batch=8, checkpoint_every=4), place, recorder, distribution=distribution)


def check_devices(trainer: Trainer) -> None:
    kept = [p for module in (trainer.state.generator, trainer.state.discriminators) for p in module.parameters()]
    assert kept and all(p.device == DEVICE for p in kept)


@pytest.mark.parametrize("arm", ARMS)
def test_a_training_never_mixes_devices(arm: str, tmp_path: Path) -> None:
    name, flags = ARMS[arm]
    with Recorder(tmp_path, quiet=True) as recorder, pretended_device():
        trainer = trainer_of(name, flags, tmp_path, recorder)
        for _ in range(4):
            trainer.step()
        check_devices(trainer)
        trainer.save()
        state = trainer.state
        x = state.sampler().sample(2, seed=0)
        assert x.device.type == "cpu" and x.isfinite().all()
        judge(state.sampler(), state.domain, [panel.assignment for panel in state.panels])


def test_cropped_pictures_never_mix_devices(tmp_path: Path) -> None:
    """The default path of a folder of cut-outs: framing, place, and cameras that are learned."""
    masks = up.Silhouette(size=24)(up.data.chairs(12, 24), azimuth=torch.arange(12) * 0.5)[:, 0].numpy() > 0.5
    (tmp_path / "pictures").mkdir()
    for i, mask in enumerate(masks):
        Image.fromarray((255 * mask).astype(np.uint8)).save(tmp_path / "pictures" / f"{i}.png")
    with Recorder(tmp_path, quiet=True) as recorder, pretended_device():
        trainer = trainer_of("shapes", {"data": tmp_path / "pictures"}, tmp_path, recorder)
        for _ in range(4):
            trainer.step()
        check_devices(trainer)


MISTAKES: dict[str, Callable[[Tensor], object]] = {
    "a constant is made on the processor": lambda x: x + torch.ones(3),
    "an index is on the device, what it indexes is not": lambda x: torch.ones(3)[(x > -1).nonzero()[:, 0]],
    "a value of the device meets the processor": lambda x: torch.ones(3) * x.sum(),
    "numpy takes it": lambda x: x.numpy(),
    "numpy takes it without being told": lambda x: np.asarray(x),
    "a kernel takes its address": lambda x: x.data_ptr(),
    "the processor's generator draws": lambda x: torch.rand(3, device=x.device, generator=torch.Generator()),
    "a gradient is left behind": lambda x: torch.autograd.grad(x.requires_grad_().sum() * 2, x, torch.ones(())[None]),
    "a list is joined": lambda x: torch.cat([x, torch.ones(3)]),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes_are_noticed(mistake: str) -> None:
    with pretended_device() as device, pytest.raises((DeviceError, RuntimeError)):
        MISTAKES[mistake](torch.zeros(3).to(device))


def test_what_a_device_allows_is_allowed() -> None:
    with pretended_device() as device:
        x = torch.arange(6.0, device=device).view(2, 3)
        assert all(y.device == DEVICE for y in (x.T, x + 1, x * torch.tensor(2.0), x[torch.tensor([1])], x.new_ones(2)))
        assert (x.to("cpu") + torch.ones(3)).device.type == "cpu"
        x.copy_(torch.ones(2, 3))
        assert x.sum().item() == 6 and x.is_cuda and torch.ones(2).to(x).is_cuda
        layer = torch.nn.Linear(3, 2).to(device)
        layer(x).sum().backward()
        torch.optim.Adam(layer.parameters(), fused=True).step()
        assert layer.weight.grad is not None and layer.weight.grad.is_cuda
    assert not torch.ones(2).is_cuda
