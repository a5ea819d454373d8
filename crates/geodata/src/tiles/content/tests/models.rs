//! glTF: geometry, transforms, materials.

use super::*;
use crate::tiles::content::Fault;
use base64::Engine;
use boresight_models::shape::textured::TexturedMesh;

/// The one mesh of a content.
#[track_caller]
fn one(content: &Content) -> &TexturedMesh {
    assert_eq!(content.meshes.len(), 1, "{content:?}");
    &content.meshes[0].mesh
}

/// A square of four vertices drawn in a mode, with indices.
fn square(mode: u32, indices: &[u16]) -> Vec<u8> {
    let mut model = Model::default();
    let square = bytes![f32; 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0];
    model.add("VEC3", 5126, 4, &square);
    let data: Vec<u8> = indices.iter().flat_map(|i| i.to_le_bytes()).collect();
    let indices = model.add("SCALAR", 5123, indices.len(), &data);
    model.glb(json!({"meshes": [{"primitives": [
        {"attributes": {"POSITION": 0}, "indices": indices, "mode": mode}]}]}))
}

#[test]
fn lists_strips_and_fans_of_triangles() {
    for (mode, indices, expected) in [
        (4, &[0, 1, 2, 2, 1, 3, 0][..], vec![0, 1, 2, 2, 1, 3]),
        (5, &[0, 1, 2, 3], vec![0, 1, 2, 2, 1, 3]),
        (5, &[0, 1, 2, 2, 3], vec![0, 1, 2]),
        (6, &[0, 1, 3, 2], vec![0, 1, 3, 0, 3, 2]),
    ] {
        let content = alone(&square(mode, indices)).unwrap();
        assert_eq!(one(&content).indices, expected, "mode {mode}");
    }
    let points = alone(&square(0, &[3, 3, 0])).unwrap();
    assert_eq!(points.point_count(), 3);
    let lines = alone(&square(1, &[0, 1])).unwrap();
    assert_eq!(
        (lines.triangle_count(), lines.notes),
        (0, vec!["lines are left out".to_owned()])
    );
    assert!(alone(&square(7, &[0])).is_err());
    let beyond = alone(&square(4, &[0, 1, 4])).unwrap_err().to_string();
    assert!(
        beyond.contains("mesh 0, primitive 0: is damaged: index 4 where there are 4"),
        "{beyond}"
    );
}

#[test]
fn nodes_keep_every_bit_of_large_offsets() {
    // The centre of a city, earth-centred: f32 there is good to half a metre.
    let (model, meshes) = triangle();
    let file = model.glb(json!({"meshes": meshes, "nodes": [
        {"translation": [4275010.0625, 638412.015625, 4674100.25], "children": [1]},
        {"rotation": [0.0, 0.0, 1.0, 0.0], "scale": [2.0, 2.0, 2.0], "mesh": 0}]}));
    let content = decode(&file, UpAxis::Z, &|_| Err(String::new())).unwrap();
    near(
        &corners(&content),
        &[
            [4275010.0625, 638412.015625, 4674100.25],
            [4275008.0625, 638412.015625, 4674100.25],
            [4275010.0625, 638408.015625, 4674100.25],
        ],
    );
    let mesh = one(&content);
    assert!(mesh.positions.as_flattened().iter().all(|x| x.abs() < 10.0));
}

#[test]
fn cesium_rtc_lies_outside_the_up_axis() {
    let (model, meshes) = triangle();
    let file = model.glb(
        json!({"meshes": meshes, "extensionsRequired": ["CESIUM_RTC"],
        "extensions": {"CESIUM_RTC": {"center": [1e6, 2e6, 3e6]}}}),
    );
    near(
        &corners(&alone(&file).unwrap())[1..],
        &[[1000001.0, 2e6, 3e6], [1e6, 2e6, 3000002.0]],
    );
}

