//! Clips out: H.264 in MP4 files.

use super::colour::yuv_of;
use super::error::VideoError;
use image::RgbImage;
use rusty_h264_common::nal::split_annex_b;
use rusty_h264_encoder::{Encoder, EncoderConfig, Preset};
use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Units of time a second in files that are written [Hz].
const TIMESCALE: u32 = 90_000;

/// Writes H.264 into an MP4 file that browsers play.
pub struct Writer {
    path: PathBuf,
    file: BufWriter<File>,
    encoder: Encoder,
    size_px: [u32; 2],
    /// Parameter sets: those of the sequence, those of the picture.
    sets: [Vec<u8>; 2],
    /// Size of every frame [byte], and whether it needs no other.
    samples: Vec<(u32, bool)>,
}

/// Bytes before the first frame: `ftyp` and the long head of `mdat`.
pub(super) const HEAD: [u8; 40] =
    *b"\0\0\0\x18ftypisom\0\0\x02\0isomavc1\0\0\0\x01mdat\0\0\0\0\0\0\0\0";

impl Writer {
    /// Begins a file for pictures of `size_px` at `rate_hz`; an odd last row or column is left out.
    pub fn create(path: &Path, size_px: [u32; 2], rate_hz: f64) -> Result<Self, VideoError> {
        let wrong = |why: String| VideoError::Write {
            path: path.into(),
            why,
        };
        let even = size_px.map(|side| side & !1);
        let [width, height] = even.map(|side| side as usize);
        let blocks = width.div_ceil(16) * height.div_ceil(16);
        // Baseline, one reference, no reordering: every player takes it.
        let mut config = EncoderConfig::baseline(width, height);
        config.preset = Preset::Balanced;
        config.qp = 22;
        config.gop_size = 60;
        config.framerate = rate_hz as f32;
        // Table A-1: levels 3.1, 4.0, 5.1 by macroblocks a frame.
        config.level_idc = match blocks {
            0..=3_600 => 31,
            3_601..=8_192 => 40,
            _ => 51,
        };
        let encoder = Encoder::new(config).map_err(|error| wrong(error.to_string()))?;
        let file = File::create(path).map_err(|error| wrong(error.to_string()))?;
        let mut file = BufWriter::new(file);
        (file.write_all(&HEAD)).map_err(|error| wrong(error.to_string()))?;
        Ok(Self {
            path: path.into(),
            file,
            encoder,
            size_px: even,
            sets: [Vec::new(), Vec::new()],
            samples: Vec::new(),
        })
    }

    /// Appends a picture of the size given first.
    pub fn push(&mut self, picture: &RgbImage) -> Result<(), VideoError> {
        let coded = (self.encoder)
            .try_encode(&yuv_of(picture))
            .map_err(|error| self.wrong(error.to_string()))?;
        let mut sample = Vec::with_capacity(coded.len());
        let mut whole = false;
        for unit in split_annex_b(&coded) {
            match unit.first().map_or(0, |head| head & 0x1f) {
                7 => self.sets[0] = unit.to_vec(),
                8 => self.sets[1] = unit.to_vec(),
                kind => {
                    whole |= kind == 5;
                    sample.extend((unit.len() as u32).to_be_bytes());
                    sample.extend(unit);
                }
            }
        }
        (self.file.write_all(&sample)).map_err(|error| self.wrong(error.to_string()))?;
        self.samples.push((sample.len() as u32, whole));
        Ok(())
    }

    /// Writes the tables, for frames that follow each other at `rate_hz` [Hz], and closes the file.
    pub fn finish(mut self, rate_hz: f64) -> Result<(), VideoError> {
        let tables = self.tables(rate_hz);
        let data: u64 = self.samples.iter().map(|(size, _)| u64::from(*size)).sum();
        let mut write = || {
            self.file.write_all(&tables)?;
            self.file.seek(SeekFrom::Start(32))?;
            self.file.write_all(&(16 + data).to_be_bytes())?;
            self.file.flush()
        };
        write().map_err(|error: io::Error| self.wrong(error.to_string()))
    }

    fn wrong(&self, why: String) -> VideoError {
        VideoError::Write {
            path: self.path.clone(),
            why,
        }
    }

