"""A Python environment of its own for each script here, made on the first call."""

import os
import pathlib
import subprocess
import sys
import venv

HERE = pathlib.Path(__file__).resolve().parent
CACHE = pathlib.Path(os.environ.get("XDG_CACHE_HOME") or pathlib.Path.home() / ".cache") / "boresight"


def continue_in(name, requirements):
    """Runs the calling script again, with `--inside`, in the venv `name` that has the pinned packages."""
    folder = CACHE / name
    python = folder / "bin" / "python"
    wanted = (HERE / requirements).read_text()
    stamp = folder / "requirements.txt"
    if not stamp.is_file() or stamp.read_text() != wanted:
        print(f"peers: installing {requirements} into {folder}", file=sys.stderr, flush=True)
        venv.create(folder, with_pip=True, clear=True)
        pip = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        subprocess.run([*pip, "-r", HERE / requirements], check=True)
        stamp.write_text(wanted)
    os.execv(python, [str(python), os.path.abspath(sys.argv[0]), "--inside", *sys.argv[1:]])
