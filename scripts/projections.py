"""Writes tests/data/projections.csv: points in many systems, and where PROJ puts them. `cargo test projection` holds
Boresight to them. With --datums it prints how far Boresight's datum shifts (those of the PROJ strings) lie from what PROJ itself
chooses by EPSG code without grids, and the accuracy that EPSG states of it. With --registers it writes assets/epsg: EPSG's vertical
systems, and its compound and three-dimensional ones, from PROJ's database.

    python3 -m venv venv && venv/bin/pip install pyproj==3.7.2
    venv/bin/python scripts/projections.py [--datums | --registers]
"""

import csv
import math
import re
import sqlite3
import sys
from pathlib import Path

from pyproj import Geod, Transformer, __version__, datadir, proj_version_str
from pyproj.transformer import TransformerGroup

# Points by the code of the system they lie in: east or longitude, north or latitude, height (X, Y, Z in geocentric ones).
POINTS = {
    28992: [(84600.0, 447200.0, 1.5), (155000.0, 463000.0, 0.0), (244000.0, 601000.0, 10.0), (190000.0, 318000.0, 300.0)],
    7415: [(84600.0, 447200.0, 1.5), (121000.0, 487000.0, 30.0)],
    21781: [(683000.0, 247000.0, 408.0), (500000.0, 118000.0, 375.0), (820000.0, 187000.0, 1500.0)],
    2056: [(2683000.0, 1247000.0, 408.0), (2600000.0, 1200000.0, 550.0)],
    4326: [(8.5417, 47.3769, 408.0), (-71.06, 42.36, 10.0), (151.21, -33.87, 20.0)],
    4258: [(13.4, 52.5, 34.0)],
    4314: [(11.57, 48.14, 520.0)],
    4289: [(4.36, 52.01, 1.0)],
    4978: [(3771793.968, 140253.342, 5124304.349), (4278990.0, 643000.0, 4670800.0)],
    4936: [(3771793.968, 140253.342, 5124304.349)],
    25832: [(691000.0, 5334000.0, 520.0), (166000.0, 5500000.0, 100.0), (890000.0, 5600000.0, 100.0)],
    32633: [(391000.0, 5820000.0, 34.0)],
    32756: [(334000.0, 6252000.0, 20.0)],
    31467: [(3500000.0, 5400000.0, 300.0), (3388000.0, 5750000.0, 60.0)],
    31256: [(2500.0, 340000.0, 170.0)],
    31287: [(625000.0, 483000.0, 170.0)],
    27700: [(530000.0, 180000.0, 25.0), (325000.0, 674000.0, 80.0)],
    2154: [(652000.0, 6862000.0, 35.0), (1000000.0, 6300000.0, 20.0)],
    31370: [(149000.0, 170000.0, 60.0)],
    3812: [(649000.0, 670000.0, 60.0)],
    2180: [(637000.0, 487000.0, 110.0)],
    3067: [(385000.0, 6672000.0, 20.0)],
    3879: [(25496000.0, 6673000.0, 20.0)],
    3006: [(674000.0, 6580000.0, 20.0)],
    23700: [(650000.0, 240000.0, 120.0)],
    5514: [(-743000.0, -1043000.0, 200.0)],
    2263: [(983000.0, 199000.0, 10.0)],
    2229: [(6487000.0, 1842000.0, 90.0)],
    26910: [(551000.0, 4180000.0, 20.0)],
    3414: [(29000.0, 30000.0, 15.0)],
    2326: [(835000.0, 816000.0, 30.0)],
    5186: [(198000.0, 552000.0, 40.0)],
    2193: [(1757000.0, 5920000.0, 30.0)],
    3857: [(950000.0, 6000000.0, 0.0)],
}


# As in crates/geodata/src/projection/mod.rs.
REPLACED = {
    "+datum=OSGB36": "+ellps=airy +towgs84=446.448,-125.157,542.06,0.15,0.247,0.842,-20.489",
    "+datum=potsdam": "+ellps=bessel +towgs84=598.1,73.7,418.2,0.202,0.045,-2.455,6.7",
    "+towgs84=589,76,480,0,0,0,0": "+towgs84=572.213,85.334,461.94,4.9732,1.529,5.2484,3.5378",
}


def strings() -> dict[int, str]:
    """The PROJ strings that the program uses, from the sources of the crate that it takes them from."""
    crates = Path.home() / ".cargo/registry/src"
    found = sorted(crates.glob("*/crs-definitions-0.6.0/src/defs.rs"))
    if not found:
        sys.exit("fetch the crates first: cargo fetch")
    entry = re.compile(r'^EPSG_\d+\|(\d+)\|"([^"]*)"')
    lines = (entry.match(line) for line in found[0].open(encoding="utf-8"))
    table = {int(match[1]): match[2] for match in lines if match}
    for old, new in REPLACED.items():
        table = {code: text.replace(old, new) for code, text in table.items()}
    return table


