"""Puts small files into a corpus: those of the tests, and the real ones beside the repository where they are at hand."""

import hashlib
import pathlib
import struct
import sys

ENDINGS = {
    "content": ("b3dm", "i3dm", "pnts", "cmpt", "glb", "gltf"),
    "glb": ("glb", "b3dm", "i3dm", "gltf"),
    "tileset": ("json",),
    "subtree": ("subtree",),
    "cityjson": ("city.json", "city.jsonl"),
    "geotiff": ("tif", "tiff"),
    "lockstep": ("messages",),
    "airsim": ("messages",),
}
LARGEST = 60_000  # [byte]


def parts(data):
    """A model's JSON, a zero and its binary part: what the target `glb` puts a container around."""
    at = data.find(b"glTF")
    if at < 0 or len(data) < at + 20:
        return data.lstrip().startswith(b"{") and data + b"\0"
    (length,) = struct.unpack_from("<I", data, at + 12)
    return data[at + 20 : at + 20 + length].rstrip() + b"\0" + data[at + 28 + length :]


target, corpus = sys.argv[1], pathlib.Path(sys.argv[2])
repository = pathlib.Path(__file__).resolve().parent.parent
folders = [repository / "tests" / "data", repository / "fuzz" / "seeds" / target]
folders += [repository.parent / "shared" / "data" / name for name in ("tiles", "cityjson", "dem")]
for folder in folders:
    own = folder.name == target
    for path in sorted(folder.rglob("*")):
        if not path.is_file() or path.stat().st_size > LARGEST:
            continue
        if not own and not path.name.endswith(ENDINGS[target]):
            continue
        data = path.read_bytes()
        if target == "glb" and not own:
            data = parts(data)
        if data and len(data) <= LARGEST:
            (corpus / hashlib.sha1(data).hexdigest()).write_bytes(data)
