//! Where MAVLink is spoken: `udpout:127.0.0.1:14550` and the like, on this machine alone.

use std::fmt;
use std::net::{SocketAddr, ToSocketAddrs};

/// How a connection comes to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Datagrams go to the address, and come from whoever answers.
    UdpOut,
    /// Datagrams come to the address, and go to whoever has sent one.
    UdpIn,
    /// A stream to one that listens at the address.
    TcpOut,
    /// Streams of those that come to the address.
    TcpIn,
}

impl Kind {
    const ALL: [(Self, &'static str); 4] = [
        (Self::UdpOut, "udpout"),
        (Self::UdpIn, "udpin"),
        (Self::TcpOut, "tcpout"),
        (Self::TcpIn, "tcpin"),
    ];

    fn name(self) -> &'static str {
        let found = Self::ALL.iter().find(|(kind, _)| *kind == self);
        found.map_or("", |(_, name)| name)
    }
}

/// An address of this machine, and how it is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Address {
    pub kind: Kind,
    pub at: SocketAddr,
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}:{}", self.kind.name(), self.at)
    }
}

impl Address {
    /// Reads one, or says in a line what is wrong with it.
    pub(super) fn read(text: &str) -> Result<Self, String> {
        let wanted = "expected udpout, udpin, tcpout or tcpin with address and port, such as udpout:127.0.0.1:14550";
        let (name, place) = text.split_once(':').ok_or(wanted)?;
        let kind = Kind::ALL.into_iter().find(|(_, known)| *known == name);
        let (kind, _) = kind.ok_or(wanted)?;
        let found = place.to_socket_addrs();
        let mut found =
            found.map_err(|error| format!("'{place}' is no address: {error}; {wanted}"))?;
        let at = found.next().ok_or(wanted)?;
        if !at.ip().is_loopback() {
            return Err(format!(
                "{at}: MAVLink lets in whoever reaches it, so it is spoken on this machine alone: give 127.0.0.1 or [::1]"
            ));
        }
        Ok(Self { kind, at })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_of_this_machine_are_read_and_others_refused() {
        for text in [
            "udpout:127.0.0.1:14550",
            "udpin:[::1]:14550",
            "tcpin:127.0.0.2:4560",
            "tcpout:127.0.0.1:5760",
        ] {
            assert_eq!(Address::read(text).unwrap().to_string(), text);
        }
        for (text, named) in [
            ("14550", "expected udpout"),
            ("serial:/dev/ttyUSB0:57600", "expected udpout"),
            ("udpout:127.0.0.1", "is no address"),
            ("udpout:192.0.2.1:14550", "this machine alone"),
            ("udpin:0.0.0.0:14550", "this machine alone"),
            ("tcpin:[::]:4560", "this machine alone"),
        ] {
            let error = Address::read(text).unwrap_err();
            assert!(error.contains(named), "{text}: {error}");
        }
    }
}
