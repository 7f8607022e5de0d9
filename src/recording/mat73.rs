//! MATLAB files of level 7.3, which are HDF5 with a header of 512 bytes.
//!
//! A variable is a dataset, a structure a group, and the attribute `MATLAB_class` says which. Numbers lie
//! column after column, so that the shape of a dataset is that of the array the other way round. What is in a
//! file is put together as that of level 5 ([`super::mat`]). The crate `hdf5-reader` takes the file apart and
//! holds no more than it is allowed to.

use std::fs::File;
use std::path::Path;
use std::sync::Arc;

use hdf5_reader::group::Group;
use hdf5_reader::storage::FileStorage;
use hdf5_reader::{ByteOrder, Dataset, Datatype, Hdf5File, OpenOptions};

use super::error::{Error, ErrorKind};
use super::mat::{Found, MAX_DEPTH};
use super::tdms::Kind;

/// Whether a file that begins with `head` is of this level.
pub(super) fn recognises(head: &[u8]) -> bool {
    head.starts_with(b"MATLAB 7.") && head.get(512..520) == Some(b"\x89HDF\r\n\x1a\n")
}

/// Variables and fields that a file may have: links that lead in a circle make any number.
const MAX_MEMBERS: usize = 100_000;

/// Reads what is in a file, at most `numbers` numbers.
///
/// # Errors
/// The file is damaged, or holds more.
pub(super) fn read(path: &Path, file: File, numbers: u64) -> Result<Found, Error> {
    let most = usize::try_from(numbers.saturating_mul(8)).unwrap_or(usize::MAX);
    let options = OpenOptions::default().with_max_read_bytes(most);
    let storage = FileStorage::from_file(file).map_err(|e| wrong(path, "", &e))?;
    let root = Hdf5File::from_storage_with_options(Arc::new(storage), options)
        .and_then(|file| file.root_group())
        .map_err(|e| wrong(path, "", &e))?;
    let mut found = Found::new(numbers);
    Walk {
        path,
        found: &mut found,
        left: MAX_MEMBERS,
    }
    .group(&root, "", 0)?;
    Ok(found)
}

fn wrong(path: &Path, name: &str, what: &dyn std::fmt::Display) -> Error {
    let which = match name.is_empty() {
        true => "the file".to_owned(),
        false => format!("the variable {name}"),
    };
    Error::new(
        ErrorKind::Grammar,
        path,
        format!("{which} is damaged: {what}"),
    )
    .action("copy the file again, or save it again in MATLAB with save('run.mat', '-v7')")
}

struct Walk<'a> {
    path: &'a Path,
    found: &'a mut Found,
    left: usize,
}

impl Walk<'_> {
    /// The variables of a file, or the fields of a structure.
    fn group(&mut self, group: &Group, inside: &str, depth: usize) -> Result<(), Error> {
        if depth > MAX_DEPTH {
            return Err(wrong(
                self.path,
                inside,
                &"structures stand in each other without an end",
            ));
        }
        let (groups, arrays) = group.members().map_err(|e| wrong(self.path, inside, &e))?;
        self.left = self
            .left
            .checked_sub(groups.len() + arrays.len())
            .ok_or_else(|| wrong(self.path, inside, &"it has variables without an end"))?;
        let called = |full: &str| {
            let own = full.rsplit('/').next().unwrap_or_default();
            match inside {
                "" => own.to_owned(),
                _ => format!("{inside}.{own}"),
            }
        };
        for array in &arrays {
            self.array(array, &called(array.name()))?;
        }
        for inner in &groups {
            let name = called(inner.name());
            // what MATLAB keeps for cells and objects
            if name.starts_with('#') {
                continue;
            }
            if inner.attribute("MATLAB_sparse").is_ok() {
                self.found.others.push((name, "sparse"));
                continue;
            }
            self.group(inner, &name, depth + 1)?;
        }
        Ok(())
    }

    fn array(&mut self, array: &Dataset, name: &str) -> Result<(), Error> {
        let class = array
            .attribute("MATLAB_class")
            .and_then(|a| a.read_string())
            .unwrap_or_default();
        let mut other = |why| self.found.others.push((name.to_owned(), why));
        if array.attribute("MATLAB_object_decode").is_ok() {
            self.found.objects.push((name.to_owned(), class));
            return Ok(());
        }
        if array.attribute("MATLAB_empty").is_ok() {
            other("empty");
            return Ok(());
        }
        let number = match array.dtype() {
            _ if class == "char" => Err("text"),
            Datatype::Reference { .. } if class == "cell" => Err("a cell array"),
            Datatype::Reference { .. } => Err("of an array of structures"),
            Datatype::Compound { .. } => Err("complex"),
            other => kind(other).ok_or("no number"),
        };
        let (kind, big) = match number {
            Ok(number) => number,
            Err(why) => {
                other(why);
                return Ok(());
            }
        };
        let sizes: Vec<u64> = match array.shape() {
            [] => vec![1, 1],
            [length] => vec![*length, 1],
            shape => shape.iter().rev().copied().collect(),
        };
        if sizes.len() != 2 {
            other("of three and more dimensions");
            return Ok(());
        }
        let count = sizes[0].checked_mul(sizes[1]);
        self.found.numbers_left = count
            .and_then(|count| self.found.numbers_left.checked_sub(count))
            .ok_or_else(|| super::mat::too_many(self.path, name))?;
        let bytes = array
            .read_raw_bytes()
            .map_err(|e| wrong(self.path, name, &e))?;
        let each = usize::try_from(kind.size()).unwrap_or(1);
        let values = bytes
            .chunks_exact(each)
            .map(|b| kind.value(b, big))
            .collect();
        self.found.keep(name, &sizes, values);
        Ok(())
    }
}

/// How the numbers of a dataset are kept, and whether their bytes are the other way round.
fn kind(datatype: &Datatype) -> Option<(Kind, bool)> {
    let (kind, order) = match datatype {
        Datatype::FixedPoint {
            size,
            signed,
            byte_order,
        } => {
            let kind = match (size, signed) {
                (1, true) => Kind::I8,
                (1, false) => Kind::U8,
                (2, true) => Kind::I16,
                (2, false) => Kind::U16,
                (4, true) => Kind::I32,
                (4, false) => Kind::U32,
                (8, true) => Kind::I64,
                (8, false) => Kind::U64,
                _ => return None,
            };
            (kind, byte_order)
        }
        Datatype::FloatingPoint { size, byte_order } => match size {
            4 => (Kind::F32, byte_order),
            8 => (Kind::F64, byte_order),
            _ => return None,
        },
        Datatype::Enum { base, .. } => return self::kind(base),
        _ => return None,
    };
    Some((kind, matches!(order, ByteOrder::BigEndian)))
}
