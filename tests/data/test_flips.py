"""Flips against the cameras: the mirror image of an object, seen from θ, is its flipped picture from -θ."""

from __future__ import annotations

import math

import pytest
import torch

from unproject._types import UserError
from unproject.data import Collection, observe, with_flips
from unproject.projections.silhouette import Silhouette, azimuth_bins, azimuth_elevation_bins

RNG = torch.Generator().manual_seed(0)
VOLUMES = torch.rand(6, 12, 12, 12, generator=RNG) ** 4


@pytest.mark.parametrize("views", [azimuth_bins(5), azimuth_elevation_bins(3, 3)], ids=["level", "tilted"])
def test_flipped_pictures_are_pictures_of_mirrored_volumes(views: tuple) -> None:
    seen = with_flips(observe(VOLUMES, views, each=2))
    mirrored = with_flips(Collection(VOLUMES)).items[1::2].repeat_interleave(2, 0)
    assert seen.latents is not None and sorted(seen.latents) == ["azimuth", "elevation"]
    theta = {name: value[1::2] for name, value in seen.latents.items()}
    torch.testing.assert_close(Silhouette()(mirrored, **theta), seen.items[1::2], atol=1e-4, rtol=0)
    assert not torch.allclose(seen.items[1::2], seen.items[::2], atol=1e-2)


def test_originals_and_mirror_images_alternate() -> None:
    pictures = Collection(
        torch.rand(3, 1, 4, 4), latents={"azimuth": torch.tensor([0.0, 1.0, -2.0])}, names=list("abc")
    )
    both = with_flips(pictures)
    assert torch.equal(both.items[::2], pictures.items) and torch.equal(both.items[1::2], pictures.items.flip(3))
    assert both.names == ("a", "a flipped", "b", "b flipped", "c", "c flipped")
    assert both.latents is not None and both.latents["azimuth"].tolist() == [0, 0, 1, -1, -2, 2]
    assert with_flips(Collection(torch.rand(3, 1, 4, 4))).latents is None


def test_what_a_flip_does_not_mean_is_refused() -> None:
    with pytest.raises(UserError, match="only pictures and volumes"):
        with_flips(Collection(torch.rand(3, 8)))
    rolled = Collection(torch.rand(2, 1, 4, 4), latents={"roll": torch.tensor([0.0, math.pi])})
    with pytest.raises(UserError, match="how roll changes in a flip; leave flips out"):
        with_flips(rolled)
