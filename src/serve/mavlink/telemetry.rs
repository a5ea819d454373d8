//! What ground stations are told, message by message.

use super::frames::{
    Earth, attitude, boot_ms, centi, compass, frd, heading_rad, looking, milli, ned,
};
use crate::components::flight::UavStatus;
use glam::{DQuat, DVec2, DVec3};
use mavlink::dialects::common::{
    ATTITUDE_QUATERNION_DATA, GIMBAL_DEVICE_ATTITUDE_STATUS_DATA, GIMBAL_MANAGER_INFORMATION_DATA,
    GIMBAL_MANAGER_STATUS_DATA, GLOBAL_POSITION_INT_DATA, GimbalDeviceErrorFlags,
    GimbalDeviceFlags, GimbalManagerCapFlags, GimbalManagerFlags, HEARTBEAT_DATA,
    LOCAL_POSITION_NED_DATA, MavAutopilot, MavMessage, MavModeFlag, MavState, MavType,
};

/// The component that a gimbal is, MAV_COMP_ID_GIMBAL.
pub(super) const GIMBAL: u8 = 154;
/// The component that an autopilot is, MAV_COMP_ID_AUTOPILOT1.
pub(super) const AUTOPILOT: u8 = 1;
/// Version of MAVLink that a heartbeat names.
const VERSION: u8 = 3;

/// How a body moves.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion {
    pub r_enu_m: DVec3,
    pub v_enu_mps: DVec3,
    pub q_enu_body: DQuat,
    /// Rates about forward, left and up [rad/s].
    pub rates_body_radps: DVec3,
}

/// That a UAV is there: its kind by its rotors, its state by what has become of it.
pub(super) fn uav_heartbeat(rotors: usize, status: UavStatus) -> MavMessage {
    let mavtype = match rotors {
        6 => MavType::MAV_TYPE_HEXAROTOR,
        8 => MavType::MAV_TYPE_OCTOROTOR,
        _ => MavType::MAV_TYPE_QUADROTOR,
    };
    let flies = MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED | MavModeFlag::MAV_MODE_FLAG_AUTO_ENABLED;
    let (system_status, base_mode) = match status {
        UavStatus::Flying => (MavState::MAV_STATE_ACTIVE, flies),
        UavStatus::Landed => (MavState::MAV_STATE_STANDBY, MavModeFlag::empty()),
        UavStatus::Falling | UavStatus::Struck => (MavState::MAV_STATE_EMERGENCY, flies),
        UavStatus::Down | UavStatus::Crashed => {
            (MavState::MAV_STATE_FLIGHT_TERMINATION, MavModeFlag::empty())
        }
    };
    heartbeat(
        mavtype,
        MavAutopilot::MAV_AUTOPILOT_GENERIC,
        base_mode,
        system_status,
    )
}

/// That a station's gimbal is there.
pub(super) fn gimbal_heartbeat() -> MavMessage {
    heartbeat(
        MavType::MAV_TYPE_GIMBAL,
        MavAutopilot::MAV_AUTOPILOT_INVALID,
        MavModeFlag::empty(),
        MavState::MAV_STATE_ACTIVE,
    )
}

fn heartbeat(
    mavtype: MavType,
    autopilot: MavAutopilot,
    base_mode: MavModeFlag,
    system_status: MavState,
) -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype,
        autopilot,
        base_mode,
        system_status,
        mavlink_version: VERSION,
    })
}

/// Where something is on the Earth; `height_agl_m` is its height over the bare ground.
pub(super) fn global_position(
    earth: &Earth,
    motion: &Motion,
    height_agl_m: f64,
    t_s: f64,
) -> MavMessage {
    let at = earth.global(motion.r_enu_m);
    let [vx, vy, vz] = ned(motion.v_enu_mps).to_array().map(centi);
    MavMessage::GLOBAL_POSITION_INT(GLOBAL_POSITION_INT_DATA {
        time_boot_ms: boot_ms(t_s),
        lat: at.lat,
        lon: at.lon,
        alt: at.alt,
        relative_alt: milli(height_agl_m),
        vx,
        vy,
        vz,
        hdg: compass(heading_rad(motion.q_enu_body)),
    })
}

