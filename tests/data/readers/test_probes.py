"""Light probes: what is read is what was stored, a change of size keeps the light, and what is no light is refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from unproject._pictures import write_picture
from unproject._types import UserError
from unproject.data import daylight_probes, mixed_probes, procedural_probes, read_probe, read_probes, resample_probe
from unproject.data.readers.probes import directions, find_probes
from unproject.ops.environment import solid_angles

MEASURED = Path(__file__).parents[4] / "shared" / "data" / "hdr" / "probes45_128x64.npz"
GRADED = np.random.default_rng(0).gamma(0.3, 3.0, (16, 32, 3)).astype(np.float32)


def energy(probe: Tensor) -> Tensor:
    """(..., 3) Σ L dΩ of every channel."""
    return (probe.double() * solid_angles(*probe.shape[-2:])).sum((-2, -1))


def irradiance(probe: Tensor, normal: tuple[float, float, float] = (0, 0, 1)) -> Tensor:
    """(..., 3) E = Σ L cos θ dΩ on a surface with this normal."""
    d = directions(*probe.shape[-2:])
    cosine = torch.einsum("chw,c->hw", d, torch.tensor(normal, dtype=torch.float64)).clamp(min=0)
    return (probe.double() * cosine * solid_angles(*probe.shape[-2:])).sum((-2, -1))


def saved(path: Path, pixels: np.ndarray) -> Path:
    np.save(path, pixels)
    return path


# ------------------------------------------------------------------------------------------------ the frame and energy


def test_solid_angles_cover_the_sphere_and_directions_start_at_the_normal() -> None:
    omega, d = solid_angles(64, 128), directions(64, 128)
    assert omega.sum().item() == pytest.approx(4 * math.pi, rel=1e-12)
    assert (d.norm(dim=0) - 1).abs().max() < 1e-12
    assert d[2, 0].min() > 0.999 and d[2, -1].max() < -0.999
    assert (d[0, 32, 0], d[1, 32, 32]) == (pytest.approx(1, abs=1e-3), pytest.approx(1, abs=1e-3))  # x, then y


@pytest.mark.parametrize("height", [8, 7, 5, 16, 64, 1, 37])
def test_resampling_keeps_the_energy_of_every_channel(height: int) -> None:
    probe = torch.from_numpy(GRADED).movedim(2, 0)
    smaller = resample_probe(probe, height)
    assert smaller.shape == (3, height, 2 * height) and smaller.dtype == torch.float32
    assert ((energy(smaller) - energy(probe)) / energy(probe)).abs().max() < 1e-5


def test_a_plain_mean_of_pixels_would_not_keep_it() -> None:
    probe = torch.from_numpy(GRADED).movedim(2, 0)
    mean = torch.nn.functional.avg_pool2d(probe, 4)
    assert ((energy(mean) - energy(probe)) / energy(probe)).abs().max() > 1e-3


def test_halving_weights_rows_with_their_solid_angle() -> None:
    probe = torch.tensor([1.0, 3.0, 0.0, 0.0])[None, :, None].expand(3, 4, 8)
    pole, ring = 1 - math.sqrt(0.5), math.sqrt(0.5)  # shares of the upper hemisphere above and below 45°
    halved = resample_probe(probe, 2)
    assert halved[0, 0].tolist() == pytest.approx([pole * 1 + ring * 3] * 4, rel=1e-6)
    assert halved[0, 1].abs().max() == 0


def test_a_source_stays_in_its_column_and_row() -> None:
    probe = torch.zeros(3, 8, 16)
    probe[:, 2, 5] = 1
    smaller = resample_probe(probe, 4)
    assert smaller[0].nonzero().tolist() == [[1, 2]]
    assert resample_probe(probe, 16)[0].nonzero().tolist() == [[4, 10], [4, 11], [5, 10], [5, 11]]


def test_constant_light_stays_constant_and_the_same_size_is_left_alone() -> None:
    probe = torch.full((2, 3, 12, 24), 0.7)
    assert resample_probe(probe, 12) is probe
    assert (resample_probe(probe, 31) - 0.7).abs().max() < 1e-6


# ------------------------------------------------------------------------------------------------------------- reading


@pytest.mark.parametrize("suffix, tolerance", [("hdr", 1e-2), ("exr", 0.0)])
def test_radiance_is_read_as_stored(tmp_path: Path, suffix: str, tolerance: float) -> None:
    write_picture(tmp_path / f"a.{suffix}", 3000 * GRADED, "float")
    probe = read_probe(tmp_path / f"a.{suffix}")
    assert probe.shape == (3, 16, 32) and probe.dtype == torch.float32
    difference = np.abs(np.moveaxis(probe.numpy(), 0, 2) - 3000 * GRADED).max(-1)
    assert (difference <= tolerance * 3000 * GRADED.max(-1)).all()


def test_the_top_row_of_the_file_is_the_normal(tmp_path: Path) -> None:
    pixels = np.zeros((4, 8, 3), np.float32)
    pixels[0] = 1
    assert read_probe(saved(tmp_path / "a.npy", pixels))[0, 0].tolist() == [1] * 8


@pytest.mark.parametrize("channels", [1, 2, 4])
def test_alpha_is_dropped_and_one_channel_repeated(tmp_path: Path, channels: int) -> None:
    pixels = np.dstack([GRADED[..., : 3 if channels > 2 else 1], np.full((16, 32), 0.5, np.float32)])
    pixels = pixels[..., :channels]
    write_picture(tmp_path / "a.exr", pixels, "float")
    for path in (tmp_path / "a.exr", saved(tmp_path / "a.npy", pixels)):
        probe = read_probe(path).numpy()
        assert np.array_equal(
            probe, np.moveaxis(np.broadcast_to(pixels[..., : max(1, channels - 1)], (16, 32, 3)), 2, 0)
        )


def test_a_height_resamples_to_twice_as_wide(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.npy", GRADED.astype(np.float64))
    probe = read_probe(path, 8)
    assert probe.shape == (3, 8, 16)
    assert torch.allclose(energy(probe), energy(read_probe(path)), rtol=1e-5)


def test_tiny_negatives_are_noise(tmp_path: Path) -> None:
    pixels = GRADED.copy()
    pixels[3, 3] = -5e-4 * pixels.max()
    assert read_probe(saved(tmp_path / "a.npy", pixels))[:, 3, 3].tolist() == [0, 0, 0]


def spoilt(value: float) -> np.ndarray:
    pixels = GRADED.copy()
    pixels[2, 3, 1] = value
    return pixels


@pytest.mark.parametrize(
    "pixels, reason",
    [
        (spoilt(np.nan), "1 values that are NaN"),
        (spoilt(np.inf), "infinite"),
        (spoilt(1.0).astype(np.float64) * 1e200, "over float32"),
        (spoilt(-50.0), "negative"),
        (-GRADED, "negative"),
        (np.zeros((4, 8, 3), np.float32), "black everywhere"),
        (np.ones((8, 8, 3), np.float32), "8 × 8 pixels"),
        (np.ones((4, 16, 3), np.float32), "twice as wide"),
        (np.ones((3, 16, 32), np.float32), "light probe|lat-long"),
        (np.ones((16, 32, 7), np.float32), "shape"),
        (np.ones((1, 2, 4, 3), np.float32), "shape"),
        (np.ones(7, np.float32), "shape"),
        (np.full((4, 8, 3), 200, np.uint8), "uint8 values, not linear"),
        (np.array([{"a": 1}], dtype=object), "Python objects"),
    ],
)
def test_what_is_no_radiance_is_one_line_with_the_file(tmp_path: Path, pixels: np.ndarray, reason: str) -> None:
    np.save(tmp_path / "bad.npy", pixels, allow_pickle=pixels.dtype == object)
    with pytest.raises(UserError, match=reason) as error:
        read_probe(tmp_path / "bad.npy")
    assert "bad.npy" in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("depth", ["uint8", "uint16"])
@pytest.mark.parametrize("name", ["a.png", "renamed.exr"])
def test_pictures_for_screens_are_refused(tmp_path: Path, depth: str, name: str) -> None:
    write_picture(tmp_path / "a.png", GRADED / GRADED.max(), depth)  # pyright: ignore[reportArgumentType]
    (tmp_path / "a.png").rename(tmp_path / name)
    with pytest.raises(UserError, match="not linear radiance"):
        read_probe(tmp_path / name)


def test_missing_and_damaged_files_and_odd_heights_are_refused(tmp_path: Path) -> None:
    (tmp_path / "damaged.npy").write_bytes(b"\x93NUMPY\x01\x00rubbish")
    for name in ("nowhere.hdr", "nowhere.npy", "nowhere.png", "damaged.npy"):
        with pytest.raises(UserError, match=name):
            read_probe(tmp_path / name)
    for path in (tmp_path, tmp_path / "a.npz"):
        np.savez(tmp_path / "a.npz", probes=GRADED)
        with pytest.raises(UserError, match="several light probes"):
            read_probe(path)
    with pytest.raises(UserError, match="height of 0"):
        read_probe(saved(tmp_path / "a.npy", GRADED), 0)
    with pytest.raises(UserError, match="cannot have 0 rows; give at least 1"):
        resample_probe(torch.ones(3, 2, 4), 0)


# --------------------------------------------------------------------------------------------------------- collections


def test_a_folder_is_read_in_order_and_to_one_height(tmp_path: Path) -> None:
    write_picture(tmp_path / "b.exr", GRADED, "float")
    (tmp_path / "sub").mkdir()
    saved(tmp_path / "sub" / "c.npy", GRADED[::2, ::2])
    saved(tmp_path / "a.npy", GRADED)
    saved(tmp_path / ".hidden.npy", GRADED)
    (tmp_path / "notes.txt").write_text("no probe")
    probes, names = read_probes(tmp_path)
    assert names == ["a.npy", "b.exr", "sub/c.npy"]
    assert probes.shape == (3, 3, 8, 16)  # the lowest of their heights
    assert torch.equal(probes[0], probes[1])
    assert read_probes(tmp_path, 32)[0].shape == (3, 3, 32, 64)


def test_one_bad_file_is_named_and_skipped_unless_strict(tmp_path: Path) -> None:
    saved(tmp_path / "a.npy", GRADED)
    saved(tmp_path / "bad.npy", spoilt(np.nan))
    with pytest.warns(UserWarning, match=r"1 of 2 light probes skipped.*bad\.npy: has 1 values"):
        probes, names = read_probes(tmp_path)
    assert names == ["a.npy"] and len(probes) == 1
    assert [name for name, _ in find_probes(tmp_path).skipped] == ["bad.npy"]
    with pytest.raises(UserError, match=r"bad\.npy"):
        read_probes(tmp_path, strict=True)
    saved(tmp_path / "a.npy", -GRADED)
    with pytest.raises(UserError, match=r"none of the 2 light probes.*negative"):
        read_probes(tmp_path)


def test_a_single_file_is_a_collection_of_one(tmp_path: Path) -> None:
    assert read_probes(saved(tmp_path / "a.npy", GRADED))[1] == ["a.npy"]
    with pytest.raises(UserError, match="NaN"):
        read_probes(saved(tmp_path / "b.npy", spoilt(np.nan)))


def test_an_archive_of_probes(tmp_path: Path) -> None:
    stack = np.stack([GRADED, 2 * GRADED])
    np.savez(tmp_path / "a.npz", probes=stack, names=np.array(["one", "two"]))
    probes, names = read_probes(tmp_path / "a.npz", 8)
    assert names == ["one", "two"] and probes.shape == (2, 3, 8, 16)
    assert torch.allclose(probes[1], 2 * probes[0])
    np.savez(tmp_path / "b.npz", probes=stack)
    assert read_probes(tmp_path / "b.npz")[1] == ["00000", "00001"]


def test_bad_archives_say_why(tmp_path: Path) -> None:
    def refused(match: str, **arrays: np.ndarray) -> None:
        np.savez(tmp_path / "a.npz", **arrays)  # pyright: ignore[reportArgumentType]
        with pytest.raises(UserError, match=match):
            read_probes(tmp_path / "a.npz")

    refused(r"holds lights \(16, 32, 3\); save", lights=GRADED)
    refused(r"names \(1,\) for 2 probes", probes=np.stack([GRADED] * 2), names=np.array(["one"]))
    refused("none of the 2 .* uint8", probes=np.ones((2, 4, 8, 3), np.uint8))
    with pytest.raises(UserError, match="holds no light probe"):
        (tmp_path / "empty").mkdir()
        read_probes(tmp_path / "empty")


@pytest.mark.skipif(not MEASURED.is_file(), reason="the measured probes are not beside this checkout")
def test_the_measured_probes() -> None:
    probes, names = read_probes(MEASURED, 16)
    assert probes.shape == (45, 3, 16, 32) and "venice" in names
    assert torch.allclose(energy(probes), energy(read_probes(MEASURED)[0]), rtol=1e-5)


# ---------------------------------------------------------------------------------------------------------- procedural


@pytest.fixture(scope="module")
def made() -> dict[str, Tensor]:
    probes, names = procedural_probes(64)
    return dict(zip(names, probes))


def test_procedural_probes_are_radiance_and_always_the_same(made: dict[str, Tensor]) -> None:
    assert [*made] == ["sky", "overcast", "studio", "window", "night"]
    for name, probe in made.items():
        assert probe.shape == (3, 64, 128) and probe.dtype == torch.float32, name
        assert probe.isfinite().all() and probe.min() > 0, name
        upper, lower = irradiance(probe), irradiance(probe, (0, 0, -1))
        assert (upper > 2 * lower).all(), f"{name}: the light comes from above"
    assert torch.equal(procedural_probes(64)[0][4], made["night"])


def test_they_light_a_surface_the_same_at_every_height(made: dict[str, Tensor]) -> None:
    for name, probe in zip(made, procedural_probes(24)[0]):
        assert torch.allclose(energy(probe), energy(made[name]), rtol=0.01), name


def test_the_overcast_sky_is_the_cies(made: dict[str, Tensor]) -> None:
    """E = 7π/9 of the zenith's radiance, and three times as bright there as at the horizon."""
    probe = made["overcast"]
    zenith = torch.tensor([0.94, 0.98, 1.0], dtype=torch.float64)
    assert torch.allclose(irradiance(probe), 7 * math.pi / 9 * zenith, rtol=2e-3)
    assert torch.allclose(probe[:, 0, 0] / probe[:, 31, 0], torch.tensor(3.0), rtol=0.06)
    assert probe.std(2).max() < 1e-6


