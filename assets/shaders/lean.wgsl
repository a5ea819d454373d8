// The one material of sensor cameras and window: Lambert sun, sky ambient, air-light (eq. 5).
// It stays lean because a software rasteriser pays for every instruction of every fragment. No branch
// asks uniforms alone: Mesa's lavapipe makes a shader anew, and keeps it, whenever such a uniform may have changed.
// Output: rgb = luminance of linear sRGB channels [kcd/m^2] times the view's exposure,
// alpha = 1 and the identity digit of the surface (see `systems/capture.rs`).
// A window's view alone asks Bevy for a tone curve; its pipelines balance the white and roll the highlights off.

#import bevy_pbr::mesh_functions
#import bevy_pbr::mesh_view_bindings::view

struct Light {
    sun_dir: vec4<f32>,       // unit vector to the sun, ENU
    sun: vec4<f32>,           // direct normal illuminance, rgb [klx]
    ambient_sky: vec4<f32>,   // illuminance of an upward face [klx]
    ambient_ground: vec4<f32>,// illuminance of a downward face [klx]
    extinction: vec4<f32>,    // rgb [1/m]
    night: vec4<f32>,         // x: luminance of a lit window [kcd/m^2]
    // Air-light as a polynomial in the cosine of the azimuth from the sun, rgb [kcd/m^2]
    airlight: array<vec4<f32>, 4>,
}

