"""Estimation, sampling and textures; interruptions, threads, progress; values of any kind."""

import _thread
import threading
import time

import numpy as np
import pytest
import surfelkit
from surfelkit import InputError, SurfelCloud, UsageError


@pytest.fixture(scope="module")
def many():
    """Points whose estimation takes long enough to be interrupted."""
    return SurfelCloud.from_arrays(np.random.default_rng(3).random((100000, 3), np.float32))


def test_normals_and_sizes_of_a_sphere(ball):
    cloud = SurfelCloud.from_arrays(ball, colors=np.full((len(ball), 3), 99, np.uint8))
    cloud.columns["mark"] = np.arange(len(ball), dtype=np.uint32)
    report = {"mine": 1}
    surfels = surfelkit.estimate(cloud, report=report)
    cosine = np.sum(surfels.normals * ball, axis=1)
    assert len(surfels) == len(ball) and cosine.min() > 0.9
    assert abs(surfels.area.sum() / (4 * np.pi) - 1) < 0.1
    assert np.array_equal(surfels.columns["mark"], cloud.columns["mark"])
    assert surfels.columns["confidence"].dtype == np.float32
    assert report["points"] == len(ball) and report["orient"] == "winding" and report["mine"] == 1
    assert cloud.normals is None


def test_points_that_are_not_finite_are_left_out(ball):
    ball[7] = np.nan
    ball[9, 1] = np.inf
    report = {}
    surfels = surfelkit.estimate(SurfelCloud.from_arrays(ball), report=report)
    assert len(surfels) == len(ball) - 2 and report["nonfinite"] == 2
    assert np.isfinite(surfels.positions).all() and np.isfinite(surfels.normals).all()
    with pytest.raises(InputError, match="finite"):
        surfelkit.estimate(SurfelCloud.from_arrays(np.full((5, 3), np.nan)))
    with pytest.raises(InputError):
        surfelkit.estimate(SurfelCloud())


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"k": 2}, "`k` is 2"),
        ({"k": 2.5}, "`k` is 2.5; it must be of the type int"),
        ({"k": "many"}, "type int"),
        ({"cutoff": float("nan")}, "`cutoff`"),
        ({"orient": "sideways"}, "one of auto, winding"),
        ({"orient": 3}, "one of auto"),
        ({"orient": "viewpoint"}, "viewpoint"),
        ({"viewpoint": (1, 2)}, "`viewpoint` is"),
        ({"crease_angle": 45}, "no effect without `clip`"),
        ({"smooth_order": 4}, "no effect without `smooth`"),
        ({"remove_outliers": True, "outlier_neighbors": 0}, "`outlier_neighbors`"),
        ({"smooth": True, "smooth_spacings": 99}, "`smooth_spacings`"),
        ({"voxel": -1}, "`voxel`"),
        ({"threads": 0}, "`threads` is 0"),
    ],
)
def test_wrong_arguments_are_named(ball, arguments, message):
    with pytest.raises(UsageError, match=message):
        surfelkit.estimate(SurfelCloud.from_arrays(ball[:100]), **arguments)


def test_threads_do_not_change_the_result(ball):
    cloud = SurfelCloud.from_arrays(ball)
    before = surfelkit.thread_count()
    one, four = (surfelkit.estimate(cloud, threads=threads) for threads in (1, 4))
    assert surfelkit.thread_count() == before
    assert all(one.columns[n].tobytes() == four.columns[n].tobytes() for n in one.columns)
    surfelkit.set_thread_count(3)
    assert surfelkit.thread_count() == 3
    surfelkit.set_thread_count(None)
    with pytest.raises(UsageError):
        surfelkit.set_thread_count(5000)


def test_progress_is_told(ball):
    told = []
    surfelkit.estimate(SurfelCloud.from_arrays(ball), progress=lambda *news: told.append(news))
    assert {"estimating normals", "sizing splats"} <= {name for name, share in told}
    assert all(0 <= share <= 1 for name, share in told)


def test_a_callback_that_raises_ends_the_work(many):
    def fail(name, share):
        raise LookupError(name)

    begin = time.monotonic()
    with pytest.raises(LookupError):
        surfelkit.estimate(many, progress=fail)
    assert time.monotonic() - begin < 60
    with pytest.raises(TypeError):
        surfelkit.estimate(many[:1000], progress=3)


def test_interrupts_end_the_work_and_leave_the_next_whole(many, ball):
    for _ in range(2):
        timer = threading.Timer(0.1, _thread.interrupt_main)
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            for _ in range(1000):
                surfelkit.estimate(many)
        timer.join()
    assert len(surfelkit.estimate(SurfelCloud.from_arrays(ball))) == len(ball)


def test_other_threads_run_meanwhile_and_may_not_change_columns(many):
    many = many[:30000]
    refused = []
    done = threading.Event()

    def disturb():
        while not done.is_set() and not refused:
            try:
                many.alpha = np.ones(len(many))
                many.alpha = None
            except RuntimeError as error:
                refused.append(str(error))

    thread = threading.Thread(target=disturb)
    thread.start()
    for _ in range(100):
        surfelkit.estimate(many, k=8)
        if refused:
            break
    done.set()
    thread.join()
    many.alpha = None
    assert refused and "in use" in refused[0]


