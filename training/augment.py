"""Pictures that are not rendered, and changes to those that are: the levers from the simulator to real video.

All functions take a `numpy.random.Generator` and float32 pictures [H,W,3], RGB 0..255; what they draw depends on the
generator's state alone. Boxes are x0, y0, x1, y1 in pixels; pixel (i, j) covers [i, i+1) x [j, j+1).
"""

import math
from collections.abc import Callable

import cv2
import numpy as np

cv2.setNumThreads(0)  # the picture worker has one core; OpenCV's pool would fight the training threads
Rng = np.random.Generator
NOISE = np.random.default_rng(7).standard_normal(1 << 21, dtype=np.float32)  # drawing afresh costs more than all else
COVERED = 0.1  # [px^2] least of a target in a column or row of pixels inside its box (the data set's rule)
LUMA = np.array([0.299, 0.587, 0.114], np.float32)  # ITU-R BT.601


def noise(rng: Rng, shape: tuple[int, ...]) -> np.ndarray:
    """Standard normal samples cut out of a fixed bank."""
    count = math.prod(shape)
    start = int(rng.integers(0, NOISE.size - count))
    return NOISE[start : start + count].reshape(shape)


def texture(rng: Rng, h: int, w: int, coarse: int, fine: int, fall: float = 0.6) -> np.ndarray:
    """Fractal noise [h,w], about -1..1, octaves from `coarse` to `fine` pixels, amplitudes falling by `fall`."""
    cells = [coarse]
    while cells[-1] >= 2 * fine:
        cells.append(cells[-1] // 2)
    out, amplitude, total = np.zeros((1, 1), np.float32), 1.0, 0.0
    for cell in cells:  # each octave on the enlarged sum of the coarser ones
        shape = (-(-h // cell) + 1, -(-w // cell) + 1)
        out = cv2.resize(out, shape[::-1], interpolation=cv2.INTER_CUBIC) + amplitude * noise(rng, shape)
        total, amplitude = total + amplitude**2, amplitude * fall
    if cells[-1] > 1:
        out = cv2.resize(out, None, fx=cells[-1], fy=cells[-1], interpolation=cv2.INTER_CUBIC)
    return out[:h, :w] / (1.7 * math.sqrt(total))


def colour(rng: Rng, low: float, high: float, tint: float = 12.0) -> np.ndarray:
    """A near-grey colour [3] of luminance low..high."""
    return np.clip(rng.uniform(low, high) + rng.normal(0, tint, 3), 0, 255).astype(np.float32)


# --- backgrounds ---------------------------------------------------------------------------------------------------


def sky(rng: Rng, h: int, w: int) -> np.ndarray:
    """A sky: vertical gradient from blue to white, grey, dusk or night, with or without clouds."""
    kind = rng.choice(5, p=[0.38, 0.17, 0.28, 0.12, 0.05])
    if kind == 0:  # clear blue
        top = np.array([rng.uniform(30, 140), rng.uniform(90, 185), rng.uniform(150, 250)])
        low = top + (np.array([235, 240, 245]) - top) * rng.uniform(0, 0.9)
    elif kind == 1:  # haze, burnt out
        top = low = np.full(3, rng.uniform(190, 255)) + rng.normal(0, 5, 3)
    elif kind == 2:  # overcast
        top = np.full(3, rng.uniform(80, 220)) + rng.normal(0, 8, 3)
        low = top + rng.uniform(-25, 30)
    elif kind == 3:  # dusk
        top = np.array([rng.uniform(50, 130), rng.uniform(60, 120), rng.uniform(90, 160)])
        low = np.array([rng.uniform(180, 255), rng.uniform(120, 190), rng.uniform(70, 150)])
    else:  # night
        top = low = np.full(3, rng.uniform(5, 40)) + rng.normal(0, 4, 3)
    a, b = np.sort(rng.uniform(-1, 2, 2))
    ramp = np.clip(np.linspace(a, b, h, dtype=np.float32), 0, 1)[:, None, None]
    out = np.broadcast_to((top + (low - top) * ramp).astype(np.float32), (h, w, 3)).copy()
    if rng.random() < 0.5:
        field = texture(rng, h, w, int(rng.integers(32, 160)), int(rng.choice([2, 4, 8])), rng.uniform(0.4, 0.65))
        if rng.random() < 0.5:  # broken clouds: white tops, grey bases
            cover = np.clip((field + rng.uniform(-0.6, 0.6)) * rng.uniform(1, 4), 0, 1)[..., None]
            shade = np.clip(1 + 0.25 * texture(rng, h, w, 64, 8), 0.5, 1.3)[..., None]
            out += cover * rng.uniform(0.3, 1) * (colour(rng, 150, 255, 5) * shade - out)
        else:  # mottling
            out += (field * rng.uniform(3, 25))[..., None]
    return out


def ground(rng: Rng, h: int, w: int) -> np.ndarray:
    """Foliage, grass, soil, snow or water: fractal noise between two colours."""
    base = np.array([[60, 75, 40], [90, 100, 60], [120, 105, 85], [45, 50, 45], [200, 200, 205], [75, 95, 110]][rng.integers(6)])
    base = base * rng.uniform(0.4, 1.4) + rng.normal(0, 8, 3)
    field = texture(rng, h, w, int(rng.choice([8, 16, 32, 64])), 1, rng.uniform(0.55, 1.0))
    contrast = rng.uniform(0.1, 0.7)
    return (base * np.exp(np.clip(field, -2, 2) * contrast)[..., None]).astype(np.float32)


def facade(rng: Rng, h: int, w: int) -> np.ndarray:
    """A wall with a grid of windows, some of them glinting."""
    out = np.empty((h, w, 3), np.float32)
    out[:] = colour(rng, 50, 220, 15)
    out += (texture(rng, h, w, 16, 2) * rng.uniform(1, 8))[..., None]
    px, py = rng.uniform(6, 40, 2)
    wx, wy = rng.uniform(0.3, 0.8, 2)
    dark = colour(rng, 15, 120, 15)
    for y in np.arange(rng.uniform(-py, 0), h, py):
        for x in np.arange(rng.uniform(-px, 0), w, px):
            c = colour(rng, 180, 255, 5) if rng.random() < 0.03 else dark * rng.uniform(0.7, 1.3)
            cv2.rectangle(out, *corners(x, y, x + wx * px, y + wy * py), c.tolist(), -1, cv2.LINE_AA, 4)
    return out


def corners(x0: float, y0: float, x1: float, y1: float) -> tuple[tuple[int, int], tuple[int, int]]:
    """Corners of a rectangle as cv2 takes them with 4 fractional bits."""
    return (round(x0 * 16 - 8), round(y0 * 16 - 8)), (round(x1 * 16 - 8), round(y1 * 16 - 8))


def tree_line(rng: Rng, picture: np.ndarray, top: float | None = None) -> None:
    """Trees or a roof line over the lower part of a picture, in place; `top` is its mean row."""
    h, w = picture.shape[:2]
    top = rng.uniform(0.25, 1.0) * h if top is None else top
    if rng.random() < 0.7:
        fall = rng.uniform(0.5, 0.95)
        rows = top + rng.uniform(3, 40) * texture(rng, 8, w, int(rng.choice([16, 32, 64, 128])), 1, fall)[4]
        skin = ground(rng, h, w)
        skin *= rng.uniform(0.3, 1.0)
        mask = np.clip(np.arange(h, dtype=np.float32)[:, None] + 0.5 - rows[None], 0, 1)
        if rng.random() < 0.6:  # thin crowns: sky through the leaves near the edge
            depth = np.arange(h, dtype=np.float32)[:, None] - rows[None]
            mask *= np.clip((texture(rng, h, w, 8, 1, 0.9) + 0.2) * 3 + depth / rng.uniform(3, 15), 0, 1)
    else:
        rows, x = np.full(w, top, np.float32), 0
        while x < w:
            step = int(rng.integers(8, 90))
            rows[x : x + step] += rng.normal(0, 25)
            x += step
        skin = facade(rng, h, w) if rng.random() < 0.6 else np.broadcast_to(colour(rng, 20, 200, 15), (h, w, 3))
        mask = np.clip(np.arange(h, dtype=np.float32)[:, None] + 0.5 - rows[None], 0, 1)
    picture += mask[..., None] * (skin - picture)


def background(rng: Rng, size: int) -> np.ndarray:
    """A procedural background [size,size,3]."""
    kind = rng.random()
    if kind < 0.12:
        out = ground(rng, size, size)
    elif kind < 0.18:
        out = facade(rng, size, size)
    else:
        out = sky(rng, size, size)
        if kind > 0.6:
            tree_line(rng, out)
    return out


# --- things in the air ---------------------------------------------------------------------------------------------


class Sprite:
    """Polygons painted finely on a transparent canvas, premultiplied; in sprite units, canvas `side` units wide."""

    def __init__(self, size_px: float, side: float = 2.4):
        self.fine = 8 if size_px < 30 else 4
        pixels = math.ceil(size_px * side / 2) + 4
        self.n = pixels * self.fine
        self.scale = size_px / 2 * self.fine  # sprite units to fine samples: a unit is half the nominal size
        self.canvas = np.zeros((self.n, self.n, 4), np.float32)
        self.shift = np.zeros(2)

    def xy(self, points: np.ndarray) -> np.ndarray:
        return np.round((np.asarray(points) * self.scale + self.n / 2 + self.shift - 0.5) * 16).astype(np.int32)

    def fill(self, points: np.ndarray, rgb: np.ndarray, alpha: float = 1.0) -> None:
        """A convex polygon [k,2]; alpha < 1 blends (a turning rotor)."""
        points = cv2.convexHull(self.xy(points))
        if alpha >= 1:
            cv2.fillConvexPoly(self.canvas, points, (*map(float, rgb), 1.0), cv2.LINE_8, 4)
            return
        x0, y0 = np.maximum(points.min((0, 1)) // 16 - 1, 0)
        x1, y1 = np.minimum(points.max((0, 1)) // 16 + 2, self.n)
        if x1 <= x0 or y1 <= y0:
            return
        mask = np.zeros((y1 - y0, x1 - x0), np.uint8)
        cv2.fillConvexPoly(mask, points - np.array([x0, y0]) * 16, 1, cv2.LINE_8, 4)
        part = self.canvas[y0:y1, x0:x1]
        part += (alpha * mask[..., None]) * (np.array([*rgb, 1.0], np.float32) - part)

    def line(self, points: np.ndarray, width: float, rgb: np.ndarray) -> None:
        thickness = max(1, round(width * self.scale))
        cv2.polylines(self.canvas, [self.xy(points)], False, (*map(float, rgb), 1.0), thickness, cv2.LINE_8, 4)

    def down(self) -> tuple[np.ndarray, np.ndarray | None]:
        """Pixels [n,n,4], premultiplied, and the tight box, None if it has none: the columns and
        rows of pixels with `COVERED` of it in them, to the fine sample within the outermost."""
        alpha = self.canvas[..., 3]
        small = cv2.resize(self.canvas, None, fx=1 / self.fine, fy=1 / self.fine, interpolation=cv2.INTER_AREA)
        spans = []
        for axis in (0, 1):
            fine = cv2.reduce(alpha, axis, cv2.REDUCE_SUM).ravel()
            good = (fine.reshape(-1, self.fine).sum(1) >= COVERED * self.fine**2).nonzero()[0]
            if len(good) == 0:
                return small, None
            lit = fine > 0  # the first and last fine sample within those pixels
            first, last = good[0] * self.fine, (good[-1] + 1) * self.fine
            spans.append((first + lit[first:last].argmax(), last - lit[first:last][::-1].argmax()))
        (x0, x1), (y0, y1) = spans
        return small, np.array([x0, y0, x1, y1], np.float32) / self.fine


def rotation(rng: Rng, tilt_rad: float, ahead: float = 0.0) -> np.ndarray:
    """World-from-body rotation: random yaw, `ahead` of the time about straight towards the viewer or away, then a tilt of
    normal spread, then a view elevation; rows are view axes right, down, depth."""
    yaw, roll, pitch = rng.uniform(0, 2 * math.pi), rng.normal(0, tilt_rad), rng.normal(0, tilt_rad)
    if rng.random() < ahead:
        yaw = rng.choice((-0.5, 0.5)) * math.pi + rng.normal(0, 0.35)
    # Mostly seen from below or level, at times from far below; sometimes from above or any side.
    kind = rng.random()
    elevation = rng.normal(0.25, 0.35) if kind < 0.65 else rng.uniform(0.2, 1.2) if kind < 0.85 else rng.uniform(-1.5, 1.5)

    def turn(axis: int, a: float) -> np.ndarray:
        i, j = [(1, 2), (2, 0), (0, 1)][axis]
        m = np.eye(3)
        m[i, i] = m[j, j] = math.cos(a)
        m[i, j], m[j, i] = -math.sin(a), math.sin(a)
        return m

    world = turn(1, pitch) @ turn(0, roll) @ turn(2, yaw)  # z up
    view = np.array([[1, 0, 0], [0, -math.sin(elevation), -math.cos(elevation)], [0, math.cos(elevation), -math.sin(elevation)]])
    return view @ world


BOX = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
RING = np.array([[math.cos(a), math.sin(a), 0] for a in np.linspace(0, 2 * math.pi, 16, endpoint=False)])


# How many aeroplanes fly level, within so much tilt [rad], and how many of these come or go: what is near enough to show its shape
# mostly lands or has taken off. The others tilt as in turns. Judged, not measured.
LEVEL, LEVEL_TILT_RAD, AHEAD, TURNING_TILT_RAD = 0.6, 0.08, 0.6, 0.25
BIRD, AEROPLANE, HELICOPTER = 3, 4, 5  # classes of `models.CLASSES` that are drawn here and are no UAVs
Made = tuple[np.ndarray, np.ndarray | None, int]  # a sprite, its box, None if it has none, and its class


def uav(rng: Rng, size_px: float, tone: np.ndarray) -> Made:
    """A UAV about `size_px` wide seen from any side: sprite, its box, class (0 fpv, 1 quadcopter, 2 hexacopter)."""
    label = int(rng.choice(3, p=[0.25, 0.55, 0.2]))
    arms = 6 if label == 2 else 4
    sprite = Sprite(size_px, 3.0)
    sprite.shift = rng.uniform(0, sprite.fine, 2)
    r = rotation(rng, [0.35, 0.12, 0.08][label])
    light = rng.normal(0, 1, 3)
    light /= np.linalg.norm(light)
    parts: list[tuple[float, np.ndarray, np.ndarray, float]] = []  # depth, points, colour, alpha

    def add(points: np.ndarray, shade: float = 1.0, alpha: float = 1.0, rgb: np.ndarray | None = None) -> None:
        p = points @ r.T
        c = (tone if rgb is None else rgb) * shade * rng.uniform(0.8, 1.2)
        parts.append((float(p[:, 2].mean()), p[:, :2], np.clip(c, 0, 255), alpha))

    spread = rng.uniform(0.85, 1.1) if label != 1 else rng.uniform(0.75, 1.15)  # front-back against left-right
    angles = (np.arange(arms) + 0.5) * 2 * math.pi / arms + rng.normal(0, 0.08) * (arms == 4) * np.array([1, -1] * (arms // 2))
    reach, disc = 0.68, rng.uniform(0.28, 0.46) if arms == 4 else rng.uniform(0.22, 0.32)
    long, wide, high = [(0.32, 0.1, 0.07), (0.34, 0.16, 0.1), (0.26, 0.24, 0.11)][label] * rng.uniform(0.6, 1.5, 3)
    hull = BOX * (long, wide, high)
    hull[BOX[:, 2] > 0, :2] *= rng.uniform(0.5, 1)
    for z in (0, 1):  # two shades: top and bottom half
        half = hull.copy()
        half[:, 2] = np.where(hull[:, 2] > 0, high * z, high * (z - 1))
        add(half, 1.15 if z else 0.85)
    thick = rng.uniform(0.02, 0.07)
    prop_z = rng.uniform(0.0, 0.14)
    blur = rng.random() < 0.6
    blade = colour(rng, 10, 200, 5) if rng.random() < 0.4 else tone * rng.uniform(0.5, 1.3)
    fold = rng.uniform(-0.05, 0.12)
    for a in angles:
        d = np.array([math.cos(a) * spread, math.sin(a), 0])
        tip = d * reach + [0, 0, fold]
        side = np.array([-d[1], d[0], 0]) * thick
        up = np.array([0, 0, thick * rng.uniform(0.6, 1.2)])
        add(np.array([s + v + u for s in (d * 0.1, tip) for v in (side, -side) for u in (up, -up)]), rng.uniform(0.7, 1.1))
        motor = rng.uniform(0.04, 0.08)
        add(tip + BOX * (motor, motor, 0.5 * prop_z + 0.05) + [0, 0, prop_z * 0.5], 0.8)
        hub = tip + [0, 0, prop_z + 0.05]
        if blur:
            add(hub + RING * disc, 1.0, rng.uniform(0.03, 0.3), blade)
        if not blur or rng.random() < 0.3:
            phase = rng.uniform(0, math.pi)
            along = np.array([math.cos(phase), math.sin(phase), 0]) * disc
            across = np.array([-math.sin(phase), math.cos(phase), rng.uniform(0.2, 0.8)]) * rng.uniform(0.02, 0.05)
            add(np.array([hub + s * along + t * across for s in (-1, 1) for t in (-1, 1)]), 1.0, rng.uniform(0.5, 1), blade)
        if rng.random() < 0.1:  # a lamp
            add(tip + BOX * 0.05 - [0, 0, 0.08], 1, 1, np.array([[255, 40, 40], [40, 255, 40], [255, 255, 255]][rng.integers(3)]))
    if label and rng.random() < 0.75:  # landing gear: two skids, or a leg under each arm
        drop, stance = rng.uniform(0.15, 0.5), rng.uniform(0.15, 0.5)
        for s in (-1, 1):
            if rng.random() < 0.7:
                add(BOX * (rng.uniform(0.2, 0.4), 0.025, 0.025) + [0, s * stance, -drop], 0.8)
            for f in (-0.15, 0.15):
                top, foot = np.array([f, s * 0.12, -high]), np.array([f * 1.3, s * stance, -drop])
                add(np.array([top, foot, top + [0.04, 0.03, 0], foot + [0.04, 0.03, 0]]), 0.8)
    if rng.random() < 0.6:  # camera or payload below; a battery above
        add(BOX * rng.uniform(0.05, 0.14, 3) + [rng.uniform(-0.1, 0.3), 0, -high - 0.08], rng.uniform(0.5, 1))
    if label == 0 or rng.random() < 0.3:
        add(BOX * (0.2, 0.08, 0.06) + [0, 0, high + 0.04], rng.uniform(0.4, 1.2), 1, colour(rng, 10, 240, 30) if rng.random() < 0.3 else None)
    for _, points, rgb, alpha in sorted(parts, key=lambda part: -part[0]):
        sprite.fill(points, rgb, alpha)
    small, box = sprite.down()
    return small, box, label


def bird(rng: Rng, size_px: float, tone: np.ndarray) -> Made:
    """A bird: body, tail and two wings of two segments each, seen from any side: at any phase of the beat, or spread as
    gulls and raptors glide; the light may come through its wings, or from below on a bright belly."""
    sprite = Sprite(size_px)
    soars = rng.random() < 0.35
    r = rotation(rng, 0.4 if soars else 0.3)
    flap, bend = rng.uniform(-0.9, 1.1), rng.uniform(-1.0, 0.3)
    if soars:
        flap, bend = rng.normal(0.12, 0.1), rng.normal(-0.05, 0.2)
    sweep = rng.uniform(-0.25, 0.4)
    chord = rng.uniform(0.14, 0.34) if not soars else rng.uniform(0.16, 0.45)
    blunt = rng.uniform(0.05, 0.2) if not soars else rng.uniform(0.1, 0.7)  # width of the tips over the chord's
    thin = rng.uniform(1.1, 1.9) if rng.random() < 0.3 else 1.0
    tips = rng.uniform(0.2, 0.7) if rng.random() < 0.4 else 1.0
    for s in (-1, 1):
        elbow = np.array([rng.uniform(0, 0.15), s * 0.45 * math.cos(flap), 0.45 * math.sin(flap)])
        tip = elbow + 0.55 * np.array([-sweep, s * math.cos(flap + bend), math.sin(flap + bend)])
        c = np.array([chord, 0, 0])
        shade = rng.uniform(0.75, 1.2) * thin
        inner, outer = [c / 2, -c / 2, elbow + c / 2, elbow - c / 2], [elbow + c / 2, elbow - c / 2, tip + c * blunt, tip - c * blunt]
        for wing, ink in ((inner, 1.0), (outer, tips)):
            sprite.fill((np.array(wing) @ r.T)[:, :2], np.clip(tone * shade * ink, 0, 255))
    body = RING[:, [0, 1, 2]] * (rng.uniform(0.3, 0.5), rng.uniform(0.07, 0.14), 0)
    body = np.concatenate([body, body[:, [0, 2, 1]]])
    belly = rng.uniform(1.2, 2.2) if rng.random() < 0.25 else rng.uniform(0.8, 1.1)
    sprite.fill((body @ r.T)[:, :2], np.clip(tone * belly, 0, 255))
    fan = rng.uniform(0.06, 0.3) if soars else 0.12
    tail = np.array([[-0.3, 0.03, 0], [-0.3, -0.03, 0], [-0.6, fan, 0], [-0.6, -fan, 0]])
    sprite.fill((tail @ r.T)[:, :2], tone * 0.9)
    return *sprite.down(), BIRD


def aeroplane(rng: Rng, size_px: float, tone: np.ndarray) -> Made:
    """An aeroplane or a glider: fuselage, wings, tail, with jets below the wings, turboprops before them or the disc of a
    propeller; its wheels may be down."""
    sprite = Sprite(size_px)
    r = rotation(rng, LEVEL_TILT_RAD, AHEAD) if rng.random() < LEVEL else rotation(rng, TURNING_TILT_RAD)
    span, sweep, fat = rng.uniform(0.8, 1.1), rng.uniform(0, 0.5), rng.uniform(0.05, 0.12)
    chord = rng.uniform(0.1, 0.3)
    fuselage = np.concatenate([RING * (0.95, fat, 0), (RING * (0.95, fat, 0))[:, [0, 2, 1]]])
    high = rng.uniform(-0.08, 0.1)  # where the wing sits
    kind = rng.random()
    turboprop = 0.4 <= kind < 0.6
    if turboprop:
        sweep, high = rng.uniform(0, 0.15), fat
    rise = 0.35 if turboprop and rng.random() < 0.7 else 0.0  # of a T-tail
    for s in (-1, 1):
        wing = np.array([[chord / 2, 0, high], [-chord / 2, 0, high], [-sweep, s * span, high + 0.08], [-sweep + 0.1, s * span, high + 0.08]])
        tail = np.array([[-0.75, 0, rise], [-0.95, 0, rise], [-1.0, s * 0.35, rise], [-0.9, s * 0.35, rise]])
        sprite.fill((wing @ r.T)[:, :2], tone * rng.uniform(0.8, 1.2))
        sprite.fill((tail @ r.T)[:, :2], tone)
        if kind < 0.4:  # jets
            engine = BOX * (0.12, 0.05, 0.05) + [0.02 - 0.3 * sweep, s * 0.33, high - 0.08]
            sprite.fill((engine @ r.T)[:, :2], tone * rng.uniform(0.6, 1.1))
        if turboprop:
            nacelle = BOX * (0.15, 0.04, 0.04) + [0.15, s * 0.3, high - 0.02]
            disc = RING[:, [2, 0, 1]] * rng.uniform(0.12, 0.17) + [0.32, s * 0.3, high - 0.02]
            sprite.fill((nacelle @ r.T)[:, :2], tone * rng.uniform(0.6, 1.1))
            sprite.fill((disc @ r.T)[:, :2], tone * rng.uniform(0.5, 1.2), rng.uniform(0.05, 0.4))
    fin = np.array([[-0.7, 0, 0], [-0.95, 0, 0], [-1.0, 0, 0.35], [-0.9, 0, 0.35]])
    sprite.fill((fin @ r.T)[:, :2], tone * rng.uniform(0.7, 1.3))
    sprite.fill((fuselage @ r.T)[:, :2], tone)
    if kind > 0.6:  # a propeller
        disc = RING[:, [2, 0, 1]] * rng.uniform(0.15, 0.25) + [0.95, 0, 0]
        sprite.fill((disc @ r.T)[:, :2], tone * rng.uniform(0.5, 1.2), rng.uniform(0.05, 0.3))
    if rng.random() < (0.6 if kind > 0.6 else 0.4):
        for at in ((0.7, 0), (0, -0.15), (0, 0.15)):
            wheel = BOX * (0.04, 0.02, 0.06) + [*at, -fat - 0.05]
            sprite.fill((wheel @ r.T)[:, :2], tone * rng.uniform(0.3, 0.8))
    return *sprite.down(), AEROPLANE


def helicopter(rng: Rng, size_px: float, tone: np.ndarray) -> Made:
    """A helicopter: cabin, tail boom with fin, skids, a main rotor as blades or as a pale disc."""
    sprite = Sprite(size_px, 3.0)
    r = rotation(rng, 0.12)
    tail, cabin, girth = rng.uniform(0.85, 1.1), rng.uniform(0.22, 0.34), rng.uniform(0.1, 0.2)
    second = colour(rng, 10, 230, 20) if rng.random() < 0.4 else tone
    parts: list[tuple[np.ndarray, np.ndarray, float]] = []
    hull = np.concatenate([RING * (cabin, girth, 0), (RING * (cabin, girth, 0))[:, [0, 2, 1]]]) + [0.15, 0, 0]
    root = girth * rng.uniform(0.25, 0.5)
    boom = np.concatenate([BOX[BOX[:, 0] > 0] * (1, root, root) - [1, 0, 0], BOX[BOX[:, 0] < 0] * (1, 0.02, 0.02) + [1 - tail, 0, 0.08]])
    fin = np.array([[-tail, 0, 0.05], [-tail + 0.2, 0, 0.05], [-tail - 0.05, 0, 0.35], [-tail + 0.08, 0, 0.35]])
    if rng.random() < 0.65:
        for s in (-1, 1):
            parts.append((BOX * (0.33, 0.015, 0.015) + [0.15, s * girth * 1.1, -girth - 0.12], tone, 0.6))
            for x in (0.0, 0.3):
                parts.append((BOX * (0.015, 0.015, 0.09) + [x, s * girth, -girth - 0.04], tone, 0.6))
    parts += [(boom, tone, 0.9), (fin, second, 1.0), (hull, tone, 1.0)]
    glass = hull[hull[:, 0] > 0.3]
    if len(glass) > 2:
        parts.append((glass, np.full(3, rng.uniform(10, 90)), 1.0))
    parts.append((BOX * (0.2, girth * 0.6, 0.06) + [0.02, 0, girth], second, 0.9))
    for points, ink, shade in parts:
        sprite.fill((points @ r.T)[:, :2], np.clip(ink * shade * rng.uniform(0.85, 1.15), 0, 255))
    hub = np.array([0.05, 0, girth + 0.14])
    sprite.fill(((BOX * (0.03, 0.03, 0.09) + hub - [0, 0, 0.08]) @ r.T)[:, :2], tone * 0.6)
    radius, dark = rng.uniform(0.75, 1.0), tone * rng.uniform(0.3, 0.9)
    sprite.fill(((RING * radius + hub) @ r.T)[:, :2], dark, rng.uniform(0.02, 0.2))
    if rng.random() < 0.75:
        blades, phase = int(rng.integers(2, 6)), rng.uniform(0, math.pi)
        for turn in phase + 2 * math.pi * np.arange(blades) / blades:
            along, across = np.array([math.cos(turn), math.sin(turn), 0.05]), np.array([-math.sin(turn), math.cos(turn), 0]) * 0.02
            blade = np.array([hub + across, hub - across, hub + along * radius + across, hub + along * radius - across])
            sprite.fill((blade @ r.T)[:, :2], dark, rng.uniform(0.4, 1))
    back = RING[:, [0, 2, 1]] * rng.uniform(0.1, 0.17) + [-tail, 0.03, 0.15]
    sprite.fill((back @ r.T)[:, :2], dark, rng.uniform(0.1, 0.5))
    return *sprite.down(), HELICOPTER


def blob(rng: Rng, size_px: float, tone: np.ndarray) -> np.ndarray:
    """A balloon, an insect out of focus, a leaf, a scrap: an ellipse or a ragged polygon, sharp or smeared."""
    sprite = Sprite(size_px)
    count = 16 if rng.random() < 0.5 else int(rng.integers(3, 8))
    a = np.sort(rng.uniform(0, 2 * math.pi, count))
    radius = rng.uniform(0.5, 1) if count < 16 else 1.0
    points = np.stack([np.cos(a), np.sin(a)], 1) * radius * (1, rng.uniform(0.15, 1))
    turn = rng.uniform(0, math.pi)
    points = points @ np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    sprite.fill(points, tone)
    small = sprite.down()[0]
    if rng.random() < 0.4:
        small = cv2.GaussianBlur(small, (0, 0), rng.uniform(0.1, 0.25) * size_px)
    return small * np.float32(rng.uniform(0.4, 1))


def house(rng: Rng, size_px: float, tone: np.ndarray) -> np.ndarray:
    """A far farmhouse, church or shed: blocks with roofs and windows, a tower, trunks before them."""
    sprite = Sprite(size_px)
    box = lambda x0, y0, x1, y1: np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])  # noqa: E731
    wall = colour(rng, 130, 250, 10) if rng.random() < 0.6 else tone
    roof, pane, base, x = colour(rng, 25, 170, 25), colour(rng, 10, 90, 8), rng.uniform(0.2, 0.6), -1.0
    while x < 0.9:
        end, top = min(x + rng.uniform(0.2, 1.2), 1.0), base - rng.uniform(0.1, 0.6)
        sprite.fill(box(x, top, end, base), wall * rng.uniform(0.7, 1.05))
        if rng.random() < 0.75:
            ridge, inset = top - rng.uniform(0.06, 0.4), rng.uniform(0, 0.5) * (end - x)
            gable = np.array([[x - 0.03, top], [end + 0.03, top], [end - inset, ridge], [x + inset, ridge]])
            sprite.fill(gable, roof if rng.random() < 0.7 else wall * 0.9)
        for at in np.linspace(x, end, int(rng.integers(0, 5)) + 2)[1:-1]:
            half, y = rng.uniform(0.02, 0.06), rng.uniform(top, base)
            sprite.fill(box(at - half, y - 1.5 * half, at + half, y + 1.5 * half), pane)
        x = end + (rng.uniform(0, 0.4) if rng.random() < 0.3 else 0.0)
    if rng.random() < 0.3:
        at, half, top = rng.uniform(-0.9, 0.9), rng.uniform(0.06, 0.16), base - rng.uniform(0.5, 1.0)
        sprite.fill(box(at - half, top, at + half, base), wall)
        sprite.fill(np.array([[at - half, top], [at + half, top], [at, top - rng.uniform(0.1, 0.6)]]), roof)
    trunk = colour(rng, 15, 110, 10)
    for _ in range(int(rng.integers(0, 6))):
        at = rng.uniform(-1, 1)
        sprite.line(np.array([[at, -1.2], [at + rng.normal(0, 0.05), base]]), rng.uniform(0.02, 0.08), trunk)
    return sprite.down()[0]


def streak(rng: Rng, size_px: float, tone: np.ndarray) -> np.ndarray:
    """A thing too fast for the exposure, a scratch, a drop of rain."""
    sprite = Sprite(size_px)
    turn = rng.uniform(0, 2 * math.pi)
    end = np.array([math.cos(turn), math.sin(turn)])
    sprite.line(np.array([-end, rng.normal(0, 0.1, 2), end]), rng.uniform(0.03, 0.25), tone)
    return cv2.GaussianBlur(sprite.down()[0], (0, 0), rng.uniform(0.3, 1.5)) * np.float32(rng.uniform(0.2, 0.9))


def twig(rng: Rng, size: int, tone: np.ndarray) -> np.ndarray:
    """Branches with or without leaves, wires, a pole, a lattice, a crane's jib, mastheads: lines [size,size,4] over the crop."""
    fine = 2
    canvas = np.zeros((size * fine, size * fine, 4), np.float32)
    ink = (*map(float, tone), 1.0)

    def draw(points: np.ndarray, width: float) -> None:
        cv2.polylines(canvas, [np.round(points * fine * 16).astype(np.int32)], False, ink, max(1, round(width * fine)), cv2.LINE_AA, 4)

    kind = rng.uniform(0, 1.35)
    if kind < 0.45:  # branches
        for _ in range(int(rng.integers(1, 4))):
            point, heading = rng.uniform(0, size, 2), rng.uniform(0, 2 * math.pi)
            point[rng.integers(2)] = rng.choice([0, size])
            width, leaves = rng.uniform(0.6, 4), rng.random() < 0.5
            stack = [(point, heading, width)]
            while stack and len(stack) < 12:
                point, heading, width = stack.pop()
                path = [point]
                for _ in range(int(rng.integers(3, 9))):
                    heading += rng.normal(0, 0.35)
                    path.append(path[-1] + rng.uniform(4, 14) * np.array([math.cos(heading), math.sin(heading)]))
                    if rng.random() < 0.3 and width > 0.6:
                        stack.append((path[-1], heading + rng.choice([-1, 1]) * rng.uniform(0.4, 1.1), width * 0.6))
                    if leaves and rng.random() < 0.6:
                        axes = np.round(rng.uniform(1, 5, 2) * fine * 16).astype(int)
                        at = np.round((path[-1] + rng.normal(0, 4, 2)) * fine * 16).astype(int)
                        cv2.ellipse(canvas, at.tolist(), axes.tolist(), rng.uniform(0, 180), 0, 360, ink, -1, cv2.LINE_AA, 4)
                draw(np.array(path), width)
    elif kind < 0.75:  # wires, with or without a pole
        slope, sag = rng.normal(0, 0.4), rng.uniform(0, 30)
        x = np.linspace(-10, size + 10, 20)
        y, gap = rng.uniform(0, size), rng.uniform(4, 30)
        for k in range(int(rng.integers(1, 6))):
            draw(np.stack([x, y + k * gap + slope * (x - size / 2) + sag * np.sin(x / size * math.pi)], 1), rng.uniform(0.4, 2))
    elif kind > 1:  # masts of boats and roofs with lamps, vanes, cups and aerials on top
        for _ in range(int(rng.integers(1, 4))):
            top = np.array([rng.uniform(0, size), rng.uniform(0, 0.85 * size)])
            foot = np.array([top[0] + rng.normal(0, 0.02) * size, size + 5])
            reach = math.exp(rng.normal(math.log(5), 0.5))  # [px]
            draw(np.stack([top, foot]), rng.uniform(0.5, 3))
            for _ in range(int(rng.integers(2, 7))):
                middle = top + rng.uniform((-0.8, -0.6), (0.8, 0.2)) * reach
                turn = rng.choice([0, math.pi / 2, rng.uniform(0, math.pi)], p=[0.5, 0.3, 0.2])
                half = rng.uniform(0.15, 0.7) * reach * np.array([math.cos(turn), math.sin(turn)])
                draw(np.stack([middle - half, middle + half]), rng.uniform(0.4, 1.8))
            if rng.random() < 0.5:
                for side in (-1, 1):
                    draw(np.stack([top, foot + (side * rng.uniform(5, 40), 0)]), rng.uniform(0.3, 0.7))
    if 0.65 < kind <= 1:  # pole, mast or lattice
        x, wide, top = rng.uniform(0, size), rng.uniform(1, 14), rng.uniform(-size, 0.8 * size)
        lean = rng.normal(0, 0.03) * size
        if rng.random() < 0.5:
            draw(np.array([[x + lean, top], [x, size + 5]]), wide)
        else:
            rungs = np.arange(top, size + wide, wide * rng.uniform(0.7, 1.5))
            side = np.where(np.arange(len(rungs)) % 2, 1, -1) * wide / 2
            bar = rng.uniform(0.5, 1.5)
            draw(np.stack([x + side, rungs], 1), bar)
            for s in (-1, 1):
                draw(np.array([[x + s * wide / 2, top], [x + s * wide / 2, size + 5]]), bar)
        for _ in range(int(rng.integers(0, 4))):  # cross arms, antennas, lamps
            y, reach = rng.uniform(max(top, 0), size), rng.uniform(5, 60)
            draw(np.array([[x - reach * rng.random(), y], [x + reach, y + rng.normal(0, 3)]]), rng.uniform(0.6, 4))
    out = cv2.resize(canvas, (size, size), interpolation=cv2.INTER_AREA)
    if rng.random() < 0.3:
        out = cv2.GaussianBlur(out, (0, 0), rng.uniform(0.5, 3))
    return cv2.rotate(out, cv2.ROTATE_90_CLOCKWISE) if rng.random() < 0.2 else out


def paste(picture: np.ndarray, sprite: np.ndarray, x: int, y: int) -> tuple[slice, slice] | None:
    """Composes a premultiplied sprite with its corner at (x, y), in place; the part of the sprite inside, or None."""
    h, w = picture.shape[:2]
    sh, sw = sprite.shape[:2]
    x0, y0, x1, y1 = max(x, 0), max(y, 0), min(x + sw, w), min(y + sh, h)
    if x1 <= x0 or y1 <= y0:
        return None
    inside = (slice(y0 - y, y1 - y), slice(x0 - x, x1 - x))
    part, cut = picture[y0:y1, x0:x1], sprite[inside]
    part *= 1 - cut[..., 3:]
    part += cut[..., :3]
    return inside


def tone_against(rng: Rng, picture: np.ndarray, x: float, y: float, reach: float, least: float = 12.0) -> np.ndarray:
    """A colour [3] for a thing at (x, y): darker than the surround as a rule, `least` of 255 away from it."""
    h, w = picture.shape[:2]
    x0, y0 = int(np.clip(x - reach, 0, w - 2)), int(np.clip(y - reach, 0, h - 2))
    around = picture[y0 : max(int(y + reach), y0) + 1, x0 : max(int(x + reach), x0) + 1].mean((0, 1))
    level = float(around @ LUMA)
    for _ in range(8):
        kind = rng.random()
        if kind < 0.5:
            tone = rng.uniform(0, 0.7) * level + rng.normal(0, 5, 3)  # in shade against the light
        elif kind < 0.8:
            tone = rng.uniform(5, 110) + rng.normal(0, 10, 3)
        else:
            tone = rng.uniform(130, 255) + rng.normal(0, 10, 3)
        tone += (around - tone) * rng.uniform(0, 0.5) * (rng.random() < 0.4)  # haze in front of it
        if abs(float(tone @ LUMA) - level) > least:
            break
    return np.clip(tone, 0, 255).astype(np.float32)


def target_size(rng: Rng) -> float:
    """Long side of a target [px]: log-normal about 13 px, 3..70; one in seven evenly over its logarithm, 30..150."""
    if rng.random() < 0.15:
        return float(math.exp(rng.uniform(math.log(30), math.log(150))))
    return float(np.clip(math.exp(rng.normal(math.log(13), 0.65)), 3, 70))


def overlap(box: np.ndarray, others: np.ndarray) -> float:
    """Largest part of any of `others` [n,4] that `box` covers, 0..1."""
    if not len(others):
        return 0.0
    side = np.minimum(box[2:], others[:, 2:]) - np.maximum(box[:2], others[:, :2])
    inner = np.clip(side, 0, None).prod(1)
    return float((inner / np.clip((others[:, 2:] - others[:, :2]).prod(1), 1e-6, None)).max())


def add(
    rng: Rng, picture: np.ndarray, maker: Callable[[Rng, float, np.ndarray], Made], size: float, at: tuple[float, float],
    boxes: np.ndarray, labels: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Composes what `maker` draws at a place, in place, where it is clear of the given boxes and can be told from what
    is behind it; boxes [n,4] and labels [n] of all."""
    h, w = picture.shape[:2]
    sprite, box, label = maker(rng, size, tone_against(rng, picture, *at, size / 2 + 2))
    if box is None or max(box[2:] - box[:2]) < 2.5:
        return boxes, labels
    x, y = round(at[0] - sprite.shape[1] / 2), round(at[1] - sprite.shape[0] / 2)
    full = box + (x, y, x, y)
    seen = np.clip(full, 0, (w, h, w, h))
    if (seen[2:] - seen[:2]).prod() < 0.6 * (full[2:] - full[:2]).prod() or min(seen[2:] - seen[:2]) < 1:
        return boxes, labels
    if overlap(seen + (-4, -4, 4, 4), boxes) > 0:
        return boxes, labels
    y0, x0, y1, x1 = max(y, 0), max(x, 0), y + sprite.shape[0], x + sprite.shape[1]
    part = picture[y0:y1, x0:x1]
    before = part.copy()
    paste(picture, sprite, x, y)
    if np.abs((part - before) @ LUMA).max() < max(12, 1.2 * float((before @ LUMA).std())):  # nobody could tell it apart
        part[:] = before
        return boxes, labels
    return np.concatenate([boxes, seen[None]]).astype(np.float32), np.concatenate([labels, [label]]).astype(np.int64)


def add_uavs(rng: Rng, picture: np.ndarray, count: int, boxes: np.ndarray, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Composes up to `count` procedural UAVs clear of the given ones; boxes [n,4] and labels [n] of all."""
    h, w = picture.shape[:2]
    for _ in range(count):
        boxes, labels = add(rng, picture, uav, target_size(rng), (rng.uniform(0, w), rng.uniform(0, h)), boxes, labels)
    return boxes, labels


def add_flyers(rng: Rng, picture: np.ndarray, boxes: np.ndarray, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Composes birds, in flocks at times, aeroplanes and helicopters; boxes [n,4] and labels [n] of all."""
    h, w = picture.shape[:2]
    flock = rng.random() < 0.2
    maker = bird if flock else (bird, bird, aeroplane, helicopter)[rng.integers(4)]
    size, middle = target_size(rng), rng.uniform(0, (w, h))
    for _ in range(int(rng.integers(3, 9) if flock else rng.integers(1, 3))):
        at = middle + rng.normal(0, 3 * size, 2) if flock else rng.uniform(0, (w, h))
        boxes, labels = add(rng, picture, maker, size * rng.uniform(0.7, 1.3), tuple(at), boxes, labels)
    return boxes, labels


def add_clutter(rng: Rng, picture: np.ndarray, boxes: np.ndarray) -> None:
    """Things without a class, in place, clear of what has one: twigs, wires, houses, blobs, streaks."""
    h, w = picture.shape[:2]

    def put(maker: Callable[[Rng, float, np.ndarray], np.ndarray], size: float) -> None:
        cx, cy = rng.uniform(0, w), rng.uniform(0, h)
        sprite = maker(rng, size, tone_against(rng, picture, cx, cy, size / 2 + 2, 0))
        x, y = round(cx - sprite.shape[1] / 2), round(cy - sprite.shape[0] / 2)
        if overlap(np.array([x, y, x + sprite.shape[1], y + sprite.shape[0]], float), boxes) < 0.02:
            paste(picture, sprite, x, y)

    if rng.random() < 0.4:
        near = rng.uniform(5, 120) * rng.uniform(0.3, 1)
        lines = twig(rng, max(h, w), np.clip(near + rng.normal(0, 8, 3), 0, 255).astype(np.float32))[:h, :w]
        hidden = [lines[int(y0) : math.ceil(y1), int(x0) : math.ceil(x1), 3].mean() for x0, y0, x1, y1 in boxes]
        if max(hidden, default=0) < 0.12:
            paste(picture, lines, 0, 0)
    if rng.random() < 0.25:
        for _ in range(int(rng.integers(1, 4))):
            put(house, float(np.clip(math.exp(rng.normal(math.log(26), 0.7)), 6, 120)))
    if rng.random() < 0.3:
        size = float(np.clip(math.exp(rng.normal(math.log(11), 0.7)), 3, 80))
        for _ in range(int(rng.integers(1, 4))):
            put((blob, streak)[rng.integers(2)], size * rng.uniform(0.7, 1.3))


# --- camera --------------------------------------------------------------------------------------------------------


def exposure(rng: Rng, x: np.ndarray) -> np.ndarray:
    """Gain, black level, contrast, gamma, white balance and saturation as one table and one colour matrix."""
    if rng.random() < 0.75:
        grid = np.linspace(0, 1, 256, dtype=np.float32)
        table = grid ** math.exp(rng.normal(0, 0.22)) * math.exp(rng.normal(0, 0.2))
        pivot, contrast = rng.uniform(0.2, 0.8), math.exp(rng.normal(0, 0.18))
        table = (table - pivot) * contrast + pivot + rng.normal(0, 0.04)
        tables = table[:, None] * np.exp(rng.normal(0, 0.06, 3)).astype(np.float32)[None]
        x = cv2.LUT(np.clip(x, 0, 255).astype(np.uint8), (np.clip(tables, 0, 1) * 255).astype(np.float32)[None])
    if rng.random() < 0.6:
        keep = rng.uniform(0, 1.6) if rng.random() < 0.8 else 0.0
        matrix = keep * np.eye(3) + (1 - keep) * LUMA[None].repeat(3, 0)
        turn = rng.normal(0, 0.1)  # hue: rotation about the grey axis
        k = np.full((3, 3), 1 / 3)
        q = np.array([[0, -1, 1], [1, 0, -1], [-1, 1, 0]]) / math.sqrt(3)
        x = cv2.transform(x, (matrix @ (k + math.cos(turn) * (np.eye(3) - k) + math.sin(turn) * q)).astype(np.float32))
    return x


def lens(rng: Rng, x: np.ndarray) -> np.ndarray:
    """Fog, uneven brightness, defocus, motion blur."""
    h, w = x.shape[:2]
    if rng.random() < 0.15:
        x = x + rng.uniform(0, 0.55) * (colour(rng, 120, 245, 6) - x)
    if rng.random() < 0.2:
        x = x * (1 + rng.uniform(0.02, 0.15) * texture(rng, h, w, 128, 64))[..., None]
    if rng.random() < 0.55:
        x = cv2.GaussianBlur(x, (0, 0), rng.uniform(0.3, 1.3))
    if rng.random() < 0.15:
        length, turn = rng.uniform(1.5, 5), rng.uniform(0, math.pi)
        kernel = np.zeros((9, 9), np.float32)
        d = np.array([math.cos(turn), math.sin(turn)]) * length / 2
        a, b = np.round((np.array([4, 4]) - d) * 16).astype(int), np.round((np.array([4, 4]) + d) * 16).astype(int)
        cv2.line(kernel, a.tolist(), b.tolist(), 1.0, 1, cv2.LINE_AA, 4)
        x = cv2.filter2D(x, -1, kernel / kernel.sum())
    return x


def interlace(rng: Rng, x: np.ndarray) -> np.ndarray:
    """Every other line as the camera saw it a fiftieth of a second earlier: moved sideways."""
    moved = cv2.warpAffine(x, np.float32([[1, 0, rng.uniform(-4, 4)], [0, 1, 0]]), x.shape[1::-1], borderMode=cv2.BORDER_REPLICATE)
    x = x.copy()
    x[1::2] = moved[1::2]
    return x


def camera(rng: Rng, x: np.ndarray) -> np.ndarray:
    """What a video camera adds: interlacing, sensor noise, sharpening halos, colour fringes, coarse chroma, compression. uint8."""
    h, w = x.shape[:2]
    if rng.random() < 0.05:
        x = interlace(rng, x)
    if rng.random() < 0.7:
        read, shot = abs(rng.normal(0, 2.5)), abs(rng.normal(0, 0.25))
        sigma = np.sqrt(read**2 + shot**2 * np.clip(x, 0, None))
        grain = noise(rng, (h, w, 3))
        if rng.random() < 0.4:  # demosaicing and noise reduction correlate the grain
            grain = cv2.GaussianBlur(grain, (0, 0), s := rng.uniform(0.4, 1.0)) * (1 + 2 * s)
        x = x + sigma * grain
    small = rng.uniform(0.5, 0.9) if rng.random() < 0.2 else 1.0  # a stream scaled down and up again
    if small < 1:
        x = cv2.resize(x, (round(w * small), round(h * small)), interpolation=cv2.INTER_AREA)
        x = cv2.resize(x, (w, h), interpolation=[cv2.INTER_LINEAR, cv2.INTER_CUBIC][rng.integers(2)])
    if rng.random() < 0.5:
        soft = cv2.GaussianBlur(x, (0, 0), rng.uniform(0.7, 2.0))
        x = x + rng.uniform(0.2, 1.8) * (x - soft)
    if rng.random() < 0.5:
        ycc = cv2.cvtColor(np.clip(x, 0, 255) / 255, cv2.COLOR_RGB2YCrCb)
        chroma = ycc[..., 1:]
        if rng.random() < 0.5:  # lateral colour: chroma beside the luma
            shift = np.eye(2, 3, dtype=np.float32)
            shift[:, 2] = rng.uniform(-1, 1, 2)
            chroma = cv2.warpAffine(chroma, shift, (w, h), borderMode=cv2.BORDER_REPLICATE)
        if rng.random() < 0.3:  # purple or blue fringe at edges
            edge = cv2.absdiff(ycc[..., 0], cv2.GaussianBlur(ycc[..., 0], (0, 0), 1.2))
            chroma = chroma + edge[..., None] * rng.uniform(-0.3, 0.6, 2).astype(np.float32)
        if rng.random() < 0.7:
            half = cv2.resize(chroma, (w // 2, h // 2), interpolation=cv2.INTER_AREA)
            chroma = cv2.resize(half, (w, h), interpolation=cv2.INTER_LINEAR)
        ycc[..., 1:] = chroma
        x = cv2.cvtColor(ycc, cv2.COLOR_YCrCb2RGB) * 255
    x = np.clip(x + 0.5, 0, 255).astype(np.uint8)
    if rng.random() < 0.65:
        quality = int(rng.uniform(25, 95))
        ok, data = cv2.imencode(".jpg", cv2.cvtColor(x, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, quality])
        if ok:
            x = cv2.cvtColor(cv2.imdecode(data, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    return x


def mirror(boxes: np.ndarray, width: int) -> np.ndarray:
    """Boxes of a picture mirrored left-right."""
    return np.stack([width - boxes[:, 2], boxes[:, 1], width - boxes[:, 0], boxes[:, 3]], 1)
