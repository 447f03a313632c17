"""Arrays of clouds and meshes: shared memory, lifetimes, types and shapes, files."""

import gc

import numpy as np
import pytest
import surfelkit
from surfelkit import GaussianCloud, InputError, SurfelCloud, TriangleMesh


def test_views_share_memory(plane, tmp_path):
    view = plane.positions
    assert view.dtype == np.float32 and view.shape == (441, 3) and view.flags.writeable
    assert np.shares_memory(view, plane.positions)
    view[:, 2] = np.arange(441)
    surfelkit.write(tmp_path / "moved.ply", plane)
    assert np.array_equal(surfelkit.read(tmp_path / "moved.ply").positions[:, 2], np.arange(441))


def test_views_outlive_the_cloud(plane):
    views = [plane.positions, plane.normals[::2], plane.columns["green"], plane[:7].colors]
    copies = [view.copy() for view in views]
    del plane
    gc.collect()
    junk = [np.ones(10000) for _ in range(50)]  # Takes memory that may have been given back.
    assert all(np.array_equal(view, copy) for view, copy in zip(views, copies))
    views[0][:] = 3
    assert views[0].sum() == 3 * 3 * 441 and len(junk) == 50


def test_assigned_values_appear_in_views(plane):
    view = plane.normals
    plane.normals = np.tile([1, 0, 0], (441, 1))
    assert np.array_equal(view[5], [1, 0, 0])
    plane.normals = plane.normals[::-1, ::-1]
    assert np.array_equal(view[5], [0, 0, 1])


def test_columns_that_are_taken_away_stay_in_views(plane):
    view = plane.colors
    plane.columns["quality"] = np.arange(441, dtype=np.uint16)
    extra = plane.columns["quality"]
    plane.colors = None
    del plane.columns["quality"]
    assert plane.colors is None and "red" not in plane.columns and "quality" not in plane.columns
    plane.colors = np.ones((441, 3), np.float32)
    assert view[3, 1] == 1 and view[3, 0] == 0 and extra[7] == 7
    assert not np.shares_memory(view, plane.colors)


def test_columns_have_the_names_of_files(plane, tmp_path):
    assert list(plane.columns) == "x y z nx ny nz variance red green blue".split()
    x = plane.columns["x"]
    x /= 4
    assert plane.positions[20, 0] == 0.25 and np.shares_memory(x, plane.positions)
    plane.columns["y"] = np.zeros(441)
    assert plane.positions[:, 1].sum() == 0
    for type_name in ("int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64"):
        plane.columns[f"a_{type_name}"] = np.arange(441).astype(type_name)
    surfelkit.write(tmp_path / "a.ply", plane)
    back = surfelkit.read(tmp_path / "a.ply")
    assert back.columns["a_float64"].dtype == np.float64
    assert all(np.array_equal(back.columns[n], plane.columns[n]) for n in plane.columns)
    assert set(back.columns) == set(plane.columns)
    with pytest.raises(KeyError):
        plane.columns["nothing"]
    with pytest.raises(KeyError):
        del plane.columns["nothing"]
    for name in ("", "two words", "radius", "ü"):
        with pytest.raises(InputError, match="cannot be the name"):
            plane.columns[name] = np.zeros(441)
    with pytest.raises(InputError, match="int64"):
        plane.columns["wide"] = np.arange(441)
    with pytest.raises(InputError, match="tx; assign `tangents`"):
        plane.columns["tx"] = np.zeros(441)


def test_an_empty_cloud_is_filled_by_assignment(ball):
    cloud = SurfelCloud()
    assert len(cloud) == 0 and cloud.positions.shape == (0, 3)
    cloud.positions = ball
    cloud.positions = ball[:100]
    cloud.colors = np.full((100, 3), 128, np.uint8)
    assert len(cloud) == 100 and "100 surfels: positions, colors" in repr(cloud)
    with pytest.raises(InputError, match="other columns"):
        cloud.positions = ball


@pytest.mark.parametrize(
    "name, values, message",
    [
        ("positions", np.zeros((441, 2)), r"\(441, 2\); it must be \(N, 3\)"),
        ("positions", None, "cannot be taken away"),
        ("normals", np.zeros((440, 3)), "440 rows; there are 441 surfels"),
        ("normals", np.zeros((441, 3), complex), "complex128"),
        ("normals", [["a", "b", "c"]] * 441, "real numbers"),
        ("colors", np.zeros((441, 3), int), "linear light, or sRGB codes"),
        ("alpha", np.zeros((441, 1)), r"\(441, 1\); it must be \(N,\)"),
        ("group", np.zeros(441), "whole numbers"),
        ("group", np.full(441, 70000), "do not fit"),
        ("source", np.full(441, -1), "do not fit"),
    ],
)
def test_wrong_values_are_refused(plane, name, values, message):
    before = plane.positions.copy()
    with pytest.raises(InputError, match=message):
        setattr(plane, name, values)
    assert np.array_equal(plane.positions, before) and len(plane.columns) == 10


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"positions": np.zeros(3)}, "shape"),
        ({"positions": "abc"}, "real numbers"),
        ({"positions": np.zeros((2, 3)), "radii": [1, np.nan]}, "surfel 1 is nan"),
        ({"positions": np.zeros((2, 3)), "radii": [1, 0]}, "surfel 1 is 0"),
        ({"positions": np.zeros((2, 3)), "radii": [1]}, "1 rows"),
        ({"positions": np.zeros((2, 3)), "normals": np.zeros((3, 3))}, "3 rows"),
    ],
)
def test_wrong_arrays_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        SurfelCloud.from_arrays(**arguments)


