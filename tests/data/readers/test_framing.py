"""The framing rule against drawn shapes whose framed picture is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from unproject._types import UserError
from unproject.data import AS_GIVEN, Framing, UnusablePicture, frame
from unproject.data.readers.framing import area_resample, is_mask


def disc(height: int, width: int, row: float, column: float, radius: float) -> np.ndarray:
    y, x = np.mgrid[:height, :width] + 0.5
    return (np.hypot(y - row, x - column) < radius).astype(np.float32)


def box_of(image) -> tuple[int, int, int, int]:
    rows, columns = np.flatnonzero((image[0] > 0.5).any(1)), np.flatnonzero((image[0] > 0.5).any(0))
    return rows[0], rows[-1] + 1, columns[0], columns[-1] + 1


def test_a_disc_anywhere_is_centred_fills_85_percent_and_keeps_its_area():
    image = frame(disc(300, 500, 90, 400, 60), 64).image
    top, bottom, left, right = box_of(image)
    assert abs((top + bottom) / 2 - 32) <= 0.5 and abs((left + right) / 2 - 32) <= 0.5
    assert abs((bottom - top) - 0.85 * 64) <= 1
    assert float(image.mean()) == pytest.approx(math.pi / 4 * 0.85**2, rel=0.01)


def test_aspect_is_kept_and_the_longer_side_fills():
    picture = np.zeros((200, 200), np.float32)
    picture[20:180, 90:130] = 1
    top, bottom, left, right = box_of(frame(picture, 80).image)
    assert bottom - top == 68 and right - left in (16, 17, 18)


def test_edges_are_soft_unless_binary():
    picture = disc(301, 301, 150, 150, 97)
    soft, hard = frame(picture, 32).image, frame(picture, 32, Framing(binary=True)).image
    assert ((soft > 0) & (soft < 1)).any() and set(hard.unique().tolist()) == {0.0, 1.0}


def test_black_on_white_and_white_on_black_are_the_same_object():
    picture = disc(100, 100, 40, 60, 25)
    assert frame(picture, 32).background == "dark" and frame(1 - picture, 32).background == "light"
    assert np.array_equal(frame(picture, 32).image, frame(1 - picture, 32).image)


def test_polarity_can_be_forced_when_the_object_fills_the_border():
    picture = np.ones((60, 60), np.float32)
    picture[20:40, 20:40] = 0
    assert float(frame(picture, 40).image[0, 20, 20]) == 1
    assert float(frame(picture, 40, Framing(polarity="light")).image[0, 20, 20]) == 0


def test_alpha_is_the_mask_if_it_is_not_opaque_and_is_ignored_if_it_is():
    mask = disc(80, 80, 40, 40, 20)
    cutout = np.stack([np.ones_like(mask)] * 3 + [mask], -1)
    framed = frame(cutout, 32)
    assert framed.channel == "alpha" and np.array_equal(framed.image, frame(mask, 32).image)
    opaque = np.stack([mask] * 3 + [np.ones_like(mask)], -1)
    assert frame(opaque, 32).channel == "luminance"
    assert np.array_equal(frame(opaque, 32).image, frame(mask, 32).image)


def photographed(rim: tuple[int, int] = (0, 0), corner: int = 0) -> np.ndarray:
    """A brown tall thing before a pale backdrop, (100, 100, 4), with a rim and corners that are transparent."""
    photo = np.full((100, 100, 4), (0.9, 0.9, 0.85, 1), np.float32)
    photo[20:80, 40:60, :3] = (0.5, 0.3, 0.2)
    photo[20:50, 40:60, :3] = (0.8, 0.6, 0.5)
    y, x = np.mgrid[:100, :100] + 0.5
    outside = np.hypot(*(np.clip(np.abs(z - 50) - (50 - corner), 0, None) for z in (y, x))) > corner
    outside[:, : rim[0]] = outside[: rim[1]] = outside[100 - rim[1] :] = True
    photo[outside & (corner + sum(rim) > 0)] = 0
    return photo


@pytest.mark.parametrize(
    "changed", [{}, {"rim": (1, 0)}, {"rim": (4, 0)}, {"rim": (1, 1)}, {"corner": 4}, {"corner": 20}]
)
def test_transparency_that_cuts_nothing_out_leaves_a_photograph(changed) -> None:
    photo = photographed(**changed)
    photo[50, 5, 3] = 0.5 / 255
    if not changed:
        photo[0, 30:60, 3] = 0  # a notch, that is no rim
    for rule in (Framing(), Framing(mode="keep")):
        found, opaque = (frame(picture, 32, rule) for picture in (photo, photographed()))
        assert (found.channel, found.background) == ("photograph", "light") and not found.cut
        assert np.array_equal(found.image, opaque.image) and (found.width, found.height) == (100, 100)
    if "rim" in changed:
        photo[..., :3] = landscape()
        with pytest.raises(UnusablePicture, match="no plain backdrop: .*; its transparency cuts nothing out"):
            frame(photo, 32)


def test_boxes_that_are_cut_out_stay_cut_outs() -> None:
    """A door whose margins are wide; black ones and slanted ones that nearly fill the picture."""
    door = photographed()
    door[..., 3] = 0
    door[8:92, 30:70, 3] = 1
    plain, slanted = (np.zeros((100, 100, 4), np.float32) for _ in range(2))
    plain[2:98, 2:98, 3] = 1
    slanted[..., :3] = photographed()[..., :3]
    slanted[..., 3] = np.arange(100)[:, None] >= np.arange(100) * 0.08
    for box in (door, plain, slanted):
        found = frame(box, 32)
        assert found.channel == "alpha" and np.array_equal(found.image, frame(box[..., 3], 32).image)


def test_masks_within_rims_tell_the_usual_polarity() -> None:
    inverted = photographed((2, 2), 10)
    inverted[..., :3] = np.where(inverted[..., :1] < 0.6, 0, 1)
    assert Framing().as_most([inverted]).undecided == "dark"


def test_threshold_decides_what_belongs_to_the_object():
    picture = disc(100, 100, 50, 50, 20) + 0.4 * (disc(100, 100, 50, 50, 40) - disc(100, 100, 50, 50, 20))
    small = frame(picture, 64, Framing(mode="keep", photo_threshold=0.5)).image.mean()
    large = frame(picture, 64, Framing(mode="keep", threshold=0.3, photo_threshold=0.3)).image.mean()
    assert float(large / small) == pytest.approx(4, rel=0.02)


def test_a_pale_object_photographed_on_white_is_kept_whole():
    photo = np.ones((100, 100, 3), np.float32)
    photo[30:70, 30:50] = (0.2, 0.1, 0.1)
    photo[30:70, 50:70] = (0.85, 0.85, 0.8)
    framed = frame(photo, 40)
    assert framed.channel == "photograph"
    assert float(framed.image.mean()) == pytest.approx(0.85**2, rel=0.01)


def landscape():
    """Grass below sky, and something before both."""
    photo = np.full((100, 100, 3), (0.6, 0.7, 0.9), np.float32)
    photo[48:] = (0.3, 0.5, 0.2)
    photo[30:70, 40:60] = (0.5, 0.1, 0.1)
    return photo


@pytest.mark.parametrize("photo", [landscape(), landscape().swapaxes(0, 1)])
def test_a_photograph_before_no_plain_backdrop_is_no_silhouette(photo):
    with pytest.raises(UnusablePicture, match="no plain backdrop: .* of the photograph's border differ"):
        frame(photo, 32)
    assert frame(photo, 32, Framing(polarity="light", photo_threshold=0.65)).channel == "photograph"


def test_a_photograph_that_is_cropped_closely_is_used():
    photo = np.ones((100, 100, 3), np.float32)
    photo[:, 40:60] = photo[45:55] = (0.3, 0.4, 0.5)  # touches all four sides
    photo[20:30, 45:55] = (0.6, 0.2, 0.2)
    assert frame(photo, 32).channel == "photograph"


def test_a_mask_with_a_soft_edge_is_no_photograph():
    y, x = np.mgrid[:80, :80] + 0.5
    assert is_mask(np.clip(20.5 - np.hypot(y - 40, x - 40), 0, 1))
    assert not is_mask(np.full((80, 80), 0.5))


def test_keep_leaves_the_object_where_it_is():
    picture = disc(100, 100, 25, 70, 15)
    image = frame(picture, 50, Framing(mode="keep")).image
    y, x = np.mgrid[:50, :50] + 0.5
    mass = image[0].numpy()
    assert (mass * y).sum() / mass.sum() == pytest.approx(12.5, abs=0.05)
    assert (mass * x).sum() / mass.sum() == pytest.approx(35, abs=0.05)


def test_keep_pads_a_wide_picture_to_a_square():
    picture = np.ones((20, 40), np.float32)
    picture[:, :4] = picture[:, -4:] = 0
    image = frame(picture, 40, Framing(mode="keep", polarity="light")).image[0]
    assert image[:10].sum() == 0 and image[30:].sum() == 0 and image[10:30, 4:36].min() == 1


def test_as_given_keeps_grey_values():
    picture = np.linspace(0, 1, 64, dtype=np.float32).reshape(8, 8)
    assert np.allclose(frame(picture, 8, AS_GIVEN).image[0], picture)


@pytest.mark.parametrize(
    ("picture", "reason"),
    [
        (np.zeros((50, 50), np.float32), "empty"),
        (np.ones((50, 50), np.float32), "empty"),
        (disc(200, 200, 100, 100, 3), "too small: the object is 6 x 6"),
        (np.pad(np.ones((200, 200), np.float32), ((0, 0), (0, 1))), "full"),
    ],
)
def test_what_cannot_be_used_says_why(picture, reason):
    with pytest.raises(UnusablePicture, match=reason):
        frame(picture, 32, Framing(polarity="light" if reason == "full" else "auto"))


@pytest.mark.parametrize(
    "wrong", [{"fill": 0.0}, {"threshold": 1.5}, {"threshold": None}, {"mode": "squash"}, {"polarity": "up"}]
)
def test_a_framing_that_makes_no_sense_is_refused(wrong):
    with pytest.raises(UserError, match="framing: "):
        Framing(**wrong)


@settings(max_examples=40, deadline=None)
@given(
    height=st.integers(8, 90),
    width=st.integers(8, 90),
    size=st.integers(4, 70),
    seed=st.integers(0, 1000),
)
def test_area_resampling_keeps_the_mean(height, width, size, seed):
    image = np.random.default_rng(seed).random((height, width), dtype=np.float32)
    side = max(height, width)
    resampled = area_resample(image, ((height - side) / 2, (width - side) / 2, side), size)
    assert float(resampled.mean()) == pytest.approx(float(image.sum()) / side**2, rel=1e-3)


@settings(max_examples=25, deadline=None)
@given(dy=st.integers(-30, 30), dx=st.integers(-60, 60))
def test_cropping_does_not_depend_on_where_the_object_stood(dy, dx):
    assert np.allclose(
        frame(disc(150, 220, 75 + dy, 110 + dx, 30), 32).image, frame(disc(150, 220, 75, 110, 30), 32).image, atol=1e-4
    )


def letter(border: int = 0) -> np.ndarray:
    """A light L that touches its picture's border along half of it, in a margin."""
    mask = np.zeros((40, 30))
    mask[:, :12] = mask[-14:] = 1
    return np.pad(mask, border)[..., None]