#[test]
fn mirroring_nodes_keep_the_front_in_front() {
    let (mut model, _) = triangle();
    let normals = model.add(
        "VEC3",
        5126,
        3,
        &bytes![f32; 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0],
    );
    let meshes = json!([{"primitives": [{"attributes": {"POSITION": 0, "NORMAL": normals}}]}]);
    for nodes in [
        json!([{"mesh": 0, "scale": [-1, 1, 1]}]),
        // Two nodes share the mesh: placements instead of moved vertices.
        json!([{"mesh": 0, "scale": [-1, 1, 1], "children": [1]}, {"mesh": 0, "translation": [5, 0, 0]}]),
    ] {
        let file = model.glb(json!({"meshes": meshes, "nodes": nodes}));
        let content = decode(&file, UpAxis::Z, &|_| Err(String::new())).unwrap();
        let shared = nodes.as_array().unwrap().len() == 2;
        assert_eq!(content.triangle_count(), if shared { 2 } else { 1 });
        for triangle in corners(&content).chunks(3) {
            let normal = (triangle[1] - triangle[0])
                .cross(triangle[2] - triangle[0])
                .normalize();
            assert!((normal - DVec3::Z).length() < 1e-9, "{normal}");
            assert!(triangle.iter().all(|p| p.x <= 0.0), "{triangle:?}");
        }
        assert_eq!(content.meshes[0].mesh.normals[0], [0.0, 0.0, 1.0]);
    }
}

#[test]
fn meshes_on_many_nodes_are_kept_once() {
    let (model, meshes) = triangle();
    let nodes: Vec<Value> = (0..3)
        .map(|i| json!({"mesh": 0, "translation": [i, 0, 0]}))
        .collect();
    let file =
        model.glb(json!({"meshes": meshes, "nodes": nodes, "scenes": [{"nodes": [0, 1, 2]}]}));
    let content = decode(&file, UpAxis::Z, &|_| Err(String::new())).unwrap();
    assert_eq!(content.meshes.len(), 1);
    assert_eq!(content.meshes[0].placements.len(), 3);
    assert_eq!(content.triangle_count(), 3);
    near(&[corners(&content)[6]], &[[2.0, 0.0, 0.0]]);
}

#[test]
fn circles_of_nodes_are_refused() {
    let (model, meshes) = triangle();
    for nodes in [
        json!([{"children": [1]}, {"children": [0]}]),
        json!([{"children": [0]}]),
        json!([{"children": [1, 1]}, {"mesh": 0}]),
        json!([{"children": [7]}]),
        json!([{"translation": [1.5e308, 0, 0], "children": [1]}, {"mesh": 0, "translation": [1.5e308, 0, 0]}]),
    ] {
        assert!(
            alone(&model.glb(json!({"meshes": meshes, "nodes": nodes}))).is_err(),
            "{nodes}"
        );
    }
}

#[test]
fn instancing_places_a_mesh() {
    let (mut model, meshes) = triangle();
    let to = model.add(
        "VEC3",
        5126,
        2,
        &bytes![f32; 1.0, 2.0, 3.0, -1.0, -2.0, -3.0],
    );
    // A half turn about x in normalized shorts, and none.
    let turn = model.add(
        "VEC4",
        5122,
        2,
        &bytes![i16; 32767, 0, 0, 0, 0, 0, 0, 32767],
    );
    model.accessors[turn]["normalized"] = json!(true);
    let scale = model.add("VEC3", 5126, 2, &bytes![f32; 1.0, 1.0, 1.0, 2.0, 2.0, 2.0]);
    let file = model.glb(
        json!({"meshes": meshes, "extensionsRequired": ["EXT_mesh_gpu_instancing"],
        "nodes": [{"mesh": 0, "translation": [10, 0, 0], "extensions": {"EXT_mesh_gpu_instancing": {
            "attributes": {"TRANSLATION": to, "ROTATION": turn, "SCALE": scale}}}}]}),
    );
    let content = decode(&file, UpAxis::Z, &|_| Err(String::new())).unwrap();
    near(
        &corners(&content),
        &[
            [11.0, 2.0, 3.0],
            [12.0, 2.0, 3.0],
            [11.0, 0.0, 3.0],
            [9.0, -2.0, -3.0],
            [11.0, -2.0, -3.0],
            [9.0, 2.0, -3.0],
        ],
    );
}

