//! The same frames in other boxes: fragments, edit lists, turns, and what else containers say.

use super::*;
use crate::media::video::edits::{Edit, place};
use crate::media::video::sps::{Stated, stated};
use crate::media::video::tables::Sample;
use std::path::PathBuf;

/// Units of time a second of the movies made here, and of their track [Hz].
const MOVIE_HZ: u32 = 1_000;
const TRACK_HZ: u32 = 90_000;
/// Time between two frames, in units of the track.
const STEP: u32 = 3_600;

fn u32s(numbers: &[u32]) -> Vec<u8> {
    numbers.iter().flat_map(|n| n.to_be_bytes()).collect()
}

/// The frames of [`FILE`] as they are read from it.
static FRAMES: LazyLock<Vec<ClipFrame>> = LazyLock::new(|| read_bytes(&FILE).unwrap());

/// The coded frames of [`FILE`].
fn payloads() -> Vec<Vec<u8>> {
    let at = find(&FILE, b"stsz") + 12;
    let sizes = FILE[at + 4..].chunks_exact(4).take(COUNT);
    let mut rest = &FILE[HEAD.len()..];
    sizes
        .map(|size| {
            let size = u32::from_be_bytes(*size.first_chunk().unwrap()) as usize;
            let (one, after) = rest.split_at(size);
            rest = after;
            one.to_vec()
        })
        .collect()
}

/// A sample entry and its `avcC` box, of [`FILE`].
fn entry() -> (Vec<u8>, Vec<u8>) {
    let at = find(&FILE, b"avc1\0\0\0\0") + 4;
    let avcc = find(&FILE, b"avcC") - 4;
    let size = u32::from_be_bytes(*FILE[avcc..].first_chunk().unwrap()) as usize;
    (FILE[at..at + 78].to_vec(), FILE[avcc..avcc + size].to_vec())
}

/// How fragments say where their data begins.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Base {
    Moof,
    Absolute,
    Implied,
}

/// How frames are put into boxes.
#[derive(Clone, Debug)]
struct Boxing {
    /// Frames of each fragment; none: one table.
    fragments: Vec<usize>,
    base: Base,
    /// Whether sizes, times and offsets take 64 bits, and boxes are of version 1.
    long: bool,
    index_first: bool,
    /// Entries of the edit list: length in the movie, start in the track, rate.
    edits: Vec<(u64, i64, u32)>,
    /// a, b, c, d.
    matrix: [i32; 4],
    durations: Vec<u32>,
    /// How much later each frame is shown than decoded.
    shifts: Vec<i32>,
    brand: [u8; 4],
    kind: [u8; 4],
    /// More boxes of the sample entry.
    more: Vec<u8>,
    /// Tracks before this one.
    before: Vec<u8>,
    /// Parameter sets in the frames alone.
    in_band: bool,
}

fn plain() -> Boxing {
    Boxing {
        fragments: Vec::new(),
        base: Base::Moof,
        long: false,
        index_first: true,
        edits: Vec::new(),
        matrix: [1, 0, 0, 1],
        durations: vec![STEP; COUNT],
        shifts: vec![0; COUNT],
        brand: *b"isom",
        kind: *b"avc1",
        more: Vec::new(),
        before: Vec::new(),
        in_band: false,
    }
}

/// A box with a size of 64 bits, or of 32.
fn sized(kind: &[u8; 4], content: &[u8], long: bool) -> Vec<u8> {
    if !long {
        return boxed(kind, content);
    }
    let mut out = vec![0, 0, 0, 1];
    out.extend(kind);
    out.extend((16 + content.len() as u64).to_be_bytes());
    out.extend(content);
    out
}

impl Boxing {
    fn payloads(&self) -> Vec<Vec<u8>> {
        let mut frames = payloads();
        if self.in_band {
            let (_, avcc) = entry();
            // Version, profile and lengths, one set of each kind.
            let mut rest = &avcc[8 + 5..];
            let mut sets = Vec::new();
            for _ in 0..2 {
                let size = usize::from(u16::from_be_bytes([rest[1], rest[2]]));
                sets.extend((size as u32).to_be_bytes());
                sets.extend(&rest[3..3 + size]);
                rest = &rest[3 + size..];
            }
            sets.extend(&frames[0]);
            frames[0] = sets;
        }
        frames
    }

