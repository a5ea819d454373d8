//! A run that is served to clients: stepped by one, disturbed by others.

mod airsim;
mod hostile;
mod mavlink;
mod outside;

use crate::common::{BLIND, ROOT, boresight, refused, run_scenario, tick_hashes};
use boresight::simulation::Simulation;
use boresight_lockstep::proto::{
    self, BeDetector, Drive, GetState, Order, Ping, Release, Request, Seek, Slew, Step, order,
    reply, request::What,
};
use boresight_lockstep::{Client, Endpoint, encode};
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};
use tempfile::TempDir;

const SCENARIO: &str = "scenarios/urban_intercept.toml";
const PATIENCE: Duration = Duration::from_secs(60);

/// A server that listens.
struct Server {
    child: Child,
    endpoint: Endpoint,
    lines: Receiver<String>,
    folder: TempDir,
}

impl Server {
    /// Serves a scenario without pictures, on a port of its own.
    fn start(options: &[&str]) -> Self {
        let truth = ["--set", "detector.kind=truth"];
        Self::of(&[&truth[..], options].concat())
    }

    fn of(options: &[&str]) -> Self {
        let folder = TempDir::new().unwrap();
        let out = folder.path().join("out");
        let out = out.to_str().unwrap();
        Self::serve(
            folder,
            &[&["--no-capture", "--out", out][..], options].concat(),
        )
    }

    /// One whose run leaves nothing.
    fn unrecorded() -> Self {
        let options = ["--no-capture", "--set", "detector.kind=truth"];
        Self::serve(TempDir::new().unwrap(), &options)
    }

