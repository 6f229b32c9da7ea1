"""Penalties against closed forms: a linear D(y) = ⟨w, y⟩ has the gradient w, a quadratic ½‖y‖² the gradient y."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from unproject.adversarial.penalties import R1R2, GradientPenalty, Penalty, squared_gradient_norms

SHAPE = (1, 2, 3)


def rng(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def weights() -> Tensor:
    return torch.randn(SHAPE, dtype=torch.float64, generator=rng(1)).requires_grad_()


def images(seed: int, n: int = 5) -> Tensor:
    return torch.rand(n, *SHAPE, dtype=torch.float64, generator=rng(seed))


def penalise(penalty: Penalty, w: Tensor) -> Tensor:
    return penalty(lambda y: (y * w).flatten(1).sum(1), images(2), images(3), rng())


@pytest.mark.parametrize("every", [1, 4])
def test_r1_r2_of_a_linear_discriminator(every: int) -> None:
    w = weights()
    value = penalise(R1R2(gamma=3.0, every=every), w)
    assert value.item() == pytest.approx(3 / 2 * every * 2 * w.square().sum().item())
    value.backward()
    torch.testing.assert_close(w.grad, 3 * every * 2 * w.detach())


@pytest.mark.parametrize("every", [1, 4])
def test_the_gradient_penalty_of_a_linear_discriminator(every: int) -> None:
    w = weights()
    value, norm = penalise(GradientPenalty(10.0, every), w), w.detach().norm()
    assert value.item() == pytest.approx(10 * every * (norm - 1).square().item())
    value.backward()
    torch.testing.assert_close(w.grad, 10 * every * 2 * (norm - 1) * w.detach() / norm)


def test_a_discriminator_of_gradient_norm_one_is_not_penalised() -> None:
    w = weights().detach()
    assert penalise(GradientPenalty(), w / w.norm()).item() == pytest.approx(0, abs=1e-12)
    assert penalise(R1R2(), w / w.norm()).item() == pytest.approx(4)


@pytest.mark.parametrize("norm", [0.5, 2.0])
def test_the_gradient_penalty_is_two_sided(norm: float) -> None:
    w = weights().detach()
    assert penalise(GradientPenalty(10.0), norm * w / w.norm()).item() == pytest.approx(10 * (norm - 1) ** 2)


def test_the_gradient_penalty_is_on_interpolates_of_real_and_generated_images() -> None:
    """D(y) = ½‖y‖² has the gradient y. From generated -e to real 3e it is t e, t uniform on [-1, 3]:

    E (|t| - 1)² = ¼ (∫₋₁⁰ (t + 1)² dt + ∫₀³ (t - 1)² dt) = ¼ (1/3 + 3) = 5/6.

    On real images alone it is 4, on generated ones alone 0.
    """
    e = torch.zeros(20_000, *SHAPE, dtype=torch.float64)
    e[:, 0, 1, 2] = 1
    value = GradientPenalty(1.0)(lambda y: y.square().flatten(1).sum(1) / 2, 3 * e, -e, rng())
    assert value.item() == pytest.approx(5 / 6, abs=0.03)


def test_gradient_norms_are_those_of_each_image() -> None:
    y = images(2)
    norms = squared_gradient_norms(lambda x: x.square().flatten(1).sum(1) / 2, y)
    torch.testing.assert_close(norms, y.square().sum((1, 2, 3)))


def test_r1_is_of_real_images_and_r2_of_generated_ones() -> None:
    value = R1R2(1.0, 1)(lambda y: y.square().flatten(1).sum(1) / 2, images(2), 2 + images(3), rng())
    expected = (images(2).square().sum() + (2 + images(3)).square().sum()) / 5 / 2
    torch.testing.assert_close(value, expected)


def test_r1_r2_of_a_judge_that_knows_one_kind_only() -> None:
    """D(y) = a max(0, s) + b min(0, s), s the sum of y, has the slope a on real images (s > 0), b on generated ones."""

    def discriminator(y: Tensor) -> Tensor:
        s = y.flatten(1).sum(1)
        return 3 * s.clamp(min=0) + 5 * s.clamp(max=0)

    value = R1R2(gamma=2.0, every=1)(discriminator, 1 + images(2), -1 - images(3), rng())
    assert value.item() == pytest.approx(2 / 2 * 6 * (3**2 + 5**2))  # six pixels


def interpolates(seed: int) -> Tensor:
    """Return the images between generated (0) and real (1) that the gradient penalty is evaluated at."""
    seen = []

    def discriminator(y: Tensor) -> Tensor:
        seen.append(y.detach())
        return y.flatten(1).sum(1)

    real = torch.ones(400, *SHAPE, dtype=torch.float64)
    GradientPenalty()(discriminator, real, torch.zeros_like(real), rng(seed))
    return seen[0]


def test_the_gradient_penalty_is_between_real_and_generated() -> None:
    points = interpolates(0)
    per_image = points.flatten(1)
    assert (per_image == per_image[:, :1]).all(), "one place an image"
    assert 0 <= per_image.min() < 0.02 and 0.98 < per_image.max() <= 1
    assert per_image[:, 0].mean().item() == pytest.approx(0.5, abs=0.05)
    assert torch.equal(points, interpolates(0)) and not torch.equal(points, interpolates(1))


@pytest.mark.parametrize("penalty", [R1R2(), GradientPenalty()], ids=lambda p: type(p).__name__)
def test_a_penalty_teaches_the_discriminator_alone(penalty: Penalty) -> None:
    w, real = weights(), images(2).requires_grad_()
    penalty(lambda y: (y * w).square().flatten(1).sum(1), real, images(3), rng()).backward()
    assert w.grad is not None and real.grad is None
