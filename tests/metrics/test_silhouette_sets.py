import pytest
import torch

from unproject._random import generator_at
from unproject._types import UserError
from unproject.metrics.feature_sets import kernel_distance
from unproject.metrics.silhouette_sets import silhouette_features, silhouette_scores


def squares(n, seed, size=10, spread=20):
    """Filled squares at random places of a 32 x 32 picture."""
    pictures = torch.zeros(n, 1, 32, 32)
    places = torch.randint(spread, (n, 2), generator=generator_at(seed, 0, "squares"))
    for picture, (row, column) in zip(pictures, places.tolist(), strict=True):
        picture[0, row : row + size, column : column + size] = 1
    return pictures


def test_kernel_distance_is_unbiased_small_within_one_family_and_large_across():
    same = [
        kernel_distance(silhouette_features(squares(40, s)), silhouette_features(squares(40, 100 + s)))
        for s in range(40)
    ]
    across = kernel_distance(silhouette_features(squares(40, 0)), silhouette_features(squares(40, 1, size=14)))
    assert min(same) < 0 < max(same)
    # One value has a standard deviation of 0.0043 (600 draws, mean 0.0003 ± 0.0002): 4 / sqrt(40) of it is 0.0027.
    assert abs(sum(same) / 40) < 0.0027 < across / 10


def test_features_by_hand():
    # The top left quarter of a 32 x 32 picture: 8 x 8 of the 16 x 16 cells full; 16 of 32 row bands half full, and
    # 16 of 32 column bands.
    picture = torch.zeros(1, 1, 32, 32)
    picture[..., :16, :16] = 0.9
    features = silhouette_features(picture)
    expected = torch.zeros(16, 16)
    expected[:8, :8] = 1
    band = torch.cat([torch.full((16,), 0.5), torch.zeros(16)])
    torch.testing.assert_close(features[0], torch.cat([expected.flatten(), band, band]))
    # The top half: every column half full, rows full and then empty.
    picture[..., :16, :] = 1
    rows, columns = silhouette_features(picture)[0, 256:].split(32)
    assert rows.tolist() == [1] * 16 + [0] * 16 and columns.tolist() == [0.5] * 32
    torch.testing.assert_close(silhouette_features(picture[:, 0]), silhouette_features(picture))


def test_scores_by_hand():
    # 4 x 4 pictures with the first k of 16 cells: k = 4, 8 generated; 4, 16 held out. 1 - IoU = 1 - k/l:
    # [[0, 3/4], [1/2, 1/2]]: MMD (0 + 1/2) / 2; COV: rows' nearest 0 and (a tie, the first) 0: 1/2.
    # 1-NNA: g4 (own 1/2, other 0) no; g8 (1/2, 1/2) half; r4 (3/4, 0) no; r16 (3/4, 1/2) no: 1/8.
    def first(*counts):
        return torch.stack([(torch.arange(16) < k).float().view(1, 4, 4) for k in counts])

    scores = silhouette_scores(first(4, 8), first(4, 16))
    assert scores["mmd_iou_silhouette"].value == 0.25
    assert scores["cov_iou_silhouette"].value == 0.5
    assert scores["1nna_iou_silhouette"].value == 0.125
    assert scores["mmd_iou_silhouette"].protocol == (
        "mmd(1-iou), silhouettes 4x4 at 0.5, 2 generated vs 2 reference, views as given"
    )


def test_equal_and_shuffled_sets():
    pictures = squares(12, 0)
    scores = silhouette_scores(pictures, pictures[torch.randperm(12, generator=generator_at(1))])
    assert scores["mmd_iou_silhouette"].value == 0
    equal = {"mmd_iou_silhouette_equal", "cov_iou_silhouette_equal"}
    assert (
        set(scores) == {"mmd_iou_silhouette", "cov_iou_silhouette", "1nna_iou_silhouette", "kernel_silhouette"} | equal
    )
    one, other = (silhouette_scores(x, squares(12, 5)) for x in (pictures, pictures.flip(0)))
    for name in one:
        assert one[name].value == pytest.approx(other[name].value, abs=1e-9)
    assert "12 generated vs 12 reference" in one["kernel_silhouette"].protocol


@pytest.mark.parametrize(
    ("generated", "reference"),
    [
        (torch.zeros(0, 1, 8, 8), torch.zeros(2, 1, 8, 8)),
        (torch.zeros(2, 1, 8, 8), torch.zeros(2, 1, 16, 16)),
        (torch.zeros(1, 1, 8, 8), torch.zeros(2, 1, 8, 8)),
        (torch.zeros(2, 3, 8, 8), torch.zeros(2, 3, 8, 8)),
    ],
)
def test_bad_sets_are_the_users_to_mend(generated, reference):
    with pytest.raises(UserError):
        silhouette_scores(generated, reference)
