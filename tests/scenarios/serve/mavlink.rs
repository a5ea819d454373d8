//! MAVLink: a ground station that looks on and turns a gimbal, and an autopilot that flies a UAV in lockstep.

use super::*;
use crate::common::stderr;
use ::mavlink::dialects::common::{
    COMMAND_LONG_DATA, GimbalManagerFlags, HEARTBEAT_DATA, HIL_ACTUATOR_CONTROLS_DATA, MavCmd,
    MavMessage, MavModeFlag, MavResult,
};
use ::mavlink::{MavHeader, MavlinkReader, Message as _};
use std::net::UdpSocket;

/// A ground station, system 255 of component 190.
struct Ground {
    socket: UdpSocket,
    header: MavHeader,
}

fn framed(header: MavHeader, message: &MavMessage) -> Vec<u8> {
    let mut bytes = Vec::new();
    ::mavlink::write_v2_msg(&mut bytes, header, message).unwrap();
    bytes
}

impl Ground {
    /// One that has said who it is, and is heard.
    fn join(address: &str, system_id: u32) -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.connect(address).unwrap();
        socket
            .set_read_timeout(Some(Duration::from_millis(200)))
            .unwrap();
        let header = MavHeader {
            system_id,
            component_id: 190,
            sequence: 0,
        };
        let ground = Self { socket, header };
        ground.send(&MavMessage::HEARTBEAT(HEARTBEAT_DATA::DEFAULT));
        // Time stands, so that heartbeats come by the clock.
        ground.until(|(header, message)| {
            (header.system_id == 250 && matches!(message, MavMessage::HEARTBEAT(_))).then_some(())
        });
        ground
    }

    fn send(&self, message: &MavMessage) {
        self.socket.send(&framed(self.header, message)).unwrap();
    }

    fn read(&self) -> Option<(MavHeader, MavMessage)> {
        let mut bytes = [0; 4096];
        let count = self.socket.recv(&mut bytes).ok()?;
        MavlinkReader::new(&bytes[..count]).read_any_message().ok()
    }

    /// All that has come.
    fn drain(&self) -> Vec<(MavHeader, MavMessage)> {
        std::iter::from_fn(|| self.read()).collect()
    }

    #[track_caller]
    fn until<T>(&self, wanted: impl Fn(&(MavHeader, MavMessage)) -> Option<T>) -> T {
        let until = Instant::now() + PATIENCE;
        while Instant::now() < until {
            if let Some(found) = self.read().as_ref().and_then(&wanted) {
                return found;
            }
        }
        panic!("what is waited for does not come");
    }

    /// What is answered to a command, by whom.
    fn command(&self, system: u8, command: MavCmd, params: [f32; 7]) -> (u32, MavResult) {
        let [param1, param2, param3, param4, param5, param6, param7] = params;
        self.send(&MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            param1,
            param2,
            param3,
            param4,
            param5,
            param6,
            param7,
            command,
            target_system: system,
            target_component: 0,
            confirmation: 0,
        }));
        self.until(|(header, message)| match message {
            MavMessage::COMMAND_ACK(answer) if answer.command == command => {
                assert_eq!(u32::from(answer.target_system), self.header.system_id);
                Some((header.system_id, answer.result))
            }
            _ => None,
        })
    }
}

/// Where MAVLink is spoken, as the server says it.
fn address(server: &Server) -> String {
    let line = server.says("mavlink  udpin:");
    line.trim_start_matches("mavlink  udpin:").to_owned()
}

const NONE: f32 = f32::NAN;
const PITCHYAW: MavCmd = MavCmd::MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW;

