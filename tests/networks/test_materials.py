"""Generators of materials: maps that can be materials, codes as the seed draws them, samples that repeat."""

from __future__ import annotations

import math

import pytest
import torch

from unproject._random import generator_at, seeded
from unproject._types import UserError
from unproject.networks import DCGANMaterials, Generator, StationaryMaterials
from unproject.networks.texture_layers import Waves
from unproject.networks.texture_noise import normal_noise, stretched, white_noise
from unproject.ops.maps import MAPS, check_maps, places, unpack_maps
from unproject.testing import check_generator, run_laws


def made(kind: str, specular: int = 1) -> Generator:
    with seeded(0):
        return (
            DCGANMaterials(16, channels=32, code_size=24, specular_channels=specular)
            if kind == "dcgan"
            else StationaryMaterials(
                32, 24, places=3, channels=32, least=8, specular_channels=specular, cycles=8 * (kind == "waves")
            )
        )


COLOURS = pytest.mark.parametrize("specular", [1, 3])
TILING = pytest.mark.parametrize("kind", ["stationary", "waves"])
EACH = pytest.mark.parametrize("kind", ["dcgan", "stationary", "waves"])


@EACH
@COLOURS
def test_they_obey_the_laws(kind: str, specular: int) -> None:
    check_generator(made(kind, specular), low=-1, high=3)


@EACH
@COLOURS
def test_they_make_what_can_be_a_material(kind: str, specular: int) -> None:
    x = made(kind, specular).sample(5, seed=1)
    assert x.shape == (5, 7 + specular, *[16 if kind == "dcgan" else 32] * 2)
    check_maps(x)
    assert x[:, -1].min() > 0
    colours = unpack_maps(x)["specular"].std(1, correction=0)
    assert (colours.min() > 0) == (specular == 3)


@EACH
def test_a_specular_albedo_has_one_channel_or_three(kind: str) -> None:
    with pytest.raises(UserError, match="give 1, or 3"):
        made(kind, 2)


@EACH
@COLOURS
def test_every_map_learns(kind: str, specular: int) -> None:
    """Each branch gets a gradient from its own map and none from another's; what they share gets one from each."""
    generator = made(kind, specular).train()
    code = generator.draw(4, generator_at(2))
    for name, place in places(7 + specular).items():
        generator.zero_grad()
        generator(code)[:, place].square().sum().backward()
        for other in MAPS:
            moved = any(bool(p.grad is not None and p.grad.any()) for p in generator.branches[other].parameters())  # pyright: ignore
            assert moved == (other == name)
        shared = (generator.start, generator.common)  # pyright: ignore[reportAttributeAccessIssue]
        assert all(bool(p.grad is not None and p.grad.any()) for part in shared for p in list(part.parameters())[:1])  # pyright: ignore


def drawn_maps(normal: tuple[float, float, float]) -> torch.Tensor:
    """(8,) of what the branches drew as 0, but for the normal; the scale factors are 1, 2 and 3."""
    generator = DCGANMaterials(8, code_size=4, channels=8)
    with torch.no_grad():
        generator.scales.weight.zero_()
        generator.scales.bias.copy_(torch.tensor([1.0, 2.0, 3.0]).expm1().log())  # softplus takes it back
    drawn = {name: torch.zeros(1, place.stop - place.start, 1, 1) for name, place in MAPS.items()}
    drawn["normal"] = torch.tensor(normal).view(1, 3, 1, 1)
    return generator.maps(torch.zeros(1, 4), drawn).detach().flatten()


def test_each_map_has_its_own_scale_factor() -> None:
    """A sigmoid of 0 is 1/2: k_d = 1/2, k_s = 2/2, m = 3/2 and the least roughness."""
    torch.testing.assert_close(drawn_maps((0, 0, 0))[:5], torch.tensor([0.5, 0.5, 0.5, 1.0, 1.505]))


