//! Requests that wait for the run: few of each client, which take turns.

use super::outbox::Outbox;
use boresight_lockstep::proto::Request;
use std::collections::{BTreeMap, VecDeque};
use std::fmt;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Requests that are carried out between two ticks of a run that is behind the clock.
pub(super) const BETWEEN_LATE_TICKS: usize = 8;
/// Requests of one client that wait at most; those that follow wait in its connection.
const MOST_REQUESTS: usize = 32;
/// Their bytes at most, but for the first.
const MOST_BYTES: usize = 1 << 20;
/// How long the run looks for the next request before its thread sleeps: waking it takes about as long.
const SPIN: Duration = Duration::from_micros(40);
/// How long it sleeps at most: so soon it sees that it was stopped, and that a client has taken its replies.
const NAP: Duration = Duration::from_millis(20);
/// The same where a client that is not ready has requests waiting.
const SHORT_NAP: Duration = Duration::from_millis(2);

/// A client that has been let in.
#[derive(Clone)]
pub(super) struct Client {
    /// Its number; none is given twice.
    pub id: u64,
    /// What it calls itself, and where it comes from.
    pub name: String,
    pub from: String,
    /// The way to it.
    pub outbox: Outbox,
}

impl fmt::Display for Client {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Self { id, name, from, .. } = self;
        match name.is_empty() {
            true => write!(f, "client {id} ({from})"),
            false => write!(f, "client {id} '{name}' ({from})"),
        }
    }
}

/// What [`Inbox::take`] finds.
pub(super) enum Taken<R> {
    /// A request.
    Request(Box<(Client, R)>),
    /// The time that was given has come.
    Due,
    /// Nothing yet.
    Nothing,
}

/// The requests of all clients.
pub(super) struct Inbox<R = Request> {
    seats: Mutex<Seats<R>>,
    came: Condvar,
    room: Condvar,
}

struct Seats<R> {
    seats: BTreeMap<u64, Seat<R>>,
    /// The client that has the next turn, or the next one after it.
    turn: u64,
    had_any: bool,
    closed: bool,
}

struct Seat<R> {
    client: Client,
    waiting: VecDeque<(R, usize)>,
    bytes: usize,
    left: bool,
}

impl<R> Default for Inbox<R> {
    fn default() -> Self {
        let seats = Seats {
            seats: BTreeMap::new(),
            turn: 0,
            had_any: false,
            closed: false,
        };
        Self {
            seats: Mutex::new(seats),
            came: Condvar::new(),
            room: Condvar::new(),
        }
    }
}

impl<R> Inbox<R> {
    fn lock(&self) -> MutexGuard<'_, Seats<R>> {
        self.seats.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Lets a client in.
    pub(super) fn join(&self, client: Client) {
        let mut seats = self.lock();
        seats.had_any = true;
        let seat = Seat {
            client,
            waiting: VecDeque::new(),
            bytes: 0,
            left: false,
        };
        seats.seats.insert(seat.client.id, seat);
        self.came.notify_all();
    }

    /// Puts in a request of so many bytes; waits for room. False once no more requests are taken.
    pub(super) fn put(&self, id: u64, request: R, bytes: usize) -> bool {
        let mut seats = self.lock();
        loop {
            let closed = seats.closed;
            let Some(seat) = seats.seats.get_mut(&id).filter(|_| !closed) else {
                return false;
            };
            let fits = seat.waiting.len() < MOST_REQUESTS && seat.bytes + bytes <= MOST_BYTES;
            if fits || seat.waiting.is_empty() {
                seat.bytes += bytes;
                seat.waiting.push_back((request, bytes));
                self.came.notify_all();
                return true;
            }
            seats = self
                .room
                .wait(seats)
                .unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// A client has left; its requests that came whole are still carried out.
    pub(super) fn leave(&self, id: u64) {
        let mut seats = self.lock();
        if let Some(seat) = seats.seats.get_mut(&id) {
            seat.left = true;
            if seat.waiting.is_empty() {
                seats.seats.remove(&id);
            }
        }
        self.came.notify_all();
    }

    /// Whether any client has ever been let in.
    pub(super) fn had_any(&self) -> bool {
        self.lock().had_any
    }

    /// Whether there were clients, and all have left.
    pub(super) fn is_abandoned(&self) -> bool {
        let seats = self.lock();
        seats.had_any && seats.seats.is_empty()
    }

    /// The clients that are there.
    pub(super) fn clients(&self) -> Vec<Client> {
        let seats = self.lock();
        seats
            .seats
            .values()
            .map(|seat| seat.client.clone())
            .collect()
    }

    /// Takes no more requests.
    pub(super) fn close(&self) {
        self.lock().closed = true;
        self.room.notify_all();
    }

    /// The next request that is there.
    pub(super) fn try_take(&self) -> Option<(Client, R)> {
        self.next(&mut self.lock()).0
    }

    /// The next request; waits for it a little, and no longer than until `due`.
    pub(super) fn take(&self, due: Option<Instant>) -> Taken<R> {
        let begun = Instant::now();
        let mut seats = self.lock();
        loop {
            let now = Instant::now();
            if due.is_some_and(|due| due <= now) {
                return Taken::Due;
            }
            let (found, held_up) = self.next(&mut seats);
            if let Some((client, request)) = found {
                return Taken::Request(Box::new((client, request)));
            }
            let waited = now - begun;
            if waited < SPIN {
                drop(seats);
                std::thread::yield_now();
                seats = self.lock();
                continue;
            }
            let nap = if held_up { SHORT_NAP } else { NAP };
            if waited >= nap {
                return Taken::Nothing;
            }
            let left = due.map_or(nap, |due| nap.min(due - now));
            let woken = self.came.wait_timeout(seats, left);
            seats = woken.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// The next request in turn, and whether there are some of clients that must first take their replies.
    fn next(&self, seats: &mut Seats<R>) -> (Option<(Client, R)>, bool) {
        let mut held_up = false;
        let after = seats.seats.range(seats.turn..);
        let before = seats.seats.range(..seats.turn);
        let found = after.chain(before).find_map(|(id, seat)| {
            let ready = !seat.waiting.is_empty() && seat.client.outbox.ready();
            held_up |= !ready && !seat.waiting.is_empty();
            ready.then_some(*id)
        });
        let Some(id) = found else {
            return (None, held_up);
        };
        seats.turn = id + 1;
        let Some(seat) = seats.seats.get_mut(&id) else {
            return (None, held_up);
        };
        let taken = seat.waiting.pop_front();
        let taken = taken.map(|(request, bytes)| {
            seat.bytes = seat.bytes.saturating_sub(bytes);
            (seat.client.clone(), request)
        });
        if seat.left && seat.waiting.is_empty() {
            seats.seats.remove(&id);
        }
        self.room.notify_all();
        (taken, held_up)
    }
}
