//! Aligned recording, prediction and residual as arrays: CSV, MATLAB (`.mat`, level 5) and NumPy (`.npz`).
//!
//! One array a column, all as long as the recording, in the units that the names end in; NaN where there is
//! no value. The residual is predicted minus command. The same input gives the same bytes: no date is
//! written.

use std::io::{self, Write};

use crate::calibration::RecordingOutcome;
use crate::dataset::Dataset;
use crate::report::csv::{Missing, missing};

/// Kinds of array files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ArrayFormat {
    /// Comma-separated, every digit.
    Csv,
    /// MATLAB level 5.
    Mat,
    /// NumPy, uncompressed.
    Npz,
}

impl ArrayFormat {
    /// By the extension of a file.
    #[must_use]
    pub fn of_extension(extension: &str) -> Option<Self> {
        match extension.to_ascii_lowercase().as_str() {
            "csv" => Some(ArrayFormat::Csv),
            "mat" => Some(ArrayFormat::Mat),
            "npz" => Some(ArrayFormat::Npz),
            _ => None,
        }
    }
}

/// Named columns of one length.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Arrays {
    columns: Vec<(String, Vec<f64>)>,
}

impl Arrays {
    /// The aligned recording; with an `outcome` of it its prediction and residual, and its clock offset.
    #[must_use]
    pub fn of(d: &Dataset, outcome: Option<&RecordingOutcome>) -> Self {
        let n = d.samples();
        let offset_s = outcome.map_or(d.offset_s, |r| r.offset_s);
        let mut out = Arrays::default();
        let three = |out: &mut Arrays, names: [&str; 3], f: &dyn Fn(usize) -> [f64; 3]| {
            let rows: Vec<[f64; 3]> = (0..n).map(f).collect();
            for (k, name) in names.iter().enumerate() {
                let column = rows.iter().map(|r| r[k]).collect();
                out.columns.push(((*name).to_owned(), column));
            }
        };
        out.columns
            .push(("time_s".into(), (0..n).map(|i| d.time_s(i)).collect()));
        three(&mut out, ["x_raw_mm", "y_raw_mm", "z_raw_mm"], &|i| {
            d.measured_m[i].map(|v| v * 1e3)
        });
        let smooth = |i: usize, v: [f64; 3]| if d.usable[i] { v } else { [f64::NAN; 3] };
        three(&mut out, ["x_mm", "y_mm", "z_mm"], &|i| {
            smooth(i, [0, 1, 2].map(|k| d.axes[k].position[i] * 1e3))
        });
        three(&mut out, ["vx_mm_s", "vy_mm_s", "vz_mm_s"], &|i| {
            smooth(i, [0, 1, 2].map(|k| d.axes[k].velocity[i] * 1e3))
        });
        three(&mut out, ["ax_mm_s2", "ay_mm_s2", "az_mm_s2"], &|i| {
            smooth(i, [0, 1, 2].map(|k| d.axes[k].acceleration[i] * 1e3))
        });
        three(
            &mut out,
            ["phi1_V", "phi2_V", "phi3_V"],
            &|i| match d.has_voltage(i, offset_s) {
                true => [0, 1, 2].map(|k| d.command_v(k, i, offset_s)),
                false => [f64::NAN; 3],
            },
        );
        if let Some(m) = &d.monitor {
            let (first, last) = m.span_s();
            let names = ["phi1_monitor_V", "phi2_monitor_V", "phi3_monitor_V"];
            three(&mut out, names, &|i| {
                let t = d.time_s(i) + offset_s;
                match (first..=last).contains(&t) {
                    true => [0, 1, 2].map(|k| m.at(k, t)),
                    false => [f64::NAN; 3],
                }
            });
        }
        if let Some(r) = outcome {
            let flags = missing(r);
            let value = |i: usize| match &flags[i] {
                None => r.predicted_v[i],
                Some(Missing::Negative(chains)) => [0, 1, 2].map(|k| {
                    if chains.contains(&(k + 1)) {
                        f64::NAN
                    } else {
                        r.predicted_v[i][k]
                    }
                }),
                Some(_) => [f64::NAN; 3],
            };
            let names = ["phi1_predicted_V", "phi2_predicted_V", "phi3_predicted_V"];
            three(&mut out, names, &value);
            let names = ["phi1_residual_V", "phi2_residual_V", "phi3_residual_V"];
            three(&mut out, names, &|i| {
                let v = value(i);
                [0, 1, 2].map(|k| v[k] - r.command_v[i][k])
            });
        }
        let payload = d.payload_kg.iter().map(|m| m * 1e3).collect();
        out.columns.push(("payload_g".into(), payload));
        let flag = |f: &dyn Fn(usize) -> bool| (0..n).map(|i| f64::from(u8::from(f(i)))).collect();
        out.columns
            .push(("captured".into(), flag(&|i| d.captured(i))));
        out.columns.push(("usable".into(), flag(&|i| d.usable[i])));
        out
    }

    /// The columns: name and values.
    #[must_use]
    pub fn columns(&self) -> &[(String, Vec<f64>)] {
        &self.columns
    }

