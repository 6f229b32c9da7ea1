"""The discriminator of textures: places do not matter, windows move, batches are compared by group."""

from __future__ import annotations

import pytest
import torch

from unproject._random import generator_at, seeded
from unproject._types import UserError
from unproject.networks import TextureDiscriminator

HEAD = torch.zeros(6, dtype=torch.long)


def discriminator(**settings: object) -> TextureDiscriminator:
    with seeded(0):
        return TextureDiscriminator((3, 32, 32), channels=8, **settings)  # pyright: ignore


def pictures(n: int = 6) -> torch.Tensor:
    return torch.rand(n, 3, 32, 32, generator=generator_at(1))


def test_training_looks_through_another_window_each_time_and_goes_on_where_it_was() -> None:
    """The finest windows get everywhere; a copy restored from the state goes on with the same ones."""
    network = discriminator(window=16)
    number = torch.arange(32.0 * 32).view(1, 1, 32, 32)
    seen = torch.cat([network.windows(number)[0].flatten() for _ in range(100)]).long()
    assert seen.remainder(32).unique().numel() == 32 and seen.div(32, rounding_mode="floor").unique().numel() == 32
    copy = discriminator(window=16)
    copy.load_state_dict(network.state_dict())
    x = pictures()
    assert torch.equal(copy(x, HEAD), network(x, HEAD))
    assert not torch.equal(network(x, HEAD), network(x, HEAD))


def test_images_are_scaled_to_minus_one_and_one() -> None:
    network, seen = discriminator(window=32), []
    network.scales[0][0].register_forward_hook(lambda module, x, y: seen.append(x[0]))  # pyright: ignore
    network(torch.stack([torch.zeros(3, 32, 32), torch.ones(3, 32, 32)]), HEAD[:2])
    assert (seen[0][0] == -1).all() and (seen[0][1] == 1).all()


def test_scales_end_with_the_whole_picture() -> None:
    network, x = discriminator(window=8), pictures()
    finest, middle, whole = network.windows(x)
    assert finest.shape == middle.shape == whole.shape == (6, 3, 8, 8)
    torch.testing.assert_close(whole, torch.nn.functional.avg_pool2d(x, 4))
    assert len(discriminator().windows(x)) == 1


def test_outside_of_training_it_looks_at_the_middle() -> None:
    network, x = discriminator(window=16).eval(), pictures()
    assert torch.equal(network.windows(x)[0], x[:, :, 8:24, 8:24]) and network.taken == 0


def test_where_things_lie_hardly_counts() -> None:
    """A shift by a place of the coarsest level moves the logit far less than another contrast does."""
    network = discriminator(window=32).eval()
    x = pictures(64) * torch.linspace(0, 1, 64)[:, None, None, None]
    head = torch.zeros(64, dtype=torch.long)
    with torch.no_grad():
        alone = torch.cat([network(one[None], head[:1]) for one in x])
        shifted = torch.cat([network(one[None].roll((8, 8), (2, 3)), head[:1]) for one in x])
    assert (shifted - alone).std() < 0.2 * alone.std()


def test_a_batch_of_equal_pictures_is_told_from_one_of_different_ones() -> None:
    """Through the deviations over the batch; those of other groups have no say."""
    network = discriminator(group=3).eval()
    x = pictures()
    same = torch.cat([x[:1].expand(3, -1, -1, -1), x[3:]])
    with torch.no_grad():
        mixed, equal = network(x, HEAD), network(same, HEAD)
    assert (mixed[0] - equal[0]).abs() > 1e-4
    torch.testing.assert_close(mixed[3:], equal[3:])


@pytest.mark.parametrize(
    ("shape", "window", "complaint"),
    [
        ((3, 32, 16), None, "square images"),
        ((3, 32), None, "square images"),
        ((3, 32, 32), 64, "does not fit"),
        ((3, 32, 32), 12, "size 12"),
    ],
)
def test_what_it_does_not_take(shape: tuple[int, ...], window: int | None, complaint: str) -> None:
    with pytest.raises(UserError, match=complaint):
        TextureDiscriminator(shape, window=window)
