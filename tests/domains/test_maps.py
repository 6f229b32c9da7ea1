"""Maps: pictures are judged beside other real ones, never beside themselves."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import torch
from torch import Tensor

from unproject.data import wood
from unproject.domains import Maps
from unproject.domains.evidence import MIN_PICTURES, Evidence
from unproject.domains.maps import MATCH
from unproject.export import MATERIAL_FORMATS
from unproject.ops.maps import MAPS
from unproject.projections import Identity, Observation, Projection
from unproject.recipes.material_panels import observation_of, standardised_panel


def match(generated: Tensor, real: Tensor, others: Tensor, apart: Tensor) -> float:
    views = torch.zeros(len(generated), dtype=torch.long)
    seen = Evidence(generated, views, real, None, others, apart, silhouettes=False)
    (finding,) = Maps().picture_findings(seen, seed=0)
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
    assert apart.all(0).sum() == 40 > MIN_PICTURES
    assert match(others[40:], real, mixed, apart) < 3


@pytest.mark.parametrize("meant", ["albedo", "eta"])
@pytest.mark.parametrize("to", MATERIAL_FORMATS)
def test_every_format_of_a_domain_says_what_its_specular_map_means(
    tmp_path: Path, to: str, meant: Literal["albedo", "eta"]
) -> None:
    maps = wood(1, 16, 0)
    Maps(fresnel=meant).exporters[to](maps, tmp_path / "own" / "oak")
    for fresnel in ("albedo", "eta"):
        MATERIAL_FORMATS[to](maps, tmp_path / fresnel / "oak", fresnel=fresnel)
    files = {file.relative_to(tmp_path / "own"): file.read_bytes() for file in (tmp_path / "own").rglob("*.*")}
    same = {f: all((tmp_path / f / k).read_bytes() == v for k, v in files.items()) for f in ("albedo", "eta")}
    assert files and [fresnel for fresnel, equal in same.items() if equal] == [meant]


def test_previews_shade_what_a_specular_map_means() -> None:
    """Of an index of refraction k_s of 1 reflects 4 % as much."""
    maps = wood(2, 16, 0)
    maps[:, 3] = 1
    dark, bright = (np.asarray(Maps(fresnel=meant).preview(maps)).astype(float) for meant in ("eta", "albedo"))
    assert np.array_equal(dark[:, : 4 * 16], bright[:, : 4 * 16])
    assert bright[:, 4 * 16 :].mean() > dark[:, 4 * 16 :].mean() + 40


def test_a_map_that_all_materials_share_is_matched_within_two_levels() -> None:
    """As a specular map of 0.04, standardised by 0.001: generated ones are off by so many thousandths."""
    real, apart = torch.full((12, 1, 16, 16), 0.5), torch.ones(12, 12, dtype=torch.bool)
    found = [match(real + 0.25 * off, real, real, apart) for off in (0.0, 6.0, 12.0, 40.0)]
    assert found[0] < found[1] < MATCH[0] < found[2] < MATCH[1] < found[3]


@pytest.mark.parametrize(("side", "cell"), [(16, 64), (48, 96), (64, 64), (80, 80)])
def test_previews_have_cells_in_which_labels_can_be_read(side: int, cell: int) -> None:
    sheet = Maps().preview(wood(3, side, 0))
    assert 8 * cell < sheet.width < 8 * cell + 20 and sheet.height == 16 + 3 * cell  # a number beside each row


def left_open(*observations: Observation) -> list[str]:
    return [f"{finding.word}: {finding.says}" for finding in Maps().open_findings(observations)]


def by_name(*names: str) -> list[Observation]:
    return [observation_of(name, torch.ones(1, 3, 4, 8), 2) for name in names]


def test_maps_that_nothing_tells_are_said_to_be_guesses() -> None:
    guesses = ["doubtful: nothing in the data tells the maps specular, roughness, normal, which are guesses"]
    for name in ("diffuse", "top", "ambient", "daylight", "lamp"):
        assert left_open(*by_name(name)) == guesses
    assert left_open(*standardised_panel(by_name("diffuse")[0], wood(2, 16)[:, :3]).observations) == guesses
    assert left_open(*by_name("daylight", "roughness")) == [guesses[0].replace(" roughness,", "")]
    for names in (("daylight", "flash"), ("coloured",), ("raking",), MAPS):
        assert left_open(*by_name(*names)) == []
    (lamp,) = by_name("lamp")
    assert left_open(replace(lamp, name="my own")) == [], "of which only the light is known"
    assert left_open(Observation("itself", Identity())) == []


def test_of_projections_that_are_not_known_nothing_is_said() -> None:
    class Mean(Projection):
        def forward(self, x: Tensor) -> Tensor:
            return x.mean(1, keepdim=True)

    assert left_open(Observation("mean", Mean()), *by_name("diffuse")) == []
