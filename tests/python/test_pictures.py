"""Pictures: shapes, depths, cameras, files, comparisons."""

import gc

import numpy as np
import pytest
import surfelkit
from surfelkit import Camera, Image, InputError, UsageError


def test_a_plane_seen_from_above(plane):
    plane.color_light = "recorded"  # Recorded light is shown as it is.
    image = surfelkit.render(
        plane, size=(40, 30), eye=(0.5, 0.5, 2), target=(0.5, 0.5, 0), ortho=0.6, aovs=True
    )
    rgba = np.asarray(image)
    assert rgba.shape == (30, 40, 4) and rgba.dtype == np.float32
    assert np.shares_memory(rgba, image.data)
    assert image.channels == ("R", "G", "B", "A", "Z", "Z.first", "N.X", "N.Y", "N.Z", "weight")
    assert np.allclose(rgba, [0, 1, 0, 1], atol=1e-4)
    assert np.allclose(image.depth, 2, atol=1e-4)
    assert np.allclose(image.first_depth, image["Z.first"])
    assert np.allclose(image.normals, [0, 0, 1], atol=1e-4)
    assert image.weight.shape == (30, 40) and image.data.shape == (30, 40, 10)
    assert np.array_equal(np.asarray(image, dtype=np.float64), rgba.astype(np.float64))
    with pytest.raises(KeyError):
        image["nothing"]
    lit = surfelkit.render(plane, image.camera, lit=True)
    assert lit.depth is None and not np.allclose(lit.rgba, rgba, atol=0.1)
    view = lit.rgba
    copy = view.copy()
    del lit
    gc.collect()
    assert np.array_equal(view, copy)


def test_cameras_of_intrinsics_and_a_matrix_see_where_points_are(plane):
    plane.positions[:] = plane.positions * 0.05
    plane.variance[:] = plane.variance * 0.05**2
    angle = 0.3
    rotation = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, -1, 0], [np.sin(angle), 0, -np.cos(angle)]]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    matrix[:3, 3] = [0.1, -0.05, 1.5]
    intrinsics = np.array([[90, 0, 36], [0, 80, 20], [0, 0, 1.0]])
    camera = Camera((64, 48), intrinsics, matrix)
    assert camera.size == (64, 48) and np.allclose(camera.matrix, matrix)
    assert np.allclose(camera.intrinsics, intrinsics)
    assert np.allclose(rotation @ camera.eye + matrix[:3, 3], 0)
    alpha = surfelkit.render(plane, camera).rgba[:, :, 3]
    rows, columns = np.mgrid[:48, :64] + 0.5
    seen = intrinsics @ (rotation @ plane.positions.mean(axis=0) + matrix[:3, 3])
    center = np.array([(columns * alpha).sum(), (rows * alpha).sum()]) / alpha.sum()
    assert np.abs(center - seen[:2] / seen[2]).max() < 0.1
    with pytest.raises(UsageError, match="rotation"):
        Camera((64, 48), intrinsics, 2 * np.eye(4))
    with pytest.raises(UsageError, match="rotation"):
        Camera((64, 48), intrinsics, np.full((4, 4), np.nan))
    with pytest.raises(UsageError):
        Camera((0, 48), intrinsics, matrix)
    with pytest.raises(InputError, match=r"\(3, 3\)"):
        Camera((64, 48), np.eye(4), matrix)
    for row, column, value in [(0, 1, 2.0), (1, 0, 1.0), (2, 0, 0.1), (2, 2, 2.0)]:
        skewed = intrinsics.copy()
        skewed[row, column] = value
        with pytest.raises(UsageError, match="skew"):
            Camera((64, 48), skewed, matrix)
    for last in [[0, 0, 0, 2], [0, 0, 1, 0], [0.5, 0, 0, 1], [0, 0, 0, np.nan]]:
        with pytest.raises(UsageError, match="last row"):
            Camera((64, 48), intrinsics, np.vstack([matrix[:3], last]))


def test_a_renderer_draws_from_many_cameras(plane, tmp_path):
    renderer = surfelkit.Renderer(plane)
    assert len(renderer) == len(plane)
    cameras = [renderer.frame(size=32, direction=(np.sin(a), 0.2, np.cos(a))) for a in (0, 1, 2)]
    images = [renderer.render(camera) for camera in cameras]
    for camera, image in zip(cameras, images):
        assert np.array_equal(image.rgba, surfelkit.render(plane, camera).rgba)
    assert not np.array_equal(images[0].rgba, images[1].rgba)
    surfelkit.write(tmp_path / "plane.ply", plane)
    of_file = surfelkit.render(tmp_path / "plane.ply", cameras[0], threads=1)
    assert np.array_equal(of_file.rgba, images[0].rgba)
    framed = surfelkit.frame(plane, size=32, direction=(0, 0.2, 1))
    assert np.array_equal(framed.matrix, cameras[0].matrix)
    assert np.asarray(renderer.render()).shape == (512, 512, 4)


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"cutoff": 0}, "`cutoff` is 0"),
        ({"layers": 100}, "`layers`"),
        ({"filter": "box"}, "one of ewa, circular, none"),
        ({"background": (1, 1, 1)}, "`background`"),
        ({"lit": "yes"}, "`lit`"),
        ({"size": (0, 5)}, "size is 0x5"),
        ({"size": 10**9}, "size is"),
        ({"size": "large"}, "`size` is 'large'"),
        ({"fov": 180}, "`fov`"),
        ({"eye": (0, 0, 1), "target": (0, 0, 1)}, "coincide|same|eye"),
        ({"view": "front", "direction": (1, 0, 0)}, "view|direction"),
        ({"view": "sensor"}, "sensor"),
        ({"zoom": 0}, "`zoom`"),
    ],
)
def test_wrong_arguments_are_named(plane, arguments, message):
    with pytest.raises(UsageError, match=message):
        surfelkit.render(plane, **arguments)


