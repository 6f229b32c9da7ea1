"""Discriminators: heads that know nothing of one another, and spectral norms that hold for each of them."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch
from torch import Tensor, nn
from torch.nn.utils.parametrizations import spectral_norm
from torch.nn.utils.parametrize import is_parametrized, register_parametrization

from unproject._random import seeded
from unproject._types import UserError
from unproject.adversarial.penalties import R1R2
from unproject.networks import DCGANDiscriminator, Discriminator, LineDiscriminator, TextureDiscriminator
from unproject.networks.blocks import HeadConv
from unproject.networks.discriminators import SpectralNorm

HEAD = torch.tensor([0, 1, 2, 1, 0, 2, 2])


def build(**options: object) -> Discriminator:
    with seeded(0, "test"):
        return Discriminator((1, 32, 32), **{"heads": 3, "channels": 4, **options})  # type: ignore[arg-type]


def images(n: int = len(HEAD), *shape: int) -> Tensor:
    return torch.rand(n, *(shape or (1, 32, 32)), generator=torch.Generator().manual_seed(0))


# Heads

LAYOUTS = [
    {"shared": 4},
    {"shared": 2},
    {"shared": 0},
    {"shared": 4, "bottleneck": 5},
    {"shared": 4, "common": True},
    {"shared": 2, "bottleneck": 5, "common": True},
    {"shared": 2, "spectral": True},
]


def own_weights(model: Discriminator) -> list[Tensor]:
    """Everything that exists once a head, heads first."""
    stored = [p for module in model.own for p in module.parameters()]
    return [*stored, *model.last.parameters()]


def image_discriminators() -> dict[str, nn.Module]:
    """Every discriminator of images and lines with three heads, all weights drawn: rows may start at zero."""
    with seeded(0, "heads"):
        found = {f"{options}": build(**options) for options in LAYOUTS}
        found |= {
            "DCGAN": DCGANDiscriminator((1, 32, 32), heads=3, channels=4),
            "texture": TextureDiscriminator((1, 32, 32), heads=3, channels=4),
            "lines": LineDiscriminator((1, 32), heads=3, width=8, bottleneck=6),
        }
        for model in found.values():
            for module in model.modules():
                if isinstance(module, nn.Embedding) and not is_parametrized(module):
                    nn.init.normal_(module.weight)
    return found


@pytest.mark.parametrize("name", image_discriminators())
def test_a_logit_is_that_of_its_own_head(name: str) -> None:
    """Row b of a batch of mixed heads is what head b says when it judges all; no two heads agree on an image."""
    model, y = image_discriminators()[name].eval(), images(len(HEAD), *((1, 32) if name == "lines" else (1, 32, 32)))
    start = {key: value.clone() for key, value in model.state_dict().items()}

    def logits(head: Tensor) -> Tensor:
        model.load_state_dict(start)  # spectral vectors move with every pass
        with torch.no_grad():
            return model(y, head)

    by_head = torch.stack([logits(torch.full_like(HEAD, k)) for k in range(3)])
    torch.testing.assert_close(logits(HEAD), by_head[HEAD, torch.arange(len(HEAD))], rtol=1e-4, atol=1e-5)
    for first, second in ((0, 1), (0, 2), (1, 2)):
        assert ((by_head[first] - by_head[second]).abs() > 1e-4).all()


@pytest.mark.parametrize("options", LAYOUTS, ids=str)
def test_a_head_does_not_hear_of_anothers_weights(options: dict[str, object]) -> None:
    model = build(**options)
    with torch.no_grad():
        # Spectral vectors move with every pass: the same ones before and after.
        kept = {name: value.clone() for name, value in model.state_dict().items()}
        before = model(images(), HEAD)
        model.load_state_dict(kept)
        for weight in own_weights(model):
            weight[1] = weight[1].flip(-1) + 0.5
        after = model(images(), HEAD)
    torch.testing.assert_close(after[HEAD != 1], before[HEAD != 1], rtol=1e-5, atol=1e-6)
    assert ((after - before)[HEAD == 1].abs() > 1e-4).all()


@pytest.mark.parametrize("options", LAYOUTS, ids=str)
def test_an_image_teaches_its_own_head_alone(options: dict[str, object]) -> None:
    model = build(**options)
    model(images(2), torch.tensor([1, 1])).sum().backward()
    for weight in own_weights(model):
        assert weight.grad is not None
        assert weight.grad[1].any() and not weight.grad[[0, 2]].any()
    assert all(p.grad is not None and p.grad.any() for p in model.shared.parameters())


@pytest.mark.parametrize("options", LAYOUTS, ids=str)
def test_each_image_is_scored_alone(options: dict[str, object]) -> None:
    model = build(**options)
    with torch.no_grad():
        for _ in range(200 if options.get("spectral") else 0):  # until the spectral vectors stand still
            model(images(1), HEAD[:1])
        together = model(images(), HEAD)
        alone = torch.cat([model(images()[b : b + 1], HEAD[b : b + 1]) for b in range(len(HEAD))])
    torch.testing.assert_close(together, alone, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("shared", [0, 2, 4])
def test_four_blocks_of_which_the_first_are_shared(shared: int) -> None:
    model = build(shared=shared)
    assert (len(model.shared), len(model.own)) == (shared, 4 - shared)
    assert all(isinstance(block, HeadConv) and len(block.weight) == 3 for block in model.own)


def test_heads_start_as_one_that_all_share() -> None:
    model = build(shared=4, common=True)
    start = [model(images(), torch.full((7,), head)) for head in range(3)]
    assert torch.equal(start[0], start[1]) and torch.equal(start[0], start[2])
    with pytest.raises(UserError, match="common or spectral"):
        build(common=True, spectral=True)


def test_one_head_shares_everything() -> None:
    assert len(build(heads=1, shared=2).shared) == 4


def test_inputs_are_scaled_to_minus_one_and_one() -> None:
    model, seen = build(), []
    model.shared[0].register_forward_hook(lambda m, x, y: seen.append(x[0]))
    model(torch.stack([torch.zeros(1, 32, 32), torch.ones(1, 32, 32)]), HEAD[:2])
    assert (seen[0][0] == -1).all() and (seen[0][1] == 1).all()


# Shapes


@pytest.mark.parametrize("shape", [(1, 64, 64), (3, 32, 32), (1, 16, 48)])
@pytest.mark.parametrize("shared", [2, 4])
def test_one_logit_an_image(shape: tuple[int, ...], shared: int) -> None:
    model = Discriminator(shape, heads=3, channels=4, shared=shared)
    assert model(images(7, *shape), HEAD).shape == (7,)


@pytest.mark.parametrize("options", LAYOUTS, ids=str)
def test_one_logit_a_line(options: dict[str, object]) -> None:
    model = Discriminator((2, 48), heads=3, channels=4, **options)  # type: ignore[arg-type]
    assert all(isinstance(block, nn.Conv1d) for block in model.shared)
    lines = images(7, 2, 48)
    logits = model(lines, HEAD)
    assert logits.shape == (7,)
    torch.testing.assert_close(model(lines.flip(0), HEAD.flip(0)).flip(0), logits, rtol=1e-2, atol=1e-3)


@pytest.mark.parametrize("shape", [(16, 16, 16), (32, 16, 16)])
def test_one_logit_a_volume(shape: tuple[int, ...]) -> None:
    model = Discriminator(shape, channels=4, volumetric=True, spectral=True)
    assert all(isinstance(block, nn.Conv3d) for block in model.shared)
    logits = model(images(2, *shape), torch.zeros(2, dtype=torch.long))
    assert logits.shape == (2,) and logits[0] != logits[1]


@pytest.mark.parametrize(
    "shape, volumetric",
    [
        ((1, 24, 32), False),
        ((1, 32, 24), False),
        ((1, 8, 8), False),
        ((1, 0, 16), False),
        ((32,), False),
        ((1, 24), False),
        ((32, 32), True),
        ((1, 32, 32, 32), False),
        ((24, 16, 16), True),
        ((1, 16, 16), True),
    ],
)
def test_sides_that_cannot_be_halved_four_times_are_refused(shape: tuple[int, ...], volumetric: bool) -> None:
    with pytest.raises(UserError, match="multiples of 16"):
        Discriminator(shape, volumetric=volumetric)


# Spectral norms


def stacks(model: nn.Module) -> Iterator[tuple[str, Tensor]]:
    """Every normalised weight as matrices (heads, O, I)."""
    for name, module in model.named_modules():
        if is_parametrized(module):
            weight = module.weight
            assert isinstance(weight, Tensor)
            if isinstance(module, nn.Embedding):
                yield name, weight[:, None]
            else:
                yield name, weight if isinstance(module, HeadConv) else weight.flatten(1)[None]


@pytest.mark.parametrize("options", [{"shared": 2}, {"shared": 4, "bottleneck": 6}], ids=str)
def test_the_largest_singular_value_of_every_head_is_one(options: dict[str, object]) -> None:
    model = build(spectral=True, **options)
    with torch.no_grad():
        for weight in own_weights(model):
            weight[1] *= 30  # heads of unlike size: one norm for all of them would not do
        for _ in range(60):
            model(images(), HEAD)
        found = {name: torch.linalg.matrix_norm(stack, 2) for name, stack in stacks(model)}
    assert len(found) == 5 + ("bottleneck" in options)
    for name, largest in found.items():
        assert (largest - 1).abs().max() < 0.03, name


def test_fresh_weights_are_nearly_normalised_already() -> None:
    for name, stack in stacks(build(spectral=True)):
        assert torch.linalg.matrix_norm(stack.detach(), 2).max() < 1.2, name


def test_without_the_option_nothing_is_normalised() -> None:
    assert not any(is_parametrized(module) for module in build().modules())


def linear_pair() -> tuple[nn.Linear, nn.Linear]:
    """The same layer under our norm and under torch's, both converged."""
    with seeded(0, "test"):
        ours, theirs = nn.Linear(7, 5), nn.Linear(7, 5)
    theirs.load_state_dict(ours.state_dict())
    register_parametrization(ours, "weight", SpectralNorm(ours.weight[None]))
    spectral_norm(theirs, n_power_iterations=1)
    for _ in range(200):
        assert isinstance(ours.weight, Tensor) and isinstance(theirs.weight, Tensor)
    return ours, theirs