    fn serve(folder: TempDir, options: &[&str]) -> Self {
        let mut child = boresight()
            .args(["serve", SCENARIO, "--listen", "127.0.0.1:0"])
            .args(options)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = BufReader::new(child.stderr.take().unwrap()).lines();
        let first = said.next().unwrap().unwrap();
        let endpoint = Endpoint::tcp(first.strip_prefix("serve  ").expect(&first)).unwrap();
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            for line in said.map_while(Result::ok) {
                let _ = sender.send(line);
            }
        });
        Self {
            child,
            endpoint,
            lines,
            folder,
        }
    }

    fn client(&self) -> Client {
        Client::connect(&self.endpoint, "test", "").unwrap()
    }

    /// A bare connection.
    fn socket(&self) -> TcpStream {
        let Endpoint::Tcp(address) = &self.endpoint else {
            panic!()
        };
        let socket = TcpStream::connect(address).unwrap();
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
        socket
    }

    /// A bare connection that has said hello.
    fn greeted(&self) -> TcpStream {
        let mut socket = self.socket();
        socket.write_all(&encode(&hello(1, ""))).unwrap();
        let mut head = [0; 4];
        socket.read_exact(&mut head).unwrap();
        let mut body = vec![0; u32::from_le_bytes(head) as usize];
        socket.read_exact(&mut body).unwrap();
        socket
    }

    /// The next line on standard error that holds some words.
    #[track_caller]
    fn says(&self, words: &str) -> String {
        let until = Instant::now() + PATIENCE;
        let mut others = Vec::new();
        while let Ok(line) = self
            .lines
            .recv_timeout(until.saturating_duration_since(Instant::now()))
        {
            if line.contains(words) {
                return line;
            }
            others.push(line);
        }
        panic!("nothing says '{words}': {others:?}");
    }

    fn out(&self, name: &str) -> std::path::PathBuf {
        self.folder.path().join("out").join(name)
    }

    /// Most memory that it has had [byte].
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

    /// Waits for its end.
    fn end(&mut self) -> ExitStatus {
        let begun = Instant::now();
        loop {
            if let Some(status) = self.child.try_wait().unwrap() {
                return status;
            }
            assert!(begun.elapsed() < PATIENCE, "it goes on");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// (tick, state hash) of every tick of the recording it leaves.
    fn ticks(&self) -> Vec<(u64, u64)> {
        let messages = crate::common::messages(&self.out("run.mcap"), "/boresight/tick");
        let tick = |data: &Vec<u8>| {
            use prost::Message as _;
            let tick = boresight::recording::proto::Tick::decode(&data[..]).unwrap();
            (tick.tick, tick.state_hash)
        };
        messages.iter().map(tick).collect()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn hello(version: u32, token: &str) -> Request {
    let hello = proto::Hello {
        version,
        token: token.into(),
        name: "bare".into(),
    };
    request(1, What::Hello(hello))
}

fn request(id: u64, what: What) -> Request {
    Request {
        id,
        what: Some(what),
    }
}

fn order(what: order::What) -> Order {
    Order {
        t_s: 0.0,
        station: None,
        what: Some(what),
    }
}

/// State hash of the run without clients after a tick.
fn hash_of(path: &Path, tick: u64) -> u64 {
    let mut run = Simulation::builder(path).open().unwrap();
    run.step(tick).unwrap();
    assert_eq!(run.view().tick(), tick);
    run.view().state_hash()
}

#[test]
fn a_run_with_clients_is_that_without_them_and_can_be_repeated() {
    let mut server = Server::start(&["--seed", "5"]);
    let mut client = server.client();
    let welcome = client.welcome().clone();
    assert_eq!((welcome.version, welcome.seed), (1, 5));
    assert!(welcome.cameras.len() >= 3 && welcome.pace.is_none() && !welcome.pictures);
    let tick_hz = u64::from(welcome.tick_hz);

    // Untouched, it is the run of the library.
    let stepped = client.step(300).unwrap();
    let mut alone = Simulation::builder(Path::new(ROOT).join(SCENARIO))
        .set("detector.kind=truth")
        .seed(5)
        .open()
        .unwrap();
    alone.step(300).unwrap();
    assert_eq!(
        (stepped.tick, stepped.state_hash),
        (300, alone.view().state_hash())
    );
    let state = client.state().unwrap();
    assert_eq!(
        (state.tick, state.state_hash, state.over),
        (300, stepped.state_hash, false)
    );
    let view = alone.view();
    let (station, seen) = (view.stations().next().unwrap(), &state.stations[0]);
    assert_eq!(seen.state, station.state().name());
    assert_eq!(seen.tracks.len(), station.tracks().count());
    let mount = seen.mount.as_ref().unwrap();
    assert_eq!(mount.az_el_rad, station.mount().az_el_rad.to_array());
    assert_eq!(
        state.uavs[0].r_enu_m,
        view.uavs().next().unwrap().r_enu_m().to_array()
    );
    assert!(state.air.unwrap().visibility_m > 1000.0);

    // Frames with their truth, and what is no camera.
    let frames = client.frames(true).unwrap().frames;
    assert!(!frames.is_empty() && frames.iter().all(|frame| frame.rgb8.is_empty()));
    assert!(frames.iter().any(|frame| !frame.truth.is_empty()));
    let wanted = proto::GetFrames {
        cameras: vec!["nose".into()],
        ..Default::default()
    };
    let error = client.ask(What::Frames(wanted)).unwrap_err().to_string();
    assert!(error.contains("no camera 'nose'"), "{error}");

    // Orders, and those that cannot be.
    client.order(order(order::What::Fire(false))).unwrap();
    client.step(100).unwrap();
    let slew = Slew {
        azimuth_deg: 310.0,
        elevation_deg: 12.5,
    };
    client.order(order(order::What::Slew(slew))).unwrap();
    client.step(100).unwrap();
    for rate in [1.0, -2.0, 0.5] {
        let rates = proto::AzElRates {
            azimuth_degps: rate,
            elevation_degps: 0.1,
        };
        let drive = Drive {
            rates: Some(rates),
            mirror: None,
        };
        client.order(order(order::What::Drive(drive))).unwrap();
        client.step(7).unwrap();
    }
    client
        .order(order(order::What::Drive(Drive::default())))
        .unwrap();
    client
        .order(order(order::What::Release(Release {})))
        .unwrap();
    let weather = proto::Weather {
        visibility_m: Some(7_000.0),
        ..Default::default()
    };
    client.order(order(order::What::Weather(weather))).unwrap();
    for (what, words) in [
        (order::What::Designate("nobody".into()), "nobody"),
        (
            order::What::Goal(proto::Goal::default()),
            "fly.uav: no UAV ''",
        ),
        (
            order::What::Gains(proto::Gains::default()),
            "changes no gain",
        ),
        (
            order::What::Slew(Slew {
                azimuth_deg: f64::NAN,
                elevation_deg: 0.0,
            }),
            "slew_deg[0]",
        ),
    ] {
        let error = client.order(order(what)).unwrap_err().to_string();
        assert!(
            error.starts_with("order: ") && error.contains(words),
            "{error}"
        );
    }
    let stepped = client.run_until(0.5 + 600.0 / tick_hz as f64).unwrap();
    let events = client.events(0).unwrap();
    assert_eq!(
        (events.next, events.end, events.lost),
        (events.events.len() as u64, events.end, 0)
    );
    let obeyed = |event: &proto::Event| matches!(&event.what, Some(proto::event::What::Order(of)) if of.order == "slew" && of.answer == "obeyed");
    assert!(events.events.iter().any(obeyed), "{:?}", events.events);

    let toml = client.scenario().unwrap();
    let finished = client.finish().unwrap();
    assert_eq!(
        (finished.tick, finished.state_hash),
        (stepped.tick, stepped.state_hash)
    );
    assert!(server.end().success());
    assert_eq!(
        std::fs::read_to_string(server.out("scenario.toml")).unwrap(),
        toml
    );
    assert_eq!(
        hash_of(&server.out("scenario.toml"), stepped.tick),
        stepped.state_hash
    );
    assert_eq!(
        server.ticks().last(),
        Some(&(stepped.tick, stepped.state_hash))
    );
    assert!(server.out("summary.json").exists() && server.out("report.html").exists());
}

#[test]
fn a_run_goes_back_and_comes_to_the_same() {
    let mut server = Server::start(&[]);
    let mut client = server.client();
    client.step(50).unwrap();
    client.order(order(order::What::Fire(false))).unwrap();
    let first = client.step(150).unwrap();
    client
        .order(order(order::What::Slew(Slew {
            azimuth_deg: 10.0,
            elevation_deg: 5.0,
        })))
        .unwrap();
    let other = client.step(100).unwrap();
    let back = client.seek(200).unwrap();
    assert_eq!(back, first);
    let error = client.seek(u64::MAX).unwrap_err().to_string();
    assert!(error.contains("the run ends with tick"), "{error}");
    // The order at tick 200 is forgotten, that at 50 is not.
    let toml = client.scenario().unwrap();
    assert!(
        toml.contains("fire = false") && !toml.contains("slew_deg"),
        "{toml}"
    );
    let last = client.step(100).unwrap();
    assert_ne!(last.state_hash, other.state_hash);
    client.finish().unwrap();
    assert!(server.end().success());
    let ticks = server.ticks();
    assert_eq!(ticks.last(), Some(&(300, last.state_hash)));
    assert!(ticks.contains(&(200, first.state_hash)));
    assert_eq!(hash_of(&server.out("scenario.toml"), 300), last.state_hash);
}

#[test]
fn a_run_by_the_clock_goes_on_by_itself_until_it_is_stopped() {
    let mut server = Server::start(&["--pace", "1"]);
    let mut client = server.client();
    assert_eq!(client.welcome().pace, Some(1.0));
    let begun = Instant::now();
    let error = client.step(1).unwrap_err().to_string();
    assert!(error.contains("pause it to step it"), "{error}");
    std::thread::sleep(Duration::from_millis(700));
    let paused = client.pause().unwrap();
    let t_s = client.state().unwrap().t_s;
    let elapsed_s = begun.elapsed().as_secs_f64();
    assert!(t_s > 0.2 && t_s < elapsed_s + 0.05, "{t_s} {elapsed_s}");
    std::thread::sleep(Duration::from_millis(100));
    assert_eq!(client.state().unwrap().tick, paused.tick);
    assert_eq!(client.step(3).unwrap().tick, paused.tick + 3);
    client.resume().unwrap();
    while client.state().unwrap().tick < paused.tick + 50 {
        std::thread::sleep(Duration::from_millis(5));
    }
    let pid = server.child.id().to_string();
    assert!(
        Command::new("kill")
            .args(["-s", "INT", &pid])
            .status()
            .unwrap()
            .success()
    );
    assert_eq!(server.end().code(), Some(130));
    server.says("ticks by the clock ended late, at most by");
    let error = client.state().unwrap_err().to_string();
    assert!(error.contains("stopped by Ctrl-C"), "{error}");
    let ticks = server.ticks();
    let (last, hash) = ticks[ticks.len() - 1];
    assert_eq!(hash_of(&server.out("scenario.toml"), last), hash);
}

#[test]
fn strangers_are_kept_out() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name);
    let serve = |options: &[&str]| {
        let mut command = boresight();
        command.args(["serve", SCENARIO]).args(BLIND).args(options);
        command
    };
    refused(
        &mut serve(&["--listen", "0.0.0.0:0"]),
        &["0.0.0.0:0", "a token is wanted", "--token FILE"],
    );
    std::fs::write(path("short"), "1234\n").unwrap();
    let short = path("short").display().to_string();
    refused(
        &mut serve(&["--listen", "0.0.0.0:0", "--token", &short]),
        &["fewer than 16 characters"],
    );
    refused(
        &mut serve(&["--token", "/nowhere"]),
        &["--token /nowhere", "cannot be read"],
    );
    refused(
        &mut serve(&["--listen", "nowhere"]),
        &["'nowhere' is no address"],
    );
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    refused(
        &mut serve(&["--listen", &address]),
        &["cannot listen on", &address],
    );

    std::fs::write(path("token"), "0123456789abcdef\n").unwrap();
    let token = path("token").display().to_string();
    let server = Server::start(&["--token", &token]);
    for wrong in ["", "0123456789abcdeF", "0123456789abcdef0"] {
        let error = Client::connect(&server.endpoint, "x", wrong)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("the token is not that of the server"),
            "{error}"
        );
    }
    let mut client = Client::connect(&server.endpoint, "x", "0123456789abcdef").unwrap();
    client.ping().unwrap();

    // Over a Unix socket.
    let socket = path("socket");
    let mut child = serve(&["--unix"])
        .arg(&socket)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(child.stderr.take().unwrap())
        .read_line(&mut line)
        .unwrap();
    assert_eq!(line.trim_end(), format!("serve  {}", socket.display()));
    let mut client = Client::connect(&Endpoint::unix(&socket), "x", "").unwrap();
    assert_eq!(client.step(5).unwrap().tick, 5);
    assert_eq!(client.finish().unwrap().folder, "");
    assert!(child.wait().unwrap().success());
    assert!(!socket.exists());
}

