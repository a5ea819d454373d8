#!/usr/bin/env python3
"""Writes the bodies of the held-out UAVs, assets/uavs/hframe.glb and quadplane.glb: convex pieces in plain colours.

Body axes are forward, left, up from the middle of the rotors [m]. What is held out is drawn by nothing else in the
program, so that no kit of parts is shared with the UAVs that networks learn from.
"""

import json
import math
import struct
import sys
from pathlib import Path

Point = tuple[float, float, float]
# Linear base colours.
FOAM, GREY, CARBON, DARK, TAPE, METAL = (0.62, 0.62, 0.6), (0.22, 0.22, 0.23), (0.035, 0.035, 0.038), (0.06, 0.065, 0.07), (0.5, 0.17, 0.03), (0.42, 0.42, 0.43)


class Body:
    """Triangles by colour, each facing out of its piece."""

    def __init__(self) -> None:
        self.triangles: dict[tuple, list[Point]] = {}

    def loft(self, rings: list[list[Point]], colour: tuple) -> None:
        """A solid through rings of as many points each, with flat ends."""
        for low, high in zip(rings, rings[1:]):
            sides = [[low[k], low[(k + 1) % len(low)], high[(k + 1) % len(low)], high[k]] for k in range(len(low))]
            ends = [ring for ring, end in ((low, rings[0]), (high, rings[-1])) if ring is end]
            self.piece(sides + ends, low + high, colour)

    def piece(self, faces: list[list[Point]], corners: list[Point], colour: tuple) -> None:
        """Faces of a convex part of a solid, which face away from the middle of its corners."""
        middle = tuple(sum(p[k] for p in corners) / len(corners) for k in range(3))
        for face in faces:
            for b, c in zip(face[1:], face[2:]):
                a = face[0]
                u, v = ([q[k] - a[k] for k in range(3)] for q in (b, c))
                n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
                out = sum(n[k] * (a[k] - middle[k]) for k in range(3)) > 0
                self.triangles.setdefault(colour, []).extend((a, b, c) if out else (a, c, b))

    def block(self, middle: Point, size: Point, colour: tuple) -> None:
        x, y, z = middle
        l, w, h = (s / 2 for s in size)
        ring = lambda dx: [(x + dx, y - w, z - h), (x + dx, y + w, z - h), (x + dx, y + w, z + h), (x + dx, y - w, z + h)]  # noqa: E731
        self.loft([ring(-l), ring(l)], colour)

    def tube(self, low: Point, high: Point, radii: tuple[float, float], colour: tuple, sides: int = 8) -> None:
        d = [b - a for a, b in zip(low, high)]
        length = math.hypot(*d)
        d = [x / length for x in d]
        e = (0.0, 0.0, 1.0) if abs(d[2]) < 0.9 else (1.0, 0.0, 0.0)
        u = [e[1] * d[2] - e[2] * d[1], e[2] * d[0] - e[0] * d[2], e[0] * d[1] - e[1] * d[0]]
        u = [x / math.hypot(*u) for x in u]
        v = [d[1] * u[2] - d[2] * u[1], d[2] * u[0] - d[0] * u[2], d[0] * u[1] - d[1] * u[0]]
        ring = lambda p, r: [tuple(p[k] + r * (math.cos(a) * u[k] + math.sin(a) * v[k]) for k in range(3)) for a in (2 * math.pi * n / sides for n in range(sides))]  # noqa: E731
        self.loft([ring(low, radii[0]), ring(high, radii[1])], colour)

    def hull(self, stations: list[tuple[float, float, float, float]], colour: tuple, sides: int = 10) -> None:
        """Ellipses along the body: x, half width, half height, z of the middle."""
        around = [2 * math.pi * (n + 0.5) / sides for n in range(sides)]
        self.loft([[(x, w * math.cos(a), z + h * math.sin(a)) for a in around] for x, w, h, z in stations], colour)

    def wing(self, root: Point, tip: Point, chords: tuple[float, float], thickness: float, colour: tuple, upright: bool = False) -> None:
        """A panel from root to tip: leading edge, thickest at a third, trailing edge. Points are at a third of the chord."""

        def ring(at: Point, chord: float) -> list[Point]:
            t = thickness * chord / 2
            section = ((chord / 3, 0.0), (0.0, t), (-2 * chord / 3, 0.0), (0.0, -t))
            return [(at[0] + x, at[1] + (s if upright else 0.0), at[2] + (0.0 if upright else s)) for x, s in section]

        self.loft([ring(root, chords[0]), ring(tip, chords[1])], colour)

    def size_m(self) -> list[float]:
        points = [p for triangles in self.triangles.values() for p in triangles]
        return [round(max(p[k] for p in points) - min(p[k] for p in points), 4) for k in range(3)]

    def glb(self) -> bytes:
        """glTF looks along +z with +y up: its x is left, y up, z forward."""
        blob, views, accessors, materials, primitives = b"", [], [], [], []
        for colour, points in self.triangles.items():
            data = b"".join(struct.pack("<3f", y, z, x) for x, y, z in points)
            turned = [(y, z, x) for x, y, z in points]
            views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(data)})
            low, high = ([f(p[k] for p in turned) for k in range(3)] for f in (min, max))
            accessors.append({"bufferView": len(views) - 1, "componentType": 5126, "count": len(points), "type": "VEC3", "min": low, "max": high})
            materials.append({"pbrMetallicRoughness": {"baseColorFactor": [*colour, 1.0], "metallicFactor": 0.0}})
            primitives.append({"attributes": {"POSITION": len(accessors) - 1}, "material": len(materials) - 1})
            blob += data
        root = {
            "asset": {"version": "2.0", "generator": "boresight scripts/uav_bodies.py"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": primitives}], "materials": materials, "accessors": accessors, "bufferViews": views,
            "buffers": [{"byteLength": len(blob)}],
        }  # fmt: skip
        text = json.dumps(root, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<2I", len(text), 0x4E4F534A) + text + struct.pack("<2I", len(blob), 0x004E4942) + blob
        return struct.pack("<3I", 0x46546C67, 2, 12 + len(chunks)) + chunks


FOUR = [(1, 1), (-1, 1), (-1, -1), (1, -1)]


def motor(body: Body, hub: Point, radius: float) -> None:
    x, y, z = hub
    body.tube((x, y, z - 0.034), (x, y, z - 0.016), (radius, radius), DARK)
    body.tube((x, y, z - 0.016), (x, y, z - 0.002), (radius, 0.85 * radius), METAL)


def hframe() -> tuple[Body, list[Point]]:
    """A self-built H: two tubes across, a box between them, a load below."""
    body, hubs = Body(), [(0.20 * sx, 0.24 * sy, 0.035) for sx, sy in FOUR]
    for sx in (1, -1):
        body.block((0.20 * sx, 0.0, 0.0), (0.026, 0.51, 0.022), CARBON)
    for sy in (1, -1):
        body.block((0.0, 0.045 * sy, 0.0), (0.40, 0.02, 0.02), CARBON)
        body.tube((0.12, 0.06 * sy, -0.01), (0.13, 0.15 * sy, -0.19), (0.007, 0.006), CARBON, 6)
        body.tube((-0.12, 0.06 * sy, -0.01), (-0.13, 0.15 * sy, -0.19), (0.007, 0.006), CARBON, 6)
        body.tube((-0.19, 0.15 * sy, -0.19), (0.19, 0.15 * sy, -0.19), (0.009, 0.009), CARBON, 6)
    body.block((0.0, 0.0, 0.035), (0.26, 0.11, 0.05), GREY)
    body.block((-0.015, 0.0, 0.078), (0.17, 0.07, 0.036), TAPE)
    body.tube((0.10, 0.0, 0.06), (0.10, 0.0, 0.13), (0.005, 0.005), DARK, 6)
    body.tube((0.10, 0.0, 0.13), (0.10, 0.0, 0.145), (0.03, 0.026), DARK, 10)
    body.hull([(-0.14, 0.012, 0.012, -0.065), (-0.10, 0.036, 0.036, -0.065), (0.08, 0.036, 0.036, -0.065), (0.14, 0.008, 0.008, -0.065)], DARK)
    body.block((0.215, 0.0, -0.03), (0.05, 0.05, 0.045), DARK)
    for hub in hubs:
        motor(body, hub, 0.021)
    return body, hubs


def quadplane() -> tuple[Body, list[Point]]:
    """A small fixed-wing body that four rotors on two booms lift."""
    body, hubs = Body(), [(0.2475 * sx, 0.2475 * sy, 0.05) for sx, sy in FOUR]
    body.hull([
        (-0.34, 0.018, 0.022, 0.02), (-0.20, 0.05, 0.055, 0.01), (0.08, 0.062, 0.07, 0.0), (0.26, 0.055, 0.06, -0.005),
        (0.36, 0.035, 0.036, -0.012), (0.40, 0.012, 0.012, -0.018),
    ], FOAM)  # fmt: skip
    body.hull([(0.06, 0.03, 0.012, 0.066), (0.14, 0.042, 0.03, 0.06), (0.24, 0.03, 0.012, 0.05)], DARK)
    for sy in (1, -1):
        body.wing((0.0, 0.03 * sy, 0.045), (-0.03, 0.65 * sy, 0.075), (0.21, 0.13), 0.12, FOAM)
        body.wing((-0.032, 0.56 * sy, 0.0705), (-0.033, 0.655 * sy, 0.0752), (0.146, 0.134), 0.13, TAPE)
        body.tube((-0.58, 0.2475 * sy, 0.012), (0.30, 0.2475 * sy, 0.012), (0.011, 0.011), CARBON)
        body.wing((-0.53, 0.2475 * sy, 0.012), (-0.57, 0.2475 * sy, 0.165), (0.13, 0.085), 0.1, FOAM, upright=True)
        body.tube((0.05, 0.035 * sy, -0.05), (0.06, 0.11 * sy, -0.125), (0.006, 0.006), CARBON, 6)
        body.tube((-0.10, 0.11 * sy, -0.125), (0.16, 0.11 * sy, -0.125), (0.007, 0.007), CARBON, 6)
    body.wing((-0.565, -0.2475, 0.155), (-0.565, 0.2475, 0.155), (0.1, 0.1), 0.1, FOAM)
    body.tube((-0.365, 0.0, 0.02), (-0.335, 0.0, 0.02), (0.02, 0.02), METAL)
    body.hull([(0.20, 0.012, 0.012, -0.075), (0.225, 0.032, 0.032, -0.08), (0.26, 0.03, 0.03, -0.08), (0.28, 0.01, 0.01, -0.08)], DARK, 8)
    for hub in hubs:
        motor(body, hub, 0.017)
    return body, hubs


def main() -> None:
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1] / "assets/uavs"
    for made in (hframe, quadplane):
        body, hubs = made()
        (out / f"{made.__name__}.glb").write_bytes(body.glb())
        count = sum(len(points) for points in body.triangles.values()) // 3
        print(f"{made.__name__}: size_m = {body.size_m()}, {count} triangles, hubs_body_m = {[list(hub) for hub in hubs]}")


if __name__ == "__main__":
    main()