    fn table(&self, offset: u64) -> Vec<u8> {
        let frames = self.payloads();
        let (mut head, avcc) = entry();
        head.extend(match self.in_band {
            true => boxed(b"avcC", &[&avcc[8..8 + 5], &[0xe0, 0][..]].concat()),
            false => avcc,
        });
        head.extend(&self.more);
        let stsd = [u32s(&[0, 1]), boxed(&self.kind, &head)].concat();
        let stsd = boxed(b"stsd", &stsd);
        if !self.fragments.is_empty() {
            let none = u32s(&[0, 0]);
            let more = [
                boxed(b"stts", &none),
                boxed(b"stsc", &none),
                boxed(b"stco", &none),
                boxed(b"stsz", &u32s(&[0, 0, 0])),
            ];
            return [stsd, more.concat()].concat();
        }
        let n = COUNT as u32;
        let sizes: Vec<u32> = frames.iter().map(|frame| frame.len() as u32).collect();
        let runs: Vec<u32> = self.durations.iter().flat_map(|d| [1, *d]).collect();
        let shifts: Vec<u32> = (self.shifts.iter())
            .flat_map(|s| [1, s.cast_unsigned()])
            .collect();
        let offsets = match self.long {
            true => boxed(
                b"co64",
                &u32s(&[0, 1, (offset >> 32) as u32, offset as u32]),
            ),
            false => boxed(b"stco", &u32s(&[0, 1, offset as u32])),
        };
        [
            stsd,
            boxed(b"stts", &u32s(&[&[0, n][..], &runs].concat())),
            boxed(b"ctts", &u32s(&[&[0, n][..], &shifts].concat())),
            boxed(b"stsc", &u32s(&[0, 1, 1, n, 1])),
            boxed(b"stsz", &u32s(&[&[0, 0, n][..], &sizes].concat())),
            offsets,
        ]
        .concat()
    }

    fn moov(&self, offset: u64) -> Vec<u8> {
        let one = 1_i32 << 16;
        let turn = |[a, b, c, d]: [i32; 4]| {
            [a * one, b * one, 0, c * one, d * one, 0, 0, 0, 1 << 30].map(i32::cast_unsigned)
        };
        let version = u32::from(self.long) << 24;
        let times = |flags: u32, after: &[u32]| {
            let before: &[u32] = if self.long { &[0; 4] } else { &[0; 2] };
            u32s(&[&[version | flags][..], before, after].concat())
        };
        let span: &[u32] = if self.long { &[0, 0] } else { &[0] };
        let tkhd = [
            times(3, &[&[7, 0][..], span, &[0; 4]].concat()),
            u32s(&turn(self.matrix)),
            u32s(&[SIZE[0] << 16, SIZE[1] << 16]),
        ];
        let row = |(length, start, rate): &(u64, i64, u32)| match self.long {
            true => [length.to_be_bytes(), start.to_be_bytes()]
                .concat()
                .into_iter()
                .chain(rate.to_be_bytes())
                .collect::<Vec<u8>>(),
            false => u32s(&[*length as u32, (*start as i32).cast_unsigned(), *rate]),
        };
        let rows: Vec<u8> = self.edits.iter().flat_map(row).collect();
        let elst = [u32s(&[version, self.edits.len() as u32]), rows].concat();
        let edts = match self.edits.is_empty() {
            true => Vec::new(),
            false => boxed(b"edts", &boxed(b"elst", &elst)),
        };
        let mut hdlr = u32s(&[0, 0]);
        hdlr.extend(b"vide\0\0\0\0\0\0\0\0\0\0\0\0\0");
        let mdia = [
            boxed(b"mdhd", &times(0, &[&[TRACK_HZ][..], span, &[0]].concat())),
            boxed(b"hdlr", &hdlr),
            boxed(b"minf", &boxed(b"stbl", &self.table(offset))),
        ];
        let trak = [
            boxed(b"tkhd", &tkhd.concat()),
            edts,
            boxed(b"mdia", &mdia.concat()),
        ];
        let mvhd = [
            times(0, &[&[MOVIE_HZ][..], span, &[1 << 16, 0, 0, 0]].concat()),
            u32s(&turn([1, 0, 0, 1])),
            u32s(&[0, 0, 0, 0, 0, 0, 8]),
        ];
        let trex = boxed(b"trex", &u32s(&[0, 7, 1, STEP, 0, 0]));
        let mvex = match self.fragments.is_empty() {
            true => Vec::new(),
            false => boxed(b"mvex", &trex),
        };
        let all = [
            boxed(b"mvhd", &mvhd.concat()),
            self.before.clone(),
            boxed(b"trak", &trak.concat()),
            mvex,
        ];
        sized(b"moov", &all.concat(), self.long)
    }