/// Where something is in the site's frame.
pub(super) fn local_position(motion: &Motion, t_s: f64) -> MavMessage {
    let [x, y, z] = ned(motion.r_enu_m).to_array().map(|x| x as f32);
    let [vx, vy, vz] = ned(motion.v_enu_mps).to_array().map(|x| x as f32);
    MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
        time_boot_ms: boot_ms(t_s),
        x,
        y,
        z,
        vx,
        vy,
        vz,
    })
}

/// How a UAV is turned.
pub(super) fn uav_attitude(motion: &Motion, t_s: f64) -> MavMessage {
    let [q1, q2, q3, q4] = attitude(motion.q_enu_body);
    let rates = frd(motion.rates_body_radps).to_array();
    let [rollspeed, pitchspeed, yawspeed] = rates.map(|x| x as f32);
    MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
        time_boot_ms: boot_ms(t_s),
        q1,
        q2,
        q3,
        q4,
        rollspeed,
        pitchspeed,
        yawspeed,
        ..ATTITUDE_QUATERNION_DATA::DEFAULT
    })
}

/// Where a mount looks by its encoders, and how fast it turns by its gyros: azimuth (x) and elevation (y), \[rad\] and
/// \[rad/s\]. Rates are those of the angles: pitch about the elevation axis, yaw about the vertical.
pub(super) fn device_status(az_el_rad: DVec2, rates_radps: DVec2, t_s: f64) -> MavMessage {
    MavMessage::GIMBAL_DEVICE_ATTITUDE_STATUS(GIMBAL_DEVICE_ATTITUDE_STATUS_DATA {
        time_boot_ms: boot_ms(t_s),
        q: looking(az_el_rad.x, az_el_rad.y),
        angular_velocity_x: 0.0,
        angular_velocity_y: rates_radps.y as f32,
        angular_velocity_z: rates_radps.x as f32,
        failure_flags: GimbalDeviceErrorFlags::empty(),
        flags: GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_ROLL_LOCK
            | GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_PITCH_LOCK
            | GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_YAW_LOCK
            | GimbalDeviceFlags::GIMBAL_DEVICE_FLAGS_YAW_IN_EARTH_FRAME,
        ..GIMBAL_DEVICE_ATTITUDE_STATUS_DATA::DEFAULT
    })
}

/// Who is in control of a gimbal.
pub(super) fn manager_status(control: Option<(u8, u8)>, t_s: f64) -> MavMessage {
    let (system, component) = control.unwrap_or_default();
    MavMessage::GIMBAL_MANAGER_STATUS(GIMBAL_MANAGER_STATUS_DATA {
        time_boot_ms: boot_ms(t_s),
        flags: GimbalManagerFlags::GIMBAL_MANAGER_FLAGS_ROLL_LOCK
            | GimbalManagerFlags::GIMBAL_MANAGER_FLAGS_PITCH_LOCK
            | GimbalManagerFlags::GIMBAL_MANAGER_FLAGS_YAW_LOCK,
        gimbal_device_id: GIMBAL,
        primary_control_sysid: system,
        primary_control_compid: component,
        secondary_control_sysid: 0,
        secondary_control_compid: 0,
    })
}

