"""The paper's rule and its control laws, eqs. 8 to 10, on directions that were recorded.

The paper has no association of its own: the target is what the detector sees nearest to the centre of a picture, and
eqs. 9 and 10 turn the coarse and the precise camera towards it. So what eq. 10 is worth to a tracker is whether the
camera still looks at the same thing when the next picture comes. It can be read in two ways, see `READINGS`.

Frames: `enu` is east, north, up; `cam` is x right, y down, z along the axis. Quaternions are (x, y, z, w), turn `cam`
into `enu`, and multiply as rotations do.
"""

import dataclasses
import math
import statistics

import numpy as np

# Δt in eq. 10's update q ← q (I + Δt/2 Ω(u)) for a frame of so many seconds. As printed it is the frame's time, which
# makes a loop of 0.005 rad/s. Eq. 9 has no such factor; with one frame as the unit of time eq. 10 is its counterpart.
READINGS = {"seconds": lambda frame_s: frame_s, "frames": lambda frame_s: 1.0}
# Beside the printed gains: where sat() ends, which is not printed, as a share of the field. Boresight's own assumption.
SATURATION_SHARE = 0.25


@dataclasses.dataclass(frozen=True)
class Law:
    """Gains of eq. 9 or 10: `kp`, `ki_per_s` [1/s], `kd_s` [s]."""

    kp: float
    ki_per_s: float
    kd_s: float


COARSE = Law(0.015, 0.002, 0.001)
PRECISE = Law(0.005, 0.0005, 0.001)


class Pid:
    """u = Kp sat(e) + Ki ∫e dτ + Kd de/dt of a two-dimensional error, x right and y down [rad]."""

    def __init__(self, law, limit_rad=math.inf):
        self.law, self.limit_rad = law, limit_rad
        self.integral_rad_s, self.before_rad = np.zeros(2), None

    def step(self, error_rad, frame_s):
        """The output, shape (2,) [rad], for the error of one frame of `frame_s` seconds; only the first term saturates."""
        error_rad = np.asarray(error_rad, float)
        self.integral_rad_s = self.integral_rad_s + error_rad * frame_s
        slope = np.zeros(2) if self.before_rad is None else (error_rad - self.before_rad) / frame_s
        self.before_rad = error_rad
        first = np.clip(error_rad, -self.limit_rad, self.limit_rad)
        return self.law.kp * first + self.law.ki_per_s * self.integral_rad_s + self.law.kd_s * slope


def product(a, b):
    """Product of two quaternions, shape (4,)."""
    (ax, ay, az, aw), (bx, by, bz, bw) = a, b
    return np.array([
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ])


def inverse(q):
    """The opposite turn of a unit quaternion."""
    return np.array([-q[0], -q[1], -q[2], q[3]])


def turned(q, v):
    """A vector, shape (3,), turned by a unit quaternion."""
    return product(product(q, np.array([*v, 0.0])), inverse(q))[:3]


def looking(ray_enu):
    """Attitude of a level camera whose axis is the unit vector `ray_enu`, shape (3,)."""
    azimuth, elevation = math.atan2(ray_enu[0], ray_enu[1]), math.asin(ray_enu[2])
    # Columns: where the picture's right, its down and the axis point.
    right = np.array([math.cos(azimuth), -math.sin(azimuth), 0.0])
    axis = np.array([math.sin(azimuth) * math.cos(elevation), math.cos(azimuth) * math.cos(elevation), math.sin(elevation)])
    m = np.column_stack([right, np.cross(axis, right), axis])
    # Of the four ways to a quaternion the one that divides by the largest number.
    squares = np.array([
        1 + m[0, 0] - m[1, 1] - m[2, 2], 1 - m[0, 0] + m[1, 1] - m[2, 2],
        1 - m[0, 0] - m[1, 1] + m[2, 2], 1 + m[0, 0] + m[1, 1] + m[2, 2],
    ])
    columns = np.array([
        [squares[0], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[2, 1] - m[1, 2]],
        [m[0, 1] + m[1, 0], squares[1], m[1, 2] + m[2, 1], m[0, 2] - m[2, 0]],
        [m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], squares[2], m[1, 0] - m[0, 1]],
        [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], squares[3]],
    ])
    row = columns[int(np.argmax(squares))]
    return row / np.linalg.norm(row)


def coarse_update(q, u_rad):
    """Eq. 9: q ← q exp(½ [0, u_y, u_x]). About a camera's x axis (y points down) a positive turn looks up: hence −u_y."""
    size = math.hypot(*u_rad)
    half = 0.5 if size == 0 else math.sin(0.5 * size) / size
    return product(q, np.array([-half * u_rad[1], half * u_rad[0], 0.0, math.cos(0.5 * size)]))


def precise_update(q, u_rad, factor):
    """Eq. 10: q ← q (I + Δt/2 Ω(u)), to unit length again; `factor` is Δt in one of its `READINGS`."""
    step = q + product(q, 0.5 * factor * np.array([-u_rad[1], u_rad[0], 0.0, 0.0]))
    return step / np.linalg.norm(step)


