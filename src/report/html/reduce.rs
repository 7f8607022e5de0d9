//! Long series made short without losing a spike: of each stretch of samples the first, the last and the
//! extreme ones stay.

/// Points of one drawn curve, at most.
pub const MOST_POINTS: usize = 1500;

/// Runs of points without a missing value, at most [`MOST_POINTS`] together where that can be. Of each
/// stretch of samples the first, the last, the lowest and the highest are kept, in their order; with `both`
/// also the leftmost and the rightmost, for curves that run back and forth. Stretches are as short as the
/// limit allows: where a curve is smooth these samples are two, so that more stretches fit.
pub fn curve(points: &[[f64; 2]], both: bool) -> Vec<Vec<[f64; 2]>> {
    if points.len() <= MOST_POINTS {
        return extremes(points, both, 1);
    }
    let most = points
        .len()
        .div_ceil(MOST_POINTS / if both { 6 } else { 4 });
    let mut bucket = (2 * points.len()).div_ceil(MOST_POINTS);
    loop {
        let runs = extremes(points, both, bucket);
        if bucket >= most || runs.iter().map(Vec::len).sum::<usize>() <= MOST_POINTS {
            return runs;
        }
        bucket = (bucket * 5).div_ceil(4).min(most);
    }
}

fn extremes(points: &[[f64; 2]], both: bool, bucket: usize) -> Vec<Vec<[f64; 2]>> {
    let mut runs: Vec<Vec<[f64; 2]>> = Vec::new();
    let mut open = false;
    let mut keep: Vec<usize> = Vec::with_capacity(6);
    for (number, chunk) in points.chunks(bucket).enumerate() {
        let first = number * bucket;
        let finite = |i: &usize| points[*i].iter().all(|v| v.is_finite());
        let here = first..first + chunk.len();
        let mut start = here.start;
        while start < here.end {
            // one stretch without a missing value
            let Some(begin) = (start..here.end).find(finite) else {
                open = false;
                break;
            };
            open &= begin == start;
            let end = (begin..here.end).find(|i| !finite(i)).unwrap_or(here.end);
            keep.clear();
            keep.extend([begin, end - 1]);
            for axis in if both { 0..2 } else { 1..2 } {
                let by = |a: &usize, b: &usize| points[*a][axis].total_cmp(&points[*b][axis]);
                keep.extend((begin..end).min_by(by));
                keep.extend((begin..end).max_by(by));
            }
            keep.sort_unstable();
            keep.dedup();
            if !open {
                runs.push(Vec::new());
            }
            if let Some(run) = runs.last_mut() {
                run.extend(keep.iter().map(|&i| points[i]));
            }
            open = end == here.end;
            start = end;
        }
    }
    runs
}

/// Runs of a band (x, low, high): of each stretch the lowest low and the highest high, at most half of
/// [`MOST_POINTS`] rows.
pub fn band(rows: &[[f64; 3]]) -> Vec<Vec<[f64; 3]>> {
    let bucket = rows.len().div_ceil(MOST_POINTS / 2).max(1);
    let mut runs: Vec<Vec<[f64; 3]>> = vec![Vec::new()];
    for chunk in rows.chunks(bucket) {
        let mut row: Option<[f64; 3]> = None;
        let mut broken = false;
        for &[x, low, high] in chunk {
            if !(x.is_finite() && low.is_finite() && high.is_finite()) {
                broken = true;
                continue;
            }
            row = Some(row.map_or([x, low, high], |r| [r[0], r[1].min(low), r[2].max(high)]));
        }
        if let (Some(row), Some(run)) = (row, runs.last_mut()) {
            run.push(row);
        }
        if broken && runs.last().is_some_and(|r| !r.is_empty()) {
            runs.push(Vec::new());
        }
    }
    runs.retain(|r| !r.is_empty());
    runs
}

/// Stretches of `x` in which `marked` holds, each as long as its samples reach.
pub fn spans(x: &[f64], marked: impl Fn(usize) -> bool) -> Vec<[f64; 2]> {
    let mut out: Vec<[f64; 2]> = Vec::new();
    let mut open = false;
    for i in 0..x.len() {
        let on = marked(i);
        if on {
            let from = x[i.saturating_sub(1)];
            let to = x[(i + 1).min(x.len() - 1)];
            match out.last_mut() {
                Some(last) if open => last[1] = (x[i] + to) / 2.0,
                _ => out.push([(from + x[i]) / 2.0, (x[i] + to) / 2.0]),
            }
        }
        open = on;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spike_survives() {
        let mut points: Vec<[f64; 2]> = (0..100_000).map(|i| [i as f64, 0.0]).collect();
        points[34_567][1] = 9.0;
        points[70_001][1] = -9.0;
        for both in [false, true] {
            let runs = curve(&points, both);
            assert_eq!(runs.len(), 1);
            assert!(runs[0].len() <= MOST_POINTS);
            assert!(runs[0].contains(&[34_567.0, 9.0]));
            assert!(runs[0].contains(&[70_001.0, -9.0]));
            assert_eq!(runs[0][0][0], 0.0);
            assert_eq!(runs[0].last().unwrap()[0], 99_999.0);
            assert!(runs[0].windows(2).all(|w| w[0][0] < w[1][0]));
        }
    }

    #[test]
    fn a_missing_value_breaks_the_curve_wherever_it_falls() {
        for n in [10, 10_000] {
            for at in [0, 1, n / 2, n - 1] {
                let mut points: Vec<[f64; 2]> = (0..n).map(|i| [i as f64, 1.0]).collect();
                points[at][1] = f64::NAN;
                let runs = curve(&points, false);
                let expected = if at == 0 || at == n - 1 { 1 } else { 2 };
                assert_eq!(runs.len(), expected, "{n} {at}");
                let crosses =
                    |r: &Vec<[f64; 2]>| r[0][0] < at as f64 && r[r.len() - 1][0] > at as f64;
                assert!(!runs.iter().any(crosses));
            }
        }
        assert!(curve(&[], false).is_empty());
    }

    #[test]
    fn a_band_keeps_its_widest_rows() {
        let mut rows: Vec<[f64; 3]> = (0..50_000).map(|i| [i as f64, -1.0, 1.0]).collect();
        rows[4_321][2] = 7.0;
        let runs = band(&rows);
        assert!(runs[0].len() <= MOST_POINTS / 2);
        assert!(runs[0].iter().any(|r| r[2] == 7.0));
        rows[100][1] = f64::NAN;
        assert_eq!(band(&rows).len(), 2);
        assert!(band(&[]).is_empty());
    }

    #[test]
    fn spans_reach_half_way_to_their_neighbours() {
        let x = [0.0, 1.0, 2.0, 3.0, 4.0];
        assert_eq!(spans(&x, |i| i == 1 || i == 2), vec![[0.5, 2.5]]);
        assert_eq!(spans(&x, |i| i != 2), vec![[0.0, 1.5], [2.5, 4.0]]);
        assert!(spans(&[], |_| true).is_empty());
    }
}
