"""Where the program's data and ONNX Runtime's library lie; said to the program before it starts."""

from __future__ import annotations

import importlib.util
import os
import tempfile
from pathlib import Path


def tell() -> None:
    """Names the folder of the data, the library and a folder for the driver, unless the environment names others."""
    folder = Path(__file__).parent / "data"
    if folder.is_dir():
        os.environ.setdefault("BORESIGHT_DATA", str(folder))
    if "ORT_DYLIB_PATH" not in os.environ:
        found = library()
        if found is not None:
            os.environ["ORT_DYLIB_PATH"] = str(found)
    # Mesa complains on standard error where a session has none, as in a container.
    os.environ.setdefault("XDG_RUNTIME_DIR", tempfile.gettempdir())


def scenarios() -> Path:
    """The folder of the shipped scenarios."""
    return Path(os.environ.get("BORESIGHT_DATA", Path(__file__).parent / "data")) / "scenarios"


def library() -> Path | None:
    """ONNX Runtime's library in its wheel; the wheel is not imported for it."""
    spec = importlib.util.find_spec("onnxruntime")
    if spec is None or spec.origin is None:
        return None
    folder = Path(spec.origin).parent / "capi"
    return next(iter(sorted(folder.glob("libonnxruntime.so*"))), None)