def test_views_beside_cameras_are_refused(plane):
    camera = surfelkit.frame(plane, size=16)
    for arguments in ({"size": 32}, {"up": (0, 0, 1)}, {"frame_all": True}):
        with pytest.raises(UsageError, match="beside `camera`"):
            surfelkit.render(plane, camera, **arguments)
    with pytest.raises(InputError, match="variance"):
        surfelkit.render(surfelkit.SurfelCloud.from_arrays(np.random.rand(9, 3)))
    with pytest.raises(TypeError):
        surfelkit.render(3)


def test_scenes_light_surfels(plane, source, tmp_path):
    (tmp_path / "dark.toml").write_text("ambient = [0.5, 0.5, 0.5]\n[[light]]\ntype = 'headlight'\n"
                                        "direction = [0, 0, 1]\ncolor = [0, 0, 0]\n")
    camera = surfelkit.frame(plane, size=16, direction=(0, 0, 1))
    rgba = surfelkit.render(plane, camera, scene=tmp_path / "dark.toml").rgba
    assert np.allclose(rgba[8, 8, :3], [0, 0.5, 0], atol=1e-3)
    with pytest.raises(surfelkit.FileError, match="none.toml"):
        surfelkit.render(plane, camera, scene=tmp_path / "none.toml")


def test_gaussians_are_drawn(ball):
    count = 300
    cloud = surfelkit.GaussianCloud.from_arrays(
        ball[:count], np.full((count, 3), 0.2), np.tile([1.0, 0, 0, 0], (count, 1)),
        np.full(count, 0.9), np.full((count, 1, 3), 1.0)
    )
    image = surfelkit.render_gaussians(cloud, size=(48, 32), profile="exact", depth=True)
    assert image.rgba.shape == (32, 48, 4) and image.rgba[16, 24, 3] > 0.9
    assert np.isfinite(image["Z.mean"][16, 24]) and image.depth.shape == (32, 48)
    same = surfelkit.render_gaussians(cloud, surfelkit.frame(cloud, size=(48, 32)), profile="exact")
    assert np.array_equal(same.rgba, image.rgba)
    with pytest.raises(UsageError, match="unless `profile`"):
        surfelkit.render_gaussians(cloud, profile="inria", lowpass=1.0)
    with pytest.raises(UsageError, match="beside `camera`"):
        surfelkit.render_gaussians(cloud, image.camera, size=9)


def test_files_of_pictures(plane, tmp_path):
    image = surfelkit.render(plane, size=24, background=(0.2, 0.1, 0.4, 0.5), aovs=True)
    surfelkit.write(tmp_path / "a.png", image)
    codes = image.to_uint8()
    assert np.array_equal(surfelkit.read_image(tmp_path / "a.png").to_uint8(), codes)
    assert np.array_equal(Image(codes).to_uint8(), codes)
    grey = np.linspace(0, 1, 64, dtype=np.float32).reshape(8, 8)
    assert np.array_equal(Image(grey).rgba[:, :, 1], grey) and Image(grey).rgba.min(axis=2).max() == 1
    wide = Image(np.full((2, 2, 3), 65535, np.uint16))
    assert np.array_equal(wide.rgba, np.ones((2, 2, 4)))
    surfelkit.write(tmp_path / "rgb.png", codes[:, :, :3])
    assert np.array_equal(surfelkit.read(tmp_path / "rgb.png").to_uint8()[:, :, :3], codes[:, :, :3])
    for wrong in (np.zeros(3), np.zeros((2, 2, 2)), np.zeros((0, 4, 3)), np.zeros((2, 2, 3), int)):
        with pytest.raises(InputError):
            Image(wrong)
    with pytest.raises(UsageError, match="extension|written"):
        surfelkit.write(tmp_path / "a.xyzzy", image)
    with pytest.raises(surfelkit.FileError):
        surfelkit.write(tmp_path / "no folder" / "a.png", image)


def test_comparisons(plane):
    image = surfelkit.render(plane, size=24)
    equal = surfelkit.compare(image, np.asarray(image))
    assert equal.psnr == np.inf and equal.maximum == 0 and equal.pixels == 576
    black, grey = np.zeros((8, 8, 3), np.uint8), np.zeros((8, 8, 3), np.uint8)
    grey[2, 5, 1] = 51
    found = surfelkit.compare(grey, black)
    assert np.isclose(found.maximum, 0.2) and found.maximum_at == (2, 5, 1)
    assert np.isclose(found.rmse, 0.2 / np.sqrt(192)) and np.isclose(found.beyond, 1 / 64)
    assert np.isclose(found.psnr, -20 * np.log10(found.rmse))
    map_of_errors = surfelkit.difference(grey, black, scale=2).to_uint8()
    assert map_of_errors[2, 5, 1] == 102 and map_of_errors[0, 0, 1] == 0
    with pytest.raises(InputError, match="8"):
        surfelkit.compare(grey, image)
    with pytest.raises(UsageError, match="`threshold`"):
        surfelkit.compare(grey, black, threshold=2)