    /// A fragment of the frames from `first` on, at `at` in the file.
    fn fragment(&self, first: usize, count: usize, at: u64) -> Vec<u8> {
        let frames = &self.payloads()[first..first + count];
        let decoded: u32 = self.durations[..first].iter().sum();
        let make = |start: u64, shift: u32| {
            let (flags, base) = match self.base {
                Base::Moof => (0x2_0000, Vec::new()),
                Base::Absolute => (1, start.to_be_bytes().to_vec()),
                Base::Implied => (0, Vec::new()),
            };
            let tfhd = [u32s(&[flags, 7]), base].concat();
            let tfdt = match self.long {
                true => u32s(&[1 << 24, 0, decoded]),
                false => u32s(&[0, decoded]),
            };
            // Offset, lengths of time, sizes and shifts.
            let mut trun = u32s(&[0x0100_0b01, count as u32, shift]);
            for (i, frame) in frames.iter().enumerate() {
                let numbers = [self.durations[first + i], frame.len() as u32];
                trun.extend(u32s(&numbers));
                trun.extend(self.shifts[first + i].to_be_bytes());
            }
            let traf = [
                boxed(b"tfhd", &tfhd),
                boxed(b"tfdt", &tfdt),
                boxed(b"trun", &trun),
            ];
            // A track of another number before, of one frame.
            let other = [
                boxed(b"tfhd", &u32s(&[0x2_0000, 3])),
                boxed(b"trun", &u32s(&[0x0000_0200, 1, 1])),
            ];
            let trafs = match self.base {
                Base::Implied => boxed(b"traf", &traf.concat()),
                _ => [
                    boxed(b"traf", &other.concat()),
                    boxed(b"traf", &traf.concat()),
                ]
                .concat(),
            };
            let moof = [boxed(b"mfhd", &u32s(&[0, 1])), trafs].concat();
            boxed(b"moof", &moof)
        };
        let length = make(0, 0).len() as u64;
        let data_head = if self.long { 16 } else { 8 };
        let moof = match self.base {
            Base::Absolute => make(at + length + data_head, 0),
            _ => make(0, (length + data_head) as u32),
        };
        [moof, sized(b"mdat", &frames.concat(), self.long)].concat()
    }

    fn bytes(&self) -> Vec<u8> {
        let ftyp = boxed(b"ftyp", &[&self.brand[..], &[0; 4], &self.brand].concat());
        if !self.fragments.is_empty() {
            let mut out = [ftyp, self.moov(0), boxed(b"sidx", &[0; 24])].concat();
            let mut first = 0;
            for count in &self.fragments {
                let fragment = self.fragment(first, *count, out.len() as u64);
                out.extend(fragment);
                first += count;
            }
            out.extend(boxed(b"mfra", &[0; 8]));
            return out;
        }
        let data = sized(b"mdat", &self.payloads().concat(), self.long);
        let head = if self.long { 16 } else { 8 };
        if self.index_first {
            let offset = ftyp.len() + self.moov(0).len() + head;
            [ftyp, self.moov(offset as u64), data].concat()
        } else {
            let moov = self.moov((ftyp.len() + head) as u64);
            [ftyp, data, moov].concat()
        }
    }

