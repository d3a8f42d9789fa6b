//! Trails over hand-made declarations, with findings as the scan would report them.
use super::super::super::*;
use super::super::{NotScannable, Place, Value, Values};
use super::*;

/// One declared frame of an accumulating effect. `book` carries the histories from frame to frame.
struct Made {
    declaration: Declaration,
    order: Vec<u32>,
}

fn made(g: FrameGraph) -> Made {
    let declaration = g.finish().unwrap().declaration;
    let order = (0..declaration.passes.len() as u32).collect();
    Made { declaration, order }
}

/// `gi.accumulate` blends `gi.trace` with its own history; `compose.sum` reads the result.
fn accumulating(scope: &HistoryScope) -> Made {
    let mut g = FrameGraph::new(Extent::new(8, 8));
    let desc = ImageDesc::full(Format::Rgba32Float);
    let traced = g.pass("gi.trace", Queue::Graphics, |p| (p.create("radiance", desc).0, |_: &mut Record| {}));
    let history = g.history(scope, "gi:colour", desc);
    let sum = g.pass("gi.accumulate", Queue::Graphics, |p| {
        p.sample(traced.read());
        p.sample(history.previous);
        (p.write(history.next).0, |_: &mut Record| {})
    });
    let lit = g.pass("compose.sum", Queue::Graphics, |p| {
        p.sample(sum.read());
        (p.create("lit", desc).0, |_: &mut Record| {})
    });
    g.output(lit.read());
    made(g)
}

fn nan_at(made: &Made, pass: &str, bad_inputs: &[&str]) -> Finding {
    let d = &made.declaration;
    let index = (0..d.passes.len() as u32).find(|&p| d.pass_name(p) == pass).unwrap();
    let output = &d.outputs_of(index)[0];
    let value = |v: f32| Value { values: Values::Float([v; 4]), channels: 4 };
    let reads = d.uses_of(index).iter().filter(|u| u.reads.is_some() && u.writes.is_none());
    let input = |name: String| {
        let bad = bad_inputs.contains(&name.as_str());
        Input { seen: InputValue::At(Place::pixel(3, 4), value(if bad { f32::NAN } else { 0.5 })), name }
    };
    Finding {
        pass: pass.to_owned(),
        pass_index: Some(index),
        output: output.name.clone(),
        resource: output.resource,
        version: output.version,
        nan: 1,
        infinite: 0,
        place: Place::pixel(3, 4),
        value: value(f32::NAN),
        parts: vec![Part { mip: 0, mips: 1, layer: 0, layers: 1 }],
        inputs: reads.map(|u| input(d.resource_name(u.resource))).collect(),
    }
}

/// A finding in the previous half of the only history, as the scan of imports reports it.
fn carried_in(made: &Made) -> Finding {
    let resource = made.declaration.histories[0].previous;
    let output = made.declaration.resource_name(resource);
    let mut finding = nan_at(made, "gi.trace", &[]);
    (finding.pass, finding.pass_index, finding.output) = ("import".to_owned(), None, output);
    (finding.resource, finding.version) = (resource, 0);
    finding
}

fn follow(tracker: &mut FindingTracker, frame: u32, made: &Made, findings: &[Finding]) {
    tracker.follow(frame, &made.declaration, &made.order, findings, &[]);
}

#[test]
fn a_clean_run_has_no_reports() {
    let (scope, mut tracker) = (HistoryScope::new(), FindingTracker::default());
    for frame in 0..4 {
        follow(&mut tracker, frame, &accumulating(&scope), &[]);
    }
    assert!(tracker.reports().is_empty() && tracker.carried.is_empty());
}

#[test]
fn one_nan_that_goes_round_for_ever_is_one_report_of_bounded_size() {
    let (scope, mut tracker) = (HistoryScope::new(), FindingTracker::default());
    for frame in 0..5000 {
        let made = accumulating(&scope);
        let mut findings = Vec::new();
        match frame {
            0..3 => {}
            3 => findings.extend(["gi.accumulate", "compose.sum"].map(|p| nan_at(&made, p, &[]))),
            _ => {
                findings.extend(["gi.accumulate", "compose.sum"].map(|p| nan_at(&made, p, &["gi:colour.previous"])));
                findings.push(carried_in(&made));
            }
        }
        follow(&mut tracker, frame, &made, &findings);
    }
    let [report] = tracker.reports() else { panic!("{:?}", tracker.reports()) };
    assert_eq!(
        (report.frame, report.origin.pass.as_str(), report.arose, report.last_frame),
        (3, "gi.accumulate", 1, 4999)
    );
    let path: Vec<String> = report.path.iter().map(Link::to_string).collect();
    assert_eq!(
        path.join(" → "),
        "gi.accumulate (frame 3) → history gi:colour → gi.accumulate (frame 4) → compose.sum (frame 4)"
    );
    let carried = tracker.carried.values().next().unwrap();
    assert!(carried.path.len() <= 3, "{:?}", carried.path);
    assert_eq!(carried.path.last().unwrap().to_string(), "gi.accumulate (frames 4 to 4999)");
}