def test_the_suns_strength_is_a_suns(made: dict[str, Tensor]) -> None:
    probe = made["sky"]
    row, column = divmod(int(probe.sum(0).argmax()), 128)
    assert (row + 0.5) * 180 / 64 == pytest.approx(35, abs=3)
    assert (column + 0.5) * 360 / 128 == pytest.approx(120, abs=3)
    d = directions(64, 128)
    near = torch.einsum("chw,c->hw", d, d[:, row, column]) > math.cos(math.radians(7))
    without = probe * ~near
    assert 1000 < probe.max() / without[:, :32].mean() < 10000
    assert 4 < irradiance(probe).sum() / irradiance(without).sum() < 7
    assert (without[2, :32] >= without[0, :32]).all(), "the sky is blue"
    assert without[1, 30].mean() > without[1, 12].mean(), "brighter towards the horizon"


def test_lamps_are_warm_the_moon_is_not_and_the_night_is_dark(made: dict[str, Tensor]) -> None:
    night, sky = made["night"], made["sky"]
    assert irradiance(night).mean() < 0.02 * irradiance(sky).mean()
    lamps = night[:, 24:31].flatten(1)
    red, _, blue = lamps[:, lamps.sum(0).argmax()]
    assert red > 2 * blue
    assert night[2, :10].mean() > 2 * night[0, :10].mean()