    fn read(&self) -> Result<Vec<ClipFrame>, VideoError> {
        read_bytes(&self.bytes())
    }

    fn warned(&self) -> Vec<String> {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), self.bytes()).unwrap();
        let clip = Clip::open(file.path(), 30.0).unwrap();
        clip.warnings().iter().map(ToString::to_string).collect()
    }

    fn refused(&self) -> String {
        self.read().unwrap_err().to_string()
    }
}

/// The pictures are those of [`FILE`] from `first` on, and shown at the times given [s].
fn same(found: &[ClipFrame], first: usize, times_s: &[f64]) {
    assert_eq!(found.len(), times_s.len());
    for ((found, expected), time_s) in found.iter().zip(&FRAMES[first..]).zip(times_s) {
        assert!(found.picture == expected.picture, "{time_s}");
        assert!((found.t_s - time_s).abs() < 1e-6, "{} {time_s}", found.t_s);
    }
}

fn even_s(count: usize) -> Vec<f64> {
    (0..count).map(|i| i as f64 * 0.04).collect()
}

fn odd(name: &str) -> Option<Vec<ClipFrame>> {
    let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
        .join("../shared/data/odd")
        .join(name);
    if !path.exists() {
        println!("skipped: no ../shared/data/odd/{name}");
        return None;
    }
    Some(super::read(&path).unwrap())
}

#[test]
fn a_turned_clip_of_others_is_upright() {
    let (Some(turned), Some(whole)) = (odd("rotated90.mp4"), odd("fragmented.mp4")) else {
        return;
    };
    assert_eq!(turned.len(), 30);
    assert_eq!(whole.len(), 30);
    assert_eq!(turned[0].size_px(), [240, 320]);
    assert_eq!(whole[0].size_px(), [320, 240]);
}

#[test]
fn a_cut_clip_of_others_begins_with_its_eleventh_frame() {
    let (Some(cut), Some(turned)) = (odd("editlist.mp4"), odd("rotated90.mp4")) else {
        return;
    };
    assert_eq!(cut.len(), 20);
    // The two files hold the same frames; a quarter clockwise brings the left column to the top.
    for (cut, turned) in cut.iter().zip(&turned[10..]) {
        let [width, height] = cut.size_px();
        let upright = RgbImage::from_fn(height, width, |i, j| {
            *cut.picture.get_pixel(j, height - 1 - i)
        });
        assert!(upright == turned.picture);
    }
    assert!((cut[19].t_s - 19.0 / 30.0).abs() < 1e-6);
}

#[test]
fn pictures_are_turned_and_mirrored_as_their_track_says() {
    type Source = fn(u32, u32, [u32; 2]) -> [u32; 2];
    // Where the pixel (i, j) of what is shown lies in what is stored, by the matrices of QuickTime's file format.
    let cases: [([i32; 4], bool, Source); 7] = [
        ([0, 1, -1, 0], true, |i, j, [_, h]| [j, h - 1 - i]),
        ([-1, 0, 0, -1], false, |i, j, [w, h]| [w - 1 - i, h - 1 - j]),
        ([0, -1, 1, 0], true, |i, j, [w, _]| [w - 1 - j, i]),
        ([-1, 0, 0, 1], false, |i, j, [w, _]| [w - 1 - i, j]),
        ([1, 0, 0, -1], false, |i, j, [_, h]| [i, h - 1 - j]),
        ([0, 1, 1, 0], true, |i, j, _| [j, i]),
        ([0, 0, 0, 0], false, |i, j, _| [i, j]),
    ];
    for (matrix, swapped, source) in cases {
        for long in [false, true] {
            let found = Boxing {
                matrix,
                long,
                ..plain()
            }
            .read()
            .unwrap();
            let stored = &FRAMES[3].picture;
            let [width, height] = if swapped { [SIZE[1], SIZE[0]] } else { SIZE };
            let expected = RgbImage::from_fn(width, height, |i, j| {
                let [i, j] = source(i, j, SIZE);
                *stored.get_pixel(i, j)
            });
            assert!(found[3].picture == expected, "{matrix:?}");
        }
    }
    let sheared = Boxing {
        matrix: [1, 1, -1, 1],
        ..plain()
    }
    .refused();
    assert!(sheared.contains("turned by 45°"), "{sheared}");
}

