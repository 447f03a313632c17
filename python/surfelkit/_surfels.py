"""What makes surfels: estimation, sampling, textures. Defaults are the library's own."""

from __future__ import annotations

import os
from typing import Any, Iterator, MutableMapping

from numpy.typing import ArrayLike

from . import _core
from ._arguments import Array, Path, Progress, Vector, name_of, options_of
from ._core import Image, SurfelCloud, TriangleMesh

_ESTIMATE = _core.estimate_defaults()
_SAMPLE = _core.sample_defaults()
_FIT = _core.fit_defaults()


class Columns(MutableMapping[str, Array]):
    """The numbers of a cloud by the names that files have (docs/format.md).

    Values are views (N,) of the cloud's memory; red, green and blue are linear light. Assigning
    copies values in their place, or adds a column of an unknown name with the array's type.
    `radius` follows from the variances and is no column.
    """

    def __init__(self, cloud: SurfelCloud) -> None:
        self._cloud = cloud

    def __getitem__(self, name: str) -> Array:
        return self._cloud._column(name)

    def __setitem__(self, name: str, values: ArrayLike) -> None:
        self._cloud._set_column(name, values)

    def __delitem__(self, name: str) -> None:
        self._cloud._remove_column(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self._cloud._column_names())

    def __len__(self) -> int:
        return len(self._cloud._column_names())

    def __repr__(self) -> str:
        return f"<Columns: {', '.join(self)}>"


# Here, as it is a class of Python's.
SurfelCloud.columns = property(  # type: ignore[assignment]
    Columns, doc="Numbers by the names that files have, a dict of views (N,); see Columns."
)


def estimate(
    cloud: SurfelCloud,
    *,
    k: int = _ESTIMATE["k"],
    adaptive: bool = _ESTIMATE["adaptive"],
    k_min: int = _ESTIMATE["k_min"],
    k_max: int = _ESTIMATE["k_max"],
    radius: float = _ESTIMATE["radius"],
    grow_in_noise: bool = _ESTIMATE["grow_in_noise"],
    search: str = _ESTIMATE["search"],
    orient: str = _ESTIMATE["orient"],
    viewpoint: Vector | None = _ESTIMATE["viewpoint"],
    up: Vector = _ESTIMATE["up"],
    variance: str = _ESTIMATE["variance"],
    anisotropy: str = _ESTIMATE["anisotropy"],
    cutoff: float = _ESTIMATE["cutoff"],
    max_radius: float = _ESTIMATE["max_radius"],
    clip: bool = _ESTIMATE["clip"],
    crease_angle: float = _ESTIMATE["crease_angle"],
    remove_outliers: bool = _ESTIMATE["remove_outliers"],
    outlier_neighbors: int = _ESTIMATE["outlier_neighbors"],
    outlier_deviations: float = _ESTIMATE["outlier_deviations"],
    voxel: float | None = _ESTIMATE["voxel"],
    smooth: bool = _ESTIMATE["smooth"],
    smooth_spacings: float = _ESTIMATE["smooth_spacings"],
    smooth_order: int = _ESTIMATE["smooth_order"],
    smooth_normals: bool = _ESTIMATE["smooth_normals"],
    report: dict[str, Any] | None = None,
    progress: Progress = None,
    threads: int | None = None,
) -> SurfelCloud:
    """Surfels of raw points: normals, their sides, sizes that just close the surface.

    As surfel-estimate, with the same bytes. Points that are not finite are left out, all columns
    but normals and sizes are kept; `columns` has curvature, confidence, flag and side_confidence.

    k: points of a neighbourhood, the point itself included, 3 to 65535.
    adaptive, k_min, k_max: a number for each point instead, as noise and curvature ask for it.
    radius: above 0: all points within it instead, scene units.
    grow_in_noise: larger neighbourhoods where noise exceeds the spacing.
    search: "exact", "flann" or "flann-approx".
    orient: side of the normals: "auto" (to the viewpoint where one is known, else "winding"),
        "winding", "mst", "outward", "viewpoint", "up", "align" (to the cloud's normals), "none".
    viewpoint: where the scanner stood, world coordinates; None: as the cloud says.
    up: direction for orient="up".
    variance: "cover" or "max-distance"; anisotropy: ellipses, "auto", "on" or "off".
    cutoff: c of beta < c that discs close the surface at, 0.1 to 16.
    max_radius: longest reach in local spacings, at least 1; 0: as far as gaps are.
    clip: surfels end at borders and creases; crease_angle: least angle there, degrees, 10 to 90.
    remove_outliers: points further from outlier_neighbors (1 to 1024) neighbours than the mean by
        outlier_deviations standard deviations are left out first.
    voxel: points are averaged in cubes with this edge, scene units; 0: twice the spacing.
    smooth: points are moved onto polynomials of order smooth_order (1 to 5) over smooth_spacings
        (1 to 20) spacings; smooth_normals: with the normals of these.
    report: a dict that figures are added to: points, nonfinite, outliers, orient and others.
    progress: called with the name of a stage and the share of it that is done, 0 to 1.
    threads: for this call, 1 to 1024; None: thread_count().

    Raises UsageError, and InputError where no finite point is left.
    """
    options = options_of(locals(), _ESTIMATE)
    surfels, figures = _core.estimate(cloud, options, progress, threads)
    if report is not None:
        report.update(figures)
    return surfels


