//! Results of `magpie bench graph` as JSON and as a table.

use crate::clock::{Clock, RETIRE};
use crate::{Frame, Work};
use magpie::gpu::DeviceReport;
use magpie::measure::Spread;
use serde::Serialize;
use std::fmt::Write;
use std::thread::available_parallelism;

/// The four phases in order.
const PHASES: [&str; 4] = ["declare", "plan", "record", "submit"];
/// Number of passes that growth is measured from, up to the greatest number.
const GROWTH_FROM: u32 = 100;
const MICROSECOND: f64 = 1e3;

/// Results of a run.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Version of Magpie.
    pub magpie: &'static str,
    /// Name of the device.
    pub device: String,
    /// Name and version of its driver.
    pub driver: String,
    /// CPU threads of the machine.
    pub threads: usize,
    /// Whether the build includes the other libraries.
    pub peers: bool,
    /// The contestants.
    pub contestants: Vec<Entry>,
    /// Results, one per contestant and work.
    pub rows: Vec<Row>,
    /// Contestants that could not take part, with the reason.
    pub left_out: Vec<LeftOut>,
    /// Growth with the number of passes, one per contestant and variant with at least two sizes.
    pub growth: Vec<Growth>,
}

/// A contestant.
#[derive(Clone, Debug, Serialize)]
pub struct Entry {
    /// Name of the contestant.
    pub name: &'static str,
    /// What it rebuilds every frame and what it keeps.
    pub about: &'static str,
}

/// A contestant that could not do a work.
#[derive(Clone, Debug, Serialize)]
pub struct LeftOut {
    /// `buffer` or `image`.
    pub variant: &'static str,
    /// Passes of the frame.
    pub passes: u32,
    /// Name of the contestant.
    pub contestant: &'static str,
    /// The reason.
    pub why: String,
}

/// Results of one contestant on one work. Times are µs per pass, without the wait for the device.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// `buffer` or `image`.
    pub variant: &'static str,
    /// Passes of the frame.
    pub passes: u32,
    /// Name of the contestant.
    pub contestant: &'static str,
    /// Measured frames.
    pub frames: usize,
    /// `declare`, `plan`, `record` and `submit`, joined by `+` if they can only be timed together; then `retire`.
    pub phases: Vec<Phase>,
    /// Sum of the phases except `retire`, µs per pass.
    pub total_us: Spread,
    /// CPU time of the calling thread in the same phases, µs per pass: without time taken by other programs, and without other threads.
    /// None if the system does not provide it.
    pub cpu_us: Option<Spread>,
    /// Barriers per pass; none if the library does not report them.
    pub barriers_per_pass: Option<f64>,
    /// Heap allocations per frame.
    pub allocations_per_frame: u64,
}

/// Time of a phase.
#[derive(Clone, Debug, Serialize)]
pub struct Phase {
    /// Name of the phase.
    pub phase: &'static str,
    /// Time, µs per pass.
    pub us: Spread,
}

/// Growth of the time per pass with the number of passes; 1 means that the total is linear.
#[derive(Clone, Debug, Serialize)]
pub struct Growth {
    /// `buffer` or `image`.
    pub variant: &'static str,
    /// Name of the contestant.
    pub contestant: &'static str,
    /// The smaller number of passes.
    pub from: u32,
    /// The greater number of passes.
    pub to: u32,
    /// Ratio of the median CPU times per pass, greater over smaller; of the sums of phases if CPU time is unknown.
    pub ratio: f64,
}

impl Row {
    /// None without frames.
    pub(crate) fn new(
        contestant: &'static str,
        work: Work,
        samples: &[Clock],
        frame: Frame,
        allocations: u64,
    ) -> Option<Self> {
        let passes = f64::from(work.passes);
        let unit = MICROSECOND * passes;
        let phase = |at: usize, phase| {
            let times = samples.iter().filter_map(|clock| clock.laps().get(at)).map(|(_, time)| *time).collect();
            Spread::of(times, unit).map(|us| Phase { phase, us })
        };
        Some(Self {
            variant: work.variant.name(),
            passes: work.passes,
            contestant,
            frames: samples.len(),
            phases: samples.first()?.laps().iter().enumerate().filter_map(|(at, (name, _))| phase(at, *name)).collect(),
            total_us: Spread::of(samples.iter().map(Clock::total).collect(), unit)?,
            cpu_us: Spread::of(samples.iter().filter_map(Clock::cpu).collect(), unit),
            barriers_per_pass: frame.barriers.map(|barriers| f64::from(barriers) / passes),
            allocations_per_frame: allocations,
        })
    }

    /// The four phase columns. Joined phases are shown in the last of them, with `+` in the others.
    fn cells(&self) -> [String; 4] {
        PHASES.map(|column| {
            let named = |phase: &&Phase| phase.phase.split('+').any(|part| part == column);
            self.phases.iter().find(named).map_or_else(String::new, |phase| {
                let last = phase.phase.rsplit('+').next() == Some(column);
                if last { format!("{:.3}", phase.us.median) } else { "+".to_owned() }
            })
        })
    }
}

