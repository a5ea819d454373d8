//! Where a server listens: an address of TCP, or a Unix socket.

use std::fmt;
use std::io::{self, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Where a server listens.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Endpoint {
    /// Address and port.
    Tcp(SocketAddr),
    /// Path of a socket.
    Unix(PathBuf),
}

/// Why an endpoint cannot be had or reached.
#[derive(Debug, thiserror::Error)]
pub enum EndpointError {
    /// It is no address.
    #[error("'{text}' is no address ({why}): expected one with a port, such as 127.0.0.1:7878")]
    Address {
        /// What was given.
        text: String,
        /// What the system said.
        why: String,
    },
    /// Nobody can listen there.
    #[error("cannot listen on {endpoint}: {source}; choose another address, port or path")]
    Listen {
        /// Where.
        endpoint: Endpoint,
        /// What the system said.
        source: io::Error,
    },
    /// Nobody listens there.
    #[error("cannot reach {endpoint}: {source}; does `boresight serve` listen there?")]
    Connect {
        /// Where.
        endpoint: Endpoint,
        /// What the system said.
        source: io::Error,
    },
}

impl Endpoint {
    /// An address by number or name with its port, such as `localhost:7878`.
    pub fn tcp(text: &str) -> Result<Self, EndpointError> {
        let wrong = |why: String| EndpointError::Address {
            text: text.to_owned(),
            why,
        };
        let mut found = text
            .to_socket_addrs()
            .map_err(|error| wrong(error.to_string()))?;
        let first = found
            .next()
            .ok_or_else(|| wrong("it leads nowhere".to_owned()))?;
        Ok(Self::Tcp(first))
    }

    /// The path of a socket.
    pub fn unix(path: impl AsRef<Path>) -> Self {
        Self::Unix(path.as_ref().to_owned())
    }

    /// Whether only this machine reaches it.
    pub fn is_local(&self) -> bool {
        match self {
            Self::Tcp(address) => address.ip().to_canonical().is_loopback(),
            Self::Unix(_) => true,
        }
    }

    /// Connects to a server.
    pub fn connect(&self) -> Result<Connection, EndpointError> {
        let connected = match self {
            Self::Tcp(address) => TcpStream::connect(address).and_then(Connection::of_tcp),
            Self::Unix(path) => UnixStream::connect(path).map(Connection::Unix),
        };
        connected.map_err(|source| EndpointError::Connect {
            endpoint: self.clone(),
            source,
        })
    }

    /// Listens. A socket that a server left behind is replaced; only the user who listens reaches it.
    pub fn listen(&self) -> Result<Listener, EndpointError> {
        let listening = match self {
            Self::Tcp(address) => TcpListener::bind(address).map(Listener::Tcp),
            Self::Unix(path) => listen_on_path(path),
        };
        listening.map_err(|source| EndpointError::Listen {
            endpoint: self.clone(),
            source,
        })
    }
}

fn listen_on_path(path: &Path) -> io::Result<Listener> {
    let left = path
        .symlink_metadata()
        .is_ok_and(|of| of.file_type().is_socket());
    if left && UnixStream::connect(path).is_err() {
        std::fs::remove_file(path)?;
    }
    let socket = UnixListener::bind(path)?;
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o600))?;
    Ok(Listener::Unix(socket, path.to_owned()))
}

impl fmt::Display for Endpoint {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Tcp(address) => address.fmt(f),
            Self::Unix(path) => path.display().fmt(f),
        }
    }
}

/// A server's ear. Dropping it removes the path of a Unix socket.
pub enum Listener {
    /// On an address.
    Tcp(TcpListener),
    /// On a path.
    Unix(UnixListener, PathBuf),
}

impl Listener {
    /// Where it listens: the port that was found where 0 was asked for.
    pub fn endpoint(&self) -> io::Result<Endpoint> {
        match self {
            Self::Tcp(listener) => listener.local_addr().map(Endpoint::Tcp),
            Self::Unix(_, path) => Ok(Endpoint::Unix(path.clone())),
        }
    }

