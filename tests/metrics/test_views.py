import math

import pytest
import torch
from PIL import Image

from unproject._random import generator_at
from unproject._types import UserError
from unproject.metrics.confusion import confusion_picture
from unproject.metrics.gauge import Gauge, dihedral
from unproject.metrics.views import ViewAccuracy, chance_level, of_ceiling, view_accuracy, view_scores


def labels(n, bins, seed=0):
    return torch.randint(bins, (n,), generator=generator_at(seed, 0, "labels"))


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("shift", range(16))
def test_every_relabelling_is_recovered(sign, shift):
    true = labels(200, 16)
    found = view_accuracy((sign * true + shift) % 16, true, trials=2)
    assert found.exact == 1 and found.within_one == 1
    assert torch.equal(found.confusion, torch.diag(torch.bincount(true, minlength=16)))


@pytest.mark.parametrize("gauge", dihedral(8))
def test_the_gauge_found_takes_the_learned_shapes_to_the_true_ones(gauge):
    # If g takes learned shapes y to true ones x = g y, then P(x, t) = P(y, g.view(t)): view t is called g.view(t).
    true = labels(100, 8)
    found = view_accuracy(gauge.view(true), true, 8, trials=2)
    assert found.exact == 1 and found.gauge == gauge


def test_accuracy_by_hand():
    # Bins of 4; q(p) = p + c or c - p. With the identity: true 0 0 1 2 3 1, predicted 0 0 1 3 1 2:
    # right 3 of 6; off by 1: 2 -> 3 and 1 -> 2; 3 -> 1 is two off: within one 5 of 6. No other does as well:
    # differences p - t are 0 0 0 1 2 1 (at most 3 alike), sums p + t are 0 0 2 1 0 3 (3 alike, c = 0: then
    # q(p) = -p is 0 0 3 1 3 2 against 0 0 1 2 3 1, off by 0 0 2 1 0 1: also 5 of 6). The first is taken: unreflected.
    true, predicted = torch.tensor([0, 0, 1, 2, 3, 1]), torch.tensor([0, 0, 1, 3, 1, 2])
    found = view_accuracy(predicted, true, 4, trials=2)
    assert found.exact == 0.5 and found.within_one == pytest.approx(5 / 6)
    assert found.gauge == Gauge(0, False, 4) and found.n == 6
    # Rows are the true bins, columns the predicted ones.
    assert found.confusion.tolist() == [[2, 0, 0, 0], [0, 1, 1, 0], [0, 0, 0, 1], [0, 1, 0, 0]]


def test_within_one_goes_round_the_circle():
    true = torch.tensor([0, 0, 0, 5, 7])
    found = view_accuracy(torch.tensor([0, 0, 7, 5, 0]), true, 8, trials=2)
    assert found.exact == pytest.approx(3 / 5) and found.within_one == 1


def test_confusion_is_relabelled():
    # p = t + 1 but for one picture of bin 2, called 2: after the gauge (p - 1) it lies in row 2, column 1.
    true = torch.tensor([0, 1, 2, 3, 2, 3])
    predicted = torch.tensor([1, 2, 3, 0, 2, 0])
    found = view_accuracy(predicted, true, 4, trials=2)
    assert found.exact == pytest.approx(5 / 6)
    assert found.confusion.tolist() == [[1, 0, 0, 0], [0, 1, 0, 0], [0, 1, 1, 0], [0, 0, 0, 2]]


def test_order_of_pictures_does_not_matter():
    true, predicted, order = labels(300, 16), labels(300, 16, 1), torch.randperm(300, generator=generator_at(5))
    one, other = view_accuracy(predicted, true), view_accuracy(predicted[order], true[order])
    assert (one.exact, one.within_one, one.gauge, one.chance_exact) == (
        other.exact,
        other.within_one,
        other.gauge,
        other.chance_exact,
    )


