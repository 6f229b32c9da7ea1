"""Generators: the seed's structure level by level, the low-rank formula, and samples that depend on (seed, i) alone."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
import torch
from torch import Tensor, nn

from unproject._random import generator_at, seeded
from unproject._types import UserError
from unproject.networks import Generator, ImageGenerator, LowRankGenerator, SmoothImageGenerator, VoxelGenerator
from unproject.ops import visual_hull
from unproject.projections import LineIntegral
from unproject.testing import check_generator, run_laws

SMALL: dict[str, Callable[[], Generator]] = {
    "transposed": lambda: VoxelGenerator(16, 6, 16),
    "nearest": lambda: VoxelGenerator(16, 6, 16, upsampling="nearest"),
    "mirror": lambda: VoxelGenerator(16, 6, 16, mirror=True),
    "truncated": lambda: VoxelGenerator(16, 6, 16, truncation=0.75),
    "image": lambda: ImageGenerator(16, 6, 16),
    "colour": lambda: ImageGenerator(8, 6, 16, outputs=3),
    "smooth image": lambda: SmoothImageGenerator(16, 6, 16),
    "smooth image on a disc": lambda: SmoothImageGenerator(16, 6, 16, disc=True),
    "low-rank": lambda: LowRankGenerator(16, 6, 16, rank=3),
    "low-rank-mirror": lambda: LowRankGenerator(16, 6, 16, rank=3, mirror=True),
}


def build(make: Callable[[], Generator]) -> Generator:
    with seeded(0, "test"):
        return make()


def codes(generator: Generator, n: int = 3) -> Tensor:
    return generator.draw(n, generator_at(0, 0, "test"))


# The laws


@pytest.mark.parametrize("name", SMALL)
def test_generators_obey_the_laws(name: str) -> None:
    check_generator(build(SMALL[name]))


def test_statistics_of_the_batch_break_one_law_only() -> None:
    generator = build(lambda: VoxelGenerator(16, 6, 16, batch_statistics=True))
    assert [law.name for law in run_laws(generator) if not law.passed] == ["alone"]


# Sampling


@pytest.mark.parametrize("name", SMALL)
def test_a_sample_depends_on_neither_n_nor_batch(name: str) -> None:
    generator = build(SMALL[name])
    samples = generator.sample(5, seed=3, batch=4)
    assert torch.equal(samples[:2], generator.sample(2, seed=3, batch=4))
    torch.testing.assert_close(samples[:3], generator.sample(3, seed=3, batch=2))
    assert not torch.equal(samples[0], samples[1])


def test_with_statistics_of_the_batch_a_sample_depends_on_the_batch_but_not_on_n() -> None:
    generator = build(lambda: VoxelGenerator(16, 6, 16, batch_statistics=True))
    samples = generator.sample(5, seed=3, batch=4)
    assert torch.equal(samples[:2], generator.sample(2, seed=3, batch=4))
    assert torch.equal(samples, generator.sample(5, seed=3, batch=4))
    assert (samples[:2] - generator.sample(2, seed=3, batch=2)).abs().max() > 1e-3


def test_no_samples_are_an_empty_batch() -> None:
    assert build(SMALL["low-rank"]).sample(0).shape == (0, 16, 16, 16)


@pytest.mark.parametrize(("n", "batch"), [(-5, 64), (2, 0)])
def test_numbers_of_samples_that_are_none_are_refused(n: int, batch: int) -> None:
    with pytest.raises(UserError, match=f"{n} samples, {batch} at once: give 0 or more, and 1 or more at once"):
        build(SMALL["low-rank"]).sample(n, batch=batch)


@pytest.mark.parametrize("training", [True, False])
def test_sampling_leaves_the_mode_and_the_statistics(training: bool) -> None:
    generator = build(SMALL["transposed"]).train(training)
    before = {name: value.clone() for name, value in generator.state_dict().items()}
    generator.sample(2)
    assert generator.training is training
    assert all(torch.equal(value, before[name]) for name, value in generator.state_dict().items())


class Failing(Generator):
    def __init__(self) -> None:
        super().__init__(code_size=4)
        self.weight = nn.Parameter(torch.ones(()))

    def forward(self, code: Tensor) -> Tensor:
        assert not self.training
        raise RuntimeError("out of memory")


def test_the_mode_is_restored_after_a_failure() -> None:
    generator = Failing().train()
    with pytest.raises(RuntimeError, match="out of memory"):
        generator.sample(1)
    assert generator.training


class Codes(Failing):
    """Shows its codes."""

    def forward(self, code: Tensor) -> Tensor:
        return code


def test_codes_are_normal() -> None:
    drawn = Codes().sample(2000)
    assert abs(drawn.mean()) < 0.05 and abs(drawn.var() - 1) < 0.05


def test_truncated_codes_are_a_truncated_normal() -> None:
    generator, a = Codes(), 0.75
    generator.truncation = a
    drawn = generator.sample(2000)
    mass = math.erf(a / math.sqrt(2))
    variance = 1 - 2 * a * math.exp(-(a**2) / 2) / math.sqrt(2 * math.pi) / mass
    assert drawn.abs().max() <= a * (1 + 1e-6)
    assert drawn.var().item() == pytest.approx(variance, rel=0.05)
    assert generator.draw(100, generator_at(0)).abs().max() > a, "training does not truncate"


def test_samples_of_a_generator_with_a_hull_are_filled() -> None:
    """Hollows that no level view sees into are filled when sampling, not in training."""
    plain = build(lambda: LowRankGenerator(16, 6, 16, rank=3, bias=0.0)).eval()
    filled = build(lambda: LowRankGenerator(16, 6, 16, rank=3, bias=0.0, hull=True)).eval()
    assert torch.equal(filled.sample(2), visual_hull(plain.sample(2)))
    assert not torch.equal(filled.sample(2), plain.sample(2))
    assert torch.equal(filled(codes(filled)), plain(codes(plain)))


# The seed's generator


def level_shapes(generator: VoxelGenerator) -> list[tuple[int, ...]]:
    """(channels, side, side, side) after every ReLU, then after the last convolution."""
    shapes: list[tuple[int, ...]] = []
    for module in generator.levels:
        if isinstance(module, (nn.ReLU, nn.Conv3d)):
            module.register_forward_hook(lambda m, x, y: shapes.append(tuple(y.shape[1:])))
    generator(torch.empty(2, generator.code_size, device="meta"))
    return shapes


@pytest.mark.parametrize("upsampling", ["transposed", "nearest"])
def test_the_seeds_structure(upsampling: str) -> None:
    with torch.device("meta"):
        generator = VoxelGenerator(64, upsampling=upsampling)
    cubes = [(512, 4), (256, 8), (128, 16), (64, 32), (32, 64), (1, 64)]
    assert level_shapes(generator) == [(channels, side, side, side) for channels, side in cubes]


@pytest.mark.parametrize("upsampling", ["transposed", "nearest"])
def test_batch_norm_and_relu_follow_every_convolution_but_the_last(upsampling: str) -> None:
    layers = list(VoxelGenerator(32, 4, 8, upsampling=upsampling).levels)
    doubling = nn.ConvTranspose3d if upsampling == "transposed" else nn.Sequential
    expected = [nn.BatchNorm3d, nn.ReLU, *[doubling, nn.BatchNorm3d, nn.ReLU] * 3, nn.Conv3d]
    assert [type(layer) for layer in layers] == expected


def test_an_unknown_upsampling_is_refused() -> None:
    with pytest.raises(UserError, match="'bicubic': choose 'transposed' or 'nearest'"):
        VoxelGenerator(16, upsampling="bicubic")


@pytest.mark.parametrize("upsampling", ["transposed", "nearest"])
def test_32_voxels_in_the_range(upsampling: str) -> None:
    generator = build(lambda: VoxelGenerator(32, 6, 16, upsampling=upsampling)).eval()
    list(generator.levels.parameters())[-2].data *= 1000
    x = generator(codes(generator))
    assert x.shape == (3, 32, 32, 32)
    assert 0 <= x.min() < 0.01 and 0.99 < x.max() <= 1


@pytest.mark.parametrize("name", ["mirror", "low-rank-mirror"])
def test_mirrored_volumes_are_exactly_symmetric(name: str) -> None:
    x = build(SMALL[name]).sample(3)
    assert torch.equal(x, x.flip(1))
    assert not torch.equal(x, x.flip(2)) and not torch.equal(x, x.flip(3))


@pytest.mark.parametrize("name", ["transposed", "low-rank"])
def test_others_are_not_symmetric(name: str) -> None:
    x = build(SMALL[name]).sample(3)
    assert not torch.allclose(x, x.flip(1), atol=1e-5)


def test_the_mirror_keeps_the_left_half() -> None:
    plain = build(lambda: VoxelGenerator(16, 6, 16))
    mirrored = build(lambda: VoxelGenerator(16, 6, 16, mirror=True))
    assert torch.equal(plain.sample(2)[:, :8], mirrored.sample(2)[:, :8])


# The low-rank generator


@pytest.mark.parametrize("mirror", [False, True])
def test_the_low_rank_formula(mirror: bool) -> None:
    rank = 3
    generator = build(lambda: LowRankGenerator(8, 4, 8, rank, mirror, bias=-2.5, limit=4.0)).double().eval()
    code = codes(generator, 2).double()
    hidden = generator.mapping(code)
    xz, zy, xy = (plane(hidden) for plane in generator.planes)
    line_y, line_x, line_z = (line(hidden) for line in generator.lines)
    total = torch.zeros(2, 4 if mirror else 8, 8, 8, dtype=torch.float64)
    for r in range(rank):
        total += torch.einsum("bxz,by->bxyz", xz[:, r], line_y[:, r])
        total += torch.einsum("bzy,bx->bxyz", zy[:, r], line_x[:, r])
        total += torch.einsum("bxy,bz->bxyz", xy[:, r], line_z[:, r])
    total = torch.cat([total, total.flip(1)], 1) if mirror else total
    t = -2.5 + total / math.sqrt(rank)
    torch.testing.assert_close(generator(code), torch.sigmoid(t / (1 + (t / 4.0) ** 2).sqrt()))


def test_volumes_that_vanished_have_a_gradient_that_brings_them_back() -> None:
    """With unlimited logits a sigmoid has none."""
    generator = build(lambda: LowRankGenerator(16, 6, 16, rank=3, bias=-500.0, limit=5.0)).eval()
    assert 0.006 < generator(codes(generator)).mean() < 0.007
    generator(codes(generator)).sum().backward()
    # 0.01 times the mean square of what |t| has beyond 15, against which the gradient of the sum is nothing.
    assert generator.bias.grad is not None
    torch.testing.assert_close(generator.bias.grad, torch.tensor(-2 * 0.01 * 485), rtol=1e-2, atol=0)


@pytest.mark.parametrize("limit", [0.0, -1.0, math.nan])
def test_limits_that_are_not_positive_are_refused(limit: float) -> None:
    with pytest.raises(UserError, match=r"LowRankGenerator\(limit=.*must be positive"):
        LowRankGenerator(8, limit=limit)


@pytest.mark.parametrize("size", [32, 64, 128])
def test_sizes_of_the_low_rank_generator(size: int) -> None:
    generator = build(lambda: LowRankGenerator(size, 4, 16, rank=4))
    with torch.no_grad():
        x = generator.eval()(codes(generator, 1))
    assert x.shape == (1, size, size, size) and x.isfinite().all()


def test_training_starts_from_nearly_transparent_volumes() -> None:
    start = build(lambda: LowRankGenerator(32, channels=32))
    unbiased = build(lambda: LowRankGenerator(32, channels=32, bias=0))
    with torch.no_grad():
        assert start(codes(start, 8)).mean() < 0.03
        assert unbiased(codes(unbiased, 8)).mean() > 0.3


def factor_elements(size: int, rank: int) -> int:
    """How many numbers the planes and lines of one volume hold."""
    with torch.device("meta"):
        generator = LowRankGenerator(size, rank=rank).eval()
    counts: list[int] = []
    for module in (*generator.planes, *generator.lines):
        module.register_forward_hook(lambda m, x, y: counts.append(y.numel()))
    assert generator(torch.empty(1, 128, device="meta")).numel() == size**3
    return sum(counts)


def test_the_factors_grow_with_the_square_and_the_volume_with_the_cube() -> None:
    assert factor_elements(64, 32) == 3 * 32 * (64**2 + 64)
    assert factor_elements(128, 32) / 128**3 < 0.8
    assert factor_elements(256, 32) / factor_elements(128, 32) == pytest.approx(4, rel=0.01)


# Images


@pytest.mark.parametrize("kind", [ImageGenerator, SmoothImageGenerator])
@pytest.mark.parametrize("size, outputs", [(8, 1), (16, 3), (32, 1)])
def test_images_of_any_size(kind: type[ImageGenerator | SmoothImageGenerator], size: int, outputs: int) -> None:
    x = build(lambda: kind(size, 6, 16, outputs)).sample(2)
    assert x.shape == (2, outputs, size, size) and x.min() >= 0 and x.max() <= 1


@pytest.mark.parametrize("kind", [ImageGenerator, SmoothImageGenerator])
def test_images_start_dark(kind: type[ImageGenerator | SmoothImageGenerator]) -> None:
    assert build(lambda: kind(16, 6, 16)).sample(8).mean() < 0.2


def test_smooth_images_start_without_a_checkerboard() -> None:
    """Its frequency, the highest of both axes, has no more power than the others; of transposed convolutions it has."""

    def share(kind: type[ImageGenerator | SmoothImageGenerator], seed: int) -> float:
        with seeded(seed, "weights"):
            generator = kind(32, 16, 64)
        power = torch.fft.fft2(generator.sample(64)).abs().square().mean((0, 1))
        return (power[16, 16] / power[1:, 1:].mean()).item()

    assert max(share(SmoothImageGenerator, seed) for seed in range(5)) < 1.5
    assert max(share(ImageGenerator, seed) for seed in range(5)) > 50


def test_the_seeds_channels_halve_with_every_doubling() -> None:
    layers = [m for m in build(lambda: ImageGenerator(32, 6, 64)).modules() if isinstance(m, nn.ConvTranspose2d)]
    assert [(m.in_channels, m.out_channels) for m in layers] == [(64, 32), (32, 16), (16, 8)]


# Other sizes


def rough(mirror: bool | str = False, hull: bool = False) -> LowRankGenerator:
    """A generator of volumes that are neither empty nor full, whose logits vary from voxel to voxel."""
    generator = build(lambda: LowRankGenerator(16, 6, 16, rank=3, mirror=mirror, bias=0.0, hull=hull))
    assert isinstance(generator, LowRankGenerator)
    for factor in (*generator.planes, *generator.lines):
        factor.last.weight.data *= 40
    return generator.eval()


def blocks(x: Tensor, times: int) -> Tensor:
    """(B, X, Y, Z) as (B, X / t, Y / t, Z / t, t³)."""
    parts = x.unfold(1, times, times).unfold(2, times, times).unfold(3, times, times)
    return parts.flatten(4)


@pytest.mark.parametrize("times", [1, 2, 3, 4])
@pytest.mark.parametrize("mirror", [False, "x", "z"])
def test_finer_sums_average_to_the_sums(mirror: bool | str, times: int) -> None:
    generator = rough(mirror).double()
    code = codes(generator).double()
    hidden = generator.mapping(code)
    fine, coarse = generator.sums(hidden, times), generator.sums(hidden)
    assert coarse.std() > 0.5 and (times == 1 or fine.std() > coarse.std())
    torch.testing.assert_close(blocks(fine, times).mean(-1), coarse)


@pytest.mark.parametrize("times", [2, 4])
@pytest.mark.parametrize("mirror", [False, "x", "z"])
def test_finer_samples_average_to_the_sample(mirror: bool | str, times: int) -> None:
    """Within half the largest |p''| times the variance of t, by Taylor's theorem."""
    generator = rough(mirror)
    fine = blocks(generator.sample(3, seed=4, size=16 * times), times)
    logits = fine.double().logit()
    t = logits / (1 - (logits / 10) ** 2).sqrt()
    off = (fine.mean(-1) - generator.sample(3, seed=4)).abs()
    assert (off <= 0.049 * t.var(-1, correction=0) + 1e-5).all()
    assert off.mean() < 0.005 and generator.sample(3, seed=4).std() > 0.05


