//! AirSim's calls: flight, frames, time, hostile clients, and depths against what is known.

use crate::common::{ROOT, boresight, refused, rendering};
use boresight::simulation::{Seen, Simulation};
use boresight_airsim::arguments::{of_map, vector};
use boresight_airsim::{Call, Reader, Value};
use glam::DVec3;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};
use tempfile::TempDir;

const SCENARIO: &str = "tests/data/airsim.toml";
const PATIENCE: Duration = Duration::from_secs(60);

struct Server {
    child: Child,
    address: String,
    lines: Receiver<String>,
    folder: TempDir,
}

impl Server {
    fn start(options: &[&str]) -> Self {
        let folder = TempDir::new().unwrap();
        let mut child = boresight()
            .args([
                "serve",
                SCENARIO,
                "--airsim",
                "127.0.0.1:0",
                "--no-capture",
                "--out",
            ])
            .arg(folder.path().join("out"))
            .args(options)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = BufReader::new(child.stderr.take().unwrap()).lines();
        let first = said.next().unwrap().unwrap();
        let address = first.strip_prefix("airsim  ").expect(&first).to_owned();
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            for line in said.map_while(Result::ok) {
                let _ = sender.send(line);
            }
        });
        Self {
            child,
            address,
            lines,
            folder,
        }
    }

    fn client(&self) -> Client {
        let socket = TcpStream::connect(&self.address).unwrap();
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
        let reader = Reader::new(socket.try_clone().unwrap());
        Client {
            socket,
            reader,
            last_id: 0,
        }
    }

    #[track_caller]
    fn says(&self, words: &str) {
        let until = Instant::now() + PATIENCE;
        while let Ok(line) = self
            .lines
            .recv_timeout(until.saturating_duration_since(Instant::now()))
        {
            if line.contains(words) {
                return;
            }
        }
        panic!("nothing says '{words}'");
    }

    fn memory(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).unwrap();
        let line = status
            .lines()
            .find(|line| line.starts_with("VmHWM"))
            .unwrap();
        1024 * line
            .split_whitespace()
            .nth(1)
            .unwrap()
            .parse::<u64>()
            .unwrap()
    }

    /// Ends it as Ctrl-C does.
    fn stop(mut self) -> TempDir {
        let pid = self.child.id().to_string();
        Command::new("kill").args(["-INT", &pid]).status().unwrap();
        assert_eq!(self.child.wait().unwrap().code(), Some(130));
        std::mem::replace(&mut self.folder, TempDir::new().unwrap())
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

struct Client {
    socket: TcpStream,
    reader: Reader<TcpStream>,
    last_id: u32,
}

impl Client {
    fn send(&mut self, method: &str, arguments: Vec<Value>) -> u32 {
        self.last_id += 1;
        let call = Call {
            id: Some(self.last_id),
            method: method.to_owned(),
            arguments,
        };
        self.socket.write_all(&call.encode()).unwrap();
        self.last_id
    }

    /// The next answer: number, and result or error.
    fn receive(&mut self) -> (u64, Result<Value, String>) {
        let (answer, _) = self.reader.read_value().unwrap();
        let Value::Array(parts) = answer else {
            panic!()
        };
        let [kind, id, error, result] = parts.try_into().unwrap();
        assert_eq!(kind, Value::from(1));
        let said = match error {
            Value::Nil => Ok(result),
            error => Err(error.as_str().unwrap().to_owned()),
        };
        (id.as_u64().unwrap(), said)
    }

    fn try_ask(&mut self, method: &str, arguments: Vec<Value>) -> Result<Value, String> {
        let id = self.send(method, arguments);
        let (answered, said) = self.receive();
        assert_eq!(answered, u64::from(id));
        said
    }

    #[track_caller]
    fn ask(&mut self, method: &str, arguments: Vec<Value>) -> Value {
        self.try_ask(method, arguments).unwrap()
    }

    fn time_ns(&mut self) -> u64 {
        let state = self.ask("getMultirotorState", vec![]);
        of_map(&state, "timestamp").unwrap().as_u64().unwrap()
    }

    fn place(&mut self, vehicle: &str) -> DVec3 {
        let pose = self.ask("simGetVehiclePose", vec![vehicle.into()]);
        vector(of_map(&pose, "position").unwrap()).unwrap()
    }
}

fn yaw_mode() -> Value {
    Value::Map(vec![
        ("is_rate".into(), true.into()),
        ("yaw_or_rate".into(), 0.0.into()),
    ])
}

fn to(x: f64, y: f64, z: f64) -> Vec<Value> {
    let limits = [
        5.into(),
        Value::from(3e38),
        0.into(),
        yaw_mode(),
        (-1).into(),
        1.into(),
    ];
    let place = [x, y, z].map(Value::from);
    place
        .into_iter()
        .chain(limits)
        .chain(["alpha".into()])
        .collect()
}

#[test]
fn a_run_that_is_flown_repeats_without_the_client() {
    // Where it begins is home: without an error of navigation that is the scenario's place.
    let server = Server::start(&["--set", "uavs.0.gnss_sigma_m=[0, 0]"]);
    let mut client = server.client();
    client.ask("simPause", vec![true.into()]);
    client.ask("enableApiControl", vec![true.into(), "alpha".into()]);
    // Until it was held it went by the clock.
    let begun_ns = client.time_ns();
    let flight = client.send("moveToPosition", to(4.0, 6.0, -2.0));
    let mut seconds = 0;
    loop {
        let step = client.send("simContinueForTime", vec![1.into()]);
        let (first, said) = client.receive();
        seconds += 1;
        if first == u64::from(flight) {
            assert_eq!(said, Ok(true.into()));
            assert_eq!(client.receive().0, u64::from(step));
            break;
        }
        assert!(first == u64::from(step) && seconds < 60);
    }
    let place = client.place("alpha");
    assert!(place.distance(DVec3::new(4.0, 6.0, -2.0)) < 0.7, "{place}");
    let ended_ns = client.time_ns();
    assert!((ended_ns - begun_ns).abs_diff(1_000_000_000 * seconds) <= 1);
    drop(client);
    let folder = server.stop();
    let scenario = folder.path().join("out/scenario.toml");
    let mut again = Simulation::open(&scenario).unwrap();
    // Rounded up to a nanosecond, the tick's time would be the next one's.
    again.run_until((ended_ns as f64 - 2.0) / 1e9).unwrap();
    let alpha = again.view().uavs().next().unwrap().r_enu_m();
    let own = DVec3::new(alpha.y - 40.0, alpha.x, 52.0 - alpha.z);
    assert!(own.distance(place) < 1e-9, "{own} {place}");
}

#[test]
fn what_cannot_be_is_one_line_and_changes_nothing() {
    let server = Server::start(&[]);
    let mut client = server.client();
    client.ask("simPause", vec![true.into()]);
    let nan = f64::NAN;
    for (method, arguments, words) in [
        (
            "simLoadLevel",
            vec!["x".into()],
            "simLoadLevel: is not offered",
        ),
        ("\u{1b}[31m\n", vec![], "[31m: is not offered"),
        (
            "hover",
            vec!["alpha".into()],
            "call enableApiControl(True) first",
        ),
        ("hover", vec!["nobody".into()], "no vehicle 'nobody'"),
        (
            "simContinueForTime",
            vec![nan.into()],
            "argument 1 (seconds) is NaN",
        ),
        (
            "simContinueForFrames",
            vec![(-1).into()],
            "argument 1 (frames) is -1",
        ),
        (
            "simPause",
            vec!["yes".into()],
            "argument 1 (is_paused) is \"yes\"",
        ),
        (
            "moveOnPath",
            vec![Value::Array(vec![1.into()])],
            "a list of Vector3r",
        ),
        (
            "simListSceneObjects",
            vec!["(".into()],
            "no regular expression",
        ),
        (
            "simGetImages",
            vec![Value::Array(vec![Value::Nil])],
            "a list of ImageRequest",
        ),
        (
            "simGetImage",
            vec!["0".into(), 0.into()],
            "this run renders no pictures",
        ),
        ("simGetImage", vec!["9".into(), 0.into()], "no camera '9'"),
    ] {
        let said = client.try_ask(method, arguments).unwrap_err();
        assert!(
            said.contains(words) && !said.contains('\n'),
            "{method}: {said}"
        );
    }
    let before = client.time_ns();
    // Detections do without pictures.
    client.ask("simContinueForTime", vec![2.into()]);
    let filter = vec!["0".into(), 0.into(), "*".into(), "".into(), false.into()];
    client.ask("simAddDetectionFilterMeshName", filter);
    let found = client.ask("simGetDetections", vec!["0".into(), 0.into()]);
    assert!(!found.as_array().unwrap().is_empty());
    assert_eq!(client.time_ns() - before, 2_000_000_000);

    refused(
        boresight().args(["serve", SCENARIO, "--airsim", "0.0.0.0:0"]),
        &["--airsim 0.0.0.0:0", "AirSim's clients give no token"],
    );
    let both = boresight()
        .args(["serve", SCENARIO, "--airsim", "--listen", "127.0.0.1:0"])
        .output()
        .unwrap();
    assert_eq!(both.status.code(), Some(2));
}

#[test]
fn hostile_clients_get_one_line_and_the_run_goes_on() {
    let server = Server::start(&["--patience", "1"]);
    let mut good = server.client();
    good.ask("simPause", vec![true.into()]);
    let before = server.memory();
    let some_values = [
        &[0x94, 0, 1, 0xa1, b'p', 0xdd, 0, 2, 0, 0][..],
        &[0xc0; 1000],
    ]
    .concat();
    let deep = [&[0x94, 0, 1, 0xa1, b'p'][..], &[0x91; 4000]].concat();
    for (bytes, words) in [
        (
            b"GET / HTTP/1.1\r\n\r\n".to_vec(),
            "is no call of msgpack-rpc",
        ),
        (
            vec![0x94, 0, 1, 0xdb, 0x80, 0, 0, 0],
            "2147483656 bytes is announced",
        ),
        (some_values, "values is announced"),
        (deep, "more than 12 deep"),
    ] {
        let mut socket = TcpStream::connect(&server.address).unwrap();
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
        socket.write_all(&bytes).unwrap();
        let mut said = Vec::new();
        let _ = socket.read_to_end(&mut said);
        let mut reader = Reader::new(&said[..]);
        let (answer, _) = reader.read_value().unwrap();
        assert!(answer.to_string().contains(words), "{answer}");
        assert!(reader.read_value().is_err(), "one line");
        server.says(words);
    }
    // Half a call from one that leaves.
    let mut socket = TcpStream::connect(&server.address).unwrap();
    socket.write_all(&[0x94, 0, 1]).unwrap();
    drop(socket);
    server.says("the connection ended in the middle of a call: 3 bytes of it came");
    // One that asks and never reads.
    let mut deaf = server.client();
    deaf.socket
        .set_write_timeout(Some(Duration::from_secs(5)))
        .unwrap();
    let ask = Call {
        id: Some(1),
        method: "simListSceneObjects".into(),
        arguments: vec![".*".into()],
    };
    let asks = ask.encode().repeat(100);
    while deaf.socket.write_all(&asks).is_ok() {}
    server.says("has taken nothing for 1 s");
    // Ten thousand calls at once, answered in their order while another has its turn.
    let mut many = server.client();
    let mut writer = many.socket.try_clone().unwrap();
    let sends = std::thread::spawn(move || {
        for id in 0..10_000 {
            let call = Call {
                id: Some(id),
                method: "ping".into(),
                arguments: vec![],
            };
            writer.write_all(&call.encode()).unwrap();
        }
    });
    for id in 0..10_000 {
        assert_eq!(many.receive(), (id, Ok(true.into())));
        if id % 1000 == 0 {
            good.ask("ping", vec![]);
        }
    }
    sends.join().unwrap();
    good.ask("simContinueForTime", vec![Value::from(0.1)]);
    assert!(
        server.memory() < before + (64 << 20),
        "{before} {}",
        server.memory()
    );
}

#[test]
fn depths_are_those_of_uavs_and_city_and_change_nothing() {
    let _guard = rendering();
    let path = format!("{ROOT}/{SCENARIO}");
    let hashes = |look: bool| {
        let mut run = Simulation::builder(&path).pictures(true).open().unwrap();
        run.run_until(6.0).unwrap();
        if look {
            for camera in 0..3 {
                run.depth(camera).unwrap().unwrap();
                run.picture(camera).unwrap().unwrap();
            }
        }
        run.step(100).unwrap();
        run.view().state_hash()
    };
    assert_eq!(hashes(false), hashes(true));

    let mut run = Simulation::builder(&path).pictures(true).open().unwrap();
    run.run_until(6.0).unwrap();
    let frame = run.picture(0).unwrap().unwrap();
    assert_eq!(frame.view().tick(), run.view().tick());
    let (mut flying, mut city, mut level) = (0, 0, 0);
    for camera in 0..3 {
        let depth = run.depth(camera).unwrap().unwrap();
        let view = run.view();
        let ranges_m = depth.ranges_m();
        let width = depth.pinhole.width_px as usize;
        let dsm = &view.air().city().dsm;
        let mut apart = Vec::new();
        for (index, seen) in depth.seen.iter().enumerate() {
            let (x, y) = (index % width, index / width);
            let place = depth.place_enu_m(x, y);
            match seen {
                Seen::Sky => assert!(ranges_m[index].is_infinite() && place.is_none()),
                Seen::Flying(number) => {
                    let uav = view.uavs().find(|uav| uav.index() == *number).unwrap();
                    let range_m = uav.r_enu_m().distance(depth.pose.r_enu_m);
                    let off_m = f64::from(ranges_m[index]) - range_m;
                    assert!(off_m.abs() < 0.6, "{off_m}");
                    assert!(place.unwrap().distance(uav.r_enu_m()) < 0.8);
                    flying += 1;
                }
                Seen::City(_) => {
                    // The height raster's own ray; its cells are 2 m wide.
                    let r = place.unwrap();
                    let to = r - depth.pose.r_enu_m;
                    let hit = dsm.first_hit(depth.pose.r_enu_m, to.normalize(), 2000.0);
                    if let Some(range_m) = hit {
                        apart.push((range_m - to.length()).abs() / to.length());
                    }
                    let normal = DVec3::from(depth.normals_enu[index].map(f64::from));
                    // It is turned to the camera, if it is known.
                    assert!(normal == DVec3::ZERO || normal.dot(to) < 1e-3 * to.length());
                    level += usize::from(normal.z > 0.99);
                    city += 1;
                }
            }
        }
        if camera == 0 {
            apart.sort_by(f64::total_cmp);
            assert!(apart.len() > 1000);
            let (half, most) = (apart[apart.len() / 2], apart[apart.len() * 8 / 10]);
            assert!(half < 0.01 && most < 0.05, "{half} {most}");
        }
    }
    assert!(
        flying > 50 && city > 5_000 && level > 500,
        "{flying} {city} {level}"
    );
}
