//! `boresight diff`: where two recordings part, and what follows.

use super::ExperimentError;
use crate::recording::read::{Decoder, Recorded};
use clap::Args;
use mcap::Message;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::iter::Peekable;
use std::path::PathBuf;

/// What `boresight diff` is asked for.
#[derive(Args, Clone, Debug)]
pub struct Arguments {
    /// A recording.
    pub a: PathBuf,
    /// Another one; absent: the scenario inside the first is run again.
    pub b: Option<PathBuf>,
    /// Differences of a field that do not count, such as `azimuth_rad=1e-9`, or `*=1e-9` for every number; state
    /// hashes then do not count. May be repeated.
    #[arg(long, value_name = "FIELD=MOST")]
    pub tolerance: Vec<String>,
}

/// The field of every tick that says whether anything differs, not how much.
const HASH: &str = "state_hash";
/// The topic that has it, every tick.
const HASHED: &str = "/boresight/tick";

/// Differences that do not count, by the field's name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tolerances(BTreeMap<String, f64>);

impl Tolerances {
    /// Reads `field=most` texts.
    pub fn parse(texts: &[String]) -> Result<Self, ExperimentError> {
        let one = |text: &String| {
            let (field, most) = text.split_once('=')?;
            let most: f64 = most.trim().parse().ok()?;
            (!field.trim().is_empty() && most >= 0.0).then(|| (field.trim().to_owned(), most))
        };
        let read =
            |text: &String| one(text).ok_or_else(|| ExperimentError::Tolerance(text.clone()));
        texts.iter().map(read).collect::<Result<_, _>>().map(Self)
    }

    /// Whether a field's values are as good as equal.
    fn allows(&self, field: &str, a: &Value, b: &Value) -> bool {
        let name = field.rsplit('.').next().unwrap_or(field);
        let name = name.split('[').next().unwrap_or(name);
        if name == HASH {
            return !self.0.is_empty();
        }
        let most = self.0.get(name).or_else(|| self.0.get("*"));
        match (most, a.as_f64(), b.as_f64()) {
            (Some(most), Some(a), Some(b)) => (a - b).abs() <= *most,
            _ => false,
        }
    }
}

/// A field whose values differ.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldDifference {
    /// First tick at which they do.
    pub tick: u64,
    /// Its topic.
    pub topic: String,
    /// The UAV or camera of the message, where it names one.
    pub entity: String,
    /// Its name, with those of the messages it lies in.
    pub field: String,
    /// Its values then; `None` where the message is in one recording only.
    pub values: [Option<Value>; 2],
    /// Largest difference of numbers, over the whole run.
    pub largest: Option<f64>,
}

/// What two recordings have in common, and what not.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Comparison {
    /// Messages of the first.
    pub messages: usize,
    /// Last tick that was compared.
    pub last_tick: u64,
    /// First line of the scenario that differs, from 1, with its text in both.
    pub scenario: Option<(usize, [String; 2])>,
    /// What else the recordings say of their runs and differ in.
    pub runs: Vec<(&'static str, [String; 2])>,
    /// The fields that differ, the earliest first.
    pub fields: Vec<FieldDifference>,
    /// Where the runs end, if not at one tick.
    pub ends: Option<[u64; 2]>,
    /// Tracking states, (tick, state), by topic.
    states: [BTreeMap<String, Vec<(u64, String)>>; 2],
    /// Last known status by UAV.
    fates: [BTreeMap<String, String>; 2],
    /// Operator's orders.
    orders: [usize; 2],
    /// Files that lack their end.
    cut: Vec<PathBuf>,
    /// Whether hashes of the state were compared.
    hashed: bool,
    tick_hz: u32,
}

