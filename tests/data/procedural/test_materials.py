"""Procedural data sets of materials: what they promise, for many of them."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from unproject._types import UserError
from unproject.data import correlated, fabric, metal, plastic, wood
from unproject.data.procedural.materials.correlated import FIELDS, octave_correlations
from unproject.data.procedural.materials.fabric import (
    WEAVES,
    basket,
    build_fabric,
    denim,
    herringbone,
    plain,
    satin,
    twill,
    woven,
)
from unproject.data.procedural.materials.materials import BLOCK, FABRIC, METAL, PLASTIC, WOOD
from unproject.data.procedural.materials.metal import METALS, STRUCTURES
from unproject.data.procedural.materials.noise import Chances, draw
from unproject.data.procedural.materials.patterns import cells, normals, scratches, texels
from unproject.data.procedural.materials.plastic import MOULDS
from unproject.data.procedural.materials.wood import SPECIES, wood_gloss
from unproject.ops.maps import MAPS, check_maps, luminance, unpack_maps, with_specular

DATA_SETS = {"wood": wood, "metal": metal, "plastic": plastic, "fabric": fabric, "correlated": correlated}
MANY = 160


@pytest.fixture(scope="module")
def many():
    return {name: make(MANY, 64, seed=0) for name, make in DATA_SETS.items()}


@pytest.fixture(params=list(DATA_SETS))
def named(request, many):
    return DATA_SETS[request.param], many[request.param]


def part(maps, name):
    return maps[:, MAPS[name]]


def seam(x):
    """Mean difference of neighbours across the tile's edges, over that inside: (rows, columns)."""
    edge = [(x - x.roll(1, axis)).abs().mean((0, 1)) for axis in (2, 3)]
    rows, columns = edge[0].mean(1), edge[1].mean(0)
    return float(rows[0] / rows[1:].mean()), float(columns[0] / columns[1:].mean())


def test_they_are_maps_of_a_material(named):
    maps = named[1]
    assert maps.shape == (MANY, 8, 64, 64) and maps.dtype == torch.float32
    assert check_maps(maps) is maps
    assert float(part(maps, "diffuse").max()) <= 0.95
    assert float(part(maps, "roughness").min()) >= 0.02 and float(part(maps, "roughness").max()) <= 0.95
    assert float(part(maps, "normal")[:, 2].min()) > 0.6


def test_a_coloured_specular_albedo_is_as_bright_as_the_one_of_one_channel(named):
    """And has no colour but a metal's."""
    make, maps = named
    coloured = make(MANY, 64, seed=0, coloured=True)
    assert coloured.shape == (MANY, 10, 64, 64)
    check_maps(coloured)
    torch.testing.assert_close(with_specular(coloured, 1)[:, 3:], maps[:, 3:], atol=1e-6, rtol=1e-6)
    if make is not metal:
        assert torch.equal(coloured, with_specular(maps, 3))


def test_metals_have_their_measured_colour_and_no_tint_below(many):
    """A bare one without patina reflects what was measured; what has other colours is corrosion and paint."""
    coloured, drawn = metal(MANY, 16, seed=0, coloured=True), draw(METAL, range(MANY), 16, 0)
    parts = unpack_maps(coloured)
    bare = ((drawn["finish"] < 0.5) & (drawn["patina"] <= 0) & (drawn["structure"].floor() != 8))[:, 0, 0]
    assert bare.sum() > 10
    reflected = torch.tensor([one.reflectance for one in METALS.values()])[drawn["metal"].flatten().long()]
    torch.testing.assert_close(
        parts["specular"][bare], reflected[bare, :, None, None].expand(-1, -1, 16, 16), atol=1e-6, rtol=0
    )
    unpainted = drawn["finish"].flatten() < 0.5
    base = parts["diffuse"][unpainted]
    torch.testing.assert_close(base, base[:, :1].expand_as(base), atol=1e-6, rtol=0)
    tinted = part(many["metal"], "diffuse")[unpainted]
    assert (tinted[:, 0] > 1.5 * tinted[:, 2]).any()


def test_an_item_depends_on_its_seed_and_index_alone(named):
    make, maps = named
    for count in (1, 7, BLOCK, BLOCK + 1):
        assert torch.equal(make(count, 64, seed=0), maps[:count])
    assert not torch.equal(make(7, 64, seed=1), maps[:7])
    assert not torch.equal(maps[0], maps[BLOCK])


