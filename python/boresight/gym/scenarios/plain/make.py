"""Writes the plain that the environments fly over: a square of grass, and its heights, so that a run opens at once.

    python3 make.py
"""

import base64
import json
import math
import struct
from pathlib import Path

#: Half of the square's side [m].
HALF_M = 4000.0
#: Albedo of grass, linear red, green, blue.
GRASS = [0.06, 0.09, 0.03, 1.0]
#: The site of the scenarios beside this folder.
LATITUDE_DEG, LONGITUDE_DEG, ALTITUDE_M = 47.3769, 8.5417, 455.0
#: Cells of the rasters to a side, and their length [m].
CELLS, CELL_M = 4, HALF_M / 2


def mesh() -> bytes:
    """Two triangles as binary glTF, z up."""
    h = HALF_M
    corners = [(-h, -h, 0.0), (h, -h, 0.0), (h, h, 0.0), (-h, h, 0.0)]
    data = b"".join(struct.pack("<3f", *corner) for corner in corners)
    data += 4 * struct.pack("<3f", 0.0, 0.0, 1.0)
    data += struct.pack("<6H", 0, 1, 2, 0, 2, 3)
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": 1}, "indices": 2, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": GRASS, "metallicFactor": 0, "roughnessFactor": 1}}],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 48},
            {"buffer": 0, "byteOffset": 96, "byteLength": 12},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-h, -h, 0], "max": [h, h, 0]},
            {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
    }
    text = json.dumps(tree, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def tileset() -> bytes:
    """One tile, its mesh within the file."""
    h = HALF_M
    tree = {
        "asset": {"version": "1.1", "gltfUpAxis": "Z"},
        "geometricError": 1000,
        "root": {
            "boundingVolume": {"box": [0, 0, 0, h, 0, 0, 0, h, 0, 0, 0, 1]},
            "geometricError": 0,
            "refine": "REPLACE",
            "content": {"uri": "data:model/gltf-binary;base64," + base64.b64encode(mesh()).decode()},
        },
    }
    return json.dumps(tree, indent=1).encode() + b"\n"


def heights() -> bytes:
    """The file of heights that the program reads beside a tileset: bare, level ground at the site's height."""
    frame = f"origin_e_m = {-HALF_M}\norigin_n_m = {-HALF_M}\ncell_m = {CELL_M}\nnx = {CELLS}\nny = {CELLS}\n"
    head = (
        f"[site]\nlatitude_rad = {math.radians(LATITUDE_DEG)!r}\nlongitude_rad = {math.radians(LONGITUDE_DEG)!r}\n"
        f"height_m = {ALTITUDE_M}\n\n[terrain]\n{frame}\n[surface]\n{frame}\n"
        "[city]\nstation_enu_m = [0.0, 0.0, 48.0]\nmean_height_m = 0.0\noutside_m = 0.0\ntriangles_beyond = 0\nbuildings = []\n"
    ).encode()
    level = struct.pack(f"<{2 * CELLS * CELLS}f", *([0.0] * (2 * CELLS * CELLS)))
    return b"boresight heights 2\n" + struct.pack("<I", len(head)) + head + level


if __name__ == "__main__":
    folder = Path(__file__).parent
    (folder / "tileset.json").write_bytes(tileset())
    (folder / "heights.bin").write_bytes(heights())