/// A message with its tick.
type Dated = (u64, Message<'static>);

/// A message's place in its tick: topic, entity, and its number among those of both.
type Place = (String, String, usize);

impl Comparison {
    /// Compares two recordings message by message.
    pub fn of(a: &Recorded, b: &Recorded, tolerances: &Tolerances) -> Self {
        let mut found = Self {
            scenario: first_line(&a.scenario_toml, &b.scenario_toml),
            runs: [
                ("changes", [a, b].map(|of| of.overrides.join(" "))),
                ("seed", [a, b].map(|of| of.seed.to_string())),
                ("version", [a, b].map(|of| of.version.clone())),
            ]
            .into_iter()
            .filter(|(_, [a, b])| a != b)
            .collect(),
            cut: [a, b]
                .into_iter()
                .filter(|recorded| !recorded.is_whole())
                .map(|recorded| recorded.path.clone())
                .collect(),
            tick_hz: a.tick_hz,
            ..Self::default()
        };
        let mut decoders = [Decoder::default(), Decoder::default()];
        let mut streams = [a, b].map(|recorded| {
            let dated = recorded
                .messages()
                .map(|message| (recorded.tick(&message), message));
            (Box::new(dated) as Box<dyn Iterator<Item = Dated>>).peekable()
        });
        let mut fields: BTreeMap<(String, String, String), FieldDifference> = BTreeMap::new();
        let mut last = [0, 0];
        loop {
            let heads = [0, 1].map(|i| streams[i].peek().map(|(tick, _)| *tick));
            let Some(tick) = heads.into_iter().flatten().min() else {
                break;
            };
            let ended = [0, 1].map(|i| heads[i].is_none());
            let of_tick = [0, 1].map(|i| take_tick(&mut streams[i], tick));
            for i in [0, 1] {
                if !of_tick[i].is_empty() {
                    last[i] = tick;
                }
                found.follow(i, tick, &of_tick[i], &mut decoders[i]);
            }
            // Where one run has ended there is nothing to compare.
            if ended.contains(&true) {
                continue;
            }
            found.messages += of_tick[0].len();
            found.last_tick = tick;
            let hashed = |messages: &Vec<Message>| {
                let mut topics = messages.iter().map(|message| &message.channel.topic);
                topics.any(|topic| topic == HASHED)
            };
            found.hashed |= tolerances.0.is_empty() && of_tick.iter().all(hashed);
            let raw = |i: usize| {
                of_tick[i]
                    .iter()
                    .map(|m: &Message| (&m.channel.topic, &m.data))
            };
            if raw(0).eq(raw(1)) {
                continue;
            }
            let placed = [0, 1].map(|i| placed(&of_tick[i], &mut decoders[i]));
            let places: BTreeSet<&Place> = placed.iter().flat_map(BTreeMap::keys).collect();
            for place in places {
                let (topic, entity, _) = place;
                let values = [0, 1].map(|i| placed[i].get(place));
                let mut put = |field: String, values: [Option<&Value>; 2]| {
                    let by = match values.map(|value| value.and_then(Value::as_f64)) {
                        [Some(a), Some(b)] if field != HASH => Some((a - b).abs()),
                        _ => None,
                    };
                    let key = (topic.clone(), entity.clone(), field.clone());
                    let kept = fields.entry(key).or_insert_with(|| FieldDifference {
                        tick,
                        topic: topic.clone(),
                        entity: entity.clone(),
                        field,
                        values: values.map(|value| value.cloned()),
                        largest: by,
                    });
                    if let (Some(by), Some(largest)) = (by, &mut kept.largest) {
                        *largest = largest.max(by);
                    }
                };
                match values {
                    // Stamps are the tick again, and the scenario's own time.
                    [Some(a), Some(b)] => parts(a, b, String::new(), &mut |field, a, b| {
                        if !field.ends_with("timestamp") && !tolerances.allows(&field, a, b) {
                            put(field, [Some(a), Some(b)]);
                        }
                    }),
                    one_only => put(String::new(), one_only),
                }
            }
        }
        // A cut recording does not say where its run ended.
        if last[0] != last[1] && found.cut.is_empty() {
            found.ends = Some(last);
        }
        found.fields = fields.into_values().collect();
        found.fields.sort_by(|a, b| {
            // The hash says that something differs, the fields what.
            let order = |d: &FieldDifference| (d.tick, d.field == HASH);
            order(a).cmp(&order(b))
        });
        found
    }

    /// Whether something was compared and nothing that counts differs.
    pub fn equal(&self) -> bool {
        self.messages > 0 && self.fields.is_empty() && self.ends.is_none()
    }

    /// Takes in what a tick's messages say of states and fates.
    fn follow(&mut self, side: usize, tick: u64, messages: &[Message], decoder: &mut Decoder) {
        for message in messages {
            let topic = &message.channel.topic;
            let text = |fields: &Value, key: &str| fields[key].as_str().map(str::to_owned);
            if topic.ends_with("/track_state") {
                let Some(state) = decoder.decode(message).and_then(|m| text(&m, "state")) else {
                    continue;
                };
                let states = self.states[side].entry(topic.clone()).or_default();
                if states.last().is_none_or(|(_, last)| *last != state) {
                    states.push((tick, state));
                }
            } else if topic == "/boresight/uav_state"
                && let Some(fields) = decoder.decode(message)
                && let (Some(name), Some(status)) = (text(&fields, "name"), text(&fields, "status"))
            {
                self.fates[side].insert(name, status);
            } else if topic == "/log"
                && let Some(name) = decoder.decode(message).and_then(|m| text(&m, "name"))
                && name.rsplit('/').next() == Some("operator")
            {
                self.orders[side] += 1;
            }
        }
    }

    /// What was found, in lines, the verdict first.
    pub fn text(&self) -> String {
        let mut lines = vec![self.verdict()];
        lines.extend(self.of_the_runs());
        if !self.equal() {
            lines.extend(self.of_the_fields());
            lines.extend(self.of_the_states());
            lines.extend(self.of_the_ends());
        }
        lines.join("\n")
    }

    /// Time of a tick [s].
    fn t_s(&self, tick: u64) -> f64 {
        tick as f64 / f64::from(self.tick_hz.max(1))
    }

    /// In one line, whether they are equal, or where they part.
    fn verdict(&self) -> String {
        if self.messages == 0 {
            return "nothing to compare: no message is in both recordings".to_owned();
        }
        let until_s = self.t_s(self.last_tick);
        let (count, end) = (self.messages, format!("{until_s:.3} s"));
        match (self.fields.first(), self.ends) {
            (Some(first), _) => {
                let (tick, t_s) = (first.tick, self.t_s(first.tick));
                let parted = format!("they part at tick {tick}, {t_s:.4} s, in {}", first.place());
                // A hash tells of what is recorded later, or not at all.
                let shown = self.fields.iter().find(|field| field.field != HASH);
                match shown.filter(|_| first.field == HASH) {
                    Some(shown) => {
                        format!(
                            "{parted}, seen from tick {} in {}",
                            shown.tick,
                            shown.place()
                        )
                    }
                    None if self.hashed && self.fields.iter().all(|field| field.field != HASH) => {
                        format!("the states are equal, what is recorded of them is not: {parted}")
                    }
                    None => parted,
                }
            }
            (None, Some(_)) => {
                format!("equal to {end}, where one of them ends: {count} messages")
            }
            (None, None) => format!("equal: {count} messages to {end}"),
        }
    }

    /// In what the runs differ by themselves.
    fn of_the_runs(&self) -> Vec<String> {
        let mut lines = Vec::new();
        if let Some((line, [a, b])) = &self.scenario {
            lines.push(format!(
                "scenario  line {line}: {} | {}",
                a.trim(),
                b.trim()
            ));
        }
        for (what, [a, b]) in &self.runs {
            let shown = |text: &str| if text.is_empty() { "none" } else { text }.replace('\n', " ");
            lines.push(format!("{what:<9} {} | {}", shown(a), shown(b)));
        }
        let cut = |path: &PathBuf| {
            let path = path.display();
            format!("cut       {path} lacks its end: its run was killed")
        };
        lines.extend(self.cut.iter().map(cut));
        lines
    }

    /// The fields that differ, the earliest first.
    fn of_the_fields(&self) -> Vec<String> {
        /// Fields that are listed.
        const MOST: usize = 15;
        let mut lines = Vec::new();
        for (index, difference) in self.fields.iter().take(MOST).enumerate() {
            let word = if index == 0 { "first" } else { "" };
            let largest = match difference.largest {
                Some(largest) => format!(", at most {largest:.3e} apart"),
                None => String::new(),
            };
            let [a, b] = [0, 1].map(|i| difference.shown(i));
            let tick = difference.tick;
            lines.push(format!(
                "{word:<9} tick {tick} ({:.4} s) {}: {a} | {b}{largest}",
                self.t_s(tick),
                difference.place()
            ));
        }
        if self.fields.len() > MOST {
            let more = self.fields.len() - MOST;
            lines.push(format!("          and {more} fields more"));
        }
        lines
    }

    /// From where on the stations' states differ.
    fn of_the_states(&self) -> Vec<String> {
        let mut lines = Vec::new();
        let [a, b] = &self.states;
        let topics: BTreeSet<&String> = a.keys().chain(b.keys()).collect();
        for topic in topics {
            let none = Vec::new();
            let [a, b] = [a, b].map(|states| states.get(topic).unwrap_or(&none));
            let until = a.iter().zip(b).take_while(|(a, b)| a == b).count();
            if until == a.len() && until == b.len() {
                continue;
            }
            let rest = |states: &[(u64, String)]| {
                let one =
                    |(tick, state): &(u64, String)| format!("{state} {:.2} s", self.t_s(*tick));
                let rest: Vec<String> = states[until..].iter().take(6).map(one).collect();
                if rest.is_empty() {
                    "nothing more".to_owned()
                } else {
                    rest.join(", ")
                }
            };
            lines.push(format!("states    {topic}: {} | {}", rest(a), rest(b)));
        }
        lines
    }

    /// How orders, ends and outcomes differ.
    fn of_the_ends(&self) -> Vec<String> {
        let mut lines = Vec::new();
        if let [a, b] = self.orders
            && a != b
        {
            lines.push(format!(
                "orders    {a} | {b}: those of a window are not in its scenario; `view --save-orders` writes one with them"
            ));
        }
        if let Some([a, b]) = self.ends {
            let [a, b] = [a, b].map(|tick| self.t_s(tick));
            lines.push(format!("ends      {a:.3} s | {b:.3} s"));
        }
        let [a, b] = &self.fates;
        for (name, status) in a {
            let other = b.get(name).map_or("not there", String::as_str);
            if other != status {
                lines.push(format!("outcome   {name}: {status} | {other}"));
            }
        }
        lines
    }
}

impl FieldDifference {
    /// Topic, entity and field, as far as there are.
    fn place(&self) -> String {
        let at = [&self.topic, &self.entity, &self.field].map(|part| part.trim());
        let at: Vec<&str> = at.into_iter().filter(|part| !part.is_empty()).collect();
        at.join(" ")
    }

    /// Its value in the first or second recording.
    fn shown(&self, side: usize) -> String {
        match &self.values[side] {
            None => "not there".to_owned(),
            Some(_) if self.field.is_empty() => "there".to_owned(),
            Some(Value::Number(hash)) if self.field == HASH => {
                format!("{:016x}", hash.as_u64().unwrap_or_default())
            }
            Some(Value::String(text)) if text.len() > 40 => format!("{text:.40}…"),
            Some(value) => value.to_string(),
        }
    }
}

/// The first line in which two texts differ, from 1.
fn first_line(a: &str, b: &str) -> Option<(usize, [String; 2])> {
    let (mut a, mut b) = (a.lines(), b.lines());
    for line in 1.. {
        match (a.next(), b.next()) {
            (None, None) => break,
            (a, b) if a != b => return Some((line, [a, b].map(|text| text.unwrap_or("").into()))),
            _ => {}
        }
    }
    None
}

/// The messages of a tick.
fn take_tick(
    stream: &mut Peekable<impl Iterator<Item = Dated>>,
    tick: u64,
) -> Vec<Message<'static>> {
    std::iter::from_fn(|| stream.next_if(|(of, _)| *of == tick))
        .map(|(_, message)| message)
        .collect()
}