@pytest.mark.parametrize("height", [0, 1, 4096])
def test_procedural_heights_are_checked(height: int) -> None:
    with pytest.raises(UserError, match=f"height of {height}"):
        procedural_probes(height)


def test_mixed_probes_are_many_different_lights_of_one_strength() -> None:
    probes = mixed_probes(6, 16, seed=1)
    assert probes.shape == (6, 3, 16, 32) and probes.isfinite().all() and probes.min() >= 0
    assert torch.equal(mixed_probes(3, 16, seed=1), probes[:3]) and not torch.equal(mixed_probes(3, 16), probes[:3])
    assert torch.cdist(probes.flatten(1), probes.flatten(1)).add(torch.eye(6) * 99).min() > 1
    cosine = directions(16, 32)[2].clamp(min=0).float()
    irradiance = (probes.mean(1) * cosine * solid_angles(16, 32).float()).sum((1, 2))
    torch.testing.assert_close(irradiance, torch.full((6,), math.pi), rtol=0.25, atol=0)


def test_daylight_is_one_source_and_the_same_light_from_everywhere() -> None:
    """By the formula: π (1 - s) from everywhere and π s from the source on a surface that faces it."""
    probes = daylight_probes(16, 32)
    assert probes.shape == (16, 3, 32, 64) and probes.isfinite().all() and probes.min() >= 0
    assert torch.equal(daylight_probes(3, 32), probes[:3]) and torch.equal(probes[0], torch.ones(3, 32, 64))
    total = energy(probes)[:, 0] / math.pi  # 4 (1 - s) + s
    share = (4 - total) / 3
    assert share.min() >= -1e-3 and share.max() > 0.9 and 0.65 < share.mean() < 0.8
    torch.testing.assert_close(probes.amin((1, 2, 3)).double(), 1 - share, atol=0.05, rtol=0)


