"""Types of arguments, and how they reach the library."""

from __future__ import annotations

import os
from typing import Any, Callable, Optional, Sequence, Union

import numpy as np
from numpy.typing import NDArray

from . import _core

Path = Union[str, "os.PathLike[str]"]
Array = NDArray[Any]
Vector = Union[Sequence[float], Array]
Size = Union[int, Sequence[int]]
Progress = Optional[Callable[[str, float], None]]


def name_of(path: Path) -> bytes:
    """The name of a file as the system has it. Raises UsageError for a NUL, which would cut it."""
    name = os.fsencode(path)
    if b"\0" in name:
        raise _core.UsageError(f"{os.fspath(path)!r} holds a NUL, which no name of a file has")
    return name


def options_of(arguments: dict[str, Any], names: dict[str, Any]) -> dict[str, Any]:
    """The arguments of a function that are options of the library."""
    options = {name: arguments[name] for name in names}
    if isinstance(options.get("size"), (int, np.integer)):
        options["size"] = [options["size"]] * 2
    return options