@dataclasses.dataclass(frozen=True)
class Field:
    """Half a camera's field: tangents of the half angles, right and down."""

    half_x: float
    half_y: float

    def error_rad(self, q, ray_enu):
        """Eq. 8's linear angle from the axis, right and down, shape (2,) [rad]; None outside the picture."""
        x, y, z = turned(inverse(q), ray_enu)
        if z <= 0 or abs(x) > self.half_x * z or abs(y) > self.half_y * z:
            return None
        return np.array([x / z / self.half_x * math.atan(self.half_x), y / z / self.half_y * math.atan(self.half_y)])


class Pursuit:
    """A coarse and a precise camera that follow what is nearest to their centres.

    The precise line of sight rides on the coarse one, as a mirror on a mount does. `coarse` and `precise` are `Field`s.
    Both begin with their axes on `ray_enu`. Mount and mirror are ideal: an attitude is there as soon as it is set.
    """

    def __init__(self, reading, coarse, precise, ray_enu):
        self.factor = READINGS[reading]
        self.coarse, self.precise = coarse, precise
        self.q_coarse = self.q_precise = looking(ray_enu)
        # Eq. 9 has no sat().
        self.coarse_pid = Pid(COARSE)
        self.precise_pid = Pid(PRECISE, SATURATION_SHARE * 2 * math.atan(precise.half_x))

    def look(self, precise, rays_enu, frame_s):
        """Takes one picture in; returns the direction that it follows, or None if it sees nothing."""
        field, q = (self.precise, self.q_precise) if precise else (self.coarse, self.q_coarse)
        seen = [(error, ray) for ray in rays_enu if (error := field.error_rad(q, ray)) is not None]
        if not seen:
            return None
        error_rad, ray = min(seen, key=lambda pair: math.hypot(*pair[0]))
        if precise:
            u_rad = self.precise_pid.step(error_rad, frame_s)
            self.q_precise = precise_update(self.q_precise, u_rad, self.factor(frame_s))
        else:
            updated = coarse_update(self.q_coarse, self.coarse_pid.step(error_rad, frame_s))
            self.q_precise = product(updated, product(inverse(self.q_coarse), self.q_precise))
            self.q_coarse = updated
        return ray

    def axis_enu(self):
        """Where the precise camera looks, a unit vector."""
        return turned(self.q_precise, (0.0, 0.0, 1.0))


def pursue(reading, run):
    """The paper's rule on a recording: its target at each tick, and the axis's rms distance from the designated UAV [mrad].

    It begins with both axes on the first box that lies on the designated UAV after the first hold.
    """
    # Reading recordings wants more than the laws, which a test looks at alone.
    from rivals_recording import CUTOFF_MRAD, FRESH_S

    tier = {camera.tier: (name, camera) for name, camera in run.cameras.items()}
    fields = {
        name: Field(0.5 * camera.width_px / camera.focal_px, 0.5 * camera.height_px / camera.focal_px)
        for name, camera in tier.values()
    }
    (coarse, camera), (precise, _) = tier["coarse"], tier["precise"]
    pursuit, followed, next_scan, targets, misses = None, {}, 0, [], []
    for index, tick in enumerate(run.ticks):
        place = dict(run.truth[tick]).get(run.uavs[0])
        while next_scan < len(run.scans) and run.scans[next_scan].known <= tick:
            scan = run.scans[next_scan]
            next_scan += 1
            rays = [box.ray for box in scan.found if box.score >= scan.threshold]
            if index < run.first or scan.camera not in (coarse, precise):
                continue
            if pursuit is None:
                seen = dict(run.in_camera.get((scan.exposure, scan.camera), [])).get(run.uavs[0])
                if seen is None:
                    continue
                on = run.cameras[scan.camera].ray(run.rotation[scan.exposure][scan.camera], seen)
                near = [ray for ray in rays if 1e3 * np.linalg.norm(ray - on) < CUTOFF_MRAD]
                if not near:
                    continue
                start = min(near, key=lambda ray: np.linalg.norm(ray - on))
                pursuit = Pursuit(reading, fields[coarse], fields[precise], start)
            frame_s = run.cameras[scan.camera].period_ticks / run.tick_hz
            ray = pursuit.look(scan.camera == precise, rays, frame_s)
            if ray is not None:
                followed[scan.camera] = scan.exposure, ray
        rotation, target = run.rotation[tick][coarse], None
        for name in (precise, coarse):
            exposed, ray = followed.get(name, (None, None))
            if target is None and ray is not None and tick - exposed < FRESH_S * run.tick_hz:
                px = camera.project(rotation, ray)
                target = px and (1, *px)
        targets.append(target)
        if pursuit is not None and place is not None:
            misses.append(1e6 * np.sum((pursuit.axis_enu() - camera.ray(rotation, place)) ** 2))
    return targets, math.sqrt(statistics.fmean(misses)) if misses else None