    /// Writes them in a format.
    ///
    /// # Errors
    /// Those of the writer; more than 4 GiB in one array.
    pub fn write(&self, format: ArrayFormat, out: &mut dyn Write) -> io::Result<()> {
        match format {
            ArrayFormat::Csv => self.csv(out),
            ArrayFormat::Mat => self.mat(out),
            ArrayFormat::Npz => self.npz(out),
        }
    }

    fn rows(&self) -> usize {
        self.columns.first().map_or(0, |c| c.1.len())
    }

    fn csv(&self, out: &mut dyn Write) -> io::Result<()> {
        let names: Vec<&str> = self.columns.iter().map(|c| c.0.as_str()).collect();
        writeln!(out, "{}", names.join(","))?;
        for i in 0..self.rows() {
            for (k, (_, values)) in self.columns.iter().enumerate() {
                if k > 0 {
                    out.write_all(b",")?;
                }
                if !values[i].is_nan() {
                    // the shortest text that reads back to the same bits
                    write!(out, "{}", values[i])?;
                }
            }
            out.write_all(b"\n")?;
        }
        Ok(())
    }

    /// ```text
    /// file     := header (128 bytes) variable*
    /// variable := tag(14, size) flags tag(6) dimensions tag(5) name tag(1) values tag(9)
    /// ```
    fn mat(&self, out: &mut dyn Write) -> io::Result<()> {
        let mut header = [b' '; 128];
        let text = concat!(
            "MATLAB 5.0 MAT-file, written by deacal ",
            env!("CARGO_PKG_VERSION")
        );
        header[..text.len()].copy_from_slice(text.as_bytes());
        header[116..124].fill(0);
        header[124..].copy_from_slice(&[0, 1, b'I', b'M']);
        out.write_all(&header)?;
        for (name, values) in &self.columns {
            let bytes = size32(values.len() as u64 * 8)?;
            let mut name_padded = name.clone().into_bytes();
            let name_size = size32(name_padded.len() as u64)?;
            name_padded.resize(name_padded.len().next_multiple_of(8), 0);
            let whole = 16 + 16 + 8 + name_padded.len() as u64 + 8 + u64::from(bytes);
            let mut words: Vec<u32> = vec![14, size32(whole)?];
            // class double; real; column vector
            words.extend([6, 8, 6, 0]);
            words.extend([5, 8, size32(values.len() as u64)?, 1]);
            words.extend([1, name_size]);
            for w in &words {
                out.write_all(&w.to_le_bytes())?;
            }
            out.write_all(&name_padded)?;
            out.write_all(&9u32.to_le_bytes())?;
            out.write_all(&bytes.to_le_bytes())?;
            for v in values {
                out.write_all(&v.to_le_bytes())?;
            }
        }
        Ok(())
    }

    /// A zip archive of one `.npy` a column, stored.
    fn npz(&self, out: &mut dyn Write) -> io::Result<()> {
        let mut directory = Vec::new();
        let mut at = 0u64;
        for (name, values) in &self.columns {
            let mut body = b"\x93NUMPY\x01\x00".to_vec();
            let mut head = format!(
                "{{'descr': '<f8', 'fortran_order': False, 'shape': ({},), }}",
                values.len()
            );
            // the head ends with a newline at a multiple of 64
            while (10 + head.len() + 1) % 64 != 0 {
                head.push(' ');
            }
            head.push('\n');
            body.extend((head.len() as u16).to_le_bytes());
            body.extend(head.as_bytes());
            body.extend(values.iter().flat_map(|v| v.to_le_bytes()));
            let file = format!("{name}.npy");
            let size = size32(body.len() as u64)?;
            // version 2.0, no flags, stored, 1980-01-01
            let mut common = Vec::new();
            for v in [20u16, 0, 0, 0, 0x21] {
                common.extend(v.to_le_bytes());
            }
            common.extend(crc32fast::hash(&body).to_le_bytes());
            common.extend(size.to_le_bytes());
            common.extend(size.to_le_bytes());
            common.extend((file.len() as u16).to_le_bytes());
            common.extend(0u16.to_le_bytes());
            out.write_all(b"PK\x03\x04")?;
            out.write_all(&common)?;
            out.write_all(file.as_bytes())?;
            out.write_all(&body)?;
            directory.extend(b"PK\x01\x02");
            directory.extend(20u16.to_le_bytes());
            directory.extend(&common);
            // comment, disk, attributes
            directory.extend([0; 10]);
            directory.extend(size32(at)?.to_le_bytes());
            directory.extend(file.as_bytes());
            at += 4 + common.len() as u64 + file.len() as u64 + u64::from(size);
        }
        out.write_all(&directory)?;
        out.write_all(b"PK\x05\x06")?;
        out.write_all(&[0; 4])?;
        let count = (self.columns.len() as u16).to_le_bytes();
        out.write_all(&count)?;
        out.write_all(&count)?;
        out.write_all(&size32(directory.len() as u64)?.to_le_bytes())?;
        out.write_all(&size32(at)?.to_le_bytes())?;
        out.write_all(&[0; 2])
    }
}

fn size32(size: u64) -> io::Result<u32> {
    u32::try_from(size).map_err(|_| io::Error::other("an array is larger than 4 GiB"))
}
