//! The cameras' pictures in the window.

use super::style::{AMBER, GREEN, GREY, panel_frame, rimmed, screen_ui};
use crate::components::capture::{Readout, SensorCamera};
use crate::components::detect::DetectorInUse;
use crate::components::record::{CameraHistory, KeptFrame};
use crate::components::view::{Insets, Uploaded};
use bevy::asset::RenderAssetUsages;
use bevy::prelude::*;
use bevy::render::render_resource::{Extent3d, TextureDimension, TextureFormat};
use bevy_egui::egui::{self, Align2, Color32, FontId, Pos2, Rect, Stroke, StrokeKind, vec2};
use bevy_egui::{EguiContexts, EguiTextureHandle, EguiUserTextures};

const INSET_WIDTH: f32 = 300.0;
/// Share of a readout window's width that its inset shows: targets there are a few pixels large.
const INSET_ZOOM: f32 = 0.5;

/// Brings new camera pictures to the GPU. Each camera keeps its one image: egui's own textures
/// are new images at every change, and those are drawn a frame too late to be seen while the
/// simulation runs.
pub fn upload_pictures(
    cameras: Query<(&SensorCamera, &CameraHistory)>,
    mut insets: ResMut<Insets>,
    mut images: ResMut<Assets<Image>>,
    mut textures: ResMut<EguiUserTextures>,
) -> Result {
    for (camera, history) in &cameras {
        let Some(frame) = &history.latest else {
            continue;
        };
        let shown = insets.0.get_mut(&camera.index);
        if shown.as_ref().is_some_and(|inset| inset.t_s == frame.t_s) {
            continue;
        }
        let [width, height] = frame.size_px;
        let rgba8 = frame
            .rgb8
            .chunks_exact(3)
            .flat_map(|p| [p[0], p[1], p[2], 255])
            .collect();
        let picture = Image::new(
            Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
            TextureDimension::D2,
            rgba8,
            TextureFormat::Rgba8UnormSrgb,
            RenderAssetUsages::RENDER_WORLD,
        );
        match shown {
            Some(inset) => {
                inset.t_s = frame.t_s;
                images.insert(inset.image.id(), picture)?;
            }
            None => {
                let image = images.add(picture);
                let texture = textures.add_image(EguiTextureHandle::Weak(image.id()));
                let uploaded = Uploaded {
                    t_s: frame.t_s,
                    image,
                    texture,
                };
                insets.0.insert(camera.index, uploaded);
            }
        }
    }
    Ok(())
}

/// The pictures of the cameras with what the detector found in them.
pub fn draw_insets(
    mut contexts: EguiContexts,
    insets: Res<Insets>,
    detector: Res<DetectorInUse>,
    cameras: Query<(&SensorCamera, &Readout, &CameraHistory)>,
) -> Result {
    let ctx = contexts.ctx_mut()?;
    let panel = egui::Panel::right("insets")
        .exact_size(INSET_WIDTH + 16.0)
        .resizable(false)
        .show_separator_line(false)
        .frame(panel_frame().inner_margin(8.0));
    panel.show(&mut screen_ui(ctx), |ui| {
        let share = ui.available_height() / cameras.iter().len().max(1) as f32;
        let height = (share - 26.0).clamp(20.0, 0.75 * INSET_WIDTH);
        for (camera, readout, history) in &cameras {
            let inset = insets.0.get(&camera.index);
            let latest = history.latest.as_ref();
            title(ui, camera, readout, latest);
            let (slot, _) = ui.allocate_exact_size(vec2(INSET_WIDTH, height), egui::Sense::hover());
            let painter = ui.painter_at(slot);
            painter.rect_filled(slot, 2.0, Color32::from_gray(18));
            match latest {
                Some(frame) => {
                    let placed = PlacedPicture::new(slot, frame, camera);
                    placed.draw(&painter, frame, inset, &detector);
                    rimmed(
                        &painter,
                        slot.left_top() + vec2(5.0, 4.0),
                        Align2::LEFT_TOP,
                        &format!("{}  {}", camera.name, frame.state),
                        Color32::WHITE,
                    );
                }
                None => {
                    painter.text(
                        slot.center(),
                        Align2::CENTER_CENTER,
                        "no picture yet",
                        FontId::proportional(12.0),
                        GREY,
                    );
                }
            }
        }
    });
    Ok(())
}

/// The line above a picture: which camera, what it reads out, when it was exposed.
fn title(ui: &mut egui::Ui, camera: &SensorCamera, readout: &Readout, latest: Option<&KeptFrame>) {
    let readout = match readout {
        Readout::Full => "full frame",
        Readout::Around { .. } if camera.window_px.is_none() => "full frame, region",
        Readout::Around { .. } => "window",
        Readout::Off => "off",
    };
    let when = latest.map_or(String::new(), |frame| format!("{:.3} s", frame.t_s));
    ui.horizontal(|ui| {
        ui.strong(format!(
            "{} {}",
            camera.name.to_uppercase(),
            camera.tier.word()
        ));
        ui.colored_label(GREY, format!("{readout}  {when}"));
    });
}

/// Where a picture lies on the screen.
struct PlacedPicture {
    shown: Rect,
    /// Screen points to a sensor pixel.
    scale: f32,
    /// Upper left corner on the sensor [px].
    offset_px: [f64; 2],
}

impl PlacedPicture {
    fn new(slot: Rect, frame: &KeptFrame, camera: &SensorCamera) -> Self {
        let [width, rows] = frame.size_px.map(|n| n as f32);
        let sensor_px = [camera.pinhole.width_px, camera.pinhole.height_px];
        let zoom = if frame.size_px == sensor_px {
            1.0
        } else {
            INSET_ZOOM
        };
        let scale = (slot.width() / (zoom * width)).min(slot.height() / (zoom * rows));
        Self {
            shown: Rect::from_center_size(slot.center(), vec2(width, rows) * scale),
            scale,
            offset_px: frame.offset_px.map(f64::from),
        }
    }

    /// From sensor pixels to the screen.
    fn at(&self, x: f64, y: f64) -> Pos2 {
        let [left, top] = self.offset_px;
        self.shown.min + vec2((x - left) as f32, (y - top) as f32) * self.scale
    }

    fn draw(
        &self,
        painter: &egui::Painter,
        frame: &KeptFrame,
        inset: Option<&Uploaded>,
        detector: &DetectorInUse,
    ) {
        if let Some(inset) = inset {
            let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
            painter.image(inset.texture, self.shown, whole, Color32::WHITE);
        }
        for detection in &frame.detections {
            let [x0, y0, x1, y1] = detection.box_px;
            let found = Rect::from_two_pos(self.at(x0, y0), self.at(x1, y1)).expand(2.0);
            let stroke = Stroke::new(1.4, GREEN);
            painter.rect_stroke(found, 0.0, stroke, StrokeKind::Outside);
            painter.text(
                found.right_top() + vec2(3.0, 0.0),
                Align2::LEFT_CENTER,
                detector.caption(detection),
                FontId::proportional(11.0),
                GREEN,
            );
        }
        let [x, y] = frame.centre_px;
        let reticle = self.at(x, y);
        for arm in [
            vec2(1.0, 0.0),
            vec2(-1.0, 0.0),
            vec2(0.0, 1.0),
            vec2(0.0, -1.0),
        ] {
            let line = [reticle + 5.0 * arm, reticle + 14.0 * arm];
            painter.line_segment(line, Stroke::new(1.2, AMBER));
        }
    }
}