#[test]
fn a_ground_station_sees_the_run_and_turns_its_gimbal() {
    let mut server = Server::start(&["--mavlink", "udpin:127.0.0.1:0"]);
    let ground = Ground::join(&address(&server), 255);
    let mut client = server.client();
    let tick_hz = u64::from(client.welcome().tick_hz);
    ground.drain();

    // A second of the run has so many of each.
    client.step(tick_hz).unwrap();
    let state = client.state().unwrap();
    let seen = ground.drain();
    let of = |system: u32, name: &str| {
        let matching = seen.iter().filter(|(header, message)| {
            header.system_id == system && message.message_name() == name
        });
        matching
            .map(|(_, message)| message.clone())
            .collect::<Vec<_>>()
    };
    assert_eq!(of(1, "GLOBAL_POSITION_INT").len(), 10);
    assert_eq!(of(1, "ATTITUDE_QUATERNION").len(), 20);
    assert_eq!(of(250, "GIMBAL_DEVICE_ATTITUDE_STATUS").len(), 10);
    // By simulated time and, while time stood, by the clock.
    assert!((1..=3).contains(&of(1, "HEARTBEAT").len()));

    // The last of them are of the tick that the state is of.
    let uav = &state.uavs[0];
    let Some(MavMessage::LOCAL_POSITION_NED(local)) = of(1, "LOCAL_POSITION_NED").pop() else {
        panic!()
    };
    assert_eq!(local.time_boot_ms, 1_000);
    let [east, north, up] = [0, 1, 2].map(|axis| uav.r_enu_m[axis] as f32);
    assert_eq!([local.x, local.y, local.z], [north, east, -up]);
    let Some(MavMessage::GLOBAL_POSITION_INT(global)) = of(1, "GLOBAL_POSITION_INT").pop() else {
        panic!()
    };
    // The scenario's site is at 47.3769 N, 8.5417 E: a degree of latitude is 111.2 km there.
    let north_m = 111_180.0 * (1e-7 * f64::from(global.lat) - 47.3769);
    assert!((north_m - uav.r_enu_m[1]).abs() < 2.0, "{north_m}");
    let Some(MavMessage::GIMBAL_DEVICE_ATTITUDE_STATUS(gimbal)) =
        of(250, "GIMBAL_DEVICE_ATTITUDE_STATUS").pop()
    else {
        panic!()
    };
    let looks = &state.stations[0].mount.as_ref().unwrap().measured_az_el_rad;
    let [w, _, y, z] = gimbal.q.map(f64::from);
    let (yaw_rad, pitch_rad) = (2.0 * z.atan2(w), 2.0 * y.atan2(w));
    assert!(
        (looks[0] - yaw_rad).sin().abs() < 1e-6,
        "{yaw_rad} {looks:?}"
    );
    assert!(
        (looks[1] - pitch_rad).sin().abs() < 1e-6,
        "{pitch_rad} {looks:?}"
    );

    // Rates drive the mount.
    let rates = [NONE, NONE, 0.5, -3.0, 0.0, 0.0, 0.0];
    assert_eq!(
        ground.command(250, PITCHYAW, rates),
        (250, MavResult::MAV_RESULT_ACCEPTED)
    );
    let mut looks_deg = || {
        client.step(tick_hz).unwrap();
        let mount = client.state().unwrap().stations[0].mount.clone().unwrap();
        [0, 1].map(|axis| mount.az_el_rad[axis].to_degrees())
    };
    let (before, after) = (looks_deg(), looks_deg());
    // The base shakes; the mean over a second is what was wanted.
    let turned = [0, 1].map(|axis| after[axis] - before[axis]);
    assert!(
        (turned[0] + 3.0).abs() < 0.05 && (turned[1] - 0.5).abs() < 0.05,
        "{turned:?}"
    );

    // What is not offered is refused and said, and what is no message is counted.
    let both = [10.0, NONE, 1.0, NONE, 0.0, 0.0, 0.0];
    assert_eq!(
        ground.command(250, PITCHYAW, both).1,
        MavResult::MAV_RESULT_DENIED
    );
    server.says("mavlink: give angles or rates, not both");
    let arm = MavCmd::MAV_CMD_COMPONENT_ARM_DISARM;
    assert_eq!(
        ground.command(1, arm, [1.0; 7]),
        (1, MavResult::MAV_RESULT_UNSUPPORTED)
    );
    let other = Ground::join(&ground.socket.peer_addr().unwrap().to_string(), 254);
    assert_eq!(
        other.command(250, PITCHYAW, rates).1,
        MavResult::MAV_RESULT_DENIED
    );
    server.says("mavlink: 255/190 is in control");
    ground.socket.send(b"this is no message").unwrap();
    let mut broken = framed(
        ground.header,
        &MavMessage::HEARTBEAT(HEARTBEAT_DATA::DEFAULT),
    );
    broken[12] ^= 0xff;
    ground.socket.send(&broken).unwrap();

    // What it can do is asked for.
    let request = MavCmd::MAV_CMD_REQUEST_MESSAGE;
    let information = [280.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    ground.command(250, request, information);
    let limits = ground.until(|(_, message)| match message {
        MavMessage::GIMBAL_MANAGER_INFORMATION(own) => Some([own.pitch_min, own.pitch_max]),
        _ => None,
    });
    assert!(limits[0] < limits[1]);

    // An angle slews; then the law has the mount again.
    let mut message = ::mavlink::dialects::common::GIMBAL_MANAGER_SET_PITCHYAW_DATA {
        flags: GimbalManagerFlags::GIMBAL_MANAGER_FLAGS_YAW_LOCK,
        pitch: 0.2,
        yaw: -0.8,
        pitch_rate: NONE,
        yaw_rate: NONE,
        target_system: 250,
        target_component: 154,
        gimbal_device_id: 0,
    };
    ground.send(&MavMessage::GIMBAL_MANAGER_SET_PITCHYAW(message.clone()));
    ground.until(|(_, message)| {
        matches!(message, MavMessage::GIMBAL_MANAGER_STATUS(_)).then_some(())
    });
    client.step(3 * tick_hz).unwrap();
    let mount = client.state().unwrap().stations[0].mount.clone().unwrap();
    let off = (mount.az_el_rad[0] + 0.8).sin().abs();
    assert!(off < 0.3, "{:?}", mount.az_el_rad);
    // A message that is refused has no answer but a text.
    message.gimbal_device_id = 3;
    ground.send(&MavMessage::GIMBAL_MANAGER_SET_PITCHYAW(message));
    let text = ground.until(|(_, message)| match message {
        MavMessage::STATUSTEXT(said) => Some(said.text.to_str().unwrap_or_default().to_owned()),
        _ => None,
    });
    assert!(text.starts_with("gimbal 3"), "{text}");

    // Without them it is the same run.
    let finished = client.finish().unwrap();
    server.says("mavlink: messages 2 malformed and ignored");
    assert!(server.end().success());
    assert_eq!(
        hash_of(&server.out("scenario.toml"), finished.tick),
        finished.state_hash
    );
}

/// An autopilot that answers with the same throttles, as long as `answers` says so; whether it was let go.
fn constant(
    address: &str,
    armed: bool,
    throttle: f32,
    mut answers: impl FnMut(u64) -> bool,
) -> Vec<u64> {
    let mut socket = TcpStream::connect(address).unwrap();
    socket.set_read_timeout(Some(PATIENCE)).unwrap();
    let mut reader = MavlinkReader::new(socket.try_clone().unwrap());
    let header = MavHeader {
        system_id: 1,
        component_id: 1,
        sequence: 0,
    };
    let mut times = Vec::new();
    while let Ok((from, message)) = reader.read_any_message::<MavMessage>() {
        let MavMessage::HIL_SENSOR(sensor) = message else {
            continue;
        };
        assert_eq!(from.system_id, 1);
        times.push(sensor.time_usec);
        if !answers(sensor.time_usec) {
            continue;
        }
        let mut controls = [0.0; 16];
        controls[..4].fill(throttle);
        let answer = MavMessage::HIL_ACTUATOR_CONTROLS(HIL_ACTUATOR_CONTROLS_DATA {
            time_usec: sensor.time_usec,
            controls,
            mode: match armed {
                true => MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED,
                false => MavModeFlag::empty(),
            },
            ..HIL_ACTUATOR_CONTROLS_DATA::DEFAULT
        });
        if socket.write_all(&framed(header, &answer)).is_err() {
            break;
        }
    }
    times
}

/// Where an autopilot comes in.
fn entrance(server: &Server) -> String {
    let line = server.says("hil  intruder=tcpin:");
    line.trim_start_matches("hil  intruder=tcpin:").to_owned()
}

const HIL: [&str; 2] = ["--hil", "intruder=tcpin:127.0.0.1:0"];

#[test]
fn an_autopilot_has_the_rotors_in_lockstep_and_the_run_repeats_without_it() {
    let mut server = Server::start(&[&HIL[..], &["--set", "duration_s=0.5"]].concat());
    let times = constant(&entrance(&server), true, 0.4, |_| true);
    assert!(server.end().success());
    // 240 times a second, in order, each time once.
    let every: Vec<u64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert!(times.len() == 120 && times[0] == 0, "{}", times.len());
    assert!(
        every.iter().all(|gap| (4_166..=4_167).contains(gap)),
        "{every:?}"
    );
    let ticks = server.ticks();
    let (last, hash) = *ticks.last().unwrap();
    assert_eq!(hash_of(&server.out("scenario.toml"), last), hash);
    // Without the autopilot it is another run.
    let mut alone = Simulation::builder(Path::new(ROOT).join(SCENARIO))
        .set("detector.kind=truth")
        .open()
        .unwrap();
    alone.step(last).unwrap();
    assert_ne!(alone.view().state_hash(), hash);
}

#[test]
fn an_autopilot_that_does_not_arm_leaves_the_uav_to_its_plan() {
    let mut server = Server::start(&[&HIL[..], &["--set", "duration_s=0.25"]].concat());
    constant(&entrance(&server), false, 0.4, |_| true);
    assert!(server.end().success());
    let (last, hash) = *server.ticks().last().unwrap();
    let mut alone = Simulation::builder(Path::new(ROOT).join(SCENARIO))
        .set("detector.kind=truth")
        .set("duration_s=0.25")
        .open()
        .unwrap();
    alone.step(last).unwrap();
    assert_eq!(alone.view().state_hash(), hash);
}

#[test]
fn an_autopilot_that_falls_silent_or_leaves_ends_the_run_with_a_line() {
    let deadline = ["--hil-deadline", "0.5"];
    let mut server = Server::start(&[&HIL[..], &deadline].concat());
    constant(&entrance(&server), true, 0.4, |time_usec| {
        time_usec < 100_000
    });
    let line = server.says("error: ");
    assert!(
        line.contains("--hil intruder: no HIL_ACTUATOR_CONTROLS of time 100000 µs within 0.5 s"),
        "{line}"
    );
    assert_eq!(server.end().code(), Some(2));
    // What there is of the run is whole.
    assert!(server.ticks().len() >= 95);

    let mut server = Server::start(&HIL);
    let address = entrance(&server);
    let mut answered = 0;
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let mut socket = TcpStream::connect(&address).unwrap();
            let mut byte = [0; 64];
            while answered < 3 {
                answered += usize::from(socket.read(&mut byte).unwrap_or(0) > 0);
            }
            // It has not answered once, and goes.
            let _ = socket.shutdown(std::net::Shutdown::Both);
        });
    });
    let line = server.says("error: ");
    assert!(line.contains("its autopilot has left"), "{line}");
    assert_eq!(server.end().code(), Some(2));
}

#[test]
fn what_cannot_be_flown_or_reached_is_refused_before_the_run() {
    for (options, words) in [
        (
            ["--mavlink", "udpout:192.0.2.1:14550"],
            "this machine alone",
        ),
        (["--mavlink", "serial:/dev/ttyUSB0"], "expected udpout"),
        (
            ["--hil", "intruder=udpin:127.0.0.1:4560"],
            "expected UAV=tcpin",
        ),
        (["--hil", "nobody=tcpin:127.0.0.1:0"], "no UAV of this name"),
    ] {
        let output = boresight()
            .args(["serve", SCENARIO, "--no-capture", "--listen", "127.0.0.1:0"])
            .args(["--set", "detector.kind=truth"])
            .args(options)
            .output()
            .unwrap();
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(words), "{said}");
    }
    let output = boresight()
        .args(["serve", SCENARIO, "--no-capture", "--listen", "127.0.0.1:0"])
        .args(["--set", "detector.kind=truth", "--hil-rate", "100"])
        .args(HIL)
        .output()
        .unwrap();
    let said = stderr(&output);
    assert!(said.contains("give a divisor"), "{said}");
}