impl Report {
    pub(crate) fn new(device: &DeviceReport, contestants: Vec<Entry>, rows: Vec<Row>, left_out: Vec<LeftOut>) -> Self {
        Self {
            magpie: env!("CARGO_PKG_VERSION"),
            device: device.name.clone(),
            driver: device.driver.clone(),
            threads: available_parallelism().map_or(1, usize::from),
            peers: cfg!(feature = "peers"),
            contestants,
            left_out,
            growth: growth(&rows),
            rows,
        }
    }

    /// # Errors
    /// A value that JSON cannot represent.
    pub fn to_json(&self) -> Result<String, serde_json::Error> {
        serde_json::to_string_pretty(self).map(|text| text + "\n")
    }

    /// Median times as a text table.
    #[must_use]
    pub fn table(&self) -> String {
        // Writing to a String cannot fail.
        let mut text = String::new();
        let _ =
            writeln!(text, "what a frame graph costs the CPU: µs per pass, medians, without the wait for the device");
        let _ = writeln!(text, "{}, {}, {} threads", self.device, self.driver, self.threads);
        if !self.peers {
            text += "the other graphs are not built in: build with --features peers\n";
        }
        text += "`+`: counted in the next figure; sum: the four phases; cpu: this thread on a CPU in that time; retire: freeing after the device is done\n\n";
        let [declare, plan, record, submit] = PHASES;
        let _ = writeln!(
            text,
            "{:<7} {:>6} {:<20} {declare:>8} {plan:>8} {record:>8} {submit:>8} {:>8} {:>8} {:>9} {RETIRE:>8} {:>9} {:>12}",
            "variant", "passes", "contestant", "sum", "cpu", "least cpu", "barriers", "allocations"
        );
        for row in &self.rows {
            let [declare, plan, record, submit] = row.cells();
            let cells = |cpu: Spread| [cpu.median, cpu.min].map(|us| format!("{us:.3}"));
            let [cpu, least] = row.cpu_us.map(cells).unwrap_or_default();
            let retire = row.phases.iter().find(|phase| phase.phase == RETIRE);
            let retire = retire.map_or_else(String::new, |phase| format!("{:.3}", phase.us.median));
            let barriers =
                row.barriers_per_pass.map_or_else(|| "untold".to_owned(), |barriers| format!("{barriers:.2}"));
            let _ = writeln!(
                text,
                "{:<7} {:>6} {:<20} {declare:>8} {plan:>8} {record:>8} {submit:>8} {:>8.3} {cpu:>8} {least:>9} {retire:>8} {barriers:>9} {:>12}",
                row.variant, row.passes, row.contestant, row.total_us.median, row.allocations_per_frame
            );
        }
        for LeftOut { variant, passes, contestant, why } in &self.left_out {
            let _ = writeln!(text, "{variant:<7} {passes:>6} {contestant:<20} left out: {why}");
        }
        if !self.growth.is_empty() {
            text += "\ngrowth of the time per pass (1 is linear)\n";
        }
        for growth in &self.growth {
            let Growth { variant, contestant, from, to, ratio } = growth;
            let _ = writeln!(text, "{variant:<7} {contestant:<20} {from} to {to} passes: {ratio:.2}");
        }
        text
    }
}

fn growth(rows: &[Row]) -> Vec<Growth> {
    let last = |row: &&Row| rows.iter().all(|r| !same(r, row) || r.passes <= row.passes);
    let grown = |to: &Row| {
        let mut smaller = rows.iter().filter(|row| same(row, to) && row.passes < to.passes);
        let least = smaller.clone().min_by_key(|row| row.passes);
        let from = smaller.find(|row| row.passes == GROWTH_FROM).or(least)?;
        let time = |row: &Row| row.cpu_us.unwrap_or(row.total_us).median;
        let ratio = time(to) / time(from);
        Some(Growth { variant: to.variant, contestant: to.contestant, from: from.passes, to: to.passes, ratio })
    };
    rows.iter().filter(last).filter_map(grown).collect()
}

fn same(a: &Row, b: &Row) -> bool {
    (a.variant, a.contestant) == (b.variant, b.contestant)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Variant;

    fn row(passes: u32, laps: &[(&'static str, u64)]) -> Row {
        let mut clock = Clock::default();
        laps.iter().for_each(|(phase, time)| clock.note(phase, *time));
        let work = Work { variant: Variant::Buffer, passes };
        Row::new("someone", work, &[clock], Frame { barriers: Some(2 * passes) }, 7).unwrap()
    }

    #[test]
    fn times_are_per_pass_and_retiring_is_not_in_the_sum() {
        let row = row(10, &[("declare", 10_000), ("plan+record", 30_000), ("retire", 50_000)]);
        assert_eq!((row.total_us.median, row.phases[1].us.median, row.barriers_per_pass), (4.0, 3.0, Some(2.0)));
        assert_eq!(row.cells(), ["1.000", "+", "3.000", ""]);
    }

    #[test]
    fn growth_is_from_a_hundred_passes_where_there_are_such() {
        let ratio = |passes: &[u32]| {
            let rows: Vec<_> = passes.iter().map(|p| row(*p, &[("record", u64::from(p * p) * 1000)])).collect();
            growth(&rows).first().map(|g| (g.from, g.to, g.ratio))
        };
        assert_eq!(ratio(&[10, 100, 1000]), Some((100, 1000, 10.0)));
        assert_eq!(ratio(&[20, 10]), Some((10, 20, 2.0)));
        assert_eq!(ratio(&[100]), None);
    }
}