def test_no_two_are_alike(named):
    flat = named[1].flatten(1)
    assert float(torch.cdist(flat, flat).fill_diagonal_(9).min()) > 0.5


@pytest.mark.parametrize("size", [16, 33, 96, 130])
def test_other_sizes(size):
    for make in DATA_SETS.values():
        assert make(3, size).shape == (3, 8, size, size)


@pytest.mark.parametrize("name", ["metal", "plastic", "fabric", "correlated"])
def test_they_tile(name, many):
    rows, columns = seam(many[name])
    assert 0.6 < rows < 1.4 and 0.6 < columns < 1.4


def test_wood_tiles_along_the_grain_and_where_it_has_gaps(many):
    drawn = draw(WOOD, range(MANY), 64, 0)
    several = (drawn["boards"] >= 2).flatten()
    assert 0.3 < float(several.float().mean()) < 0.7
    colour = part(many["wood"], "diffuse")
    assert 0.6 < seam(colour)[0] < 1.4
    assert seam(colour[several])[1] < 1.4


def test_wood_runs_along_y(many):
    colour = part(many["wood"], "diffuse")
    along, across = (colour - colour.roll(1, 2)).abs().mean(), (colour - colour.roll(1, 3)).abs().mean()
    assert float(across) > 1.8 * float(along)


def test_woods_have_the_colours_of_woods(many):
    red, green, blue = part(many["wood"], "diffuse").mean((2, 3)).unbind(1)
    assert bool((red > 0.9 * green).all()) and bool((green > 0.9 * blue).all())
    light = luminance(part(many["wood"], "diffuse")).mean((1, 2, 3))
    assert 0.005 < float(light.min()) < 0.06 and 0.4 < float(light.max()) < 0.8


def test_woods_specular_and_roughness_are_functions_of_its_diffuse_map(many):
    specular, roughness = wood_gloss(part(many["wood"], "diffuse"))
    assert torch.allclose(specular, part(many["wood"], "specular"), atol=1e-6)
    assert torch.allclose(roughness, part(many["wood"], "roughness"), atol=1e-6)
    assert 0.03 < float(specular.mean()) < 0.05


def test_dark_texels_of_a_wood_reflect_less_and_are_duller():
    halves = torch.full((1, 3, 4, 4), 0.3)
    halves[..., :2] = 0.1
    specular, roughness = wood_gloss(halves)
    assert float(specular[0, 0, 0, 0]) < float(specular[0, 0, 0, 3])
    assert float(roughness[0, 0, 0, 0]) > float(roughness[0, 0, 0, 3])


def test_gaps_lie_deeper_than_boards(many):
    """At both sides of a dark line the normals lean towards it."""
    drawn = draw(WOOD, range(MANY), 64, 0)
    straight = (drawn["boards"] >= 2).flatten() & (drawn["cut"] <= 0.4).flatten()
    light = luminance(part(many["wood"][straight], "diffuse"))[:, 0].mean(1)
    gap = light.argmin(1)
    lean = part(many["wood"][straight], "normal")[:, 0].mean(1)
    left, right = (lean.gather(1, (gap[:, None] + step) % 64) for step in (-1, 1))
    assert float((left > right).float().mean()) > 0.95


def test_bare_metals_reflect_what_their_tables_say_and_scatter_nothing(many):
    drawn = draw(METAL, range(MANY), 64, 0)
    clean = ((drawn["finish"] < 0.5) & (drawn["patina"] < 0)).flatten() & (drawn["structure"].flatten() < 8)
    maps = many["metal"][clean]
    table = luminance(torch.tensor([m.reflectance for m in METALS.values()])[:, :, None, None])
    expected = table[drawn["metal"].flatten()[clean].long()]
    assert clean.sum() > 10
    assert torch.allclose(part(maps, "specular"), expected.expand(-1, -1, 64, 64), atol=1e-5)
    assert float(part(maps, "diffuse").max()) < 0.02


def test_metals_are_either_metal_or_covered(many):
    """Where a texel is neither bare nor a hole it is a dielectric that scatters."""
    light, specular = luminance(part(many["metal"], "diffuse")), part(many["metal"], "specular")
    bare, covered = specular > 0.3, specular < 0.06
    assert float((bare | covered).float().mean()) > 0.9
    assert 0.4 < float(bare.float().mean()) < 0.85
    assert float(light[bare].mean()) < 0.03 and float(light[covered].mean()) > 0.1


