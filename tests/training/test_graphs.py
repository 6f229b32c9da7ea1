"""What says that it is replayable does the same operations whatever the values, and waits for none of them.

Whether a replay gives what the call gives is tested on a GPU (tests/gpu).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import pytest
import torch
from pretended_device import CROSSED, pretended_device
from torch import Tensor, nn
from torch.utils._python_dispatch import TorchDispatchMode
from toy import toy

from unproject import networks
from unproject._random import generator_at
from unproject.adversarial.penalties import R1R2, GradientPenalty
from unproject.ops.band_statistics import band_statistics
from unproject.projections.base import Identity
from unproject.projections.rendering import Rendering, rendering_prior
from unproject.training.graphs import Graphs, replayable
from unproject.training.recorder import Recorder
from unproject.training.trainer import Trainer

WAITS = {"aten._local_scalar_dense.default", "aten.nonzero.default", "aten.is_nonzero.default"}


class Operations(TorchDispatchMode):
    """The names of the operations that run, and the shapes of their results."""

    def __init__(self) -> None:
        super().__init__()
        self.seen: list[Any] = []

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        found = func(*args, **(kwargs or {}))
        self.seen.append((str(func), found.shape if isinstance(found, Tensor) else None))
        return found


def images(seed: int, *shape: int) -> Tensor:
    return torch.rand(4, *shape, generator=generator_at(seed))


def heads(seed: int) -> Tensor:
    return torch.randint(3, (4,), generator=generator_at(seed))


GENERATORS: dict[str, Callable[[], networks.Generator]] = {
    "low rank": lambda: networks.LowRankGenerator(size=16, code_size=8, channels=8, rank=2),
    "voxels": lambda: networks.VoxelGenerator(size=16, code_size=8, channels=8),
    "images": lambda: networks.ImageGenerator(size=16, code_size=8, channels=8),
    "smooth images": lambda: networks.SmoothImageGenerator(size=16, code_size=8, channels=8),
    "materials": lambda: networks.DCGANMaterials(size=16, code_size=8, channels=16),
    "stationary materials": lambda: networks.StationaryMaterials(size=16, code_size=8, channels=16),
}
DISCRIMINATORS: dict[str, Callable[[], nn.Module]] = {
    "pictures": lambda: networks.Discriminator((1, 16, 16), heads=3, channels=4, shared=4, common=True),
    "DCGAN": lambda: networks.DCGANDiscriminator((3, 16, 16), heads=3, channels=8),
    "textures": lambda: networks.TextureDiscriminator((3, 16, 16), heads=3, channels=4, window=8),
    "lines": lambda: networks.LineDiscriminator((1, 16), heads=3, width=8, bottleneck=4),
}
SHAPES = {"pictures": (1, 16, 16), "lines": (1, 16)}


def same_operations(given: Callable[[int], tuple[Tensor, ...]], call: Callable[..., Any]) -> None:
    """Require that two calls, of two seeds, do the same, after one that may prepare what is kept."""
    call(*given(0))
    traces = []
    for seed in (1, 2):
        inputs = given(seed)
        CROSSED.clear()
        with Operations() as operations:
            call(*inputs)
        traces.append(operations.seen)
        assert not CROSSED  # what moves between devices cannot be recorded
    assert traces[0] == traces[1]
    assert not WAITS & {name for name, _ in traces[0]}


@pytest.mark.parametrize("name", GENERATORS)
def test_generators(name: str) -> None:
    with pretended_device() as device:
        generator = GENERATORS[name]().to(device)
        assert replayable(generator)
        same_operations(
            lambda seed: (generator.draw(4, generator_at(seed)).to(device),),
            lambda code: generator(code).sum().backward(),
        )


@pytest.mark.parametrize("name", DISCRIMINATORS)
def test_discriminators_and_their_penalty(name: str) -> None:
    with pretended_device() as device:
        module, shape = DISCRIMINATORS[name]().to(device), SHAPES.get(name, (3, 16, 16))
        assert replayable(module)

        def given(seed: int) -> tuple[Tensor, ...]:
            return tuple(x.to(device) for x in (images(seed, *shape), images(seed + 9, *shape), heads(seed)))

        def call(real: Tensor, fake: Tensor, head: Tensor) -> None:
            module(real, head).sum().backward()
            R1R2()(lambda x: module(x, head), real, fake, torch.Generator()).backward()

        same_operations(given, call)


@pytest.mark.parametrize("lighting", ["ambient", "directional", "coloured", "natural"])
def test_renderings_and_statistics(lighting: Any) -> None:
    light = torch.rand(2, 3, 8, 16, generator=generator_at(0)) if lighting == "natural" else lighting
    look = Rendering(light)
    prior = rendering_prior(look, 0.7, spread=0.6)
    assert replayable(look)
    with pretended_device() as device:

        def given(seed: int) -> tuple[Tensor, ...]:
            x = torch.rand(4, 8, 8, 8, generator=generator_at(seed)).to(device).requires_grad_()
            return x, *(value.to(device) for value in prior.sample(4, generator_at(seed)).values())

        def call(x: Tensor, *latents: Tensor) -> None:
            band_statistics(look(x, **dict(zip(prior.names, latents, strict=True)))).sum().backward()

        same_operations(given, call)


def test_what_waits_or_branches_is_noticed() -> None:
    with pytest.raises(AssertionError):
        same_operations(lambda seed: (images(seed, 2),), lambda x: x.mean().item())
    with pytest.raises(AssertionError):
        same_operations(lambda seed: (images(seed, 2),), lambda x: x * 2 if x.sum() > images(1, 2).sum() else x)
    with pretended_device() as device, pytest.raises(AssertionError):
        same_operations(lambda seed: (images(seed, 2).to(device),), lambda x: x + torch.ones(2).to(device))


def test_who_says_so() -> None:
    class Derived(networks.LowRankGenerator):
        pass

    assert not replayable(Derived(size=16, code_size=8, channels=8, rank=2))
    assert not replayable(networks.Discriminator((1, 16, 16), heads=3, channels=4))  # groups by head
    assert not replayable(networks.Discriminator((1, 16, 16), channels=4, spectral=True))
    assert replayable(R1R2()) and not replayable(GradientPenalty())


def test_on_the_processor_all_is_called() -> None:
    graphs, module = Graphs(), DISCRIMINATORS["pictures"]()
    x, head = images(0, 1, 16, 16), heads(0)
    assert torch.equal(graphs(module, x, head), module(x, head)) and not graphs._passes


def test_of_several_projections_of_a_step_one_is_replayed_so_that_none_overwrites_another(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    x, replayed = images(0, 1, 16, 16), []

    @dataclass(frozen=True)
    class Brighter(Identity):
        replayable: ClassVar[bool] = True

    def replay(self: Graphs, place: Any, function: Any, inputs: Any, module: Any = None) -> Tensor:
        replayed.append(place)
        return function(*inputs)

    monkeypatch.setattr(Graphs, "replayed", replay)
    graphs = Graphs()
    for _ in range(2):
        call = graphs.projecting(3)
        assert all(torch.equal(call(Brighter(), x), x) for _ in range(3))
    call(Identity(), x)
    assert replayed == [(3, ())] * 2


@pytest.mark.parametrize(("over", "enabled"), [(None, True), ("processes", False)])
def test_passes_that_wait_for_other_processes_are_not_replayed(over: Any, enabled: bool, tmp_path: Path) -> None:
    with Recorder(tmp_path, quiet=True) as recorder:
        trainer = Trainer(toy(steps=1, views="known").replace(normalise_over=over), tmp_path, recorder)
        assert trainer.graphs.enabled == enabled
