//! What became of each UAV, and why it was not acquired or not brought down.

use super::page::table;
use maud::{Markup, html};
use serde::Serialize;

/// What became of a UAV, and what the stations saw of it and spent on it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct UavSummary {
    /// Name in the scenario.
    pub name: String,
    /// Flying, falling, struck, down, crashed or landed.
    pub status: String,
    /// Energy emitted while the beam was aimed at it \[J\].
    pub energy_j: f64,
    /// Time for which the firing beam's centre lay on its aim point \[s\].
    pub dwell_s: f64,
    /// Time at which its skin failed \[s\].
    pub neutralised_s: Option<f64>,
    /// Time at which it came within the asset's radius unharmed \[s\].
    pub at_asset_s: Option<f64>,
    /// When the coarse or precise camera of a station first held it \[s\].
    pub acquired_s: Option<f64>,
    /// The hottest of what would fail, a wall that bears or what lies behind one \[K\].
    pub hottest_k: f64,
    /// The temperature at which the part aimed at fails \[K\].
    pub fails_at_k: f64,
    /// Area that is burnt through \[m²\].
    pub hole_m2: f64,
    /// Parts destroyed, in the order of their loss.
    pub lost: Vec<String>,
    /// How it crashed; `None` if it did not.
    pub crash: Option<CrashSummary>,
    /// Why it was not acquired, or not brought down; `None` of one that the laser brought down.
    pub why: Option<String>,
    /// What each station had to do with it, in the order of the scenario.
    pub stations: Vec<DealingSummary>,
    /// What each camera showed of it, in the order of the scenario.
    pub cameras: Vec<SightSummary>,
}

/// How a UAV flew into something.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CrashSummary {
    /// When \[s\].
    pub t_s: f64,
    /// Where \[m, ENU\].
    pub r_enu_m: [f64; 3],
    /// Into what, in words.
    pub into: String,
}

/// What a station had to do with a UAV.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct DealingSummary {
    /// The station.
    pub name: String,
    /// Time for which the UAV flew in its sight \[s\].
    pub clear_s: f64,
    /// The same behind the city or in cloud \[s\].
    pub hidden_s: f64,
    /// Time for which one of its cameras held the UAV \[s\].
    pub held_s: f64,
    /// What kept the laser from firing meanwhile, and for how long \[s\], the longest first; several may hold at once.
    pub refused: Vec<(String, f64)>,
}

/// What a camera showed of a UAV.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SightSummary {
    /// The camera.
    pub name: String,
    /// What it is for: search, coarse or precise.
    pub tier: String,
    /// Time for which it had the UAV in view \[s\].
    pub in_view_s: f64,
    /// Of that the time for which something hid the UAV \[s\].
    pub hidden_s: f64,
    /// Pictures with the UAV in view.
    pub pictures: u32,
    /// Of these the ones in which a detection that counts lay on it.
    pub found: u32,
    /// The longer side of the UAV's box at most \[px\].
    pub largest_px: Option<f64>,
    /// Its median \[px\].
    pub typical_px: Option<f64>,
    /// Median of its contrast over the deviation of what is around it (signal-to-clutter ratio).
    pub contrast: Option<f64>,
    /// Median grey level of what was around it, 0 to 255.
    pub grey_level: Option<f64>,
    /// The best score of a detection on it; `None` where scores say nothing.
    pub best_score: Option<f64>,
    /// The score from which on a detection counts.
    pub wanted_score: Option<f64>,
}

/// The light of a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Light {
    /// Elevation of the sun \[deg\].
    pub sun_elevation_deg: f64,
    /// Illuminance on level ground \[lx\].
    pub illuminance_lx: f64,
}

/// Light below which pictures are taken in the dark [lx]: a lit street at night.
const DARK_LX: f64 = 10.0;