def test_a_close_crop_is_light_unless_the_folder_says_otherwise() -> None:
    tight = letter()
    assert (
        frame(tight, 32).background == "dark" and frame(1 - tight, 32, Framing(undecided="dark")).background == "light"
    )
    assert torch.equal(frame(tight, 32).image, frame(1 - tight, 32, Framing(undecided="dark")).image)
    for polarity, picture in (("light", tight), ("dark", 1 - tight)):
        assert torch.equal(frame(picture, 32, Framing(polarity=polarity)).image, frame(tight, 32).image)


def test_masks_whose_border_is_clear_tell_the_usual_polarity() -> None:
    tight, wide = letter(), letter(4)
    assert Framing().as_most([tight, 1 - wide, 1 - wide, wide]) == Framing(undecided="dark")
    assert Framing().as_most([1 - tight, 1 - wide, wide, wide]) == Framing()
    assert Framing().as_most([tight, tight, 1 - wide, wide, wide]) == Framing()  # the close ones look dark
    assert Framing(polarity="dark").as_most([wide]) == Framing(polarity="dark")


def vase(foot: float) -> np.ndarray:
    """A dark vase (300, 300, 1) on a light ground, which stands on the border with a foot so many pixels wide."""
    picture = disc(300, 300, 170, 150, 80)
    picture[230:, 150 - round(foot / 2) : 150 + round(foot / 2)] = 1
    return 1 - picture[..., None]


