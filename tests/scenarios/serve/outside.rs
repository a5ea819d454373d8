//! A client that is the detector.

use super::*;
use boresight::simulation::{Builder, SimulationError};

/// A server whose detector is a client.
fn outside(options: &[&str]) -> Server {
    Server::of(&[&["--set", "detector.kind=outside"][..], options].concat())
}

#[test]
fn a_client_is_the_detector() {
    let mut server = outside(&[]);
    let mut client = server.client();
    assert!(client.welcome().outside_detector);
    let error = client.step(1).unwrap_err().to_string();
    assert!(error.contains("send be_detector first"), "{error}");
    let wanted = BeDetector {
        pixels: false,
        truth: true,
    };
    // It boxes what is there.
    let found = |question: &proto::Question| {
        let frame = question.frame.as_ref().unwrap();
        let boxes = frame
            .truth
            .iter()
            .filter(|seen| seen.clear)
            .map(|seen| proto::Box {
                box_px: seen.box_px.clone(),
                score: 0.9,
                class: "quadcopter".into(),
            });
        boxes.collect()
    };
    client.detect(wanted, found).unwrap();
    let other = server
        .client()
        .ask(What::BeDetector(wanted))
        .unwrap_err()
        .to_string();
    assert!(other.contains("is the detector already"), "{other}");
    let first = client.run_until(1.5).unwrap();
    let state = client.state().unwrap();
    assert!(
        ["coarse", "precise", "engage"].contains(&state.stations[0].state.as_str()),
        "{:?}",
        state.stations[0]
    );
    // Made again, with the same answers, it is the same.
    assert_eq!(client.seek(first.tick).unwrap(), first);
    client.finish().unwrap();
    assert!(server.end().success());

    // Without the client, by the answers that it left.
    let again = |change: fn(String) -> String| {
        let text = std::fs::read_to_string(server.out("answers.csv")).unwrap();
        std::fs::write(server.out("answers.csv"), change(text)).unwrap();
        let builder = Builder::file(server.out("scenario.toml"));
        let mut run = builder.pictures(false).open()?;
        run.step(first.tick)?;
        Ok::<u64, SimulationError>(run.view().state_hash())
    };
    assert_eq!(again(|text| text).unwrap(), first.state_hash);
    let fewer = |text: String| {
        text.lines()
            .take(9)
            .map(|line| format!("{line}\n"))
            .collect()
    };
    let error = again(fewer).unwrap_err().to_string();
    assert!(error.contains("has no answer for tick"), "{error}");
    let error = again(|text| text.replacen("quadcopter", "cat", 1))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("answers.csv: line 2: class 'cat'"),
        "{error}"
    );
}

#[test]
fn a_detector_that_fails_ends_the_run_with_one_line() {
    let wanted = BeDetector {
        pixels: false,
        truth: false,
    };
    // It takes too long.
    let mut server = outside(&["--detector-timeout", "0.5"]);
    let mut client = server.client();
    let begun = Instant::now();
    let slow = |_: &proto::Question| {
        std::thread::sleep(Duration::from_secs(1));
        Vec::new()
    };
    client.detect(wanted, slow).unwrap();
    let error = client.step(1_000).unwrap_err().to_string();
    assert!(
        error.contains("has not answered a frame within 0.5 s"),
        "{error}"
    );
    assert_eq!(server.end().code(), Some(2));
    server.says("has not answered a frame within 0.5 s");
    assert!(begun.elapsed().as_secs() < 10);

    // It leaves in the middle of a step of another.
    let mut server = outside(&[]);
    let mut client = server.client();
    let mut detector = server.client();
    detector.send(What::BeDetector(wanted)).unwrap();
    detector.receive().unwrap();
    client
        .send(What::Step(Step {
            ticks: 1_000,
            with_state: false,
        }))
        .unwrap();
    let question = detector.receive().unwrap();
    assert!(
        matches!(question.what, Some(reply::What::Question(_))),
        "{question:?}"
    );
    // What makes no sense is refused, and may be mended.
    let detected = proto::Detected {
        question: 0,
        boxes: vec![proto::Box {
            box_px: vec![1.0, 2.0],
            score: 0.5,
            class: String::new(),
        }],
    };
    detector.send(What::Detected(detected)).unwrap();
    let error = loop {
        if let Some(reply::What::Error(error)) = detector.receive().unwrap().what {
            break error.message;
        }
    };
    assert!(error.contains("boxes[0]: box_px must be"), "{error}");
    drop(detector);
    let Some(reply::What::Error(error)) = client.receive().unwrap().what else {
        panic!()
    };
    assert!(
        error.message.contains("the run's detector, has left with"),
        "{}",
        error.message
    );
    assert_eq!(server.end().code(), Some(2));
    // What was recorded until then can be read.
    assert!(server.out("run.mcap").exists());

    // A scenario with a detector of its own wants none.
    let server = Server::start(&[]);
    let error = server
        .client()
        .ask(What::BeDetector(wanted))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("the scenario's detector is \"truth\""),
        "{error}"
    );
    let error = server
        .client()
        .ask(What::Seek(Seek {
            tick: u64::MAX,
            with_state: false,
        }))
        .unwrap_err();
    assert!(error.to_string().contains("seek: tick"), "{error}");
}