def test_samples_cover_a_mesh(quad):
    report = {}
    surfels = surfelkit.sample(quad, count=500, report=report)
    assert len(surfels) == 500 and np.isclose(surfels.area.sum(), 1, atol=1e-3)
    assert np.isclose(report["area"], 1) and report["components"] == 1
    assert np.allclose(surfels.uv, surfels.positions[:, :2], atol=1e-6)
    assert np.array_equal(surfels.positions, surfelkit.sample(quad, count=500).positions)
    assert not np.array_equal(surfels.positions, surfelkit.sample(quad, count=500, seed=2).positions)
    for arguments in ({}, {"count": 0}, {"spacing": -1}, {"spacing": 1, "count": 5}):
        with pytest.raises(UsageError):
            surfelkit.sample(quad, **arguments)
    with pytest.raises(TypeError):
        surfelkit.sample("quad.obj", count=5)


def test_textures_come_from_files_names_and_arrays(quad, tmp_path):
    surfels = surfelkit.sample(quad, count=800)
    codes = np.zeros((32, 32, 3), np.uint8)
    codes[16:, :, 0] = 255  # The lower half, where v is small, is red.
    from_array = surfelkit.fit_texture(surfels, codes, quad)
    assert surfels.coefficients is None
    # The image repeats, so that its other half begins at the border.
    v = from_array.uv[:, 1]
    assert from_array.coefficients[(v > 0.1) & (v < 0.4), 0].min() > 0.99
    assert from_array.coefficients[(v > 0.6) & (v < 0.9), 0].max() < 0.01
    surfelkit.write(tmp_path / "half.png", codes)
    image = surfelkit.read_image(tmp_path / "half.png")
    for other in (tmp_path / "half.png", image):
        same = surfelkit.fit_texture(surfels, other, quad).coefficients
        assert np.allclose(same, from_array.coefficients, atol=1e-6)
    report = {}
    sharper = surfelkit.fit_texture(surfels, "checker:4", fit="render", cutoff=2, report=report)
    assert report["converged"] and report["error"] < report["error_ewa"]
    located = surfels.copy()
    located.uv = located.dpdu = located.dpdv = None
    again = surfelkit.fit_texture(located, codes, quad).coefficients
    assert np.allclose(again, from_array.coefficients, atol=1e-3)
    fitted = surfelkit.fit_colors(sharper, cutoff=2)
    assert fitted.coefficients.shape == (800, 3)


def test_wrong_textures_are_refused(quad, plane, tmp_path):
    surfels = surfelkit.sample(quad, count=50)
    texture = np.eye(8, dtype=np.float32)
    with pytest.raises(UsageError, match="neither"):
        surfelkit.fit_texture(surfels)
    with pytest.raises(surfelkit.FileError, match="none.png"):
        surfelkit.fit_texture(surfels, tmp_path / "none.png")
    with pytest.raises(InputError, match=r"\(5,\)"):
        surfelkit.fit_texture(surfels, np.zeros(5))
    with pytest.raises(UsageError, match="if `fit` is 'ewa'"):
        surfelkit.fit_texture(surfels, texture, lambda_=1.0)
    with pytest.raises(UsageError, match="`lambda_`"):
        surfelkit.fit_texture(surfels, texture, fit="render", lambda_=-1.0)
    surfels.positions[:, 2] += 50
    with pytest.raises(InputError, match="lies on the mesh"):
        surfelkit.fit_texture(surfels, texture, quad)
    with pytest.raises(InputError):
        surfelkit.fit_texture(plane, texture)  # No texture coordinates.


def test_no_values_crash(quad, tmp_path):
    """Whatever views leave in arrays gives a result or an error."""
    random = np.random.default_rng(4)
    kinds = [np.nan, np.inf, -np.inf, 3e38, -3e38, 1e-45, 0.0]
    texture = np.eye(16, dtype=np.float32)
    whole = surfelkit.fit_texture(surfelkit.sample(quad, count=120), texture)
    whole.alpha = np.ones(len(whole))
    whole.tangents = np.tile([1, 0, 0], (len(whole), 1))
    whole.variance_u = whole.variance_v = whole.variance
    whole.clip1 = whole.tangents
    whole.clip1_distance = np.zeros(len(whole))
    for name in ("material", "group", "source", "level"):
        setattr(whole, name, np.zeros(len(whole), int))
    outcomes = set()
    works = [
        lambda c: surfelkit.estimate(c, k=8),
        lambda c: surfelkit.render(c, size=24, aovs=True),
        lambda c: surfelkit.fit_texture(c, texture),
        lambda c: surfelkit.fit_colors(c, fit="gram"),
        lambda c: surfelkit.write(tmp_path / "any.ply", c),
        lambda c: c.bounds(),
    ]
    for turn in range(360):
        cloud = whole.copy()
        for name in list(cloud.columns):
            if random.random() < 0.2:
                column = cloud.columns[name]
                chosen = random.random(len(column)) < random.choice([0.05, 1.0])
                if column.dtype.kind == "f":
                    column[chosen] = random.choice(kinds)
                else:
                    column[chosen] = random.integers(0, np.iinfo(column.dtype).max)
        try:
            works[turn % len(works)](cloud)
            outcomes.add("result")
        except surfelkit.Error as error:
            assert str(error)
            outcomes.add("error")
    assert outcomes == {"result", "error"}
