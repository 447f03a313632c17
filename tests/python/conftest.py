"""What tests share."""

import os
import pathlib

import numpy as np
import pytest
import surfelkit


@pytest.fixture(scope="session")
def source():
    """The folder of the project."""
    return pathlib.Path(os.environ["SURFEL_SOURCE_DIR"])


@pytest.fixture
def plane():
    """Surfels of the square 0..1 in the plane z = 0, green, 21 x 21 of them."""
    x, y = np.meshgrid(np.linspace(0, 1, 21), np.linspace(0, 1, 21))
    positions = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)
    return surfelkit.SurfelCloud.from_arrays(
        positions,
        normals=np.tile([0, 0, 1], (len(positions), 1)),
        colors=np.tile([0.0, 1.0, 0.0], (len(positions), 1)),
        radii=np.full(len(positions), 0.08),
    )


@pytest.fixture
def ball():
    """Points of the unit sphere."""
    random = np.random.default_rng(1)
    points = random.normal(size=(4000, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


@pytest.fixture
def quad():
    """A mesh of two triangles that covers the unit square, with texture coordinates."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    return surfelkit.TriangleMesh.from_arrays(
        corners, triangles, triangle_uvs=corners[triangles][:, :, :2]
    )