def test_plastics_are_dielectrics_of_one_colour(many):
    maps = many["plastic"]
    specular = part(maps, "specular")
    assert float(specular.amin()) > 0.033 and float(specular.amax()) < 0.054
    assert float((specular.amax((2, 3)) - specular.amin((2, 3))).max()) == 0
    colour = part(maps, "diffuse")
    chroma = 1 - colour.amin(1) / colour.amax(1)
    assert float((chroma.flatten(1).median(1).values > 0.4).float().mean()) > 0.6
    plain = (draw(PLASTIC, range(MANY), 64, 0)["speckles"] < 0).flatten()
    hue = colour[plain] / colour[plain].sum(1, keepdim=True)
    assert float(hue.std((2, 3)).max()) < 1e-4


def test_gloss_goes_from_mirror_to_matt(many):
    typical = part(many["plastic"], "roughness").flatten(1).median(1).values
    assert float(typical.min()) < 0.05 and float(typical.max()) > 0.35


@pytest.mark.parametrize("over, repeat, warp", [
    (plain, 2, 1 / 2), (twill, 4, 1 / 2), (denim, 4, 3 / 4), (satin, 5, 4 / 5), (basket, 4, 1 / 2),
    (herringbone, 8, 1 / 2),
])  # fmt: skip
def test_a_weave_repeats_itself_and_holds_together(over, repeat: int, warp: float):
    """Every thread passes over and under others, or it would come loose."""
    i, j = torch.meshgrid(torch.arange(-8.0, 40), torch.arange(-8.0, 40), indexing="ij")
    above = over(i, j)
    assert torch.equal(above[repeat:], above[:-repeat]) and torch.equal(above[:, repeat:], above[:, :-repeat])
    assert float(above[: 40 - 40 % repeat, : 40 - 40 % repeat].float().mean()) == pytest.approx(warp)
    for axis in (0, 1):
        assert above.any(axis).all() and (~above).any(axis).all()


def test_herringbone_is_mirrored_at_its_turns():
    i, j = torch.meshgrid(torch.arange(8.0), torch.arange(8.0), indexing="ij")
    above = herringbone(i, j)
    assert torch.equal(above, above.flip(0)) and torch.equal(above[:4], twill(i, j)[:4])