    /// The `moov` box.
    fn tables(&self, rate_hz: f64) -> Vec<u8> {
        let count = self.samples.len() as u32;
        let step = (f64::from(TIMESCALE) / rate_hz).round().max(1.0) as u32;
        let duration = count.saturating_mul(step);
        let [width, height] = self.size_px;
        let [sps, pps] = &self.sets;
        let mut avcc = vec![1];
        avcc.extend(sps.get(1..4).unwrap_or(&[66, 0, 31]));
        avcc.push(0xff);
        for (count, set) in [(0xe1, sps), (1, pps)] {
            avcc.push(count);
            avcc.extend((set.len() as u16).to_be_bytes());
            avcc.extend(set);
        }
        let mut entry = vec![0; 78];
        entry[7] = 1;
        entry[24..26].copy_from_slice(&(width as u16).to_be_bytes());
        entry[26..28].copy_from_slice(&(height as u16).to_be_bytes());
        entry[28..36].copy_from_slice(&[0, 72, 0, 0, 0, 72, 0, 0]);
        entry[41] = 1;
        entry[75] = 24;
        entry[76..78].copy_from_slice(&[0xff, 0xff]);
        entry.extend(boxed(b"avcC", &avcc));
        let table = |numbers: &[u32]| -> Vec<u8> {
            (numbers.iter())
                .flat_map(|number| number.to_be_bytes())
                .collect()
        };
        let matrix = [1 << 16, 0, 0, 0, 1 << 16, 0, 0, 0, 1 << 30];
        let whole: Vec<u32> = (1..=count)
            .zip(&self.samples)
            .filter(|(_, (_, whole))| *whole)
            .map(|(number, _)| number)
            .collect();
        let sizes: Vec<u32> = self.samples.iter().map(|(size, _)| *size).collect();
        let stbl = [
            boxed(b"stsd", &[table(&[0, 1]), boxed(b"avc1", &entry)].concat()),
            boxed(b"stts", &table(&[0, 1, count, step])),
            boxed(
                b"stss",
                &table(&[&[0, whole.len() as u32][..], &whole].concat()),
            ),
            boxed(b"stsc", &table(&[0, 1, 1, count, 1])),
            boxed(b"stsz", &table(&[&[0, 0, count][..], &sizes].concat())),
            boxed(b"stco", &table(&[0, 1, HEAD.len() as u32])),
        ];
        let dref = boxed(
            b"dref",
            &[table(&[0, 1]), boxed(b"url ", &table(&[1]))].concat(),
        );
        let minf = [
            boxed(b"vmhd", &table(&[1, 0, 0])),
            boxed(b"dinf", &dref),
            boxed(b"stbl", &stbl.concat()),
        ];
        let mut hdlr = table(&[0, 0]);
        hdlr.extend(b"vide\0\0\0\0\0\0\0\0\0\0\0\0\0");
        let mdia = [
            // 0x55c4: the language is undetermined.
            boxed(
                b"mdhd",
                &table(&[0, 0, 0, TIMESCALE, duration, 0x55c4_0000]),
            ),
            boxed(b"hdlr", &hdlr),
            boxed(b"minf", &minf.concat()),
        ];
        let mut tkhd = table(&[3, 0, 0, 1, 0, duration, 0, 0, 0, 0]);
        tkhd.extend(table(&matrix));
        tkhd.extend(table(&[width << 16, height << 16]));
        let trak = [boxed(b"tkhd", &tkhd), boxed(b"mdia", &mdia.concat())];
        let mut mvhd = table(&[0, 0, 0, TIMESCALE, duration, 1 << 16, 1 << 24, 0, 0]);
        mvhd.extend(table(&matrix));
        mvhd.extend(table(&[0, 0, 0, 0, 0, 0, 2]));
        boxed(
            b"moov",
            &[boxed(b"mvhd", &mvhd), boxed(b"trak", &trak.concat())].concat(),
        )
    }
}

/// A box of a kind around its content.
pub(super) fn boxed(kind: &[u8; 4], content: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(8 + content.len());
    out.extend((8 + content.len() as u32).to_be_bytes());
    out.extend(kind);
    out.extend(content);
    out
}