impl UavSummary {
    /// Why it was not acquired or not brought down, in one sentence; `None` of one that the laser brought down.
    pub fn reason(&self, light: &Light) -> Option<String> {
        if self.neutralised_s.is_some() {
            return None;
        }
        let rest = match self.acquired_s {
            Some(t_s) => self.held(t_s),
            None => self.unseen(light),
        };
        Some(match &self.crash {
            Some(crash) => format!("flew into {} at {:.1} s; {rest}", crash.into, crash.t_s),
            None => rest,
        })
    }

    /// Why one that was acquired was not brought down.
    fn held(&self, t_s: f64) -> String {
        let held_s: f64 = self.stations.iter().map(|station| station.held_s).sum();
        let held = format!("held for {held_s:.1} s from {t_s:.1} s on");
        let refused = self.refused();
        if self.energy_j > 0.0 {
            let dwell = format!(
                "{held}, given {:.1} kJ, {:.2} s of it on the aim point: the part came to {:.0} of {:.0} K",
                1e-3 * self.energy_j,
                self.dwell_s,
                self.hottest_k,
                self.fails_at_k
            );
            return match self.lost.is_empty() {
                true => dwell,
                false => format!("{dwell}; it lost {}, and flew on", self.lost.join(", ")),
            };
        }
        match refused.is_empty() {
            true => format!("{held}, not fired at"),
            false => format!("{held}, not fired at: {refused}"),
        }
    }

    /// The two reasons that kept the lasers from firing for longest.
    fn refused(&self) -> String {
        let mut all: Vec<&(String, f64)> = (self.stations.iter())
            .flat_map(|station| &station.refused)
            .collect();
        all.sort_by(|a, b| b.1.total_cmp(&a.1));
        let words: Vec<String> = (all.iter().take(2))
            .map(|(reason, lasted_s)| format!("{reason} ({lasted_s:.1} s)"))
            .collect();
        words.join(", ")
    }

    /// Why one was not acquired: by the camera that had it in view for longest.
    fn unseen(&self, light: &Light) -> String {
        let shown_s = |camera: &SightSummary| camera.in_view_s - camera.hidden_s;
        let seen = self.cameras.iter().filter(|camera| camera.pictures > 0);
        let Some(camera) = seen.reduce(|best, camera| match shown_s(camera) > shown_s(best) {
            true => camera,
            false => best,
        }) else {
            return self.never_in_view();
        };
        let owner = camera
            .name
            .rsplit_once('/')
            .map_or("the", |(station, _)| station);
        let own = if owner == "the" { "" } else { "'s" };
        let mut words = format!(
            "in {owner}{own} {} camera's view for {:.1} s",
            camera.tier, camera.in_view_s
        );
        if camera.hidden_s > 0.05 {
            words += &format!(" and hidden for {:.1} s of it", camera.hidden_s);
        }
        if let Some(px) = camera.largest_px {
            words += &format!(", at most {px:.1} px");
        }
        if let Some(contrast) = camera.contrast {
            words += &format!(", contrast {contrast:.1} times the noise");
            if light.illuminance_lx < DARK_LX {
                words += " in the dark";
            }
        }
        match (camera.wanted_score, camera.best_score) {
            (Some(wanted), Some(best)) if best >= wanted => {
                words += &format!(
                    ", found in {} of {} pictures (best score {best:.2})",
                    camera.found, camera.pictures
                );
            }
            (Some(wanted), Some(best)) => {
                words += &format!(", best score {best:.2} of {wanted:.2} wanted");
            }
            (Some(wanted), None) => {
                words += &format!(", no score ({wanted:.2} wanted)");
            }
            (None, _) => {
                words += &format!(
                    ", found in {} of {} pictures",
                    camera.found, camera.pictures
                );
            }
        }
        words
    }

    /// What to say of one that no camera had in view.
    fn never_in_view(&self) -> String {
        let clearest = (self.stations.iter()).max_by(|a, b| a.clear_s.total_cmp(&b.clear_s));
        match clearest {
            Some(station) if station.hidden_s > 0.0 => format!(
                "in no camera's view; hidden from {} for {:.1} of {:.1} s",
                station.name,
                station.hidden_s,
                station.clear_s + station.hidden_s
            ),
            Some(station) if station.clear_s > 0.0 => format!(
                "in no camera's view: nothing hid it for {:.1} s, but no camera looked there (it may have flown outside the \
                 sector, or while another target was followed)",
                station.clear_s
            ),
            _ => "in no camera's view".into(),
        }
    }
}