@pytest.mark.parametrize("over, repeat", [(plain, 2), (twill, 4), (satin, 5), (herringbone, 8)])
@pytest.mark.parametrize("count, most", [(0.0, 8), (1.0, 16)])
def test_a_tile_has_whole_repeats_of_a_weave(over, repeat: int, count: float, most: int):
    """Rolled by one repeat, across its edges, it is itself."""
    drawn = draw(FABRIC, range(3), 240, 0)
    place = list(FABRIC.numbers).index("count")
    made = woven(over, repeat)(replace(drawn, uniform=drawn.uniform.index_fill(1, torch.tensor([place]), count)))
    made = made[:, :3]  # the last two say where threads are
    repeats = round(most / repeat)
    for axis in (2, 3):
        torch.testing.assert_close(made.roll(240 // repeats, axis), made, atol=1e-4, rtol=0)


def test_threads_that_stand_out_are_polished_and_lie_in_the_light(many):
    """In each fabric without colours and prints: bright, smooth and reflecting where it is high."""
    drawn = draw(FABRIC, range(MANY), 64, 0)
    even = (
        (drawn["design"] < 0.4) & (drawn["print"] < 0.65) & (drawn["melange"] <= 0) & (drawn["weave"] < 9)
    ).flatten()
    maps = many["fabric"][even]
    light, specular, roughness = luminance(part(maps, "diffuse")), part(maps, "specular"), part(maps, "roughness")
    assert even.sum() > 8
    for dependent, sign in ((light, 1), (roughness, -1)):
        both = torch.stack([specular.flatten(1), dependent.flatten(1)], 1)
        assert all(sign * float(torch.corrcoef(pair)[0, 1]) > 0.5 for pair in both)


def bare(designs: tuple[float, float]):
    """What was drawn of fabrics with these designs, dyed in dark flax and plum alone."""
    drawn = draw(FABRIC, range(4 * MANY), 60, 0)
    fixed = {"print": 0.0, "melange": 0.0, "light": 0.0, "first": 1.5 / 12, "second": 0.999}
    uniform = drawn.uniform.clone()
    for place, name in enumerate(FABRIC.numbers):
        uniform[:, place] = fixed.get(name, uniform[:, place])
    chosen = (drawn["design"] >= designs[0]) & (drawn["design"] < designs[1])
    return replace(drawn, uniform=uniform).take(chosen.flatten())


def changes(design: tuple[float, float], axis: int, kinds: tuple[int, ...]):
    """Whether colours of fabrics of these kinds change along an axis."""
    drawn = bare(design)
    drawn = drawn.take(sum(drawn["weave"].floor() == kind for kind in kinds).flatten() > 0)
    found = hue(drawn)
    assert len(found) > 5
    return (found - found.roll(1, axis - 1)).abs().amax((1, 2)) > 0.01


def hue(drawn):
    """The share of green, which shadows do not change."""
    colour = part(build_fabric(drawn), "diffuse")
    return colour[:, 1] / colour.sum(1)


def test_designs_show_in_their_threads():
    """Corduroy, all warp, has a second colour in stripes and checks only, both along y; a check shows in the weft."""
    plain_cloth, two, stripes, checks = (0.0, 0.4), (0.4, 0.55), (0.55, 0.75), (0.75, 1.0)
    for design in (plain_cloth, two):
        assert not changes(design, 3, (8,)).any()
    for design in (stripes, checks):
        assert changes(design, 3, (8,)).float().mean() > 0.8 and not changes(design, 2, (8,)).any()
    weaves = tuple(range(7))
    assert not changes(plain_cloth, 2, weaves).any() and changes(two, 2, weaves).all()
    assert not changes(stripes, 2, weaves).any()
    assert changes(checks, 2, weaves).float().mean() > 0.8


def test_a_thread_has_one_colour():
    """Stripes of woven cloth change where one thread of the warp ends and the next begins."""
    drawn = bare((0.55, 0.75))
    drawn = drawn.take((drawn["weave"] < 2).flatten())
    found = hue(drawn)
    threads = 2 * torch.ceil((8 + 8 * drawn["count"].flatten()) / 2 - 0.5)
    place = (torch.arange(60) + 0.5) / 60
    for one, n in zip(found, threads, strict=True):
        of_thread = (place * n).floor()
        assert max(float(one[:, of_thread == k].std()) for k in range(int(n))) < 1e-5


def test_prints_have_no_relief(many):
    """The same fabric without its print has the same normals, and nearly always other colours and another gloss."""
    drawn = draw(FABRIC, range(MANY), 64, 0)
    inked = (drawn["print"] >= 0.65).flatten()
    place = list(FABRIC.numbers).index("print")
    clean = replace(drawn, uniform=drawn.uniform.index_fill(1, torch.tensor([place]), 0.0)).take(inked)
    without, maps = build_fabric(clean), many["fabric"][inked]
    torch.testing.assert_close(part(without, "normal"), part(maps, "normal"), atol=1e-5, rtol=0)
    for name in ("diffuse", "roughness"):
        differs = (part(without, name) - part(maps, name)).abs().amax((1, 2, 3)) > 0.01
        assert float(differs.float().mean()) > 0.9


@pytest.mark.parametrize("chances, field, kinds", [
    (METAL, "structure", len(STRUCTURES)),
    (PLASTIC, "mould", len(MOULDS)),
    (WOOD, "species", len(SPECIES)),
    (FABRIC, "weave", len(WEAVES)),
], ids=["metal", "plastic", "wood", "fabric"])  # fmt: skip
def test_every_kind_comes_up(chances: Chances, field: str, kinds: int):
    drawn = draw(chances, range(MANY), 16, 0)[field].flatten().long()
    assert sorted(set(drawn.tolist())) == list(range(kinds))


@pytest.mark.parametrize("asked", [(0.9, 0.9), (-0.5, 0.3), (0.0, 0.0), (1.0, -1.0)])
@pytest.mark.parametrize("size", [32, 64, 100])
def test_the_correlations_are_those_asked_for_in_every_octave(asked, size):
    found = octave_correlations(correlated(40, size, 3, *asked))
    r, s = asked
    expected = torch.tensor([[1, r, 0, 0], [r, 1, 0, 0], [0, 0, 1, s], [0, 0, s, 1]], dtype=torch.float64)
    assert found.shape == (40, {32: 4, 64: 5, 100: 6}[size], 4, 4)
    assert float((found.mean(0) - expected).abs().max()) < 0.001
    assert float((found - expected).abs().max()) < 0.03


def test_another_way_to_measure_finds_the_same(many):
    """Pearson over all texels, each less its material's mean: Laplacian of Y and -div n/n_z, k_s and m, across."""
    maps = many["correlated"]
    n = part(maps, "normal")
    p, q = -n[:, 0] / n[:, 2], -n[:, 1] / n[:, 2]
    laplacian = p.roll(-1, 2) - p.roll(1, 2) + q.roll(1, 1) - q.roll(-1, 1)
    light = luminance(part(maps, "diffuse"))[:, 0]
    curved = light.roll(1, 1) + light.roll(-1, 1) + light.roll(1, 2) + light.roll(-1, 2) - 4 * light

    def pearson(a, b):
        a, b = (x - x.mean((1, 2), keepdim=True) for x in (a, b))
        return float((a * b).mean() / (a.square().mean() * b.square().mean()).sqrt())

    specular, roughness = part(maps, "specular")[:, 0], part(maps, "roughness")[:, 0]
    assert pearson(light, specular) == pytest.approx(0, abs=0.01)
    assert pearson(specular, roughness) == pytest.approx(0.9, abs=0.01)
    assert pearson(curved, laplacian) == pytest.approx(0.9, abs=0.03)
    assert pearson(light, roughness) == pytest.approx(0, abs=0.01)


def test_what_differs_between_materials_is_independent(many):
    means = torch.cat(
        [luminance(part(many["correlated"], "diffuse")), *(part(many["correlated"], n) for n in FIELDS[2:])], 1
    )
    found = torch.corrcoef(means.mean((2, 3)).T) - torch.eye(3)
    assert float(found.abs().max()) < 0.25  # three standard errors of 160


def test_the_statistic_is_zero_where_there_is_nothing():
    flat = torch.zeros(2, 8, 32, 32)
    flat[:, 4], flat[:, 7] = 0.3, 1
    assert float(octave_correlations(flat).abs().max()) == 0


def test_shuffled_maps_lose_their_correlation(many):
    maps = many["correlated"].clone()
    maps[:, MAPS["normal"]] = maps[:, MAPS["normal"]].roll(1, 0)
    found = octave_correlations(maps).mean((0, 1))
    assert abs(float(found[0, 1])) < 0.05 and float(found[2, 3]) == pytest.approx(0.9, abs=0.001)


def test_normals_lean_away_from_what_rises():
    """Height rises to the right and upwards: normals point left and down."""
    x, y = texels(32)
    hill = -0.01 * torch.cos(2 * torch.pi * x) - 0.01 * torch.cos(2 * torch.pi * y)
    n = normals(hill)[0]
    assert float(n[0, 8, 8]) < 0 and float(n[0, 8, 24]) > 0  # left half rises, right half falls
    assert float(n[1, 24, 8]) < 0 and float(n[1, 8, 8]) > 0  # lower half rises, upper half falls


def test_cells_and_scratches_repeat_themselves():
    generator = torch.Generator().manual_seed(0)
    nearest, second = cells(torch.tensor([5.0, 8.0])[:, None, None], torch.rand(2, 128, generator=generator), 64)
    assert bool((nearest <= second).all()) and float(nearest.max()) < 1.5
    assert all(0.5 < x < 1.5 for x in seam(nearest[:, None]))
    lines = scratches(torch.rand(8, 40, generator=generator), 64)
    assert float(lines.min()) >= 0 and 0.1 < float(lines.max()) <= 1


def test_a_field_is_the_same_at_another_size():
    chances = Chances("test", {}, {}, ("a",))
    fine, coarse = (draw(chances, range(3), size, 0).streaks("a", 6.0, 4.0) for size in (96, 32))
    shared = torch.nn.functional.interpolate(fine[:, None], scale_factor=1 / 3, mode="nearest")[:, 0]
    assert torch.allclose(shared, coarse, atol=5e-3)


@pytest.mark.parametrize("make", DATA_SETS.values(), ids=list(DATA_SETS))
def test_what_cannot_be_made(make):
    for count, size in ((0, 64), (-3, 64), (1, 8), (1, 5000)):
        with pytest.raises(UserError, match=f"{make.__name__}: give a count of at least 1 and a size of 16 to 1024"):
            make(count, size)


def test_what_is_no_correlation():
    for wrong in (1.5, -2.0, float("nan")):
        with pytest.raises(UserError, match="diffuse_normal is a correlation; give a number from -1 to 1"):
            correlated(1, 32, diffuse_normal=wrong)
        with pytest.raises(UserError, match="specular_roughness is a correlation"):
            correlated(1, 32, specular_roughness=wrong)
