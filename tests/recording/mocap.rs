//! Writes C3D files of every kind, right and wrong, for the tests of the importer and as seeds for fuzzing.

/// How a make of computer writes numbers.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Make {
    Intel,
    Dec,
    Sgi,
}

impl Make {
    fn u16(self, v: u16) -> [u8; 2] {
        if self == Make::Sgi {
            v.to_be_bytes()
        } else {
            v.to_le_bytes()
        }
    }

    pub fn f32(self, v: f32) -> [u8; 4] {
        match self {
            Make::Intel => v.to_le_bytes(),
            Make::Sgi => v.to_be_bytes(),
            Make::Dec => {
                let b = (v * 4.0).to_le_bytes();
                [b[2], b[3], b[0], b[1]]
            }
        }
    }
}

/// A value of the parameter section.
pub enum Value {
    Text(Vec<&'static str>),
    Texts(Vec<String>),
    Words(Vec<i16>),
    Floats(Vec<f32>),
    Empty,
}

/// A C3D file to be.
pub struct C3dFile {
    pub make: Make,
    /// < 0: floats, in units; > 0: whole numbers times this.
    pub scale: f32,
    pub points: u16,
    pub channels: u16,
    pub per_frame: u16,
    pub first: u16,
    pub last: u16,
    pub rate: f32,
    pub parameter_block: u8,
    /// Group, name, value. Groups are written after their parameters where `groups_last`.
    pub parameters: Vec<(&'static str, &'static str, Value)>,
    pub groups_last: bool,
    pub padded: bool,
    /// x, y, z, w of every point of every frame, in the units of the file; what is missing is 0.
    pub xyzw: Vec<[f32; 4]>,
    /// Raw analog values.
    pub analog: Vec<f32>,
}

impl Default for C3dFile {
    fn default() -> Self {
        C3dFile {
            make: Make::Intel,
            scale: -0.1,
            points: 2,
            channels: 0,
            per_frame: 1,
            first: 1,
            last: 3,
            rate: 100.0,
            parameter_block: 2,
            parameters: vec![
                ("POINT", "LABELS", Value::Text(vec!["EE", "Base"])),
                ("POINT", "UNITS", Value::Text(vec!["mm"])),
            ],
            groups_last: false,
            padded: true,
            xyzw: (0..6)
                .map(|i| [i as f32, 10.0 + i as f32, -0.5, 0.0])
                .collect(),
            analog: Vec::new(),
        }
    }
}

impl C3dFile {
    pub fn bytes(&self) -> Vec<u8> {
        let m = self.make;
        let mut names: Vec<&str> = self.parameters.iter().map(|p| p.0).collect();
        names.sort_unstable();
        names.dedup();
        let id = |group: &str| names.iter().position(|n| *n == group).unwrap() as i8 + 1;
        let mut groups = Vec::new();
        for name in &names {
            groups.push(name.len() as u8);
            groups.push((-id(name)).cast_unsigned());
            groups.extend(name.bytes());
            groups.extend(m.u16(3));
            groups.push(0);
        }
        let mut values = Vec::new();
        for (group, name, value) in &self.parameters {
            let (kind, dimensions, bytes): (i8, Vec<u8>, Vec<u8>) = match value {
                Value::Text(list) => {
                    text(&list.iter().map(|s| (*s).to_owned()).collect::<Vec<_>>())
                }
                Value::Texts(list) => text(list),
                Value::Words(list) => (
                    2,
                    vec![list.len() as u8],
                    list.iter().flat_map(|v| m.u16(v.cast_unsigned())).collect(),
                ),
                Value::Floats(list) => (
                    4,
                    vec![list.len() as u8],
                    list.iter().flat_map(|v| m.f32(*v)).collect(),
                ),
                Value::Empty => (-1, vec![0, 3], Vec::new()),
            };
            values.push(name.len() as u8);
            values.push(id(group).cast_unsigned());
            values.extend(name.bytes());
            let length = 2 + 2 + dimensions.len() + bytes.len() + 1;
            values.extend(m.u16(length as u16));
            values.push(kind.cast_unsigned());
            values.push(dimensions.len() as u8);
            values.extend(dimensions);
            values.extend(bytes);
            values.push(0);
        }
        let processor = [84, 85, 86][m as usize];
        let mut section = vec![1, 80, 0, processor];
        let parts = if self.groups_last {
            [values, groups]
        } else {
            [groups, values]
        };
        parts.iter().for_each(|p| section.extend(p));
        section.extend([0, 0]);
        section.resize(section.len().next_multiple_of(512), 0);
        section[2] = (section.len() / 512) as u8;
        let start = usize::from(self.parameter_block) - 1;
        let data_block = start + section.len() / 512 + 1;

        let mut file = vec![0; start.max(1) * 512];
        file[0] = self.parameter_block;
        file[1] = 0x50;
        for (word, value) in [
            (2, self.points),
            (3, self.channels * self.per_frame),
            (4, self.first),
            (5, self.last),
            (9, data_block as u16),
            (10, self.per_frame),
        ] {
            file[2 * word - 2..2 * word].copy_from_slice(&m.u16(value));
        }
        file[12..16].copy_from_slice(&m.f32(self.scale));
        file[20..24].copy_from_slice(&m.f32(self.rate));
        file.extend(section);

        let frames = usize::from(self.last.saturating_sub(self.first)) + 1;
        let points = usize::from(self.points);
        let analog = usize::from(self.channels) * usize::from(self.per_frame);
        let frames = frames
            .max(self.xyzw.len().checked_div(points).unwrap_or(0))
            .max(self.analog.len().checked_div(analog).unwrap_or(0));
        for f in 0..frames {
            for p in 0..points {
                let [x, y, z, w] = self.xyzw.get(f * points + p).copied().unwrap_or_default();
                for (k, v) in [x, y, z, w].into_iter().enumerate() {
                    let scale = if k < 3 { self.scale } else { 1.0 };
                    self.number(if self.scale > 0.0 { v / scale } else { v }, &mut file);
                }
            }
            for a in 0..analog {
                self.number(
                    self.analog.get(f * analog + a).copied().unwrap_or(0.0),
                    &mut file,
                );
            }
        }
        if self.padded {
            file.resize(file.len().next_multiple_of(512), 0);
        }
        file
    }

    fn number(&self, v: f32, file: &mut Vec<u8>) {
        if self.scale > 0.0 {
            // 40000 is an unsigned raw value
            file.extend(self.make.u16((v.round() as i32 & 0xffff) as u16));
        } else {
            file.extend(self.make.f32(v));
        }
    }
}

fn text(list: &[String]) -> (i8, Vec<u8>, Vec<u8>) {
    let longest = list.iter().map(String::len).max().unwrap_or(0);
    let bytes = list
        .iter()
        .flat_map(|s| {
            let mut b = s.clone().into_bytes();
            b.resize(longest, b' ');
            b
        })
        .collect();
    (-1, vec![longest as u8, list.len() as u8], bytes)
}
