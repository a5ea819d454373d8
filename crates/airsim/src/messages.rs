//! What the clients get: maps whose keys are those of AirSim's own types. All frames are AirSim's, see [`crate::frames`].

use glam::{DQuat, DVec2, DVec3};
use rmpv::Value;

/// A map of named values.
pub fn map<const N: usize>(pairs: [(&str, Value); N]) -> Value {
    let pairs = pairs.into_iter();
    Value::Map(pairs.map(|(key, value)| (key.into(), value)).collect())
}

/// `Vector2r`.
pub fn vector2(v: DVec2) -> Value {
    map([("x_val", v.x.into()), ("y_val", v.y.into())])
}

/// `Vector3r`.
pub fn vector(v: DVec3) -> Value {
    map([
        ("x_val", v.x.into()),
        ("y_val", v.y.into()),
        ("z_val", v.z.into()),
    ])
}

/// `Quaternionr`.
pub fn quaternion(q: DQuat) -> Value {
    map([
        ("w_val", q.w.into()),
        ("x_val", q.x.into()),
        ("y_val", q.y.into()),
        ("z_val", q.z.into()),
    ])
}

/// `Pose`.
pub fn pose(position: DVec3, orientation: DQuat) -> Value {
    map([
        ("position", vector(position)),
        ("orientation", quaternion(orientation)),
    ])
}

/// `GeoPoint`: degrees and metres over the ellipsoid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeoPoint {
    /// North positive \[deg\].
    pub latitude_deg: f64,
    /// East positive \[deg\].
    pub longitude_deg: f64,
    /// \[m\].
    pub altitude_m: f64,
}

impl GeoPoint {
    /// The map.
    pub fn value(self) -> Value {
        map([
            ("latitude", self.latitude_deg.into()),
            ("longitude", self.longitude_deg.into()),
            ("altitude", self.altitude_m.into()),
        ])
    }
}

/// `KinematicsState`: position and velocities in a world, angular ones in the body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Kinematics {
    /// \[m\].
    pub position: DVec3,
    /// From the body to the world.
    pub orientation: DQuat,
    /// \[m/s\], world.
    pub linear_velocity: DVec3,
    /// \[rad/s\], body.
    pub angular_velocity: DVec3,
    /// \[m/s²\], world.
    pub linear_acceleration: DVec3,
    /// \[rad/s²\], body.
    pub angular_acceleration: DVec3,
}

impl Kinematics {
    /// The map.
    pub fn value(&self) -> Value {
        map([
            ("position", vector(self.position)),
            ("orientation", quaternion(self.orientation)),
            ("linear_velocity", vector(self.linear_velocity)),
            ("angular_velocity", vector(self.angular_velocity)),
            ("linear_acceleration", vector(self.linear_acceleration)),
            ("angular_acceleration", vector(self.angular_acceleration)),
        ])
    }
}

/// `CollisionInfo`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Collision {
    /// Whether it has met something.
    pub has_collided: bool,
    /// Where it was then \[m\].
    pub position: DVec3,
    /// When \[ns\].
    pub time_stamp_ns: u64,
}

impl Collision {
    /// The map.
    pub fn value(&self) -> Value {
        map([
            ("has_collided", self.has_collided.into()),
            ("normal", vector(DVec3::ZERO)),
            ("impact_point", vector(self.position)),
            ("position", vector(self.position)),
            ("penetration_depth", 0.0.into()),
            ("time_stamp", self.time_stamp_ns.into()),
            ("object_name", "".into()),
            ("object_id", (-1).into()),
        ])
    }
}

/// `MultirotorState`.
#[derive(Clone, Debug, PartialEq)]
pub struct Multirotor {
    /// What it has met.
    pub collision: Collision,
    /// Its motion.
    pub kinematics: Kinematics,
    /// Where it is.
    pub gps_location: GeoPoint,
    /// \[ns\].
    pub time_stamp_ns: u64,
    /// Whether it stands on the ground.
    pub landed: bool,
    /// Whether it can fly.
    pub ready: bool,
    /// Why not.
    pub ready_message: String,
}

impl Multirotor {
    /// The map.
    pub fn value(&self) -> Value {
        map([
            ("collision", self.collision.value()),
            ("kinematics_estimated", self.kinematics.value()),
            ("gps_location", self.gps_location.value()),
            ("timestamp", self.time_stamp_ns.into()),
            ("landed_state", i64::from(!self.landed).into()),
            ("rc_data", no_rc()),
            ("ready", self.ready.into()),
            ("ready_message", self.ready_message.as_str().into()),
            ("can_arm", self.ready.into()),
        ])
    }
}

/// `RCData` of a remote control that is not there.
fn no_rc() -> Value {
    map([
        ("timestamp", 0.into()),
        ("pitch", 0.0.into()),
        ("roll", 0.0.into()),
        ("throttle", 0.0.into()),
        ("yaw", 0.0.into()),
        ("left_z", 0.0.into()),
        ("right_z", 0.0.into()),
        ("switches", 0.into()),
        ("vendor_id", "".into()),
        ("is_initialized", false.into()),
        ("is_valid", false.into()),
    ])
}

/// `ImuData`: attitude, angular velocity, and acceleration without gravity's, of the body.
pub fn imu(time_stamp_ns: u64, attitude: DQuat, angular: DVec3, specific_force: DVec3) -> Value {
    map([
        ("time_stamp", time_stamp_ns.into()),
        ("orientation", quaternion(attitude)),
        ("angular_velocity", vector(angular)),
        ("linear_acceleration", vector(specific_force)),
    ])
}