@group(#{MATERIAL_BIND_GROUP}) @binding(0) var<uniform> light: Light;
@group(#{MATERIAL_BIND_GROUP}) @binding(1) var picture: texture_2d<f32>;
@group(#{MATERIAL_BIND_GROUP}) @binding(2) var picture_sampler: sampler;
@group(#{MATERIAL_BIND_GROUP}) @binding(3) var sky_table: texture_2d<f32>;
@group(#{MATERIAL_BIND_GROUP}) @binding(4) var sky_sampler: sampler;

// Bevy says which attributes a mesh has; the generated city's have all.
struct Vertex {
    @builtin(instance_index) instance_index: u32,
    @location(0) position: vec3<f32>,
#ifdef VERTEX_NORMALS
    @location(1) normal: vec3<f32>,
#endif
#ifdef VERTEX_COLORS
    @location(2) color: vec4<f32>,   // linear albedo, ambient occlusion; of TILE alpha
#endif
#ifdef VERTEX_UVS_A
    @location(3) uv: vec2<f32>,      // facade metres, place in the picture, or on a half chord and the angle of that
#endif
#ifndef TILE
    @location(4) surface: vec2<f32>, // kind; variant in 0..1, or the angle from blade to blade
#endif
}

// Light and air are worked out at the corners: a fragment pays for them in gathers from the uniforms, lane by
// lane. The land's largest triangles, 800 m wide in 5 km, then err by a hundredth at 10 km of visibility.
struct Fragment {
    @builtin(position) clip: vec4<f32>,
#ifdef SKY
    @location(0) world: vec3<f32>,
#else
    @location(0) lit: vec3<f32>,  // what reaches the camera of the light that the surface throws back
    @location(1) haze: vec3<f32>, // air-light in front of it
    @location(2) uv: vec2<f32>,
    // Kind, variant, alpha written, luminance of a lit window; of TILE the first is the vertex's own alpha.
    @location(3) @interpolate(flat) surface: vec4<f32>,
#ifdef MIRRORS
    @location(4) world: vec3<f32>,
    @location(5) normal: vec3<f32>,
    @location(6) through: vec3<f32>, // transmittance times exposure
#endif
#endif
}

const KIND_FACADE_OFFICE: f32 = 2.0;

// The upper hemisphere on a square, octahedron-wise: no trigonometry for a fragment to pay for.
// The square's border is the horizon, its centre the zenith; see `sky_direction` in scene.rs.
fn sky(dir: vec3<f32>) -> vec4<f32> {
    let flat = dir.xy / (abs(dir.x) + abs(dir.y) + max(dir.z, 0.0));
    let uv = vec2(flat.x + flat.y, flat.y - flat.x) * 0.5 + 0.5;
    return textureSampleLevel(sky_table, sky_sampler, uv, 0.0);
}

// The view's exposure by channel. A window's has the gains of its white balance in its saturations: `systems/view/exposure.rs`.
fn exposed() -> vec3<f32> {
#ifdef TONEMAP_METHOD_REINHARD
    return view.exposure * view.color_grading.saturation;
#else
    return vec3(view.exposure);
#endif
}

// What a window shows of a colour: as it is up to a middle grey twice over, then ever less in its own hue, so that white walls
// in the sun keep their shades and lamps their colour. Pixels of sensors are left alone: their sensor model saturates.
fn developed(rgb: vec3<f32>) -> vec3<f32> {
#ifdef TONEMAP_METHOD_REINHARD
    let most = max(max(rgb.r, rgb.g), max(rgb.b, 1e-6));
    let rolled = 1.0 - 0.6 * exp((0.4 - most) / 0.6);
    return rgb * select(1.0, rolled / most, most > 0.4);
#else
    return rgb;
#endif
}

// What distant air shines with in a direction: the sky just above the horizon there.
fn airlight(dir: vec3<f32>) -> vec3<f32> {
    let c = dot(normalize(dir.xy + vec2(1e-9, 0.0)), normalize(light.sun_dir.xy + vec2(1e-9, 0.0)));
    let a = light.airlight;
    return (a[0] + c * (a[1] + c * (a[2] + c * a[3]))).rgb;
}

@vertex
fn vertex(in: Vertex) -> Fragment {
    var out: Fragment;
    let world_from_local = mesh_functions::get_world_from_local(in.instance_index);
    var place = in.position;
    // A tag: the digit of an identity in three bits, above them a rotor's speed [rad/s / 16].
    let tag = mesh_functions::get_tag(in.instance_index);
#ifdef TURNS
    // A rotor's slivers lie as densely as the blade is there during the exposure, which the view has as its bias [s]:
    // `sliver_turn_rad` of models/shape/uav_mesh/mod.rs.
    let half_turn = 0.5 * min(f32(tag >> 3u) * 0.0625 * view.mip_bias, in.surface.y);
    let half_chord = in.uv.y;
    let sharp = half_chord * abs(in.uv.x);
    let inner = sharp * max(half_turn / half_chord, 1.0);
    let outer = half_chord + half_turn - 2.0 * sqrt(max(half_turn * (half_chord - sharp), 0.0));
    let angle = select(outer, inner, inner <= abs(half_chord - half_turn));
    let turn_rad = select(sign(in.uv.x) * (angle - sharp), 0.0, in.uv.x == 0.0 || half_turn <= 0.0);
    let turned = vec2(cos(turn_rad), sin(turn_rad));
    let turns = mat2x2(turned.x, turned.y, -turned.y, turned.x);
    place = vec3(turns * place.xy, place.z);
#endif
    let at = mesh_functions::mesh_position_local_to_world(world_from_local, vec4(place, 1.0));
    let world = at.xyz - view.world_position;
    out.clip = view.clip_from_world * at;
#ifdef SKY
    out.world = world;
#else
    let through = exp(-light.extinction.rgb * length(world)) * exposed();
#ifdef VERTEX_COLORS
    let color = in.color;
#else
    let color = vec4(1.0);
#endif
#ifdef BAKED
    // The colours have their light in them: level ground in the open sets the scale, and nights are dark.
    let illuminance = light.sun.rgb * max(light.sun_dir.z, 0.0) + light.ambient_sky.rgb;
#else
#ifdef TURNS
    let facing = vec3(turns * in.normal.xy, in.normal.z);
#else
    let facing = in.normal;
#endif
    var normal = normalize(mesh_functions::mesh_normal_local_to_world(facing, in.instance_index));
#ifdef TWO_SIDED
    normal *= -sign(dot(normal, world));
#endif
#ifdef TILE
    let openness = 1.0;
#else
    let openness = color.a;
#endif
    let lambert = max(dot(normal, light.sun_dir.xyz), 0.0);
    let ambient = mix(light.ambient_ground.rgb, light.ambient_sky.rgb, 0.5 + 0.5 * normal.z);
    // Occlusion dims the ambient term fully and, being a proxy for shade, the sun in part.
    let illuminance = light.sun.rgb * lambert * (0.35 + 0.65 * openness) + ambient * openness;
#endif
    out.lit = color.rgb * illuminance * 0.31830988 * through;
    out.haze = airlight(world) * (exposed() - through);
#ifdef VERTEX_UVS_A
    out.uv = in.uv;
#endif
    // Digits in base 5: the resolve averages 4 samples, so sum(samples) = alpha * 4 tells
    // exactly how many samples of a pixel are covered, and how many by each of four identities.
    let digit = f32(tag & 7u);
    let identity = select(floor(pow(5.0, digit) + 0.5), 0.0, digit == 0.0);
#ifdef TILE
    out.surface = vec4(color.a, 0.0, 1.0 + identity, 0.0);
#else
    out.surface = vec4(in.surface, 1.0 + identity, light.night.x);
#endif
#ifdef MIRRORS
    out.world = world;
    out.normal = normal;
    out.through = through;
#endif
#endif
    return out;
}

// Share of a window pulse (lo..hi of each unit period) under a box filter of width w around x.
fn pulse(x: f32, w: f32, lo: f32, hi: f32) -> f32 {
    let a = x - 0.5 * w;
    let b = x + 0.5 * w;
    let ia = floor(a) * (hi - lo) + clamp(fract(a) - lo, 0.0, hi - lo);
    let ib = floor(b) * (hi - lo) + clamp(fract(b) - lo, 0.0, hi - lo);
    return (ib - ia) / w;
}

fn hash(p: vec2<f32>) -> f32 {
    return fract(sin(dot(p, vec2(12.9898, 78.233))) * 43758.547);
}

// A number in 0..1 for a lattice point, by integers alone: no trigonometry for a fragment to pay for.
fn lattice(p: vec2<i32>) -> f32 {
    var h = (u32(p.x) * 0x27d4eb2du) ^ (u32(p.y) * 0x165667b1u);
    h = (h ^ (h >> 15u)) * 0x2c1b3c6du;
    h = (h ^ (h >> 13u)) * 0x297a2d39u;
    return f32(h >> 8u) * (1.0 / 16777216.0);
}

// Value noise in 0..1.
fn noise(p: vec2<f32>) -> f32 {
    let cell = floor(p);
    let i = vec2<i32>(cell);
    let f = p - cell;
    let s = f * f * (3.0 - 2.0 * f);
    let a = lattice(i);
    let b = lattice(i + vec2(1, 0)) - a;
    let c = lattice(i + vec2(0, 1)) - a;
    let d = lattice(i + vec2(1, 1)) - a - b - c;
    return a + b * s.x + c * s.y + d * s.x * s.y;
}

#ifdef SKY
@fragment
fn fragment(in: Fragment) -> @location(0) vec4<f32> {
    let dir = normalize(in.world);
    let behind = sky(dir);
    // The sun's disc, 0.53 deg across; half floats end at 65504.
    let disc = behind.a * smoothstep(0.999985, 0.999993, dot(dir, light.sun_dir.xyz));
    let radiance = behind.rgb + disc * min(light.sun.rgb * 15.0, vec3(30000.0));
    return vec4(developed(radiance * exposed()), 0.0);
}
#else
@fragment
fn fragment(in: Fragment) -> @location(0) vec4<f32> {
    var seen = in.lit;
#ifdef PICTURE
    let texel = textureSample(picture, picture_sampler, in.uv);
    seen *= texel.rgb;
#ifdef CUTOFF
    if texel.a * in.surface.x * 255.0 < f32(#{CUTOFF}) {
        discard;
    }
#endif
#endif
#ifdef FOLIAGE
    // Clumps of leaves, where the woods' meshes give metres along the crown.
    let width = max(fwidth(in.uv), vec2(1e-4));
    let fine = clamp(2.0 - 2.5 * max(width.x, width.y), 0.0, 1.0) * step(1e-6, in.uv.y);
    let clumps = 0.6 * noise(in.uv * 1.3) + 0.4 * noise(in.uv * 3.7);
    seen *= mix(1.0, 0.3 + 1.4 * clumps, fine);
#endif
#ifdef MIRRORS
    let dir = normalize(in.world);
    let normal = normalize(in.normal);
    let mirrored = reflect(dir, normal);
    var reflected = sky(vec3(mirrored.xy, abs(mirrored.z))).rgb;
#ifdef FACADE
    let office = in.surface.x == KIND_FACADE_OFFICE;
    let variant = in.surface.y;
    let pitch = select(vec2(3.0, 3.0), vec2(3.0, 3.6), office); // bay and storey [m], as models/ground/city/parts.rs
    let cell = in.uv / pitch;
    let w = max(fwidth(in.uv), vec2(1e-4)) / pitch;
    let side = select(0.30 - 0.08 * variant, 0.06, office);
    let sill = select(0.30, 0.22, office);
    let glass = pulse(cell.x, w.x, side, 1.0 - side) * pulse(cell.y, w.y, sill, 0.86);
    // Glass mirrors the sky it faces; from below the horizon, its opposite street.
    let chance = hash(floor(cell) + floor(variant * 97.0));
    // Panes hang up to 1.5 deg out of true: some flash the sun, spread over 1 deg by their waves.
    if dot(mirrored, light.sun_dir.xyz) > 0.995 {
        let tilt = fract(chance * vec3(91.7, 57.3, 233.1)) - 0.5;
        let pane = normalize(normal + 0.052 * tilt);
        let flash = smoothstep(0.99994, 0.99998, dot(reflect(dir, pane), light.sun_dir.xyz));
        reflected += flash * light.sun.rgb * (15.0 / max(w.x * w.y, 1.0));
    }
    let lamp = step(0.8, chance) * in.surface.w * vec3(1.0, 0.78, 0.5);
    let shone = reflected * (0.10 + 0.25 * variant) + lamp;
    seen += glass * (shone * in.through - 0.85 * seen);
#else
    let fresnel = 0.02 + 0.98 * pow(1.0 - clamp(dot(-dir, normal), 0.0, 1.0), 5.0);
    seen += reflected * fresnel * in.through;
#endif
#endif
    return vec4(developed(seen + in.haze), in.surface.z);
}
#endif