#[test]
fn quantized_and_sparse_attributes() {
    let mut model = Model::default();
    // Normalized bytes with a stride of four, the last vertex replaced by a sparse one.
    let view = model.view(&[0, 0, 0, 9, 127, 0, 0, 9, 0, 127, 0, 9]);
    model.views[view]["byteStride"] = json!(4);
    let (at, values) = (model.view(&[2]), model.view(&[0, 0, 129]));
    model.accessors.push(
        json!({"bufferView": view, "componentType": 5120, "normalized": true, "count": 3,
        "type": "VEC3", "sparse": {"count": 1, "indices": {"bufferView": at, "componentType": 5121},
        "values": {"bufferView": values}}}),
    );
    let colors = model.add("VEC3", 5121, 3, &[255, 0, 51, 0, 0, 0, 0, 0, 0]);
    model.accessors[colors]["normalized"] = json!(true);
    let zeros = json!({"componentType": 5126, "count": 3, "type": "VEC3"});
    model.accessors.push(zeros);
    let file = model.glb(
        json!({"extensionsRequired": ["KHR_mesh_quantization"], "meshes": [{"primitives": [
        {"attributes": {"POSITION": 0, "COLOR_0": colors, "NORMAL": 2}}]}]}),
    );
    let content = decode(&file, UpAxis::Z, &|_| Err(String::new())).unwrap();
    near(
        &corners(&content),
        &[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]],
    );
    // Vertex colours are linear already.
    assert_eq!(one(&content).colors[0], [1.0, 0.0, 0.2, 1.0]);
}

/// A PNG of 2 × 1 pixels: red, and half transparent green.
fn png() -> Vec<u8> {
    let pixels = image::RgbaImage::from_raw(2, 1, vec![255, 0, 0, 255, 0, 255, 0, 128]).unwrap();
    let mut file = std::io::Cursor::new(Vec::new());
    pixels.write_to(&mut file, image::ImageFormat::Png).unwrap();
    file.into_inner()
}

/// The triangle with texture coordinates, an image of some bytes, a material, and what else the JSON has.
fn textured(image: &[u8], material: Value, more: Value) -> Vec<u8> {
    let (mut model, _) = triangle();
    let uv = model.add("VEC2", 5126, 3, &bytes![f32; 0.0, 0.0, 1.0, 0.0, 0.0, 0.5]);
    let view = model.view(image);
    let mut rest = json!({"meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": uv}, "material": 0}]}],
        "materials": [material], "images": [{"bufferView": view, "mimeType": "image/png"}], "textures": [{"source": 0}]});
    rest.as_object_mut()
        .unwrap()
        .extend(more.as_object().unwrap().clone());
    model.glb(rest)
}

#[test]
fn materials_become_looks() {
    let base = json!({"baseColorFactor": [0.5, 0.25, 1.0, 0.75], "baseColorTexture": {"index": 0}});
    let material = json!({"pbrMetallicRoughness": base, "doubleSided": true, "alphaMode": "MASK", "alphaCutoff": 0.4,
        "extensions": {"KHR_materials_unlit": {}}});
    let more = json!({"samplers": [{"wrapS": 33071, "wrapT": 33071}], "textures": [{"source": 0, "sampler": 0}]});
    let content = alone(&textured(&png(), material, more)).unwrap();
    let mesh = one(&content);
    let look = &mesh.look;
    assert_eq!(look.base_color, [0.5, 0.25, 1.0, 0.75]);
    assert_eq!(
        (
            look.unlit,
            look.double_sided,
            look.repeats,
            look.alpha_cutoff
        ),
        (true, true, false, Some(0.4))
    );
    let texture = look.texture.as_ref().unwrap();
    assert_eq!(
        (texture.size_px, &texture.rgba[..]),
        ([2, 1], &[255, 0, 0, 255, 0, 255, 0, 128][..])
    );
    assert_eq!(mesh.uv, [[0.0, 0.0], [1.0, 0.0], [0.0, 0.5]]);

    // Opaque ones have no alpha, whatever their colour says.
    let content = alone(&textured(
        &png(),
        json!({"pbrMetallicRoughness": base}),
        json!({}),
    ))
    .unwrap();
    let look = &one(&content).look;
    assert_eq!(
        (
            look.base_color[3],
            look.alpha_cutoff,
            look.repeats,
            look.unlit
        ),
        (1.0, None, true, false)
    );
}

