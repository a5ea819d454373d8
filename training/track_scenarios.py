#!/usr/bin/env python3
"""Draws scenarios for `boresight tracks`: UAVs, birds, aircraft, balloons and leaves before sky, city and woods.

In each one object is held by an operator's orders, so that what is no UAV fills the precise camera as UAVs do. Some
fly along with it in that camera's field, others within two degrees of it. A part searches a wide sector without help,
for tracks of dots and scenery. Nothing is fired at.

`--drawn` makes them of engagements that `boresight eval engagement --recipe recipes/tracks.toml` drew: nearly half are
left to the station, whose own choices are the tracks that it errs about, in the others something is held.
"""

import argparse
import json
import math
import random
import tomllib
from pathlib import Path

STATION_UP_M, LOWEST_M = 48.0, 15.0
# The kinds of each class, with their largest extents [m].
KINDS = {
    "uav": {"phantom4": 0.35, "mavic2": 0.35, "mavic_air": 0.21, "matrice200": 0.64, "matrice600": 1.13, "fpv5": 0.22},
    "bird": {"bird": 1.4, "crow": 0.95, "pigeon": 0.66, "swift": 0.42, "goose": 1.6, "raptor": 1.25},
    "balloon": {"balloon": 0.3},
    "aeroplane": {"aeroplane": 35.8, "turboprop": 27.1, "light_aircraft": 11.0, "contrail": 60.0},  # the first of its trail
    "helicopter": {"helicopter": 12.2},
    "leaf": {"leaf": 0.16},
}
OFTEN = {"raptor": 3.0}  # beside 1 of each other kind: while it glides, only its shape tells it from a UAV
SPEED_MPS = {"uav": (0, 16), "bird": (6, 14), "aeroplane": (50, 200), "helicopter": (0, 60)}  # the others drift
RANGE_M = {  # nearest and farthest
    "uav": (60, 1200), "bird": (60, 900), "balloon": (60, 800), "leaf": (30, 150), "aeroplane": (600, 14000), "helicopter": (300, 9000),
}  # fmt: skip
FROM_BELOW = 0.2  # share of what is held far above the horizon, where aircraft show their rotors and wings
FROM_BELOW_DEG = 12.0, 60.0
WIDER = 2.0, 8.0  # times as wide are the cameras then: aircraft near, dark before the sky, as people film them
HELD = {"uav": 0.38, "bird": 0.28, "aeroplane": 0.11, "helicopter": 0.11, "balloon": 0.07, "leaf": 0.05}
# What flies beside the held one; the far ones where no hill is before them.
LOW_COMPANY = {"uav": 0.5, "bird": 0.5}
COMPANY = {"uav": 0.25, "bird": 0.25, "aeroplane": 0.25, "helicopter": 0.25}
# What a wide sector holds, of 10 to 50 px in the precise camera: 2 to 8 in the search camera.
BESIDE_PX = 180  # so far to either side, in the precise camera
IN_SECTOR = {"uav": 0.5, "bird": 0.3, "aeroplane": 0.07, "helicopter": 0.07, "balloon": 0.06}
WIDE_DEG = 36.0, 10.0
FAR, ABOVE_HILLS_DEG = ("aeroplane", "helicopter"), 3.0
# Half the rates of the preset: twice the seconds for the time.
CAMERAS = {"search": (15, 6.0), "coarse": (30, 3.0), "precise": (60, 1.0)}  # and the fields of view [deg]
# Cities that the loop was judged in before others were kept for it: not learned from. `boresight tracks` refuses the others.
ONCE_JUDGED_CITIES = range(1, 9)
FREE, HELD_UAV = 0.45, 0.25  # shares of what is drawn; in the rest a distractor is held
FINE_IFOV_RAD = math.radians(CAMERAS["precise"][1]) / 640
# UTC: the light, and how often; a UAV that is not found is mostly one in low light.
TIMES = {
    "04:50": ("Dusk", 3), "05:10": ("Dusk", 2), "05:40": ("LowSun", 2), "08:50": ("Day", 1), "11:30": ("Day", 1), "15:10": ("Day", 1),
    "17:00": ("LowSun", 2), "17:28": ("Dusk", 2), "17:45": ("Dusk", 3),
}  # fmt: skip
WEATHER = (
    ("24005KT 9999 FEW045 19/11 Q1020", 18_000, False),
    ("24010KT 9999 SCT040 17/11 Q1016", 15_000, True),
    ("20007KT 8000 BKN035 14/12 Q1012", 8_000, True),
    ("26004KT 9999 OVC050 12/08 Q1019", 12_000, False),
    ("VRB02KT CAVOK 22/09 Q1024", 25_000, False),
    ("26010KT 7000 -RA BKN018 OVC040 10/09 Q1004", 10_000, False),
)


