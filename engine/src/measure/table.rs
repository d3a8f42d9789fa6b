//! The table of passes for a terminal.

use super::Report;

const RIGHT_FROM: usize = 2;

/// One row per pass, then the total: GPU time, share of the frame, CPU time, bytes per pixel and per second as declared, rays, non-finite values (summed over all frames), draws and
/// dispatches. Columns that are zero in every row are left out. With several queues, a line says how much time their overlap saved. Then what passes count themselves.
#[must_use]
pub fn pass_table(report: &Report) -> String {
    let frame_ms = report.frame.gpu_ms.map(|s| s.median);
    let head = [
        "pass",
        "queue",
        "GPU ms",
        "min",
        "p99",
        "share",
        "CPU us",
        "B/px",
        "GB/s",
        "rays",
        "not finite",
        "draws",
        "dispatches",
        "triangles",
        "fragments",
        "threads",
    ];
    let mut rows = vec![head.map(str::to_owned).to_vec()];
    let time = |ms: Option<f64>| ms.map_or_else(|| "-".to_owned(), |ms| format!("{ms:.3}"));
    let share = |ms: Option<f64>| match (ms, frame_ms) {
        (Some(ms), Some(frame)) if frame > 0.0 => format!("{:.1} %", 100.0 * ms / frame),
        _ => "-".to_owned(),
    };
    let pixels = f64::from(report.run.size[0]) * f64::from(report.run.size[1]);
    let per_pixel = |bytes: u64| match bytes as f64 / pixels {
        0.0 => "0".to_owned(),
        few if few < 10.0 => format!("{few:.1}"),
        many => format!("{many:.0}"),
    };
    let speed = |bytes: u64, ms: Option<f64>| match ms {
        _ if bytes == 0 => "0".to_owned(),
        Some(ms) if ms > 0.0 => format!("{:.2}", bytes as f64 / ms / 1e6),
        _ => "-".to_owned(),
    };
    for pass in &report.passes {
        let median = pass.gpu_ms.map(|s| s.median);
        rows.push(vec![
            pass.name.clone(),
            pass.queue.to_owned(),
            time(median),
            time(pass.gpu_ms.map(|s| s.min)),
            time(pass.gpu_ms.map(|s| s.p99)),
            share(median),
            format!("{:.1}", pass.cpu_us),
            per_pixel(pass.bytes),
            speed(pass.bytes, median),
            count(pass.rays.total()),
            count(pass.not_finite),
            pass.draws.to_string(),
            pass.dispatches.to_string(),
            count(pass.statistics.map_or(0, |s| s.clipping_primitives)),
            count(pass.statistics.map_or(0, |s| s.fragment_invocations)),
            count(pass.statistics.map_or(0, |s| s.compute_invocations)),
        ]);
    }
    let sum = |of: fn(&super::PassReport) -> u64| report.passes.iter().map(of).sum::<u64>();
    let measured: Vec<f64> = report.passes.iter().filter_map(|p| p.gpu_ms.map(|s| s.median)).collect();
    let passes_ms = (!measured.is_empty()).then(|| measured.iter().sum());
    rows.push(vec![
        "all passes".to_owned(),
        String::new(),
        time(passes_ms),
        String::new(),
        String::new(),
        share(passes_ms),
        format!("{:.1}", report.passes.iter().map(|p| p.cpu_us).sum::<f64>()),
        per_pixel(sum(|p| p.bytes)),
        speed(sum(|p| p.bytes), passes_ms),
        count(sum(|p| p.rays.total())),
        count(sum(|p| p.not_finite)),
        sum(|p| p.draws).to_string(),
        sum(|p| p.dispatches).to_string(),
        count(sum(|p| p.statistics.map_or(0, |s| s.clipping_primitives))),
        count(sum(|p| p.statistics.map_or(0, |s| s.fragment_invocations))),
        count(sum(|p| p.statistics.map_or(0, |s| s.compute_invocations))),
    ]);
    rows.push(vec![
        "frame".to_owned(),
        String::new(),
        time(frame_ms),
        time(report.frame.gpu_ms.map(|s| s.min)),
        time(report.frame.gpu_ms.map(|s| s.p99)),
        share(frame_ms),
        format!("{:.1}", report.frame.cpu_ms.median * 1e3),
    ]);
    let ruled = [1, report.passes.len() + 1];
    lay_out(&rows, &ruled) + &overlap(report) + &counts(report)
}

/// `gi.keep: 9808 surfels, 3 spawned`, a line for each pass that counts something itself.
fn counts(report: &Report) -> String {
    let of = |(name, n): &(&str, u64)| format!("{} {name}", count(*n));
    let line = |pass: &super::PassReport| {
        let all: Vec<String> = pass.counts.0.iter().map(of).collect();
        format!("{}: {}\n", pass.name, all.join(", "))
    };
    report.passes.iter().filter(|pass| !pass.counts.is_empty()).map(line).collect()
}

