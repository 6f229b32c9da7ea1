"""Priors: what they draw, what they contain, and bins that share a turn without gap or overlap."""

from __future__ import annotations

import math
from collections.abc import Mapping

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from unproject._random import generator_at
from unproject._types import UserError
from unproject.projections.priors import (
    TURN,
    Bins,
    Cap,
    Empirical,
    Mixture,
    Prior,
    Product,
    Uniform,
    factors_of,
    sample_each,
)
from unproject.testing import check_prior, run_laws

TABLE = {"azimuth": torch.tensor([0.1, 0.2, 3.0]), "elevation": torch.tensor([1.0, 0.0, -1.0])}
PRIORS: dict[str, Prior] = {
    "uniform": Uniform("a", -1, 2),
    "point": Uniform("a", 0.1, 0.1),
    "periodic": Uniform("a", 6.0, 6.6, TURN),
    "product": Product(Uniform("a", 0, 1), Uniform("b", 2, 3)),
    "nothing": Product(),
    "mixture": Mixture([Uniform("a", 0, 1), Uniform("a", 3, 4)], [1, 3]),
    "bins": Bins("a", 7, centre=0.3),
    "bin": Bins("a", 7).parts[0],
    "nested": Mixture([Product(Bins("a", 4), Uniform("b", 0, 0)), Product(Uniform("a", 9, 9), Uniform("b", 1, 1))]),
    "empirical": Empirical(TABLE),
    "cap": Cap("a", "b", 1.4),
}


def draw(prior: Prior, n: int = 1000, seed: int = 0) -> dict[str, Tensor]:
    return prior.sample(n, generator_at(seed))


def contains(prior: Prior, *values: float) -> list[bool]:
    return prior.contains({prior.names[0]: torch.tensor(values)}).tolist()


@pytest.mark.parametrize("name", PRIORS)
def test_priors_obey_the_laws(name: str) -> None:
    check_prior(PRIORS[name])


class WithoutPeriod(Bins):
    """The mutant: a bin that forgets the turn contains only what lies on its own side of zero."""

    def contains(self, latents: Mapping[str, Tensor]) -> Tensor:
        a = latents["a"] % TURN
        return (a >= self.parts[0].low) & (a < self.parts[-1].high)  # type: ignore[attr-defined]


def test_the_law_of_support_catches_a_bin_without_a_period() -> None:
    assert [law.name for law in run_laws(WithoutPeriod("a", 1)) if not law.passed] == ["support"]


# Uniform


def test_uniform_draws_fill_their_range() -> None:
    drawn = draw(Uniform("a", -1, 3), 4000)["a"]
    counts = torch.histc(drawn, 8, -1, 3)
    assert counts.sum() == 4000 and ((counts - 500) ** 2 / 500).sum() < 24.3  # χ² of 7 degrees, one in a thousand


def test_membership_is_half_open() -> None:
    assert contains(Uniform("a", -1, 2), -1.01, -1, 0, 1.99, 2) == [False, True, True, True, False]
    assert contains(Uniform("a", 0.5, 0.5), 0.5, 0.51) == [True, False]


@pytest.mark.parametrize("turns", [-2, -1, 0, 1, 3])
def test_membership_wraps_around(turns: int) -> None:
    around_zero = Uniform("a", -0.2, 0.2, TURN)
    inside = [x + turns * TURN for x in (-0.19, 0, 0.19)]
    outside = [x + turns * TURN for x in (-0.21, 0.21, math.pi)]
    assert contains(around_zero, *inside) == [True] * 3
    assert contains(around_zero, *outside) == [False] * 3
    assert contains(Uniform("a", 0.5, 0.5, TURN), 0.5, 0.6) == [True, False]
    assert contains(Uniform("a", -0.2, 0.2), -0.19 + TURN) == [False]


def test_a_whole_period_contains_everything() -> None:
    assert all(contains(Uniform("a", 0, TURN, TURN), -1e-16, 0, 1e-16, 3, TURN, -7, 100))


@pytest.mark.parametrize("low, high", [(1, 0), (0, math.inf), (math.nan, 1)])
def test_wrong_ranges_are_refused(low: float, high: float) -> None:
    with pytest.raises(UserError, match="give finite low <= high"):
        Uniform("a", low, high)


