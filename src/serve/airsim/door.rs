//! How AirSim's clients are let in: without a word, for they have none to say.

use crate::serve::entrance::{House, say};
use crate::serve::inbox::{Client, Inbox};
use boresight_airsim::{Call, FramingError, Reader, refusal};
use boresight_lockstep::Connection;
use std::sync::Arc;
use std::time::Duration;

/// What every client is let in by.
pub(super) struct Door {
    /// Where calls wait.
    pub inbox: Arc<Inbox<Call>>,
    /// How long a client may take nothing of what waits for it.
    pub patience: Duration,
}

impl House for Door {
    type Request = Call;
    type Reader = Reader<Connection>;

    fn inbox(&self) -> &Inbox<Call> {
        &self.inbox
    }

    fn patience(&self) -> Duration {
        self.patience
    }

    fn refusal(id: u64, why: &str) -> Vec<u8> {
        // The numbers of calls have 32 bits.
        refusal(u32::try_from(id).unwrap_or(0), why)
    }

    fn reader(connection: Connection) -> Self::Reader {
        Reader::new(connection)
    }

    fn connection(reader: &Self::Reader) -> &Connection {
        reader.stream()
    }

    fn greet(&self, client: &mut Client, _: &mut Self::Reader) -> Result<(), String> {
        self.inbox.join(client.clone());
        Ok(())
    }

    fn read_all(&self, client: &Client, reader: &mut Self::Reader) -> Result<(), String> {
        loop {
            match reader.read() {
                Ok((call, bytes)) => {
                    if !self.inbox.put(client.id, call, bytes) {
                        return Ok(());
                    }
                }
                Err(FramingError::Closed) => return Ok(()),
                // It was killed, or dropped by the one who sends.
                Err(FramingError::Io(error)) => {
                    say(format_args!("{client}: the connection failed: {error}"));
                    client.outbox.close();
                    return Ok(());
                }
                Err(error) => return Err(error.to_string()),
            }
        }
    }

    fn leave(&self, _: u64) {}
}