def pick(rng: random.Random, shares: dict) -> str:
    return rng.choices(list(shares), list(shares.values()))[0]


def kind_of(rng: random.Random, what: str) -> str:
    return pick(rng, {kind: OFTEN.get(kind, 1.0) for kind in KINDS[what]})


def of_kind(rng: random.Random, key: str, kind: str) -> str:
    """Its model, or its kind and most often which individual of it."""
    individual = f"variant = {rng.randrange(1000)}\n" if key == "kind" and rng.random() < 0.8 else ""
    return f'{key} = "{kind}"\n{individual}'


def place(az_deg: float, el_deg: float, range_m: float) -> list[float]:
    a, e = math.radians(az_deg), math.radians(el_deg)
    return [range_m * math.cos(e) * math.sin(a), range_m * math.cos(e) * math.cos(a), STATION_UP_M + range_m * math.sin(e)]


def flight(rng: random.Random, what: str, at: list[float], az_deg: float, range_m: float) -> str:
    """A trajectory that begins near `at`, in any direction: wings seen from behind look like arms."""
    if what not in SPEED_MPS:
        return hover(at)
    speed = rng.uniform(*SPEED_MPS[what])
    course = math.radians(az_deg) + rng.uniform(-math.pi, math.pi)
    climb = rng.uniform(-0.08, 0.08) * speed
    v = [speed * math.sin(course), speed * math.cos(course), climb]
    kind = rng.random()
    if what == "uav" and (kind < 0.3 or speed < 1.0):
        return hover(at, rng.uniform(0, 360))
    if what == "uav" and kind < 0.5:
        return (f'{{ kind = "weave", start_enu_m = {rounded(at)}, velocity_enu_mps = {rounded(v)}, '
                f"lateral_acceleration_mps2 = {rng.uniform(1, 5):.2f}, period_s = {rng.uniform(2, 5):.2f} }}")  # fmt: skip
    if what in ("uav", "bird") and kind > 0.8:
        radius = rng.uniform(15, 60)
        bearing = rng.uniform(0, 360)
        b = math.radians(bearing)
        centre = [at[0] - radius * math.sin(b), at[1] - radius * math.cos(b), at[2]]
        return (f'{{ kind = "orbit", centre_enu_m = {rounded(centre)}, radius_m = {radius:.1f}, '
                f"speed_mps = {max(speed, 4):.2f}, start_bearing_deg = {bearing:.1f} }}")  # fmt: skip
    return straight(at, v)


def hover(at: list[float], heading_deg: float | None = None) -> str:
    heading = "" if heading_deg is None else f", heading_deg = {heading_deg:.1f}"
    return f'{{ kind = "hover", position_enu_m = {rounded(at)}{heading} }}'


def straight(at: list[float], v: list[float]) -> str:
    return f'{{ kind = "straight", start_enu_m = {rounded(at)}, velocity_enu_mps = {rounded(v)} }}'


