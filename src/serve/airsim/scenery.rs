//! Calls about the objects of the scene: their places and numbers, and where a camera sees them.

use super::answers::{Answer, Fault};
use super::images::Kind;
use super::names::{self, fits, matching};
use super::objects::{all, building, flying};
use super::queries::geo_point;
use super::session::Session;
use crate::components::capture::UavInFrame;
use crate::models::maths::polygon::centroid;
use crate::simulation::{FrameView, UavView, View};
use boresight_airsim::frames::{ahead, attitude, camera_attitude, swapped};
use boresight_airsim::messages::{self, Detection};
use boresight_airsim::{Arguments, Value};
use glam::{DQuat, DVec3};

/// Patterns of one filter.
const MOST_PATTERNS: usize = 1_000;

/// `simListSceneObjects`.
pub(super) fn list(session: &Session, of: &mut Arguments) -> Result<Answer, Fault> {
    let pattern = of.text("name_regex")?;
    let names = matching(&pattern, all(session.view())).map_err(|why| of.wrong(why))?;
    Ok(Value::Array(names.into_iter().map(Value::from).collect()).into())
}

/// `simGetObjectPose`: in the world about the site's origin; of what is not there, as AirSim, no numbers.
pub(super) fn pose(session: &Session, of: &mut Arguments) -> Result<Answer, Fault> {
    let name = of.text("object_name")?;
    let ned = of.value();
    if ned.as_bool() == Some(false) {
        return Err(of
            .wrong("the engine's own axes are not offered: leave ned=True")
            .into());
    }
    let view = session.view();
    if let Some(uav) = flying(view, &name) {
        let pose = messages::pose(swapped(uav.r_enu_m()), attitude(uav.q_enu_body()));
        return Ok(pose.into());
    }
    let Some(index) = building(view, &name) else {
        let nowhere = DVec3::NAN;
        let unturned = DQuat::from_xyzw(f64::NAN, f64::NAN, f64::NAN, f64::NAN);
        return Ok(messages::pose(nowhere, unturned).into());
    };
    let building = &view.air().city().buildings[index];
    let foot_enu_m = centroid(building.footprint_enu_m()).extend(building.base_m);
    Ok(messages::pose(swapped(foot_enu_m), DQuat::IDENTITY).into())
}

/// `simGetSegmentationObjectID`; -1 of what is not there.
pub(super) fn id(session: &Session, of: &mut Arguments) -> Result<Answer, Fault> {
    let name = of.text("mesh_name")?;
    let id = session.objects.id_of(session.view(), &name);
    Ok(Value::from(id.map_or(-1, i64::from)).into())
}

/// `simSetSegmentationObjectID`; whether there is any such object.
pub(super) fn set_id(session: &mut Session, of: &mut Arguments) -> Result<Answer, Fault> {
    let name = of.text("mesh_name")?;
    let id = match of.number("object_id")? {
        // It is not shown.
        -1.0 => 0,
        id if (0.0..=255.0).contains(&id) && id.fract() == 0.0 => id as u8,
        id => {
            return Err(of
                .wrong(format!("object_id is {id}: give 0 to 255, or -1"))
                .into());
        }
    };
    let is_pattern = of.flag("is_name_regex")?;
    let names = all(session.view());
    let names = match is_pattern {
        true => matching(&name, names).map_err(|why| of.wrong(why))?,
        false => names.into_iter().filter(|own| *own == name).collect(),
    };
    let any = !names.is_empty();
    let ids = names.into_iter().map(|name| (name, id));
    session.objects.ids.extend(ids);
    Ok(Value::from(any).into())
}

/// The camera and kind of picture that a filter is for.
fn filter_of(session: &Session, of: &mut Arguments) -> Result<(usize, u64), String> {
    let name = of.text("camera_name")?;
    let number = of.whole("image_type")?;
    Kind::of(number).map_err(|why| of.wrong(why))?;
    let camera = names::camera(session.view(), &name).map_err(|why| of.wrong(why))?;
    Ok((camera.index(), number))
}