def sample(
    mesh: TriangleMesh,
    *,
    spacing: float | None = _SAMPLE["spacing"],
    count: int | None = _SAMPLE["count"],
    seed: int = _SAMPLE["seed"],
    flat: bool = _SAMPLE["flat"],
    variance_scale: float = _SAMPLE["variance_scale"],
    crease_angle: float = _SAMPLE["crease_angle"],
    clip: bool = _SAMPLE["clip"],
    report: dict[str, Any] | None = None,
    progress: Progress = None,
    threads: int | None = None,
) -> SurfelCloud:
    """Blue-noise surfels over a mesh, with its texture coordinates, as surfel-from-mesh.

    spacing or count: root of the area by sample, scene units, or their number, 1 to 2^28.
    seed: chooses the pattern.
    flat: normals of the faces instead of smooth ones.
    variance_scale: standard deviation of the kernels in spacings.
    crease_angle: faces that meet at a larger angle share no normal, radians.
    clip: surfels end at the mesh's borders and creases; mirrored ones come on top of `count`.
    report: a dict that figures are added to: spacing, area, faces, components and others.
    progress, threads: as estimate() has them.

    Raises UsageError, and InputError where the mesh has no area.
    """
    options = options_of(locals(), _SAMPLE)
    surfels, figures = _core.sample(mesh, options, progress, threads)
    if report is not None:
        report.update(figures)
    return surfels


def fit_texture(
    cloud: SurfelCloud,
    image: Path | Image | Array | None = None,
    mesh: TriangleMesh | None = None,
    *,
    fit: str = _FIT["fit"],
    cutoff: float = _FIT["cutoff"],
    wrap: str | None = _FIT["wrap"],
    charts: bool = _FIT["charts"],
    reconstruction: float | None = _FIT["reconstruction"],
    prefilter: float = _FIT["prefilter"],
    max_aspect: float = _FIT["max_aspect"],
    exact: bool = _FIT["exact"],
    solver: str = _FIT["solver"],
    tolerance: float = _FIT["tolerance"],
    lambda_: float | None = _FIT["lambda_"],
    bounds: tuple[float, float] | None = _FIT["bounds"],
    points: int | None = _FIT["points"],
    robust: bool = _FIT["robust"],
    report: dict[str, Any] | None = None,
    progress: Progress = None,
    threads: int | None = None,
) -> SurfelCloud:
    """The surfels with texture coefficients, filtered for each, as surfel-texture.

    image: a file, the name of a procedural texture, an Image, or an array (H, W, 3 or 4): uint8
        and uint16 are sRGB codes with straight alpha, floats linear light with straight alpha.
        None: the images that the materials of the mesh name.
    mesh: that the surfels were sampled from: kernels stay within its charts, and surfels without
        texture coordinates get them.
    fit: "ewa", "gram" or "render" (sharper, for render(..., cutoff=cutoff)).
    wrap: "repeat", "mirror" or "clamp"; None: as the material says, else repeat.
    charts: kernels take no colour from beyond their chart.
    reconstruction, prefilter, max_aspect, exact: of the filter, see docs/texture.md.
    solver ("cg", "ceres"), tolerance, lambda_, bounds: of fits other than "ewa"; points,
        robust: of "render" alone.
    report: a dict that figures are added to: charts, without_uv, iterations, error and others.
    progress, threads: as estimate() has them.

    Raises UsageError, and InputError where the cloud lacks what the image needs.
    """
    options = options_of(locals(), _FIT)
    source = name_of(image) if isinstance(image, (str, os.PathLike)) else image
    surfels, figures = _core.fit_texture(cloud, source, mesh, options, progress, threads)
    if report is not None:
        report.update(figures)
    return surfels


def fit_colors(
    cloud: SurfelCloud,
    *,
    fit: str = "render",
    cutoff: float = _FIT["cutoff"],
    solver: str = _FIT["solver"],
    tolerance: float = _FIT["tolerance"],
    lambda_: float | None = _FIT["lambda_"],
    bounds: tuple[float, float] | None = _FIT["bounds"],
    robust: bool = _FIT["robust"],
    report: dict[str, Any] | None = None,
    progress: Progress = None,
    threads: int | None = None,
) -> SurfelCloud:
    """The surfels with coefficients by which their picture takes their own colours, sharper.

    As surfel-texture --from colors; arguments as fit_texture() has them. Raises UsageError, and
    InputError where the cloud has no colours.
    """
    options = {**_FIT, **{name: value for name, value in locals().items() if name in _FIT}}
    surfels, figures = _core.fit_colors(cloud, options, progress, threads)
    if report is not None:
        report.update(figures)
    return surfels
