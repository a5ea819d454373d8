//! Clients that break the rules, never read, or vanish.

use super::*;

#[test]
fn hostile_clients_get_one_line_and_the_run_goes_on() {
    let mut server = Server::start(&[]);
    let mut good = server.client();
    good.step(10).unwrap();
    let before = server.memory();

    /// What the server says to a client before it closes the connection.
    fn last_words(mut socket: TcpStream) -> String {
        let mut bytes = Vec::new();
        let _ = socket.read_to_end(&mut bytes);
        let mut reader = boresight_lockstep::Reader::new(&bytes[..], 1 << 20);
        let mut words = Vec::new();
        while let Ok((reply, _)) = reader.read::<proto::Reply>() {
            if let Some(reply::What::Error(error)) = reply.what {
                assert_eq!(reply.id, 0);
                words.push(error.message);
            }
        }
        assert_eq!(words.len(), 1, "{words:?}");
        words.remove(0)
    }

    for (bytes, words) in [
        (
            (2u32 << 30).to_le_bytes().to_vec(),
            "2147483648 bytes is announced",
        ),
        (b"GET / HTTP/1.1\r\n\r\n".to_vec(), "is announced"),
        (vec![3, 0, 0, 0, 0xff, 0xff, 0xff], "cannot be read"),
        (encode(&hello(2, "")), "speaks version 2"),
        (
            encode(&request(1, What::Ping(Ping {}))),
            "the first request must be hello",
        ),
    ] {
        let mut socket = server.socket();
        socket.write_all(&bytes).unwrap();
        let said = last_words(socket);
        assert!(said.contains(words), "{said}");
        server.says(words);
    }
    // The same behind the door: 2 GiB, and half a message from one that leaves.
    let mut socket = server.greeted();
    socket.write_all(&(2u32 << 30).to_le_bytes()).unwrap();
    socket.write_all(&[0; 100_000]).unwrap();
    let said = last_words(socket);
    assert!(said.contains("at most 1048576 are read"), "{said}");
    let mut socket = server.greeted();
    socket.write_all(&[200, 0, 0, 0, 1, 2, 3]).unwrap();
    drop(socket);
    server.says("the connection ended in the middle of a message: 7 of 204 bytes came");
    // A request that asks for nothing known.
    let error = good
        .ask(What::Hello(proto::Hello::default()))
        .unwrap_err()
        .to_string();
    assert!(error.contains("has been said before"), "{error}");

    // More clients than there is room for.
    let many: Vec<_> = (0..15).map(|_| server.greeted()).collect();
    let said = last_words(server.socket());
    assert!(said.contains("16 clients are connected"), "{said}");
    drop(many);

    let stepped = good.step(90).unwrap();
    assert!(
        server.memory() < before + (64 << 20),
        "{before} {}",
        server.memory()
    );
    good.finish().unwrap();
    assert!(server.end().success());
    assert_eq!(server.ticks().last(), Some(&(100, stepped.state_hash)));
    assert_eq!(
        hash_of(&server.out("scenario.toml"), 100),
        stepped.state_hash
    );
}

#[test]
fn ten_thousand_requests_in_flight_are_answered_in_their_order() {
    let server = Server::start(&[]);
    let mut client = server.client();
    let before = server.memory();
    let mut writer = server.greeted();
    let reads = writer.try_clone().unwrap();
    let sends = std::thread::spawn(move || {
        for id in 0..10_000 {
            let what = match id % 10 {
                0 => What::State(GetState::default()),
                _ => What::Ping(Ping {}),
            };
            writer.write_all(&encode(&request(id, what))).unwrap();
        }
        writer
    });
    let mut reader = boresight_lockstep::Reader::new(reads, 1 << 20);
    for id in 0..10_000 {
        let (reply, _) = reader.read::<proto::Reply>().unwrap();
        assert_eq!(reply.id, id);
        // Another has its turn meanwhile.
        if id % 1000 == 0 {
            client.ping().unwrap();
        }
    }
    drop(sends.join().unwrap());
    assert!(server.memory() < before + (16 << 20));
}

#[test]
fn a_client_that_never_reads_is_dropped_and_holds_up_nobody() {
    let server = Server::start(&["--patience", "1"]);
    let mut client = server.client();
    client.step(200).unwrap();
    let before = server.memory();
    let mut deaf = server.greeted();
    let sends = std::thread::spawn(move || {
        let mut bytes = Vec::new();
        for id in 0..10_000 {
            bytes.extend(encode(&request(id, What::State(GetState::default()))));
        }
        // It fails once the server has dropped it.
        while deaf.write_all(&bytes).is_ok() {}
    });
    let mut longest = Duration::ZERO;
    let begun = Instant::now();
    while begun.elapsed().as_secs() < 2 {
        let asked = Instant::now();
        client.step(1).unwrap();
        longest = longest.max(asked.elapsed());
    }
    assert!(longest < Duration::from_millis(500), "{longest:?}");
    let line = server.says("has taken nothing for 1 s");
    assert!(
        line.starts_with("client 2 'bare' (127.0.0.1:") && line.ends_with("it is dropped"),
        "{line}"
    );
    sends.join().unwrap();
    assert!(
        server.memory() < before + (32 << 20),
        "{before} {}",
        server.memory()
    );
    client.step(1).unwrap();
}

#[test]
fn a_client_that_is_killed_in_the_middle_of_a_step_harms_nothing() {
    let mut server = Server::start(&[]);
    let mut client = server.client();
    let mut killed = server.greeted();
    let step = Step {
        ticks: 2_000,
        with_state: true,
    };
    killed
        .write_all(&encode(&request(2, What::Step(step))))
        .unwrap();
    std::thread::sleep(Duration::from_millis(20));
    drop(killed);
    // Its step is carried out whole.
    while client.state().unwrap().tick == 0 {}
    let stepped = client.step(1).unwrap();
    assert_eq!(stepped.tick, 2_001);
    // Nobody is there any more; another comes and finds the run as it was.
    drop(client);
    let mut client = server.client();
    assert_eq!(client.state().unwrap().state_hash, stepped.state_hash);
    client.finish().unwrap();
    assert!(server.end().success());
    assert_eq!(server.ticks().last(), Some(&(2_001, stepped.state_hash)));
    assert_eq!(
        hash_of(&server.out("scenario.toml"), 2_001),
        stepped.state_hash
    );
    // A killed server leaves its recording readable, too, and a run that is over ends once all have left.
    let mut server = Server::start(&["--set", "duration_s=0.2"]);
    let mut client = server.client();
    assert!(client.step(10_000).unwrap().over);
    let error = client
        .order(order(order::What::Fire(true)))
        .unwrap_err()
        .to_string();
    assert!(error.contains("the run is over"), "{error}");
    drop(client);
    assert!(server.end().success());
    let whole = run_scenario(
        "urban_intercept",
        &[&BLIND[..], &["--set", "duration_s=0.2"]].concat(),
    );
    assert_eq!(server.ticks(), tick_hashes(&whole));
}
