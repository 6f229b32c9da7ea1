"""Findings of pictures: right on silhouettes that match, and on each way in which they do not."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from unproject.data import cars, chairs, observe
from unproject.domains import Images, Maps, Volumes
from unproject.domains.evidence import Evidence, label_finding, match_finding, nearest
from unproject.ops import rotate_y
from unproject.projections.silhouette import Silhouette, azimuth_bins

SIZE, BINS, N = 16, 4, 128
VIEWS = azimuth_bins(BINS, Silhouette(size=SIZE, rule="absorption", density=2.0))


def silhouettes(x: Tensor, seed: int) -> tuple[Tensor, Tensor]:
    seen = observe(x, VIEWS, N // len(x), seed)
    assert seen.latents is not None
    return seen.floats(), seen.latents["view"].long()


@pytest.fixture(scope="module")
def honest() -> Evidence:
    """Generated chairs are chairs."""
    generated, views = silhouettes(chairs(64, SIZE, seed=1), 1)
    real, real_views = silhouettes(chairs(64, SIZE, seed=2), 2)
    others, _ = silhouettes(chairs(64, SIZE, seed=3), 3)
    return Evidence(generated, views, real, real_views, others, torch.ones(N, N, dtype=torch.bool), silhouettes=True)


def words(seen: Evidence) -> dict[str, str]:
    return {finding.name: finding.word for finding in Volumes().picture_findings(seen)}


def test_what_is_no_distance_apart_makes_no_number_of_six_digits() -> None:
    far = match_finding(639509.4, "p", 9, (1.2, 1.5), 0)
    assert far.word == "failed" and "are over 100 times as far" in far.says and far.score.value == 639509.4
    assert "are 8.10 times as far" in match_finding(8.1, "p", 9, (1.2, 1.5), 0).says


def test_chairs_match_chairs(honest: Evidence) -> None:
    assert words(honest) == {"match": "good", "variety": "good", "labels": "good", "likeness": "good"}
    match, variety, *_ = Volumes().picture_findings(honest)
    assert match.score.value == pytest.approx(1.0, abs=0.15) and variety.score.value == pytest.approx(1.0, abs=0.15)


def test_heaps_do_not_match(honest: Evidence) -> None:
    generated, _ = silhouettes((chairs(64, SIZE, seed=1).mean(0, keepdim=True) > 0.1).float(), 1)
    found = words(replace(honest, generated=generated))
    assert found["variety"] == "failed" and found["match"] != "failed"  # chairs differ as much from one another


def test_discs_do_not_match_cars() -> None:
    """Bodies of revolution as wide as cars are long, or as narrow as they are wide."""
    (generated, views), (real, known), (others, _) = (silhouettes(cars(64, SIZE, seed=k), k) for k in range(3))
    seen = Evidence(generated, views, real, known, others, torch.ones(N, N, dtype=torch.bool), silhouettes=True)
    assert set(words(seen).values()) == {"good"}
    angles = torch.arange(16) * 2 * torch.pi / 16
    turned = torch.stack([rotate_y(cars(64, SIZE, seed=0), angle.expand(64)) for angle in angles]).mean(0)
    found = words(replace(seen, generated=silhouettes((turned > 0.4).float(), 0)[0]))
    assert found["match"] == "failed" and found["labels"] == "doubtful"


def test_samples_that_are_alike_vary_too_little(honest: Evidence) -> None:
    same = honest.generated[:1].expand(N, -1, -1, -1)
    assert words(replace(honest, generated=same))["variety"] == "failed"


def test_noise_has_nothing_in_common(honest: Evidence) -> None:
    random = [torch.rand(N, 1, SIZE, SIZE, generator=torch.Generator().manual_seed(k)).round() for k in range(3)]
    found = words(replace(honest, generated=random[0], real=random[1], others=random[2]))
    assert found["match"] == "good" and found["likeness"] == "failed"


def test_known_views_that_were_mixed_up_tell_nothing(honest: Evidence) -> None:
    assert honest.real_views is not None
    order = torch.randperm(N, generator=torch.Generator().manual_seed(0))
    assert words(replace(honest, real_views=honest.real_views[order]))["labels"] != "good"
    assert "labels" not in words(replace(honest, real_views=None))


def test_pictures_of_the_same_object_do_not_count_as_others() -> None:
    distance = torch.tensor([[0.0, 0.4, 0.6], [0.5, 0.0, 0.2]])
    apart = torch.tensor([[False, True, True], [True, False, True]])
    assert nearest(distance, apart) == pytest.approx(0.3)


def test_too_few_pictures_are_no_evidence(honest: Evidence) -> None:
    assert honest.is_enough
    assert not replace(honest, real=honest.real[:3]).is_enough
    assert not replace(honest, apart=honest.apart & (torch.arange(N) > 0)[:, None]).is_enough


def test_other_domains_are_judged_by_their_match() -> None:
    lines, apart = torch.rand(3, 32, 1, 8, generator=torch.Generator().manual_seed(0)), torch.ones(32, 32).bool()
    none = torch.zeros(32, dtype=torch.long)
    seen = Evidence(lines[0], none, lines[1], None, lines[2], apart, silhouettes=False)
    assert {f.name: f.word for f in Images().picture_findings(seen)} == {"match": "good", "variety": "good"}
    assert Images().picture_findings(replace(seen, generated=lines[0] + 3))[0].word == "failed"
    maps = torch.rand(3, 32, 3, 16, 16, generator=torch.Generator().manual_seed(0))
    seen = Evidence(maps[0], none, maps[1], None, maps[2], apart, silhouettes=False)
    assert [f.word for f in Maps().picture_findings(seen)] == ["good"]
    assert Maps().picture_findings(replace(seen, generated=maps[0] / 4))[0].word != "good"


def test_pieces_and_empty_shapes_are_named() -> None:
    shapes = torch.zeros(10, SIZE, SIZE, SIZE)
    shapes[:, 2:5, 2:12, 2:12] = 1
    assert {f.name: f.word for f in Volumes().findings(shapes)} == {"pieces": "good", "empty": "good"}
    broken = shapes.clone()
    broken[:9, 9:12, 2:12, 2:12] = 1
    assert Volumes().findings(broken)[0].word == "failed" and "10%" in Volumes().findings(broken)[0].says
    assert Volumes().findings(torch.zeros_like(shapes))[1].word == "failed"


def test_views_that_are_nearly_all_one_are_compared_with_others_alone(honest: Evidence) -> None:
    """Right labels are good, however few pictures show another view."""
    assert honest.real_views is not None
    rows = torch.cat(
        [(honest.real_views == 0).nonzero()[:, 0].repeat(4)[:117], (honest.real_views == 1).nonzero()[:11, 0]]
    )
    seen = replace(honest, real=honest.real[rows], real_views=honest.real_views[rows])
    distance = torch.where(seen.views[None] == honest.real_views[rows][:, None], 0.3, 0.6)
    (finding,) = label_finding(distance, seen, 0)
    assert finding.score.value == pytest.approx(0.5)