#[test]
fn an_edit_list_says_what_is_shown_and_when() {
    let one = 1 << 16;
    let step = i64::from(STEP);
    let with = |edits: &[(u64, i64, u32)]| Boxing {
        edits: edits.to_vec(),
        ..plain()
    };
    // Five frames from the third on; a delay before them does not count.
    same(
        &with(&[(200, 2 * step, one)]).read().unwrap(),
        2,
        &even_s(5),
    );
    same(
        &with(&[(80, -1, one), (200, 2 * step, one)]).read().unwrap(),
        2,
        &even_s(5),
    );
    // To the end; twice as fast; a gap between two parts.
    same(&with(&[(0, 4 * step, one)]).read().unwrap(), 4, &even_s(5));
    let fast: Vec<f64> = (0..6).map(|i| f64::from(i) * 0.02).collect();
    same(&with(&[(120, step, 2 * one)]).read().unwrap(), 1, &fast);
    let gap = with(&[(80, 0, one), (40, -1, one), (80, 2 * step, one)])
        .read()
        .unwrap();
    same(&gap, 0, &[0.0, 0.04, 0.12, 0.16]);
    // Frames between two parts are decoded, but not shown.
    let parts = with(&[(80, 0, one), (80, 5 * step, one)]).read().unwrap();
    let shown: Vec<_> = [0, 1, 5, 6].map(|i| FRAMES[i].picture.clone()).into();
    assert!(parts.iter().map(|frame| &frame.picture).eq(&shown));
    // A frame that stands still is one frame; 333 ms are 8.3 frames; 121 ms three, and a quarter of a frame less by rounding.
    same(&with(&[(500, 2 * step + 7, 0)]).read().unwrap(), 2, &[0.0]);
    for (edits, why) in [
        (
            vec![(80, 2 * step, one), (200, 0, one)],
            "shows a part again",
        ),
        (
            vec![(80, 0, (-1_i32 << 16).cast_unsigned())],
            "shows a part backwards",
        ),
        (vec![(80, 100 * step, one)], "shows no frame"),
        (vec![(80, -1, one)], "shows no frame"),
    ] {
        let message = with(&edits).refused();
        assert!(
            message.contains(why) && message.contains("ffmpeg -i IN"),
            "{message}"
        );
    }
}

/// 20 frames of 512 units at 15,360 Hz are 666.7 ms: written as 667, they are still 20.
#[test]
fn a_length_rounded_to_milliseconds_shows_no_frame_more() {
    let sample = |i: i64| Sample {
        offset: 0,
        size: 1,
        decoded: 512 * i,
        duration: 512,
        shown: 1024 + 512 * i,
        description: 0,
        place: None,
    };
    for (length, start, expected) in [
        (667, 0, 20),
        (666, 0, 20),
        (700, 0, 21),
        (667, 5, 20),
        (0, 12, 28),
    ] {
        let mut samples: Vec<Sample> = (0..40).map(sample).collect();
        let edit = Edit {
            duration: length,
            start: Some(1024 + 512 * start),
            rate: 1.0,
        };
        let times_s = place(&mut samples, &[edit], 1000.0, 15_360.0)
            .map_err(|_| "")
            .unwrap();
        assert_eq!(times_s.len(), expected, "{length}");
        assert_eq!(samples[start as usize].place, Some(0));
    }
}

#[test]
fn frames_keep_their_own_times() {
    let durations: Vec<u32> = [1, 3, 2, 1, 5, 1, 1, 4, 1].map(|n| n * STEP).into();
    let times_s = [0.0, 0.04, 0.16, 0.24, 0.28, 0.48, 0.52, 0.56, 0.72];
    let table = Boxing {
        durations,
        ..plain()
    };
    same(&table.read().unwrap(), 0, &times_s);
    let fragmented = Boxing {
        fragments: vec![4, 1, 4],
        ..table
    };
    same(&fragmented.read().unwrap(), 0, &times_s);
}

