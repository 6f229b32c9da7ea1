"""The seed's discriminator of materials: minibatch discrimination by hand, groups, heads."""

from __future__ import annotations

import math

import pytest
import torch

from unproject._random import generator_at, seeded
from unproject._types import UserError
from unproject.networks import DCGANDiscriminator
from unproject.networks.dcgan import MinibatchDiscrimination


def test_minibatch_discrimination_by_hand() -> None:
    layer = MinibatchDiscrimination(2, kernels=1, rows=2)
    torch.nn.init.eye_(layer.matrix.weight)
    seen = layer(torch.tensor([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]]))[:, 0]
    expected = [math.exp(-1) + math.exp(-3), math.exp(-1) + math.exp(-2), math.exp(-3) + math.exp(-2)]
    torch.testing.assert_close(seen, torch.tensor(expected))


def test_sameness_is_found_out() -> None:
    layer = MinibatchDiscrimination(8)
    rows = torch.randn(16, 8, generator=generator_at(0))
    assert (layer(rows[:1].expand(16, 8)) > layer(rows)).all()


def test_groups_do_not_see_one_another() -> None:
    """Nor in batch norm while training: else real images are recognised by the others of their batch, and generated
    ones, which come alone when the generator learns, look real to a discriminator that has won."""
    with seeded(0):
        discriminator = DCGANDiscriminator((3, 16, 16), heads=2, channels=8, group=4).train()
    real, fake, other = torch.rand(3, 4, 3, 16, 16, generator=generator_at(1)).unbind(0)
    head = torch.zeros(8, dtype=torch.long)
    together = discriminator(torch.cat([real, fake]), head)
    torch.testing.assert_close(together[:4], discriminator(torch.cat([real, other]), head)[:4])
    torch.testing.assert_close(together[4:], discriminator(fake, head[:4]))
    discriminator.group = None
    assert not torch.allclose(together, discriminator(torch.cat([real, fake]), head))


def test_images_are_scaled_to_minus_one_and_one() -> None:
    discriminator, seen = DCGANDiscriminator((1, 16, 16), channels=4), []
    discriminator.layers[0].register_forward_hook(lambda module, x, y: seen.append(x[0]))
    discriminator(torch.stack([torch.zeros(1, 16, 16), torch.ones(1, 16, 16)]), torch.zeros(2, dtype=torch.long))
    assert (seen[0][0] == -1).all() and (seen[0][1] == 1).all()


def test_heads_differ_and_every_weight_learns() -> None:
    with seeded(0):
        discriminator = DCGANDiscriminator((1, 32, 32), heads=3, channels=4)
    image = torch.rand(6, 1, 32, 32, generator=generator_at(2))
    head = torch.tensor([0, 1, 2, 0, 1, 2])
    logits = discriminator(image, head)
    assert logits.shape == (6,) and not torch.allclose(logits, discriminator(image, head.flip(0)))
    logits.square().sum().backward()
    # A bias before batch norm shifts nothing.
    moved = {name: bool(p.grad is not None and p.grad.abs().sum() > 0) for name, p in discriminator.named_parameters()}
    assert all(value for name, value in moved.items() if not name.endswith("bias") or "last" in name)


@pytest.mark.parametrize("shape", [(3, 16), (3, 16, 32), (3, 20, 20)])
def test_other_shapes_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(UserError):
        DCGANDiscriminator(shape)