def test_drawn_normals_lean_to_either_side() -> None:
    """n = (2σ(d₁) - 1, 2σ(d₂) - 1, σ(d₃) + 0.05) / |…|: 2σ(log 3) - 1 = 1/2, of -log 3 it is -1/2."""
    torch.testing.assert_close(drawn_maps((0, 0, 0))[5:], torch.tensor([0.0, 0.0, 1.0]))
    length = math.hypot(0.5, 0.5, 0.55)
    expected = torch.tensor([0.5, -0.5, 0.55]) / length
    torch.testing.assert_close(drawn_maps((math.log(3), -math.log(3), 0))[5:], expected)


def test_the_seeds_codes_are_uniform_and_its_branches_share_two_layers() -> None:
    generator = DCGANMaterials(64, channels=32)
    code = generator.draw(200, generator_at(0))
    assert code.shape == (200, 512) and code.abs().max() <= 1 and code.std().item() == pytest.approx(3**-0.5, abs=0.01)
    convolutions = [m for m in generator.common.modules() if isinstance(m, torch.nn.ConvTranspose2d)]
    assert len(convolutions) == 1  # and the linear layer


def test_noise_is_white_and_a_function_of_the_code() -> None:
    code = torch.randn(3, 10, generator=generator_at(3))
    noise = white_noise(code, 64)
    assert torch.equal(noise, white_noise(code.clone(), 64))
    flat = noise.flatten(1)
    torch.testing.assert_close(flat.mean(1), torch.zeros(3), atol=0.06, rtol=0)
    torch.testing.assert_close(flat.std(1), torch.ones(3), atol=0.05, rtol=0)
    assert torch.corrcoef(flat).triu(1).abs().max() < 0.08
    several = white_noise(code, 32, 4).flatten(2)
    assert torch.corrcoef(several.flatten(0, 1)).triu(1).abs().max() < 0.15
    image = noise[0, 0]
    assert abs((image[:, 1:] * image[:, :-1]).mean()) < 0.06 and abs((image[1:] * image[:-1]).mean()) < 0.06


@pytest.mark.parametrize("times", [1, 2])
def test_half_of_the_noise_is_grain(times: int) -> None:
    """Down and across, from end to end and for a quarter of the side of training; of deviation 1, and it tiles."""
    white = white_noise(torch.randn(40, 10, generator=generator_at(3)), 32 * times, 8)
    x = stretched(white, times)
    assert torch.equal(x[:, :4], white[:, :4])
    assert torch.equal(x[:, 4], x[:, 4, :1].expand_as(x[:, 4]))
    assert torch.equal(x[:, 5], x[:, 5, :, :1].expand_as(x[:, 5]))
    torch.testing.assert_close(x.std((0, 2, 3)), torch.ones(8), atol=0.05, rtol=0)
    for k, axis in ((6, 1), (7, 2)):
        for along, expected in ((axis, 7 / 8), (3 - axis, 0.0)):
            neighbour = (x[:, k] * x[:, k].roll(1, along)).mean().item()  # over the border too
            assert neighbour == pytest.approx(expected, abs=0.06)


@TILING
def test_a_stationary_generator_has_no_origin(kind: str) -> None:
    """Its map of places shifted by one: the same material shifted by a quarter, if no level adds noise."""
    generator = made(kind).eval()
    for name, value in generator.named_parameters():
        if name.endswith("strength"):
            value.data.zero_()
    code = generator.draw(2, generator_at(4))
    places = code[:, generator.vector :].view(2, -1, 4, 4)  # pyright: ignore
    shifted = torch.cat([code[:, : generator.vector], places.roll((1, 2), (2, 3)).flatten(1)], 1)  # pyright: ignore
    with torch.no_grad():
        torch.testing.assert_close(generator(shifted), generator(code).roll((8, 16), (2, 3)), atol=1e-5, rtol=0)
        assert (generator(shifted) - generator(code)).abs().max() > 1e-3


