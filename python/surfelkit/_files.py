"""Files of any kind that Surfelkit reads and writes."""

from __future__ import annotations

import os
import warnings
from typing import Mapping, Sequence

import numpy as np

from . import _core
from ._arguments import Array, Path, Progress, Vector, name_of
from ._core import GaussianCloud, Image, SurfelCloud, TriangleMesh


def read(path: Path) -> SurfelCloud | TriangleMesh | GaussianCloud | Image:
    """What a file holds, as it is: points or surfels, a mesh, trained Gaussians, or a picture.

    PLY is told by its header, other files by their names. Raises InputError for volumes and for
    formats that are not read, FileError where the file cannot be read.
    """
    kind = _core.file_kind(name_of(path))
    if kind == "mesh":
        return read_mesh(path)
    if kind == "gaussians":
        return read_gaussians(path)
    if kind == "image":
        return read_image(path)
    if kind == "volume":
        raise _core.InputError(
            f"{os.fspath(path)}: holds a volume; surfel-from-volume makes Gaussians of it"
        )
    return read_points(path)


def read_points(
    path: Path,
    *,
    every: int = 1,
    level: int | None = None,
    bounds: tuple[Vector, Vector] | None = None,
    columns: Sequence[str] = (),
    progress: Progress = None,
    threads: int | None = None,
) -> SurfelCloud:
    """Points or surfels of PLY, PCD, LAS, LAZ, COPC, E57, PTX or text; of a mesh the vertices.

    every: one point in so many is read, the first one on.
    level: of COPC the points of this level and the coarser ones; None: all.
    bounds: lowest and highest corner of a box, world coordinates: the points inside alone.
    columns: names of the columns of a text file, "-" for one to be left out.
    progress, threads: as estimate() has them.

    Of a file with levels of detail the finest is read. Raises InputError, FileError, UsageError.
    """
    options = {"every": every, "level": level, "bounds": bounds, "columns": list(columns)}
    return _core.read_points(name_of(path), options, progress, threads)


def read_mesh(path: Path) -> TriangleMesh:
    """A mesh of PLY, OBJ, STL, OFF or glTF. Raises InputError, FileError."""
    return _core.read_mesh(name_of(path))


def read_gaussians(path: Path) -> GaussianCloud:
    """Trained splats of PLY, .splat, .spz or .ksplat. Raises InputError, FileError."""
    return _core.read_gaussians(name_of(path))


def read_image(path: Path, *, raw: bool = False) -> Image:
    """A picture, linear with premultiplied alpha; integers are decoded from sRGB.

    raw: all channels under their names, as EXR stores them, and not R G B A alone.

    Raises InputError, FileError.
    """
    return _core.read_image(name_of(path), raw)


def write(
    path: Path,
    data: SurfelCloud | TriangleMesh | GaussianCloud | Image | Array,
    *,
    ascii: bool = False,
    metadata: Mapping[str, str] | None = None,
    no_clobber: bool = False,
) -> None:
    """Writes a file by its extension, whole or not at all; the same data gives the same bytes.

    Clouds become PLY, PCD, LAS, LAZ, text or OBJ, meshes OBJ or PLY, Gaussians PLY, .splat or
    .usda, pictures PNG, EXR, TIFF, JPEG, HDR and more; arrays are taken as Image takes them.

    ascii: PLY of clouds as text.
    metadata: text for files of pictures; EXR gets the camera of a picture besides.
    no_clobber: a file that is there is left, which raises FileError.

    Warns of columns that LAS and LAZ do not hold as they are: scaled, rounded, clamped, renamed.
    Raises FileError, UsageError for extensions that are not written.
    """
    if ascii and not isinstance(data, SurfelCloud):
        raise _core.UsageError("`ascii` has no effect but on clouds; leave it out")
    if metadata and not isinstance(data, (Image, np.ndarray)):
        raise _core.UsageError("`metadata` has no effect but on pictures; leave it out")
    name = name_of(path)
    if isinstance(data, SurfelCloud):
        for change in _core.write_points(name, data, ascii, no_clobber):
            warnings.warn(f"{os.fspath(path)!r}: {change}", stacklevel=2)
    elif isinstance(data, TriangleMesh):
        _core.write_mesh(name, data, no_clobber)
    elif isinstance(data, GaussianCloud):
        _core.write_gaussians(name, data, no_clobber)
    else:
        _core.write_image(name, data, list((metadata or {}).items()), no_clobber)