#[test]
fn a_fragmented_clip_that_is_cut_off_is_read_to_its_last_whole_fragment() {
    let boxing = Boxing {
        fragments: vec![4, 3, 2],
        ..plain()
    };
    let bytes = boxing.bytes();
    let cut = &bytes[..bytes.len() - 16 - 10];
    let file = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(file.path(), cut).unwrap();
    same(&super::read(file.path()).unwrap(), 0, &even_s(8));
    let clip = Clip::open(file.path(), 30.0).unwrap();
    let told = clip.warnings()[0].to_string();
    assert!(told.contains("'mdat' box goes on after the end"), "{told}");
}

#[test]
fn a_segment_without_its_index_is_named() {
    let bytes = Boxing {
        fragments: vec![4, 5],
        ..plain()
    }
    .bytes();
    let moof = find(&bytes, b"moof") - 4;
    let segment = [boxed(b"styp", b"msdh\0\0\0\0"), bytes[moof..].to_vec()].concat();
    let message = read_bytes(&segment).unwrap_err().to_string();
    assert!(
        message.contains("a segment of a stream") && message.contains("cat INIT.mp4"),
        "{message}"
    );
    // With its first part before it, it is a clip.
    let joined = [&bytes[..moof], &segment].concat();
    same(&read_bytes(&joined).unwrap(), 0, &even_s(COUNT));
}

#[test]
fn parameter_sets_may_stand_in_the_frames() {
    for fragments in [vec![], vec![5, 4]] {
        let boxing = Boxing {
            in_band: true,
            kind: *b"avc3",
            brand: *b"qt  ",
            fragments,
            ..plain()
        };
        same(&boxing.read().unwrap(), 0, &even_s(COUNT));
    }
}

#[test]
fn a_clean_aperture_cuts_the_picture() {
    // 40 × 30 of 66 × 50, its middle 2 px right of and 3 px above the picture's.
    let clap = u32s(&[40, 1, 30, 1, 2, 1, (-3_i32).cast_unsigned(), 1]);
    let found = Boxing {
        more: boxed(b"clap", &clap),
        ..plain()
    }
    .read()
    .unwrap();
    let expected = image::imageops::crop_imm(&FRAMES[4].picture, 15, 7, 40, 30).to_image();
    assert!(found[4].picture == expected);
    let outside = u32s(&[40, 1, 30, 1, 20, 1, 0, 1]);
    let message = Boxing {
        more: boxed(b"clap", &outside),
        ..plain()
    }
    .refused();
    assert!(message.contains("clean aperture"), "{message}");
}

/// Against the definition of each matrix: red of full strength.
#[test]
fn colours_are_of_the_matrix_and_range_that_are_said() {
    for (matrix, full, [y, u, v]) in [
        (Some(6), false, [81, 90, 240]),
        (Some(1), false, [63, 102, 240]),
        (Some(9), false, [74, 97, 240]),
        (Some(6), true, [76, 85, 255]),
        (Some(1), true, [54, 99, 255]),
    ] {
        let mut frame = yuv_of(&RgbImage::from_pixel(2, 2, Rgb([0; 3])));
        frame.y.fill(y);
        frame.u.fill(u);
        frame.v.fill(v);
        let colours = Colours::of(matrix, full).unwrap();
        let [r, g, b] = rgb_of(&frame, colours).get_pixel(0, 0).0;
        assert!(
            r >= 252 && g <= 3 && b <= 3,
            "{matrix:?} {full}: {r} {g} {b}"
        );
    }
    for matrix in [0, 8, 10] {
        assert_eq!(Colours::of(Some(matrix), false), None);
    }
    let nclx = |matrix: u16, full: u8| {
        let mut colr = b"nclx\0\x01\0\x01".to_vec();
        colr.extend(matrix.to_be_bytes());
        colr.push(full);
        boxed(b"colr", &colr)
    };
    let with = |more: Vec<u8>| Boxing { more, ..plain() };
    let other = with(nclx(1, 0x80)).read().unwrap();
    assert!(other[0].picture != FRAMES[0].picture);
    assert!(with(nclx(6, 0)).read().unwrap()[0].picture == FRAMES[0].picture);
    let message = with(nclx(0, 0)).refused();
    assert!(message.contains("matrix 0 of ITU-T H.273"), "{message}");
}

