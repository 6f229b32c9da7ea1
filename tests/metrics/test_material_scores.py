"""Scores of materials: a set against itself, shuffled, blurred and collapsed; what each score must see and must not."""

import math

import pytest
import torch
from torch.nn.functional import avg_pool2d, interpolate, normalize

from unproject._random import generator_at
from unproject._types import UserError
from unproject.metrics import Score, material_scores
from unproject.ops.maps import MAPS, check_maps, with_specular

PATCHES = [f"patch_{name}" for name in MAPS]
KERNELS = [f"kernel_{name}" for name in MAPS]
SET = ["diversity", "precision", "recall", "density", "coverage"]


def materials(n=80, seed=0, size=16):
    """Relief with colour, gloss and roughness that go with it, each material of its own contrast and colour."""
    rng = generator_at(seed, 0, "materials")
    relief = interpolate(torch.randn(n, 1, size // 4, size // 4, generator=rng), size=size, mode="bicubic")
    grain = torch.randn(n, 1, size, size, generator=rng) * 0.03
    colour, contrast = torch.rand(n, 3, 1, 1, generator=rng), torch.rand(n, 1, 1, 1, generator=rng) * 0.1
    rows, columns = torch.gradient(relief * (0.5 + contrast), dim=(2, 3))
    normal = normalize(torch.cat([-columns, rows, torch.ones_like(rows)], 1), dim=1)
    diffuse = (0.2 + 0.4 * colour + contrast * relief + grain).clamp(0, 1)
    specular = (0.5 + contrast * relief - grain).clamp(0, 1)
    roughness = (0.3 - contrast * relief / 2).clamp(0.01, 1)
    return check_maps(torch.cat([diffuse, specular, roughness, normal], 1))


def rendering(x):
    """Lit along the normal: enough of one to be scored."""
    return (x[:, :3] * x[:, 7:]).clamp(0, 1)


TRUTH, OTHER = materials(), materials(seed=1)


def values(scores):
    return {name: score.value for name, score in scores.items()}


@pytest.fixture(scope="module")
def baseline():
    return values(material_scores(OTHER, TRUTH))


@pytest.fixture(scope="module")
def same():
    return values(material_scores(TRUTH, TRUTH, rendered={"top": (rendering(TRUTH),) * 2}))


def test_every_score_says_how_it_was_measured():
    found, truth = materials(50, 1, 32), materials(80, 0, 32)
    scores = material_scores(found, truth, seed=3, rendered={"top": (rendering(found)[:30], rendering(truth))})
    assert all(isinstance(score, Score) and math.isfinite(score.value) for score in scores.values())
    assert set(PATCHES + KERNELS + SET + ["patch_top", "kernel_top", "correlation_error"]) <= set(scores)
    assert {"correlation_error_mean", "correlation_error_32", "correlation_error_diffuse_normal"} <= set(scores)
    for name, score in scores.items():
        assert ("30" if name.endswith("top") else "50") + " generated vs 80 true at 32x32" in score.protocol
        assert score.n == (30 if name.endswith("top") else 50)
        draws = name.startswith("patch") or name in SET
        assert score.seed == (3 if draws else 0)
    assert "50 vs 50 of" in scores["recall"].protocol and "256 projections" in scores["patch_top"].protocol
    assert len(scores) == 2 * 5 + 1 + 4 + 6 + 5


def test_a_set_against_itself(baseline, same):
    assert all(same[name] == 0 for name in (*PATCHES, "patch_top"))
    assert all(-0.5 < same[name] <= 0 for name in (*KERNELS, "kernel_top"))  # unbiased: a little below 0
    assert all(value == 0 for name, value in same.items() if name.startswith("correlation_error"))
    assert same["diversity"] == same["precision"] == same["recall"] == same["coverage"] == 1
    assert all(0 < baseline[name] < 0.3 for name in PATCHES)
    assert all(abs(baseline[name]) < 0.3 for name in KERNELS)
    assert baseline["diversity"] == pytest.approx(1, abs=0.1) and baseline["precision"] > 0.7


def test_order_does_not_matter(baseline):
    order = torch.randperm(len(OTHER), generator=generator_at(0))
    assert values(material_scores(OTHER[order], TRUTH)) == pytest.approx(baseline, abs=1e-4)


@pytest.mark.parametrize("name", ["diffuse", "roughness"])
def test_maps_shuffled_among_materials_fail_by_their_correlations_alone(name, same):
    shuffled = TRUTH.clone()
    shuffled[:, MAPS[name]] = TRUTH.roll(1, 0)[:, MAPS[name]]
    scores = values(material_scores(shuffled, TRUTH))
    assert all(scores[patch] < 1e-6 for patch in PATCHES)
    assert all(scores[kernel] == pytest.approx(same[kernel], abs=1e-4) for kernel in KERNELS)
    assert scores["correlation_error"] > 0.3
    others = [f"correlation_error_{a}_{b}" for a in MAPS for b in MAPS if name not in (a, b)]
    assert all(scores[pair] < 1e-4 for pair in others if pair in scores)


def test_one_bad_map_is_named(baseline):
    bad = OTHER.clone()
    bad[:, 4:5] = avg_pool2d(bad[:, 4:5], 5, 1, 2, count_include_pad=False)
    scores = values(material_scores(bad, TRUTH))
    for name in MAPS:
        worse = scores[f"patch_{name}"] > 1.5 * baseline[f"patch_{name}"]
        assert worse if name == "roughness" else scores[f"patch_{name}"] == baseline[f"patch_{name}"]
    assert scores["kernel_roughness"] > baseline["kernel_roughness"] + 0.1
    assert scores["precision"] < baseline["precision"]


def test_specular_colours_that_change_places_are_seen():
    """By the scores of the specular map, and of no other; three equal channels keep the correlations of one."""
    tint = torch.tensor([1.2, 1.0, 0.6])[:, None, None]
    truth, other = (torch.cat([x[:, :3], x[:, 3:4] * tint, x[:, 4:]], 1) for x in (TRUTH, OTHER))
    swapped = torch.cat([other[:, :3], other[:, 3:6].flip(1), other[:, 6:]], 1)
    good, bad = (values(material_scores(x, truth)) for x in (other, swapped))
    assert bad["patch_specular"] > 2 * good["patch_specular"] and bad["kernel_specular"] > good["kernel_specular"] + 1
    assert all(bad[name] == good[name] for name in PATCHES + KERNELS if "specular" not in name)
    grey, own = (material_scores(with_specular(x, 3), with_specular(TRUTH, 3)) for x in (OTHER, TRUTH))
    assert grey["correlation_error"].value == pytest.approx(material_scores(OTHER, TRUTH)["correlation_error"].value)
    assert own["patch_specular"].value == 0


def test_a_collapsed_set_lacks_diversity_and_recall(baseline):
    few = OTHER[:2].repeat(40, 1, 1, 1) + 1e-3 * torch.randn(TRUTH.shape, generator=generator_at(0))
    scores = values(material_scores(few, TRUTH))
    assert scores["diversity"] < 0.85 * baseline["diversity"] and scores["recall"] < 0.3 < baseline["recall"]
    assert scores["coverage"] < 0.4 < baseline["coverage"]
    one = OTHER[:1].repeat(80, 1, 1, 1)
    assert values(material_scores(one, TRUTH))["diversity"] < 1e-3


def test_renderings_are_scored_as_maps_are():
    pair = rendering(OTHER), rendering(TRUTH)
    scores = values(material_scores(OTHER, TRUTH, rendered={"top": pair, "dark": (pair[0] / 2, pair[1])}))
    assert scores["patch_dark"] > 2 * scores["patch_top"] and scores["kernel_dark"] > scores["kernel_top"] + 0.3


def test_sets_that_cannot_be_scored():
    good = rendering(TRUTH)
    for found, rendered, words in (
        (OTHER[:5], None, "materials: give at least 6"),
        (OTHER[:, :, :12], None, "of one size"),
        (OTHER * float("nan"), None, "NaN"),
        (OTHER, {"top": (good[:5], good)}, "renderings 'top': give at least 6"),
        (OTHER, {"top": (good[..., :12], good)}, "renderings 'top'"),
        (OTHER, {"normal": (good, good)}, "'normal' is a map"),
    ):
        with pytest.raises(UserError, match=words) as error:
            material_scores(found, TRUTH, rendered=rendered)
        assert "\n" not in str(error.value)
    with pytest.raises(UserError, match=r"\(B, 8, H, W\)"):
        material_scores(good, good)
