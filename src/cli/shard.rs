//! Parts of a campaign: shard i of n, on one machine or many, and the word that they leave of what they are
//! parts of.
//!
//! Each shard is a function of the inputs, the arguments and i. It writes folders of its own, each whole or
//! not at all, beside one `campaign.json`, which all shards of a campaign agree on to the byte: one that does
//! not is of another campaign and is refused.

use std::fs::File;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::Write;
use std::path::Path;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::Failure;
use super::resume::Run;
use crate::report::json::to_text;
use crate::report::output::{HELD, OutputError, Overwrite};

/// Shard `number` of `of`, from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Shard {
    pub number: usize,
    pub of: usize,
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('/');
        let parts = parts.and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match parts {
            Some((number, of)) if (1..=of).contains(&number) => Ok(Shard { number, of }),
            _ => Err("expected i/n with i from 1 to n, as in 3/12".into()),
        }
    }
}

impl std::fmt::Display for Shard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "shard {} of {}", self.number, self.of)
    }
}

impl Shard {
    /// The shard that was asked for, or the one that a task of a Slurm array is.
    pub(super) fn or_slurm(given: Option<Shard>) -> Result<Option<Shard>, Failure> {
        match given {
            Some(shard) => Ok(Some(shard)),
            None => Self::of_array(&|name| std::env::var(name).ok()),
        }
    }

    /// From Slurm's variables. An array counts from its smallest number in its steps; without that word
    /// from 0 or from 1.
    fn of_array(variable: &dyn Fn(&str) -> Option<String>) -> Result<Option<Shard>, Failure> {
        let number = |name: &str| -> Result<Option<usize>, Failure> {
            let Some(text) = variable(&format!("SLURM_ARRAY_TASK_{name}")) else {
                return Ok(None);
            };
            let parsed = text.parse().map(Some);
            parsed.map_err(|_| {
                format!("SLURM_ARRAY_TASK_{name} is `{text}`, no number: give --shard i/n").into()
            })
        };
        let (Some(id), Some(of)) = (number("ID")?, number("COUNT")?) else {
            return Ok(None);
        };
        let step = number("STEP")?.unwrap_or(1).max(1);
        let place = match number("MIN")? {
            Some(min) => id.saturating_sub(min) / step,
            None => (id + of.max(1) - 1) % of.max(1),
        };
        if place >= of {
            return Err(format!(
                "SLURM_ARRAY_TASK_ID {id} is beyond the {of} tasks of an even array: give --shard i/n"
            )
            .into());
        }
        Ok(Some(Shard {
            number: place + 1,
            of,
        }))
    }

    /// Whether part `place` (from 0) is this shard's.
    pub(super) fn has(self, place: usize) -> bool {
        place % self.of == self.number - 1
    }
}

/// What folders are parts of.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Campaign {
    /// `batch` or `prove`.
    pub campaign: String,
    /// The program, to the byte, and what it works on.
    #[serde(flatten)]
    pub run: Run,
    /// Folders of the parts, and what each is of.
    pub parts: Vec<Part>,
}

/// A part of a campaign.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Part {
    /// Its folder.
    pub folder: String,
    /// What it is of.
    pub of: String,
}

/// The file of a campaign.
pub(super) const CAMPAIGN: &str = "campaign.json";

impl Campaign {
    /// The campaign of a folder.
    pub(super) fn read(dir: &Path) -> Result<Self, Failure> {
        let path = dir.join(CAMPAIGN);
        let text = std::fs::read_to_string(&path).map_err(|e| {
            format!(
                "{}: {e}: name the folder that `deacal batch` or `deacal prove --shard` wrote to with -o",
                path.display()
            )
        })?;
        serde_json::from_str(&text).map_err(|e| format!("{}: {e}", path.display()).into())
    }

    /// Whether two are of one program and one plan; otherwise what differs.
    fn agrees(&self, other: &Self) -> Result<(), String> {
        if self.run.program != other.run.program {
            let (a, b) = (&self.run.program, &other.run.program);
            return Err(format!(
                "is by another build of the program ({b}, this is {a})"
            ));
        }
        if self != other {
            let (a, b) = (&self.run.of, &other.run.of);
            return Err(match a == b {
                true => "has other parts or other inputs".into(),
                false => format!(
                    "is of something else ({}, this is of {})",
                    short(b),
                    short(a)
                ),
            });
        }
        Ok(())
    }