def test_the_finer_sample_is_not_the_repeated_one() -> None:
    generator = rough()
    repeated = generator.sample(2).repeat_interleave(2, 1).repeat_interleave(2, 2).repeat_interleave(2, 3)
    assert (generator.sample(2, size=32) - repeated).abs().mean() > 0.005


@pytest.mark.parametrize("mirror, axis", [("x", 1), ("z", 3)])
def test_finer_samples_are_exactly_symmetric(mirror: str, axis: int) -> None:
    x = rough(mirror).sample(2, size=48)
    assert x.shape == (2, 48, 48, 48) and torch.equal(x, x.flip(axis))


def test_the_own_size_is_the_sample() -> None:
    generator = rough()
    assert torch.equal(generator.sample(3, seed=1, size=16), generator.sample(3, seed=1))


def test_finer_samples_have_their_own_hull() -> None:
    assert torch.equal(rough(hull=True).sample(2, size=32), visual_hull(rough().sample(2, size=32)))


def test_a_finer_sample_depends_on_neither_n_nor_batch() -> None:
    generator = rough()
    samples = generator.sample(5, seed=3, batch=4, size=32)
    assert torch.equal(samples[:2], generator.sample(2, seed=3, batch=4, size=32))
    torch.testing.assert_close(samples[:3], generator.sample(3, seed=3, batch=2, size=32))