def companion(rng: random.Random, name: str, az_deg: float, el_deg: float, rate_radps: tuple[float, float], ifov_rad: float) -> tuple[str, str] | None:
    """Something that stays beside the held one, which moves at these rates to the right and away over ground: the
    farther, the faster. Near the horizon, where it does not show, it moves along the line of sight as it likes."""
    what = pick(rng, COMPANY if el_deg >= ABOVE_HILLS_DEG else LOW_COMPANY)
    kind = kind_of(rng, what)
    slow, fast = SPEED_MPS[what]
    wanted_px = math.exp(rng.uniform(math.log(5), math.log(100)))
    range_m = KINDS[what][kind] / (wanted_px * ifov_rad)
    across, along = (rate * range_m for rate in rate_radps)
    near, far = RANGE_M[what]
    from_below = el_deg >= FROM_BELOW_DEG[0]
    can_keep_up = slow <= math.hypot(across, along) <= fast if from_below else abs(across) <= fast
    if not near <= range_m <= far or not can_keep_up:
        return None
    if not from_below:
        speed = rng.uniform(max(slow, abs(across)), fast)
        along = math.sqrt(speed**2 - across**2) * rng.choice((-1, 1))
        if what == "uav" and rng.random() < 0.5:
            along = 0.0
        if range_m + 5 * min(along, 0.0) < near:
            along = -along
    az_deg += math.degrees(rng.uniform(-BESIDE_PX, BESIDE_PX) * ifov_rad) / math.cos(math.radians(el_deg))
    el_deg += math.degrees(rng.uniform(-BESIDE_PX, BESIDE_PX) * 0.8 * ifov_rad)
    if el_deg < 0:
        range_m = min(range_m, (STATION_UP_M - LOWEST_M) / math.sin(math.radians(-el_deg)))
    v = velocity(az_deg, 0.0 if from_below else el_deg, across, along)
    at = place(az_deg, el_deg, range_m)
    moves = hover(at, rng.uniform(0, 360)) if math.hypot(*v) < 0.5 else straight(at, v)
    key, table = ("model", "uavs") if what == "uav" else ("kind", "distractors")
    return f'[[{table}]]\nname = "{name}"\n{of_kind(rng, key, kind)}trajectory = {moves}\n', table


def velocity(az_deg: float, el_deg: float, across: float, along: float) -> list[float]:
    """East, north, up, of so much to the right and so much away in a direction."""
    a, e = math.radians(az_deg), math.radians(el_deg)
    return [across * math.cos(a) + along * math.cos(e) * math.sin(a), -across * math.sin(a) + along * math.cos(e) * math.cos(a),
            along * math.sin(e)]  # fmt: skip


def crossing(rng: random.Random, what: str, az_deg: float, el_deg: float, ifov_rad: float) -> tuple[str, str, tuple[float, float]]:
    """The held one in straight flight, or at rest, and its rates to the right and away [rad/s]. What is seen from below
    flies level."""
    kind = kind_of(rng, what)
    wanted_px = math.exp(rng.uniform(math.log(7), math.log(140)))
    near, far = RANGE_M[what]
    range_m = min(max(KINDS[what][kind] / (wanted_px * ifov_rad), near), far)
    if el_deg < 0:
        range_m = min(range_m, (STATION_UP_M - LOWEST_M) / math.sin(math.radians(-el_deg)))
    speed = rng.uniform(*SPEED_MPS[what])
    across = speed * rng.uniform(-1, 1)
    along = math.sqrt(speed**2 - across**2) * rng.choice((-1, 1))
    if what == "uav" and rng.random() < 0.3:
        across = along = 0.0
    v = velocity(az_deg, 0.0 if el_deg >= FROM_BELOW_DEG[0] else el_deg, across, along)
    at = place(az_deg, el_deg, range_m)
    moves = hover(at, rng.uniform(0, 360)) if math.hypot(*v) < 0.5 else straight(at, v)
    key, table = ("model", "uavs") if what == "uav" else ("kind", "distractors")
    return f'[[{table}]]\nname = "held"\n{of_kind(rng, key, kind)}trajectory = {moves}\n', table, (across / range_m, along / range_m)


def cameras(wider: float = 1.0) -> str:
    return "".join(f"[station.cameras.{name}]\nrate_hz = {rate_hz}\nhfov_deg = {wider * hfov_deg:.3f}\n" for name, (rate_hz, hfov_deg) in CAMERAS.items())


def rounded(xs: list[float]) -> list[float]:
    return [round(x, 3) for x in xs]