#[test]
fn a_history_that_is_clean_as_it_comes_is_no_cause() {
    let (scope, mut tracker) = (HistoryScope::new(), FindingTracker::default());
    let made = accumulating(&scope);
    follow(&mut tracker, 0, &made, &[nan_at(&made, "gi.accumulate", &[])]);
    // After a camera cut the history reads as zero, so a bad value is a new origin.
    let made = accumulating(&scope);
    follow(&mut tracker, 1, &made, &[nan_at(&made, "gi.accumulate", &[])]);
    let [report] = tracker.reports() else { panic!("{:?}", tracker.reports()) };
    assert_eq!((report.frame, report.arose, report.path.len()), (0, 2, 1));
}

#[test]
fn the_input_that_is_bad_at_the_place_is_the_cause() {
    let mut g = FrameGraph::new(Extent::new(8, 8));
    let desc = ImageDesc::full(Format::R32Float);
    let make = |g: &mut FrameGraph, name: &str| {
        g.pass(name, Queue::Graphics, |p| (p.create("x", desc).0, |_: &mut Record| {}))
    };
    let (a, b) = (make(&mut g, "a"), make(&mut g, "b"));
    let c = g.pass("c", Queue::Graphics, |p| {
        p.sample(a.read());
        p.sample(b.read());
        (p.create("x", desc).0, |_: &mut Record| {})
    });
    g.output(c.read());
    let made = made(g);
    let findings = [nan_at(&made, "a", &[]), nan_at(&made, "b", &[]), nan_at(&made, "c", &["b:x"])];
    let mut tracker = FindingTracker::default();
    follow(&mut tracker, 7, &made, &findings);
    let names: Vec<(&str, usize)> = tracker.reports().iter().map(|r| (r.origin.pass.as_str(), r.path.len())).collect();
    assert_eq!(names, [("a", 1), ("b", 2)], "two origins, and c comes of b");
}

#[test]
fn a_clean_write_over_a_bad_version_ends_it_and_a_write_beside_it_does_not() {
    for (mip, reports) in [(0, 2), (1, 1)] {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let desc = ImageDesc { mips: 2, ..ImageDesc::full(Format::R32Float) };
        let a = g.pass("a", Queue::Graphics, |p| (p.create_part("x", desc, Part::mip(0)).0, |_: &mut Record| {}));
        let b = g.pass("b", Queue::Graphics, |p| (p.write_part(a, Part::mip(mip)).0, |_: &mut Record| {}));
        let c = g.pass("c", Queue::Graphics, |p| {
            p.sample_part(b.read(), Part::mip(0));
            (p.create("x", ImageDesc::full(Format::R32Float)).0, |_: &mut Record| {})
        });
        g.output(c.read());
        let made = made(g);
        let mut tracker = FindingTracker::default();
        follow(&mut tracker, 0, &made, &[nan_at(&made, "a", &[]), nan_at(&made, "c", &[])]);
        assert_eq!(tracker.reports().len(), reports, "b writes mip {mip}");
    }
}

#[test]
fn reports_say_where_what_and_how() {
    let (scope, mut tracker) = (HistoryScope::new(), FindingTracker::default());
    let made = accumulating(&scope);
    let mut finding = nan_at(&made, "gi.accumulate", &[]);
    finding.inputs.push(Input { name: "probes".to_owned(), seen: InputValue::Unknown(NotScannable::Raw) });
    follow(&mut tracker, 2, &made, &[finding]);
    let text = tracker.reports()[0].to_string();
    for part in [
        "frame 2, pass gi.accumulate, output gi:colour.next: 1 pixel with NaN, the first at (3, 4): (NaN, NaN, NaN, NaN)",
        "read gi.trace:radiance at (3, 4): (0.5, 0.5, 0.5, 0.5)",
        "read probes: not scanned",
        "went gi.accumulate (frame 2)",
        "in 1 output, last seen in frame 2",
    ] {
        assert!(text.contains(part), "{part} is not in {text}");
    }
}

#[test]
fn more_origins_than_there_is_room_for_are_counted() {
    let mut tracker = FindingTracker::default();
    for i in 0..MAX_ENTRIES as u32 + 5 {
        let mut g = FrameGraph::new(Extent::new(8, 8));
        let name = format!("pass{i}");
        let desc = ImageDesc::full(Format::R32Float);
        let x = g.pass(&name, Queue::Graphics, |p| (p.create("x", desc).0, |_: &mut Record| {}));
        g.output(x.read());
        let made = made(g);
        follow(&mut tracker, i, &made, &[nan_at(&made, &name, &[])]);
    }
    assert_eq!((tracker.reports().len(), tracker.left_out()), (MAX_ENTRIES, 5));
}
