//! The cameras' pictures in the window.

use super::style::{AMBER, GREEN, GREY, panel_frame, rimmed, screen_ui, source_colour};
use crate::components::capture::{Readout, SensorCamera};
use crate::components::detect::DetectorInUse;
use crate::components::record::{CameraHistory, KeptFrame};
use crate::components::view::{CameraShown, Found, Insets, Picture, Pictures, ShowWeak, Uploaded};
use crate::media::labels;
use bevy::asset::RenderAssetUsages;
use bevy::prelude::*;
use bevy::render::render_resource::{Extent3d, TextureDimension, TextureFormat};
use bevy_egui::egui::{self, Align2, Color32, FontId, Pos2, Rect, Stroke, StrokeKind, vec2};
use bevy_egui::{EguiContexts, EguiTextureHandle, EguiUserTextures};

/// Widths of a column of pictures: of one alone, and of each of two.
const INSET_WIDTHS: [f32; 2] = [300.0, 210.0];
/// Share of a readout window's width that its inset shows: targets there are a few pixels large.
const INSET_ZOOM: f32 = 0.5;

/// Shows what the cameras of the run last took.
pub fn look_at_cameras(
    detector: Res<DetectorInUse>,
    cameras: Query<(&SensorCamera, &Readout, &CameraHistory)>,
    mut shown: ResMut<Pictures>,
) {
    let column = cameras.iter().map(|(camera, readout, history)| {
        let picture = (history.latest.as_ref()).map(|frame| picture_of(frame, camera, &detector));
        let readout = match readout {
            Readout::Full => "full frame",
            Readout::Around { .. } if camera.window_px.is_none() => "full frame, region",
            Readout::Around { .. } => "window",
            Readout::Off => "off",
        };
        let when =
            (picture.as_ref()).map_or(String::new(), |picture| format!("{:.3} s", picture.t_s));
        CameraShown {
            name: camera.name.to_string(),
            note: format!("{}, {readout}  {when}", camera.tier.word()),
            picture,
        }
    });
    shown.0 = vec![column.collect()];
}

fn picture_of(frame: &KeptFrame, camera: &SensorCamera, detector: &DetectorInUse) -> Picture {
    let [dx, dy] = frame.offset_px.map(f64::from);
    let mut found: Vec<_> = frame.detections.iter().collect();
    found.sort_by(|a, b| a.score.total_cmp(&b.score));
    let found = found.into_iter().map(|detection| {
        let [x0, y0, x1, y1] = detection.box_px;
        Found {
            box_px: [x0 - dx, y0 - dy, x1 - dx, y1 - dy],
            caption: detector.caption(detection),
            weak: detector.is_weak(detection),
        }
    });
    Picture {
        t_s: frame.t_s,
        size_px: frame.size_px,
        rgb8: frame.rgb8.clone(),
        part: frame.size_px != [camera.pinhole.width_px, camera.pinhole.height_px],
        found: found.collect(),
        reticle_px: Some([frame.centre_px[0] - dx, frame.centre_px[1] - dy]),
        state: frame.state.to_owned(),
    }
}

