"""Pictures: framing, rendering, comparing. Defaults are the library's own."""

from __future__ import annotations

import os
from typing import Any, NamedTuple

import numpy as np

from . import _core
from ._arguments import Array, Path, Progress, Size, Vector, name_of, options_of
from ._core import Camera, GaussianCloud, Image, SurfelCloud

_VIEW = _core.view_defaults()
_RENDER = _core.render_defaults()
_GAUSSIANS = _core.gaussian_defaults()
_COMPARE = _core.compare_defaults()


def _refuse_view(view: dict[str, Any]) -> None:
    """A camera leaves nothing of a view open."""
    for name, value in view.items():
        default = _VIEW[name]
        same = np.array_equal(value, default) if default is not None else value is None
        if not same:
            raise _core.UsageError(f"`{name}` has no effect beside `camera`; leave it out")


class Renderer:
    """Surfels made ready once, for pictures from any number of cameras.

    source: surfels, or the name of a file of surfels: of one with levels of detail, or larger
        than memory, a picture reads what it shows.
    scene: a scene file (TOML) of materials, lights and environment; None: a headlight and a sky.
    kernel: "auto", "affine" or "perspective"; kernel_tolerance: of "auto", pixels.
    filter: "ewa", "circular" or "none".
    cutoff: kernels end where beta >= cutoff, 0.1 to 16; 2 is smoother, at twice the time.
    lowpass: standard deviation of the pixel filter, pixels.
    layers: surfaces that a pixel blends, 1 to 64.
    depth_epsilon: in footprints, what belongs to one surface.
    coverage_threshold: of edges' antialiasing; None: by the cutoff.
    cull_back: surfels that face away are left out.
    lit: shaded; None: unless the colours are recorded light.
    relief: "none", "eye-dome" or "occlusion", shading by depths; None: "occlusion" where there are
        no colours.
    background: linear R G B and straight alpha.
    lod_error: pixels that surfels of coarser levels may stand for; 0: the finest level alone.
    aovs: with depth, first_depth, normals and weight.
    progress, threads: as estimate() has them.

    Raises InputError where surfels have no sizes (estimate() makes them), UsageError.
    """

    def __init__(
        self,
        source: SurfelCloud | Path,
        *,
        scene: Path | None = None,
        kernel: str = _RENDER["kernel"],
        kernel_tolerance: float = _RENDER["kernel_tolerance"],
        filter: str = _RENDER["filter"],
        cutoff: float = _RENDER["cutoff"],
        lowpass: float = _RENDER["lowpass"],
        layers: int = _RENDER["layers"],
        depth_epsilon: float = _RENDER["depth_epsilon"],
        coverage_threshold: float | None = _RENDER["coverage_threshold"],
        cull_back: bool = _RENDER["cull_back"],
        lit: bool | None = _RENDER["lit"],
        relief: str | None = _RENDER["relief"],
        background: Vector = tuple(_RENDER["background"]),
        lod_error: float | None = _RENDER["lod_error"],
        aovs: bool = _RENDER["aovs"],
        progress: Progress = None,
        threads: int | None = None,
    ) -> None:
        options = options_of(locals(), _RENDER)
        surfels: SurfelCloud | bytes = (
            source if isinstance(source, SurfelCloud) else name_of(source)
        )
        name = None if scene is None else name_of(scene)
        self._renderer = _core.Renderer(surfels, name, options, progress, threads)

    def __len__(self) -> int:
        """Surfels that can be drawn."""
        return len(self._renderer)

    def frame(
        self,
        *,
        size: Size = tuple(_VIEW["size"]),
        eye: Vector | None = _VIEW["eye"],
        target: Vector | None = _VIEW["target"],
        up: Vector | None = _VIEW["up"],
        direction: Vector | None = _VIEW["direction"],
        view: str | None = _VIEW["view"],
        fov: float = _VIEW["fov"],
        ortho: float | None = _VIEW["ortho"],
        near: float = _VIEW["near"],
        zoom: float = _VIEW["zoom"],
        frame_all: bool = _VIEW["frame_all"],
    ) -> Camera:
        """A camera that sees the surfels; arguments as frame() has them."""
        return self._renderer.frame(options_of(locals(), _VIEW))

    def render(
        self, camera: Camera | None = None, *, progress: Progress = None, threads: int | None = None
    ) -> Image:
        """A picture; camera: None: frame(). Raises UsageError for cameras that are not usable."""
        seen_from = self.frame() if camera is None else camera
        return self._renderer.render(seen_from, progress, threads)