@pytest.mark.parametrize("foot", [28, 80])
@pytest.mark.parametrize("standing", [6, 10])
def test_what_stands_on_the_border_tells_its_polarity(foot: float, standing: int) -> None:
    clear = 1 - disc(300, 300, 150, 150, 80)[..., None]
    folder = [vase(foot)] * standing + [clear] * (10 - standing)
    rule = Framing().as_most(folder)
    assert rule == Framing(undecided="dark")
    assert all(frame(picture, 32, rule).background == "light" for picture in folder)


def test_the_corners_of_a_close_crop_tell_none() -> None:
    """A light box whose rounded corners are all that is dark: these take more of the border than of the picture."""
    y, x = np.abs(np.mgrid[:100, :100] - 49.5)
    box = (np.hypot((y - 44).clip(0), (x - 44).clip(0)) < 6).astype(np.float32)[..., None]
    assert 0 < 1 - box.mean() < 0.01 and 0.02 < 1 - box[0].mean() < 0.1
    assert Framing().as_most([box] * 5) == Framing(close=True)


def test_of_a_folder_of_close_crops_no_border_tells() -> None:
    """A box seen from its side fills the border whole, and what it leaves free would pass for a dark object."""
    tight, box = letter(), np.ones((40, 30, 1))
    box[10:20, 10:20] = 0
    rule = Framing().as_most([tight, tight, box])
    assert rule == Framing(close=True)
    assert frame(box, 32, rule).background == "dark" and frame(box, 32).background == "light"