def choosing(down: int, across: int) -> Waves:
    """Waves of so many cycles."""
    with seeded(0):
        waves = Waves(4, 5, cycles=8)
    waves.choice.weight.data.zero_()
    waves.choice.bias.data.zero_().view(2, 9)[[0, 1], [down, across]] = 100.0
    return waves


@pytest.mark.parametrize("times", [1, 3])
def test_waves_have_the_cycles_that_the_vector_chooses_and_texels_as_large(times: int) -> None:
    places = torch.randn(2, 3, 4 * times, 4 * times, generator=generator_at(0))
    with torch.no_grad():
        x = choosing(3, 5)(torch.zeros(2, 4), places, 32 * times, times)
    assert x.shape == (2, 5, 32 * times, 32 * times)
    spectrum = torch.fft.rfft2(x, norm="forward").abs()
    there = spectrum > 1e-3 * spectrum.amax((2, 3), keepdim=True)
    expected = torch.zeros_like(there)
    expected[:, :, [3 * times, -3 * times], 0] = expected[:, :, 0, 5 * times] = True
    assert torch.equal(there, expected)


def test_no_waves_can_be_chosen_and_every_choice_learns() -> None:
    places = torch.randn(2, 3, 4, 4, generator=generator_at(0))
    assert choosing(0, 0)(torch.zeros(2, 4), places, 32).abs().max() < 1e-6
    generator = made("waves")
    generator(generator.draw(4, generator_at(2))).square().sum().backward()
    waves = generator.waves
    assert isinstance(waves, Waves)
    for parameter in waves.parameters():
        assert (
            parameter.grad is not None and (parameter.grad.flatten(1) if parameter.dim() > 1 else parameter.grad).all()
        )


@pytest.mark.parametrize("cycles", [-1, 9])
def test_waves_of_less_than_two_pixels_are_refused(cycles: int) -> None:
    with pytest.raises(UserError, match=f"cycles={cycles}: give 0 to 8"):
        StationaryMaterials(size=16, channels=16, least=8, cycles=cycles)
    assert StationaryMaterials(size=16, channels=16, least=8, cycles=8).sample(1).isfinite().all()


def test_waves_begin_anywhere_with_equal_chance() -> None:
    """Where their phase is that of the map of places, which is drawn from a normal distribution."""
    places = torch.randn(4000, 1, 4, 4, generator=generator_at(1))
    with torch.no_grad():
        x = choosing(1, 1)(torch.zeros(4000, 4), places, 32)[:, 0]
    phase = torch.fft.fft(x.mean(2)).angle()[:, 1]
    counts = torch.histc(phase, 8, -math.pi, math.pi)
    assert (counts - 500).abs().max() < 5 * 500**0.5


