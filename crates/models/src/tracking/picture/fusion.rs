//! Objects that turn out to be one become one.

use super::fix::{Follower, Sensor};
use super::known::{Picture, ROUNDS};
use super::object::SharedObject;
use std::collections::{BTreeMap, BTreeSet};

/// Squared distance of six degrees of freedom below which two objects may be one: 99 %.
const ALIKE: f64 = 16.8;

impl Picture {
    /// Makes one of objects that have been alike for long enough: the lesser name, and the surer estimate.
    pub(super) fn unite(&mut self) {
        let mut near = Vec::new();
        for (second, b) in self.objects.iter().enumerate() {
            for (first, a) in self.objects[..second].iter().enumerate() {
                let apart2 = apart2(a, b);
                if apart2 < ALIKE {
                    near.push((apart2, first, second));
                }
            }
        }
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let (mut paired, mut alike, mut gone) = (BTreeSet::new(), BTreeMap::new(), Vec::new());
        for (_, first, second) in near {
            if paired.contains(&first) || paired.contains(&second) {
                continue;
            }
            paired.extend([first, second]);
            let names = (self.objects[first].identity, self.objects[second].identity);
            let rounds = self.alike.get(&names).map_or(1, |rounds| rounds + 1);
            if rounds < ROUNDS {
                alike.insert(names, rounds);
            } else {
                let b = self.objects[second].clone();
                self.objects[first].absorb(b);
                gone.push(names.1.max(names.0));
            }
        }
        self.alike = alike;
        self.objects
            .retain(|object| !gone.contains(&object.identity));
    }
}

/// Squared distance of two objects in six degrees of freedom; infinite where one sensor follows both, and of one
/// that falls.
fn apart2(a: &SharedObject, b: &SharedObject) -> f64 {
    let sensors = |object: &SharedObject| -> BTreeSet<(usize, Sensor)> {
        let of = |f: &Follower| (f.station, f.sensor);
        object.followers.keys().map(of).collect()
    };
    if a.dealt_with || b.dealt_with || !sensors(a).is_disjoint(&sensors(b)) {
        return f64::INFINITY;
    }
    let t_s = a.track.t_s().max(b.track.t_s());
    a.track.advanced(t_s).apart2(&b.track.advanced(t_s))
}
