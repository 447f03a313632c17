"""The package says what it has: types, descriptions, defaults, and the page docs/python.md."""

import ast
import inspect
import os
import pathlib
import re
import runpy

import pytest
import surfelkit
from surfelkit import _core


def stub():
    path = pathlib.Path(surfelkit.__file__).with_name("_core.pyi")
    return ast.parse(path.read_text()).body


def names_of(body):
    """Names that statements of a stub declare."""
    names = set()
    for node in body:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            names.add(node.name)
        elif isinstance(node, ast.AnnAssign):
            names.add(node.target.id)
    return names


def members_of(thing):
    """Names that a module or a class of the module has, without what all have."""
    common = set(dir(object)) | {"__module__", "__doc__", "__weakref__"}
    return {name for name in vars(thing) if name not in common and "pybind11" not in name}


def test_the_stub_has_the_names_of_the_module():
    own = {"__name__", "__package__", "__loader__", "__spec__", "__file__"}
    types_alone = {"_Column"}
    assert names_of(stub()) - types_alone == members_of(_core) - own
    for node in stub():
        if not isinstance(node, ast.ClassDef) or node.name in types_alone:
            continue
        if not issubclass(getattr(_core, node.name), Exception):
            assert names_of(node.body) - {"__init__"} == members_of(getattr(_core, node.name)), (
                node.name
            )


def test_everything_public_is_described():
    assert pathlib.Path(surfelkit.__file__).with_name("py.typed").exists()
    for name in surfelkit.__all__:
        thing = getattr(surfelkit, name)
        assert name == "__version__" or inspect.getdoc(thing), name
        if inspect.isclass(thing) and not issubclass(thing, Exception):
            for member, value in vars(thing).items():
                if not member.startswith("_") and not isinstance(value, staticmethod):
                    assert inspect.getdoc(value), f"{name}.{member}"


FUNCTIONS = [getattr(surfelkit, name) for name in surfelkit.__all__
             if inspect.isfunction(getattr(surfelkit, name))] + [surfelkit.Renderer]


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda f: f.__name__)
def test_every_argument_is_typed_and_described(function):
    text = inspect.getdoc(function)
    # What several functions have is described by one, which the others name.
    for other in re.findall(r"(\w+)(?:\(\)| has them)", text):
        text += inspect.getdoc(getattr(surfelkit, other, None)) or ""
    for name, parameter in inspect.signature(function).parameters.items():
        assert parameter.annotation is not inspect.Parameter.empty, name
        plain = name in ("path", "cloud", "mesh", "data")
        assert plain or re.search(rf"\b{name}\b", text), name


def test_defaults_are_the_librarys():
    for function, defaults in (
        (surfelkit.estimate, _core.estimate_defaults()),
        (surfelkit.sample, _core.sample_defaults()),
        (surfelkit.fit_texture, _core.fit_defaults()),
        (surfelkit.frame, _core.view_defaults()),
        (surfelkit.render, {**_core.view_defaults(), **_core.render_defaults()}),
        (surfelkit.render_gaussians, {**_core.view_defaults(), **_core.gaussian_defaults()}),
        (surfelkit.compare, _core.compare_defaults()),
    ):
        parameters = inspect.signature(function).parameters
        own = {"cloud", "mesh", "image", "source", "camera", "scene", "tested", "truth", "report",
               "progress", "threads"}
        assert set(parameters) - own == set(defaults), function.__name__
        for name, value in defaults.items():
            default = parameters[name].default
            assert default == (tuple(value) if isinstance(value, list) else value), name


def test_the_page_runs(source, tmp_path, monkeypatch):
    """The blocks of README.md and docs/python.md, one after another, beside the samples."""
    monkeypatch.chdir(tmp_path)
    os.symlink(source / "samples", "samples")
    section = (source / "README.md").read_text().split("\n## Python\n")[1].split("\n## ")[0]
    blocks = ["\n".join(re.findall(r"^    (.*)$", section, re.M))]
    page = (source / "docs/python.md").read_text()
    blocks += re.findall(r"^```python\n(.*?)^```", page, re.M | re.S)
    assert len(blocks) >= 7 and "import surfelkit" in blocks[0]
    space = {}
    for block in blocks:
        exec(compile(block, "a block", "exec"), space)
    for name in re.findall(r'surfelkit\.write\("([^"]+)"', "".join(blocks)):
        assert pathlib.Path(name).stat().st_size > 0, name


def test_the_example_runs(source, tmp_path, monkeypatch):
    monkeypatch.setattr("sys.argv", ["scan.py", str(source / "samples/milk.ply"), "scan.png"])
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(source / "examples/python/scan.py"), run_name="__main__")
    assert surfelkit.read_image("scan.png").rgba.shape == (480, 640, 4)


def test_names_of_files_reach_the_system_whole(plane, tmp_path):
    surfelkit.write(tmp_path / "a.ply", plane)
    cut = str(tmp_path / "a.ply") + "\0.ply"
    for use in [
        lambda: surfelkit.read(cut),
        lambda: surfelkit.read_points(cut),
        lambda: surfelkit.read_mesh(cut),
        lambda: surfelkit.read_gaussians(cut),
        lambda: surfelkit.read_image(cut),
        lambda: surfelkit.write(cut, plane),
        lambda: surfelkit.Renderer(cut),
        lambda: surfelkit.Renderer(plane, scene=cut),
        lambda: surfelkit.fit_texture(plane, cut),
    ]:
        with pytest.raises(ValueError, match="NUL"):
            use()


def test_errors_have_the_names_of_files_that_are_no_utf8():
    with pytest.raises(surfelkit.FileError, match="\udcff.ply: "):
        surfelkit.read("\udcff.ply")


def test_objects_without_a_value_are_refused():
    kinds = [kind for kind in vars(surfelkit._core).values() if isinstance(kind, type)]
    kinds = [kind for kind in kinds if not issubclass(kind, Exception)]
    assert len(kinds) >= 6
    for kind in kinds:
        empty = kind.__new__(kind)
        for name in dir(kind):
            if isinstance(vars(kind).get(name), property):
                with pytest.raises((TypeError, RuntimeError)):
                    repr(getattr(empty, name))
        for name in {"__len__", "__repr__"} & set(vars(kind)):
            with pytest.raises((TypeError, RuntimeError)):
                getattr(kind, name)(empty)