def test_colours_are_codes_or_light(tmp_path):
    codes = np.arange(256 * 3).reshape(256, 3).astype(np.uint8)
    cloud = SurfelCloud.from_arrays(np.random.rand(256, 3), colors=codes)
    a = codes / 255
    light = np.where(a <= 0.04045, a / 12.92, ((a + 0.055) / 1.055) ** 2.4)
    assert np.allclose(cloud.colors, light, atol=1e-6)
    surfelkit.write(tmp_path / "codes.ply", cloud)
    assert b"property uchar red" in (tmp_path / "codes.ply").read_bytes()
    cloud.colors = light
    surfelkit.write(tmp_path / "light.ply", cloud)
    assert b"property float red" in (tmp_path / "light.ply").read_bytes()
    wide = SurfelCloud.from_arrays(np.zeros((1, 3)), colors=np.array([[0, 65535, 257]], np.uint16))
    assert wide.colors[0, 1] == 1 and np.isclose(wide.colors[0, 2], 1 / 255 / 12.92)


def test_far_coordinates_keep_their_precision(ball, tmp_path):
    far = ball + [500000, 4200000, 100]
    cloud = SurfelCloud.from_arrays(far)
    assert np.linalg.norm(cloud.origin) > 4e6
    assert np.abs(cloud.world_positions() - far).max() < 1e-6
    low, high = cloud.bounds()
    assert np.allclose(low, far.min(axis=0)) and np.allclose(high, far.max(axis=0))
    surfelkit.write(tmp_path / "far.ply", cloud)
    assert np.abs(surfelkit.read(tmp_path / "far.ply").world_positions() - far).max() < 1e-6


def test_moved_coordinates_are_not_rounded_to_the_digits_of_their_file(tmp_path):
    text = "".join(f"{500000 + i / 4:.2f} {4200000 + i % 7:.2f} {i % 3:.2f}\n" for i in range(50))
    (tmp_path / "map.xyz").write_text(text)
    cloud = surfelkit.read_points(tmp_path / "map.xyz")
    surfelkit.write(tmp_path / "unseen.xyz", cloud)
    view = cloud.positions
    surfelkit.write(tmp_path / "seen.xyz", cloud)
    same = (tmp_path / "seen.xyz").read_bytes()
    assert same == (tmp_path / "unseen.xyz").read_bytes() and b"500012.25 " in same
    view[:, 2] += np.float32(0.125 / 64)
    surfelkit.write(tmp_path / "moved.ply", cloud)
    back = surfelkit.read(tmp_path / "moved.ply")
    assert np.abs(back.world_positions() - cloud.world_positions()).max() < 1e-6


def test_parts_are_clouds_of_their_own(plane):
    x = plane.positions[:, 0]
    parts = [plane[10:20], plane[::-1], plane[x > 0.5], plane[[3, 3, 5]], plane[np.array([-1])]]
    assert [len(p) for p in parts] == [10, 441, int((x > 0.5).sum()), 3, 1]
    assert np.array_equal(parts[2].positions, plane.positions[x > 0.5])
    assert np.array_equal(parts[3].variance, plane.variance[[3, 3, 5]])
    assert np.array_equal(parts[4].positions[0], plane.positions[440])
    parts[1].positions[:] = 9
    assert plane.positions.max() == 1
    other = plane.copy()
    other.colors[:] = 0
    assert plane.colors.max() == 1
    for key in (3, (slice(None), 2), "x"):
        with pytest.raises((TypeError, IndexError)):
            plane[key]
    with pytest.raises(IndexError):
        plane[[441]]


def test_what_files_say_of_all_surfels(plane, tmp_path):
    plane.up = (0, 0, 2)
    plane.viewpoint = np.array([1, 2, 3])
    plane.color_light = "reflectance"
    plane.provenance = ["made by hand"]
    plane.comments = plane.comments + ["a note"]
    surfelkit.write(tmp_path / "a.ply", plane, ascii=True)
    back = surfelkit.read(tmp_path / "a.ply")
    assert back.viewpoint == (1, 2, 3) and back.color_light == "reflectance"
    assert np.allclose(np.array(back.up) / np.linalg.norm(back.up), [0, 0, 1])
    assert back.provenance == ["made by hand"] and "a note" in back.comments
    with pytest.raises(surfelkit.UsageError, match="recorded, reflectance, mixed, or None"):
        plane.color_light = "neon"
    with pytest.raises(surfelkit.FileError, match="a.ply"):
        surfelkit.write(tmp_path / "a.ply", plane, no_clobber=True)