def test_one_head_is_torchs_spectral_norm() -> None:
    ours, theirs = linear_pair()
    torch.testing.assert_close(ours.weight, theirs.weight, rtol=1e-4, atol=1e-5)


def test_second_derivatives_are_torchs() -> None:
    gradients = []
    for layer in linear_pair():
        x = images(4, 7).requires_grad_()
        (slope,) = torch.autograd.grad(layer(x).tanh().sum(), x, create_graph=True)
        slope.square().sum().backward()
        gradients.append(layer.parametrizations.weight.original.grad)  # pyright: ignore
    assert gradients[0].abs().max() > 0.1
    torch.testing.assert_close(*gradients, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize("spectral", [False, True])
def test_a_gradient_penalty_reaches_every_weight(spectral: bool) -> None:
    model = build(spectral=spectral, bottleneck=5)
    rng = torch.Generator().manual_seed(0)
    R1R2()(lambda y: model(y, HEAD), images(), 1 - images(), rng).backward()
    # LeakyReLU is piecewise linear: the slope does not depend on biases.
    slopes = {name: p.grad for name, p in model.named_parameters() if not name.endswith("bias")}
    assert all(grad is not None and grad.isfinite().all() and grad.any() for grad in slopes.values()), slopes.keys()


def test_half_precision_leaves_the_spectral_vectors_whole() -> None:
    model = build(spectral=True, shared=2)
    with torch.autocast("cpu", torch.bfloat16):
        logits = model(images(), HEAD)
    assert {buffer.dtype for buffer in model.buffers()} == {torch.float32}
    torch.testing.assert_close(logits.float(), model(images(), HEAD), rtol=0.1, atol=0.05)


# Lines


def line_discriminator(**options: object) -> LineDiscriminator:
    with seeded(0, "test"):
        return LineDiscriminator((1, 24), 3, **{"mean": 0.1, "deviation": 0.05, "width": 8, **options})  # type: ignore[arg-type]


def test_a_line_is_scored_by_its_head() -> None:
    discriminator = line_discriminator(bottleneck=6)
    y, one = images(len(HEAD), 1, 24), torch.ones_like(HEAD)
    assert torch.equal(discriminator(y, HEAD), discriminator(y, one))  # alike at the start
    with torch.no_grad():
        discriminator.own.weight[2] += 1
    changed = discriminator(y, HEAD) != discriminator(y, one)
    assert torch.equal(changed, HEAD == 2)
    discriminator(y, one).sum().backward()
    gradient = discriminator.own.weight.grad
    assert gradient is not None and torch.equal(gradient.any(1), torch.tensor([False, True, False]))


def test_a_unit_of_measurement_changes_nothing() -> None:
    """Readings in other units, with their mean, their deviation, and γ times deviation²."""
    values = []
    for unit in (1.0, 7.0):
        discriminator = line_discriminator(mean=0.1 * unit, deviation=0.05 * unit)
        y, rng = images(len(HEAD), 1, 24) * unit, torch.Generator().manual_seed(0)
        values.append(R1R2(0.3 * (0.05 * unit) ** 2)(lambda x, d=discriminator: d(x, HEAD), y, y.flip(0), rng))
    torch.testing.assert_close(values[0], values[1], rtol=1e-4, atol=0)


def test_what_is_no_line() -> None:
    for shape, deviation in (((1, 16, 16), 1.0), ((1, 16), 0.0)):
        with pytest.raises(UserError, match="give lines"):
            LineDiscriminator(shape, deviation=deviation)