#[test]
fn specular_glossiness_gives_its_diffuse_part() {
    let material = json!({"extensions": {"KHR_materials_pbrSpecularGlossiness": {
        "diffuseFactor": [0.1, 0.2, 0.3, 1.0], "diffuseTexture": {"index": 0}}}});
    let content = alone(&textured(&png(), material, json!({}))).unwrap();
    let look = &one(&content).look;
    assert_eq!(look.base_color, [0.1, 0.2, 0.3, 1.0]);
    assert!(look.texture.is_some());
}

#[test]
fn texture_transforms_move_the_coordinates() {
    let quarter = std::f64::consts::FRAC_PI_2;
    let transform = json!({"offset": [0.25, 0.5], "rotation": quarter, "scale": [2.0, 4.0]});
    let material = json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0,
        "extensions": {"KHR_texture_transform": transform}}}});
    let content = alone(&textured(&png(), material, json!({}))).unwrap();
    // Scaled to (2, 0) and (0, 2), then turned counter-clockwise as seen with v down: (u, v) becomes (v, -u).
    let expected = [[0.25, 0.5], [0.25, -1.5], [2.25, 0.5]];
    for (found, expected) in one(&content).uv.iter().zip(expected) {
        assert!(
            (found[0] - expected[0]).abs() < 1e-6 && (found[1] - expected[1]).abs() < 1e-6,
            "{found:?}"
        );
    }
}

#[test]
fn images_come_from_views_data_and_files() {
    let encoded = base64::engine::general_purpose::STANDARD.encode(png());
    let material = || json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}});
    let data = json!({"images": [{"uri": format!("data:image/png;base64,{encoded}")}]});
    let file = json!({"images": [{"uri": "textures/roof%20tiles.png"}]});
    let fetch = |uri: &str| match uri {
        "textures/roof%20tiles.png" => Ok(png()),
        other => Err(format!("no {other}")),
    };
    for more in [json!({}), data, file] {
        let content = decode(&textured(&png(), material(), more), UpAxis::Y, &fetch).unwrap();
        assert_eq!(one(&content).look.texture.as_ref().unwrap().size_px, [2, 1]);
    }
    let broken = json!({"images": [{"uri": "gone.jpg"}]});
    // The surface stands without its picture, and that is said.
    let content = decode(&textured(&png(), material(), broken), UpAxis::Y, &fetch).unwrap();
    assert!(one(&content).look.texture.is_none());
    let said =
        "a texture is left out: image 0: refers to \"gone.jpg\", which cannot be read: no gone.jpg";
    assert!(
        content.notes.len() == 1 && content.notes[0].starts_with(said),
        "{:?}",
        content.notes
    );
    let other = textured(b"BM no picture that is read", material(), json!({}));
    let content = alone(&other).unwrap();
    assert!(one(&content).look.texture.is_none() && content.notes[0].contains("image 0"));
}