@pytest.mark.parametrize("size, most", [(16, 64), (64, 64), (128, 8), (256, 1)])
def test_finer_samples_are_made_a_few_at_a_time(monkeypatch: pytest.MonkeyPatch, size: int, most: int) -> None:
    """So that 128³ takes no more memory than 64 samples of 64³ do."""
    seen: list[int] = []

    def noted(self: Generator, code: Tensor, size: int) -> Tensor:
        seen.append(len(code))
        return torch.zeros(len(code), 1, 1, 1)

    monkeypatch.setattr(LowRankGenerator, "at_size", noted)
    assert len(rough().sample(70, size=size)) == 70
    assert set(seen) == {most} and 70 <= sum(seen) < 70 + most


@pytest.mark.parametrize("size", [8, 15, 24, 0, -16])
def test_sizes_that_are_no_multiple_are_refused(size: int) -> None:
    with pytest.raises(UserError, match=f"size {size}: choose 16, or a multiple of it such as 32"):
        rough().sample(1, size=size)


@pytest.mark.parametrize("name", ["transposed", "image"])
def test_other_generators_have_one_size(name: str) -> None:
    with pytest.raises(UserError, match="makes samples of one size; leave size out"):
        build(SMALL[name]).sample(1, size=32)


def test_fog_is_as_opaque_at_every_size() -> None:
    """Twice as fine voxels absorb half as much each."""
    with seeded(0, "test"):
        generator = LowRankGenerator(16, 6, 16, rank=3, bias=-4.3, hull=2.0)
    coarse, fine = generator.sample(4, seed=1), generator.sample(4, seed=1, size=32)
    assert coarse.mean() > 0.1
    torch.testing.assert_close(fine.mean(), coarse.mean(), rtol=0.1, atol=0)


@pytest.mark.parametrize("make", [VoxelGenerator, ImageGenerator])
def test_few_channels_are_enough(make: type[Generator]) -> None:
    assert make(size=16, channels=3).sample(2).shape[0] == 2  # pyright: ignore[reportCallIssue]


@pytest.mark.parametrize("size", [8, 16, 32])
def test_on_a_disc_every_direction_sees_the_whole_image(size: int) -> None:
    """Line integrals have the image's mass in any direction; without, up to a fifth of it lies in corners."""
    on_disc, whole = (SmoothImageGenerator(size, 6, 16, bias=2.0, disc=disc) for disc in (True, False))
    on_disc.load_state_dict(whole.state_dict())
    x, y = on_disc.sample(2, seed=1), whole.sample(2, seed=1)
    assert torch.equal(x[0, 0, size // 2], y[0, 0, size // 2]) and float(x[0, 0, 0, 0]) == 0 < float(y[0, 0, 0, 0])
    angle = torch.linspace(0, math.pi, 13)
    for image, same in ((x[:1], True), (y[:1], False)):
        mass = LineIntegral()(image.expand(13, -1, -1, -1), angle=angle).sum((1, 2))
        assert bool(torch.allclose(mass, mass[:1], rtol=0.02)) == same
