"""Surfels from meshes, scans and point clouds, and pictures of them, with NumPy arrays in and out.

    import surfelkit

    points = surfelkit.read_points("scan.ply")
    surfels = surfelkit.estimate(points)
    image = surfelkit.render(surfels, size=(640, 480))
    surfelkit.write("scan.png", image)

Positions, lengths and variances are in the units of the scene, colours are linear light, angles of
views in degrees. Functions leave their arguments as they are. They let other Python threads run,
end with an exception at Ctrl-C, and give the same result on any number of threads; while one works
on an object, nothing else may write to the object's arrays.

Arguments that are out of range raise UsageError, arrays and files with wrong content InputError (a
ValueError each), files that cannot be read or written FileError (an OSError), computations that
fail NumericError (an ArithmeticError); all are Error.
"""

from ._core import (
    Camera,
    Error,
    FileError,
    GaussianCloud,
    Image,
    InputError,
    NumericError,
    SurfelCloud,
    TriangleMesh,
    UsageError,
    __version__,
    allow_outside,
    set_thread_count,
    thread_count,
)
from ._files import read, read_gaussians, read_image, read_mesh, read_points, write
from ._pictures import (
    Comparison,
    Renderer,
    compare,
    difference,
    frame,
    render,
    render_gaussians,
)
from ._surfels import Columns, estimate, fit_colors, fit_texture, sample

__all__ = [
    "Camera",
    "Columns",
    "Comparison",
    "Error",
    "FileError",
    "GaussianCloud",
    "Image",
    "InputError",
    "NumericError",
    "Renderer",
    "SurfelCloud",
    "TriangleMesh",
    "UsageError",
    "__version__",
    "allow_outside",
    "compare",
    "difference",
    "estimate",
    "fit_colors",
    "fit_texture",
    "frame",
    "read",
    "read_gaussians",
    "read_image",
    "read_mesh",
    "read_points",
    "render",
    "render_gaussians",
    "sample",
    "set_thread_count",
    "thread_count",
    "write",
]