#[test]
fn what_is_taken_as_it_is_is_told() {
    let with = |more: Vec<u8>| Boxing { more, ..plain() }.warned().join("\n");
    assert_eq!(with(Vec::new()), "");
    assert_eq!(with(boxed(b"pasp", &u32s(&[1, 1]))), "");
    let wide = with(boxed(b"pasp", &u32s(&[4, 3])));
    assert!(
        wide.contains("a pixel is 4 wide and 3 high") && wide.contains("setsar=1"),
        "{wide}"
    );
    let fields = with(boxed(b"fiel", &[2, 9]));
    assert!(fields.contains("two fields (interlaced)"), "{fields}");
    assert_eq!(with(boxed(b"fiel", &[1, 0])), "");
    let pq = with(boxed(b"colr", b"nclx\0\x01\0\x10\0\x01\0"));
    assert!(pq.contains("(PQ)"), "{pq}");
}

#[test]
fn other_codings_are_refused_by_name_with_the_mend() {
    for (kind, name) in [
        (b"hvc1", "H.265 (HEVC)"),
        (b"hev1", "H.265 (HEVC)"),
        (b"av01", "AV1"),
        (b"vp09", "VP8 or VP9"),
        (b"mp4v", "MPEG-4 Part 2"),
        (b"jpeg", "Motion JPEG"),
        (b"mjpa", "Motion JPEG"),
        (b"apch", "ProRes"),
        (b"zzzz", "of another kind"),
    ] {
        for fragments in [vec![], vec![COUNT]] {
            let message = Boxing {
                kind: *kind,
                fragments,
                ..plain()
            }
            .refused();
            let shown = format!(
                "its video is {name} ('{}'), not H.264",
                String::from_utf8_lossy(kind)
            );
            assert!(
                message.contains(&shown) && message.contains("ffmpeg -i IN -pix_fmt"),
                "{message}"
            );
        }
    }
    let message = Boxing {
        kind: *b"encv",
        ..plain()
    }
    .refused();
    assert!(message.contains("encrypted"), "{message}");
}

/// Of several video tracks the first of H.264 is read that is enabled; a still picture before it is none.
#[test]
fn the_track_of_video_is_found_among_others() {
    let mut hdlr = u32s(&[0, 0]);
    hdlr.extend(b"vide\0\0\0\0\0\0\0\0\0\0\0\0\0");
    let mut mdhd = vec![0; 24];
    mdhd[15] = 1;
    let stsd = boxed(b"stsd", &[u32s(&[0, 1]), boxed(b"jpeg", &[0; 78])].concat());
    let mdia = [
        boxed(b"mdhd", &mdhd),
        boxed(b"hdlr", &hdlr),
        boxed(b"minf", &boxed(b"stbl", &stsd)),
    ];
    for flags in [2, 3] {
        let cover = [
            boxed(b"tkhd", &u32s(&[flags; 21])),
            boxed(b"mdia", &mdia.concat()),
        ];
        let boxing = Boxing {
            before: boxed(b"trak", &cover.concat()),
            ..plain()
        };
        same(&boxing.read().unwrap(), 0, &even_s(COUNT));
        assert!(boxing.warned()[0].contains("it holds 2 video tracks"));
    }
}