def thing(rng: random.Random, what: str, name: str, az_deg: float, el_deg: float, ifov_rad: float, size_px: tuple[float, float] = (5, 120)) -> tuple[str, str]:
    """A table of the scenario, and which list it belongs to; its size is that in the precise camera."""
    kind = kind_of(rng, what)
    extent_m = KINDS[what][kind]
    wanted_px = math.exp(rng.uniform(*map(math.log, size_px)))
    near, far = RANGE_M[what]
    range_m = min(max(extent_m / (wanted_px * ifov_rad), near), far)
    if range_m > 2000:  # above the hills
        el_deg = max(el_deg, ABOVE_HILLS_DEG)
    if el_deg < 0:  # above the roofs of low houses, before meadows, streets and facades
        range_m = min(range_m, (STATION_UP_M - LOWEST_M) / math.sin(math.radians(-el_deg)))
    at = place(az_deg, el_deg, range_m)
    key, table = ("model", "uavs") if what == "uav" else ("kind", "distractors")
    return f'[[{table}]]\nname = "{name}"\n{of_kind(rng, key, kind)}trajectory = {flight(rng, what, at, az_deg, range_m)}\n', table


def scenario(seed: int, duration_s: float, kinds: tuple[str, ...] = tuple(HELD), from_below: float = FROM_BELOW) -> str:
    rng = random.Random(seed)
    az, el = rng.uniform(0, 360), rng.choice((rng.uniform(-3, 1), rng.uniform(-2, 1.5), rng.uniform(1.2, 4), rng.uniform(2, 12)))
    above = rng.random() < from_below
    wide = not above and rng.random() < 0.25
    if above:
        el = rng.uniform(*FROM_BELOW_DEG)
    wider = math.exp(rng.uniform(*map(math.log, WIDER))) if above else 1.0
    ifov_rad = wider * FINE_IFOV_RAD
    held = "nothing" if wide else pick(rng, {kind: HELD[kind] for kind in kinds})
    if held in FAR:
        el = max(el, ABOVE_HILLS_DEG)
    metar, visibility_m, texture = rng.choice(WEATHER)
    time = pick(rng, {time: 1 if above else share for time, (_, share) in TIMES.items()})
    forest = rng.random() < 0.4
    parts = [
        f'name = "tracks_{seed}"\ndescription = "{held} held, {TIMES[time][0]}"\nseed = {seed}\nduration_s = {duration_s}\n'
        f"time_utc = 2025-09-20T{time}:00Z\n",
        "[site]\nlatitude_deg = 47.3769\nlongitude_deg = 8.5417\naltitude_m = 455.0\n",
        f"[city]\nseed = {rng.randrange(ONCE_JUDGED_CITIES.stop, 50)}\n" + ("forest_share = 0.5\nbuilding_density = 0.1\n" if forest else "building_density = 0.4\n" if el < 1 else ""),
        f"[station]\nposition_enu_m = [0.0, 0.0, {STATION_UP_M}]\n",
        cameras(wider),
        f'[weather]\nmetar = "LSZH 200850Z {metar} NOSIG"\nvisibility_m = {visibility_m}.0\ncloud_texture = {str(texture).lower()}\n',
        "[engage]\nauthorised = false\n",
    ]
    low = rng.uniform(-1.5, 3.0)  # lower edge of a sector
    if wide:
        parts.append(f"[search]\ncentre_azimuth_deg = {az:.2f}\nwidth_deg = {WIDE_DEG[0]}\nelevation_deg = {low + WIDE_DEG[1] / 2:.2f}\nheight_deg = {WIDE_DEG[1]}\n")
    else:
        off = rng.uniform(-0.6, 0.6)
        parts.append(f"[search]\ncentre_azimuth_deg = {(az + off) % 360:.2f}\nwidth_deg = 3.0\nelevation_deg = {el:.2f}\nheight_deg = 2.0\n")
    tables = {"uavs": [], "distractors": []}
    if wide:
        for k in range(rng.randint(10, 16)):
            at = az + rng.uniform(-0.5, 0.5) * WIDE_DEG[0], low + rng.uniform(0, 1) * WIDE_DEG[1]
            text, table = thing(rng, pick(rng, IN_SECTOR), f"in the sector {k}", *at, ifov_rad, size_px=(10, 50))
            tables[table].append(text)
    elif held in ("uav", "bird", *FAR) and rng.random() < 0.75:
        text, table, rate = crossing(rng, held, az, el, ifov_rad)
        tables[table].append(text)
        company = [companion(rng, f"beside {k}", az, el, rate, ifov_rad) for k in range(16)]
        for other, of in [found for found in company if found][:6]:
            tables[of].append(other)
    else:
        text, table = thing(rng, held, "held", az, el, ifov_rad)
        tables[table].append(text)
    for k in range(0 if wide else rng.choice((0, 1, 1, 2))):
        other = rng.choice(("uav", "bird", "bird", "aeroplane", "helicopter", "balloon"))
        text, table = thing(rng, other, f"other {k}", az + rng.uniform(-1.5, 1.5), max(min(el, 0.8), el + rng.uniform(-1, 1)), ifov_rad)
        tables[table].append(text)
    parts += tables["uavs"] + tables["distractors"]
    parts += [] if wide else orders("held", duration_s)
    return "\n".join(parts)