def frame(
    source: SurfelCloud | GaussianCloud | Path,
    *,
    size: Size = tuple(_VIEW["size"]),
    eye: Vector | None = _VIEW["eye"],
    target: Vector | None = _VIEW["target"],
    up: Vector | None = _VIEW["up"],
    direction: Vector | None = _VIEW["direction"],
    view: str | None = _VIEW["view"],
    fov: float = _VIEW["fov"],
    ortho: float | None = _VIEW["ortho"],
    near: float = _VIEW["near"],
    zoom: float = _VIEW["zoom"],
    frame_all: bool = _VIEW["frame_all"],
) -> Camera:
    """A camera that sees all. What is not given is chosen as surfel-render chooses it: which way
    is up and where the front is are guessed (docs/views.md).

    source: what is to be seen; of files of surfels their name.
    size: (width, height) or one number for both, pixels.
    eye: place in world coordinates; None: so far in the direction that all is seen.
    target: the point that is looked at; None: the middle.
    up: upward direction; direction: from the target to the eye, where `eye` is not given.
    view: "front", "back", "left", "right", "top", "bottom", "iso" or "sensor", beside no direction.
    fov: vertical field of view, degrees; ortho: parallel rays instead, visible height in units.
    near: nothing nearer is drawn, scene units.
    zoom: enlarges about the middle; frame_all: takes in stray points.

    Raises UsageError where these do not go together.
    """
    options = options_of(locals(), _VIEW)
    if isinstance(source, GaussianCloud):
        return _core.frame_gaussians(source, options)
    return Renderer(source)._renderer.frame(options)


def render(
    source: SurfelCloud | Path,
    camera: Camera | None = None,
    *,
    size: Size = tuple(_VIEW["size"]),
    eye: Vector | None = _VIEW["eye"],
    target: Vector | None = _VIEW["target"],
    up: Vector | None = _VIEW["up"],
    direction: Vector | None = _VIEW["direction"],
    view: str | None = _VIEW["view"],
    fov: float = _VIEW["fov"],
    ortho: float | None = _VIEW["ortho"],
    near: float = _VIEW["near"],
    zoom: float = _VIEW["zoom"],
    frame_all: bool = _VIEW["frame_all"],
    scene: Path | None = None,
    kernel: str = _RENDER["kernel"],
    kernel_tolerance: float = _RENDER["kernel_tolerance"],
    filter: str = _RENDER["filter"],
    cutoff: float = _RENDER["cutoff"],
    lowpass: float = _RENDER["lowpass"],
    layers: int = _RENDER["layers"],
    depth_epsilon: float = _RENDER["depth_epsilon"],
    coverage_threshold: float | None = _RENDER["coverage_threshold"],
    cull_back: bool = _RENDER["cull_back"],
    lit: bool | None = _RENDER["lit"],
    relief: str | None = _RENDER["relief"],
    background: Vector = tuple(_RENDER["background"]),
    lod_error: float | None = _RENDER["lod_error"],
    aovs: bool = _RENDER["aovs"],
    progress: Progress = None,
    threads: int | None = None,
) -> Image:
    """A picture of surfels, with the bytes that surfel-render makes of their own colours.

    camera: None: as frame() makes one of size, eye, target ... frame_all.
    Other arguments as Renderer has them.

    numpy.asarray(image) is float32 (H, W, 4), linear light, premultiplied; with aovs=True
    image.depth, image.normals and more. Raises InputError, UsageError, FileError.
    """
    arguments = dict(locals())
    view_options = options_of(arguments, _VIEW)
    if camera is not None:
        _refuse_view(view_options)
    renderer = Renderer(
        source,
        scene=scene,
        progress=progress,
        threads=threads,
        **{name: arguments[name] for name in _RENDER},
    )
    if camera is None:
        camera = renderer._renderer.frame(view_options)
    return renderer.render(camera, progress=progress, threads=threads)


