"""Scores of line integrals."""

import pytest
import torch

from unproject._random import generator_at
from unproject._types import UserError
from unproject.metrics import line_scores


def lines(n, seed, width=0.2):
    """Triangles of one width at random places."""
    place = torch.rand(n, 1, generator=generator_at(seed)) * 0.5 + 0.25
    return (width - ((torch.arange(16) + 0.5) / 16 - place).abs()).clamp_min(0)[:, None]


def test_one_family_scores_better_than_another():
    same, other = line_scores(lines(300, 0), lines(300, 1)), line_scores(lines(300, 0, 0.3), lines(300, 1))
    for name in ("frechet_line", "kernel_line"):
        assert other[name].value > 5 * abs(same[name].value)


def test_a_set_against_itself_and_units_do_not_matter():
    x, y = lines(100, 0), lines(100, 1)
    assert abs(line_scores(x, x)["frechet_line"].value) < 1e-4
    for name, score in line_scores(x * 10, y * 10).items():
        assert score.value == pytest.approx(line_scores(x, y)[name].value, rel=1e-4, abs=1e-6)


def test_lines_that_cannot_be_scored():
    for x, y in ((lines(1, 0), lines(9, 0)), (lines(9, 0), lines(9, 0)[..., :8]), (lines(9, 0)[:, 0], lines(9, 0))):
        with pytest.raises(UserError, match="at least two lines"):
            line_scores(x, y)
    with pytest.raises(UserError, match="NaN"):
        line_scores(lines(9, 0) * float("nan"), lines(9, 0))