def orders(name: str, duration_s: float) -> list[str]:
    """Given up, it is designated again."""
    return [f'[[operator]]\nt_s = {t:.1f}\ndesignate = "{name}"\n' for t in (x * 0.5 for x in range(1, int(2 * duration_s)))]


def beside_intruder(rng: random.Random, intruder: dict) -> list[str]:
    """Others that fly as the drawn UAV does, a few metres away, so that the precise camera has them beside it."""
    path = intruder["trajectory"]
    key = next((key for key in path if key in ("start_enu_m", "position_enu_m", "centre_enu_m")), None)
    if key is None:
        return []
    moves_like_a_bird = path["kind"] == "straight" and math.hypot(*path["velocity_enu_mps"]) >= SPEED_MPS["bird"][0]
    reach_m, parts = 4e-3 * math.hypot(*path[key]), []
    for k in range(rng.choice((0, 1, 1, 2, 2))):
        at = rounded([x + rng.uniform(-reach_m, reach_m) for x in path[key]])
        moves = ", ".join(f"{name} = {json.dumps(value)}" for name, value in (path | {key: at}).items())
        bird = moves_like_a_bird and rng.random() < 0.6
        table, of = ("distractors", "kind") if bird else ("uavs", "model")
        parts.append(f'[[{table}]]\nname = "beside {k}"\n{of_kind(rng, of, kind_of(rng, "bird" if bird else "uav"))}trajectory = {{ {moves} }}\n')
    return parts


def of_drawn(text: str, duration_s: float) -> str | None:
    """A drawn engagement as a scenario for tracks; none of one in a city that was judged in."""
    drawn = tomllib.loads(text)
    if drawn["city"]["seed"] in ONCE_JUDGED_CITIES:
        return None
    rng = random.Random(drawn["seed"])
    text = text.replace(f"duration_s = {drawn['duration_s']}\n", f"duration_s = {duration_s}\n", 1)
    parts = [text.replace("[engage]\n", "[engage]\nauthorised = false\n", 1), cameras()]
    parts += beside_intruder(rng, drawn["uavs"][0])
    share, others = rng.random(), [thing["name"] for thing in drawn.get("distractors", [])]
    if share > FREE:
        held = "intruder" if share < FREE + HELD_UAV or not others else rng.choice(others)
        parts += orders(held, duration_s)
    return "\n".join(parts)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--first", type=int, default=1000, help="seed of the first")
    parser.add_argument("--duration-s", type=float, default=5.0)
    parser.add_argument("--held", nargs="+", choices=HELD, default=list(HELD), help="what may be held")
    parser.add_argument("--from-below", type=float, default=FROM_BELOW, help="share of them that is held far above the horizon")
    parser.add_argument("--drawn", type=Path, help="folder `draws` of an evaluation of engagements, in place of own scenarios")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    if args.drawn:
        for path in sorted(args.drawn.glob("*.toml")):
            if text := of_drawn(path.read_text(), args.duration_s):
                (args.out / f"drawn_{path.name}").write_text(text)
        return
    for seed in range(args.first, args.first + args.count):
        (args.out / f"tracks_{seed}.toml").write_text(scenario(seed, args.duration_s, tuple(args.held), args.from_below))


if __name__ == "__main__":
    main()
