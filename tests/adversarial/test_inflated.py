"""The preference for thickness: what it costs to be flat, and what descent makes of boards."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from unproject._types import UserError
from unproject.adversarial import Inflated, inflated
from unproject.ops import local_widths

N = 16


def cost(x: Tensor) -> float:
    return Inflated(1.0, density=50.0)(x, 0.0).item()


def board(thickness: int, width: int = 9) -> Tensor:
    x = torch.zeros(1, N, N, N)
    x[:, 2 : 2 + thickness, 2:14, 3 : 3 + width] = 1
    return x


def plainly(x: Tensor, weight: float, narrowest: float, density: float) -> Tensor:
    """The formula, column by column."""
    found = []
    for volume in x:
        seen = (1 - 2 * torch.exp(-density * volume.sum(0))).clamp_min(0)
        before = torch.stack([volume[: k + 1].sum(0).clamp(max=1) for k in range(len(volume))])
        behind = torch.stack([volume[k:].sum(0).clamp(max=1) for k in range(len(volume))])
        seen = seen.detach()
        height = sum(bool((row > 0).any()) for row in seen)
        asked = local_widths(seen[None])[0].clamp(max=narrowest * max(height, 1))
        short = asked - (before * behind).sum(0)
        found.append((seen * short.clamp_min(0)).sum() / seen.sum() / len(volume))
    return weight * torch.stack(found).mean()


@pytest.mark.parametrize("narrowest", [math.inf, 0.15])
def test_it_is_its_formula(narrowest: float) -> None:
    torch.manual_seed(0)
    x = torch.nn.functional.interpolate(torch.rand(3, 1, 4, 4, 4) - 0.4, (8, 12, 16), mode="trilinear")[:, 0]
    x = x.clamp_min(0).mul(torch.rand(3, 8, 12, 16)).requires_grad_()
    term, reference = Inflated(3.0, narrowest, density=8.0)(x, 0.3), plainly(x, 3.0, narrowest, 8.0)
    torch.testing.assert_close(term, reference)
    assert term > 1e-3
    torch.testing.assert_close(*(torch.autograd.grad(value, x)[0] for value in (term, reference)))


def test_columns_that_are_left_out_count_for_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a GPU none is left out."""
    some = Inflated(1.0)(board(2), 0.0)
    monkeypatch.setattr(inflated, "_counted", lambda widths: torch.arange(len(widths)))
    torch.testing.assert_close(Inflated(1.0)(board(2), 0.0), some)
    assert some > 0


def test_a_board_costs_what_it_lacks_and_a_block_nothing() -> None:
    """Of a square of 9, widths are 9, 7, 5, 3 and 1 from the middle out; larger frames show the middle row."""
    x = torch.zeros(1, 20, 20, 20)
    x[:, 5:7, 5:14, 5:14] = 1
    lacks = (1 * 7 + 8 * 5 + 16 * 3 + 24 * 1) / 81 / 20
    assert cost(x) == pytest.approx(lacks, rel=1e-5)
    x[:, 2:11, 5:14, 5:14] = 1
    assert cost(x) == 0


def test_thicker_costs_less_and_thin_legs_nothing() -> None:
    costs = [cost(board(thickness)) for thickness in range(1, 10)]
    assert all(a > b for a, b in zip(costs, costs[1:5], strict=False)) and costs[-1] == 0
    assert cost(board(1, width=1)) == cost(board(2, width=2)) == 0


def test_nothing_need_be_thicker_than_the_narrowest_pictures_are_wide() -> None:
    """A board of twelve rows, wherever it is; the more pictures of other sides allow, the more is asked."""
    allowed = [Inflated(1.0, a, density=50.0)(board(3), 0.0).item() for a in (0.1, 0.25, 0.4, 0.5, math.inf)]
    assert allowed[0] == allowed[1] == 0 < allowed[2] < allowed[3] < allowed[4]
    assert Inflated(1.0, 0.4, density=50.0)(board(3).roll(2, 2), 0.0).item() == pytest.approx(allowed[2])


def test_haze_is_not_filled() -> None:
    """Between the legs of a block, say: it absorbs 47 % of the light, over seven voxels each way."""
    x = board(9)
    x[:, :, 5:12, 4:11] = 0.02
    x.requires_grad_()
    term = Inflated(1.0)(x, 0.0)
    term.backward()
    assert x.grad is not None and (x.grad[:, :, 5:12, 4:11] == 0).all()
    full = board(1)
    full[:, 2, 5:12, 4:11] = 0.5  # and 63 %, of a board
    full.requires_grad_()
    Inflated(1.0)(full, 0.0).backward()
    assert full.grad is not None and (full.grad[:, 2, 7, 7] < 0).all()


def test_a_shell_is_as_thick_as_it_is_outside() -> None:
    shell = board(9)
    shell[:, 3:10, 3:13, 4:11] = 0
    assert cost(shell) == 0 < cost(board(4))


def test_place_along_x_does_not_matter_and_silhouettes_are_left_as_they_are() -> None:
    x = board(2).requires_grad_()
    Inflated(1.0)(x, 0.0).backward()
    assert cost(board(2)) == pytest.approx(cost(board(2).roll(5, 1)), rel=1e-6)
    gradient = x.grad
    assert gradient is not None and (gradient <= 0).all()
    empty = board(2).sum(1, keepdim=True).expand_as(gradient) == 0
    assert (gradient[empty] == 0).all() and (gradient[:, 6, 8, 7] < 0).all()


def test_a_board_of_any_thickness_becomes_as_thick_as_it_is_wide_and_not_more() -> None:
    place, outline = (torch.arange(N) - 7.5).abs()[None, :, None, None], board(2).amax(1, keepdim=True)
    half = torch.tensor(1.0, requires_grad=True)
    adam = torch.optim.Adam([half], 0.1)
    for _ in range(200):
        adam.zero_grad()
        Inflated(10.0)(outline * torch.sigmoid(4 * (half - place)), 0.0).backward()
        adam.step()
    assert 4.0 < half.item() < 5.0  # nine voxels in the middle


def test_its_mean_is_of_some_volumes() -> None:
    both = torch.cat([board(1), board(9)])
    assert Inflated(1.0, volumes=1)(both, 0.0) == Inflated(1.0)(both[:1], 0.0) > 1.9 * Inflated(1.0)(both, 0.0)


def test_empty_volumes_are_finite_and_bad_numbers_refused() -> None:
    x = torch.zeros(2, 8, 8, 8, requires_grad=True)
    Inflated()(x, 0.0).backward()
    assert x.grad is None or x.grad.isfinite().all()
    for bad in ({"weight": -1.0}, {"weight": math.nan}, {"narrowest": 0.0}, {"density": 0.0}, {"volumes": 0}):
        with pytest.raises(UserError, match=next(iter(bad))):
            Inflated(**bad)  # type: ignore[arg-type]
