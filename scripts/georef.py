"""Holds a parameter file of `boresight georef` to PROJ and to a fit of its own (Umeyama's closed form by numpy): the surveyed
points are brought to ECEF by pyproj, the model's points by PROJ's Helmert transformation with the fitted parameters.

    python3 -m venv venv && venv/bin/pip install pyproj==3.7.2 numpy
    boresight georef tests/data/control-points.csv --crs EPSG:28992+ellipsoid --out params.toml
    venv/bin/python scripts/georef.py tests/data/control-points.csv 28992 params.toml
"""

import csv
import sys
import tomllib

import numpy as np
from projections import strings
from pyproj import Transformer, __version__, proj_version_str


def umeyama(local: np.ndarray, earth: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Scale, rotation and translation of the least squares fit."""
    a, b = local - local.mean(0), earth - earth.mean(0)
    u, s, vt = np.linalg.svd(b.T @ a)
    flip = np.diag([1.0, 1.0, np.linalg.det(u) * np.linalg.det(vt)])
    rotation = u @ flip @ vt
    scale = np.trace(np.diag(s) @ flip) / (a**2).sum()
    return scale, rotation, earth.mean(0) - scale * rotation @ local.mean(0)


def rotation_matrix(vector: np.ndarray) -> np.ndarray:
    """The rotation about a vector by its length (Rodrigues)."""
    angle = np.linalg.norm(vector)
    x, y, z = vector / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k


def main() -> None:
    points, code, parameters = sys.argv[1:]
    with open(points, encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    local = np.array([[float(row[k]) for k in "xyz"] for row in rows])
    source = strings()[int(code)] + " +type=crs"
    to = Transformer.from_crs(source, "+proj=longlat +datum=WGS84 +no_defs +type=crs", always_xy=True)
    cart = Transformer.from_pipeline("+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84")
    surveyed = []
    for row in rows:
        height = float(row["height"])
        lon, lat, _ = to.transform(float(row["east"]), float(row["north"]), height)
        surveyed.append(cart.transform(lon, lat, height))
    surveyed = np.array(surveyed)
    with open(parameters, "rb") as file:
        placement = tomllib.load(file)["placement"]
    rotation = rotation_matrix(np.array(placement["rotation_vector_rad"]))
    # R = Rz·Ry·Rx; the angles of PROJ's coordinate frame convention run the other way.
    rx = np.arctan2(rotation[2, 1], rotation[2, 2])
    ry = -np.arcsin(rotation[2, 0])
    rz = np.arctan2(rotation[1, 0], rotation[0, 0])
    seconds = -np.degrees([rx, ry, rz]) * 3600
    ppm = (placement["scale"] - 1) * 1e6
    t = placement["translation_ecef_m"]
    helmert = Transformer.from_pipeline(
        f"+proj=helmert +exact +convention=coordinate_frame +x={t[0]:.6f} +y={t[1]:.6f} +z={t[2]:.6f} "
        f"+rx={seconds[0]:.9f} +ry={seconds[1]:.9f} +rz={seconds[2]:.9f} +s={ppm:.9f}"
    )
    placed = np.array([helmert.transform(*p) for p in local - np.array(placement["center_local"])])
    scale, turn, shift = umeyama(local, surveyed)
    own = scale * local @ turn.T + shift
    print(f"pyproj {__version__}, PROJ {proj_version_str}")
    print(f"residuals         {np.sqrt(((surveyed - placed) ** 2).sum(1).mean()):.4f} m rms")
    print(f"PROJ against own  {1e3 * np.linalg.norm(placed - own, axis=1).max():.4f} mm")
    assert np.linalg.norm(placed - own, axis=1).max() < 1e-3


if __name__ == "__main__":
    main()
