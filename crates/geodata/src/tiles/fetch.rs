//! Where bytes come from: files, members of `.3tz` and `.zip` archives, `http` and `https`, `data:` addresses;
//! compressed by gzip or not.
//!
//! A member of an archive has a location like a file in a folder: `city.3tz/tileset.json`.

use crate::tiles::error::TilesError;
use base64::engine::DecodePaddingMode;
use base64::engine::general_purpose::{GeneralPurpose, GeneralPurposeConfig};
use base64::{Engine as _, alphabet};
use flate2::read::MultiGzDecoder;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use zip::ZipArchive;

/// How much and how long is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// The most that one location may hold, decompressed [byte].
    pub bytes: u64,
    /// The longest that an address may take to connect, to begin its answer, or to be silent in it.
    pub silence: Duration,
    /// The longest that an address may take altogether.
    pub whole: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            bytes: 512 << 20, // [byte]
            silence: Duration::from_secs(20),
            whole: Duration::from_secs(300),
        }
    }
}

type Archive = Arc<Mutex<ZipArchive<BufReader<File>>>>;

/// Reads locations. Clones share open archives and connections.
#[derive(Clone, Debug)]
pub struct Fetcher {
    limits: Limits,
    agent: ureq::Agent,
    archives: Arc<Mutex<BTreeMap<PathBuf, Archive>>>,
}

impl Default for Fetcher {
    fn default() -> Self {
        Self::new(Limits::default())
    }
}

impl Fetcher {
    /// One with limits of its own.
    pub fn new(limits: Limits) -> Self {
        let silence = Some(limits.silence);
        let config = ureq::Agent::config_builder()
            .user_agent(concat!("boresight/", env!("CARGO_PKG_VERSION")))
            .timeout_global(Some(limits.whole))
            .timeout_connect(silence)
            .timeout_recv_response(silence)
            .timeout_per_read(silence)
            .max_redirects(5)
            .build();
        Self {
            limits,
            agent: config.new_agent(),
            archives: Arc::default(),
        }
    }

    /// Everything that a location holds, decompressed.
    pub fn read(&self, location: &str) -> Result<Vec<u8>, TilesError> {
        let bytes = if is_address(location) {
            self.get(location)?
        } else if let Some(rest) = location.strip_prefix("data:") {
            data(rest).ok_or_else(|| {
                let shown: String = location.chars().take(40).collect();
                fault(&shown, "is no data address; expected data:…;base64,…")
            })?
        } else {
            self.open(Path::new(location))?
        };
        if bytes.starts_with(&[0x1f, 0x8b]) {
            let unpack = self.limited(MultiGzDecoder::new(&bytes[..]), location);
            return unpack.map_err(|error| match error {
                TilesError::Fetch { reason, .. } if !reason.starts_with("holds") => fault(
                    location,
                    &format!("is damaged gzip ({reason}); make it again"),
                ),
                error => error,
            });
        }
        Ok(bytes)
    }

    fn get(&self, location: &str) -> Result<Vec<u8>, TilesError> {
        let failed = |error: ureq::Error| match error {
            ureq::Error::StatusCode(status) => fault(
                location,
                &format!("the server answers {status}; check the address"),
            ),
            ureq::Error::Timeout(_) => fault(
                location,
                "the server is too slow; try again, or fetch the tileset to a file",
            ),
            error => fault(
                location,
                &format!("{error}; check the address and the network"),
            ),
        };
        let mut answer = self.agent.get(location).call().map_err(failed)?;
        // The limit below counts what comes out of the decompression too.
        let body = answer.body_mut().with_config().limit(u64::MAX);
        self.limited(body.reader(), location)
    }