/// The fields of a tick's messages, by their place.
fn placed(messages: &[Message], decoder: &mut Decoder) -> BTreeMap<Place, Value> {
    let mut placed = BTreeMap::new();
    for message in messages {
        let raw = || Value::from(message.data.to_vec());
        let fields = decoder.decode(message).unwrap_or_else(raw);
        let named = ["name", "camera", "station"]
            .iter()
            .find_map(|key| fields[*key].as_str());
        let (topic, entity) = (
            message.channel.topic.clone(),
            named.unwrap_or("").to_owned(),
        );
        let of_both = |(t, e, _): &Place| *t == topic && *e == entity;
        let number = placed.keys().filter(|place| of_both(place)).count();
        placed.insert((topic, entity, number), fields);
    }
    placed
}

/// Every pair of single values that are not equal, with the path to them.
fn parts(a: &Value, b: &Value, path: String, differs: &mut impl FnMut(String, &Value, &Value)) {
    match (a, b) {
        (Value::Object(x), Value::Object(y)) if x.keys().eq(y.keys()) => {
            for ((key, a), b) in x.iter().zip(y.values()) {
                let path = if path.is_empty() {
                    key.clone()
                } else {
                    format!("{path}.{key}")
                };
                parts(a, b, path, differs);
            }
        }
        (Value::Array(x), Value::Array(y)) if x.len() == y.len() => {
            for (index, (a, b)) in x.iter().zip(y).enumerate() {
                parts(a, b, format!("{path}[{index}]"), differs);
            }
        }
        _ if a != b => differs(path, a, b),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn what_differs_is_named() {
        let a = json!({ "r": { "x": 1.0, "y": 2.0 }, "list": [1, 2], "s": "a" });
        let b = json!({ "r": { "x": 1.0, "y": 2.5 }, "list": [1, 3], "s": "a" });
        let mut found = Vec::new();
        parts(&a, &b, String::new(), &mut |field, _, _| found.push(field));
        assert_eq!(found, ["list[1]", "r.y"]);
        // Where the shapes differ, the whole.
        let mut whole = Vec::new();
        let longer = json!({ "r": { "x": 1.0, "y": 2.0 }, "list": [1], "s": "a" });
        parts(&a, &longer, String::new(), &mut |field, _, _| {
            whole.push(field)
        });
        assert_eq!(whole, ["list"]);
    }

    #[test]
    fn tolerances_go_by_the_fields_name() {
        let of = |texts: &[&str]| {
            Tolerances::parse(&texts.iter().map(|t| (*t).to_owned()).collect::<Vec<_>>())
        };
        let some = of(&["x=0.1", "list=0"]).unwrap();
        let (one, near, far) = (json!(1.0), json!(1.05), json!(1.2));
        assert!(some.allows("r.x", &one, &near) && !some.allows("r.x", &one, &far));
        assert!(!some.allows("r.y", &one, &near));
        let all = of(&["*=0.1"]).unwrap();
        assert!(all.allows("list[3]", &one, &near));
        assert!(all.allows("state_hash", &json!(1), &json!(2)));
        assert!(!Tolerances::default().allows("state_hash", &json!(1), &json!(2)));
        for wrong in ["x", "x=", "=1", "x=-1", "x=NaN"] {
            assert!(of(&[wrong]).is_err(), "{wrong}");
        }
    }

    #[test]
    fn the_first_line_that_differs() {
        assert_eq!(first_line("a\nb\n", "a\nb\n"), None);
        assert_eq!(
            first_line("a\nb", "a\nc"),
            Some((2, ["b".into(), "c".into()]))
        );
        assert_eq!(
            first_line("a", "a\nc"),
            Some((2, [String::new(), "c".into()]))
        );
    }
}
