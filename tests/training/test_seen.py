"""Pictures of training data are shown as a person would see them, whatever discriminators get."""

from __future__ import annotations

import torch

from unproject.data import chairs, wood
from unproject.ops.exposure import develop
from unproject.projections import Selection, Silhouette
from unproject.projections.standardised import standardised
from unproject.training.seen import as_seen, sheet_as_seen


def test_standardised_maps_are_shown_as_they_were() -> None:
    maps = wood(8, 16, 0)
    for name in ("diffuse", "specular", "roughness", "normal"):
        plain = Selection(name)
        brought = standardised(plain, plain(maps))
        seen, part = as_seen(brought, brought(maps)), plain(maps)
        wanted = {"roughness": part, "normal": part / 2 + 0.5}.get(name, develop(part))
        torch.testing.assert_close(seen, wanted.clamp(0, 1), atol=1e-4, rtol=0)


def test_materials_lines_and_silhouettes_are_shown() -> None:
    maps = wood(2, 16, 0)
    assert torch.equal(as_seen(Silhouette(), maps), develop(maps[:, :3]))
    masks = torch.rand(2, 1, 8, 8)
    assert torch.equal(as_seen(Silhouette(), masks), masks)
    lines = torch.tensor([[[0.0, 30.0, 15.0, 3.0]]])
    assert as_seen(Silhouette(), lines)[0, 0].sum(0).tolist() == [0, 4, 2, 0]


def test_volumes_are_shaded() -> None:
    sheet = sheet_as_seen(Silhouette(), chairs(3, 16), columns=2, cell=32)
    assert sheet.size == (64, 64)
    assert sheet_as_seen(Silhouette(), torch.rand(3, 1, 8, 8), columns=2, cell=32).size == (64, 64)