def datums(table: dict[int, str]) -> None:
    """Prints how far the shift of the PROJ string and PROJ's own choice lie apart."""
    geod = Geod(ellps="WGS84")
    print(f"pyproj {__version__}, PROJ {proj_version_str}, no grids")
    for code, points in POINTS.items():
        plain = re.sub(r" \+v?units=m(?= \+no_defs)", "", table[code])
        by_string = Transformer.from_crs(plain, "EPSG:4326", always_xy=True)
        by_code = Transformer.from_crs(f"EPSG:{code}", "EPSG:4326", always_xy=True)
        gaps = []
        for point in points:
            a, b = by_string.transform(*point), by_code.transform(*point)
            gaps.append(geod.inv(a[0], a[1], b[0], b[1])[2])
        # What EPSG states of the best shift without grids, and of the best with one.
        group = TransformerGroup(f"EPSG:{code}", "EPSG:4326", always_xy=True)
        best = [min((t.accuracy for t in found if t.accuracy >= 0), default=None) for found in (group.transformers, group.unavailable_operations)]
        stated = ", ".join("-" if accuracy is None else f"{accuracy:g} m" for accuracy in best)
        print(f"EPSG:{code:<6} {max(gaps):10.4f} m   accuracy stated without and with grids: {stated}")


def registers(table: dict[int, str]) -> None:
    """Writes EPSG's vertical systems (code, datum, metres in its unit, negative for depths, name), and the horizontal and vertical part of
    each compound system; `ellipsoid` for three-dimensional ones."""
    folder = Path(__file__).parent.parent / "assets/epsg"
    folder.mkdir(parents=True, exist_ok=True)
    base = sqlite3.connect(Path(datadir.get_data_dir()) / "proj.db")
    vertical = base.execute(
        "select v.code, v.datum_code, u.conv_factor, a.orientation, v.name from vertical_crs v "
        "join axis a using (coordinate_system_auth_name, coordinate_system_code) "
        "join unit_of_measure u on u.auth_name = a.uom_auth_name and u.code = a.uom_code "
        "where v.auth_name = 'EPSG' order by cast(v.code as int)"
    )
    with (folder / "vertical.csv").open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["code", "datum", "unit_m", "name"])
        for code, datum, unit_m, orientation, name in vertical:
            sign = -1 if orientation == "down" else 1
            rows.writerow([code, datum, f"{sign * unit_m:.16g}", name.strip().replace(",", "").removesuffix(" height")])
    parts = base.execute(
        "select code, horiz_crs_code, vertical_crs_code from compound_crs where auth_name = 'EPSG' "
        "and horiz_crs_auth_name = 'EPSG' and vertical_crs_auth_name = 'EPSG'"
    )
    found = [(int(code), int(horizontal), vertical) for code, horizontal, vertical in parts if int(horizontal) in table]
    flat = base.execute(
        "select t.code, f.code from geodetic_crs t left join geodetic_crs f on f.datum_auth_name = t.datum_auth_name "
        "and f.datum_code = t.datum_code and f.type = 'geographic 2D' and f.auth_name = 'EPSG' "
        "where t.auth_name = 'EPSG' and t.type = 'geographic 3D'"
    )
    three = {}
    for code, of in flat:
        known = [k for k in (three.get(int(code)), of and int(of), int(code)) if k in table]
        if known:
            three[int(code)] = known[0]
    found += [(code, horizontal, "ellipsoid") for code, horizontal in three.items()]
    # LUREF / Luxembourg TM (3D), the one projected system of three dimensions.
    found.append((9895, 2169, "ellipsoid"))
    with (folder / "compound.csv").open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["code", "horizontal", "vertical"])
        rows.writerows(sorted(found))
    print(f"{folder}: pyproj {__version__}, PROJ {proj_version_str}")


def main() -> None:
    table = strings()
    if "--registers" in sys.argv:
        registers(table)
        return
    if "--datums" in sys.argv:
        datums(table)
        return
    out = Path(__file__).parent.parent / "tests/data/projections.csv"
    with out.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["code", "x", "y", "z", "longitude_deg", "latitude_deg", "height_m"])
        for code, points in POINTS.items():
            source = table[code].replace("+vunits=m ", "") + " +type=crs"
            to = Transformer.from_crs(source, "+proj=longlat +datum=WGS84 +no_defs +type=crs", always_xy=True)
            for point in points:
                lon, lat, height = to.transform(*point)
                assert math.isfinite(lon), (code, point)
                rows.writerow([code, *point, f"{lon:.12f}", f"{lat:.12f}", f"{height:.6f}"])
    print(f"{out}: pyproj {__version__}, PROJ {proj_version_str}")


if __name__ == "__main__":
    main()
