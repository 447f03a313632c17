"""Files have the bytes that the tools give them."""

import os
import pathlib
import subprocess

import numpy as np
import surfelkit


def run(tool, *arguments):
    subprocess.run(
        [pathlib.Path(os.environ["SURFEL_TOOL_DIR"]) / tool, "--quiet", *map(str, arguments)],
        check=True,
    )


def assert_same(cloud, file, tmp_path):
    """Writes a cloud, with the line that tools say of themselves, and compares."""
    cloud.provenance = surfelkit.read(file).provenance
    surfelkit.write(tmp_path / "python.ply", cloud)
    assert (tmp_path / "python.ply").read_bytes() == file.read_bytes()


def test_estimates(source, tmp_path):
    milk = source / "samples/milk.ply"
    out = tmp_path / "tool.ply"
    points = surfelkit.read(milk)
    run("surfel-estimate", milk, "-o", out)
    assert_same(surfelkit.estimate(points), out, tmp_path)
    options = "--orient viewpoint --viewpoint 0,0,0 --clip --crease-angle 40 --anisotropy on"
    run("surfel-estimate", milk, "-k", "20", *options.split(), "-o", out)
    surfels = surfelkit.estimate(
        points, k=20, orient="viewpoint", viewpoint=(0, 0, 0), clip=True, crease_angle=40,
        anisotropy="on"
    )
    assert_same(surfels, out, tmp_path)


def test_samples_and_textures(source, tmp_path):
    spot, image = source / "samples/spot.obj", source / "samples/spot.png"
    out, textured = tmp_path / "tool.ply", tmp_path / "textured.ply"
    run("surfel-from-mesh", spot, "--count", "3000", "-o", out)
    mesh = surfelkit.read(spot)
    surfels = surfelkit.sample(mesh, count=3000)
    assert_same(surfels, out, tmp_path)
    for fit, more in (("ewa", {}), ("render", {"cutoff": 2})):
        options = [word for name, value in more.items() for word in (f"--{name}", str(value))]
        run("surfel-texture", out, "--mesh", spot, "--image", image, "--fit", fit, *options,
            "-o", textured)
        assert_same(surfelkit.fit_texture(surfels, image, mesh, fit=fit, **more), textured, tmp_path)


def test_pictures(source, tmp_path):
    spot = surfelkit.read(source / "samples/spot.obj")
    surfels = surfelkit.sample(spot, count=3000)
    textured = surfelkit.fit_texture(surfels, source / "samples/spot.png", spot)
    scan = surfelkit.estimate(surfelkit.read(source / "samples/milk.ply"))
    cases = [
        (surfels, "", {}),  # Without colours: relief.
        (textured, "--from 0.6,0.3,-1 --cutoff 2", {"direction": (0.6, 0.3, -1), "cutoff": 2}),
        (textured, "--view back --background 0,0,1,1 --ortho 2.5 --kernel affine",
         {"view": "back", "background": (0, 0, 1, 1), "ortho": 2.5, "kernel": "affine"}),
        (scan, "--up 0,-1,0 --zoom 1.5 --shading phong",
         {"up": (0, -1, 0), "zoom": 1.5, "lit": True}),
        (scan, "", {}),  # Recorded light.
    ]
    written = tmp_path / "surfels.ply"
    for cloud, options, arguments in cases:
        surfelkit.write(written, cloud)
        image = surfelkit.render(written, size=(96, 64), aovs=True, **arguments)
        in_memory = surfelkit.render(cloud, size=(96, 64), aovs=True, **arguments)
        assert np.array_equal(image.data, in_memory.data, equal_nan=True)
        for name in ("tool.exr", "tool.png") if cloud is surfels else ("tool.exr",):
            tool = ["surfel-render", written, "--size", "96x64", *options.split()]
            run(*tool, "-o", tmp_path / name)
            made = tmp_path / f"python{pathlib.Path(name).suffix}"
            surfelkit.write(made, image, metadata={"Software": "surfel-render"})
            assert made.read_bytes() == (tmp_path / name).read_bytes(), (options, name)


def test_pictures_of_gaussians(ball, tmp_path):
    count = 500
    splats = surfelkit.GaussianCloud.from_arrays(
        ball[:count], np.full((count, 3), 0.1), np.tile([1.0, 0, 0, 0], (count, 1)),
        np.full(count, 0.7), np.random.default_rng(5).normal(size=(count, 1, 3))
    )
    surfelkit.write(tmp_path / "splats.ply", splats)
    for options, arguments in (("", {}), ("--profile exact --from 1,0,1 --fov 50",
                                          {"profile": "exact", "direction": (1, 0, 1), "fov": 50})):
        run("surfel-render", tmp_path / "splats.ply", "--size", "64x48", *options.split(), "-o",
            tmp_path / "tool.png")
        image = surfelkit.render_gaussians(
            surfelkit.read(tmp_path / "splats.ply"), size=(64, 48), **arguments
        )
        profile = arguments.get("profile", "inria")
        surfelkit.write(tmp_path / "python.png", image,
                        metadata={"Software": "surfel-render", "Profile": profile})
        assert (tmp_path / "python.png").read_bytes() == (tmp_path / "tool.png").read_bytes()
