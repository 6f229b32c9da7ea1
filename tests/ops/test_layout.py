"""Layout: values as without it, memory in the order that level rays read."""

from __future__ import annotations

import torch

from unproject.domains import BUILT_IN
from unproject.ops.layout import repeated_volumes


def random(seed: int, *shape: int) -> torch.Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def test_repetitions_keep_values_and_gradients() -> None:
    x, weight = random(0, 2, 3, 4, 5).requires_grad_(), random(1, 6, 3, 4, 5)
    found, plain = repeated_volumes(x, 3), x.repeat_interleave(3, 0)
    assert torch.equal(found, plain)
    gradients = [torch.autograd.grad((y * weight).sum(), x)[0] for y in (found, plain)]
    torch.testing.assert_close(*gradients)


def test_silhouettes_read_repeated_volumes_without_a_copy() -> None:
    x = repeated_volumes(random(0, 2, 6, 5, 4), 3)
    assert x.shape == (6, 6, 5, 4) and x.transpose(2, 3).is_contiguous()


def test_every_domain_repeats_each_sample_in_a_row() -> None:
    x = random(0, 2, 8, 8, 8)
    for domain in BUILT_IN.values():
        assert torch.equal(domain.repeated(x, 3), x.repeat_interleave(3, 0))
        assert domain.repeated(x, 1) is x
    assert BUILT_IN["volumes"].repeated(x, 2).transpose(2, 3).is_contiguous()