def shading(probes: Tensor) -> Tensor:
    """Deciles 1, 5 and 9 of |ln E₊/E₋| over probes and turns, of slopes of 24° that face each other."""
    tilt, turns = math.radians(24), torch.arange(0, 360, 15).deg2rad().tolist()
    normals = [(math.sin(tilt) * math.cos(a), math.sin(tilt) * math.sin(a), math.cos(tilt)) for a in turns]
    ratios = [
        irradiance(probes, (x, y, z)).mean(-1).log() - irradiance(probes, (-x, -y, z)).mean(-1).log()
        for x, y, z in normals
    ]
    return torch.stack(ratios).abs().flatten().quantile(torch.tensor([0.1, 0.5, 0.9], dtype=torch.float64))


def test_daylight_shades_slopes_as_measured_light_does() -> None:
    found = shading(daylight_probes(64, 32))
    torch.testing.assert_close(found, found.new_tensor([0.035, 0.333, 1.026]), atol=0.02, rtol=0)


@pytest.mark.skipif(not MEASURED.is_file(), reason="the measured probes are not beside this checkout")
def test_these_are_the_deciles_of_measured_light() -> None:
    found = shading(read_probes(MEASURED, 32)[0])
    torch.testing.assert_close(found, found.new_tensor([0.035, 0.333, 1.026]), atol=0.002, rtol=0)


def test_the_mirror_image_of_daylight_is_that_light_turned() -> None:
    """φ → -φ leaves it as it is, so any other mirror image is a turn."""
    probes = daylight_probes(8, 16)
    torch.testing.assert_close(probes.flip(3), probes, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("make", [mixed_probes, daylight_probes])
def test_mixed_probes_are_counted(make: Callable[[int], Tensor]) -> None:
    with pytest.raises(UserError, match="count=0"):
        make(0)
