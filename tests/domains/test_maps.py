"""Maps: pictures are judged beside other real ones, never beside themselves."""

from __future__ import annotations

import torch
from torch import Tensor

from unproject.data import wood
from unproject.domains import Maps
from unproject.domains.evidence import ENOUGH, Evidence


def match(generated: Tensor, real: Tensor, others: Tensor, apart: Tensor) -> float:
    views = torch.zeros(len(generated), dtype=torch.long)
    (finding,) = Maps().picture_findings(Evidence(generated, views, real, None, others, apart), seed=0)
    return finding.score.value


def test_photographs_of_which_none_are_held_out_are_not_compared_with_themselves() -> None:
    """All of a folder's pictures are drawn as real ones and as training pictures; halves of them are compared."""
    pictures, generated = wood(40, 32, 0)[:, :3], wood(40, 32, 1)[:, :3]
    themselves = ~torch.eye(40, dtype=torch.bool)
    assert match(generated, pictures, pictures, themselves) < 3
    assert match(1 - generated, pictures, pictures, themselves) > 3


def test_training_pictures_that_were_not_drawn_as_real_ones_are_compared() -> None:
    real, others = wood(40, 32, 0)[:, :3], wood(80, 32, 1)[:, :3]
    apart = torch.ones(40, 80, dtype=torch.bool)
    apart[:, :40] = ~torch.eye(40, dtype=torch.bool)
    mixed = torch.cat([real, others[:40]])
    assert apart.all(0).sum() == 40 > ENOUGH
    assert match(others[40:], real, mixed, apart) < 3