/// `simAddDetectionFilterMeshName`.
pub(super) fn add_filter(session: &mut Session, of: &mut Arguments) -> Result<Answer, Fault> {
    let which = filter_of(session, of)?;
    let pattern = of.text("mesh_name")?;
    let filter = session.objects.filters.entry(which).or_default();
    if filter.patterns.len() >= MOST_PATTERNS {
        return Err(of
            .wrong(format!("a filter has {MOST_PATTERNS} names at most"))
            .into());
    }
    filter.patterns.insert(pattern);
    Ok(Value::Nil.into())
}

/// `simSetDetectionFilterRadius`.
pub(super) fn set_radius(session: &mut Session, of: &mut Arguments) -> Result<Answer, Fault> {
    let which = filter_of(session, of)?;
    let radius_cm = of.number("radius_cm")?;
    session.objects.filters.entry(which).or_default().radius_m = 0.01 * radius_cm;
    Ok(Value::Nil.into())
}

/// `simClearDetectionMeshNames`.
pub(super) fn clear_filters(session: &mut Session, of: &mut Arguments) -> Result<Answer, Fault> {
    let which = filter_of(session, of)?;
    session
        .objects
        .filters
        .entry(which)
        .or_default()
        .patterns
        .clear();
    Ok(Value::Nil.into())
}

/// `simGetDetections`: what flies, fits the camera's filter and is visible, from the truth of this very tick.
pub(super) fn detections(session: &mut Session, of: &mut Arguments) -> Result<Answer, Fault> {
    let which = filter_of(session, of)?;
    let filter = session.objects.filters.get(&which).cloned();
    let filter = filter.unwrap_or_default();
    if filter.patterns.is_empty() {
        return Ok(Value::Array(Vec::new()).into());
    }
    let frame = match session.frame(which.0)? {
        Some(frame) => Some(frame),
        // Without pictures: as the camera last exposed.
        None => session.held.newest(which.0).cloned(),
    };
    let Some(frame) = frame else {
        return Ok(Value::Array(Vec::new()).into());
    };
    let (view, frame) = (session.view(), frame.view());
    let found = frame.truth().iter().filter_map(|seen| {
        let uav = view.uavs().find(|uav| uav.index() == seen.uav)?;
        let fits = filter
            .patterns
            .iter()
            .any(|pattern| fits(pattern, uav.name()));
        let box_px = visible_box_px(seen, &frame)?;
        let near = seen.range_m <= filter.radius_m;
        (fits && near).then(|| detection(view, &frame, &uav, box_px).value())
    });
    Ok(Value::Array(found.collect()).into())
}

/// The box around what is visible of something \[px\]; without pictures around all of it, where its middle is.
fn visible_box_px(seen: &UavInFrame, frame: &FrameView) -> Option<[f64; 4]> {
    match &seen.rendered {
        Some(rendered) => rendered.box_px,
        None if seen.clear => {
            let pinhole = frame.pinhole();
            let sides = [pinhole.width_px, pinhole.height_px].map(f64::from);
            let [x0, y0, x1, y1] = seen.box_px;
            let within = |x: f64, axis: usize| x.clamp(0.0, sides[axis]);
            Some([within(x0, 0), within(y0, 1), within(x1, 0), within(y1, 1)])
        }
        None => None,
    }
}

fn detection(view: View, frame: &FrameView, uav: &UavView, box2d_px: [f64; 4]) -> Detection {
    let pose = frame.pose();
    let to_cam = pose.q_enu_cam.inverse();
    let place = |body_m: DVec3| {
        let r_enu_m = uav.r_enu_m() + uav.q_enu_body() * body_m;
        ahead(to_cam * (r_enu_m - pose.r_enu_m))
    };
    let outline = uav.outline_body_m().iter().map(|body_m| place(*body_m));
    let middle = place(DVec3::ZERO);
    let (low, high) = outline.fold((middle, middle), |(low, high), at| {
        (low.min(at), high.max(at))
    });
    let turned = camera_attitude(pose.q_enu_cam).inverse() * attitude(uav.q_enu_body());
    Detection {
        name: uav.name().to_owned(),
        geo_point: geo_point(view, uav.r_enu_m()),
        box2d_px,
        box3d: [low, high],
        relative: (middle, turned),
    }
}