/// Most UAVs whose pictures the page tells of, camera by camera.
const MOST: usize = 50;

/// The UAVs as tables of the page.
pub(super) fn tables(uavs: &[UavSummary], light: &Light) -> Markup {
    let told: Vec<Vec<String>> = (uavs.iter())
        .map(|uav| {
            let acquired = uav
                .acquired_s
                .map_or("never".into(), |t_s| format!("{t_s:.2} s"));
            let down = uav
                .neutralised_s
                .map_or(String::new(), |t_s| format!("{t_s:.2} s"));
            let crashed = uav.crash.as_ref().map_or(String::new(), |crash| {
                let [e, n, u] = crash.r_enu_m;
                format!(
                    "into {}, at ({e:.0}, {n:.0}, {u:.0}) m, {:.2} s",
                    crash.into, crash.t_s
                )
            });
            let why = uav.why.clone().unwrap_or_default();
            vec![
                uav.name.clone(),
                uav.status.clone(),
                acquired,
                down,
                crashed,
                why,
            ]
        })
        .collect();
    let number =
        |x: Option<f64>, decimals: usize| x.map_or(String::new(), |x| format!("{x:.decimals$}"));
    let sights: Vec<Vec<String>> = (uavs.iter().take(MOST))
        .flat_map(|uav| uav.cameras.iter().map(move |camera| (uav, camera)))
        .filter(|(_, camera)| camera.pictures > 0)
        .map(|(uav, camera)| {
            vec![
                uav.name.clone(),
                camera.name.clone(),
                format!("{:.2}", camera.in_view_s),
                format!("{:.2}", camera.hidden_s),
                format!("{} of {}", camera.found, camera.pictures),
                number(camera.largest_px, 1),
                number(camera.typical_px, 1),
                number(camera.contrast, 1),
                number(camera.grey_level, 0),
                number(camera.best_score, 2),
                number(camera.wanted_score, 2),
            ]
        })
        .collect();
    let dealings: Vec<Vec<String>> = (uavs.iter().take(MOST))
        .flat_map(|uav| uav.stations.iter().map(move |station| (uav, station)))
        .map(|(uav, station)| {
            let refused = station.refused.iter();
            let refused: Vec<_> = refused.map(|(why, s)| format!("{why} {s:.1} s")).collect();
            vec![
                uav.name.clone(),
                station.name.clone(),
                format!("{:.1}", station.clear_s),
                format!("{:.1}", station.hidden_s),
                format!("{:.2}", station.held_s),
                refused.join(", "),
            ]
        })
        .collect();
    html! {
        p .note {
            (format_args!(
                "Sun at {:.1}° of elevation, {} lx on level ground.",
                light.sun_elevation_deg,
                match light.illuminance_lx {
                    lx if lx < 10.0 => format!("{lx:.2}"),
                    lx => format!("{lx:.0}"),
                }
            ))
        }
        (table(
            &["UAV", "status", "acquired", "brought down", "crashed", "why not acquired or not brought down"],
            &told,
        ))
        h3 { "Seen from the stations" }
        (table(
            &["UAV", "station", "in sight [s]", "hidden [s]", "held [s]", "no fire while held"],
            &dealings,
        ))
        h3 { "Seen by the cameras" }
        (table(
            &[
                "UAV", "camera", "in view [s]", "hidden [s]", "found in", "largest [px]", "typical [px]", "contrast",
                "grey around", "best score", "wanted",
            ],
            &sights,
        ))
        p .note {
            "Found in so many of the pictures that it was in; contrast over the noise of what is around it; its grey level of 255; \
             the score from which on a detection counts."
        }
        @if uavs.len() > MOST {
            p .note { "The cameras' and stations' tables are of the first " (MOST) " UAVs; summary.json has all." }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn night() -> UavSummary {
        UavSummary {
            name: "one".into(),
            status: "flying".into(),
            fails_at_k: 573.0,
            hottest_k: 281.0,
            stations: vec![DealingSummary {
                name: "roof".into(),
                clear_s: 12.0,
                hidden_s: 8.0,
                ..DealingSummary::default()
            }],
            cameras: vec![
                SightSummary {
                    name: "stv".into(),
                    tier: "search".into(),
                    in_view_s: 12.3,
                    pictures: 246,
                    largest_px: Some(2.1),
                    typical_px: Some(1.8),
                    contrast: Some(0.6),
                    grey_level: Some(3.0),
                    best_score: Some(0.08),
                    wanted_score: Some(0.25),
                    ..SightSummary::default()
                },
                SightSummary {
                    name: "ctv".into(),
                    tier: "coarse".into(),
                    in_view_s: 0.4,
                    pictures: 12,
                    ..SightSummary::default()
                },
            ],
            ..UavSummary::default()
        }
    }

    const NIGHT: Light = Light {
        sun_elevation_deg: -40.0,
        illuminance_lx: 0.31,
    };

    #[test]
    fn what_was_not_acquired_says_by_how_much() {
        let mut uav = night();
        let day = Light {
            sun_elevation_deg: 40.0,
            illuminance_lx: 9e4,
        };
        assert_eq!(
            uav.reason(&day).unwrap(),
            "in the search camera's view for 12.3 s, at most 2.1 px, contrast 0.6 times the noise, best score 0.08 of \
             0.25 wanted"
        );
        assert!(
            uav.reason(&NIGHT)
                .unwrap()
                .contains("the noise in the dark, best")
        );
        uav.cameras[0].best_score = None;
        assert!(
            uav.reason(&day)
                .unwrap()
                .ends_with("the noise, no score (0.25 wanted)")
        );
        uav.cameras[0].hidden_s = 12.2;
        uav.cameras[1].name = "east/ctv".into();
        assert_eq!(
            uav.reason(&day).unwrap(),
            "in east's coarse camera's view for 0.4 s, found in 0 of 12 pictures"
        );
        uav.cameras.clear();
        assert_eq!(
            uav.reason(&day).unwrap(),
            "in no camera's view; hidden from roof for 8.0 of 20.0 s"
        );
        uav.crash = Some(CrashSummary {
            t_s: 3.21,
            r_enu_m: [1.0, 2.0, 3.0],
            into: "building 12 (a hall, 9 m high)".into(),
        });
        let why = uav.reason(&day).unwrap();
        assert!(why.starts_with("flew into building 12 (a hall, 9 m high) at 3.2 s; in no"));
    }

    #[test]
    fn what_was_held_says_what_kept_it_alive() {
        let mut uav = night();
        uav.acquired_s = Some(1.2);
        uav.stations[0].held_s = 4.5;
        uav.stations[0].refused = vec![
            ("no range".into(), 3.0),
            ("solid backstop".into(), 1.0),
            ("burst limit".into(), 0.2),
        ];
        assert_eq!(
            uav.reason(&NIGHT).unwrap(),
            "held for 4.5 s from 1.2 s on, not fired at: no range (3.0 s), solid backstop (1.0 s)"
        );
        uav.energy_j = 3_010.0;
        uav.dwell_s = 0.4;
        uav.hottest_k = 412.0;
        assert_eq!(
            uav.reason(&NIGHT).unwrap(),
            "held for 4.5 s from 1.2 s on, given 3.0 kJ, 0.40 s of it on the aim point: the part came to 412 of 573 K"
        );
        uav.neutralised_s = Some(9.0);
        assert_eq!(uav.reason(&NIGHT), None);
    }

    #[test]
    fn the_page_has_every_uav_and_camera() {
        let page = tables(&[night()], &NIGHT).into_string();
        for text in ["0.31 lx", "stv", "ctv", "0 of 246", "2.1", "in sight [s]"] {
            assert!(page.contains(text), "{text}");
        }
    }
}
