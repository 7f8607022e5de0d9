//! A parameter of a calibration: its name, unit, bounds, what is known of it beforehand, and how the search
//! sees it.

/// How the search sees a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Transform {
    /// As it is.
    Linear,
    /// By its natural logarithm: positive, and a step is a ratio.
    Log,
    /// By its reciprocal: what the data tell of a limit that may lie far away.
    Reciprocal,
}

impl Transform {
    /// From the model's value to the search's.
    pub fn to_search(self, value: f64) -> f64 {
        match self {
            Transform::Linear => value,
            Transform::Log => value.ln(),
            Transform::Reciprocal => 1.0 / value,
        }
    }

    /// From the search's value to the model's.
    pub fn to_model(self, search: f64) -> f64 {
        match self {
            Transform::Linear => search,
            Transform::Log => search.exp(),
            Transform::Reciprocal => 1.0 / search,
        }
    }

    /// Standard error of the model's value from that of the search's.
    pub fn std_error(self, value: f64, search_error: f64) -> f64 {
        match self {
            Transform::Linear => search_error,
            Transform::Log => value * search_error,
            Transform::Reciprocal => value * value * search_error,
        }
    }
}

/// One parameter, in the model's unit.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameter {
    /// What `--fix` and `--bound` call it, and the key in `fit.json`.
    pub name: String,
    /// What it is, in words.
    pub meaning: String,
    /// Unit of `start`, `lower`, `upper`.
    pub unit: &'static str,
    /// How the search sees it.
    pub transform: Transform,
    /// Where the search begins.
    pub start: f64,
    /// Smallest value.
    pub lower: f64,
    /// Largest value.
    pub upper: f64,
    /// Standard deviation, in the search's scale, of what is known beforehand about `start`; `None`: nothing.
    pub prior_sd: Option<f64>,
    /// Kept at `start`.
    pub fixed: bool,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transforms_invert_each_other() {
        for t in [Transform::Linear, Transform::Log, Transform::Reciprocal] {
            assert!((t.to_model(t.to_search(0.37)) - 0.37).abs() < 1e-15);
        }
        assert!((Transform::Log.std_error(2.0, 0.1) - 0.2).abs() < 1e-15);
    }
}