#[test]
fn a_client_branches_the_run_by_snapshots() {
    let mut server = Server::unrecorded();
    let mut client = server.client();
    client.run_until(0.5).unwrap();
    let there = client.take_snapshot().unwrap();
    let straight = client.run_until(1.0).unwrap();
    client.restore(there.number).unwrap();
    let hold = Order {
        what: Some(order::What::Fire(false)),
        ..Default::default()
    };
    client.order(hold).unwrap();
    client.run_until(0.9).unwrap();
    assert!(client.scenario().unwrap().contains("fire = false"));

    // Back to where nobody held fire.
    let back = client.restore(there.number).unwrap();
    assert_eq!(back.tick, there.tick);
    assert!(!client.scenario().unwrap().contains("fire = false"));
    assert_eq!(client.run_until(1.0).unwrap(), straight);
    let error = client.restore(9).unwrap_err().to_string();
    assert!(error.contains("there is no snapshot 9"), "{error}");
    // One that begins anew has none of before.
    client.seek(there.tick).unwrap();
    let error = client.restore(there.number).unwrap_err().to_string();
    assert!(error.contains("there is no snapshot"), "{error}");
    client.finish().unwrap();
    assert!(server.end().success());

    let server = Server::start(&[]);
    let mut client = server.client();
    let there = client.take_snapshot().unwrap();
    let error = client.restore(there.number).unwrap_err().to_string();
    assert!(error.contains("recorded does not go back"), "{error}");
    // It goes on.
    client.step(10).unwrap();
}