def test_comments_need_not_be_utf8(tmp_path):
    file = tmp_path / "latin1.ply"
    file.write_bytes(
        b"ply\nformat ascii 1.0\ncomment Kr\xfcmel\nelement vertex 1\nproperty float x\n"
        b"property float y\nproperty float z\nend_header\n1 2 3\n"
    )
    assert "Kr\udcfcmel" in surfelkit.read(file).comments


def test_columns_that_come_together_are_asked_for(plane, tmp_path):
    plane.variance_u = np.ones(441)
    with pytest.raises(InputError, match="come together"):
        surfelkit.write(tmp_path / "a.ply", plane)
    assert not (tmp_path / "a.ply").exists()
    with pytest.raises(InputError, match="come together"):
        surfelkit.render(plane, size=16)
    plane.variance_u = None
    plane.clip2, plane.clip2_distance = np.zeros((441, 3)), np.zeros(441)
    with pytest.raises(InputError, match="without `clip1`"):
        surfelkit.render(plane, size=16)


def test_files_are_read_as_what_they_are(source, plane, quad, tmp_path):
    assert isinstance(surfelkit.read(source / "samples/milk.ply"), SurfelCloud)
    mesh = surfelkit.read(str(source / "samples/spot.obj"))
    assert isinstance(mesh, TriangleMesh) and mesh.triangles.max() < len(mesh.vertices)
    assert isinstance(surfelkit.read(source / "samples/spot.png"), surfelkit.Image)
    assert len(surfelkit.read_points(source / "samples/milk.ply", every=100)) == 138
    low, high = plane.bounds()
    surfelkit.write(tmp_path / "plane ü.ply", plane)
    part = surfelkit.read_points(tmp_path / "plane ü.ply", bounds=(low, (0.5, 0.5, 1)))
    assert 100 <= len(part) <= 121
    with pytest.raises(surfelkit.FileError, match="nowhere.ply") as raised:
        surfelkit.read(tmp_path / "nowhere.ply")
    assert isinstance(raised.value, OSError) and isinstance(raised.value, surfelkit.Error)
    (tmp_path / "broken.ply").write_bytes(b"ply\nformat ascii 1.0\nelement vertex 9\n")
    with pytest.raises(InputError, match="broken.ply") as raised:
        surfelkit.read(tmp_path / "broken.ply")
    assert isinstance(raised.value, ValueError)
    with pytest.raises(surfelkit.UsageError, match="`every`"):
        surfelkit.read_points(source / "samples/milk.ply", every=0)
    with pytest.raises(surfelkit.UsageError, match="`ascii`"):
        surfelkit.write(tmp_path / "mesh.ply", quad, ascii=True)


def test_meshes(quad, tmp_path):
    quad.vertex_colors = np.full((4, 3), 255, np.uint8)
    quad.triangle_normals = np.tile([0, 0, 1], (2, 3, 1))
    surfelkit.write(tmp_path / "quad.ply", quad)
    back = surfelkit.read(tmp_path / "quad.ply")
    assert np.array_equal(back.triangles, quad.triangles)
    assert np.array_equal(back.triangle_uvs, quad.triangle_uvs) and back.vertex_colors.min() == 1
    quad.triangles[1, 2] = 77
    with pytest.raises(InputError, match="77"):
        surfelkit.sample(quad, count=10)
    with pytest.raises(InputError, match="99"):
        TriangleMesh.from_arrays(np.zeros((3, 3)), [[0, 1, 99]])
    with pytest.raises(InputError, match="vertex 1 of the mesh is not finite"):
        TriangleMesh.from_arrays([[0, 0, 0], [np.nan, 0, 0], [1, 1, 0]], [[0, 1, 2]])
    with pytest.raises(InputError, match="whole numbers"):
        TriangleMesh.from_arrays(np.zeros((3, 3)), [[0.0, 1.0, 2.0]])


def test_gaussians(ball, tmp_path):
    count = 50
    random = np.random.default_rng(2)
    rotations = random.normal(size=(count, 4))
    cloud = GaussianCloud.from_arrays(
        ball[:count],
        np.full((count, 3), 0.1),
        rotations / np.linalg.norm(rotations, axis=1, keepdims=True),
        np.full(count, 0.5),
        random.normal(size=(count, 4, 3)),
    )
    assert cloud.degree == 1 and len(cloud) == count
    surfelkit.write(tmp_path / "splats.ply", cloud)
    back = surfelkit.read(tmp_path / "splats.ply")
    assert isinstance(back, GaussianCloud)
    assert np.allclose(back.scales, 0.1) and np.allclose(back.opacities, 0.5, atol=1e-6)
    assert np.allclose(back.harmonics, cloud.harmonics, atol=1e-6)
    part = back[back.positions[:, 0] > 0]
    assert 0 < len(part) < count and part.harmonics.shape == (len(part), 4, 3)
    back.harmonics[0, 0, 0] = np.nan
    with pytest.raises(InputError, match="Gaussian 0"):
        surfelkit.render_gaussians(back, size=16)
    with pytest.raises(InputError, match="1, 4, 9, 16 or 25"):
        GaussianCloud.from_arrays(
            ball[:2], np.ones((2, 3)), np.ones((2, 4)), [1, 1], np.zeros((2, 5, 3))
        )