def render_gaussians(
    cloud: GaussianCloud,
    camera: Camera | None = None,
    *,
    size: Size = tuple(_VIEW["size"]),
    eye: Vector | None = _VIEW["eye"],
    target: Vector | None = _VIEW["target"],
    up: Vector | None = _VIEW["up"],
    direction: Vector | None = _VIEW["direction"],
    view: str | None = _VIEW["view"],
    fov: float = _VIEW["fov"],
    ortho: float | None = _VIEW["ortho"],
    near: float = _VIEW["near"],
    zoom: float = _VIEW["zoom"],
    frame_all: bool = _VIEW["frame_all"],
    profile: str | None = _GAUSSIANS["profile"],
    lowpass: float = _GAUSSIANS["lowpass"],
    samples: int = _GAUSSIANS["samples"],
    background: Vector = tuple(_GAUSSIANS["background"]),
    depth: bool = _GAUSSIANS["depth"],
    progress: Progress = None,
    threads: int | None = None,
) -> Image:
    """A picture of Gaussians in space, with the bytes that surfel-render makes.

    camera, size ... frame_all: as render() and frame() have them.
    profile: whose picture: "inria", "gsplat", "mip", "2dgs", "exact" or "surfel"; None: as the file
        says, else "inria" (docs/gaussians.md).
    lowpass: standard deviation of the pixel filter of "exact" and "surfel", pixels.
    samples: of "exact" along each side of a pixel, 1 to 4; 0: 2 for volumes, else 1.
    background: linear R G B and straight alpha.
    depth: with image.depth and image["Z.mean"].
    progress, threads: as estimate() has them.

    Raises InputError for values that are not finite, UsageError.
    """
    arguments = dict(locals())
    view_options = options_of(arguments, _VIEW)
    if camera is None:
        camera = _core.frame_gaussians(cloud, view_options)
    else:
        _refuse_view(view_options)
    return _core.render_gaussians(
        cloud, camera, options_of(arguments, _GAUSSIANS), progress, threads
    )


class Comparison(NamedTuple):
    """How far a picture is from the truth; differences are fractions of full scale."""

    pixels: int  #: That were compared.
    nonfinite: int  #: Of these, with NaN or infinity, each a difference of 1.
    psnr: float  #: dB; infinity for equal pictures.
    rmse: float
    mean_absolute: float
    maximum: float
    maximum_at: tuple[int, int, int]  #: Row, column and channel of the largest difference.
    beyond: float  #: Share of the pixels that differ by more than the threshold.
    holes: float  #: Share of the truth's solid pixels whose alpha is below 0.5.
    alpha_psnr: float  #: dB, of alpha.


def compare(
    tested: Image | Array,
    truth: Image | Array,
    *,
    encoding: str = _COMPARE["encoding"],
    background: Vector = tuple(_COMPARE["background"]),
    threshold: float = _COMPARE["threshold"],
    inside_only: bool = _COMPARE["inside_only"],
) -> Comparison:
    """Measures how far a picture is from another, as surfel-compare.

    tested, truth: of the same size; arrays as Image takes them.
    encoding: "srgb", as viewers see them, or "linear".
    background: what both are laid over, linear R G B and straight alpha.
    threshold: a pixel counts as beyond where a channel differs by more, 0 to 1.
    inside_only: colours are compared only where both alphas are at least 0.99.

    Raises InputError for other sizes and shapes, UsageError.
    """
    return Comparison(**_core.compare(tested, truth, options_of(locals(), _COMPARE)))


def difference(
    tested: Image | Array,
    truth: Image | Array,
    *,
    encoding: str = _COMPARE["encoding"],
    background: Vector = tuple(_COMPARE["background"]),
    threshold: float = _COMPARE["threshold"],
    inside_only: bool = _COMPARE["inside_only"],
    scale: float = 10,
) -> Image:
    """A picture of scale * |tested - truth|; other arguments as compare() has them."""
    return _core.difference(tested, truth, options_of(locals(), _COMPARE), scale)
