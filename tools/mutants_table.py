"""The faults that `tools/mutants.py` plants: what is changed, and which tests must notice.

`tests/test_mutants_table.py` checks in `make test` that each `old` occurs exactly once in its file, so an edit of the
package that moves a line must move it here too. To add a fault, add a line to the list of its package. A fault that
changes nothing anyone could measure is no fault: leave it out.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

PACKAGE = Path("src") / "unproject"


@dataclass(frozen=True)
class Edit:
    """One replacement in a file below `PACKAGE`."""

    file: str
    old: str
    new: str


@dataclass(frozen=True)
class Mutant:
    """A fault: edits that are made together, and the tests (files, or file::function) of which one must fail."""

    name: str
    edits: tuple[Edit, ...]
    tests: tuple[str, ...]


def mutant(name: str, file: str, old: str, new: str, *tests: str) -> Mutant:
    """A fault of one line."""
    return Mutant(name, (Edit(file, old, new),), tuple(f"tests/{test}" for test in tests))


def mutant_of_several(name: str, edits: tuple[Edit, ...], *tests: str) -> Mutant:
    """A fault that takes several edits, such as one in both implementations of a formula."""
    return Mutant(name, edits, tuple(f"tests/{test}" for test in tests))


def mutated(mutant: Mutant, package: Path) -> dict[Path, str]:
    """The text of each file that a mutant changes, after its edits.

    Raises:
        ValueError: if the old text does not occur exactly once, or the new one is the same.
    """
    texts: dict[Path, str] = {}
    for edit in mutant.edits:
        file = package / edit.file
        text = texts.get(file) or file.read_text(encoding="utf-8")
        if text.count(edit.old) != 1 or edit.old == edit.new:
            raise ValueError(f"{mutant.name}: {edit.old!r} occurs {text.count(edit.old)} times in {edit.file}")
        texts[file] = text.replace(edit.old, edit.new)
    return texts


TURNS = (
    mutant(
        "rotation: volumes turn the other way",
        "ops/rotation.py",
        "grid = torch.stack((w * c - u * s, u * c + w * s), -1)",
        "grid = torch.stack((w * c + u * s, u * c - w * s), -1)",
        "ops/test_rotation.py",
    ),
    mutant(
        "rotation: images turn the other way",
        "ops/rotation.py",
        "grid = torch.stack(((right * c - down * s) / width, (right * s + down * c) / height), -1)",
        "grid = torch.stack(((right * c + down * s) / width, (down * c - right * s) / height), -1)",
        "ops/test_rotation.py",
    ),
    mutant(
        "rotation: a camera above looks from below",
        "ops/rotation.py",
        "rows = (ca, torch.zeros_like(ca), -sa, -sa * se, ce, -ca * se, sa * ce, se, ca * ce)",
        "rows = (ca, torch.zeros_like(ca), -sa, sa * se, ce, ca * se, sa * ce, -se, ca * ce)",
        "ops/test_rotation.py",
    ),
    mutant(
        "rotation: exact quarter turns have no gradient",
        "ops/rotation.py",
        "torch.where(small, value, torch.zeros_like(value)).detach()",
        "torch.where(small, value, torch.zeros_like(value))",
        "ops/test_rotation.py",
    ),
    mutant(
        "azimuth: samples lie half a voxel off",
        "ops/azimuth.py",
        "of_column = ((u * c / half_width + 1) * width - 1) / 2,",
        "of_column = ((u * c / half_width + 1) * width) / 2,",
        "ops/test_azimuth.py",
    ),
    mutant(
        "azimuth: the adjoint counts a sample that does not exist",
        "ops/azimuth.py",
        "x_w.masked_fill_((sample < 0) | (sample >= self.samples), math.inf)",
        "x_w.masked_fill_((sample < 0) | (sample > self.samples), math.inf)",
        "ops/test_azimuth.py",
    ),
    mutant(
        "azimuth: the adjoint misses samples of a turned voxel",
        "ops/azimuth.py",
        "reach = 2 * math.sqrt(2) / min(width / half_width",
        "reach = 2 / min(width / half_width",
        "ops/test_azimuth.py",
    ),
    mutant(
        "azimuth: the gradient in the weights has the wrong sign",
        "ops/azimuth.py",
        "of_weight = _weight_gradient(table[0], ctx.index, weight, gradient)",
        "of_weight = -_weight_gradient(table[0], ctx.index, weight, gradient)",
        "ops/test_elevation.py",
    ),
    mutant(
        "elevation: samples of a camera above are those of one below",
        "ops/elevation.py",
        "PlaneRays(elevation - math.pi / 2, plane",
        "PlaneRays(-elevation - math.pi / 2, plane",
        "projections/test_silhouette.py",
    ),
    mutant(
        "elevation: sums count a tilted ray's depth for its length",
        "ops/elevation.py",
        "return torch.where(steep, lead.new_tensor(ratio), 1) / lead.abs()",
        "return torch.where(steep, lead.new_tensor(ratio), 1) / lead.abs().ceil()",
        "ops/test_elevation.py",
    ),
    mutant(
        "elevation: steep rays are sampled at the few depths that they cross",
        "ops/elevation.py",
        "steep = s.abs() * self._pitches()[0] > c.abs() * self._pitches()[1]",
        "steep = s.abs() * self._pitches()[0] < c.abs() * self._pitches()[1]",
        "ops/test_elevation.py",
    ),
    mutant(
        "elevation: the adjoint of sums misses a ray",
        "ops/elevation.py",
        "range(math.ceil(2 * max(self._pitches()) * scale - 1e-6))",
        "range(math.ceil(max(self._pitches()) * scale - 1e-6))",
        "ops/test_elevation.py",
    ),
    mutant(
        "elevation: the adjoint of sums counts rays beside the picture",
        "ops/elevation.py",
        "weight.masked_fill((rays < 0) | (rays >= self.size), 0)",
        "weight.masked_fill((rays < 0) | (rays > self.size), 0)",
        "ops/test_elevation.py",
    ),
    mutant(
        "resampling: cell centres lie at the cells' left edges",
        "ops/resampling.py",
        "* 2 + 1 - count) / count",
        "* 2 - count) / count",
        "ops/test_resampling.py",
    ),
    mutant(
        "resampling: rays run from far to near",
        "ops/resampling.py",
        "depth = -half_depth * centres(samples, frame)",
        "depth = half_depth * centres(samples, frame)",
        "ops/test_resampling.py",
    ),
    mutant(
        "resampling: what is nearer looks smaller",
        "ops/resampling.py",
        "narrowing = 1 - towards / distance",
        "narrowing = 1 + towards / distance",
        "ops/test_resampling.py",
    ),
    mutant(
        "resampling: the slant of a ray ignores the pixel's row",
        "ops/resampling.py",
        "return (1 + slope[:, None] + slope).sqrt()",
        "return (1 + 0 * slope[:, None] + slope).sqrt()",
        "ops/test_resampling.py",
    ),
)

OCCUPANCY = (
    mutant(
        "occupancy: the gradient of 'any' multiplies where it should divide",
        "ops/occupancy.py",
        "return (gradient * product * (_TRANSPARENCY - 1)).unsqueeze(ctx.dim) / q, None",
        "return (gradient * product * (_TRANSPARENCY - 1)).unsqueeze(ctx.dim) * q, None",
        "ops/test_occupancy.py",
    ),
    mutant(
        "occupancy: 'alpha' drops the sample that brings the sum to 1",
        "ops/occupancy.py",
        "p.detach().cumsum(dim) <= 1 + _ROUNDING",
        "p.detach().cumsum(dim) < 1 - _ROUNDING",
        "ops/test_occupancy.py",
    ),
    mutant(
        "occupancy: absorption ignores the density",
        "ops/occupancy.py",
        "return -torch.expm1(-density * p.sum(dim))",
        "return -torch.expm1(-p.sum(dim))",
        "ops/test_occupancy.py",
    ),
    mutant(
        "occupancy: a depth sample hides itself",
        "ops/occupancy.py",
        "reached = torch.cat((torch.ones_like(p[..., :1]), passed[..., :-1]), 3)",
        "reached = passed",
        "ops/test_occupancy.py",
    ),
)

LINE_INTEGRALS = (
    mutant_of_several(
        "line integrals: angles run clockwise in both implementations",
        (
            Edit(
                "ops/line_integrals.py",
                "x * c[:, None, None] + y * s[:, None, None]",
                "x * c[:, None, None] - y * s[:, None, None]",
            ),
            Edit(
                "ops/line_integrals.cpp", "T(height - 1 - 2 * row) * s * scale", "T(2 * row + 1 - height) * s * scale"
            ),
        ),
        "ops/test_line_integrals.py::test_directions_along_the_axes",
    ),
    mutant_of_several(
        "line integrals: not normalised by the detector's width in any implementation",
        (
            Edit(
                "ops/line_integrals.py",
                'torch.einsum("bchw,bdhw->bcd", image, area) * bins',
                'torch.einsum("bchw,bdhw->bcd", image, area) * width',
            ),
            Edit("ops/line_integrals.py", "(bins / image.shape[3] ** 2)", "(image.shape[3] / image.shape[3] ** 2)"),
            Edit("ops/line_integrals.cpp", "T(bins) / (T(width) * T(width))", "T(width) / (T(width) * T(width))"),
        ),
        "ops/test_line_integrals.py::test_rectangles_of_pixels_are_exact_at_any_angle",
    ),
    mutant(
        "line integrals: the sparse shares of three bins are wrong at a shadow's slope",
        "ops/line_integrals.py",
        "before.addcmul_(beyond.square_(), curve, value=-1)",
        "before.addcmul_(beyond.square_(), curve, value=1)",
        "ops/test_line_integrals.py::test_the_fast_paths_equal_the_reference",
    ),
    mutant(
        "line integrals: the kernel's last share is lost",
        "ops/line_integrals.cpp",
        "shares[count * n + x] = 1 - before;",
        "shares[count * n + x] = 0;",
        "ops/test_line_integrals.py::test_the_fast_paths_equal_the_reference",
    ),
)

MICROFACETS = (
    mutant_of_several(
        "microfacets: Schlick's exponent is 4 in both implementations",
        (
            Edit("ops/microfacet.py", "(1 - cos).clamp(0, 1) ** 5", "(1 - cos).clamp(0, 1) ** 4"),
            Edit("ops/shading.cpp", "return x2 * x2 * x;", "return x2 * x2;"),
        ),
        "ops/test_microfacet.py::test_schlick_is_the_fifth_power_by_hand",
        "ops/test_shading.py::test_a_smooth_surface_at_60_degrees_mirrors_schlicks_share_of_a_white_sky",
    ),
    mutant_of_several(
        "microfacets: Schlick's exponent is 4 in both implementations, unseen by a test of the formula",
        (
            Edit("ops/microfacet.py", "(1 - cos).clamp(0, 1) ** 5", "(1 - cos).clamp(0, 1) ** 4"),
            Edit("ops/shading.cpp", "return x2 * x2 * x;", "return x2 * x2;"),
        ),
        "ops/test_shading.py::test_a_smooth_surface_at_60_degrees_mirrors_schlicks_share_of_a_white_sky",
    ),
    mutant(
        "microfacets: Schlick's exponent is 4 in the kernel",
        "ops/shading.cpp",
        "return x2 * x2 * x;",
        "return x2 * x2;",
        "ops/test_shading.py::test_a_smooth_surface_at_60_degrees_mirrors_schlicks_share_of_a_white_sky",
    ),
    mutant_of_several(
        "microfacets: Smith's shadowing has a transposed digit in both implementations",
        (
            Edit("ops/microfacet.py", "(1 + 2.276 * a + 2.577 * a.square())", "(1 + 2.267 * a + 2.577 * a.square())"),
            Edit("ops/shading.cpp", "(1.f + a * (2.276f + 2.577f * a))", "(1.f + a * (2.267f + 2.577f * a))"),
        ),
        "ops/test_microfacet.py::test_smith_has_the_published_values",
    ),
    mutant_of_several(
        "microfacets: the lobe is twice as bright in both implementations",
        (
            Edit("ops/microfacet.py", "value = scale / 4 * beckmann", "value = scale / 2 * beckmann"),
            Edit("ops/shading.cpp", "larger(i[2], 0.f) * 0.25f;", "larger(i[2], 0.f) * 0.5f;"),
        ),
        "ops/test_microfacet.py::test_a_white_lobe_of_glass_returns_four_percent",
    ),
    mutant_of_several(
        "microfacets: a specular albedo of 0 reflects at grazing angles in both implementations",
        (
            Edit("ops/microfacet.py", "return 1.0, k_s, (k_s / BRIGHT).clamp(max=1)", "return 1.0, k_s, 1.0"),
            Edit("ops/shading.cpp", "p.f90 = lesser(p.k_s / BRIGHT, 1);", "p.f90 = set(1);"),
            Edit("ops/shading.cpp", "select(p.k_s <= BRIGHT, set(1 / BRIGHT), set(0))", "set(0)"),
        ),
        "ops/test_shading.py::test_a_smooth_surface_at_60_degrees_mirrors_schlicks_share_of_a_white_sky",
    ),
    mutant(
        "microfacets: Beckmann's cos⁴ is cos²",
        "ops/microfacet.py",
        "* (1 + tan2).square() / (math.pi * m.square())",
        "* (1 + tan2) / (math.pi * m.square())",
        "ops/test_microfacet.py::test_beckmann_has_the_published_values",
    ),
    mutant(
        "microfacets: grooves are half as deep",
        "ops/microfacet.py",
        "groove = 2 * cos_h / o_h",
        "groove = cos_h / o_h",
        "ops/test_microfacet.py::test_grooves_by_hand",
    ),
    mutant(
        "microfacets: facets are drawn with m where m² is meant",
        "ops/microfacet.py",
        "tan2 = -m.square() * torch.log1p(-u.clamp(TINY, 1 - TINY))",
        "tan2 = -m * torch.log1p(-u.clamp(TINY, 1 - TINY))",
        "ops/test_microfacet.py::test_the_lobe_is_sampled_with_its_density",
    ),
    mutant(
        "microfacets: the base gets what the surface reflects",
        "ops/microfacet.py",
        "return k_d * (1 - schlick(cos_o.abs(), f0, f90)).clamp(min=0)[..., None]",
        "return k_d.expand(*cos_o.shape, k_d.shape[-1])",
        "ops/test_microfacet.py::test_no_more_is_reflected_than_comes",
    ),
)

SHADING = (
    mutant(
        "shading: directional light has irradiance 1, not π",
        "ops/shading.py",
        "value = math.pi * reflected(pixels",
        "value = reflected(pixels",
        "ops/test_shading.py::test_white_and_matt_under_each_light",
    ),
    mutant_of_several(
        "shading: samples are weighed as if all were the lobe's in both implementations",
        (
            Edit("ops/shading.py", "(plan.lobes - n_d) * lobe", "plan.lobes * lobe"),
            Edit("ops/shading.cpp", "(float(job.lobes) - p.diffuse)", "float(job.lobes)"),
        ),
        "ops/test_shading.py::test_the_mean_is_the_integral",
    ),
    mutant(
        "shading: light samples count once however many there are",
        "ops/shading.py",
        "+ plan.lights * light_density",
        "+ light_density",
        "ops/test_shading.py::test_the_mean_is_the_integral",
    ),
    mutant(
        "shading: the paper's differences of the normal's azimuth are left out",
        "ops/differences.py",
        "for d_theta, d_phi in ((DELTA, 0.0), (0.0, DELTA)):",
        "for d_theta, d_phi in ((DELTA, 0.0),):",
        "ops/test_shading.py::test_differences_are_the_fixed_gradient",
    ),
    mutant(
        "shading: a fixed gradient lets the samples move",
        "ops/shading.py",
        'fixed = maps if sampling.gradient == "exact" else maps.detach()',
        "fixed = maps",
        "ops/test_shading.py::test_differences_are_the_fixed_gradient",
    ),
    mutant(
        "shading kernel: the base does not fall with the specular albedo in the gradient",
        "ops/shading.cpp",
        "sums.by_k_s += (coloured.v * falling + all.v * by_k_s) * w.v;",
        "sums.by_k_s += all.v * by_k_s * w.v;",
        "ops/test_shading.py::test_the_kernel_is_the_reference",
    ),
    mutant(
        "shading kernel: the roughness has no gradient through the shadowing",
        "ops/shading.cpp",
        "T slope = m * root(larger(1.f - cos * cos, TINY * TINY));",
        "T slope = from<T>(value(m)) * root(larger(1.f - cos * cos, TINY * TINY));",
        "ops/test_shading.py::test_the_kernel_is_the_reference",
    ),
    mutant(
        "shading kernel: an environment has a seam",
        "ops/shading.cpp",
        "right = i + 1 == job.columns ? 0 : i + 1;",
        "right = i + 1 == job.columns ? i : i + 1;",
        "ops/test_shading.py::test_the_kernel_is_the_reference",
    ),
)

LIGHT_AND_MAPS = (
    mutant(
        "environment: the density is of half the sphere",
        "ops/environment.py",
        "(weight[0].numel() / (2 * math.pi**2))",
        "(weight[0].numel() / (1 * math.pi**2))",
        "ops/test_environment.py",
    ),
    mutant_of_several(
        "environment: light turns the other way, looked up and sampled, in both implementations",
        (
            Edit("ops/environment.py", "away, x, 1)) - turn[lift]", "away, x, 1)) + turn[lift]"),
            Edit("ops/environment.py", "math.pi / width) + turn[:, None]", "math.pi / width) - turn[:, None]"),
            Edit("ops/shading.cpp", "T column = (azimuth - turn) *", "T column = (azimuth + turn) *"),
        ),
        "ops/test_environment.py",
    ),
    mutant(
        "environment: a seam where the columns close",
        "ops/environment.py",
        "left, right = left % width, (left + 1) % width",
        "left, right = left % width, (left + 1).clamp(max=width - 1)",
        "ops/test_environment.py",
    ),
    mutant(
        "environment: samples over the pole are not folded back",
        "ops/environment.py",
        "row = torch.where(row > height, 2 * height - row, row.abs())",
        "row = torch.where(row > height, 2 * height - row, row)",
        "ops/test_environment.py",
    ),
    mutant(
        "environment: samples are uniform within a texel",
        "ops/environment.py",
        "return torch.where(u < 0.5, (2 * u).sqrt() - 1, 1 - (2 - 2 * u).clamp(min=0).sqrt())",
        "return u - 0.5",
        "ops/test_environment.py",
    ),
    mutant(
        "environment: exposure counts the light from below",
        "ops/environment.py",
        "above = (height - 2 * torch.arange(height, dtype=torch.float64)).clamp(0, 2)[:, None] / 2",
        "above = 0.5 * torch.ones(height, 1, dtype=torch.float64)",
        "ops/test_environment.py",
    ),
    mutant(
        "exposure: another gamma",
        "ops/exposure.py",
        "GAMMA = 2.2",
        "GAMMA = 2.4",
        "projections/test_rendering.py::test_the_response_is_a_power_with_a_finite_slope",
    ),
    mutant(
        "hull: views stand all around, so opposite ones repeat",
        "ops/hull.py",
        "columns = _columns(volume, math.pi * k / views)",
        "columns = _columns(volume, 2 * math.pi * k / views)",
        "ops/test_hull.py",
    ),
    mutant(
        "hull: the silhouette is the least along a ray",
        "ops/hull.py",
        'planes, "amax", include_self=False',
        'planes, "amin", include_self=False',
        "ops/test_hull.py",
    ),
    mutant(
        "isosurface: half a voxel off",
        "ops/isosurface.py",
        "vertices = (indices - 0.5) / np.array(v.shape) * 2 - 1",
        "vertices = indices / np.array(v.shape) * 2 - 1",
        "ops/test_isosurface.py",
    ),
    mutant(
        "isosurface: faces look inwards",
        "ops/isosurface.py",
        'gradient_direction="ascent"',
        'gradient_direction="descent"',
        "ops/test_isosurface.py",
    ),
    mutant(
        "isosurface: smoothing shrinks and does not grow back",
        "ops/isosurface.py",
        "filter_taubin(mesh, shrink, grow, iterations=2 * rounds)",
        "filter_laplacian(mesh, shrink, iterations=2 * rounds, volume_constraint=False)",
        "ops/test_isosurface.py",
    ),
    mutant(
        "isosurface: parts that touch in a corner are apart",
        "ops/parts.py",
        "_CORNERS = np.ones((3, 3, 3))",
        "_CORNERS = None",
        "ops/test_isosurface.py",
    ),
    mutant(
        "low discrepancy: the sequence repeats after two points",
        "ops/low_discrepancy.py",
        "STEPS = (0.7548776662466927, 0.5698402909980532)",
        "STEPS = (0.5, 0.5698402909980532)",
        "ops/test_low_discrepancy.py",
    ),
    mutant_of_several(
        "low discrepancy: all pixels have the same points in both implementations",
        (
            Edit(
                "ops/low_discrepancy.py",
                "return scramble((pixel * 4 + dimension) ^ seed[:, None])",
                "return scramble((pixel * 0 + dimension) ^ seed[:, None])",
            ),
            Edit("ops/shading.cpp", "pixel[k] = uint32_t(index[k]) * 4u;", "pixel[k] = uint32_t(index[k]) * 0u;"),
        ),
        "ops/test_low_discrepancy.py",
    ),
    mutant(
        "maps: the luminance of green is red's",
        "ops/maps.py",
        "LUMINANCE = (0.2126, 0.7152, 0.0722)",
        "LUMINANCE = (0.7152, 0.2126, 0.0722)",
        "ops/test_maps.py",
    ),
    mutant(
        "maps: normals of a height lean the wrong way in y",
        "ops/maps.py",
        "(height.roll(1, -2) - height.roll(-1, -2)) / 2",
        "(height.roll(-1, -2) - height.roll(1, -2)) / 2",
        "ops/test_maps.py",
    ),
    mutant(
        "maps: normals of a height lean uphill",
        "ops/maps.py",
        "torch.stack([-h_x, -h_y, torch.ones_like(h_x)], 1)",
        "torch.stack([h_x, h_y, torch.ones_like(h_x)], 1)",
        "ops/test_maps.py",
    ),
    mutant(
        "maps: specular and roughness are taken for one another",
        "ops/maps.py",
        '"specular": slice(3, 4), "roughness": slice(4, 5)',
        '"specular": slice(4, 5), "roughness": slice(3, 4)',
        "projections/test_rendering.py::test_maps_by_name_are_maps",
    ),
)

PRIORS = (
    mutant(
        "priors: bins begin at their centres",
        "projections/priors.py",
        "[Uniform(name, centre + (k - 0.5) * width, centre + (k + 0.5) * width, period) for k in range(count)]",
        "[Uniform(name, centre + k * width, centre + (k + 1) * width, period) for k in range(count)]",
        "projections/test_priors.py",
    ),
    mutant(
        "priors: a cap is denser at its pole",
        "projections/priors.py",
        "half = math.sin(self.most / 2) * torch.rand(n, generator=rng).sqrt()",
        "half = math.sin(self.most / 2) * torch.rand(n, generator=rng)",
        "projections/test_priors.py",
    ),
    mutant(
        "priors: a mixture ignores its weights",
        "projections/priors.py",
        "which = torch.multinomial(torch.tensor(self.weights), n,",
        "which = torch.multinomial(torch.ones(len(self.weights)), n,",
        "projections/test_priors.py",
    ),
    mutant(
        "priors: each row is drawn from the first prior",
        "projections/priors.py",
        "priors[k].sample(int(rows.sum()), rng)",
        "priors[0].sample(int(rows.sum()), rng)",
        "projections/test_priors.py",
    ),
    mutant(
        "priors: a table's columns are drawn apart",
        "projections/priors.py",
        "return {name: column.float()[rows] for name, column in self.table.items()}",
        "return {name: column.float()[rows.flip(0) if k else rows] for k, (name, column) in "
        "enumerate(self.table.items())}",
        "projections/test_priors.py",
    ),
    mutant(
        "observation: all of a batch have one draw of the latents",
        "projections/observation.py",
        "theta = self.prior.sample(len(x), rng)",
        "theta = {name: value.expand(len(x)) for name, value in self.prior.sample(1, rng).items()}",
        "projections/test_observation.py",
    ),
)

PROJECTIONS = (
    mutant(
        "silhouette: level pictures are upside down",
        "projections/silhouette.py",
        "return columns.transpose(1, 2).flip(1).unsqueeze(1)",
        "return columns.transpose(1, 2).unsqueeze(1)",
        "projections/test_silhouette.py",
    ),
    mutant(
        "silhouette: tilted pictures are mirrored",
        "projections/silhouette.py",
        "return y.flip(1, 2).unsqueeze(1)",
        "return y.flip(1).unsqueeze(1)",
        "projections/test_silhouette.py",
    ),
    mutant(
        "silhouette: slices for few samples do not contain the samples of level rays",
        "projections/silhouette.py",
        "// 2 * 2 + 1)",
        "// 2 * 2 + 2)",
        "projections/test_silhouette.py",
    ),
    mutant(
        "silhouette: an elevation that is learned from 0 gets no gradient",
        "projections/silhouette.py",
        "if not elevation.requires_grad and not bool(elevation.any()):",
        "if not bool(elevation.any()):",
        "projections/test_silhouette.py",
    ),
    mutant(
        "silhouette: absorption depends on the number of samples",
        "projections/silhouette.py",
        "return self.density * half_depth * resolution / samples",
        "return self.density",
        "projections/test_silhouette.py",
    ),
    mutant(
        "silhouette: absorption along a pinhole's slanting ray counts depth for length",
        "projections/silhouette.py",
        "density = density * perspective_slant(x, *sampling[:2], self.distance)",
        "density = density * 1",
        "projections/test_silhouette.py",
    ),
    mutant(
        "silhouette: bands of elevation lie above the horizon",
        "projections/silhouette.py",
        "math.radians(15) * (band - elevations / 2)",
        "math.radians(15) * band",
        "projections/test_silhouette.py",
    ),
    mutant(
        "line integral: directions over a whole turn",
        "projections/line_integral.py",
        "middles = [math.pi * k / count for k in",
        "middles = [2 * math.pi * k / count for k in",
        "projections/test_line_integral.py",
    ),
    mutant(
        "rendering: the camera stands at the top edge",
        "projections/rendering.py",
        "FRONT = -math.pi / 2",
        "FRONT = math.pi / 2",
        "projections/test_rendering.py::test_the_camera_stands_at_the_bottom_edge",
    ),
    mutant(
        "rendering: the green and the blue lamp change places",
        "projections/rendering.py",
        "turns = (0.0, THIRD, 2 * THIRD)",
        "turns = (0.0, 2 * THIRD, THIRD)",
        "projections/test_rendering.py::test_three_coloured_lamps_are_three_pictures_by_one_lamp",
    ),
    mutant(
        "rendering: environments are not exposed",
        "projections/rendering.py",
        "lit = lit * exposure(lit)[:, None, None, None]",
        "lit = lit * 1",
        "projections/test_rendering.py::test_a_photograph_of_paper_is_exposed",
    ),
    mutant(
        "standardised: one mean for all channels",
        "projections/standardised.py",
        "mean, deviation = images.mean((0, 2, 3)), images.std",
        "mean, deviation = images.mean().expand(images.shape[1]), images.std",
        "projections/test_standardised.py",
    ),
)

HEADS = (
    mutant(
        "discriminator: the last layer uses another row's head",
        "networks/discriminators.py",
        "row = self.last(head) if self.common is None",
        "row = self.last(head.flip(0)) if self.common is None",
        "networks/test_discriminators.py::test_a_logit_is_that_of_its_own_head",
    ),
    mutant(
        "discriminator: the last layer uses another row's head beside the common row",
        "networks/discriminators.py",
        "else self.last(head) + self.common",
        "else self.last(head.flip(0)) + self.common",
        "networks/test_discriminators.py::test_a_logit_is_that_of_its_own_head",
    ),
    mutant(
        "discriminator: the head's own blocks are another row's",
        "networks/discriminators.py",
        "x = F.leaky_relu(convolution(x, head), self.slope)",
        "x = F.leaky_relu(convolution(x, head.flip(0)), self.slope)",
        "networks/test_discriminators.py::test_a_logit_is_that_of_its_own_head",
    ),
    mutant(
        "discriminator: every image is judged by head 0",
        "networks/discriminators.py",
        "row = self.last(head) if self.common is None",
        "row = self.last(head * 0) if self.common is None",
        "networks/test_discriminators.py::test_a_logit_is_that_of_its_own_head",
    ),
    mutant(
        "line discriminator: another row's head",
        "networks/discriminators.py",
        "row = self.own(head) + self.common",
        "row = self.own(head.flip(0)) + self.common",
        "networks/test_discriminators.py::test_a_logit_is_that_of_its_own_head",
    ),
    mutant(
        "DCGAN discriminator: another row's head",
        "networks/dcgan.py",
        "row = self.last(head)",
        "row = self.last(head.flip(0))",
        "networks/test_discriminators.py::test_a_logit_is_that_of_its_own_head",
    ),
    mutant(
        "texture discriminator: another row's head",
        "networks/textures.py",
        "weights = self.last(head)",
        "weights = self.last(head.flip(0))",
        "networks/test_discriminators.py::test_a_logit_is_that_of_its_own_head",
    ),
    mutant(
        "blocks: grouped samples come back in the order of their heads",
        "networks/blocks.py",
        "x.shape[1], -1)[place]",
        "x.shape[1], -1)[place[order]]",
        "networks/test_blocks.py",
    ),
    mutant(
        "spectral norm: one norm for all heads",
        "networks/discriminators.py",
        "return (stack / sigma[:, None, None]).reshape(weight.shape)",
        "return (stack / sigma.amax()).reshape(weight.shape)",
        "networks/test_discriminators.py::test_the_largest_singular_value_of_every_head_is_one",
    ),
    mutant(
        "spectral norm: the norm has no gradient",
        "networks/discriminators.py",
        'sigma = torch.einsum("ho,hoi,hi->h", self.u, stack, v)',
        'sigma = torch.einsum("ho,hoi,hi->h", self.u, stack, v).detach()',
        "networks/test_discriminators.py::test_second_derivatives_are_torchs",
    ),
)

NETWORKS = (
    mutant(
        "DCGAN discriminator: images are not centred",
        "networks/dcgan.py",
        "(image * 2 - 1)",
        "(image * 2)",
        "networks/test_dcgan.py",
    ),
    mutant(
        "DCGAN discriminator: an image is its own company",
        "networks/dcgan.py",
        "return torch.exp(-distance).sum(1) - 1",
        "return torch.exp(-distance).sum(1)",
        "networks/test_dcgan.py",
    ),
    mutant(
        "texture discriminator: images are not centred",
        "networks/textures.py",
        "(image * 2 - 1)",
        "(image * 2)",
        "networks/test_textures.py",
    ),
    mutant(
        "texture discriminator: real and generated images are compared with one another",
        "networks/textures.py",
        "s.split(self.group or len(s))",
        "s.split(len(s))",
        "networks/test_textures.py",
    ),
    mutant(
        "texture discriminator: the windows stand still",
        "networks/textures.py",
        "self.taken += int(self.training)",
        "self.taken += 0",
        "networks/test_textures.py",
    ),
    mutant(
        "view predictor: images are not centred",
        "networks/view_predictor.py",
        "return self.layers(image * 2 - 1)",
        "return self.layers(image * 2)",
        "networks/test_view_predictor.py",
    ),
    mutant(
        "generator: the right half is the left one again, not its mirror image",
        "networks/generators.py",
        "return torch.cat([half, half.flip(axis)], axis)",
        "return torch.cat([half, half], axis)",
        "networks/test_generators.py::test_mirrored_volumes_are_exactly_symmetric",
    ),
    mutant(
        "generator: samples are drawn in training mode",
        "networks/generators.py",
        "        self.eval()\n",
        "        self.train()\n",
        "networks/test_generators.py::test_a_sample_depends_on_neither_n_nor_batch",
    ),
    mutant(
        "generator: all samples of a seed have one code",
        "networks/generators.py",
        'rng = generator_at(seed, i, "sample")',
        'rng = generator_at(seed, 0, "sample")',
        "networks/test_generators.py::test_a_sample_depends_on_neither_n_nor_batch",
    ),
    mutant(
        "generator: samples of a generator with a hull are not filled",
        "networks/generators.py",
        "(visual_hull(x) if self.hull else x).cpu()",
        "x.cpu()",
        "networks/test_generators.py::test_samples_of_a_generator_with_a_hull_are_filled",
    ),
    mutant(
        "generator: low-rank products are not scaled by the rank",
        "networks/low_rank.py",
        "self.scale = rank**-0.5",
        "self.scale = 1.0",
        "networks/test_generators.py::test_the_low_rank_formula",
    ),
    mutant(
        "blocks: a modulated scale takes the mean over the batch",
        "networks/blocks.py",
        "x.square().mean(tuple(range(1, x.dim())), keepdim=True)",
        "x.square().mean(tuple(range(0, x.dim())), keepdim=True)",
        "networks/test_materials.py::test_they_obey_the_laws",
    ),
    mutant(
        "materials: every map has the diffuse albedo's scale",
        "networks/materials.py",
        "* scale[:, k] for k, name in enumerate(SCALED)",
        "* scale[:, 0] for k, name in enumerate(SCALED)",
        "networks/test_materials.py",
    ),
    mutant(
        "materials: normals lean to one side only",
        "networks/materials.py",
        "n = torch.cat([2 * n[:, :2] - 1, n[:, 2:] + LEAST_Z], 1)",
        "n = torch.cat([n[:, :2], n[:, 2:] + LEAST_Z], 1)",
        "networks/test_materials.py",
    ),
    mutant(
        "materials: the paper's codes are normal",
        "networks/materials.py",
        "return torch.rand(n, self.code_size, generator=rng) * 2 - 1",
        "return torch.randn(n, self.code_size, generator=rng)",
        "networks/test_materials.py::test_the_seeds_codes_are_uniform_and_its_branches_share_two_layers",
    ),
    mutant(
        "materials: levels do not tile",
        "networks/materials.py",
        'return F.pad(x, (border,) * 4, mode="circular")',
        'return F.pad(x, (border,) * 4, mode="replicate")',
        "networks/test_materials.py::test_a_stationary_generator_has_no_origin",
    ),
)

ADVERSARIAL = (
    mutant(
        "losses: Wasserstein's discriminator has the wrong sign",
        "adversarial/losses.py",
        "return fake.mean() - real.mean()",
        "return real.mean() - fake.mean()",
        "adversarial/test_losses.py",
    ),
    mutant(
        "losses: the hinge's margins are on the wrong side",
        "adversarial/losses.py",
        "return F.relu(1 - real).mean() + F.relu(1 + fake).mean()",
        "return F.relu(1 + real).mean() + F.relu(1 - fake).mean()",
        "adversarial/test_losses.py",
    ),
    mutant(
        "losses: the hinge has no margin",
        "adversarial/losses.py",
        "F.relu(1 - real).mean()",
        "F.relu(-real).mean()",
        "adversarial/test_losses.py",
    ),
    mutant(
        "losses: the relativistic discriminator minimises the generator's loss",
        "adversarial/losses.py",
        "return F.softplus(fake - real).mean()",
        "return F.softplus(real - fake + 0).mean()",
        "adversarial/test_losses.py",
    ),
    mutant(
        "losses: the relativistic loss compares with the mean, not with the pair",
        "adversarial/losses.py",
        "return F.softplus(fake - real).mean()",
        "return F.softplus(fake - real.mean()).mean()",
        "adversarial/test_losses.py",
    ),
    mutant(
        "losses: the logistic generator learns to be told",
        "adversarial/losses.py",
        "return F.softplus(-fake).mean()",
        "return F.softplus(fake).mean()",
        "adversarial/test_losses.py",
    ),
    mutant(
        "penalties: the gradient penalty is on real images",
        "adversarial/penalties.py",
        "u * real + (1 - u) * fake",
        "u * real + (1 - u) * real",
        "adversarial/test_penalties.py",
    ),
    mutant(
        "penalties: the gradient penalty is on generated images",
        "adversarial/penalties.py",
        "u * real + (1 - u) * fake",
        "u * fake + (1 - u) * fake",
        "adversarial/test_penalties.py",
    ),
    mutant(
        "penalties: the gradient penalty has one place for the whole batch",
        "adversarial/penalties.py",
        "u = torch.rand(len(real), generator=rng)",
        "u = torch.rand(1, generator=rng)",
        "adversarial/test_penalties.py",
    ),
    mutant(
        "penalties: the gradient penalty is one-sided",
        "adversarial/penalties.py",
        "(norm - 1).square().mean()",
        "(norm - 1).clamp(min=0).square().mean()",
        "adversarial/test_penalties.py",
    ),
    mutant(
        "penalties: R2 is on real images",
        "adversarial/penalties.py",
        "squared_gradient_norms(discriminator, fake).mean()",
        "squared_gradient_norms(discriminator, real).mean()",
        "adversarial/test_penalties.py",
    ),
    mutant(
        "penalties: R1 is on generated images",
        "adversarial/penalties.py",
        "squared_gradient_norms(discriminator, real).mean()",
        "squared_gradient_norms(discriminator, fake).mean()",
        "adversarial/test_penalties.py",
    ),
    mutant(
        "penalties: R1 is left out",
        "adversarial/penalties.py",
        "norms = squared_gradient_norms(discriminator, real).mean() +",
        "norms = 0 * squared_gradient_norms(discriminator, real).mean() +",
        "adversarial/test_penalties.py",
    ),
    mutant(
        "augmentation: shifts go the other way",
        "adversarial/augmentation.py",
        "at = torch.arange(length, device=images.device) - by[:, None]",
        "at = torch.arange(length, device=images.device) + by[:, None]",
        "adversarial/test_augmentation.py",
    ),
    mutant(
        "augmentation: images repeat their edge",
        "adversarial/augmentation.py",
        "return images.gather(-1, rows) * inside.view(shape)",
        "return images.gather(-1, rows)",
        "adversarial/test_augmentation.py",
    ),
    mutant(
        "augmentation: only the last side is shifted",
        "adversarial/augmentation.py",
        "for side in range(2, images.dim()):",
        "for side in range(images.dim() - 1, images.dim()):",
        "adversarial/test_augmentation.py",
    ),
    mutant(
        "augmentation: pictures are moved the other way",
        "adversarial/augmentation.py",
        "right = ((centres(width, images) - 2 * by[:, :1]) * width)[:, None]",
        "right = ((centres(width, images) + 2 * by[:, :1]) * width)[:, None]",
        "adversarial/test_augmentation.py",
    ),
    mutant(
        "augmentation: pictures are moved by half",
        "adversarial/augmentation.py",
        "down = ((centres(height, images) - 2 * by[:, 1:]) * height)[:, :, None]",
        "down = ((centres(height, images) - by[:, 1:]) * height)[:, :, None]",
        "adversarial/test_augmentation.py",
    ),
    mutant(
        "augmentation: a zoom makes smaller",
        "adversarial/augmentation.py",
        "cos, sin = ((value / zoom)[:, None, None]",
        "cos, sin = ((value * zoom)[:, None, None]",
        "adversarial/test_augmentation.py",
    ),
    mutant(
        "augmentation: a roll turns the other way",
        "adversarial/augmentation.py",
        "grid = torch.stack(((right * cos - down * sin) / width, (right * sin + down * cos) / height), -1)",
        "grid = torch.stack(((right * cos + down * sin) / width, (down * cos - right * sin) / height), -1)",
        "adversarial/test_augmentation.py",
    ),
    mutant(
        "augmentation: all pictures of a batch are moved alike",
        "adversarial/augmentation.py",
        "torch.rand(4, len(images), generator=rng)",
        "torch.rand(4, 1, generator=rng).expand(4, len(images))",
        "adversarial/test_augmentation.py",
    ),
    mutant(
        "augmentation: sizes are enlarged only",
        "adversarial/augmentation.py",
        "(1 + self.zoom) ** zoom, roll",
        "(1 + self.zoom) ** zoom.abs(), roll",
        "adversarial/test_augmentation.py",
    ),
    mutant(
        "augmentation: the strength is the share that is left alone",
        "adversarial/augmentation.py",
        "generator=rng) < self.strength)",
        "generator=rng) >= self.strength)",
        "adversarial/test_augmentation.py",
    ),
    mutant(
        "adaptive: overfitting lowers the strength",
        "adversarial/adaptive.py",
        "by if self.overfitting > self.settings.target else -by",
        "-by if self.overfitting > self.settings.target else by",
        "adversarial/test_adaptive.py",
    ),
    mutant(
        "adaptive: overfitting is measured from held-out to generated images",
        "adversarial/adaptive.py",
        "(train - generated - self.margin)",
        "(held_out - generated - self.margin)",
        "adversarial/test_adaptive.py",
    ),
    mutant(
        "adaptive: the last measurement decides alone",
        "adversarial/adaptive.py",
        "RECENT = 0.1",
        "RECENT = 1.0",
        "adversarial/test_adaptive.py",
    ),
    mutant(
        "adaptive: the strength moves by all of the progress",
        "adversarial/adaptive.py",
        "self.moved_at.fill_(progress)",
        "pass",
        "adversarial/test_adaptive.py",
    ),
    mutant(
        "adaptive: the strength passes its limit",
        "adversarial/adaptive.py",
        "self.strength.clamp_(0.0, self.settings.most)",
        "self.strength.clamp_(0.0, 1.0)",
        "adversarial/test_adaptive.py",
    ),
    mutant(
        "adaptive: the strength of a state is that of the start",
        "adversarial/adaptive.py",
        "Sometimes(self.settings.augmentation, self.strength.item())",
        "Sometimes(self.settings.augmentation, self.settings.start)",
        "adversarial/test_adaptive.py",
    ),
    mutant(
        "regularisers: the weight does not fall",
        "adversarial/regularisers.py",
        "self.weight + (self.final - self.weight) * min(progress, 1.0)",
        "self.weight",
        "adversarial/test_regularisers.py",
    ),
    mutant(
        "regularisers: gaps are widened",
        "adversarial/regularisers.py",
        "(1 - x) * gaps",
        "x * gaps",
        "adversarial/test_regularisers.py",
    ),
    mutant(
        "regularisers: what is not misplaced is pushed too",
        "adversarial/regularisers.py",
        "total = x.detach().flatten(1)",
        "total = x.flatten(1)",
        "adversarial/test_regularisers.py",
    ),
    mutant(
        "regularisers: only the first of several counts",
        "adversarial/regularisers.py",
        "for term in self.terms]",
        "for term in self.terms[:1]]",
        "adversarial/test_regularisers.py",
    ),
)

PARTS = (
    mutant(
        "parts: only faces connect",
        "ops/parts.py",
        "_CORNERS = np.ones((3, 3, 3))",
        "_CORNERS = ndimage.generate_binary_structure(3, 1)",
        "ops/test_parts.py::test_thin_legs_and_soft_rims_stay",
    ),
    mutant(
        "parts: soft rims go",
        "ops/parts.py",
        "_distance((numbers > 0) & ~other) <= _distance(other)",
        "(numbers > 0) & ~other",
        "ops/test_parts.py::test_a_crumb_goes_with_its_rim_and_nothing_else",
        "ops/test_parts.py::test_the_surface_is_that_of_the_part",
    ),
    mutant(
        "parts: soft voxels in the middle go",
        "ops/parts.py",
        "& ~other) <= _distance(other)",
        "& ~other) < _distance(other)",
        "ops/test_parts.py::test_the_largest_part_is_the_references",
    ),
    mutant(
        "parts: rims of what goes stay",
        "ops/parts.py",
        "_distance((numbers > 0) & ~other) <= _distance(other)",
        "~other",
        "ops/test_parts.py::test_a_crumb_goes_with_its_rim_and_nothing_else",
    ),
    mutant(
        "parts: what is broken floats",
        "ops/parts.py",
        "number_parts(_grown(occupied))",
        "number_parts(occupied)",
        "ops/test_parts.py::test_what_is_within_two_voxels_does_not_float",
    ),
    mutant(
        "parts: gaps of two voxels are none",
        "ops/parts.py",
        "((near_a & _grown(near_b)) | (_grown(near_a) & near_b))",
        "(near_a & near_b)",
        "ops/test_parts.py::test_what_is_within_two_voxels_does_not_float",
    ),
    mutant(
        "parts: masks grow to one side only",
        "ops/parts.py",
        "grown[:-1] |= before[1:]",
        "pass",
        "ops/test_parts.py::test_floating_parts_and_gaps_are_the_references",
    ),
    mutant(
        "parts: exports keep what floats",
        "cli/export.py",
        "largest_part: bool = True",
        "largest_part: bool = False",
        "cli/test_export.py::test_parts_that_float_are_removed_unless_they_shall_stay",
    ),
    mutant(
        "parts: samples lose what floats unasked",
        "training/run.py",
        "return self.domain.largest_part(x) if largest_part else x",
        "return self.domain.largest_part(x)",
        "training/test_evaluation.py::test_parts_that_float_are_removed_from_samples_if_asked",
    ),
)

METRICS = (
    mutant(
        "distances: a half is occupied",
        "metrics/distances.py",
        "left, right = (left > THRESHOLD).float()",
        "left, right = (left >= THRESHOLD).float()",
        "metrics/test_distances.py",
    ),
    mutant(
        "distances: Chamfer is one-sided",
        "metrics/distances.py",
        "square.amin(1).clamp_min_(0).mean() + square.amin(0).clamp_min_(0).mean()",
        "square.amin(1).clamp_min_(0).mean() * 2",
        "metrics/test_distances.py",
    ),
    mutant(
        "feature sets: Fréchet's covariances are biased",
        "metrics/feature_sets.py",
        "value.T.cov()",
        "value.T.cov(correction=0)",
        "metrics/test_feature_sets.py",
    ),
    mutant(
        "feature sets: Fréchet multiplies covariances without the root",
        "metrics/feature_sets.py",
        "torch.linalg.eigvalsh(root @ c_y @ root)",
        "torch.linalg.eigvalsh(c_x @ c_y)",
        "metrics/test_feature_sets.py",
    ),
    mutant(
        "feature sets: the kernel distance counts items with themselves",
        "metrics/feature_sets.py",
        "return (kernel.sum() - kernel.trace()) / (len(x) * (len(x) - 1))",
        "return kernel.mean()",
        "metrics/test_feature_sets.py",
    ),
    mutant(
        "feature sets: precision uses the generated items' balls",
        "metrics/feature_sets.py",
        "precision = (across <= _radii(reference, k)).any(1)",
        "precision = (across <= _radii(generated, k)[:, None]).any(1)",
        "metrics/test_feature_sets.py",
    ),
    mutant(
        "shape sets: an item is its own nearest neighbour",
        "metrics/shape_sets.py",
        'return distance.clone().fill_diagonal_(float("inf")).amin(1)',
        "return distance.clone().amin(1)",
        "metrics/test_shape_sets.py",
    ),
    mutant(
        "shape sets: MMD over the generated items",
        "metrics/shape_sets.py",
        "(chance @ distance.double().sort(0).values).mean().item()",
        "distance.double().amin(1).mean().item()",
        "metrics/test_shape_sets.py",
    ),
    mutant(
        "shape sets: a tie counts as a neighbour of one's own",
        "metrics/shape_sets.py",
        "(own < other).double() + 0.5 * (own == other).double()",
        "(own < other).double() + (own == other).double()",
        "metrics/test_shape_sets.py",
    ),
    mutant(
        "gauge: a reflection does not reverse the turn before it",
        "metrics/gauge.py",
        "turn = self.turn + (-first.turn if self.reflected else first.turn)",
        "turn = self.turn + first.turn",
        "metrics/test_gauge.py",
    ),
    mutant(
        "gauge: a reflected shape is relabelled without the half turn",
        "metrics/gauge.py",
        "turned = self.bins // 2 - self.turn - k if self.reflected",
        "turned = -self.turn - k if self.reflected",
        "metrics/test_gauge.py",
    ),
    mutant(
        "gauge: reflections are not tried",
        "metrics/gauge.py",
        "return min(dihedral(bins), key=",
        "return min(dihedral(bins)[:bins], key=",
        "metrics/test_gauge.py",
    ),
    mutant(
        "gauge: images turn the other way",
        "metrics/gauge.py",
        "images.new_full((len(images),), -gauge.azimuth)",
        "images.new_full((len(images),), gauge.azimuth)",
        "metrics/test_image_scores.py",
    ),
    mutant(
        "views: chance takes the mean gauge, not the best",
        "metrics/views.py",
        "return exact.amax(1).mean().item()",
        "return exact.mean().item()",
        "metrics/test_views.py",
    ),
    mutant(
        "views: chance forgets how often each bin was predicted",
        "metrics/views.py",
        "predicted[torch.randperm(len(predicted), generator=rng)]",
        "torch.randint(bins, predicted.shape, generator=rng)",
        "metrics/test_views.py",
    ),
    mutant(
        "views: the last bin is no neighbour of the first",
        "metrics/views.py",
        "((off <= 1) | (off == bins - 1)).double()",
        "(off <= 1).double()",
        "metrics/test_views.py",
    ),
    mutant(
        "map correlation: slopes of the normals point the wrong way in y",
        "metrics/map_correlation.py",
        "slopes = torch.stack([-x, y], 1)",
        "slopes = torch.stack([-x, -y], 1)",
        "metrics/test_map_correlation.py",
    ),
    mutant(
        "map correlation: means are not taken away",
        "metrics/map_correlation.py",
        "covariance = square - mean * mean[:, None]",
        "covariance = square",
        "metrics/test_map_correlation.py",
    ),
    mutant(
        "patches: unequal sets are compared without their quantiles",
        "metrics/patches.py",
        "(a[:, steps[:-1] // n] - b[:, steps[:-1] // m]).abs() @ widths",
        "(a.mean(1) - b.mean(1)).abs()",
        "metrics/test_patches.py",
    ),
    mutant(
        "patches: the unit is not the truth's deviation",
        "metrics/patches.py",
        "weights = weights / deviation.float().clamp_min(QUANTUM)[:, None]",
        "weights = weights / 1",
        "metrics/test_patches.py",
    ),
    mutant(
        "patches: groups of features weigh by their number",
        "metrics/patches.py",
        "weight = math.sqrt(total / (len(truth) * y.shape[1]))",
        "weight = 1.0",
        "metrics/test_patches.py",
    ),
)

LAWS = (
    mutant(
        "laws: 'pure' compares a projection under one global seed",
        "testing/projections.py",
        'return same(case.project(seed=1), case.project(seed=2), 0.0, "two equal calls")',
        'return same(case.project(seed=1), case.project(seed=1), 0.0, "two equal calls")',
        "test_laws.py::test_precisely_that_law_catches_the_projection",
    ),
    mutant(
        "laws: 'batched' does not permute the batch",
        "testing/projections.py",
        "order = torch.arange(len(case.x)).flip(0)",
        "order = torch.arange(len(case.x))",
        "test_laws.py::test_precisely_that_law_catches_the_projection",
    ),
    mutant(
        "laws: 'finite' does not try an empty x",
        "testing/projections.py",
        '("all 0", torch.zeros_like(case.x)), ',
        "",
        "test_laws.py::test_precisely_that_law_catches_the_projection",
    ),
    mutant(
        "laws: 'finite' does not try a full x",
        "testing/projections.py",
        ', ("all 1", torch.ones_like(case.x)))',
        ")",
        "test_laws.py::test_precisely_that_law_catches_the_projection",
    ),
    mutant(
        "laws: 'adjoint' asks autograd although there is an adjoint",
        "testing/projections.py",
        'if hasattr(case.projection, "adjoint"):',
        'if hasattr(case.projection, "no such"):',
        "test_laws.py::test_precisely_that_law_catches_the_projection",
    ),
    mutant(
        "laws: 'support' does not ask whether a prior contains its draws",
        "testing/priors.py",
        "need(bool(inside.all()), f",
        "need(True, f",
        "test_laws.py::test_precisely_that_law_catches_the_prior",
    ),
    mutant(
        "laws: 'seeded' does not compare two seeds",
        "testing/generators.py",
        "need(not torch.equal(three, other),",
        "need(True,",
        "test_laws.py::test_precisely_that_law_catches_the_generator",
    ),
    mutant(
        "laws: 'trainable' forgives a parameter without a gradient",
        "testing/generators.py",
        "if gradient is None or not gradient.isfinite().all()]",
        "if gradient is not None and not gradient.isfinite().all()]",
        "test_laws.py::test_precisely_that_law_catches_the_generator",
    ),
)

FOUNDATIONS = (
    mutant(
        "splitting: images are held out one by one",
        "data/splitting.py",
        'shapes = [RENDERED.sub("", name) for name in names]',
        "shapes = list(names)",
        "data/test_splitting.py",
    ),
    mutant(
        "splitting: mirror images are shapes of their own",
        "data/splitting.py",
        're.compile(r"#\\d+( flipped)?$")',
        're.compile(r"#\\d+$")',
        "data/test_splitting.py",
    ),
    mutant(
        "splitting: of few shapes nearly none is held out",
        "data/splitting.py",
        "max(round(share * count), min(LEAST, count // 4), 1)",
        "max(round(share * count), 1)",
        "data/test_splitting.py",
    ),
    mutant(
        "random: places are joined without a separator",
        "_random.py",
        'f"{seed}/{step}/{stream}"',
        'f"{seed}{step}{stream}"',
        "test_random.py",
    ),
    mutant(
        "random: a seeded block ignores its stream",
        "_random.py",
        "torch.manual_seed(derived_seed(seed, 0, stream) % 2**63)",
        "torch.manual_seed(derived_seed(seed, 0) % 2**63)",
        "test_random.py",
    ),
    mutant(
        "files: a failed write leaves its temporary file",
        "_files.py",
        "        temporary.unlink(missing_ok=True)\n        raise",
        "        raise",
        "test_files.py",
    ),
    mutant(
        "files: the final name is taken before the data is on disk",
        "_files.py",
        "        _synchronise(temporary)\n        os.replace(temporary, final)",
        "        os.replace(temporary, final)\n        _synchronise(final)",
        "test_files.py",
    ),
    mutant(
        "checkpoint: the oldest is resumed",
        "training/checkpoint.py",
        "return found[-1]",
        "return found[0]",
        "training/test_checkpoint.py",
    ),
    mutant(
        "checkpoint: the newest is dropped",
        "training/checkpoint.py",
        "for old in list_checkpoints(folder)[:-KEEP]:",
        "for old in list_checkpoints(folder)[KEEP:]:",
        "training/test_checkpoint.py",
    ),
    mutant(
        "checkpoint: a file of another program is loaded",
        "training/checkpoint.py",
        'if (file.metadata() or {}).get("format") != FORMAT:',
        "if False:",
        "training/test_checkpoint.py",
    ),
    mutant(
        "checkpoint: what was loaded changes with its file",
        "training/checkpoint.py",
        "file.get_tensor(name).clone()",
        "file.get_tensor(name)",
        "training/test_checkpoint.py",
    ),
    mutant(
        "health: diversity is upside down",
        "training/health.py",
        "fake.std(0).mean() / real.std(0).mean().clamp_min(1e-9)",
        "real.std(0).mean() / fake.std(0).mean().clamp_min(1e-9)",
        "training/test_health.py::test_diversity_is_a_share_of_the_real_images",
    ),
    mutant(
        "health: a collapse is six checks in a row",
        "training/health.py",
        "PATIENCE = 5",
        "PATIENCE = 6",
        "training/test_health.py::test_a_collapse_is_five_checks_in_a_row",
    ),
    mutant(
        "health: an infinite loss passes",
        "training/health.py",
        "if not math.isfinite(value):",
        "if math.isnan(value):",
        "training/test_health.py::test_losses_that_are_not_finite_are_named",
    ),
)

TRAINER, VIEWS = "training/test_trainer.py", "recipes/test_predicting_views.py"
PAPER, PANEL, RESUME = "recipes/test_paper_choices.py", "assignment/test_panel.py", "training/test_resume.py"
PAIRED = f"{TRAINER}::test_samples_are_projected_in_the_views_of_the_images_they_are_paired_with"

ASSIGNMENTS = (
    mutant(
        "predictor: labels are shifted by a bin",
        "assignment/predicted.py",
        "return torch.cat(projections)[:count], torch.cat(views)[:count]",
        "return torch.cat(projections)[:count], (torch.cat(views)[:count] + 1) % len(self.panel.observations)",
        f"{TRAINER}::test_the_predictor_learns_the_views_its_images_were_projected_in",
    ),
    mutant(
        "predictor: labels are shuffled",
        "assignment/predicted.py",
        "return torch.cat(projections)[:count], torch.cat(views)[:count]",
        "return torch.cat(projections)[:count], torch.cat(views)[:count].flip(0)",
        VIEWS,
    ),
    mutant(
        "predictor: fitted to labels of other rows",
        "assignment/predictor.py",
        "self.half_mirrored(images[rows], views[rows].to(images.device))",
        "self.half_mirrored(images[rows], views[rows.flip(0)].to(images.device))",
        "assignment/test_predictor.py",
    ),
    mutant(
        "predictor: the learning rate does not fall",
        "assignment/predictor.py",
        "self.learning_rate * (1 - step / self.steps)",
        "self.learning_rate * 1.0",
        "assignment/test_predictor.py",
    ),
    mutant(
        "assignment: samples are projected in another image's view",
        "assignment/panel.py",
        "return self.panel.project(x, self.views[rows], rng)",
        "return self.panel.project(x, self.views[rows.flip(0)], rng)",
        PAIRED,
    ),
    mutant(
        "assignment: samples are projected in views drawn anew",
        "assignment/panel.py",
        "return self.panel.project(x, self.views[rows], rng)",
        "return self.panel.project(x, self.draw_views(len(x), rng), rng)",
        PAIRED,
    ),
    mutant(
        "panel: latents of the first prior for all views",
        "assignment/panel.py",
        "theta = sample_each(priors, views, rng) if priors[0].names else {}",
        "theta = sample_each(priors, views * 0, rng) if priors[0].names else {}",
        f"{PANEL}::test_each_image_is_paired_with_its_own_view",
    ),
    mutant(
        "panel: rows of further collections are off by one",
        "assignment/panel.py",
        "(self._ends[k - 1] if k else 0)",
        "(self._ends[k - 1] + 1 if k else 0)",
        f"{PANEL}::test_rows_run_through_the_collections",
    ),
    mutant(
        "known: an image gets the last view that contains its latents",
        "assignment/views.py",
        "return inside.long().argmax(1)",
        "return inside.long().flip(1).argmax(1)",
        f"{PANEL}::test_known_views_are_those_of_the_collections_or_of_the_latents",
    ),
    mutant(
        "responsibilities: the least probable view is assigned",
        "assignment/responsibilities.py",
        "views = responsibilities.argmax(1)",
        "views = responsibilities.argmin(1)",
        "assignment/test_responsibilities.py",
    ),
    mutant(
        "responsibilities: not normalised within the window",
        "assignment/responsibilities.py",
        "inside = inside / inside.sum(1, keepdim=True)",
        "inside = inside / 1.0",
        "assignment/test_responsibilities.py",
    ),
    mutant(
        "responsibilities: balance is ignored",
        "assignment/responsibilities.py",
        "inside = balanced(inside, self.balance)",
        "inside = balanced(inside, 0.0)",
        "assignment/test_responsibilities.py",
    ),
    mutant(
        "rounds: those that come too soon are made",
        "assignment/predicted.py",
        "run.step - self.last < rounds.least_steps",
        "run.step - self.last < 0 * rounds.least_steps",
        f"{TRAINER}::test_rounds_that_come_too_soon_are_left_out",
    ),
    mutant(
        "rounds: an interrupted fit starts again",
        "assignment/predicted.py",
        "images, views, seed, int(self.fitted))",
        "images, views, seed, 0)",
        f"{RESUME}::test_an_assignment_goes_on_where_it_was",
    ),
    mutant(
        "learned prior: no gradient reaches it",
        "assignment/learned_prior.py",
        "few - few.detach(), others",
        "few.detach() - few.detach(), others",
        "assignment/test_learned_prior.py",
    ),
    mutant(
        "mean shape: the worst of several fits is taken",
        "assignment/mean_shape.py",
        "best = max(fits",
        "best = min(fits",
        "assignment/test_mean_shape.py",
    ),
)

TRAINING = (
    mutant(
        "trainer: real images are scored by other heads",
        "training/trainer.py",
        "batch.head.repeat(2))",
        "torch.cat([batch.head.flip(0), batch.head]))",
        PAIRED,
    ),
    mutant(
        "trainer: samples are scored by the wrong heads in the generator's update",
        "training/trainer.py",
        "return self.panel.discriminator(images, self.head)",
        "return self.panel.discriminator(images, self.head.flip(0))",
        PAIRED,
    ),
    mutant(
        "trainer: the penalty sees generated images twice",
        "training/trainer.py",
        "recipe.penalty(batch.score, batch.real, batch.fake.detach(), rng)",
        "recipe.penalty(batch.score, batch.fake.detach(), batch.fake.detach(), rng)",
        f"{TRAINER}::test_the_penalty_is_of_real_and_of_generated_images",
    ),
    mutant(
        "trainer: the penalty sees real images twice",
        "training/trainer.py",
        "recipe.penalty(batch.score, batch.real, batch.fake.detach(), rng)",
        "recipe.penalty(batch.score, batch.real, batch.real, rng)",
        f"{TRAINER}::test_the_penalty_is_of_real_and_of_generated_images",
    ),
    mutant(
        "start: the average is the last generator",
        "training/start.py",
        'state.average.load_state_dict(stripped(tensors, "average"))',
        'state.average.load_state_dict(stripped(tensors, "generator"))',
        "training/test_start.py",
    ),
    mutant(
        "start: discriminators are new",
        "training/start.py",
        "panel.discriminator.load_state_dict(weights)",
        "pass",
        "training/test_start.py",
    ),
    mutant(
        "start: the weights at the start are not stored",
        "training/loop.py",
        "if began is not None and distribution.leads:",
        "if began is None and distribution.leads:",
        "training/test_start.py",
    ),
    mutant(
        "start: settings that differ are let pass",
        "training/start.py",
        "if name in given and given[name] != value]",
        "if name not in given and given[name] != value]",
        "training/test_start.py",
    ),
    mutant(
        "start: the run before the other one is forgotten",
        "training/start.py",
        '("recipe", "arguments", "start")',
        '("recipe", "arguments")',
        "training/test_start.py",
    ),
    mutant(
        "start: views stay random",
        "assignment/predicted.py",
        'self._take(*self.settings.estimator.assign(found, derived_seed(self.seed, 0, "assignment")))',
        "pass",
        "training/test_start.py",
    ),
    mutant(
        "start: an initialiser overwrites the views",
        "assignment/predicted.py",
        "self.round == 0 and not self.heads.any():",
        "self.round == 0:",
        "training/test_start.py",
    ),
    mutant(
        "start: views are predicted by new weights",
        "assignment/predicted.py",
        'if shapes != own or not tensors["round"] > 0:',
        "if shapes != own:",
        "training/test_start.py",
    ),
    mutant(
        "overfitting: training images stand for held-out ones",
        "training/overfitting.py",
        "held_out.batch(rows).to(ranks.device), rng)",
        "panel.panel.batch(rows).to(ranks.device), rng)",
        "training/test_overfitting.py",
    ),
    mutant(
        "overfitting: held-out images have the heads of training images",
        "training/overfitting.py",
        "panel.assignment.held_out_heads[rows]",
        "panel.assignment.heads[rows]",
        "training/test_overfitting.py",
    ),
    mutant(
        "overfitting: held-out images are not augmented",
        "training/overfitting.py",
        "images = panel.augmentation(held_out.batch(rows).to(ranks.device), rng)",
        "images = held_out.batch(rows).to(ranks.device)",
        "training/test_overfitting.py",
    ),
    mutant(
        "overfitting: each update measures the same held-out images",
        "training/overfitting.py",
        "batch_rows(len(held_out), recipe.batch, seed, draw,",
        "batch_rows(len(held_out), recipe.batch, seed, 0,",
        "training/test_overfitting.py",
    ),
    mutant(
        "overfitting: generated images stand for training images",
        "training/trainer.py",
        "adapt(batch.panel, (real, held_out, fake), progress",
        "adapt(batch.panel, (fake, held_out, real), progress",
        "training/test_overfitting.py",
    ),
    mutant(
        "overfitting: the strength is not checkpointed",
        "training/state.py",
        "if panel.augmentation is not None:",
        "if panel.augmentation is None:",
        "training/test_overfitting.py",
    ),
    mutant(
        "predictor: probabilities are those of training mode",
        "assignment/predictor.py",
        "predictor.eval()  # one that",
        "pass  # one that",
        "assignment/test_predictor.py",
    ),
    mutant(
        "assignment: held-out images have known views of others",
        "assignment/panel.py",
        "state.held_out_heads.copy_(views_of(panel.held_out, panel.observations))",
        "state.held_out_heads.copy_(views_of(panel.held_out, panel.observations).flip(0))",
        "training/test_overfitting.py",
    ),
    mutant(
        "assignment: held-out images have the predicted views of training images",
        "assignment/predicted.py",
        "self.held_out_heads.copy_(heads[count:])",
        "self.held_out_heads.copy_(heads[: len(self.held_out_heads)])",
        "training/test_overfitting.py",
    ),
    mutant(
        "trainer: real images are not augmented",
        "training/trainer.py",
        "real, fake = panel.augmentation(real, rng), panel.augmentation(fake, rng)",
        "real, fake = real, panel.augmentation(fake, rng)",
        f"{TRAINER}::test_discriminators_see_nothing_that_is_not_augmented",
    ),
    mutant(
        "trainer: the codes of step 0 are drawn in each step",
        "training/trainer.py",
        'rng = generator_at(self.recipe.seed, draw, f"codes/{self.distribution.rank}")',
        'rng = generator_at(self.recipe.seed, 0, f"codes/{self.distribution.rank}")',
        f"{TRAINER}::test_every_update_draws_anew",
    ),
    mutant(
        "trainer: a panel's penalty scale is ignored",
        "training/trainer.py",
        "penalty + batch.panel.panel.penalty_scale * found",
        "penalty + found",
        f"{PANEL}::test_a_discriminator_is_penalised_as_its_panel_says",
    ),
    mutant(
        "trainer: an assignment's loss is dropped",
        "training/trainer.py",
        "extra = extra + batch.panel.assignment.loss(",
        "extra = extra + 0 * batch.panel.assignment.loss(",
        "assignment/test_learned_prior.py",
    ),
    mutant(
        "balancing: a panel's weight is ignored",
        "training/balancing.py",
        "balanced = balanced + panel.panel.weight / panel.gradient_norm * loss",
        "balanced = balanced + 1 / panel.gradient_norm * loss",
        f"{PANEL}::test_balanced_panels_contribute_alike",
    ),
    mutant(
        "balancing: the gradient norm is ignored",
        "training/balancing.py",
        "balanced = balanced + panel.panel.weight / panel.gradient_norm * loss",
        "balanced = balanced + panel.panel.weight * loss",
        f"{PANEL}::test_balanced_panels_contribute_alike",
    ),
    mutant(
        "state: the average is the current generator",
        "training/state.py",
        "rate = 1 - 0.5 ** (1 / half_life) if half_life else 1.0",
        "rate = 1.0",
        "training/test_state.py",
    ),
    mutant(
        "state: a restart keeps the weights",
        "training/state.py",
        'with seeded(self.recipe.seed + 1, "weights"):',
        'with seeded(self.recipe.seed, "weights"):',
        f"{TRAINER}::test_restart_begins_round_1_with_fresh_networks_and_keeps_the_assignment",
    ),
    mutant(
        "recovery: a rollback keeps the learning rate",
        "training/recovery.py",
        "counters.rate_scale / 2, 0",
        "counters.rate_scale, 0",
        "training/test_health.py",
    ),
    mutant(
        "evaluation: the truth is scored in place of the estimate",
        "training/evaluation.py",
        "accuracy_of(domain, state.panel, estimated, true)",
        "accuracy_of(domain, state.panel, true, true)",
        "training/test_evaluation.py",
        VIEWS,
    ),
)

CHOICES = (
    *(
        mutant(f"shapes-paper: {name}", "recipes/shapes.py", old, new, PAPER)
        for name, old, new in (
            ("another optimiser", "Adam(1e-4, beta1=0.5, beta2=0.999)", "Adam(2e-4, beta1=0.5, beta2=0.999)"),
            ("another penalty", "penalty=GradientPenalty(10.0) if", "penalty=GradientPenalty(1.0) if"),
            ("no spectral norm", "spectral=True, slope=0.1", "spectral=False, slope=0.1"),
            ("another loss", 'loss=Wasserstein() if loss == "wasserstein"', 'loss=Hinge() if loss == "wasserstein"'),
            ("one discriminator update a generator update", "discriminator_steps=2", "discriminator_steps=1"),
            ("fewer channels", "channels: int = 512", "channels: int = 256"),
        )
    ),
    *(
        mutant(f"digits-paper: {name}", "recipes/digits.py", old, new, PAPER)
        for name, old, new in (
            ("another optimiser", "Adam(1e-4, beta1=0.5, beta2=0.999)", "Adam(1e-4, beta1=0.0, beta2=0.999)"),
            ("another penalty", "GradientPenalty(10.0),", "None,"),
            ("no spectral norm", "spectral=True, slope=0.1", "slope=0.1"),
            ("another loss", "loss=Wasserstein(),", "loss=Relativistic(),"),
            ("one discriminator update a generator update", "discriminator_steps=2", "discriminator_steps=1"),
            ("fewer channels", "channels: int = 512", "channels: int = 256"),
            ("fewer predictor steps", "predictor_steps: int = 100_000", "predictor_steps: int = 20_000"),
        )
    ),
    *(
        mutant(f"materials-paper: {name}", "recipes/materials.py", old, new, PAPER)
        for name, old, new in (
            ("another optimiser", "Adam(1e-4, beta1=0.5, beta2=0.9)", "Adam(1e-4, beta1=0.5, beta2=0.99)"),
            ("another loss", "loss=Logistic(),", "loss=Relativistic(),"),
            ("a penalty", "penalty=None,", "penalty=R1R2(1.0),"),
            ("fewer channels", "channels: int = 512", "channels: int = 256"),
        )
    ),
    *(
        mutant(f"rounds of the paper: {name}", "recipes/pairing.py", old, new, PAPER)
        for name, old, new in (
            ("four of them", "(0.2, 0.4, 0.6, 0.8), restart=True", "(0.25, 0.5, 0.75), restart=True"),
            ("no restart", "(0.2, 0.4, 0.6, 0.8), restart=True", "(0.2, 0.4, 0.6, 0.8)"),
            ("predictors that go on", "fresh=True", "fresh=False"),
            (
                "another width of the predictor",
                "partial(ViewPredictor, channels=32)",
                "partial(ViewPredictor, channels=16)",
            ),
        )
    ),
)

VERDICTS = (
    mutant(
        "finding: doubtful and failed change places",
        "metrics/finding.py",
        "sign * (value - self.failed) >= 0",
        "sign * (value - self.doubtful) >= 0",
        "metrics/test_finding.py",
    ),
    mutant(
        "finding: what is no number is good",
        "metrics/finding.py",
        "not math.isfinite(value) or ",
        "",
        "metrics/test_finding.py",
    ),
    mutant(
        "finding: the best one decides",
        "metrics/finding.py",
        "return WORDS[max(",
        "return WORDS[min(",
        "metrics/test_finding.py",
    ),
    mutant(
        "view findings: a telling world is not compared with pictures",
        "assignment/view_findings.py",
        "ratio = of_real / of_generated",
        "ratio = of_generated / of_generated",
        "assignment/test_view_findings.py",
    ),
    mutant(
        "view findings: information is the entropy of the mean alone",
        "assignment/view_findings.py",
        "(entropy(p.mean(0)) - entropy(p).mean()).item()",
        "entropy(p.mean(0)).item()",
        "assignment/test_view_findings.py",
    ),
    mutant(
        "evidence: the same object counts as another",
        "domains/evidence.py",
        'distance.masked_fill(~among, float("inf"))',
        "distance",
        "domains/test_evidence.py::test_pictures_of_the_same_object_do_not_count_as_others",
    ),
    mutant(
        "evidence: labels are compared with all views",
        "domains/evidence.py",
        "seen.real_views.roll(len(seen.real_views) // 2)",
        "seen.real_views",
        "domains/test_evidence.py::test_chairs_match_chairs",
    ),
    mutant(
        "domain: pictures are matched to themselves",
        "domains/domain.py",
        "d(seen.real, seen.generated).amin(1)",
        "d(seen.real, seen.others).amin(1)",
        "domains/test_evidence.py::test_discs_do_not_match_cars",
    ),
    mutant(
        "domain: variety is that of real pictures",
        "domains/domain.py",
        "pairs(d(seen.generated, seen.generated))",
        "pairs(d(seen.real, seen.real))",
        "domains/test_evidence.py::test_samples_that_are_alike_vary_too_little",
    ),
    mutant(
        "sides: opposite views are always one",
        "domains/sides.py",
        "if opposite_sides_agree(observations[0]) else density",
        "",
        "domains/test_sides.py::test_a_gap_is_named",
    ),
    mutant(
        "sides: opposite views are never one",
        "domains/sides.py",
        "return (density + density.roll(CELLS // 2)) / 2",
        "return density",
        "domains/test_sides.py::test_a_gap_is_named",
    ),
    mutant(
        "verdict: places are not relative to their collection",
        "training/verdict.py",
        "(rows - ends[which] + lengths[which]) / lengths[which]",
        "rows / len(panel)",
        "training/test_verdict.py::test_pictures_of_the_same_object_are_near",
    ),
    mutant(
        "verdict: held-out pictures are not used",
        "training/verdict.py",
        "panel.batch(rows) if panel.held_out is None else panel.held_out.batch(rows)",
        "panel.batch(rows)",
        "training/test_verdict.py::test_held_out_pictures_are_used_if_there_are_any",
    ),
    mutant(
        "verdict: more projections than training pictures that count",
        "training/verdict.py",
        "max(1, round(apart.float().sum(1).mean().item()))",
        "len(others)",
        "training/test_verdict.py::test_as_many_projections_as_training_pictures_that_count",
    ),
    mutant(
        "verdict: what is said is not what is worst",
        "training/verdict.py",
        "if finding.word == self.word]",
        'if finding.word != "good"]',
        "training/test_verdict.py::test_the_line_says_what_is_worst_and_what_to_do",
    ),
    mutant(
        "verdict: of a run that was stopped",
        "cli/_verdict.py",
        "if not run.complete or ",
        "if ",
        "training/test_verdict.py::test_a_run_that_was_stopped_has_no_verdict",
    ),
    mutant(
        "verdict: stays when training goes on",
        "training/loop.py",
        "(out / run_directory.VERDICT).unlink(missing_ok=True)",
        "pass",
        "training/test_verdict.py::test_the_command_says_and_writes_the_verdict",
    ),
)

ANY_CLASS = (
    mutant(
        "framing: the box begins at a quarter of the maximum",
        "ops/framing.py",
        "level = profile.amax(1, keepdim=True) / 2",
        "level = profile.amax(1, keepdim=True) / 4",
        "ops/test_framing.py",
    ),
    mutant(
        "framing: width does not count",
        "ops/framing.py",
        "torch.maximum(box.height / height, box.width / (width or height))",
        "torch.maximum(box.height / height, box.height / (width or height))",
        "ops/test_framing.py",
    ),
    mutant(
        "framing: pictures are taken for cropped wherever the object is",
        "ops/framing.py",
        "(off <= tolerance * height).all(0)",
        "(off[2:] <= tolerance * height).all(0)",
        "ops/test_framing.py",
    ),
    mutant(
        "cropped: tilted views are scaled the other way",
        "projections/cropped.py",
        "box.height / level.height",
        "level.height / box.height",
        "projections/test_cropped.py",
    ),
    mutant(
        "azimuth: windows lie on the other side",
        "ops/azimuth.py",
        "(column * 2 + 1 - self.size) / self.size) + self._offset(c)",
        "(column * 2 + 1 - self.size) / self.size) - self._offset(c)",
        "projections/test_cropped.py",
    ),
    mutant(
        "azimuth: gradients forget where a window lies",
        "ops/azimuth.py",
        "(x * c - z * s - self._offset(c)) / viewport",
        "(x * c - z * s) / viewport",
        "projections/test_cropped.py",
    ),
    mutant(
        "joint: the generator is steered whatever the weight",
        "assignment/jointly_predicted.py",
        "fake.detach() + w * (fake - fake.detach())",
        "fake",
        "assignment/test_jointly_predicted.py",
    ),
    mutant(
        "joint: worlds may tell more than pictures do",
        "assignment/jointly_predicted.py",
        "falling * min(1.0, max(0.0, room))",
        "falling",
        "assignment/test_jointly_predicted.py",
    ),
    mutant(
        "joint: views are balanced whatever pictures tell",
        "assignment/jointly_predicted.py",
        "balance=estimator.balance * (1 - told)",
        "balance=estimator.balance",
        "assignment/test_jointly_predicted.py",
    ),
    mutant(
        "predictor: flipped images keep their labels",
        "assignment/predictor.py",
        "mirrored[views[half:]]",
        "views[half:]",
        "assignment/test_predictor.py",
    ),
    mutant(
        "silhouette: the mirrored view is the view itself",
        "projections/silhouette.py",
        "-k % azimuths * elevations + band",
        "k * elevations + band",
        "projections/test_silhouette.py::test_the_mirrored_view_shows_the_flipped_picture",
    ),
    mutant(
        "tries: the worst goes on",
        "training/choosing.py",
        "merit.item() > counters.best_merit",
        "merit.item() < counters.best_merit",
        "training/test_tries.py",
    ),
    mutant(
        "tries: others throw the weights of --from away",
        "training/start.py",
        "state.counters.tried = state.recipe.tries.count",
        "state.counters.tried = 0",
        "training/test_start.py::test_no_other_try_throws_the_weights_away",
    ),
    mutant(
        "tries: a resumed try draws as the first",
        "training/state.py",
        "self._begin_assignments(self.counters.start)",
        "pass",
        "training/test_tries.py",
    ),
    mutant(
        "symmetry: the plane z = 0 is taken for x = 0",
        "data/symmetry.py",
        '{"x": -torch.arange(BINS) % BINS, "z": (BINS // 2 - torch.arange(BINS)) % BINS}',
        '{"z": -torch.arange(BINS) % BINS, "x": (BINS // 2 - torch.arange(BINS)) % BINS}',
        "data/test_symmetry.py",
    ),
)

SIZES = (
    mutant(
        "refinement: parts lean the other way",
        "ops/refinement.py",
        "zip(edges, edges[1:], strict=False)",
        "reversed(list(zip(edges, edges[1:], strict=False)))",
        "ops/test_refinement.py",
    ),
    mutant(
        "refinement: parts are interpolated linearly, and averages change",
        "ops/refinement.py",
        "return (t - 2 * t**2 + t**3) / 2, (t + 3 * t**2 - 2 * t**3) / 2, (t**3 - t**2) / 2",
        "return t / 2 * (1 - t / 2), t * (1 + t) / 2 - t**2 / 2, t**2 / 4",
        "networks/test_generators.py::test_finer_logits_average_to_the_logits",
    ),
    mutant(
        "refinement: what lies beyond an end is taken from the other",
        "ops/refinement.py",
        "(place - 1).clamp(min=0)",
        "(place - 1) % count",
        "ops/test_refinement.py::test_what_is_reflected_at_an_end_is_refined_as_its_half",
    ),
    mutant(
        "generator: finer samples repeat voxels",
        "networks/low_rank.py",
        "x = torch.sigmoid(self.logits(code, size // self.size))",
        "x = torch.sigmoid(self.logits(code)).repeat_interleave(size // self.size, 1).repeat_interleave("
        "size // self.size, 2).repeat_interleave(size // self.size, 3)",
        "networks/test_generators.py",
    ),
    mutant(
        "generator: lines are not refined with the planes",
        "networks/low_rank.py",
        "(refined(line(hidden), times, -1) for line",
        "(line(hidden).repeat_interleave(times, -1).roll(1, -1) for line",
        "networks/test_generators.py::test_finer_logits_average_to_the_logits",
    ),
    mutant(
        "generator: finer samples are not reflected exactly",
        "networks/low_rank.py",
        'reflect(x, "xyz".index(self.mirror) + 1)',
        'torch.cat([x, x if size > self.size else x.flip(1)], "xyz".index(self.mirror) + 1)',
        "networks/test_generators.py::test_finer_samples_are_exactly_symmetric",
    ),
    mutant(
        "generator: finer samples are made as many at a time",
        "networks/generators.py",
        "max(min(batch, FINE_VOXELS // max(size, 1) ** 3), 1)",
        "batch",
        "networks/test_generators.py::test_finer_samples_are_made_a_few_at_a_time",
    ),
    mutant(
        "run: samples of any size are tried, whatever memory they take",
        "training/run.py",
        'if size is not None and self.domain.name == "volume":',
        "if False:",
        "cli/test_results.py::test_samples_that_do_not_fit_into_memory",
    ),
    mutant(
        "layout: volumes are repeated in turn",
        "ops/layout.py",
        ".repeat_interleave(times, 1)",
        ".repeat(1, times, 1, 1)",
        "ops/test_layout.py",
    ),
    mutant(
        "layout: silhouettes copy what is repeated",
        "ops/layout.py",
        ".permute(1, 2, 3, 0)",
        ".permute(1, 2, 3, 0).contiguous()",
        "ops/test_layout.py",
    ),
    mutant(
        "size: direct training is at 64 voxels",
        "recipes/sizes.py",
        'SMALL if arguments.get("views") == "direct" else',
        "",
        "recipes/test_sizes.py::test_direct_training_stays_small",
    ),
    mutant(
        "size: pictures of exactly 64 pixels are taken for small",
        "recipes/sizes.py",
        "side is None or side < LARGE",
        "side is None or side <= LARGE",
        "recipes/test_sizes.py::test_of_a_folder_the_median_of_the_shorter_sides",
    ),
    mutant(
        "size: the largest picture of a folder decides",
        "data/readers/sides.py",
        "int(statistics.median(sides))",
        "max(sides)",
        "recipes/test_sizes.py::test_of_a_folder_the_median_of_the_shorter_sides",
    ),
    mutant(
        "size: the longer side of a picture counts",
        "data/readers/sides.py",
        "return min(picture.size)",
        "return max(picture.size)",
        "recipes/test_sizes.py::test_of_a_folder_the_median_of_the_shorter_sides",
    ),
    mutant(
        "size: all pictures of a folder are opened",
        "data/readers/sides.py",
        "if len(files) > MOST else files",
        "if False else files",
        "recipes/test_sizes.py::test_thousands_of_pictures_are_not_all_opened",
    ),
    mutant(
        "size: a run forgets what was chosen",
        "training/origin.py",
        "{**arguments, **_chosen(made.origin, arguments)}",
        "arguments",
        "recipes/test_sizes.py::test_a_run_of_the_command_line_resumes_at_its_size",
    ),
)

MUTANTS: tuple[Mutant, ...] = (
    *TURNS,
    *OCCUPANCY,
    *LINE_INTEGRALS,
    *MICROFACETS,
    *SHADING,
    *LIGHT_AND_MAPS,
    *PRIORS,
    *PROJECTIONS,
    *HEADS,
    *NETWORKS,
    *ADVERSARIAL,
    *PARTS,
    *METRICS,
    *LAWS,
    *FOUNDATIONS,
    *ASSIGNMENTS,
    *TRAINING,
    *VERDICTS,
    *ANY_CLASS,
    *SIZES,
    *CHOICES,
)