#[test]
fn pictures_of_jpeg_and_webp() {
    let pixels = image::RgbImage::from_fn(16, 8, |x, _| {
        image::Rgb([if x < 8 { 250 } else { 5 }, 128, 60])
    });
    let material = || json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}});
    let webp = json!({"extensionsRequired": ["EXT_texture_webp"],
        "textures": [{"extensions": {"EXT_texture_webp": {"source": 0}}}]});
    for (format, more, tolerance) in [
        (image::ImageFormat::Jpeg, json!({}), 12),
        (image::ImageFormat::WebP, webp, 0),
    ] {
        let mut file = std::io::Cursor::new(Vec::new());
        pixels.write_to(&mut file, format).unwrap();
        let content = alone(&textured(&file.into_inner(), material(), more)).unwrap();
        let texture = one(&content).look.texture.clone().unwrap();
        assert_eq!(texture.size_px, [16, 8]);
        for (i, expected) in [250, 128, 60, 255].into_iter().enumerate() {
            assert!(
                texture.rgba[i].abs_diff(expected) <= tolerance,
                "{format:?}: {:?}",
                &texture.rgba[..4]
            );
        }
    }
}

#[test]
fn pictures_too_large_are_refused_before_they_are_decoded() {
    // A PNG's header alone, of 100,000 × 100,000 pixels.
    let mut file = png();
    file[16..24].copy_from_slice(&[0, 1, 0x86, 0xa0, 0, 1, 0x86, 0xa0]);
    let crc = {
        let mut crc = flate2::Crc::new();
        crc.update(&file[12..29]);
        crc.sum()
    };
    file[29..33].copy_from_slice(&crc.to_be_bytes());
    let material = json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}});
    let refused = alone(&textured(&file, material, json!({}))).unwrap_err();
    assert!(matches!(refused.fault, Fault::TooLarge { .. }), "{refused}");
}

#[test]
fn json_models_with_buffers_elsewhere() {
    let data: Vec<u8> = CORNERS.iter().flat_map(|x| x.to_le_bytes()).collect();
    let root = |uri: &str| {
        json!({"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
            "bufferViews": [{"buffer": 0, "byteLength": 36}], "buffers": [{"uri": uri, "byteLength": 36}]})
        .to_string()
    };
    let encoded = base64::engine::general_purpose::STANDARD.encode(&data);
    let inside = root(&format!("data:application/octet-stream;base64,{encoded}"));
    assert_eq!(alone(inside.as_bytes()).unwrap().triangle_count(), 1);
    let fetch = |uri: &str| {
        if uri == "a.bin" {
            Ok(data.clone())
        } else {
            Err("gone".into())
        }
    };
    let outside = decode(root("a.bin").as_bytes(), UpAxis::Y, &fetch).unwrap();
    assert_eq!(outside, alone(inside.as_bytes()).unwrap());
    let short = |_: &str| Ok(data[..35].to_vec());
    let refused = decode(root("a.bin").as_bytes(), UpAxis::Y, &short).unwrap_err();
    assert_eq!(
        refused.fault,
        Fault::Short {
            needed: 36,
            have: 35
        }
    );
    assert_eq!(refused.place, "glTF, buffer 0");
}

#[test]
fn extensions_that_are_not_read_are_named_where_they_are_required() {
    let (model, meshes) = triangle();
    let file =
        model.glb(json!({"meshes": meshes, "extensionsRequired": ["KHR_gaussian_splatting"]}));
    let refused = alone(&file).unwrap_err().to_string();
    assert!(
        refused.contains("it requires the glTF extension KHR_gaussian_splatting"),
        "{refused}"
    );
    let file = model.glb(json!({"meshes": meshes, "extensionsUsed": ["KHR_gaussian_splatting"]}));
    assert_eq!(alone(&file).unwrap().triangle_count(), 1);
}

#[test]
fn numbers_that_are_not_finite_are_refused() {
    let mut model = Model::default();
    model.add(
        "VEC3",
        5126,
        3,
        &bytes![f32; 0.0, 0.0, 0.0, 1.0, f32::NAN, 0.0, 0.0, 2.0, 0.0],
    );
    let file = model.glb(json!({"meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}]}));
    let refused = alone(&file).unwrap_err().to_string();
    assert!(
        refused.starts_with("glTF, mesh 0, primitive 0, POSITION: is damaged"),
        "{refused}"
    );
}