@pytest.mark.parametrize("period", [0, -1, math.inf])
def test_wrong_periods_are_refused(period: float) -> None:
    with pytest.raises(UserError, match="give a positive period"):
        Uniform("a", 0, 1, period)


# Bins

CENTRES = st.sampled_from(["zero", "half a bin", "odd"])


@settings(deadline=None)
@given(st.integers(1, 40), CENTRES, st.lists(st.floats(-20, 20, width=32), max_size=20), st.integers(-80, 80))
def test_bins_partition_the_turn(count: int, centre: str, values: list[float], edge: int) -> None:
    bins = Bins("a", count, {"zero": 0.0, "half a bin": math.pi / count, "odd": 1.3}[centre])
    first = bins.parts[0]
    assert isinstance(first, Uniform)
    on_edge = torch.tensor([first.low + edge * TURN / count])
    beside = [torch.nextafter(on_edge, on_edge + side) for side in (-1, 1)]
    azimuths = torch.cat([torch.tensor(values), torch.tensor([0.0]), on_edge, *beside])
    inside = torch.stack([part.contains({"a": azimuths}) for part in bins.parts])
    assert (inside.sum(0) == 1).all()
    assert bins.contains({"a": azimuths}).all()


def test_sixteen_bins_are_centred_on_their_azimuths() -> None:
    degrees = torch.tensor([0, 11.2, 11.3, -11.2, 348.8, 22.5, 337.5, 180])
    bins = Bins("a", 16)
    inside = torch.stack([part.contains({"a": degrees.deg2rad()}) for part in bins.parts], 1)
    assert inside.long().argmax(1).tolist() == [0, 0, 1, 0, 0, 1, 15, 8]


def test_bins_draw_each_bin_equally_and_from_all_around() -> None:
    bins = Bins("a", 5)
    drawn = draw(bins, 5000)
    counts = torch.tensor([int(part.contains(drawn).sum()) for part in bins.parts])
    assert counts.sum() == 5000 and ((counts - 1000) ** 2 / 1000).sum() < 18.5


def test_no_bins_are_refused() -> None:
    with pytest.raises(UserError, match="count must be at least 1, not 0"):
        Bins("a", 0)


# Cap


@pytest.mark.parametrize("most", [0.2, 1.4, math.pi])
def test_a_cap_is_drawn_evenly_over_its_part_of_the_sphere(most: float) -> None:
    """Equal heights of a sphere have equal areas (Archimedes): cosθ is uniform from cos(most) to 1."""
    drawn = draw(Cap("a", "b", most), 4000)
    share = (1 - drawn["a"].double().cos()) / (1 - math.cos(most))
    for value in (share, drawn["b"].double() / TURN):
        counts = torch.histc(value, 8, 0, 1)
        assert counts.sum() == 4000 and ((counts - 500) ** 2 / 500).sum() < 24.3  # χ² of 7 degrees, one in a thousand


# Product and mixture


def test_a_product_is_independent_and_contains_what_all_factors_do() -> None:
    prior = Product(Uniform("a", 0, 1), Uniform("b", 0, 1))
    drawn = draw(prior, 4000)
    assert prior.names == tuple(drawn) == ("a", "b")
    assert abs(torch.corrcoef(torch.stack([drawn["a"], drawn["b"]]))[0, 1]) < 0.05
    corners = {"a": torch.tensor([0.5, 0.5, 2.0]), "b": torch.tensor([0.5, 2.0, 0.5])}
    assert prior.contains(corners).tolist() == [True, False, False]


def test_a_product_of_nothing_draws_nothing() -> None:
    assert Product().names == () and draw(Product()) == {}


def test_a_latent_drawn_twice_is_refused() -> None:
    with pytest.raises(UserError, match=r"same latent twice \(a, a\)"):
        Product(Uniform("a", 0, 1), Uniform("a", 0, 1))


def test_a_mixture_draws_its_parts_by_weight() -> None:
    prior = Mixture([Uniform("a", 0, 1), Uniform("a", 3, 4)], [1, 3])
    assert prior.weights == (0.25, 0.75)
    assert (draw(prior, 4000)["a"] > 2).float().mean().item() == pytest.approx(0.75, abs=0.03)
    assert contains(prior, 0.5, 2.0, 3.5) == [True, False, True]