@pytest.mark.parametrize("values", [(0, 1 / 255), (0, 20 / 255), (3 / 255, 4 / 255), (0, 100 / 255)])
def test_two_values_are_a_mask_whatever_they_are(values: tuple[float, float]) -> None:
    low, high = values
    found = frame(low + (high - low) * letter(4), 32)
    assert torch.equal(found.image, frame(letter(4), 32).image) and found.channel == "luminance"


def test_dirt_does_not_decide_the_crop() -> None:
    clean = letter(20).repeat(2, 0).repeat(2, 1)
    dirty = clean.copy()
    dirty[0, 0] = dirty[-1, -1] = 1
    assert torch.equal(frame(dirty, 32).image, frame(clean, 32).image)
    dirty[2:6, 2:6] = 1  # a part
    assert not torch.equal(frame(dirty, 32).image, frame(clean, 32).image)


@pytest.mark.parametrize("labels", [(1,), (7,), (1, 2)])
def test_the_void_around_labels_is_no_object(labels: tuple[int, ...]) -> None:
    picture = 255 * (disc(100, 100, 50, 60, 25) - disc(100, 100, 50, 60, 22))
    for label in labels:
        picture[disc(100, 100, 50, 60, 22 - 5 * labels.index(label)) > 0] = label
    assert torch.equal(frame(picture / 255, 32).image, frame(disc(100, 100, 50, 60, 22), 32).image)


@pytest.mark.parametrize("labels", [(1, 2), (1, 2, 3), (14, 15)])
def test_labels_of_parts_are_one_object(labels: tuple[int, ...]) -> None:
    picture = np.zeros((100, 100), np.float32)
    for k, label in enumerate(labels):
        picture[disc(100, 100, 50, 60, 25 - 6 * k) > 0] = label / 255
    assert torch.equal(frame(picture, 32).image, frame(disc(100, 100, 50, 60, 25), 32).image)


def test_noise_near_the_background_is_no_label() -> None:
    mask = disc(100, 100, 50, 60, 25)
    noisy = np.where(mask > 0, 1, np.random.default_rng(0).integers(0, 9, mask.shape) / 255).astype(np.float32)
    assert torch.equal(frame(noisy, 32).image, frame(mask, 32).image)


@pytest.mark.parametrize(
    ("rows", "columns", "cut"),
    [
        (slice(20, 80), slice(20, 80), False),
        (slice(20, 100), slice(20, 80), True),
        (slice(0, 100), slice(20, 100), True),
        (slice(0, 100), slice(20, 80), False),
        (slice(0, 100), slice(0, 100), False),
    ],
)
def test_what_the_border_may_cut_off_is_told_from_what_is_trimmed(rows: slice, columns: slice, cut: bool) -> None:
    picture = np.zeros((100, 100), np.float32)
    picture[rows, columns] = 1
    picture[40:60, 40:60] = 0
    assert frame(picture, 32, Framing(polarity="light")).cut == cut


def test_parts_of_a_fifth_of_the_largest_are_counted() -> None:
    picture = disc(100, 100, 30, 30, 20) + disc(100, 100, 70, 70, 10) + disc(100, 100, 10, 90, 5)
    assert frame(picture, 32).parts == 2