    /// Writes the word of a campaign into its folder, or finds it there; shards `agree` on it, a run that is
    /// no shard replaces what an earlier one planned.
    pub(super) fn claim(
        &self,
        dir: &Path,
        agree: bool,
        overwrite: Overwrite,
    ) -> Result<(), Failure> {
        let path = dir.join(CAMPAIGN);
        let io = |e| OutputError::io(&path, e);
        std::fs::create_dir_all(dir).map_err(io)?;
        let text = to_text(self);
        // shards of several machines may have the same number of process
        let own = RandomState::new().build_hasher().finish();
        let own = dir.join(format!("{HELD}{own:016x}"));
        // held until it has its name: who clears up behind a run that was killed leaves it alone
        let mut file = loop {
            let file = File::create(&own).map_err(io)?;
            let _ = file.try_lock();
            if own.exists() {
                break file;
            }
        };
        file.write_all(text.as_bytes())
            .and_then(|()| file.sync_all())
            .map_err(io)?;
        // a second name: never over what is there
        let linked = std::fs::hard_link(&own, &path);
        if linked.is_ok() || !path.exists() {
            return std::fs::rename(&own, &path)
                .and_then(|()| std::fs::remove_file(&own).or(Ok(())))
                .map_err(|e| io(e).into());
        }
        if overwrite == Overwrite::Own {
            let objection = Self::read(dir).and_then(|other| match self.agrees(&other) {
                Err(why) if agree || other.campaign != self.campaign => Err(format!(
                    "{}: {why}; write elsewhere with -o, or replace it with --force",
                    path.display()
                )
                .into()),
                _ => Ok(()),
            });
            if objection.is_err() {
                let _ = std::fs::remove_file(&own);
                return objection;
            }
        }
        std::fs::rename(&own, &path).map_err(|e| io(e).into())
    }
}

/// The beginning of what something is of, which may be long.
pub(super) fn short(of: &str) -> String {
    match of.char_indices().nth(100) {
        Some((end, _)) => format!("{}...", &of[..end]),
        None => of.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_are_read_and_refused() {
        assert_eq!("3/12".parse(), Ok(Shard { number: 3, of: 12 }));
        for bad in ["0/3", "4/3", "3", "a/b", "1/0", "-1/3"] {
            assert!(bad.parse::<Shard>().is_err(), "{bad}");
        }
        let shards: Vec<Shard> = (1..=5).map(|number| Shard { number, of: 5 }).collect();
        for place in 0..23 {
            assert_eq!(shards.iter().filter(|s| s.has(place)).count(), 1);
        }
    }

    #[test]
    fn every_task_of_an_array_is_another_shard() {
        let of = |list: &[(&str, &str)]| {
            let list: Vec<(String, String)> = list
                .iter()
                .map(|(a, b)| (format!("SLURM_ARRAY_TASK_{a}"), (*b).to_owned()))
                .collect();
            Shard::of_array(&move |name| list.iter().find(|l| l.0 == name).map(|l| l.1.clone()))
        };
        let one = |id: &str, min: &str, step: &str| {
            of(&[("ID", id), ("COUNT", "4"), ("MIN", min), ("STEP", step)]).unwrap()
        };
        assert_eq!(of(&[]).unwrap(), None);
        assert_eq!(one("0", "0", "1"), Some(Shard { number: 1, of: 4 }));
        assert_eq!(one("4", "1", "1"), Some(Shard { number: 4, of: 4 }));
        assert_eq!(one("16", "10", "2"), Some(Shard { number: 4, of: 4 }));
        for first in [0, 1] {
            let mut numbers: Vec<usize> = (first..first + 4)
                .map(|id| of(&[("ID", &id.to_string()), ("COUNT", "4")]))
                .map(|s| s.unwrap().unwrap().number)
                .collect();
            numbers.sort_unstable();
            assert_eq!(numbers, [1, 2, 3, 4]);
        }
        assert!(of(&[("ID", "x"), ("COUNT", "4")]).is_err());
        let text = of(&[("ID", "7"), ("COUNT", "2"), ("MIN", "0")]).unwrap_err();
        assert!(text.to_string().contains("--shard"), "{text}");
    }

    #[test]
    fn shards_of_one_campaign_agree_and_others_are_refused() {
        let of = |what: &str, parts: usize| {
            let part = |i| Part {
                folder: format!("{i}"),
                of: String::new(),
            };
            Campaign {
                campaign: "prove".into(),
                run: Run {
                    program: "p".into(),
                    of: what.into(),
                },
                parts: (0..parts).map(part).collect(),
            }
        };
        let dir = tempfile::tempdir().unwrap();
        let dir = dir.path().join("new");
        let own = Overwrite::Own;
        std::thread::scope(|threads| {
            for _ in 0..8 {
                threads.spawn(|| of("1", 3).claim(&dir, true, own).unwrap());
            }
        });
        let files = || std::fs::read_dir(&dir).unwrap().count();
        assert_eq!((files(), Campaign::read(&dir).unwrap()), (1, of("1", 3)));
        let refused = |c: Campaign| c.claim(&dir, true, own).unwrap_err().to_string();
        let text = refused(of("2", 3));
        assert!(text.contains("something else (1, this is of 2)"), "{text}");
        let text = refused(of("1", 4));
        assert!(text.contains("other parts"), "{text}");
        // a whole run plans anew, and --force does
        of("5", 3).claim(&dir, false, own).unwrap();
        of("2", 3).claim(&dir, true, Overwrite::Any).unwrap();
        assert_eq!((files(), Campaign::read(&dir).unwrap()), (1, of("2", 3)));
        std::fs::write(dir.join(CAMPAIGN), "mine").unwrap();
        assert!(of("2", 3).claim(&dir, false, own).is_err());
        assert_eq!(std::fs::read(dir.join(CAMPAIGN)).unwrap(), b"mine");
        assert_eq!(files(), 1);
    }
}