    fn open(&self, path: &Path) -> Result<Vec<u8>, TilesError> {
        let location = path.display().to_string();
        if let Some((archive, member)) = in_archive(path) {
            let archive = self.archive(&archive)?;
            let mut archive = archive.lock().unwrap_or_else(PoisonError::into_inner);
            let file = archive.by_name(&member).map_err(|error| {
                let reason = match error {
                    zip::result::ZipError::FileNotFound => "is not in the archive".to_string(),
                    error => error.to_string(),
                };
                fault(&location, &format!("{reason}; make the archive again"))
            })?;
            return self.limited(file, &location);
        }
        let failed = |error: std::io::Error| {
            let reason = match error.kind() {
                ErrorKind::NotFound => "there is no such file; check the path".into(),
                ErrorKind::IsADirectory => "is a folder; name a file in it".into(),
                _ => format!("{error}; name a file that can be read"),
            };
            fault(&location, &reason)
        };
        let file = File::open(path).map_err(failed)?;
        if !file.metadata().map_err(failed)?.is_file() {
            return Err(fault(&location, "is no file; name one"));
        }
        self.limited(file, &location)
    }

    /// An archive, opened at its first use.
    fn archive(&self, path: &Path) -> Result<Archive, TilesError> {
        let mut open = self.archives.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(archive) = open.get(path) {
            return Ok(archive.clone());
        }
        let failed = |error: String| {
            let reason = format!("is no archive that can be read ({error}); make it again");
            fault(&path.display().to_string(), &reason)
        };
        let file = File::open(path).map_err(|error| failed(error.to_string()))?;
        let archive = ZipArchive::new(BufReader::new(file)).map_err(|e| failed(e.to_string()))?;
        let archive = Arc::new(Mutex::new(archive));
        open.insert(path.to_owned(), archive.clone());
        Ok(archive)
    }

    fn limited(&self, reader: impl Read, location: &str) -> Result<Vec<u8>, TilesError> {
        let mut bytes = Vec::new();
        let most = self.limits.bytes;
        let read = reader.take(most + 1).read_to_end(&mut bytes);
        read.map_err(|error| fault(location, &error.to_string()))?;
        if bytes.len() as u64 > most {
            let reason = format!("holds more than {} MiB; split it", most >> 20);
            return Err(fault(location, &reason));
        }
        Ok(bytes)
    }
}

fn fault(location: &str, reason: &str) -> TilesError {
    TilesError::Fetch {
        location: location.into(),
        reason: reason.into(),
    }
}

/// Whether a location is on a network.
pub(super) fn is_address(location: &str) -> bool {
    let lower = location.get(..8).unwrap_or(location).to_ascii_lowercase();
    lower.starts_with("http://") || lower.starts_with("https://")
}

/// The archive that a path runs through, and the path inside.
fn in_archive(path: &Path) -> Option<(PathBuf, String)> {
    let packed = |path: &Path| {
        let end = path.extension().and_then(|end| end.to_str());
        end.is_some_and(|end| ["3tz", "zip"].contains(&&end.to_ascii_lowercase()[..]))
    };
    let archive = path
        .ancestors()
        .skip(1)
        .find(|p| packed(p) && p.is_file())?;
    let member = path.strip_prefix(archive).ok()?.to_str()?;
    Some((archive.to_owned(), member.replace('\\', "/")))
}

/// What a `data:` address holds, its scheme taken off.
pub(crate) fn data(rest: &str) -> Option<Vec<u8>> {
    const LENIENT: GeneralPurpose = GeneralPurpose::new(
        &alphabet::STANDARD,
        GeneralPurposeConfig::new().with_decode_padding_mode(DecodePaddingMode::Indifferent),
    );
    let (kind, text) = rest.split_once(',')?;
    let plain = unescape(text);
    if kind.ends_with(";base64") {
        // Long ones are broken into lines by hand.
        let packed: Vec<u8> = plain
            .iter()
            .copied()
            .filter(|c| !c.is_ascii_whitespace())
            .collect();
        return LENIENT.decode(packed).ok();
    }
    Some(plain.into_owned())
}

/// Percent escapes undone.
pub(crate) fn unescape(text: &str) -> Cow<'_, [u8]> {
    let bytes = text.as_bytes();
    if !bytes.contains(&b'%') {
        return Cow::Borrowed(bytes);
    }
    let mut plain = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        let hex = text.get(i + 1..i + 3).filter(|_| bytes[i] == b'%');
        match hex.and_then(|hex| u8::from_str_radix(hex, 16).ok()) {
            Some(byte) => {
                plain.push(byte);
                i += 3;
            }
            None => {
                plain.push(bytes[i]);
                i += 1;
            }
        }
    }
    Cow::Owned(plain)
}