def test_chance_of_two_pictures_by_hand():
    # Two pictures of bins 0 and 1, predicted 0 and 1 in either order, 4 bins: p - t is alike (0, 0) or p + t is
    # (1, 1), so the best relabelling is always right in both.
    assert chance_level(torch.tensor([1, 1, 0, 0]), torch.tensor([1, 1, 0, 0]), trials=20) == (1, 1)


def test_chance_of_two_bins_by_hand():
    # 2 bins, 2 + 2 pictures; p - t and p + t agree modulo 2. Of the 6 shuffles, 2 put both of a kind in their own or
    # in the other bin (best 1), 4 put one in each (best 1/2): mean (2 · 1 + 4 · 1/2) / 6 = 2/3. Within one: always.
    # Standard error with 4000 trials: sqrt(1/18 / 4000) = 0.004.
    exact, within = chance_level(torch.tensor([2, 2]), torch.tensor([2, 2]), trials=4000)
    assert exact == pytest.approx(2 / 3, abs=0.015) and within == 1


def test_chance_is_what_random_labels_score_and_above_one_in_sixteen():
    n = 320
    exact, within = chance_level(torch.full((16,), n // 16), torch.full((16,), n // 16))
    scores = [view_accuracy(labels(n, 16, 2 * s), labels(n, 16, 2 * s + 1), trials=1) for s in range(40)]
    mean = sum(score.exact for score in scores) / 40
    mean_within = sum(score.within_one for score in scores) / 40
    assert exact > 1 / 16 and mean > 1 / 16
    assert exact == pytest.approx(mean, abs=0.01)
    assert within == pytest.approx(mean_within, abs=0.02)
    # The maximum of 32 nearly normal shares of mean 1/16 lies about two standard deviations above it.
    deviation = math.sqrt(15 / 256 / n)
    assert 1 / 16 + 1.5 * deviation < exact < 1 / 16 + 3 * deviation


def test_chance_of_a_constant_prediction_is_the_largest_bin():
    # Everything called 3: the best relabelling sends 3 to the most frequent bin, 6 of 10.
    true = torch.tensor([6, 1, 2, 1])
    exact, _ = chance_level(torch.tensor([0, 0, 0, 10]), true, trials=5)
    assert exact == pytest.approx(0.6)
    found = view_accuracy(torch.full((10,), 3), torch.arange(4).repeat_interleave(true), 4)
    assert found.exact == found.chance_exact == pytest.approx(0.6)


def test_share_of_the_ceiling_and_scores():
    true = torch.arange(8).repeat(2)
    ceiling = view_accuracy(true, true, 8, trials=2)
    half = view_accuracy(torch.where(torch.arange(16) < 8, true, (true * 3 + 1) % 8), true, 8, trials=2)
    assert of_ceiling(half, ceiling) == half.exact < 1
    scores = view_scores(half, ceiling, seed=3)
    assert scores["view_of_ceiling"].value == half.exact and scores["view_ceiling_exact"].value == 1
    assert "best of 16 dihedral relabellings" in scores["view_exact"].protocol
    assert scores["view_exact"].n == 16 and scores["view_exact"].seed == 3
    assert "view_of_ceiling" not in view_scores(half)


@pytest.mark.parametrize(
    "call",
    [
        lambda: view_accuracy(torch.zeros(0).long(), torch.zeros(0).long()),
        lambda: view_accuracy(torch.zeros(2).long(), torch.zeros(3).long()),
        lambda: view_accuracy(torch.tensor([16]), torch.tensor([0])),
        lambda: view_accuracy(torch.tensor([0]), torch.tensor([-1])),
        lambda: view_accuracy(torch.tensor([0]), torch.tensor([0]), 5),
        lambda: chance_level(torch.tensor([2, 0]), torch.tensor([1, 0])),
        lambda: confusion_picture(torch.zeros(3, 4)),
        lambda: of_ceiling(*[ViewAccuracy(0.0, 0.0, Gauge(), torch.zeros(16, 16), 0.1, 0.2)] * 2),
    ],
)
def test_bad_labels_are_the_users_to_mend(call):
    with pytest.raises(UserError):
        call()


def test_confusion_picture_puts_true_bins_down_and_predicted_across():
    confusion = torch.zeros(16, 16)
    confusion[2, 5] = 10
    picture = confusion_picture(confusion)
    assert isinstance(picture, Image.Image)
    blank = confusion_picture(torch.zeros(16, 16))
    changed = [
        (x, y)
        for x in range(picture.width)
        for y in range(picture.height)
        if picture.getpixel((x, y)) != blank.getpixel((x, y))
    ]
    left, top = min(x for x, _ in changed), min(y for _, y in changed)
    # Cells are 30 pixels from a margin of 64: column 5 begins at 64 + 150, row 2 at 64 + 60.
    assert (left, top) == (64 + 150 + 1, 64 + 60 + 1)


def test_directions_of_half_a_turn_are_relabelled_with_what_they_see_from_behind():
    """Five of them, an odd number: a turn by 72° sends the fourth to the second seen the other way round."""
    true = torch.arange(50) % 5
    for predicted in ((true + 3) % 5, (2 - true) % 5):
        found = view_accuracy(predicted, true, 5, half=True)
        assert found.exact == found.within_one == 1 and torch.equal(found.confusion, 10 * torch.eye(5).long())
        assert found.gauge.bins == 10
    assert "5 directions of half a turn" in view_scores(found)["view_exact"].protocol
    assert 0.2 < found.chance_exact < 0.5


def test_chance_breaks_ties_as_the_accuracy_does():
    rng = torch.Generator().manual_seed(0)
    pairs = [(torch.randint(16, (12,), generator=rng), torch.randint(16, (12,), generator=rng)) for _ in range(300)]
    found = [view_accuracy(a, b, bins=16, trials=1).within_one for a, b in pairs]
    chance = [chance_level(a.bincount(minlength=16), b.bincount(minlength=16), trials=20)[1] for a, b in pairs]
    assert sum(found) / 300 == pytest.approx(sum(chance) / 300, abs=0.012)


@pytest.mark.parametrize("half", [True, False])
def test_a_line_may_be_that_of_the_mirror_image(half):
    """Directions called t or 9 - t, image by image: half of them are right, all of them up to the reflection of each.

    Where the ten are the first of twenty around, lines are read from one end, and a world that is turned by three
    relabels them to 3 - t or t - 6, which no reflection of single images changes.
    """
    true, mirrored = torch.arange(400) % 10, labels(400, 2).bool()
    called = torch.where(mirrored, 9 - true, true)
    bins = 10 if half else 20
    found = view_accuracy(Gauge(3, True, 20).view(called) % bins, true, bins, half=half, mirrored=True)
    assert found.exact_mirrored == 1 and 0.4 < found.exact < 0.65
    assert found.chance_exact_mirrored is not None and 1.5 * found.chance_exact < found.chance_exact_mirrored < 0.35
    assert view_accuracy((called + (true == 3)) % bins, true, bins, half=half, mirrored=True).exact_mirrored == 0.9


def test_the_mirrored_accuracy_is_a_share_of_the_same_of_the_ceiling():
    true = torch.arange(40) % 10
    called = torch.where(true > 7, 5, true)
    best = view_accuracy(torch.where(true == 0, 9, called), true, 10, half=True, mirrored=True)
    assert best.exact == pytest.approx(0.7) and best.exact_mirrored == pytest.approx(0.8)
    found = view_accuracy(torch.where(true < 4, 5, 9 - true), true, 10, half=True, mirrored=True)
    scores = view_scores(found, best)
    assert scores["view_of_ceiling_mirrored"].value == pytest.approx(0.6 / 0.8)
    assert "up to the reflection of each image" in scores["view_exact_mirrored"].protocol
    assert scores["view_chance_exact_mirrored"].value < 0.4
    assert not any("mirrored" in name for name in view_scores(view_accuracy(true, true, 10, half=True)))