@pytest.mark.parametrize(
    "parts, weights, message",
    [
        ([], None, "at least one part"),
        ([Uniform("a", 0, 1)], [1, 1], "one non-negative weight a part"),
        ([Uniform("a", 0, 1)], [-1], "non-negative"),
        ([Uniform("a", 0, 1)], [0], "not all zero"),
        ([Uniform("a", 0, 1), Uniform("b", 0, 1)], None, "the same latents"),
    ],
)
def test_wrong_mixtures_are_refused(parts: list[Prior], weights: list[float] | None, message: str) -> None:
    with pytest.raises(UserError, match=message):
        Mixture(parts, weights)


def test_a_part_of_no_weight_is_never_drawn_nor_contained() -> None:
    prior = Mixture([Uniform("a", 0, 1), Uniform("a", 3, 4)], [1, 0])
    assert contains(prior, 0.5, 3.5) == [True, False]


def test_azimuths_of_a_cap_are_any_turn() -> None:
    inside = Cap("light", "around", 0.5).contains(
        {"light": torch.full((4,), 0.2), "around": torch.tensor([-1.0, 5, 7, math.nan])}
    )
    assert inside.tolist() == [True, True, True, False]


# Empirical


def test_rows_of_a_table_are_drawn_whole_and_equally() -> None:
    prior = Empirical(TABLE)
    drawn = draw(prior, 3000)
    rows = torch.stack([drawn[name] for name in prior.names], 1)
    found, counts = rows.unique(dim=0, return_counts=True)
    assert torch.equal(found, torch.stack(list(TABLE.values()), 1).unique(dim=0))
    assert ((counts - 1000) ** 2 / 1000).sum() < 13.8


def test_a_table_contains_its_rows_and_no_mixture_of_them() -> None:
    asked = {"azimuth": torch.tensor([0.1, 0.1, 0.2]), "elevation": torch.tensor([1.0, 0.0, 0.0])}
    assert Empirical(TABLE).contains(asked).tolist() == [True, False, True]


def test_large_tables_are_searched_without_all_pairs() -> None:
    """A million pairs would be quick too; of these there are 40 billion."""
    column = torch.arange(200_000).float()
    asked = torch.cat([column[::2] + 0.5, column[1::2]])
    assert int(Empirical({"azimuth": column}).contains({"azimuth": asked}).sum()) == 100_000


@pytest.mark.parametrize("table", [{}, {"a": torch.empty(0)}, {"a": torch.zeros(2), "b": torch.zeros(3)}])
def test_wrong_tables_are_refused(table: dict[str, Tensor]) -> None:
    with pytest.raises(UserError, match="Empirical: give at least one row"):
        Empirical(table)


def test_tables_can_be_compared_and_hashed() -> None:
    prior = Empirical(TABLE)
    assert prior == prior and prior != Empirical(TABLE) and len({prior, prior}) == 1


# One prior a row


def test_every_row_is_drawn_from_its_own_prior() -> None:
    priors = [Product(Uniform("a", k, k + 0.5), Uniform("b", -k, -k)) for k in range(4)]
    which = torch.tensor([3, 0, 2, 3, 0, 3])
    drawn = sample_each(priors, which, generator_at(0))
    assert set(drawn) == {"a", "b"} and torch.equal(drawn["b"], -which.float())
    assert torch.equal(drawn["a"].floor(), which.float()) and len(drawn["a"].unique()) == len(which)


@pytest.mark.parametrize("edge", [k * math.pi / 10 for k in range(20)])
def test_a_single_angle_contains_itself_in_single_precision(edge: float) -> None:
    prior = Uniform("angle", edge, edge, period=math.pi)
    assert bool(prior.contains(prior.sample(8, torch.Generator())).all())


def test_factors_of_nested_products_are_flat() -> None:
    a, b, c = (Uniform(name, 0, 1) for name in "abc")
    assert factors_of(Product(a, Product(b, c))) == (a, b, c)
    assert factors_of(a) == (a,) and factors_of(Product()) == ()