/// `overlap 0.840 ms, 12.0 % of the frame`; empty for one queue.
fn overlap(report: &Report) -> String {
    let Some(overlap_ms) = report.graph.overlap_ms.filter(|_| report.graph.queues > 1) else { return String::new() };
    match report.frame.gpu_ms {
        Some(frame) if frame.median > 0.0 => {
            format!("overlap {overlap_ms:.3} ms, {:.1} % of the frame\n", 100.0 * overlap_ms / frame.median)
        }
        _ => format!("overlap {overlap_ms:.3} ms\n"),
    }
}

/// `12.3 M` for large counts.
fn count(n: u64) -> String {
    match n {
        0..10_000 => n.to_string(),
        10_000..1_000_000 => format!("{:.1} k", n as f64 / 1e3),
        _ => format!("{:.1} M", n as f64 / 1e6),
    }
}

/// Aligns the columns. A rule precedes the rows with these indices.
fn lay_out(rows: &[Vec<String>], ruled: &[usize]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let cell = |row: &[String], column: usize| row.get(column).cloned().unwrap_or_default();
    let shown: Vec<usize> = (0..columns)
        .filter(|&c| c < RIGHT_FROM || rows[1..].iter().any(|r| !matches!(cell(r, c).as_str(), "" | "0")))
        .collect();
    let width = |c: usize| rows.iter().map(|r| cell(r, c).chars().count()).max().unwrap_or(0);
    let total: usize = shown.iter().map(|&c| width(c) + 2).sum::<usize>().saturating_sub(2);
    let mut text = String::new();
    for (at, row) in rows.iter().enumerate() {
        if ruled.contains(&at) {
            text += &"-".repeat(total);
            text.push('\n');
        }
        let cells: Vec<String> = shown
            .iter()
            .map(|&c| {
                if c < RIGHT_FROM {
                    format!("{:<1$}", cell(row, c), width(c))
                } else {
                    format!("{:>1$}", cell(row, c), width(c))
                }
            })
            .collect();
        text += cells.join("  ").trim_end();
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        config::Config,
        measure::{Device, FrameSample, PassTime, Recorder, Run},
    };

    fn report(gpu_ms: u64, passes: Vec<PassTime>) -> Report {
        let mut recorder = Recorder::new(0);
        recorder.push(FrameSample { gpu_ns: Some(gpu_ms * 1_000_000), passes, ..FrameSample::default() });
        let text = String::new;
        let device = Device { name: text(), driver: text(), kind: text() };
        let run = Run {
            magpie: text(),
            commit: text(),
            device,
            rays: text(),
            scene: text(),
            size: [1, 1],
            config: Config::default(),
        };
        recorder.report(run).unwrap()
    }

    #[test]
    fn what_queues_saved_is_told() {
        let pass = |queue, start_ms: u64, ms: u64| PassTime {
            queue,
            gpu_start_ns: Some(start_ms * 1_000_000),
            gpu_ns: Some(ms * 1_000_000),
            ..PassTime::default()
        };
        let last = |report: Report| pass_table(&report).lines().last().unwrap().to_owned();
        let two = report(8, vec![pass("graphics", 0, 7), pass("async compute", 5, 3)]);
        assert_eq!(last(two), "overlap 2.000 ms, 25.0 % of the frame");
        let one = report(8, vec![pass("graphics", 0, 7), pass("graphics", 7, 1)]);
        assert!(last(one).starts_with("frame "));
    }

    #[test]
    fn what_passes_count_themselves_is_below() {
        let of = |n| PassTime {
            name: "gi.keep".to_owned(),
            counts: vec![("surfels", n), ("dropped", 0)],
            ..PassTime::default()
        };
        let mut counted = report(1, vec![of(20_000)]);
        assert!(pass_table(&counted).ends_with("gi.keep: 20.0 k surfels, 0 dropped\n"));
        counted.passes[0].counts = super::super::Counts::default();
        assert!(!pass_table(&counted).contains("gi.keep:"));
    }

    #[test]
    fn the_table_lines_up_and_adds_up() {
        let pass = |name: &str, gpu_ms: u64, rays_any| PassTime {
            name: name.to_owned(),
            queue: "graphics",
            gpu_ns: Some(gpu_ms * 1_000_000),
            dispatches: 1,
            rays_any,
            ..PassTime::default()
        };
        let passes = vec![pass("gbuffer.draw", 2, 0), pass("shadows.trace", 6, 230_400)];
        let table = pass_table(&report(10, passes));
        let wanted = "\
pass           queue     GPU ms     min     p99    share  CPU us     rays  dispatches
-------------------------------------------------------------------------------------
gbuffer.draw   graphics   2.000   2.000   2.000   20.0 %     0.0        0           1
shadows.trace  graphics   6.000   6.000   6.000   60.0 %     0.0  230.4 k           1
-------------------------------------------------------------------------------------
all passes                8.000                   80.0 %     0.0  230.4 k           2
frame                    10.000  10.000  10.000  100.0 %     0.0
";
        assert_eq!(table, wanted, "\n{table}");
    }
}
