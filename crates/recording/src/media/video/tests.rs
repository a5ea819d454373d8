use super::boxes::Broken;
use super::colour::{Colours, rgb_of, yuv_of};
use super::read::numbered;
use super::tables::samples;
use super::write::{HEAD, boxed};
use super::*;
use image::{ImageFormat, Rgb, RgbImage};
use proptest::prelude::*;
use std::path::Path;
use std::sync::LazyLock;

mod containers;

const SIZE: [u32; 2] = [66, 50];
const COUNT: usize = 9;

/// A bright disc that moves over a grey slope.
fn picture(index: usize) -> RgbImage {
    let centre = (12.0 + 4.0 * index as f64, 20.0 + index as f64);
    RgbImage::from_fn(SIZE[0], SIZE[1], |i, j| {
        let (x, y) = (f64::from(i), f64::from(j));
        if (x - centre.0).hypot(y - centre.1) < 6.0 {
            Rgb([230, 180, 90])
        } else {
            Rgb([60 + i as u8, 70 + i as u8, 90 + j as u8])
        }
    })
}

/// A file with its index behind the frames.
static FILE: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mp4");
    let mut writer = Writer::create(&path, SIZE, 25.0).unwrap();
    for i in 0..COUNT {
        writer.push(&picture(i)).unwrap();
    }
    writer.finish(25.0).unwrap();
    std::fs::read(path).unwrap()
});

/// The same with its index before the frames.
fn index_first() -> Vec<u8> {
    let at = find(&FILE, b"moov") - 4;
    let (data, moov) = FILE.split_at(at);
    let mut moov = moov.to_vec();
    let offset = find(&moov, b"stco") + 12;
    let shifted = (HEAD.len() + moov.len()) as u32;
    moov[offset..offset + 4].copy_from_slice(&shifted.to_be_bytes());
    [&data[..24], &moov, &data[24..]].concat()
}

fn find(data: &[u8], kind: &[u8]) -> usize {
    data.windows(kind.len()).position(|w| w == kind).unwrap()
}

fn replaced(from: &[u8], to: &[u8]) -> Vec<u8> {
    let mut bytes = FILE.clone();
    let at = find(&bytes, from);
    bytes[at..at + to.len()].copy_from_slice(to);
    bytes
}

fn read(path: &Path) -> Result<Vec<ClipFrame>, VideoError> {
    let mut clip = Clip::open(path, 30.0)?;
    let mut frames = Vec::new();
    while let Some(frame) = clip.next_frame()? {
        frames.push(frame);
    }
    assert_eq!(frames.len(), clip.frames());
    Ok(frames)
}

fn read_bytes(bytes: &[u8]) -> Result<Vec<ClipFrame>, VideoError> {
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), bytes).unwrap();
    read(file.path())
}

#[test]
fn what_is_written_is_read_again() {
    for bytes in [FILE.clone(), index_first()] {
        let frames = read_bytes(&bytes).unwrap();
        assert_eq!(frames.len(), COUNT);
        for (i, frame) in frames.iter().enumerate() {
            assert_eq!(frame.size_px(), SIZE);
            assert!((frame.t_s - i as f64 / 25.0).abs() < 1e-6, "{}", frame.t_s);
            // Brightness: chroma is halved, which costs the disc's edge its colour.
            let luma = |rgb8: &[u8]| -> Vec<f64> {
                rgb8.chunks_exact(3)
                    .map(|p| {
                        0.299 * f64::from(p[0]) + 0.587 * f64::from(p[1]) + 0.114 * f64::from(p[2])
                    })
                    .collect()
            };
            let squares: f64 = (luma(frame.picture.as_raw())
                .iter()
                .zip(luma(picture(i).as_raw())))
            .map(|(a, b)| (a - b).powi(2))
            .sum();
            let area = f64::from(SIZE[0] * SIZE[1]);
            let psnr_db = 10.0 * (255.0 * 255.0 * area / squares).log10();
            assert!(psnr_db > 36.0, "frame {i}: {psnr_db:.1} dB");
        }
    }
}

/// Against BT.601's definition: 8-bit limited range of the primaries, and back.
#[test]
fn colours_are_those_of_the_standard() {
    let rgb = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255; 3], [0; 3]];
    let ycc = [
        [81, 90, 240],
        [145, 54, 34],
        [41, 240, 110],
        [235, 128, 128],
        [16, 128, 128],
    ];
    for (rgb, ycc) in rgb.into_iter().zip(ycc) {
        let frame = yuv_of(&RgbImage::from_pixel(2, 2, Rgb(rgb)));
        for (found, expected) in [frame.y[0], frame.u[0], frame.v[0]].iter().zip(ycc) {
            assert!(found.abs_diff(expected) <= 1, "{rgb:?}: {found} {expected}");
        }
        let back = rgb_of(&frame, Colours::of(None, false).unwrap());
        for (found, expected) in back.as_raw().iter().zip(rgb.iter().cycle()) {
            assert!(found.abs_diff(*expected) <= 3, "{rgb:?}: {back:?}");
        }
    }
}

#[test]
fn an_odd_row_and_column_are_left_out() {
    let frame = yuv_of(&RgbImage::from_pixel(5, 3, Rgb([200; 3])));
    assert_eq!((frame.width, frame.height), (4, 2));
    assert!(frame.is_valid());
}