/// What a gimbal can do; it turns between these elevations \[deg\], and about without end.
pub(super) fn manager_information(elevation_limits_deg: [f64; 2], t_s: f64) -> MavMessage {
    let [pitch_min, pitch_max] = elevation_limits_deg.map(|deg| deg.to_radians() as f32);
    let about = std::f32::consts::PI;
    MavMessage::GIMBAL_MANAGER_INFORMATION(GIMBAL_MANAGER_INFORMATION_DATA {
        time_boot_ms: boot_ms(t_s),
        cap_flags: GimbalManagerCapFlags::GIMBAL_MANAGER_CAP_FLAGS_HAS_PITCH_AXIS
            | GimbalManagerCapFlags::GIMBAL_MANAGER_CAP_FLAGS_HAS_PITCH_LOCK
            | GimbalManagerCapFlags::GIMBAL_MANAGER_CAP_FLAGS_HAS_YAW_AXIS
            | GimbalManagerCapFlags::GIMBAL_MANAGER_CAP_FLAGS_HAS_YAW_LOCK
            | GimbalManagerCapFlags::GIMBAL_MANAGER_CAP_FLAGS_SUPPORTS_INFINITE_YAW
            | GimbalManagerCapFlags::GIMBAL_MANAGER_CAP_FLAGS_SUPPORTS_YAW_IN_EARTH_FRAME,
        roll_min: 0.0,
        roll_max: 0.0,
        pitch_min,
        pitch_max,
        yaw_min: -about,
        yaw_max: about,
        gimbal_device_id: GIMBAL,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::maths::geodesy::Geodetic;

    const MOTION: Motion = Motion {
        r_enu_m: DVec3::new(10.0, 20.0, 30.0),
        v_enu_mps: DVec3::new(1.0, -2.0, 0.5),
        q_enu_body: DQuat::IDENTITY,
        rates_body_radps: DVec3::new(0.1, 0.2, 0.3),
    };

    #[test]
    fn places_and_velocities_are_north_east_down() {
        let MavMessage::LOCAL_POSITION_NED(local) = local_position(&MOTION, 1.25) else {
            panic!()
        };
        assert_eq!(local.time_boot_ms, 1_250);
        assert_eq!([local.x, local.y, local.z], [20.0, 10.0, -30.0]);
        assert_eq!([local.vx, local.vy, local.vz], [-2.0, 1.0, -0.5]);
        let earth = Earth::about(Geodetic {
            latitude_rad: 0.8,
            longitude_rad: 0.1,
            height_m: 400.0,
        });
        let MavMessage::GLOBAL_POSITION_INT(global) = global_position(&earth, &MOTION, 25.0, 0.0)
        else {
            panic!()
        };
        assert_eq!([global.vx, global.vy, global.vz], [-200, 100, -50]);
        // A body without a turn has its nose to the east.
        assert_eq!((global.relative_alt, global.hdg), (25_000, 9_000));
        assert!(global.lat > earth.global(DVec3::ZERO).lat);
    }

    #[test]
    fn rates_are_about_forward_right_and_down() {
        let MavMessage::ATTITUDE_QUATERNION(turned) = uav_attitude(&MOTION, 0.0) else {
            panic!()
        };
        let rates = [turned.rollspeed, turned.pitchspeed, turned.yawspeed];
        assert_eq!(rates, [0.1, -0.2, -0.3]);
        let status = device_status(DVec2::new(0.3, 0.2), DVec2::new(0.02, 0.01), 0.0);
        let MavMessage::GIMBAL_DEVICE_ATTITUDE_STATUS(status) = status else {
            panic!()
        };
        let rates = [status.angular_velocity_y, status.angular_velocity_z];
        assert_eq!(rates, [0.01, 0.02]);
    }

    #[test]
    fn a_heartbeat_says_what_has_become_of_a_uav() {
        for (status, state, armed) in [
            (UavStatus::Flying, MavState::MAV_STATE_ACTIVE, true),
            (UavStatus::Falling, MavState::MAV_STATE_EMERGENCY, true),
            (
                UavStatus::Down,
                MavState::MAV_STATE_FLIGHT_TERMINATION,
                false,
            ),
            (UavStatus::Landed, MavState::MAV_STATE_STANDBY, false),
        ] {
            let MavMessage::HEARTBEAT(beat) = uav_heartbeat(6, status) else {
                panic!()
            };
            assert_eq!(beat.mavtype, MavType::MAV_TYPE_HEXAROTOR);
            assert_eq!(beat.system_status, state);
            let flag = MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
            assert_eq!(beat.base_mode.contains(flag), armed);
        }
    }
}