/// The location that a reference inside another file means; relative ones lie beside that file. An address keeps
/// its parameters, and hands those that a reference does not have itself on to it (keys, sessions) on the same
/// server. Parameters of files are dropped. What came from a network leads to no file.
pub fn resolve(base: &str, reference: &str) -> Result<String, TilesError> {
    let wrong = |what: &str, mend: &str| TilesError::Unsupported {
        location: base.into(),
        what: format!(
            "the reference '{}' ({what})",
            reference.chars().take(80).collect::<String>()
        ),
        mend: mend.into(),
    };
    if reference.starts_with("data:") || is_address(reference) {
        return Ok(reference.into());
    }
    if reference.is_empty() {
        return Err(wrong("empty", "name a file"));
    }
    if is_address(base) {
        if scheme(reference).is_some() {
            return Err(wrong("of another scheme", "use http or https"));
        }
        return Ok(beside_address(base, reference));
    }
    let (reference, local) = match scheme(reference) {
        None => (reference, Path::new(reference)),
        Some("file") => {
            let path = reference[5..].trim_start_matches("//");
            (path, Path::new(path))
        }
        Some(_) => {
            return Err(wrong(
                "of another scheme",
                "use a relative path, http or https",
            ));
        }
    };
    let folder = Path::new(base).parent().unwrap_or(Path::new(""));
    // A name may hold what looks like parameters or escapes.
    let literal = folder.join(local);
    let path = if !reference.contains(['?', '#', '%']) || literal.is_file() {
        literal
    } else {
        let plain = reference.split(['?', '#']).next().unwrap_or(reference);
        let plain = unescape(plain);
        folder.join(&*String::from_utf8_lossy(&plain))
    };
    let path = path
        .to_str()
        .ok_or_else(|| wrong("no text", "rename the file"))?;
    Ok(straight(path))
}

/// The scheme of a reference, if it has one; a drive's letter is none.
fn scheme(reference: &str) -> Option<&str> {
    let (scheme, _) = reference.split_once(':')?;
    let named = scheme.len() > 1
        && scheme
            .bytes()
            .all(|c| c.is_ascii_alphanumeric() || c == b'+');
    named.then_some(scheme)
}

/// An address beside another (RFC 3986, section 5.2), with the other's parameters.
fn beside_address(base: &str, reference: &str) -> String {
    let base = base.split('#').next().unwrap_or(base);
    let (base, base_query) = base.split_once('?').unwrap_or((base, ""));
    let start = base.find("://").map_or(0, |at| at + 3);
    let server_end = base[start..].find('/').map_or(base.len(), |at| start + at);
    let (server, base_path) = base.split_at(server_end);
    let reference = reference.split('#').next().unwrap_or(reference);
    let (path, query) = reference.split_once('?').unwrap_or((reference, ""));
    if let Some(other) = path.strip_prefix("//") {
        // Another server on the same scheme learns no parameters.
        let mark = if query.is_empty() { "" } else { "?" };
        return format!("{}//{other}{mark}{query}", &base[..start - 2]);
    }
    let path = if path.starts_with('/') {
        path.to_string()
    } else {
        let folder = base_path.rsplit_once('/').map_or("", |(folder, _)| folder);
        format!("{folder}/{path}")
    };
    let key = |pair: &str| pair.split('=').next().unwrap_or(pair).to_string();
    let own: Vec<String> = query.split('&').map(key).collect();
    let inherited = base_query
        .split('&')
        .filter(|pair| !own.contains(&key(pair)));
    let pairs: Vec<&str> = (query.split('&').chain(inherited))
        .filter(|pair| !pair.is_empty())
        .collect();
    let mark = if pairs.is_empty() { "" } else { "?" };
    format!("{server}{}{mark}{}", straight(&path), pairs.join("&"))
}

/// A path without `.` and `..`, as far as they can be undone.
fn straight(path: &str) -> String {
    let mut parts: Vec<&str> = Vec::new();
    for part in path.split('/') {
        match part {
            "." => {}
            ".." if parts.last().is_some_and(|last| !["..", ""].contains(last)) => {
                parts.pop();
            }
            ".." if parts == [""] => {}
            part => parts.push(part),
        }
    }
    parts.join("/")
}

#[cfg(test)]
mod tests;