/// Brings new camera pictures to the GPU. Each camera keeps its one image: egui's own textures
/// are new images at every change, and those are drawn a frame too late to be seen while the
/// simulation runs.
pub fn upload_pictures(
    shown: Res<Pictures>,
    mut insets: ResMut<Insets>,
    mut images: ResMut<Assets<Image>>,
    mut textures: ResMut<EguiUserTextures>,
) -> Result {
    let columns = shown.0.iter().enumerate();
    let cameras = columns.flat_map(|(column, cameras)| cameras.iter().map(move |c| (column, c)));
    for (column, camera) in cameras {
        let Some(picture) = &camera.picture else {
            continue;
        };
        let key = (column, camera.name.clone());
        let inset = insets.0.get_mut(&key);
        if inset.as_ref().is_some_and(|inset| inset.t_s == picture.t_s) {
            continue;
        }
        let [width, height] = picture.size_px;
        let rgba8 = (picture.rgb8.chunks_exact(3))
            .flat_map(|p| [p[0], p[1], p[2], 255])
            .collect();
        let image = Image::new(
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
        match inset {
            Some(inset) => {
                inset.t_s = picture.t_s;
                images.insert(inset.image.id(), image)?;
            }
            None => {
                let image = images.add(image);
                let texture = textures.add_image(EguiTextureHandle::Weak(image.id()));
                let uploaded = Uploaded {
                    t_s: picture.t_s,
                    image,
                    texture,
                };
                insets.0.insert(key, uploaded);
            }
        }
    }
    Ok(())
}

/// The pictures of the cameras with what the detector found in them, a column for each run.
pub fn draw_insets(
    mut contexts: EguiContexts,
    shown: Res<Pictures>,
    insets: Res<Insets>,
    mut weak: ResMut<ShowWeak>,
) -> Result {
    let ctx = contexts.ctx_mut()?;
    let columns = shown.0.len().max(1);
    let width = INSET_WIDTHS[(columns - 1).min(1)];
    let panel = egui::Panel::right("insets")
        .exact_size(columns as f32 * (width + 8.0) + 8.0)
        .resizable(false)
        .show_separator_line(false)
        .frame(panel_frame().inner_margin(8.0));
    panel.show(&mut screen_ui(ctx), |ui| {
        let most = shown.0.iter().map(Vec::len).max().unwrap_or(0);
        ui.checkbox(&mut weak.0, "boxes below the threshold");
        let share = ui.available_height() / most.max(1) as f32;
        let height = (share - 26.0).clamp(20.0, 0.75 * width);
        ui.horizontal_top(|ui| {
            for (number, cameras) in shown.0.iter().enumerate() {
                ui.vertical(|ui| {
                    ui.set_width(width);
                    if cameras.is_empty() {
                        ui.colored_label(GREY, "no pictures recorded");
                    }
                    for camera in cameras {
                        let inset = insets.0.get(&(number, camera.name.clone()));
                        draw_camera(ui, camera, inset, [width, height], (number, *weak));
                    }
                });
            }
        });
    });
    Ok(())
}

fn draw_camera(
    ui: &mut egui::Ui,
    camera: &CameraShown,
    inset: Option<&Uploaded>,
    [width, height]: [f32; 2],
    (source, weak): (usize, ShowWeak),
) {
    ui.horizontal(|ui| {
        let name = egui::RichText::new(camera.name.to_uppercase()).strong();
        ui.label(if source > 0 {
            name.color(source_colour(source))
        } else {
            name
        });
        ui.colored_label(GREY, &camera.note);
    });
    let (slot, _) = ui.allocate_exact_size(vec2(width, height), egui::Sense::hover());
    let painter = ui.painter_at(slot);
    painter.rect_filled(slot, 2.0, Color32::from_gray(18));
    let Some(picture) = &camera.picture else {
        let font = FontId::proportional(12.0);
        painter.text(
            slot.center(),
            Align2::CENTER_CENTER,
            "no picture yet",
            font,
            GREY,
        );
        return;
    };
    PlacedPicture::new(slot, picture).draw(&painter, picture, inset, weak);
    rimmed(
        &painter,
        slot.left_top() + vec2(5.0, 4.0),
        Align2::LEFT_TOP,
        &format!("{}  {}", camera.name, picture.state),
        Color32::WHITE,
    );
}

/// Where a picture lies on the screen.
struct PlacedPicture {
    shown: Rect,
    /// Screen points to a pixel.
    scale: f32,
}

impl PlacedPicture {
    fn new(slot: Rect, picture: &Picture) -> Self {
        let [width, rows] = picture.size_px.map(|n| n as f32);
        let zoom = if picture.part { INSET_ZOOM } else { 1.0 };
        let scale = (slot.width() / (zoom * width)).min(slot.height() / (zoom * rows));
        Self {
            shown: Rect::from_center_size(slot.center(), vec2(width, rows) * scale),
            scale,
        }
    }

    /// From pixels to the screen.
    fn at(&self, x: f64, y: f64) -> Pos2 {
        self.shown.min + vec2(x as f32, y as f32) * self.scale
    }

    /// The boxes, the weakest first, with their labels, of which the stronger choose their places first.
    fn draw_boxes(&self, painter: &egui::Painter, picture: &Picture, weak: ShowWeak) {
        let area = painter.clip_rect().intersect(self.shown);
        let within = |at: Pos2| [at.x - area.min.x, at.y - area.min.y].map(f64::from);
        let strongest_first = || {
            let shown = |found: &&Found| weak.0 || !found.weak;
            picture.found.iter().rev().filter(shown)
        };
        let colour = |found: &Found| if found.weak { GREY } else { GREEN };
        let outlines: Vec<Rect> = strongest_first()
            .map(|found| {
                let [x0, y0, x1, y1] = found.box_px;
                Rect::from_two_pos(self.at(x0, y0), self.at(x1, y1)).expand(2.0)
            })
            .collect();
        let words: Vec<_> = strongest_first()
            .map(|found| {
                let font = FontId::proportional(11.0);
                painter.layout_no_wrap(found.caption.clone(), font, colour(found))
            })
            .collect();
        let boxes: Vec<[f64; 4]> = (outlines.iter())
            .map(|outline| {
                let ([x0, y0], [x1, y1]) = (within(outline.min), within(outline.max));
                [x0, y0, x1, y1]
            })
            .collect();
        let labels_px: Vec<[f64; 2]> = (words.iter())
            .map(|words| [words.size().x, words.size().y].map(f64::from))
            .collect();
        let size_px = [area.width(), area.height()].map(f64::from);
        let places = labels::place(&boxes, &labels_px, size_px, 1.0);
        let colours: Vec<Color32> = strongest_first().map(colour).collect();
        let drawn = outlines.into_iter().zip(words).zip(colours).zip(places);
        for (((outline, words), colour), place) in drawn.rev() {
            painter.rect_stroke(outline, 0.0, Stroke::new(1.4, colour), StrokeKind::Outside);
            if let Some([x, y]) = place {
                painter.galley(area.min + vec2(x as f32, y as f32), words, colour);
            }
        }
    }

    fn draw(
        &self,
        painter: &egui::Painter,
        picture: &Picture,
        inset: Option<&Uploaded>,
        weak: ShowWeak,
    ) {
        if let Some(inset) = inset {
            let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
            painter.image(inset.texture, self.shown, whole, Color32::WHITE);
        }
        self.draw_boxes(painter, picture, weak);
        let Some([x, y]) = picture.reticle_px else {
            return;
        };
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