def test_no_lattice_can_be_learned() -> None:
    """What the last convolution adds to one of the four that become a channel's neighbours, each of them gets."""
    generator = made("stationary").eval()
    before = generator.sample(2, seed=0)
    bias = generator.last.bias  # pyright: ignore
    bias.data += torch.tensor([1.0, -1.0, 0.5, -0.5]).repeat(len(bias) // 4)  # pyright: ignore
    torch.testing.assert_close(generator.sample(2, seed=0), before, atol=1e-5, rtol=0)


def test_relief_is_that_of_a_height() -> None:
    """Slopes of a height have no curl: with central differences, exactly."""
    slopes = made("stationary").sample(3, seed=1)[:, 5:].double()
    slope_x, slope_y = (-slopes[:, k] / slopes[:, 2] for k in range(2))
    curl = (slope_x.roll(1, 1) - slope_x.roll(-1, 1)) - (slope_y.roll(-1, 2) - slope_y.roll(1, 2))
    assert slope_x.std() > 1e-3 and curl.abs().max() < 1e-5


@pytest.mark.parametrize(("fields", "owned"), [(16, [4, 4, 4, 4]), (6, [2, 2, 1, 1]), (3, [1, 1, 1, 3])])
def test_each_map_begins_with_fields_of_its_own(fields: int, owned: list[int]) -> None:
    """Either way round: a field makes its map darker in some materials and lighter in others."""
    with seeded(0):
        generator = StationaryMaterials(16, channels=16, least=8, fields=fields)
        x, hidden = torch.randn(60, fields, 8, 8, requires_grad=True), torch.randn(60, 128)
    pulls = [torch.autograd.grad(m(x, hidden).sum(), x)[0].sum((2, 3)) for m in generator.branches.values()]
    uses = torch.stack([pull.abs().sum(0) > 0 for pull in pulls])
    assert uses.sum(1).tolist() == owned
    assert uses[: min(fields, 4)].sum(0).tolist() == [1] * fields
    lighter = torch.cat([(pull[:, used] > 0).float().mean(0) for pull, used in zip(pulls, uses, strict=True)])
    assert lighter.min() > 0.1 and lighter.max() < 0.9, lighter


def test_at_the_start_maps_have_as_much_contrast_as_of_all_fields() -> None:
    with seeded(0):
        generator = StationaryMaterials(16, channels=16, least=8)
        x = torch.randn(60, 16, 8, 8)
        branch, own = generator.branches["roughness"], torch.arange(16) < 4
        torch.nn.init.constant_(branch.mix.weight, 0.25)
        whole = branch.mix(x).std()
        branch.begin_with(own)
        assert 0.9 < branch.mix(x).std() / whole < 1.1


def test_a_moving_vector_moves_no_noise() -> None:
    """A material changes smoothly with its vector, and is another one with another map of places."""
    generator = made("stationary").eval()
    code = generator.draw(1, generator_at(5))
    near, other = code.clone(), code.clone()
    near[:, : generator.vector] += 1e-4  # pyright: ignore
    other[:, generator.vector :] += 1e-4  # pyright: ignore
    with torch.no_grad():
        x, close, far = (generator(c) for c in (code, near, other))
    assert (close - x).abs().max() < 1e-3 < (far - x).abs().max()


def test_a_stationary_generator_starts_as_a_flat_dielectric() -> None:
    with seeded(0):
        x = StationaryMaterials(64).sample(8, seed=0)
    mean = x.mean((0, 2, 3))
    found = torch.stack([mean[:3].mean(), mean[3], mean[4]])
    torch.testing.assert_close(found, torch.tensor([0.31, 0.05, 0.31]), atol=0.1, rtol=0)
    assert mean[7] > 0.9


@pytest.mark.parametrize("size", [8, 16, 256])
def test_a_stationary_generator_of_any_size(size: int) -> None:
    check_maps(StationaryMaterials(size, channels=16, least=8).sample(1, batch=1))


def test_noise_is_a_part_of_the_latent() -> None:
    generator = StationaryMaterials(size=16, channels=16, least=8)
    code = generator.draw(2, generator_at(0))
    latent = generator.map_code(code)
    assert torch.equal(generator.synthesise(latent), generator(code))
    assert generator.white == latent.shape[1] - generator.code_size
    moved = latent.clone()
    moved[:, generator.code_size :] = 0
    smooth, rough = generator.synthesise(moved), generator(code)
    assert smooth.var((2, 3)).sum() < rough.var((2, 3)).sum()


LARGE = 96
"""Three times the side of `made("stationary")`."""


def contrast(x: torch.Tensor, at: int) -> torch.Tensor:
    """Return the root mean square of the difference of texels that are `at` apart, over borders too, by channel."""
    differences = torch.stack([x - x.roll(at, axis) for axis in (2, 3)])
    return differences.square().mean((0, 1, 3, 4)).sqrt()


@TILING
def test_a_sample_of_another_size_is_the_same_material_with_texels_as_large(kind: str) -> None:
    generator = made(kind)
    own, large = generator.sample(12, seed=1), generator.sample(12, seed=1, size=LARGE)
    assert torch.equal(generator.sample(12, seed=1, size=32), own)
    assert large.shape == (12, 8, LARGE, LARGE)
    check_maps(large)
    torch.testing.assert_close(large.mean((2, 3)), own.mean((2, 3)), atol=0.02, rtol=0)
    for at in (1, 2, 4):
        torch.testing.assert_close(contrast(large, at), contrast(own, at), rtol=0.1, atol=1e-3)


@TILING
def test_a_large_sample_tiles(kind: str) -> None:
    large = made(kind).sample(8, seed=1, size=LARGE)[:, :7]
    for axis in (2, 3):
        steps = (large - large.roll(1, axis)).square().mean((0, 1, 5 - axis)).sqrt()
        assert steps[0] < 1.5 * steps[1:].mean()  # over the border, as within


def test_nothing_but_waves_repeats_within_a_large_sample() -> None:
    large = made("stationary").sample(8, seed=1, size=LARGE)[:, :7]
    fields = (large - large.mean((2, 3), keepdim=True)).flatten(0, 1)
    energy = fields.square().mean((1, 2))
    for shift in (32, 64):
        alike = (fields * fields.roll((shift, shift), (1, 2))).mean((1, 2)) / energy
        assert alike.mean().abs() < 0.1, alike


@pytest.mark.parametrize("size", [0, 16, 48])
def test_other_sizes_are_multiples(size: int) -> None:
    with pytest.raises(UserError, match="choose 32, or a multiple of it such as 128"):
        made("stationary").sample(1, size=size)


@pytest.mark.parametrize("lag", [189_447, 481_304, 670_751])
def test_noise_does_not_repeat(lag: int) -> None:
    """At these lags frac(sin), as in shaders, correlates by 0.34 to 0.97."""
    noise = white_noise(torch.randn(2, 4, generator=generator_at(0)), 1024)
    assert not torch.equal(noise[0], noise[1])
    flat = noise.flatten(1).double()
    assert (flat[:, lag:] * flat[:, :-lag]).mean(1).abs().max() < 0.01
    assert abs(flat.mean()) < 0.01 and abs(flat.std() - 1) < 0.01


def test_noise_is_not_its_own_mirror_image_and_differs_between_levels() -> None:
    codes = torch.randn(64, 4, generator=generator_at(1))
    fine, coarse = white_noise(codes, 64)[:, 0].double(), white_noise(codes, 32)[:, 0].double()
    for x in (fine, coarse):
        spectrum = torch.fft.rfft2(x)  # the correlation with the point mirror image, at every shift
        mirrored = torch.fft.irfft2(spectrum * spectrum, s=x.shape[1:]) / x[0].numel()
        assert mirrored.abs().max() < 0.3  # 0.17 to 0.22 by chance, by codes and so by processor; its own has 1
    assert abs((fine[:, :16].flatten(1) * coarse.flatten(1)).mean()) < 0.02
    assert torch.equal(white_noise(codes[:3], 32, 2), white_noise(codes, 32, 2)[:3])


def test_noise_of_large_maps_is_normal_where_codes_are() -> None:
    x = normal_noise(torch.randn(4, 10, generator=generator_at(3)), 64, 2).double()
    assert abs(x.mean()) < 0.02 and abs(x.std() - 1) < 0.02 and abs((x**4).mean() - 3) < 0.2


@pytest.mark.parametrize("kind", [DCGANMaterials, StationaryMaterials])
@pytest.mark.parametrize("width", [{"channels": 0}, {"channels": -1}, {"code_size": 0}])
def test_widths_below_one_are_refused(kind: type[Generator], width: dict[str, int]) -> None:
    with pytest.raises(UserError, match=f"{next(iter(width))}=.*; give at least 1"):
        kind(size=16, **width)


@EACH
def test_unproject_check_knows_the_range_of_maps(kind: str) -> None:
    assert [law.name for law in run_laws(made(kind)) if not law.passed] == []