    /// The next client, and what to call where it comes from; waits for it.
    pub fn accept(&self) -> io::Result<(Connection, String)> {
        match self {
            Self::Tcp(listener) => {
                let (stream, from) = listener.accept()?;
                Ok((Connection::of_tcp(stream)?, from.to_string()))
            }
            Self::Unix(listener, path) => {
                let (stream, _) = listener.accept()?;
                Ok((Connection::Unix(stream), path.display().to_string()))
            }
        }
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        if let Self::Unix(_, path) = self {
            // Somebody else may have removed it.
            let _ = std::fs::remove_file(path);
        }
    }
}

/// A connection between client and server. Small messages go at once.
#[derive(Debug)]
pub enum Connection {
    /// Over TCP.
    Tcp(TcpStream),
    /// Over a Unix socket.
    Unix(UnixStream),
}

impl Connection {
    fn of_tcp(stream: TcpStream) -> io::Result<Self> {
        stream.set_nodelay(true)?;
        Ok(Self::Tcp(stream))
    }

    /// The same connection for another thread.
    pub fn try_clone(&self) -> io::Result<Self> {
        match self {
            Self::Tcp(stream) => stream.try_clone().map(Self::Tcp),
            Self::Unix(stream) => stream.try_clone().map(Self::Unix),
        }
    }

    /// Longest time that reading waits; none is for ever.
    pub fn set_read_timeout(&self, longest: Option<Duration>) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => stream.set_read_timeout(longest),
            Self::Unix(stream) => stream.set_read_timeout(longest),
        }
    }

    /// Longest time that writing waits; none is for ever.
    pub fn set_write_timeout(&self, longest: Option<Duration>) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => stream.set_write_timeout(longest),
            Self::Unix(stream) => stream.set_write_timeout(longest),
        }
    }

    /// Ends it, or one direction of it, for all threads.
    pub fn shutdown(&self, how: Shutdown) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => stream.shutdown(how),
            Self::Unix(stream) => stream.shutdown(how),
        }
    }
}

impl Read for Connection {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => stream.read(into),
            Self::Unix(stream) => stream.read(into),
        }
    }
}

impl Write for Connection {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::Tcp(stream) => stream.write(bytes),
            Self::Unix(stream) => stream.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::Tcp(stream) => stream.flush(),
            Self::Unix(stream) => stream.flush(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_loopback_and_paths_are_local() {
        let local = |text: &str| Endpoint::tcp(text).unwrap().is_local();
        assert!(local("127.0.0.1:1") && local("127.9.9.9:1") && local("[::1]:1"));
        assert!(local("[::ffff:127.0.0.1]:1"));
        assert!(!local("0.0.0.0:1") && !local("[::]:1") && !local("192.168.1.2:1"));
        assert!(Endpoint::unix("/tmp/x").is_local());
        let error = Endpoint::tcp("nowhere").unwrap_err().to_string();
        assert!(
            error.contains("'nowhere'") && error.contains("127.0.0.1:7878"),
            "{error}"
        );
    }

    #[test]
    fn a_socket_left_behind_is_replaced_and_one_in_use_is_not() {
        let path = std::env::temp_dir().join(format!("boresight-lockstep-{}", std::process::id()));
        let endpoint = Endpoint::unix(&path);
        drop(UnixListener::bind(&path).unwrap());
        let listener = endpoint.listen().unwrap();
        let mode = path.metadata().unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
        assert!(
            endpoint
                .listen()
                .is_err_and(|error| error.to_string().contains("cannot listen"))
        );
        drop(listener);
        assert!(!path.exists());
        std::fs::write(&path, "mine").unwrap();
        assert!(endpoint.listen().is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"mine");
        std::fs::remove_file(&path).unwrap();
    }
}