#[test]
fn frames_are_shown_in_the_order_of_their_times() {
    // Stored I P B B, shown I B B P: shifts of 1, 3, 0 and 0 steps of 100.
    let table =
        |numbers: &[u32]| -> Vec<u8> { numbers.iter().flat_map(|n| n.to_be_bytes()).collect() };
    let stbl = [
        boxed(b"stsz", &table(&[0, 0, 4, 10, 20, 30, 40])),
        boxed(b"stco", &table(&[0, 2, 1_000, 5_000])),
        boxed(b"stsc", &table(&[0, 2, 1, 3, 1, 2, 1, 1])),
        boxed(b"stts", &table(&[0, 1, 4, 100])),
        boxed(b"ctts", &table(&[0, 3, 1, 100, 1, 300, 2, 0])),
    ]
    .concat();
    let found = samples(&stbl, 10_000).map_err(|_| "refused").unwrap();
    let brief: Vec<_> = found.iter().map(|s| (s.offset, s.size, s.shown)).collect();
    let expected = [
        (1_000, 10, 100),
        (1_010, 20, 400),
        (1_030, 30, 200),
        (5_000, 40, 300),
    ];
    assert_eq!(brief, expected);
    assert!(matches!(samples(&stbl, 5_039), Err(Broken::Truncated(_))));
}

#[test]
fn what_is_no_clip_is_told() {
    let told = |bytes: &[u8]| read_bytes(bytes).unwrap_err().to_string();
    let whole = index_first();
    for (bytes, expected) in [
        (&b""[..], "no MP4 or MOV file"),
        (b"abc", "no MP4 or MOV file"),
        (b"# A page of text, not a video", "no MP4 or MOV file"),
        (b"\x89PNG\r\n\x1a\n0123456789", "no MP4 or MOV file"),
        (&FILE[..HEAD.len() - 16], "no 'moov' box"),
        (&FILE[..300], "'mdat' box goes on after the end"),
        (&FILE[..FILE.len() - 1], "'moov' box goes on after the end"),
        (&whole[..200], "'moov' box goes on after the end"),
        (
            &whole[..whole.len() - 1],
            "frame 8 of 9 lies behind the end",
        ),
        (&replaced(b"vide", b"soun"), "no video track"),
        (
            &replaced(b"avc1\0\0\0\0", b"hvc1"),
            "H.265 (HEVC) ('hvc1'), not H.264",
        ),
        (&replaced(b"avcC", b"free"), "lacks the parameters"),
        (&replaced(b"stsz", b"free"), "'stsz' is damaged"),
        (
            &replaced(
                b"stts\0\0\0\0\0\0\0\x01\0\0\0\x09",
                b"stts\0\0\0\0\0\0\0\x01\0\0\0\x08",
            ),
            "'stts' is damaged",
        ),
    ] {
        let message = told(bytes);
        assert!(message.contains(expected), "{expected}: {message}");
    }
    let mut noise = FILE.clone();
    noise[HEAD.len()..HEAD.len() + 60].fill(0xa7);
    let message = told(&noise);
    assert!(message.contains("frame 0 cannot be decoded"), "{message}");
    // A byte in a slice by which the decoder panics.
    let mut bytes = FILE.clone();
    let at = (FILE.len() as u128 * 7_856_727_431_009_071_375) >> 64;
    bytes[at as usize] = 168;
    let message = told(&bytes);
    assert!(
        message.contains("cannot be decoded (it is damaged)"),
        "{message}"
    );
}

fn png(path: &Path, [width, height]: [u32; 2], grey: u8) {
    let picture = RgbImage::from_pixel(width, height, Rgb([grey; 3]));
    picture.save_with_format(path, ImageFormat::Png).unwrap();
}

#[test]
fn folders_are_read_by_number() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let told = || read(path).unwrap_err().to_string();
    assert!(told().contains("holds no .png"), "{}", told());
    for (name, grey) in [
        ("f_10.png", 10),
        ("f_9.png", 9),
        ("f_011.PNG", 11),
        ("notes.txt", 0),
    ] {
        png(&path.join(name), [8, 6], grey);
    }
    let frames = read(path).unwrap();
    let greys: Vec<u8> = frames
        .iter()
        .map(|frame| frame.picture.as_raw()[0])
        .collect();
    assert_eq!(greys, [9, 10, 11]);
    assert!((frames[2].t_s - 2.0 / 30.0).abs() < 1e-12);
    png(&path.join("f_12.png"), [8, 7], 12);
    let message = told();
    assert!(message.contains("f_12.png") && message.contains("8 × 7 px, those before it 8 × 6"));
    std::fs::write(path.join("f_12.png"), "no picture").unwrap();
    assert!(told().contains("f_12.png: no picture"), "{}", told());
    assert!(read(&path.join("absent")).is_err());
}

#[test]
fn names_are_split_at_their_last_number() {
    for (name, expected) in [
        ("000012.png", ("", 12)),
        ("V_1_0015.jpg", ("V_1_", 15)),
        ("é9x.png", ("é", 9)),
        ("x.png", ("", u64::MAX)),
        ("12345678901234567890123.png", ("", u64::MAX)),
    ] {
        let (before, number, _) = numbered(Path::new(name));
        assert_eq!((before.as_str(), number), expected, "{name}");
    }
}

proptest! {
    /// A damaged file is read or refused.
    #[test]
    fn any_damage_is_read_or_refused(
        first in any::<bool>(),
        at in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        cut in any::<prop::sample::Index>(),
        cuts in any::<bool>(),
    ) {
        let mut bytes = if first { index_first() } else { FILE.clone() };
        for (at, byte) in at {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        if cuts {
            bytes.truncate(cut.index(bytes.len()));
        }
        let _ = read_bytes(&bytes);
    }
}