/// A set with a crop at its left and top and usability information, written bit by bit.
#[test]
fn a_parameter_set_is_read_to_its_colours() {
    let mut bits = String::new();
    let ue = |n: u32| {
        let code = format!("{:b}", n + 1);
        "0".repeat(code.len() - 1) + &code
    };
    bits += "010000100000000000011111"; // Profile 66, level 31.
    for n in [0, 0, 2] {
        bits += &ue(n);
    }
    bits += &(ue(1) + "0" + &ue(4) + &ue(3) + "1" + "1");
    bits += &("1".to_owned() + &ue(3) + &ue(1) + &ue(2) + &ue(0));
    bits += "1"; // Usability: an aspect of 16:11, video of full range, BT.709.
    bits += &("1".to_owned()
        + "00000100"
        + "0"
        + "1"
        + "101"
        + "1"
        + "1"
        + "00000001"
        + "00000001"
        + "00000001");
    bits += "1";
    while !bits.len().is_multiple_of(8) {
        bits += "0";
    }
    let mut unit = vec![0x67];
    unit.extend(
        (0..bits.len() / 8).map(|i| u8::from_str_radix(&bits[8 * i..8 * i + 8], 2).unwrap()),
    );
    let expected = Stated {
        corner_px: [6, 4],
        aspect: Some([16, 11]),
        full_range: Some(true),
        transfer: Some(1),
        matrix: Some(1),
    };
    assert_eq!(stated(&unit), Some(expected));
    assert_eq!(stated(&unit[..4]), None);
    assert_eq!(stated(&[0x68, 0xff]), None);
}

fn boxing() -> impl Strategy<Value = Boxing> {
    let base = prop_oneof![Just(Base::Moof), Just(Base::Absolute), Just(Base::Implied)];
    let cuts = prop::collection::vec(1_usize..4, 0..6);
    let flags = any::<[bool; 4]>();
    let step = prop::collection::vec(1_u32..5, COUNT);
    (base, cuts, flags, step, 0_i32..3).prop_map(|(base, cuts, flags, steps, late)| {
        let [fragmented, long, index_first, quick] = flags;
        let mut fragments = Vec::new();
        if fragmented {
            let mut left = COUNT;
            for cut in cuts {
                let count = cut.min(left);
                fragments.extend((count > 0).then_some(count));
                left -= count;
            }
            fragments.extend((left > 0).then_some(left));
        }
        Boxing {
            fragments,
            base,
            long,
            index_first,
            durations: steps.iter().map(|step| step * STEP).collect(),
            shifts: vec![late * STEP as i32; COUNT],
            brand: if quick { *b"qt  " } else { *b"isom" },
            ..plain()
        }
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// The same frames in other boxes are the same clip.
    #[test]
    fn a_clip_in_other_boxes_is_the_same_clip(boxing in boxing()) {
        let mut times_s = vec![0.0];
        for duration in &boxing.durations[..COUNT - 1] {
            times_s.push(times_s.last().unwrap() + f64::from(*duration) / f64::from(TRACK_HZ));
        }
        same(&boxing.read().unwrap(), 0, &times_s);
    }

    /// An edit list shows what a cut of the frames does.
    #[test]
    fn an_edit_list_is_a_cut(boxing in boxing(), first in 0..COUNT, count in 1..COUNT) {
        let count = count.min(COUNT - first);
        let begins = |i: usize| boxing.durations[..i].iter().sum::<u32>();
        let start = i64::from(begins(first)) + i64::from(boxing.shifts[0]);
        // All times are whole milliseconds.
        let length = u64::from(begins(first + count) - begins(first)) * u64::from(MOVIE_HZ) / u64::from(TRACK_HZ);
        let edits = vec![(length, start, 1 << 16)];
        let times_s: Vec<f64> = (first..first + count)
            .map(|i| f64::from(begins(i) - begins(first)) / f64::from(TRACK_HZ))
            .collect();
        same(&Boxing { edits, ..boxing }.read().unwrap(), first, &times_s);
    }

    /// Damage anywhere in a fragmented file is read or refused.
    #[test]
    fn any_damage_to_fragments_is_read_or_refused(
        boxing in boxing(),
        at in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        cut in any::<prop::sample::Index>(),
        cuts in any::<bool>(),
    ) {
        let mut bytes = Boxing { edits: vec![(120, 0, 1 << 16)], ..boxing }.bytes();
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
