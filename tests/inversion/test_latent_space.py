"""Whitened latents: noise that a generator adds is a part of them, as it is."""

from __future__ import annotations

import torch

from unproject._random import generator_at
from unproject.inversion import LatentSpace
from unproject.networks import StationaryMaterials


def test_noise_stays_as_it_is_and_has_a_share_of_its_own_in_what_is_unusual() -> None:
    generator = StationaryMaterials(size=16, channels=16, least=8).eval()
    space = LatentSpace.of(generator)
    latent = generator.map_code(generator.draw(4, generator_at(1)))
    v = space.whitened(latent)
    torch.testing.assert_close(space.latents(v), latent, atol=1e-3, rtol=0)
    assert torch.equal(v[:, -generator.white :], latent[:, -generator.white :])
    code, noise = v[:, : -generator.white], v[:, -generator.white :]
    torch.testing.assert_close(space.unusual(v), code.square().mean(1) + noise.square().mean(1))
