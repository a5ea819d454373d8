use super::*;
use flate2::{Compression, write::GzEncoder};
use std::io::{BufRead, Write};
use std::net::{TcpListener, TcpStream};

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// Serves connections until the test ends: `answer` gets the path asked for.
fn serve(answer: fn(&str, &mut TcpStream)) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("http://{}", listener.local_addr().unwrap());
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let Ok(mut stream) = stream else { return };
            std::thread::spawn(move || {
                let mut lines = BufReader::new(stream.try_clone().unwrap()).lines();
                let first = lines
                    .next()
                    .unwrap_or(Ok(String::new()))
                    .unwrap_or_default();
                for line in lines {
                    if line.is_ok_and(|line| line.is_empty()) {
                        break;
                    }
                }
                let path = first.split(' ').nth(1).unwrap_or("").to_string();
                answer(&path, &mut stream);
            });
        }
    });
    address
}

fn send(stream: &mut TcpStream, head: &str, body: &[u8]) {
    let length = body.len();
    let head = format!("HTTP/1.1 {head}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n");
    // The other side may have gone.
    let _ = stream
        .write_all(head.as_bytes())
        .and_then(|()| stream.write_all(body));
}

fn answer(path: &str, stream: &mut TcpStream) {
    match path {
        "/plain?key=1" => send(stream, "200 OK", b"plain"),
        "/packed" => send(stream, "200 OK\r\nContent-Encoding: gzip", &gzip(b"packed")),
        "/inner" => send(stream, "200 OK", &gzip(b"inner")),
        "/large" => send(stream, "200 OK", &[7; 5000]),
        "/bomb" => send(
            stream,
            "200 OK\r\nContent-Encoding: gzip",
            &gzip(&[0; 1 << 20]),
        ),
        "/moved" => send(stream, "302 Found\r\nLocation: /plain?key=1", b""),
        "/failing" => send(stream, "500 Internal Server Error", b"no"),
        "/slow" => std::thread::sleep(Duration::from_secs(3)),
        "/drops" => {
            let _ = stream.write_all(b"HTTP/1.1 200 OK\r\nContent-Length: 100\r\n\r\nonly so");
        }
        "/noise" => drop(stream.write_all(b"\x00\x01 no answer\r\n\r\n")),
        _ => send(stream, "404 Not Found", b""),
    }
}

#[test]
fn addresses_are_read_and_their_failures_told() {
    let address = serve(answer);
    let fetcher = Fetcher::new(Limits {
        bytes: 4096,
        silence: Duration::from_millis(700),
        whole: Duration::from_secs(2),
    });
    let read = |path: &str| fetcher.read(&format!("{address}{path}"));
    assert_eq!(read("/plain?key=1").unwrap(), b"plain");
    assert_eq!(read("/packed").unwrap(), b"packed");
    assert_eq!(read("/inner").unwrap(), b"inner");
    assert_eq!(read("/moved").unwrap(), b"plain");
    let started = std::time::Instant::now();
    for (path, told) in [
        ("/nothing", "404"),
        ("/failing", "500"),
        ("/large", "more than"),
        ("/bomb", "more than"),
        ("/slow", "too slow"),
        ("/drops", ""),
        ("/noise", ""),
    ] {
        let error = read(path).unwrap_err().to_string();
        assert!(error.contains(path) && error.contains(told), "{error}");
    }
    assert!(started.elapsed() < Duration::from_secs(10));
    // Nobody listens there.
    let closed = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap();
    assert!(fetcher.read(&format!("http://{closed}/x")).is_err());
}

#[test]
fn files_gzip_and_archives_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    std::fs::write(at("plain"), b"plain").unwrap();
    std::fs::write(at("packed"), gzip(b"packed")).unwrap();
    std::fs::write(at("broken"), &gzip(&[5; 1000])[..20]).unwrap();
    std::fs::write(at("bomb"), gzip(&vec![0; 1 << 20])).unwrap();
    std::fs::write(at("no.3tz"), b"no archive").unwrap();
    let mut archive = zip::ZipWriter::new(File::create(at("city.3tz")).unwrap());
    let stored =
        zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    let deflated = stored.compression_method(zip::CompressionMethod::Deflated);
    for (name, bytes, how) in [
        ("tileset.json", &b"{}"[..], stored),
        ("a/b.glb", b"glTF", deflated),
    ] {
        archive.start_file(name, how).unwrap();
        archive.write_all(bytes).unwrap();
    }
    archive.finish().unwrap();
    let fetcher = Fetcher::new(Limits {
        bytes: 4096,
        ..Limits::default()
    });
    let read = |name: &str| fetcher.read(&at(name));
    assert_eq!(read("plain").unwrap(), b"plain");
    assert_eq!(read("packed").unwrap(), b"packed");
    assert_eq!(read("city.3tz/tileset.json").unwrap(), b"{}");
    assert_eq!(read("city.3tz/a/b.glb").unwrap(), b"glTF");
    for (name, told) in [
        ("broken", "gzip"),
        ("bomb", "more than"),
        ("none", "no such file"),
        ("", "no file"),
        ("city.3tz/none", "not in the archive"),
        ("no.3tz/tileset.json", "no archive"),
    ] {
        let error = read(name).unwrap_err().to_string();
        assert!(error.contains(told), "{name}: {error}");
    }
}

#[test]
fn data_addresses_are_read() {
    let fetcher = Fetcher::default();
    assert_eq!(
        fetcher
            .read("data:application/octet-stream;base64,AQID")
            .unwrap(),
        [1, 2, 3]
    );
    assert_eq!(fetcher.read("data:,a%20b").unwrap(), b"a b");
    assert!(fetcher.read("data:;base64,???").is_err());
}

#[test]
fn references_are_resolved() {
    let folder = tempfile::tempdir().unwrap();
    let base = folder.path().join("t/tileset.json");
    std::fs::create_dir(folder.path().join("t")).unwrap();
    std::fs::write(folder.path().join("t/odd#1.glb"), b"").unwrap();
    let (base, root) = (base.to_str().unwrap(), folder.path().to_str().unwrap());
    for (reference, expected) in [
        ("a.glb", format!("{root}/t/a.glb")),
        ("./b/../c.glb", format!("{root}/t/c.glb")),
        (
            "../x.3tz/tileset.json",
            format!("{root}/x.3tz/tileset.json"),
        ),
        ("a%20b.glb?foo=bar#baz", format!("{root}/t/a b.glb")),
        ("odd#1.glb", format!("{root}/t/odd#1.glb")),
        ("/abs/a.glb", "/abs/a.glb".into()),
        ("https://other/a.glb?k=1", "https://other/a.glb?k=1".into()),
    ] {
        assert_eq!(resolve(base, reference).unwrap(), expected);
    }
    let base = "http://server:8/v1/root/tileset.json?key=K&session=old#f";
    for (reference, expected) in [
        ("a.glb", "http://server:8/v1/root/a.glb?key=K&session=old"),
        (
            "../a.json?session=new#x",
            "http://server:8/v1/a.json?session=new&key=K",
        ),
        ("/top.glb", "http://server:8/top.glb?key=K&session=old"),
        (
            "../../../../a.glb",
            "http://server:8/a.glb?key=K&session=old",
        ),
        ("http://else/a.glb", "http://else/a.glb"),
        ("//else/a.glb", "http://else/a.glb"),
    ] {
        assert_eq!(resolve(base, reference).unwrap(), expected);
    }
    assert!(resolve(base, "file:///etc/passwd").is_err());
    assert!(resolve(base, "").is_err() && resolve("a/b.json", "ftp://x/y").is_err());
}