/// `BarometerData`: altitude \[m\], pressure \[Pa\], pressure at sea level \[hPa\].
pub fn barometer(time_stamp_ns: u64, altitude_m: f64, pressure_pa: f64, qnh_hpa: f64) -> Value {
    map([
        ("time_stamp", time_stamp_ns.into()),
        ("altitude", altitude_m.into()),
        ("pressure", pressure_pa.into()),
        ("qnh", qnh_hpa.into()),
    ])
}

/// `MagnetometerData`: the field in the body \[G\].
pub fn magnetometer(time_stamp_ns: u64, field_gauss: DVec3) -> Value {
    map([
        ("time_stamp", time_stamp_ns.into()),
        ("magnetic_field_body", vector(field_gauss)),
        ("magnetic_field_covariance", Value::Array(Vec::new())),
    ])
}

/// `GpsData` of a receiver that is right.
pub fn gps(time_stamp_ns: u64, utc_us: u64, at: GeoPoint, velocity: DVec3) -> Value {
    /// A fix in three dimensions.
    const FIX_3D: i64 = 3;
    let gnss = map([
        ("geo_point", at.value()),
        ("eph", 0.0.into()),
        ("epv", 0.0.into()),
        ("velocity", vector(velocity)),
        ("fix_type", FIX_3D.into()),
        ("time_utc", utc_us.into()),
    ]);
    map([
        ("time_stamp", time_stamp_ns.into()),
        ("gnss", gnss),
        ("is_valid", true.into()),
    ])
}

/// `EnvironmentState`.
pub fn environment(
    position: DVec3,
    geo_point: GeoPoint,
    gravity_mps2: f64,
    (pressure_pa, temperature_k, density_kgpm3): (f64, f64, f64),
) -> Value {
    map([
        ("position", vector(position)),
        ("geo_point", geo_point.value()),
        ("gravity", vector(DVec3::new(0.0, 0.0, gravity_mps2))),
        ("air_pressure", pressure_pa.into()),
        ("temperature", temperature_k.into()),
        ("air_density", density_kgpm3.into()),
    ])
}

/// `CameraInfo`: pose, horizontal field \[deg\] and the matrix that projects forward, right, down.
pub fn camera_info(pose: Value, fov_deg: f64, matrix: [[f64; 4]; 4]) -> Value {
    let rows = matrix.map(|row| Value::Array(row.map(Value::from).to_vec()));
    let projection = map([("matrix", Value::Array(rows.to_vec()))]);
    map([
        ("pose", pose),
        ("fov", fov_deg.into()),
        ("proj_mat", projection),
    ])
}

/// What a picture holds.
#[derive(Clone, Debug, PartialEq)]
pub enum Pixels {
    /// A PNG, or 8 bits a channel, blue, green and red.
    Bytes(Vec<u8>),
    /// Numbers, row by row.
    Floats(Vec<f32>),
}

/// `ImageResponse`.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Name of the camera.
    pub camera: String,
    /// What it holds.
    pub pixels: Pixels,
    /// Where the camera was, and how it was turned.
    pub camera_position: DVec3,
    /// See [`Self::camera_position`].
    pub camera_orientation: DQuat,
    /// \[ns\].
    pub time_stamp_ns: u64,
    /// Whether it is a PNG.
    pub compress: bool,
    /// Width and height \[px\].
    pub size_px: [u32; 2],
    /// Number of its kind.
    pub kind: u64,
}

impl Image {
    /// The map.
    pub fn value(self) -> Value {
        let as_float = matches!(self.pixels, Pixels::Floats(_));
        let (bytes, floats) = match self.pixels {
            Pixels::Bytes(bytes) => (bytes, Vec::new()),
            Pixels::Floats(floats) => (Vec::new(), floats),
        };
        let floats = floats.into_iter().map(Value::from).collect();
        let [width, height] = self.size_px;
        map([
            ("camera_name", self.camera.into()),
            ("image_data_uint8", Value::Binary(bytes)),
            ("image_data_float", Value::Array(floats)),
            ("camera_position", vector(self.camera_position)),
            ("camera_orientation", quaternion(self.camera_orientation)),
            ("time_stamp", self.time_stamp_ns.into()),
            ("message", "".into()),
            ("pixels_as_float", as_float.into()),
            ("compress", self.compress.into()),
            ("width", width.into()),
            ("height", height.into()),
            ("image_type", self.kind.into()),
            ("annotation_name", "".into()),
        ])
    }
}

/// `DetectionInfo`.
#[derive(Clone, Debug, PartialEq)]
pub struct Detection {
    /// Name of the object.
    pub name: String,
    /// Where it is.
    pub geo_point: GeoPoint,
    /// Its box in the picture: x and y of two corners \[px\].
    pub box2d_px: [f64; 4],
    /// Two corners of its box \[m\].
    pub box3d: [DVec3; 2],
    /// Where it is against the camera, and how it is turned.
    pub relative: (DVec3, DQuat),
}

impl Detection {
    /// The map.
    pub fn value(&self) -> Value {
        let [x0, y0, x1, y1] = self.box2d_px;
        let [low, high] = self.box3d;
        map([
            ("name", self.name.as_str().into()),
            ("geo_point", self.geo_point.value()),
            (
                "box2D",
                map([
                    ("min", vector2(DVec2::new(x0, y0))),
                    ("max", vector2(DVec2::new(x1, y1))),
                ]),
            ),
            ("box3D", map([("min", vector(low)), ("max", vector(high))])),
            ("relative_pose", pose(self.relative.0, self.relative.1)),
        ])
    }
}
